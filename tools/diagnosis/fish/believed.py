"""What the believed scenario says to be wrong already: the neutral point of a diagnosis.

Effects of the robot in its water are in its parameters when the scenario has been read; those of
instruments, clock and link are brought here, by the very rows that a diagnosis looks for. So a
cause is always a change beyond what is believed, and whoever believes what was found predicts what
was found.
"""

from __future__ import annotations

from collections.abc import Mapping

from tools.diagnosis.causes import CAUSES
from tools.diagnosis.fish.setup import Setup
from tools.effects import INSTRUMENTS

Wrong = Mapping[str, Mapping[str, float]]
"""Effects by name, each with its numbers as `[effects]` has them."""


def believing(setup: Setup, wrong: Wrong) -> Setup:
    """Return a setup with effects of instruments, clock and link."""
    for name in INSTRUMENTS:
        told = wrong.get(name, {})
        row = CAUSES[name]
        cause = row.cause
        numbers = [told.get(p.name.partition(".")[2], 0.0) for p in cause.reported]
        setup = row.apply(setup, cause.reads(numbers))
    return setup
