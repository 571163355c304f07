"""Duty cycle: when the radio is on, by the time that all boards share.

All listen in a common window at the beginning of each period and sleep for the rest. A board whose
clock may be off has its ears open from a guard before the window to a guard after it, and sends
within the window by its own clock; so whatever one sends, the others hear, as long as each knows
the time to `ERROR_LIMIT_TICKS`. One that does not (`time_sync.py`) is always on. So that groups
whose windows lie elsewhere find each other, every board listens through one whole period in
`discovery_periods`, not all in the same.

The period divides 2^32 ticks, so that the window does not jump when the shared time wraps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from procboard.errors import ProcConfigError

ERROR_LIMIT_TICKS: Final = 33
"""A clock within this of the root's is good enough [1/32768 s]: 1 ms, nearly twice what was
measured on boards over six hops that lose 30 % (docs/network.md)."""
DRIFT_PPM: Final = 10
"""By how much the drift of a crystal may have changed since the last pair: 0.035 ppm/K² around
25 °C (a watch crystal's data sheet), 15 K away."""
GUARD_TICKS: Final = 2 * ERROR_LIMIT_TICKS
"""Of two boards one may be early and the other late."""
WAKE_TICKS: Final = 82
"""From switching the radio on until it hears [1/32768 s]: 2.5 ms, 1 ms for the oscillator, 0.32 ms
for turnaround and RSSI (CC2420 sections 6.6 and 25), and a flash page that holds the bus."""
EXCHANGE_TICKS: Final = 1_311
"""The longest that a message goes on [1/32768 s]: 40 ms, four attempts with back-offs of 2.2 ms,
frames of 4.3 ms, turnaround and the wait for an acknowledgement of 0.9 ms each, and reading."""


@dataclass(frozen=True, slots=True)
class DutyConfig:
    """Window and period in ticks of 1/32768 s.

    Raises:
        ProcConfigError: a period that does not divide 2^32, a window that does not fit.

    """

    period_ticks: int = 1 << 16
    """2 s."""
    window_ticks: int = 1 << 13
    """0.25 s."""
    discovery_periods: int = 32
    """One whole period in so many: 64 s."""

    def __post_init__(self) -> None:
        if self.period_ticks <= 0 or (1 << 32) % self.period_ticks:
            raise ProcConfigError(f"a period of {self.period_ticks} ticks: a power of two, to 2^32")
        longest = self.period_ticks - 2 * GUARD_TICKS - WAKE_TICKS
        if not EXCHANGE_TICKS < self.window_ticks <= longest:
            raise ProcConfigError(
                f"a window of {self.window_ticks} ticks: above {EXCHANGE_TICKS}, to {longest}"
            )
        if self.discovery_periods < 1 or (1 << 32) // self.period_ticks % self.discovery_periods:
            raise ProcConfigError(f"discovery every {self.discovery_periods} periods: a power of 2")

    @property
    def spread_ticks(self) -> int:
        """First half of the window: when a board begins to send what came up outside it."""
        return (self.window_ticks - EXCHANGE_TICKS) // 2 + 1

    @property
    def share(self) -> float:
        """Share of the time that a synchronised board's radio is on."""
        window = (self.window_ticks + 2 * GUARD_TICKS + WAKE_TICKS) / self.period_ticks
        return window + (1 - window) / self.discovery_periods


@dataclass(frozen=True, slots=True)
class DutyState:
    """What the radio does now, and for how many ticks at least."""

    listening: bool
    """Whether it is on; `WAKE_TICKS` later it hears."""
    sending: bool
    """Whether a message may begin."""
    ticks: int


def error_bound(last_pair_ticks: int, now_ticks: int) -> int:
    """Return how far a synchronised clock may be off: half the limit, and what drift adds."""
    return ERROR_LIMIT_TICKS // 2 + (now_ticks - last_pair_ticks) * DRIFT_PPM // 1_000_000


class Duty:
    """One board's duty cycle: a function of the shared time."""

    def __init__(self, address: int, config: DutyConfig | None = None) -> None:
        self.config = config or DutyConfig()
        self._address = address

    def state(self, global_ticks: int, error_ticks: int | None) -> DutyState:
        """Return what the radio does at a shared time that may be off by `error_ticks`.

        None: the board is not synchronised. It is on, as is one that may be off by too much, and
        has to ask again after a second.
        """
        config = self.config
        if error_ticks is None or error_ticks > ERROR_LIMIT_TICKS:
            return DutyState(True, True, config.period_ticks // 2)
        period, window = config.period_ticks, config.window_ticks
        phase = global_ticks % period
        number = global_ticks // period
        discovers = (number - self._address) % config.discovery_periods == 0
        edges = (
            window - EXCHANGE_TICKS,
            window,
            window + GUARD_TICKS,
            period - GUARD_TICKS - WAKE_TICKS,
            period,
        )
        ticks = next(edge for edge in edges if edge > phase) - phase
        near = phase < window + GUARD_TICKS or phase >= period - GUARD_TICKS - WAKE_TICKS
        return DutyState(near or discovers, phase < window - EXCHANGE_TICKS, ticks)

    def next_window(self, global_ticks: int) -> int:
        """Return ticks until messages may go; 0 where they may now."""
        phase = global_ticks % self.config.period_ticks
        if phase < self.config.window_ticks - EXCHANGE_TICKS:
            return 0
        return self.config.period_ticks - phase
