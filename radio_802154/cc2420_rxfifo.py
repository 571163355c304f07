"""The CC2420's receive FIFO: 128 octets in a ring, cut into frames.

The host reads octets; the chip needs to know where frames end, because FIFOP tells of complete
frames, a rejected frame is taken out again, and nothing else is. The octets live in the chip's RAM
at 0x080, so that RAM access sees them.
"""

from __future__ import annotations

from collections import deque

from radio_802154.cc2420_registers import FIFO_OCTETS, RAM_RXFIFO


class RxFifo:
    """Ring of received octets. `unread` counts them all, `frames` cuts them (unread, complete)."""

    __slots__ = ("_frames", "_ram", "_read", "_write", "unread")

    def __init__(self, ram: bytearray) -> None:
        self._ram = ram
        self._read = 0
        self._write = 0
        self.unread = 0
        self._frames: deque[list[int]] = deque()  # [unread octets, 1 if complete]

    def flush(self) -> None:
        """Forget everything."""
        self._read = self._write = self.unread = 0
        self._frames.clear()

    @property
    def free(self) -> int:
        """Octets that still fit."""
        return FIFO_OCTETS - self.unread

    @property
    def frame_open(self) -> bool:
        """Whether the last frame is still arriving."""
        return bool(self._frames) and not self._frames[-1][1]

    @property
    def complete_next(self) -> bool:
        """Whether the frame that the host reads next, or is reading, is complete."""
        return bool(self._frames) and bool(self._frames[0][1])

    def begin_frame(self) -> None:
        """The octets that follow belong to a new frame."""
        self._frames.append([0, 0])

    def push(self, octets: bytes) -> None:
        """Take octets of the open frame; the caller has made sure that they fit."""
        ram, write = self._ram, self._write
        for octet in octets:
            ram[RAM_RXFIFO + write] = octet
            write = (write + 1) % FIFO_OCTETS
        self._write = write
        self.unread += len(octets)
        self._frames[-1][0] += len(octets)

    def end_frame(self) -> None:
        """The open frame is complete."""
        self._frames[-1][1] = 1
        self._drop_empty()

    def drop_open_frame(self) -> None:
        """Take what is left of the open frame out again; earlier frames stay."""
        if self.frame_open:
            octets = self._frames.pop()[0]
            self._write = (self._write - octets) % FIFO_OCTETS
            self.unread -= octets

    def peek(self) -> int:
        """Return the octet that a read would give; if there is none, whatever the RAM holds."""
        return self._ram[RAM_RXFIFO + self._read]

    def pop(self) -> bool:
        """Take one octet out, if there is one; return whether a frame has been read to its end."""
        if not self.unread:
            return False
        self._read = (self._read + 1) % FIFO_OCTETS
        self.unread -= 1
        self._frames[0][0] -= 1
        return self._drop_empty()

    def _drop_empty(self) -> bool:
        if self._frames and self._frames[0][1] and self._frames[0][0] == 0:
            self._frames.popleft()
            return True
        return False
