"""Errors of the radio package: one base, and for frames, whose fault it is.

A frame that cannot be *built* is the caller's fault; a frame that cannot be *read* is the
sender's (or the channel's). The two are different classes, because a receiver must survive the
second and a programmer must be told of the first.
"""

from __future__ import annotations


class RadioError(Exception):
    """Base of every error that this package raises."""


class LocalFrameError(RadioError, ValueError):
    """The caller asked for a frame that IEEE 802.15.4 cannot express."""


class RemoteFrameError(RadioError, ValueError):
    """Octets were received that are no valid frame: the sender's or the channel's fault."""


class FcsError(RemoteFrameError):
    """The frame check sequence does not match: the frame was damaged on its way."""


class UnsupportedFrameError(RemoteFrameError):
    """The frame may be valid, but it uses a part of the standard that is not implemented here."""
