"""The storage controller: one task that flushes the log in time and erases ahead.

A record is stored when a page's worth has come together, or after `latency_s` at the latest. If the
flash fails or is full, the robot swims on: records are counted as lost, and telemetry says so.
"""

from __future__ import annotations

from collections.abc import Callable

from firmware_model.cpu import Cpu
from procboard.alarms import Alarms
from procboard.coroutines import Firmware
from procboard.drivers.m25p80 import M25P80Driver
from procboard.errors import FlashFailureError, LogFullError
from procboard.flash_regions import FlashRegion
from procboard.storage import LogConfig, RecordLog


class StorageController:
    """The log, mounted and served. `start` at every boot."""

    def __init__(
        self,
        cpu: Cpu,
        alarms: Alarms,
        driver: M25P80Driver | FlashRegion,
        config: LogConfig,
        latency_s: float,
        on_stored: Callable[[int], None],
    ) -> None:
        self.log = RecordLog(driver, config, on_stored)
        self.lost = 0
        """Records that were not stored since the boot: flash full or broken."""
        self.full = False
        self.failure = ""
        """What went wrong with the flash; empty while nothing did."""
        self._cpu = cpu
        self._alarms = alarms
        self._driver = driver
        self._latency_us = round(latency_s * 1_000_000)

    def start(self) -> Firmware[None]:
        """Wake the chip, mount the log, spawn the task."""
        try:
            yield from self._driver.start()
            yield from self.log.mount()
        except FlashFailureError as error:
            self.failure = str(error)
        else:
            self._cpu.spawn("storage", self._run())

    def store(self, payload: bytes) -> Firmware[int | None]:
        """Hand a record to the log; return its number, or None where it is lost."""
        if self.failure:
            self.lost += 1
            return None
        try:
            return (yield from self.log.append(payload))
        except LogFullError:
            self.full = True
        except FlashFailureError as error:
            self._fail(error)
        self.lost += 1
        return None

    @property
    def stored(self) -> int:
        """Records ever stored in this log, those of former boots included: the next number."""
        return self.log.stored_sequence + 1

    def settle(self) -> Firmware[None]:
        """Store all that was handed over before the call, or count it as lost."""
        if self.failure:
            return
        before = self.log.statistics.rejected
        try:
            yield from self.log.flush()
        except LogFullError:
            self.full = True
            self.lost += self.log.statistics.rejected - before
        except FlashFailureError as error:
            self._fail(error)

    def _fail(self, error: FlashFailureError) -> None:
        self.failure = str(error)
        self.lost += self.log.buffered

    def _run(self) -> Firmware[None]:
        log, alarms = self.log, self._alarms
        while not self.failure:
            if not log.buffered:
                yield log.pending
                continue
            log.page_full.clear()
            if not log.page_waits:
                alarm = alarms.after_us(self._latency_us, log.page_full)
                yield log.page_full
                alarms.cancel(alarm)
            yield from self.settle()
            if not self.failure and log.wants_preparing:
                try:
                    yield from log.prepare()
                except FlashFailureError as error:
                    self._fail(error)
