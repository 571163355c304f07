"""Physics of the robot and its tank: rigid-tail dynamics, servo, battery, fields, camera."""
