"""Signals: levels that change, and quantities that are looked at.

A `Signal` is pushed: whoever drives it calls `set`, listeners hear of changes only. Pins, chip
selects, data-ready lines and supply rails are signals. A `Quantity` is pulled: a function of time
that an instrument evaluates when it looks, so that nothing is computed which nobody sees. Analog
voltages and the plant's physical quantities are quantities.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeAlias, TypeVar

T = TypeVar("T")

Quantity: TypeAlias = Callable[[int], float]
"""A physical quantity as a function of time in femtoseconds (SI unit named by its user)."""


class Signal(Generic[T]):
    """A named level. Listeners are called in the order of `watch`, with the new value."""

    __slots__ = ("_listeners", "name", "value")

    def __init__(self, name: str, value: T) -> None:
        self.name = name
        self.value = value
        self._listeners: tuple[Callable[[T], None], ...] = ()

    def set(self, value: T) -> None:
        """Drive the signal; listeners hear of it only if the level changes."""
        if value != self.value:
            self.value = value
            for listener in self._listeners:
                listener(value)

    def watch(self, listener: Callable[[T], None]) -> None:
        """Call `listener` with the new value at every change from now on."""
        self._listeners = (*self._listeners, listener)

    def __repr__(self) -> str:
        return f"Signal({self.name!r}, {self.value!r})"


def constant(value: float) -> Quantity:
    """Return a quantity that never changes."""
    return lambda _time_fs: value
