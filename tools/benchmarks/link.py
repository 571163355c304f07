"""The link: how fast frames are made and read, and how much of a line it fills with payload.

Speeds are of this machine; what a line carries is computed on a simulated one (`lines`), with both
links, their windows, acknowledgements and transports running, and comes out the same everywhere.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, make_dataclass
from random import Random
from typing import Any, Final

from spi_bus import crc
from spi_bus.frame import MAX_PAYLOAD_BYTES, Decoder, Frame, FrameType, seal
from spi_bus.layout import U48, U64, Field, Layout, MessageRow, MessageTable
from spi_bus.link import Event, Link, LinkConfig, MessageAcknowledged, MessageReceived, Role
from spi_bus.messages import LINK_MESSAGES, MASTER, SLAVE, SensorReport
from spi_bus.transports.base import Transport
from spi_bus.transports.can_bus import CanTransport
from spi_bus.transports.isotp import IsoTpConfig
from spi_bus.transports.runner import LinkRunner
from tools.benchmarks.lines import (
    SECOND_NS,
    CanBus,
    CanBusEnd,
    Load,
    Simulation,
    serial_pair,
)
from tools.benchmarks.measure import Effort, Figures, Row, best_s

WANTED: Final = "≥ 20 MB/s"
FRAMES: Final = 4_000
MESSAGES: Final = 2_000
_REPORT: Final = SensorReport(
    2_000_000, 100, 0.5, 0.1, -0.2, 9.81, 1.0, 1.01, 0.25, 7.4, 0.33, 21.5, None
)

PAYLOADS: Final[dict[str, Callable[[Random], bytes]]] = {
    "247 bytes": lambda random: random.randbytes(MAX_PAYLOAD_BYTES),
    "32 bytes": lambda random: random.randbytes(32),
    "8 bytes": lambda random: random.randbytes(8),
    "a SensorReport": lambda random: LINK_MESSAGES.encode(_REPORT),
    "247 zeros": lambda random: bytes(MAX_PAYLOAD_BYTES),
    "every other byte zero": lambda random: b"\x05\0" * (MAX_PAYLOAD_BYTES // 2),
}
"""By name what a frame carries: random bytes, and what costs COBS the most."""


def codec(effort: Effort) -> Figures:
    """Bytes on the wire a second, of one thread's time, and nanoseconds a frame."""
    random = Random(1)
    figures: Figures = {}
    for name, payload in PAYLOADS.items():
        bodies = [
            Frame(FrameType.DATA, 0x21, index & 0xFF, 3, 0x10, 4, payload(random)).body()
            for index in range(FRAMES)
        ]
        stream = b"".join(map(seal, bodies))
        if Decoder().receive(stream) != bodies:
            raise RuntimeError(f"frames of {name} do not come back")
        chunks = [stream[at : at + 64] for at in range(0, len(stream), 64)]

        def encode(bodies: list[bytes] = bodies) -> None:
            for body in bodies:
                seal(body)

        def decode(stream: bytes = stream) -> None:
            Decoder().receive(stream)

        def decode_chunks(chunks: list[bytes] = chunks) -> None:
            receive = Decoder().receive
            for chunk in chunks:
                receive(chunk)

        times = best_s(4 * effort.repeats, encode, decode, decode_chunks, clock=time.thread_time)
        for what, time_s in zip(("encode", "decode", "chunks"), times, strict=True):
            figures[f"{name}: {what}"] = len(stream) / time_s
            figures[f"{name}: {what} a frame"] = time_s / FRAMES
    octets = random.randbytes(4_000_000)
    (time_s,) = best_s(effort.repeats, lambda: crc.crc16(octets), clock=time.thread_time)
    figures["crc"] = len(octets) / time_s
    return figures


def codec_rows(figures: Figures) -> Sequence[Row]:
    """Encoding and decoding of each kind of frame; the CRC by itself."""
    rows = []
    for name in PAYLOADS:
        for what, label in (
            ("encode", f"frames of {name}, made"),
            ("decode", "  read, all at once"),
            ("chunks", "  read, 64 bytes at a time"),
        ):
            speed, frame_s = figures[f"{name}: {what}"], figures[f"{name}: {what} a frame"]
            rows.append(
                Row(label, f"{speed / 1e6:.0f} MB/s", WANTED, f"{1e6 * frame_s:.2f} µs a frame")
            )
    rows.append(Row("CRC alone", f"{figures['crc'] / 1e6:.0f} MB/s"))
    return rows


