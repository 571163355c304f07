"""Lines with their bits counted, and transports on them: a serial cable and a CAN bus, simulated.

Time is simulated, in nanoseconds, so that what is measured on them depends on the protocols alone
and not on the machine. The serial line has ten bits a byte (8N1) each way. The CAN bus is shared:
of what waits the lowest identifier goes, and a frame takes its bits of ISO 11898-1:2015, the stuff
bits of its very contents included, and three of silence.

`CanBusEnd` is what `CanTransport` takes for a python-can bus, so that segmentation, flow control
and queues are those of real CAN; `SerialEnd` is a transport with the buffer that a system has.
"""

from __future__ import annotations

import errno
from collections import deque
from dataclasses import dataclass, field
from functools import cache
from heapq import heappop, heappush
from itertools import count
from typing import Any, Final

import can

from spi_bus.transports.base import BUFFER_BYTES, READ_BYTES, Outbox

BITS_A_BYTE: Final = 10  # start bit, eight, stop bit
CHUNK_BYTES: Final = 16  # what a UART's FIFO hands over together (16550 and later)
QUEUE_FRAMES: Final = 10  # a CAN interface's queue: Linux' default txqueuelen
SECOND_NS: Final = 1_000_000_000

_TAIL_BITS: Final = 10 + 3  # CRC delimiter, acknowledgement and its delimiter, end, intermission


class Simulation:
    """The clock, and what happens at which time; at one time in the order it was asked for."""

    def __init__(self) -> None:
        self.now_ns = 0
        self._agenda: list[tuple[int, int, Any]] = []
        self._order = count()

    def __call__(self) -> float:
        """The time in seconds, as transports and runners ask for it."""
        return self.now_ns / SECOND_NS

    def at(self, when_ns: int, action: Any) -> None:
        """Call `action` at a time."""
        heappush(self._agenda, (when_ns, next(self._order), action))

    def step(self, until_ns: int) -> None:
        """Go on to what happens next, at most to `until_ns`."""
        if self._agenda and self._agenda[0][0] <= until_ns:
            self.now_ns, _, action = heappop(self._agenda)
            action()
        else:
            self.now_ns = until_ns


@dataclass(slots=True)
class Load:
    """What a line carried."""

    bits: int = 0
    """Line bits that were not idle."""
    data_bytes: int = 0
    """Bytes of our stream, on CAN of all data fields."""


class SerialEnd:
    """One end of a serial line: a transport.

    Args:
        simulation: the clock.
        baud: bits a second.
        latency_s: from the last bit of a chunk to its reader, as a USB adapter has it.

    """

    openings = 1
    wants_writable = False
    description = "simulated serial line"

    def __init__(self, simulation: Simulation, baud: int, latency_s: float = 0.0) -> None:
        self._simulation = simulation
        self._baud = baud
        self._latency_ns = round(latency_s * SECOND_NS)
        self._outbox = Outbox(BUFFER_BYTES)
        self._arrived = bytearray()
        self._busy = False
        self.load = Load()
        self.other: SerialEnd | None = None

    @property
    def room(self) -> int:
        """Bytes that `write` takes now."""
        return self._outbox.room

    @property
    def pending(self) -> int:
        """Bytes that have not begun to go."""
        return len(self._outbox)

    def read(self, limit: int = READ_BYTES) -> bytes:
        """Return what has arrived."""
        data = bytes(self._arrived[:limit])
        del self._arrived[:limit]
        return data

    def write(self, data: bytes) -> None:
        """Take bytes to send."""
        self._outbox.add(data)
        self.flush()

    def flush(self) -> None:
        """Put the next chunk on the line if it is idle."""
        if self._busy or not len(self._outbox):
            return
        chunk = self._outbox.first(CHUNK_BYTES)
        self._outbox.drop(len(chunk))
        self._busy = True
        bits = BITS_A_BYTE * len(chunk)
        self.load.bits += bits
        self.load.data_bytes += len(chunk)
        end_ns = self._simulation.now_ns + bits * SECOND_NS // self._baud

        def gone() -> None:
            self._busy = False
            self.flush()

        def come() -> None:
            if self.other is not None:
                self.other._arrived += chunk

        self._simulation.at(end_ns, gone)
        self._simulation.at(end_ns + self._latency_ns, come)

    def fileno(self) -> int:
        """There is no descriptor."""
        return -1

    def next_deadline_s(self) -> float | None:
        """Nothing is due by itself: the simulation says when."""
        return None

    def wait(self, timeout_s: float) -> None:
        """Nobody waits in simulated time."""

    def close(self) -> None:
        """Nothing is held."""


