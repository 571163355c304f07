"""The overhead camera: pose from two LEDs at 30 frames/s, late and with noise (source, 5.7.3).

Frame n is exposed at n/30 s, rounded down to a femtosecond from integers, so frames never drift.
Each LED's centroid has Gaussian noise and is found in steps of a fraction of a pixel. Position is
the mid-point, heading the direction from the rear LED to the front one; so heading noise follows
from centroid noise and baseline (√2 σ / baseline). The step also keeps a last-bit difference of the
generator's normal deviates between machines out of the record.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from plant.checks import check_number
from plant.elementary import atan2, sincos
from plant.errors import InvalidParameterError

_FS_PER_S = 10**15
_DRAWN = 64  # frames whose noise is drawn at a time


@dataclass(frozen=True, slots=True)
class CameraParameters:
    """What the camera is. All but the frame rate is assumed: the source gives none of it."""

    frames_per_s: int = 30
    led_noise_m: float = 0.001  # standard deviation per axis of one centroid
    led_baseline_m: float = 0.10  # rear to front LED
    step_m: float = 1e-4  # of a centroid: 1/50 of a 5 mm pixel
    latency_s: float = 0.050  # from exposure to a computed pose

    def __post_init__(self) -> None:
        """Refuse rates that are no whole number, and negative noise or latency."""
        rate = self.frames_per_s
        if isinstance(rate, bool) or not isinstance(rate, int) or not 1 <= rate <= 10_000:
            raise InvalidParameterError(
                "camera.frames_per_s", f"must be a whole number from 1 to 10000, got {rate!r}"
            )
        check_number("camera.led_noise_m", self.led_noise_m, least=0.0)
        check_number("camera.led_baseline_m", self.led_baseline_m, above=0.0)
        check_number("camera.step_m", self.step_m, above=0.0)
        check_number("camera.latency_s", self.latency_s, least=0.0)


class CameraFrame(NamedTuple):
    """One pose: exposed at ``exposure_fs``, known at ``available_fs``; heading in [−π, π]."""

    number: int
    exposure_fs: int
    available_fs: int
    x_m: float
    y_m: float
    heading_rad: float


class Camera:
    """Measures the pose that it is given. ``generator`` is seeded by the caller."""

    __slots__ = (
        "_deviates",
        "_generator",
        "_half_m",
        "_latency_fs",
        "_noise_m",
        "_step_m",
        "parameters",
    )

    def __init__(
        self, generator: np.random.Generator, parameters: CameraParameters | None = None
    ) -> None:
        self.parameters = parameters or CameraParameters()
        self._generator = generator
        self._deviates: list[list[float]] = []
        self._latency_fs = round(self.parameters.latency_s * _FS_PER_S)
        self._half_m = 0.5 * self.parameters.led_baseline_m
        self._noise_m = self.parameters.led_noise_m
        self._step_m = self.parameters.step_m

    def exposure_fs(self, index: int) -> int:
        """Time of frame ``index``; frame 0 is exposed at 0."""
        return index * _FS_PER_S // self.parameters.frames_per_s

    def next_index(self, t_fs: int) -> int:
        """First frame exposed at or after a time."""
        index = max(0, t_fs * self.parameters.frames_per_s // _FS_PER_S)
        while self.exposure_fs(index) < t_fs:
            index += 1
        return index

    def capture(self, index: int, x_m: float, y_m: float, heading_rad: float) -> CameraFrame:
        """Measure the true pose at the exposure of frame ``index`` (four draws a frame)."""
        sine, cosine = sincos(heading_rad)
        along_x, along_y = self._half_m * cosine, self._half_m * sine
        if not self._deviates:  # drawn in advance: a call for each frame costs more than the frame
            self._deviates = self._generator.standard_normal((_DRAWN, 4)).tolist()[::-1]
        noise = self._deviates.pop()
        # Each centroid, true position and noise, in whole steps.
        sigma, step, floor = self._noise_m, self._step_m, math.floor
        front_x = floor((x_m + along_x + sigma * noise[0]) / step + 0.5) * step
        front_y = floor((y_m + along_y + sigma * noise[1]) / step + 0.5) * step
        rear_x = floor((x_m - along_x + sigma * noise[2]) / step + 0.5) * step
        rear_y = floor((y_m - along_y + sigma * noise[3]) / step + 0.5) * step
        exposure = self.exposure_fs(index)
        return CameraFrame(
            index,
            exposure,
            exposure + self._latency_fs,
            0.5 * (front_x + rear_x),
            0.5 * (front_y + rear_y),
            atan2(front_y - rear_y, front_x - rear_x),
        )