def messages(effort: Effort) -> Figures:
    """Messages a second through two links in one thread: encoded, sent, received, acknowledged."""
    figures: Figures = {}
    for name, table, message in (
        ("SensorReport", LINK_MESSAGES, _REPORT),
        ("largest payload", BLOCKS, _blocks(SLAVE, 1)[0]),
    ):
        config = LinkConfig(window=8, queue_limit=8, ack_delay_us=0)
        master, slave = Link(Role.MASTER, 1, config, table), Link(Role.SLAVE, 2, config, table)

        def run(master: Link = master, slave: Link = slave, message: object = message) -> None:
            received = 0
            while received < MESSAGES:
                while slave.queued < 8:
                    slave.send(message)
                told = master.receive(slave.data_to_send(0), 0)
                received += sum(isinstance(event, MessageReceived) for event in told)
                slave.receive(master.data_to_send(0), 0)

        (time_s,) = best_s(effort.repeats, run, clock=time.thread_time)
        figures[name] = MESSAGES / time_s
    return figures


def messages_rows(figures: Figures) -> Sequence[Row]:
    """Messages a second."""
    return [
        Row(f"through both links: {name}", f"{speed:,.0f} messages/s")
        for name, speed in figures.items()
    ]


def imports(effort: Effort) -> Figures:
    """Time of a process that imports the link, beyond one that imports nothing."""

    def start(statement: str) -> Callable[[], object]:
        command = [sys.executable, "-c", statement]
        return lambda: subprocess.run(command, check=True)

    nothing_s, link_s = best_s(2 * effort.repeats, start("pass"), start("import spi_bus.link"))
    return {"link_s": link_s - nothing_s}


def imports_rows(figures: Figures) -> Sequence[Row]:
    """Milliseconds."""
    return [Row("import spi_bus.link", f"{1e3 * figures['link_s']:.0f} ms")]


# Lines.

WIDE: Final = 30  # fields of 8 bytes, and one of 6: with the number the largest payload


def _block_row(kind: int, sender: str) -> MessageRow:
    names = [f"value_{index}" for index in range(WIDE)]
    message: Any = make_dataclass(
        f"BlockOf{sender.title()}", [*names, "rest"], frozen=True, slots=True
    )
    rows = (*(Field(name, U64) for name in names), Field("rest", U48))
    return MessageRow(kind, sender, Layout(message, rows), "as many bytes as a frame carries")


BLOCKS: Final = MessageTable((_block_row(1, MASTER), _block_row(2, SLAVE)))


def _blocks(sender: str, count: int) -> list[object]:
    """Messages of the largest payload with random contents."""
    row = next(row for row in BLOCKS.rows if row.sender == sender)
    random = Random(sender)
    return [
        row.layout.message(*(random.getrandbits(64) for _ in range(WIDE)), random.getrandbits(48))
        for _ in range(count)
    ]


@dataclass(frozen=True, slots=True)
class LineCase:
    """A row of the table of lines."""

    name: str
    bit_rate: int
    can: bool = False
    fd: bool = False
    both: bool = True
    """Both sides send all that they can; else the slave alone."""
    latency_s: float = 0.0
    window: int = LinkConfig().window
    segment_bytes: int = 256
    """Of an ISO-TP payload."""


LINES: Final = (
    LineCase("serial 921 600 baud, one way", 921_600, both=False),
    LineCase("serial 921 600 baud, both ways", 921_600),
    LineCase("  with 1 ms of latency", 921_600, latency_s=1e-3),
    LineCase("  with 16 ms (USB adapter), window 15", 921_600, latency_s=16e-3, window=15),
    LineCase("serial 115 200 baud, both ways", 115_200),
    LineCase("CAN 1 Mbit/s, one way", 1_000_000, can=True, both=False),
    LineCase(
        "  window 15, payload=512", 1_000_000, can=True, both=False, window=15, segment_bytes=512
    ),
    LineCase("CAN 1 Mbit/s, both ways", 1_000_000, can=True),
    LineCase("CAN FD 1 Mbit/s, one way", 1_000_000, can=True, fd=True, both=False),
    LineCase("CAN FD 1 Mbit/s, both ways", 1_000_000, can=True, fd=True),
)

