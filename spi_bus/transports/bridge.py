"""A real board in the place of an emulated one: emulated wires here, a transport there.

The protocol is the same on both, so nothing is translated. But SPI clocks filler and a serial line
does not, a slave works in words, and filler may stand between frames only. So bytes cross as whole
frames, stored until their zero has come: the wires never see half a frame that goes on later, the
transport never sees filler. That costs a frame's time on the wire and no more, since no link acts
on half a frame.

`FrameLine` is the transport's side. `BridgeMaster` plays the processing board's pins to an emulated
navigation board, `BridgeSlave` the navigation board's to an emulated processing board.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final

from firmware_model.scheduler import Scheduler
from firmware_model.signals import Signal
from spi_bus.transports.base import Clock, Transport, Waitable, wait_any
from spi_bus.transports.emulated import SpiWires

__all__ = ["BIT_FS", "BridgeMaster", "BridgeSlave", "FrameLine"]

BIT_FS: Final = 4_000_000_000
"""Bit period of `BridgeMaster`: 250 kHz, about the TelosB's 1048576 Hz / 4."""
_LONGEST: Final = 256
"""Bytes of the longest frame with its zero; a longer piece is noise."""
_KEPT: Final = 1024
"""Bytes kept each way: four of the longest frames. Beyond that a line holds its peer back (in) or
loses frames (out), which the link sends again."""
_DRAIN_WORDS: Final = 200
"""Words clocked at most for a frame whose end does not come: more than the longest frame."""

Watcher = Callable[[bytes], None]


def _unwatched(_frame: bytes) -> None:
    """Stand in where nobody watches."""


class FrameLine:
    """A transport as a queue of whole frames each way; no byte of it waits for anybody.

    Args:
        transport: open; `close` closes it.
        clock: monotonic, in seconds; the one that the transport was opened with.

    """

    def __init__(self, transport: Transport, clock: Clock) -> None:
        self.transport = transport
        self.incoming: deque[bytes] = deque()
        """Frames that came and that the wires have not taken yet, each with its zero."""
        self.on_incoming: Callable[[], None] = lambda: None
        """Called when `incoming` has got something; set by the bridge."""
        self.watch_incoming: Watcher = _unwatched
        self.watch_outgoing: Watcher = _unwatched
        """Called with every frame that arrives, and that is handed to the transport."""
        self.frames_in = 0
        self.frames_out = 0
        self.frames_dropped = 0
        """Frames of the emulated board that found the line full or gone for long."""
        self.noise_bytes = 0
        """Bytes in pieces too long to be a frame, either way."""
        self.bytes_in = 0
        self.resumptions = 0
        """How often the line was opened again."""
        self._clock = clock
        self._openings = transport.openings
        self._arriving = bytearray()
        self._leaving = bytearray()
        self._queue: deque[bytes] = deque([b"\0"])  # ends what our noise at opening may have begun
        self._waiting = 1

    @property
    def held(self) -> bool:
        """Whether frames wait for the transport to take them."""
        return bool(self._queue)

    def wait(self, timeout_s: float) -> None:
        """Block until the transport may have something to do, at most this long."""
        wait_any((self.transport,), timeout_s, self._clock)

    def waitables(self) -> list[Waitable]:
        """Return what to wait on, for somebody who waits for other lines, too."""
        return [self.transport]

    def poll(self) -> bool:
        """Move what can be moved now; return whether frames came."""
        before = self.frames_in
        if sum(map(len, self.incoming)) < _KEPT:
            data = self.transport.read(_KEPT)
            self._look_for_reopening()
            if data:
                self._take(data)
        self._flush()
        return self.frames_in != before

    def give(self, octets: bytes) -> None:
        """Take bytes off the wires; frames among them go out, filler does not."""
        leaving = self._leaving
        for byte in octets:
            if byte:
                leaving.append(byte)
            elif leaving:
                frame = bytes(leaving) + b"\0"
                leaving.clear()
                self._send(frame)

    def close(self) -> None:
        """Close the transport."""
        self.transport.close()

    def _take(self, data: bytes) -> None:
        self.bytes_in += len(data)
        *ended, rest = data.split(b"\0")
        for piece in ended:
            frame = bytes(self._arriving) + piece
            self._arriving.clear()
            if len(frame) >= _LONGEST:
                self.noise_bytes += len(frame)
            elif frame:
                frame += b"\0"
                self.frames_in += 1
                self.incoming.append(frame)
                self.watch_incoming(frame)
        self._arriving += rest
        if len(self._arriving) >= 2 * _LONGEST:
            # The rest of it is noise as well, up to a zero: one byte over the longest stays.
            self.noise_bytes += len(self._arriving) - _LONGEST
            del self._arriving[_LONGEST:]

    def _send(self, frame: bytes) -> None:
        if len(frame) > _LONGEST:
            self.noise_bytes += len(frame)
            return
        if self._waiting + len(frame) > _KEPT:
            self.frames_dropped += 1
            return
        self._queue.append(frame)
        self._waiting += len(frame)
        self._flush()

    def _flush(self) -> None:
        transport = self.transport
        while self._queue and len(self._queue[0]) <= transport.room:
            frame = self._queue.popleft()
            self._waiting -= len(frame)
            transport.write(frame)
            if len(frame) > 1:
                self.frames_out += 1
                self.watch_outgoing(frame)
        transport.flush()

    def _look_for_reopening(self) -> None:
        openings = self.transport.openings
        if openings != self._openings:
            self._openings = openings
            self.resumptions += 1
            self._arriving.clear()  # its other half went with the old line
            self._queue.appendleft(b"\0")
            self._waiting += 1


