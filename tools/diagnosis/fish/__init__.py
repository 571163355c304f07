"""The robotic fish as a model for the diagnosis: predictor, instruments, inputs, tolerances."""
