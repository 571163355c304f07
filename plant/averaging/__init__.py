"""Averaging of the dynamics over a tail-beat (source, chapter 5)."""
