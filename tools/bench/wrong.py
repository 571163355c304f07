"""What is wrong with instruments, clock and link: `[effects]` that are no physics of the robot.

Each is laid around the true quantity that a chip or the camera looks at, so that drivers, noise and
quantisation are as always. A neutral effect leaves the quantity itself in place.
"""

from __future__ import annotations

import math
import random
from typing import TYPE_CHECKING, Any

import msgspec

from firmware_model.time import FS_PER_S, from_seconds
from plant.elementary import sincos

if TYPE_CHECKING:
    from collections.abc import Callable

    from firmware_model.signals import Quantity
    from plant.underwater import UnderwaterVehicle
    from tools.configuration import Scenario

Pose = tuple[float, float, float]


def _of(config: Scenario, name: str) -> dict[str, float]:
    effects: Any = config.effects
    values: dict[str, float] = msgspec.structs.asdict(getattr(effects, name))
    return values


def gyro(config: Scenario, rate_rad_s: Quantity) -> Quantity:
    """Return the rate that the gyro feels."""
    bias, scale = _of(config, "gyro_bias")["b_rad_s"], _of(config, "gyro_scale")["k"]
    if bias == 0.0 and scale == 0.0:
        return rate_rad_s
    return lambda time_fs: (1.0 + scale) * rate_rad_s(time_fs) + bias


def compass(config: Scenario, heading_rad: Quantity) -> Quantity:
    """Return the heading that the compass feels."""
    offset = _of(config, "compass_offset")["delta_rad"]
    hard, soft = _of(config, "compass_hard_iron"), _of(config, "compass_soft_iron")
    if offset == 0.0 and hard["a"] == 0.0 and soft["a"] == 0.0:
        return heading_rad

    def felt(time_fs: int) -> float:
        psi = heading_rad(time_fs)
        return (
            psi
            + offset
            + hard["a"] * sincos(psi - hard["phi_rad"])[0]
            + soft["a"] * sincos(2.0 * psi - soft["phi_rad"])[0]
        )

    return felt


def clock_rate(config: Scenario) -> float:
    """Return seconds of the recorder per true second."""
    return 1.0 + _of(config, "clock_drift")["k"]


def arrives(config: Scenario, name: str = "") -> Callable[[], bool]:
    """Return what says of each change of the tail beat whether it arrives.

    `name`: of one of several robots, each of which has chances of its own.

    An ideal tail misses changes that its board has made; the board's records hold them. A real
    servo does what its board tells it, and its board records that: there the base station's
    commands are lost on the air, and no record of the robot knows of them.
    """
    share = _of(config, "dropped_commands")["p"]
    if share == 0.0:
        return lambda: True
    draw = random.Random(f"{config.scenario.seed}/{prefix(name)}dropped").random
    return lambda: draw() >= share


def prefix(name: str) -> str:
    """Return what the trace channels and random numbers of one of several robots begin with."""
    return f"{name}." if name else ""


class Lens:
    """What the camera makes of true poses: another frame, late, and stalled at times."""

    def __init__(self, config: Scenario, name: str = "") -> None:
        self._scale = 1.0 + _of(config, "camera_scale")["k"]
        self._turn = _of(config, "camera_rotation")["delta_rad"]
        self._sine, self._cosine = sincos(self._turn)
        self.delay_fs = from_seconds(_of(config, "camera_delay")["delay_s"])
        """By how much a frame shows what was before its exposure."""
        self._hold_s = _of(config, "stale_samples")["hold_s"]
        self._draw = random.Random(f"{config.scenario.seed}/{prefix(name)}stale").random
        self._until_fs = -1
        self._plain = self._scale == 1.0 and self._turn == 0.0

    def look(self, vehicle: UnderwaterVehicle, time_fs: int) -> Pose:
        """Return the pose that is seen at a time, in the camera's frame."""
        x, y = vehicle.position(time_fs)
        heading = vehicle.heading(time_fs)
        if self._plain:
            return x, y, heading
        return (
            self._scale * (self._cosine * x - self._sine * y),
            self._scale * (self._sine * x + self._cosine * y),
            heading + self._turn,
        )

    def stalls(self, time_fs: int) -> bool:
        """Whether the frame of a time shows the one before; else decide until when it will stay."""
        if self._hold_s == 0.0:
            return False
        if time_fs <= self._until_fs:
            return True
        self._until_fs = time_fs + math.floor(self._draw() * self._hold_s * FS_PER_S)
        return False
