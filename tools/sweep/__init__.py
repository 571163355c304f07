"""Sweeps: one scenario at many points of its keys, and one table of what came of each."""
