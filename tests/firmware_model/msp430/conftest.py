"""A bench with one MSP430F1611 whose firmware is the test."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from firmware_model.cpu import Coroutine
from firmware_model.msp430.mcu import Msp430F1611
from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_US


class McuBench:
    """An MCU that has booted, with its watchdog held, and a task that sleeps for ever."""

    def __init__(
        self,
        dco_factor: float = 1.0,
        lfxt1_drift_ppm: float = 0.0,
        scheduler: Scheduler | None = None,
    ) -> None:
        self.scheduler = scheduler or Scheduler()
        self.rail = Rail(self.scheduler, "vcc", 3.0)
        self.setup: Callable[[Msp430F1611], None] = lambda mcu: None
        self.boots = 0
        self.hold_watchdog = True
        self.mcu = Msp430F1611(
            self.scheduler, self.rail, self._boot,
            dco_factor=dco_factor, lfxt1_drift_ppm=lfxt1_drift_ppm,
        )  # fmt: skip

    def _boot(self, mcu: Msp430F1611) -> None:
        self.boots += 1
        if self.hold_watchdog:
            mcu.reg["WDTCTL"].write(0x5A80)
        self.setup(mcu)

    def start(self, setup: Callable[[Msp430F1611], None] | None = None) -> McuBench:
        """Run up to and over the release from reset."""
        if setup is not None:
            self.setup = setup
        self.scheduler.run(2_100 * FS_PER_US)
        assert self.boots == 1
        return self

    def task(self, body: Coroutine) -> None:
        self.mcu.cpu.spawn("test", body)

    def write(self, **values: int) -> None:
        for name, value in values.items():
            self.mcu.reg[name].write(value)

    def read(self, name: str) -> int:
        return self.mcu.reg[name].read()

    def run_us(self, duration_us: float) -> None:
        self.scheduler.run(self.scheduler.now + round(duration_us * FS_PER_US))

    def handle(self, line: str, action: Callable[[], object], cycles: int = 10) -> None:
        def handler() -> int:
            action()
            return cycles

        self.mcu.cpu.on_interrupt(line, handler)


@pytest.fixture
def bench() -> McuBench:
    return McuBench().start()


@pytest.fixture(scope="session")
def make_bench() -> type[McuBench]:
    return McuBench  # a class has no state: property tests may share it
