"""A cable between two transports that can be pulled and can damage what it carries.

For tests and soaks: two programs each open one end (two ptys, as a rule), the cable carries bytes
between them, honours both lines' back-pressure, and closes both ends when it is pulled, so that
either program sees its device vanish.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress

from spi_bus.errors import TransportLost
from spi_bus.transports.base import Clock, Transport, wait_any

__all__ = ["Cable"]

_CHUNK = 4096


class Cable:
    """Carries bytes between two ends.

    Args:
        open_one, open_other: open the ends, now and whenever the cable is plugged in again.
        damage: what becomes of a chunk on its way; by default nothing.
        clock: monotonic, in seconds.

    """

    def __init__(
        self,
        open_one: Callable[[], Transport],
        open_other: Callable[[], Transport],
        damage: Callable[[bytes], bytes] = lambda chunk: chunk,
        clock: Clock = time.monotonic,
    ) -> None:
        self._openers = (open_one, open_other)
        self._ends: tuple[Transport, Transport] | None = None
        self._clock = clock
        self.damage = damage
        self.carried = 0
        """Bytes taken in at either end."""
        self.plug()

    @property
    def plugged(self) -> bool:
        """Whether the ends are open."""
        return self._ends is not None

    def plug(self) -> None:
        """Open both ends; nothing where they are open."""
        if self._ends is None:
            one = self._openers[0]()
            try:
                self._ends = (one, self._openers[1]())
            except BaseException:
                one.close()
                raise

    def pull(self) -> None:
        """Close both ends: bytes on their way are gone."""
        if self._ends is not None:
            for end in self._ends:
                end.close()
            self._ends = None

    close = pull

    def carry(self) -> bool:
        """Carry what there is, both ways, without waiting; return whether there was anything."""
        if self._ends is None:
            return False
        moved = False
        one, other = self._ends
        for source, sink in ((one, other), (other, one)):
            with suppress(TransportLost):  # an end that nobody holds open: silence
                while chunk := source.read(min(_CHUNK, sink.room)):
                    moved = True
                    self.carried += len(chunk)
                    sink.write(self.damage(chunk))
                sink.flush()
        return moved

    def run(self, duration_s: float) -> None:
        """Carry for a time."""
        end_s = self._clock() + duration_s
        while (left_s := end_s - self._clock()) > 0:
            self.carry()
            if self._ends is None:
                time.sleep(left_s)
            else:
                wait_any(self._ends, min(left_s, 0.1), self._clock)
