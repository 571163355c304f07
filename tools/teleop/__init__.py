"""Driving a fish by hand: operator's input, setpoint, XBee module, status line (docs/teleop.md)."""
