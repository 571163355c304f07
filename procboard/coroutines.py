"""Small tools for cooperative firmware: the type of a sub-routine, and a lock.

A sub-routine is a generator that a task runs with `yield from`: it yields the cycles that its code
cost, or a flag to wait for, and returns a result.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeAlias, TypeVar

from firmware_model.cpu import Flag

T = TypeVar("T")

Firmware: TypeAlias = Generator[int | Flag, None, T]
"""A sub-routine of firmware that returns a T."""


class Lock:
    """Mutual exclusion between tasks: taken for as long as an operation lasts over its waits."""

    __slots__ = ("_free", "held")

    def __init__(self, name: str) -> None:
        self.held = False
        self._free = Flag(name)

    def acquire(self) -> Firmware[None]:
        """Wait until nobody holds the lock, then hold it."""
        while self.held:
            yield self._free
        self.held = True

    def release(self) -> None:
        """Let the next task have it."""
        self.held = False
        self._free.set()
