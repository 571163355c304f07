"""Time is one integer count of femtoseconds; clocks compute edges from their origin.

A femtosecond is fine enough that a 32 768 Hz period is exact (30 517 578 125 fs), and Python's
integers never overflow. A `Clock` never adds rounded periods: its n-th edge is one division from
its origin, so an hour of ticks is as exact as the first. Crystal error is a drift in parts per
million, kept as an integer ratio so that the same drift gives the same femtosecond everywhere.
"""

from __future__ import annotations

from fractions import Fraction

FS_PER_NS = 10**6
FS_PER_US = 10**9
FS_PER_MS = 10**12
FS_PER_S = 10**15

_DRIFT_RESOLUTION = 10**6  # drift is kept to 1e-6 ppm


def to_seconds(time_fs: int) -> float:
    """Return a time in femtoseconds as seconds."""
    return time_fs / FS_PER_S


def from_seconds(seconds: float) -> int:
    """Return seconds as femtoseconds: of the decimal that the float is written as, rounded.

    So 0.1 is 10¹⁴ fs, and whole microseconds come back from `to_seconds` as they were.
    """
    return round(Fraction(repr(float(seconds))) * FS_PER_S)


class Clock:
    """An oscillator: a frequency in hertz, a drift in ppm, and edges counted from an origin.

    Edge 0 stands at the origin. `retune` keeps count and phase: the part of a period that has
    passed stays passed, so a change of frequency never makes an edge in the past.
    """

    __slots__ = (
        "_base",
        "_den",
        "_drift_ppm",
        "_edge_offset",
        "_frequency_hz",
        "_num",
        "_origin_fs",
        "_tick_offset",
    )

    def __init__(
        self, frequency_hz: int | Fraction, drift_ppm: float = 0.0, origin_fs: int = 0
    ) -> None:
        if frequency_hz <= 0:
            raise ValueError(f"a clock needs a positive frequency, not {frequency_hz} Hz")
        self._origin_fs = origin_fs
        self._base = 0
        self._frequency_hz = Fraction(frequency_hz)
        self._drift_ppm = drift_ppm
        self._set_ratio()
        self._set_offsets()

    def _set_ratio(self) -> None:
        drift = Fraction(round(self._drift_ppm * _DRIFT_RESOLUTION), 10**6 * _DRIFT_RESOLUTION)
        period = Fraction(FS_PER_S) / (self._frequency_hz * (1 + drift))
        self._num, self._den = period.numerator, period.denominator

    def _set_offsets(self) -> None:
        """Bring origin and base under the fraction, so that edges and ticks take one division."""
        offset = self._origin_fs * self._den - self._base * self._num
        self._edge_offset = offset
        # The largest n with floor((n num + offset) / den) <= t: n num < (t + 1) den - offset.
        self._tick_offset = self._den - 1 - offset

    @property
    def frequency_hz(self) -> Fraction:
        """Nominal frequency: what the firmware believes."""
        return self._frequency_hz

    @property
    def drift_ppm(self) -> float:
        """Deviation of the true frequency from the nominal one, parts per million."""
        return self._drift_ppm

    def edge(self, n: int) -> int:
        """Return the time of the n-th edge in femtoseconds."""
        return (n * self._num + self._edge_offset) // self._den

    def ticks(self, time_fs: int) -> int:
        """Return how many edges after edge 0 have happened at or before `time_fs`."""
        return (time_fs * self._den + self._tick_offset) // self._num

    def next_edge(self, time_fs: int) -> int:
        """Return the time of the first edge strictly after `time_fs`."""
        return self.edge(self.ticks(time_fs) + 1)

    def span(self, cycles: int) -> int:
        """Return the length of `cycles` periods, rounded down to a femtosecond."""
        return cycles * self._num // self._den

    def retune(
        self, now_fs: int, frequency_hz: int | Fraction, drift_ppm: float | None = None
    ) -> None:
        """Change frequency (and drift) from `now_fs` on, in the middle of a period if need be."""
        if frequency_hz <= 0:
            raise ValueError(f"a clock needs a positive frequency, not {frequency_hz} Hz")
        count = self.ticks(now_fs)
        passed, old_num, old_den = now_fs - self.edge(count), self._num, self._den
        self._frequency_hz = Fraction(frequency_hz)
        if drift_ppm is not None:
            self._drift_ppm = drift_ppm
        self._set_ratio()
        passed = passed * self._num * old_den // (self._den * old_num)
        self._origin_fs = now_fs - min(passed, self._num // self._den - 1)
        self._base = count
        self._set_offsets()
