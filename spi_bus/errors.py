"""Errors of the link package: one base, and the builtin that a caller would expect beside it.

Nothing that arrives from a wire raises: noise, stale frames and unknown messages are counted and
reported as events. What raises is a caller's mistake (a value that does not fit its field, a
message that this side does not send) or a full queue.
"""

__all__ = [
    "CobsError",
    "FieldError",
    "FrameError",
    "LayoutError",
    "LinkFull",
    "PayloadError",
    "SpiBusError",
    "UnknownMessageError",
]


class SpiBusError(Exception):
    """Base of every error of `spi_bus`."""


class CobsError(SpiBusError, ValueError):
    """Bytes that no COBS encoder produces; whoever sent them, or the wire, is at fault."""


class FrameError(SpiBusError, ValueError):
    """A frame that cannot exist: a payload too long, a header field out of its range."""


class FieldError(SpiBusError, ValueError):
    """A value that does not fit the field it was given for; the message names both."""


class PayloadError(SpiBusError, ValueError):
    """An intact payload that is no message of the table: the sender's table differs from ours."""


class LayoutError(SpiBusError, TypeError):
    """A message table that contradicts itself or its dataclasses: its author is at fault."""


class UnknownMessageError(SpiBusError, TypeError):
    """An object that is no message of the table, or one that only the other side sends."""


class LinkFull(SpiBusError, BufferError):  # noqa: N818 (a state to wait out, not a fault)
    """The send queue is full: nothing was queued; try again after a `MessageAcknowledged`."""
