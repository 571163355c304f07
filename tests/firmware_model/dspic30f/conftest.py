"""A dsPIC30F6014A that runs whatever firmware a test gives it."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from firmware_model.dspic30f.mcu import DsPic30F6014A, DspicConfig
from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler


class Rig:
    """A scheduler, a 3.3 V rail and one MCU; `run` advances to a time in seconds."""

    def __init__(
        self,
        firmware: Callable[[DsPic30F6014A], None],
        config: DspicConfig | None = None,
        volts: float = 3.3,
    ) -> None:
        self.scheduler = Scheduler()
        self.rail = Rail(self.scheduler, "3V3", volts)
        self.mcu = DsPic30F6014A("nav", self.scheduler, self.rail, firmware, config)

    def run(self, seconds: float) -> None:
        self.scheduler.run(round(seconds * 10**15))


@pytest.fixture
def rig() -> Callable[..., Rig]:
    return Rig
