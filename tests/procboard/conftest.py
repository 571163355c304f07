"""A bench for the flash: the real chip and driver, run without a CPU, step by step.

Every byte on the wires, every chip select edge and several moments of every wait are steps. At each
of them a test may look, or cut the supply.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Generator
from typing import Any

import pytest

from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_US
from procboard.chips.m25p80 import M25P80, FlashGeometry, FlashImage
from procboard.drivers.m25p80 import M25P80Driver

BYTE_FS = 4 * FS_PER_US


class PowerLostError(Exception):
    """The bench cut the supply."""


class FlashBench:
    def __init__(
        self,
        geometry: FlashGeometry,
        image: FlashImage | None = None,
        seed: int = 0,
        wait_steps: int = 6,
    ) -> None:
        self.scheduler = Scheduler()
        self.rail = Rail(self.scheduler, "3V", 3.0)
        self.chip = M25P80(self.scheduler, self.rail, random.Random(seed), image, geometry)
        self.driver = M25P80Driver(self, self.sleep_us)
        self.wait_steps = wait_steps
        self.steps = 0
        self.on_step: Callable[[], None] = lambda: None
        self.cut_at: int | None = None

    def power_up(self) -> None:
        self.scheduler.run(self.scheduler.now + 20_000 * FS_PER_US)

    def step(self) -> None:
        self.steps += 1
        self.on_step()
        if self.steps == self.cut_at:
            self.rail.set_volts(0.0)
            raise PowerLostError

    def sleep_us(self, duration_us: int) -> Generator[int, None, None]:
        start = self.scheduler.now
        for part in range(1, self.wait_steps + 1):
            until = start + duration_us * FS_PER_US * part // self.wait_steps
            # A hair before the end, so that the last step still is within the cycle.
            self.scheduler.run(until - FS_PER_US if part == self.wait_steps else until)
            self.step()
        self.scheduler.run(start + duration_us * FS_PER_US)
        yield 0

    def exchange(self, command: bytes, answer_bytes: int = 0) -> Generator[int, None, bytes]:
        chip = self.chip
        chip.select(True)
        self.step()
        answer = bytearray()
        for byte in command + bytes(answer_bytes):
            answer.append(chip.begin())
            chip.end(byte)
            self.step()
        self.scheduler.run(self.scheduler.now + BYTE_FS * len(answer))
        chip.select(False)
        self.step()
        yield 0
        return bytes(answer[len(command) :])

    def run(self, firmware: Generator[Any, None, Any]) -> Any:
        while True:
            try:
                item = next(firmware)
            except StopIteration as done:
                return done.value
            assert isinstance(item, int), f"waits for {item!r}, and nobody will set it"

    def talk(self, command: bytes, answer_bytes: int = 0) -> bytes:
        return self.run(self.exchange(command, answer_bytes))

    def wait_s(self, duration_s: float) -> None:
        self.scheduler.run(self.scheduler.now + round(duration_s * 1e6) * FS_PER_US)


@pytest.fixture
def make_flash_bench() -> Callable[..., FlashBench]:
    def make(*args: Any, **kwargs: Any) -> FlashBench:
        bench = FlashBench(*args, **kwargs)
        bench.power_up()
        return bench

    return make


@pytest.fixture
def power_lost() -> type[Exception]:
    return PowerLostError
