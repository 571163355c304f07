"""Flexible tails of chapter 4: rigid segments joined by springs, and the modes of a beam.

Loaded only where a tail bends (``integrate.motion_of``), so that a rigid one compiles none of it.
"""
