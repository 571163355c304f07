"""What the host's end of a plant in the loop measures: punctuality, round trips, what was missed.

Numbers and time stamps in the messages are all that is needed. A pulse says which sample was the
newest at the board and for how long it had been there, so the time on the line, both ways, is what
is left of the time between sending that sample and hearing of the pulse.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final

from firmware_model.histogram import DurationHistogram
from spi_bus.plant_messages import BoardStatus, ServoPulse
from tools.bench.board_clock import BoardClock
from tools.bench.lateness import above
from tools.words import ms, pace

REMEMBERED: Final = 4096
"""Samples whose sending is remembered: 4 s at 1 kHz. An answer to an older one is not timed."""


class PlantFigures:
    """Counts and times of one run."""

    def __init__(self) -> None:
        self.sent = 0
        self.skipped = 0
        """Samples that were a whole period late and so were not taken."""
        self.pulses = 0
        self.pulses_missing = 0
        self.pulses_repeated = 0
        self.registers_written = 0
        self.characters = 0
        self.board_resets = 0
        self.round_trip = DurationHistogram()
        self.sample_age = DurationHistogram()
        """Of the newest sample at the board, when it made a pulse."""
        self.board_clock = BoardClock()
        self.status: BoardStatus | None = None
        self._sent_s: deque[tuple[int, float]] = deque(maxlen=REMEMBERED)
        self._pulse = 0

    def streamed(self, number: int, clock_s: float) -> None:
        """Note that the transport has taken a sample."""
        self.sent += 1
        self._sent_s.append((number, clock_s))

    def restarted(self) -> None:
        """Note that the board begins anew: its counts do, too."""
        self._pulse = 0
        self._sent_s.clear()

    def pulse(self, pulse: ServoPulse, clock_s: float, run_s: float) -> bool:
        """Take a pulse with the clock's and the run's time; return whether it is a new one."""
        ahead = (pulse.number - self._pulse) & 0xFFFFFFFF
        if self._pulse and not 0 < ahead < 0x80000000:
            self.pulses_repeated += 1
            return False
        if self._pulse:
            self.pulses_missing += ahead - 1
        self._pulse = pulse.number
        self.pulses += 1
        self.board_clock.note(pulse.board_time_us / 1e6, run_s)
        age_s = pulse.sample_age_us / 1e6
        sent = self._sent_s
        while sent and _before(sent[0][0], pulse.sample):
            sent.popleft()
        if sent and sent[0][0] == pulse.sample:
            self.sample_age.record(age_s)
            self.round_trip.record(clock_s - sent[0][1] - age_s)
        return True

    def summary(self, replaced: int, ignored: int) -> dict[str, Any]:
        """Return all for a `summary.json`.

        `replaced` samples waited until newer ones came, `ignored` pulses were none of a servo's.
        """
        fit = self.board_clock.fit()
        return {
            "samples": {"sent": self.sent, "skipped": self.skipped, "replaced": replaced},
            "pulses": {
                "received": self.pulses,
                "missing": self.pulses_missing,
                "repeated": self.pulses_repeated,
                "ignored": ignored,
            },
            "board": asdict(self.status) if self.status is not None else None,
            "board_resets": self.board_resets,
            "registers_written": self.registers_written,
            "nmea_characters": self.characters,
            "round_trip": {**self.round_trip.summary(), "above": above(self.round_trip)},
            "sample_age": {**self.sample_age.summary(), "above": above(self.sample_age)},
            "clock": None if fit is None else {**asdict(fit), "resets": self.board_clock.resets},
        }


def words(hil: Mapping[str, Any]) -> list[str]:
    """Lines on the board's side of a run, for the terminal."""
    samples, pulses, board = hil["samples"], hil["pulses"], hil["board"]
    lines = [
        (
            f"  {'samples':<14}{samples['sent']} sent at {hil['rate_hz']:g} Hz, "
            f"{samples['skipped']} skipped as late, {samples['replaced']} never taken by the line"
        )
    ]
    if board:
        lines.append(
            f"  {'':<14}the board took {board['samples']}, missed {board['missing']}, "
            f"{board['repeated']} repeated, {board['stalls']} stalls"
        )
    lines.append(
        f"  {'servo pulses':<14}{pulses['received']} received, {pulses['missing']} missing, "
        f"{pulses['repeated']} repeated"
    )
    trip, age = hil["round_trip"], hil["sample_age"]
    if trip["count"]:
        lines.append(
            f"  {'round trip':<14}median {ms(trip['median_s'])}, p99 {ms(trip['p99_s'])}, "
            f"max {ms(trip['maximum_s'])}; samples at the board "
            f"{ms(age['median_s'])} old, p99 {ms(age['p99_s'])}"
        )
    clock = hil["clock"]
    if clock:
        lines.append(f"  {'its clock':<14}{pace(clock)}, began at {clock['offset_s']:.4f} s")
    return lines


def port_words(plant: Mapping[str, Any]) -> list[str]:
    """Lines on the board's end of a plant's line, for the terminal."""
    samples, pulses, out = plant["samples"], plant["pulses"], plant["outages"]
    lines = [
        f"  {'plant':<14}at {plant['line']}",
        (
            f"  {'samples':<14}{samples['received']} received, {samples['missing']} missing, "
            f"{samples['repeated']} repeated, {samples['stalls']} stalls"
        ),
        f"  {'servo pulses':<14}{pulses['sent']} sent, {out['outages']} outages of that line",
    ]
    if plant["diagnosis"]:
        lines.append(f"  {plant['diagnosis']}")
    return lines


def _before(number: int, other: int) -> bool:
    """Whether a sample's number comes before another, around the end of the 32 bits."""
    return 0 < (other - number) & 0xFFFFFFFF < 0x80000000
