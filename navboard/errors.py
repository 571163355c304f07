"""Errors of the navigation board."""

from __future__ import annotations


class NavBoardError(Exception):
    """Base of every error of the navigation board."""


class ConfigurationError(NavBoardError, ValueError):
    """A board was asked for that cannot be built."""


class SentenceError(NavBoardError, ValueError):
    """An NMEA sentence is not what it says it is."""


class BusError(NavBoardError, OSError):
    """A chip on the I²C bus did not acknowledge."""