BEGIN_S: Final = 0.5
"""Before this the link greets and fills its window."""


def line(case: LineCase, end_s: float) -> Figures:
    """Run a link on a line from silence; figures are of the time from `BEGIN_S` to the end."""
    simulation = Simulation()
    ends: tuple[Transport, Transport]
    loads: list[Load]
    if case.can:
        bus = CanBus(simulation, case.bit_rate)
        config = IsoTpConfig(frame_bytes=64 if case.fd else 8)
        ends = (
            CanTransport(
                CanBusEnd(bus),
                0x101,
                0x201,
                config,
                simulation,
                "simulated CAN",
                False,
                case.segment_bytes,
            ),
            CanTransport(
                CanBusEnd(bus),
                0x201,
                0x101,
                config,
                simulation,
                "simulated CAN",
                False,
                case.segment_bytes,
            ),
        )
        loads = [bus.load]
    else:
        pair = serial_pair(simulation, case.bit_rate, case.latency_s)
        ends = pair
        loads = [end.load for end in pair]
    received = [0, 0]
    runners = []
    link_config = LinkConfig(window=case.window)
    for index, role in enumerate((Role.MASTER, Role.SLAVE)):
        link = Link(role, index + 1, link_config, BLOCKS)
        blocks = _blocks(role.value, 64) if case.both or role is Role.SLAVE else []

        def on_event(
            event: Event, index: int = index, link: Link = link, blocks: list[object] = blocks
        ) -> None:
            if isinstance(event, MessageReceived):
                received[index] += 1
            elif isinstance(event, MessageAcknowledged):
                link.send(blocks[event.token % len(blocks)])

        runners.append(LinkRunner(link, ends[index], on_event=on_event, clock=simulation))
        for block in blocks[: link_config.queue_limit]:
            link.send(block)

    def run(until_s: float) -> None:
        until_ns = round(until_s * SECOND_NS)
        while simulation.now_ns < until_ns:
            for runner in runners:
                runner.turn()
            wanted = [runner.next_moment_s() for runner in runners]
            wanted += [end.next_deadline_s() for end in ends]
            # A moment that is past is served in the next turn, a nanosecond later at the earliest.
            moments = [
                max(simulation.now_ns + 1, round(at * SECOND_NS)) for at in wanted if at is not None
            ]
            simulation.step(min([until_ns, *moments]))

    # One way on a serial line is one wire: acknowledgements go on the other.
    wires = loads if case.can or case.both else loads[1:]

    def carried() -> tuple[int, int, int]:
        return (
            sum(load.bits for load in wires),
            sum(load.data_bytes for load in wires),
            MAX_PAYLOAD_BYTES * sum(received),
        )

    run(BEGIN_S)
    before = carried()
    run(end_s)
    bits, data_bytes, payload = (now - then for now, then in zip(carried(), before, strict=True))
    time_s = end_s - BEGIN_S
    capacity = len(wires) * case.bit_rate * time_s
    return {
        "busy": bits / capacity,
        "of_bytes": payload / data_bytes,
        "of_bits": 8 * payload / capacity,
        "kb_s": payload / time_s / 1e3,
        "again": float(sum(runner.link.statistics.retransmissions for runner in runners)),
    }


def lines(effort: Effort) -> Figures:
    """Every line of the table."""
    figures: Figures = {}
    for case in LINES:
        figures |= {
            f"{case.name}: {name}": value for name, value in line(case, effort.line_s).items()
        }
    return figures


def lines_rows(figures: Figures) -> Sequence[Row]:
    """Payload of the bytes carried, of all line bits, and how busy the line is."""
    rows = []
    for case in LINES:
        busy, of_bytes, of_bits, kb_s = (
            figures[f"{case.name}: {name}"] for name in ("busy", "of_bytes", "of_bits", "kb_s")
        )
        rows.append(
            Row(
                case.name,
                f"payload {of_bytes:.1%} of bytes",
                "> 80 %, line busy" if not case.name.startswith(" ") else "",
                f"{busy:.1%} busy, {of_bits:.1%} of line bits, {kb_s:.1f} kB/s",
            )
        )
    return rows
