"""What a transport is: bytes in, bytes out, never blocking, and one place to wait.

A link wants little of a line: what has arrived, how much may be sent, and a moment to wait for
either. So nothing here blocks except `wait`. What the system does not take at once is kept in a
small buffer, and `room` says how much of that is left: whoever writes asks first, which carries the
line's back-pressure up to the link, whose queue carries it to the application.

A transport that needs a clock (CAN's segmentation has time-outs) is given one when it is opened.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Protocol

from spi_bus.errors import TransportFull

if TYPE_CHECKING:
    from spi_bus.transports.outage import BackOff, OutageEvent
    from spi_bus.transports.pair import PairEnd

__all__ = [
    "BUFFER_BYTES",
    "READ_BYTES",
    "Clock",
    "OpenContext",
    "Outbox",
    "Transport",
    "Waitable",
    "wait_any",
]

BUFFER_BYTES: Final = 4096
"""What a transport keeps of written bytes that the system did not take: sixteen largest frames."""
READ_BYTES: Final = 65_536
"""Most bytes of one `read` unless told otherwise."""
_SLICE_S: Final = 0.001
"""How often transports without a descriptor are looked at while several are waited for."""

Clock = Callable[[], float]


class Waitable(Protocol):
    """What `wait_any` needs to know."""

    @property
    def wants_writable(self) -> bool:
        """Whether the descriptor's becoming writable would help."""

    def fileno(self) -> int:
        """Return a descriptor that is readable when bytes may have arrived, or -1."""

    def next_deadline_s(self) -> float | None:
        """Return when `read` or `flush` has something to do by the clock, or None."""

    def wait(self, timeout_s: float) -> None:
        """Block until bytes may have arrived or pending ones may go, at most this long."""


class Transport(Waitable, Protocol):
    """One end of a byte stream.

    Bytes arrive whole and in order, cut anywhere, or (radio, CAN, damage) not at all: the link
    above makes up for that. Only `wait` blocks.
    """

    @property
    def description(self) -> str:
        """What this is, for a person: the kind, and the path or address in use."""

    @property
    def openings(self) -> int:
        """How often the line below was opened: when it grows, bytes on their way are gone."""

    @property
    def room(self) -> int:
        """How many bytes `write` takes now."""

    @property
    def pending(self) -> int:
        """Bytes taken by `write` that the system has not taken yet; `flush` tries again."""

    def read(self, limit: int = READ_BYTES) -> bytes:
        """Return what has arrived, at most `limit` bytes; b"" when there is nothing.

        Raises:
            TransportLost: the line is gone, and all that came before has been read.
            TransportClosedError: after our own `close`.

        """

    def write(self, data: bytes) -> None:
        """Take bytes to send; all of them or, with an error, none.

        Raises:
            TransportFull: more than `room`.
            TransportLost: the line is known to be gone.
            TransportClosedError: after our own `close`.

        """

    def flush(self) -> None:
        """Hand on what is pending as far as that goes without waiting."""

    def close(self) -> None:
        """Give the line back; once more does no harm. What is pending is dropped."""


@dataclass(frozen=True, slots=True)
class OpenContext:
    """What transports that are opened together share.

    `clock` is monotonic, in seconds. `pairs` holds the ends of `pair:` that wait for their other
    one: both have to be opened with the same context. With `reconnect` a line that is lost is
    opened again, and `notify` hears of it.
    """

    clock: Clock = time.monotonic
    pairs: dict[str, PairEnd] = field(default_factory=dict)
    reconnect: BackOff | None = None
    notify: Callable[[OutageEvent], None] = lambda event: None


class Outbox:
    """Written bytes that wait for the system, at most `limit`."""

    __slots__ = ("_data", "limit")

    def __init__(self, limit: int = BUFFER_BYTES) -> None:
        self._data = bytearray()
        self.limit = limit

    def __len__(self) -> int:
        return len(self._data)

    @property
    def room(self) -> int:
        """Bytes that `add` takes."""
        return self.limit - len(self._data)

    def add(self, data: bytes) -> None:
        """Keep bytes; all or, with `TransportFull`, none."""
        if len(data) > self.room:
            raise TransportFull(f"{len(data)} bytes, and room for {self.room}: ask `room` first")
        self._data += data

    def first(self, count: int) -> bytes:
        """Return the first bytes, at most `count`, and keep them."""
        return bytes(self._data[:count])

    def drop(self, count: int) -> None:
        """Forget the first bytes: they went."""
        del self._data[:count]

    def clear(self) -> None:
        """Forget all."""
        self._data.clear()


def wait_any(transports: Iterable[Waitable], timeout_s: float, clock: Clock) -> None:
    """Block until one of several transports may have something to do, at most this long.

    `select` and not `poll`, because it waits to the microsecond and `poll` to the millisecond,
    which is a tenth of a period at 100 Hz.
    """
    several = list(transports)
    deadlines = [at for each in several if (at := each.next_deadline_s()) is not None]
    if deadlines:
        timeout_s = min(timeout_s, min(deadlines) - clock())
    reading = [descriptor for each in several if (descriptor := each.fileno()) >= 0]
    writing = [each.fileno() for each in several if each.wants_writable and each.fileno() >= 0]
    blind = [each for each in several if each.fileno() < 0]
    if not blind:
        select.select(reading, writing, [], max(0.0, timeout_s))
        return
    if len(several) > 1:
        # One without a descriptor says only by `read` whether it has something: its owner looks.
        timeout_s = min(timeout_s, _SLICE_S)
        if any(select.select(reading, writing, [], 0)[:2]):
            return
    blind[0].wait(max(0.0, timeout_s))
