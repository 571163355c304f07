"""What the state machines of this package have in common: what they send, and their chance.

Every machine offers `start(now_ms)`, `receive(…, now_ms)` and `handle_timer(now_ms)`, which give
events where there are any, `next_deadline()`, and `take(now_ms)`: the next message to send or None.
Messages are pulled, so that a radio that is busy or off holds them back and what goes is up to
date. Times are integer milliseconds of the board's crystal since its boot; only differences matter.
Early or late calls of `handle_timer` do no harm.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Protocol

from radio_802154.tinyos import AM_BROADCAST

BROADCAST: Final = AM_BROADCAST
"""Destination of a message for whoever hears it."""
NOBODY: Final = AM_BROADCAST
"""No board: as the TinyOS tree has it, an address that no board may have."""


@dataclass(frozen=True, slots=True)
class Outgoing:
    """An active message to send; a unicast's outcome is to be reported."""

    destination: int
    am_type: int
    payload: bytes


class Chance(Protocol):
    """A source of random numbers: `procboard.network.RandomMlcg`."""

    def below(self, limit: int) -> int:
        """Return a number from 0 to limit − 1."""


def earliest(deadlines: Iterable[int | None]) -> int | None:
    """Return the first of some deadlines; None where there is none."""
    return min((deadline for deadline in deadlines if deadline is not None), default=None)
