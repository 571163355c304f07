"""A transport over a file descriptor that does not block: pairs, ptys, serial devices, sockets.

What differs between those is how they are opened and closed; reading, writing and noticing that the
other end is gone are the same system calls, made here and nowhere else.
"""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Callable
from typing import Final

from spi_bus.errors import TransportClosedError, TransportLost
from spi_bus.transports.base import BUFFER_BYTES, READ_BYTES, Outbox, wait_any

__all__ = ["DescriptorTransport"]

_WRITE_BYTES: Final = 4096
_NOTHING_NOW: Final = frozenset((errno.EAGAIN, errno.EWOULDBLOCK, errno.EINTR))


class DescriptorTransport:
    """Reads and writes a descriptor; a subclass may say how to close it.

    Args:
        descriptor: open, readable and writable, not blocking; closed by `close`.
        description: for a person.
        peer: what is gone when the line is lost, for the message.
        buffer_bytes: most bytes kept that the system does not take.

    A write that fails does not raise: what the other end sent before it went is still to be read,
    and `read` raises `TransportLost` after the last of it.

    """

    openings = 1

    def __init__(
        self,
        descriptor: int,
        description: str,
        peer: str = "the other end",
        buffer_bytes: int = BUFFER_BYTES,
        close: Callable[[], None] | None = None,
    ) -> None:
        self._descriptor = descriptor
        self._description = description
        self._peer = peer
        self._outbox = Outbox(buffer_bytes)
        self._close = close
        self._broken: str | None = None
        self._closed = False

    @property
    def description(self) -> str:
        """What this is, and where."""
        return self._description

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._closed

    @property
    def room(self) -> int:
        """Bytes that `write` takes now."""
        return 0 if self._broken is not None or self._closed else self._outbox.room

    @property
    def pending(self) -> int:
        """Bytes that the system has not taken yet."""
        return len(self._outbox)

    @property
    def wants_writable(self) -> bool:
        """Whether something is pending."""
        return bool(self._outbox)

    def read(self, limit: int = READ_BYTES) -> bytes:
        """Return what has arrived; see `Transport`."""
        self._check_open()
        try:
            data = os.read(self._descriptor, limit)
        except OSError as error:
            if error.errno not in _NOTHING_NOW:
                raise self._lost(error.strerror) from error
            if self._broken is not None:
                raise self._lost(self._broken) from error
            return b""
        if not data and limit:
            raise self._lost("end of file")
        return data

    def write(self, data: bytes) -> None:
        """Take bytes to send; see `Transport`."""
        self._check_open()
        if self._broken is not None:
            raise self._lost(self._broken)
        self._outbox.add(data)
        self.flush()

    def flush(self) -> None:
        """Hand on what is pending without waiting."""
        while self._outbox and self._broken is None and not self._closed:
            try:
                count = os.write(self._descriptor, self._outbox.first(_WRITE_BYTES))
            except OSError as error:
                if error.errno not in _NOTHING_NOW:
                    self._broken = error.strerror
                    self._outbox.clear()
                return
            if not count:
                return
            self._outbox.drop(count)

    def fileno(self) -> int:
        """Return the descriptor, -1 when closed."""
        return -1 if self._closed else self._descriptor

    def next_deadline_s(self) -> float | None:
        """Return None: nothing here depends on time."""
        return None

    def wait(self, timeout_s: float) -> None:
        """Block until there may be something to do."""
        self._check_open()
        wait_any((self,), timeout_s, time.monotonic)

    def close(self) -> None:
        """Close the descriptor."""
        if self._closed:
            return
        self._closed = True
        self._outbox.clear()
        if self._close is not None:
            self._close()
        else:
            os.close(self._descriptor)

    def _check_open(self) -> None:
        if self._closed:
            raise TransportClosedError(f"{self._description} was closed: open it again")

    def _lost(self, reason: str | None) -> TransportLost:
        return TransportLost(f"{self._description}: {self._peer} is gone ({reason})")
