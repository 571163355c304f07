"""Chips of the navigation board: physics in, volts or bus bytes out.

A chip sees the world through `Quantity` callables and knows nothing of firmware. Its noise comes
from a generator of its own, so that fitting or removing one chip changes no other's.
"""