def serial_pair(
    simulation: Simulation, baud: int, latency_s: float = 0.0
) -> tuple[SerialEnd, SerialEnd]:
    """Both ends of a line."""
    ends = SerialEnd(simulation, baud, latency_s), SerialEnd(simulation, baud, latency_s)
    ends[0].other, ends[1].other = ends[1], ends[0]
    return ends


@dataclass
class CanBus:
    """The wire that all nodes share."""

    simulation: Simulation
    bit_rate: int
    load: Load = field(default_factory=Load)
    ends: list[CanBusEnd] = field(default_factory=list)
    busy: bool = False

    def arbitrate(self) -> None:
        """Let the lowest identifier that waits have the wire, if it is idle."""
        waiting = [end for end in self.ends if end.queue]
        if self.busy or not waiting:
            return
        sender = min(waiting, key=lambda end: end.queue[0].arbitration_id)
        message = sender.queue.popleft()
        self.busy = True
        bits = frame_bits(message.arbitration_id, bytes(message.data), fd=message.is_fd)
        self.load.bits += bits
        self.load.data_bytes += len(message.data)

        def over() -> None:
            self.busy = False
            for end in self.ends:
                if end is not sender:
                    end.arrived.append(message)
            self.arbitrate()

        self.simulation.at(self.simulation.now_ns + bits * SECOND_NS // self.bit_rate, over)


class CanBusEnd:
    """A node, with as much of python-can's bus as `CanTransport` uses."""

    def __init__(self, bus: CanBus) -> None:
        self._bus = bus
        self.queue: deque[can.Message] = deque()
        self.arrived: deque[can.Message] = deque()
        bus.ends.append(self)

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        """Take a frame, or be full as a socket is."""
        if len(self.queue) >= QUEUE_FRAMES:
            raise can.CanOperationError("the queue is full", error_code=errno.ENOBUFS)
        self.queue.append(message)
        self._bus.simulation.at(self._bus.simulation.now_ns, self._bus.arbitrate)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame that came."""
        return self.arrived.popleft() if self.arrived else None

    def fileno(self) -> int:
        """There is no descriptor."""
        return -1

    def shutdown(self) -> None:
        """Nothing is held."""


def frame_bits(identifier: int, data: bytes, *, fd: bool = False) -> int:
    """Bits of a data frame on the wire with an 11-bit identifier, stuffed, with the intermission.

    Args:
        identifier: 11 bits.
        data: 0 to 8 bytes, with `fd` a length that CAN FD has.
        fd: CAN FD at one bit rate.

    """
    content = int.from_bytes(data, "big")
    size = 8 * len(data)
    if fd:
        # SOF, identifier, RRS, IDE, FDF, res, BRS, ESI, DLC: clause 10.4.2.3
        code = _FD_CODES[len(data)]
        head = identifier << 10 | 1 << 7 | code  # FDF is the only other recessive bit
        bits = f"{head:022b}" + (f"{content:0{size}b}" if size else "")
        count_and_crc = 4 + (17 if len(data) <= 16 else 21)
        # a fixed stuff bit ahead of the stuff count, and after every four bits from there on
        return len(stuffed(bits)) + count_and_crc + -(-count_and_crc // 4) + _TAIL_BITS
    # SOF, identifier, RTR, IDE, r0, DLC: clause 10.4.2.2
    bits = f"{identifier << 7 | len(data):019b}" + (f"{content:0{size}b}" if size else "")
    return len(stuffed(bits + f"{crc15(bits):015b}")) + _TAIL_BITS


_FD_CODES: Final = {
    length: code
    for code, length in enumerate((0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64))
}


def crc15(bits: str) -> int:
    """CRC of classic CAN: x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1, start 0."""
    table = _crc15_table()
    register = 0
    for octet in int(bits or "0", 2).to_bytes(-(-len(bits) // 8), "big"):  # zeros ahead: no matter
        register = (register << 8 & 0x7FFF) ^ table[register >> 7 ^ octet]
    return register


@cache
def _crc15_table() -> tuple[int, ...]:
    def one(octet: int) -> int:
        register = octet << 7
        for _ in range(8):
            register = register << 1 ^ (0xC599 if register & 0x4000 else 0)
        return register

    return tuple(one(octet) for octet in range(256))


def stuffed(bits: str) -> str:
    """Bits with one of the other kind after every five of a kind, stuff bits counted in."""
    out = []
    last, run = "", 0
    for at in range(0, len(bits), 8):
        some, last, run = _stuffed_some(last, run, bits[at : at + 8])
        out.append(some)
    return "".join(out)


@cache
def _stuffed_some(last: str, run: int, bits: str) -> tuple[str, str, int]:
    out = []
    for bit in bits:
        run = run + 1 if bit == last else 1
        last = bit
        out.append(bit)
        if run == 5:
            last = "0" if bit == "1" else "1"
            out.append(last)
            run = 1
    return "".join(out), last, run
