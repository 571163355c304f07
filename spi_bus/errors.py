"""Errors of the link package: one base, and the builtin that a caller would expect beside it.

Nothing that arrives from a wire raises: noise, stale frames and unknown messages are counted and
reported as events. What raises is a caller's mistake (a value that does not fit its field, a
message that this side does not send), a full queue, or a transport that cannot be opened or is
gone: those are `TransportError`s, whose text is one line that says what is wrong and what to do.
"""

__all__ = [
    "CanInterfaceError",
    "CobsError",
    "FieldError",
    "FrameError",
    "LayoutError",
    "LinkFull",
    "MissingPackageError",
    "PayloadError",
    "PortBusyError",
    "PortNotFoundError",
    "PortPermissionError",
    "RecordingError",
    "SpiBusError",
    "TransportClosedError",
    "TransportError",
    "TransportFull",
    "TransportLost",
    "TransportUrlError",
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


class TransportError(SpiBusError):
    """A transport cannot be opened or used; `str()` is one line with the remedy."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))


class TransportUrlError(TransportError, ValueError):
    """A URL that names no transport, or an option that it does not have."""


class PortNotFoundError(TransportError, FileNotFoundError):
    """No such port, host or adapter: not plugged in, not running, or misspelt."""


class PortPermissionError(TransportError, PermissionError):
    """The port is there and may not be opened by this user."""


class PortBusyError(TransportError, BlockingIOError):
    """The port, path or link is in use by another program."""


class CanInterfaceError(TransportError, RuntimeError):
    """A CAN interface that python-can does not know, or that this machine does not have."""


class MissingPackageError(TransportError, ImportError):
    """A Python package that this transport needs is not installed."""


class RecordingError(TransportError, ValueError):
    """A recording that cannot be made, or a file that is none."""


class TransportLost(TransportError, ConnectionError):  # noqa: N818 (the line's state, not a fault)
    """The other end closed, or the device was unplugged; all that had arrived has been read."""


class TransportClosedError(TransportError, ValueError):
    """Used after our own `close`: the caller is at fault."""


class TransportFull(TransportError, BufferError):  # noqa: N818 (a state to wait out)
    """More than `room`: nothing was taken; try again when there is room."""