class BridgeSlave:
    """A `SpiTarget` that stands where the navigation board's SPI module was."""

    def __init__(self, line: FrameLine) -> None:
        self.data_ready: Signal[bool] = Signal("bridge.ready", False)
        self._line = line
        self._out = b""
        self._index = 0
        line.on_incoming = self._raise

    def select(self, selected: bool) -> None:
        """Chip select; transfers delimit nothing."""

    def begin(self) -> int:
        """Return the next byte of a frame, or filler."""
        if self._index >= len(self._out):
            if not self._line.incoming:
                return 0
            self._out, self._index = self._line.incoming.popleft(), 0
        byte = self._out[self._index]
        self._index += 1
        if self._index >= len(self._out) and not self._line.incoming:
            self.data_ready.set(False)
        return byte

    def end(self, mosi: int) -> None:
        """Take a byte of the master's."""
        self._line.give(bytes((mosi,)))

    def _raise(self) -> None:
        self.data_ready.set(True)


class BridgeMaster:
    """Clocks the wires where the processing board's USART was.

    It clocks words of two bytes while frames wait for the slave, the slave's data-ready is up, or
    the slave is in the middle of a frame; not while the transport has no room for the answer, so
    that the slave keeps what it has to say.
    """

    def __init__(self, scheduler: Scheduler, wires: SpiWires, line: FrameLine) -> None:
        self._scheduler = scheduler
        self._wires = wires
        self._line = line
        self._out = b""
        self._index = 0
        self._busy = False
        self._drained = 0
        line.on_incoming = self._start
        wires.data_ready.watch(lambda ready: self._start() if ready else None)

    def _wanted(self) -> bool:
        if self._index < len(self._out) or 0 < self._drained < _DRAIN_WORDS:
            return True
        return bool(self._line.incoming) or (self._wires.data_ready.value and not self._line.held)

    def _start(self) -> None:
        if not self._busy and self._wanted():
            self._busy = True
            self._wires.select(True)
            self._word()

    def resume(self) -> None:
        """Look again whether there is something to clock: the transport may have room now."""
        self._start()

    def _word(self) -> None:
        if self._index >= len(self._out) and self._line.incoming:
            frame = self._line.incoming.popleft()
            self._out, self._index = frame + bytes(len(frame) & 1), 0
        word = self._out[self._index : self._index + 2] or b"\0\0"
        self._index += 2
        self._byte(word[0], lambda first: self._second(word[1], first))

    def _second(self, mosi: int, first: int) -> None:
        self._byte(mosi, lambda second: self._ended(bytes((first, second))))

    def _byte(self, mosi: int, then: Callable[[int], None]) -> None:
        self._wires.begin(mosi, BIT_FS)
        self._scheduler.after(8 * BIT_FS, lambda: then(self._wires.end()))

    def _ended(self, answer: bytes) -> None:
        self._line.give(answer)
        # A zero in the last place is filler or the end of a frame, anything else its middle.
        self._drained = self._drained + 1 if answer[1] else 0
        if self._wanted():
            self._word()
        else:
            self._busy = False
            self._wires.select(False)
