"""Seeds of chips, and white noise within a bandwidth."""

from __future__ import annotations

import math
import random


def chip_random(seed: int, board: str, chip: str) -> random.Random:
    """Return the generator of one chip: the same for the same seed and names everywhere."""
    return random.Random(f"{seed}/{board}/{chip}")


def rms_of_density(density: float, bandwidth_hz: float) -> float:
    """Return the RMS of white noise of a density (per √Hz) behind one pole at `bandwidth_hz`.

    One pole passes the noise of an ideal filter of π/2 times its corner frequency.
    """
    return density * math.sqrt(bandwidth_hz * math.pi / 2.0)
