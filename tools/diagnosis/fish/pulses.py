"""What a servo makes of the commands that a board recorded: pulses, in frames, with a dead band.

A board writes an angle down when it computes it. The servo knows it when the pulse that says it has
ended: the pulse begins with the next frame, and the longer it lasts the more it says. The timer
counts whole ticks, and the servo's electronics ignore what differs by less than their dead band
from the pulse they follow. Without this the tail would be 3 ms early, and what it does where it
turns round another thing: small, but ten thousand samples of a gyro see it.

The stamps are the board's clock's, and an emulated servo acts at the next step of its plant. The
numbers are those of the bundled boards and of the HS-5646WP (`navboard.drivers.servo`,
`navboard.chips.hs5646wp`). Another board's frame may begin at another time: the tolerance of the
command's time (3 ms) covers that.
"""

from __future__ import annotations

import numpy as np

from navboard.chips.hs5646wp import Hs5646wpSpecs
from navboard.drivers.servo import FRAME_S, MIDDLE_S, SECONDS_PER_RAD
from tools.diagnosis.model import FloatArray

TO_FRAME_S = 0.877e-3
"""From the board's stamp of a command to the beginning of its pulse: the control tick leads the
servo's frame by 1 ms (`navboard.firmware.LEAD_S`), and the stamp comes 0.123 ms after the tick, a
little later when the tick was busy."""
BUSY_S = 0.5e-3
"""Stamps that are no later than this against frames of 20 ms are of a control tick in step."""
TICK_S = 8.0 / 14.7456e6
"""Of the pulse's timer: the board's instruction clock over 8."""
MIDDLE_RAD = (round(MIDDLE_S / TICK_S) * TICK_S - MIDDLE_S) / SECONDS_PER_RAD
"""What a whole number of ticks makes of the middle: 0.2 mrad."""


def followed(
    time_s: FloatArray,
    angle_rad: FloatArray,
    step_s: float,
    drift_ppm: float = 0.0,
    specs: Hs5646wpSpecs | None = None,
    *,
    at_rest: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """Return when a servo took new targets, and which, from recorded commands (n,).

    An emulated servo takes them at the next step of its plant, ``step_s``. ``drift_ppm``: of the
    board's clock, in whose time the answer is, as its samples are. Before the first command a
    servo ``at_rest`` stands at zero, where the record begins later than time zero.
    """
    specs = specs or Hs5646wpSpecs()
    ticks = np.floor(angle_rad * (SECONDS_PER_RAD / TICK_S))
    least = specs.dead_band_s / TICK_S
    taken: list[int] = []
    there = np.inf
    for i, width in enumerate(ticks.tolist()):
        if not abs(width - there) < least:
            taken.append(i)
            there = width
    angle = ticks[taken] * (TICK_S / SECONDS_PER_RAD) + MIDDLE_RAD
    fast = 1.0 + 1e-6 * drift_ppm
    begins_s = (_ticks(time_s)[taken] + TO_FRAME_S) / fast
    ends_s = (
        np.ceil((begins_s + MIDDLE_S + angle * SECONDS_PER_RAD) / step_s - 1e-6) * step_s * fast
    )
    if at_rest and time_s.size and time_s[0] > 0.0:
        return np.concatenate(([0.0], ends_s)), np.concatenate(([0.0], angle))
    return ends_s, angle


def _ticks(time_s: FloatArray) -> FloatArray:
    """Return the stamps as they are when no tick is busy, where they are in step with frames."""
    if time_s.size == 0:
        return time_s
    whole = time_s[0] + FRAME_S * np.round((time_s - time_s[0]) / FRAME_S)
    late_s = time_s - whole
    if float(np.ptp(late_s)) > BUSY_S:
        return time_s
    found: FloatArray = whole + late_s.min()
    return found
