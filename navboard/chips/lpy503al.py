"""ST LPY503AL: dual-axis analog gyroscope; its yaw axis, with the ×1 and the ×4 output.

    V = 1.23 V + S Ω,   S = 8.3 mV/(°/s) at ×1 (±120 °/s), 33.3 mV/(°/s) at ×4 (±30 °/s)

Both outputs amplify the same rate, so they share bandwidth, bias and noise. The bandwidth is one
pole at 140 Hz (the figure of the sibling LPY403AL). Noise density 0.014 (°/s)/√Hz and the output
swing are those of sibling parts too: unconfirmed for this one.
"""

from __future__ import annotations

import math
import random

from firmware_model.signals import Quantity
from firmware_model.time import FS_PER_S
from navboard.chips.noise import rms_of_density

ZERO_RATE_V = 1.23
SENSITIVITY_X1_V_DPS = 8.3e-3
SENSITIVITY_X4_V_DPS = 33.3e-3
BANDWIDTH_HZ = 140.0
NOISE_DENSITY_DPS = 0.014  # per √Hz
SUPPLY_A = 6.8e-3
DRAWN_BIAS_SIGMA_DPS = 0.5  # assumed: left over after the board's own calibration at the bench
HEADROOM_V = 0.05  # assumed: how near the outputs come to the rails
_EXP_RATE = -2.0 * math.pi * BANDWIDTH_HZ / FS_PER_S


class Lpy503al:
    """The yaw axis; `x1` and `x4` are output voltages.

    Args:
        rate_rad_s: yaw rate, counter-clockwise positive, rad/s.
        rng: the chip's own generator.
        supply_v: supply, which limits the swing.
        bias_rad_s: zero-rate error; drawn where None.
        noise_scale: multiplies the noise.

    """

    __slots__ = ("_filtered", "_gauss", "_high_v", "_noise_dps", "_rate", "_time_fs", "bias_dps")

    def __init__(
        self,
        rate_rad_s: Quantity,
        rng: random.Random,
        supply_v: float = 3.3,
        bias_rad_s: float | None = None,
        noise_scale: float = 1.0,
    ) -> None:
        drawn = rng.gauss(0.0, DRAWN_BIAS_SIGMA_DPS)
        self.bias_dps = drawn if bias_rad_s is None else math.degrees(bias_rad_s)
        self._rate = rate_rad_s
        self._gauss = rng.gauss
        self._noise_dps = noise_scale * rms_of_density(NOISE_DENSITY_DPS, BANDWIDTH_HZ)
        self._high_v = supply_v - HEADROOM_V
        self._time_fs: int | None = None
        self._filtered = 0.0

    def x1(self, time_fs: int) -> float:
        """Output of the sensor, V."""
        volts = ZERO_RATE_V + SENSITIVITY_X1_V_DPS * self._signal_dps(time_fs)
        return min(max(volts, HEADROOM_V), self._high_v)

    def x4(self, time_fs: int) -> float:
        """Output of its amplifier, V."""
        volts = ZERO_RATE_V + SENSITIVITY_X4_V_DPS * self._signal_dps(time_fs)
        return min(max(volts, HEADROOM_V), self._high_v)

    def _signal_dps(self, time_fs: int) -> float:
        """Filter the rate up to now; two looks at one instant see the same."""
        before = self._time_fs
        if time_fs != before:
            rate_dps = self._rate(time_fs) * 57.29577951308232 + self.bias_dps
            rate_dps += self._noise_dps * self._gauss(0.0, 1.0)
            if before is None:
                self._filtered = rate_dps
            else:
                decay = math.exp(_EXP_RATE * (time_fs - before))
                self._filtered = rate_dps + (self._filtered - rate_dps) * decay
            self._time_fs = time_fs
        return self._filtered
