"""Telemetry: each sensor report into the log, the robot's state to the base twice a second.

A stored record is the link message's own bytes, its number first (`spi_bus.messages`), so what was
measured is kept to the last bit and `LINK_MESSAGES.decode` reads it.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from procboard.applications.commands import CommandDesk, send_message
from procboard.applications.services import Services
from procboard.applications.swimming import Swimmer
from procboard.coroutines import Firmware
from procboard.errors import ProcConfigError
from radio_802154.messages import Telemetry, TelemetryFlag
from spi_bus.errors import LinkFull
from spi_bus.messages import (
    LINK_MESSAGES,
    BoardEvent,
    BoardEventCode,
    GpsReport,
    SensorReport,
    SetReporting,
)

LINK_DOWN_US: Final = 1_000_000
"""Silence after which the navigation board is taken as gone."""
REPORT_CYCLES: Final = 150
"""Copying a report's fields: about 50 instructions (estimate)."""
TELEMETRY_CYCLES: Final = 400
"""Filling and encoding a telemetry message: about 130 instructions (estimate)."""


@dataclass(frozen=True, slots=True)
class TelemetryConfig:
    """Periods and the address that telemetry goes to."""

    base_address: int = 1
    telemetry_period_s: float = 0.5
    report_period_s: float = 0.1
    store_period_s: float = 0.0
    """Least time between two sensor reports that are stored, by the navigation board's clock; 0
    stores every one."""
    gps_enabled: bool = True

    def __post_init__(self) -> None:
        for name in ("telemetry_period_s", "report_period_s", "store_period_s"):
            if getattr(self, name) < 0:
                raise ProcConfigError(f"{name} = {getattr(self, name)}: 0 or more")


class TelemetryTask:
    """Receives the navigation board's messages, stores them, and reports."""

    def __init__(
        self, services: Services, config: TelemetryConfig, swimmer: Swimmer, desk: CommandDesk
    ) -> None:
        if services.link is None or services.storage is None:
            raise ValueError("telemetry needs a navigation board and a log")
        self.report: SensorReport | None = None
        """The last sensor report."""
        self.on_report: Callable[[SensorReport], None] | None = None
        """Hears of every sensor report."""
        self.heading_control = False
        self.target_reached = False
        self.fail_safe = False
        self._services = services
        self._config = config
        self._link = services.link
        self._storage = services.storage
        self._swimmer = swimmer
        self._desk = desk
        self._gps_fix = False
        slack_s = config.report_period_s / 2
        self._store_period_us = round(max(0.0, config.store_period_s - slack_s) * 1e6)
        self._store_from_us = 0
        self._sequence = 0
        self._link.on(SensorReport, self._on_report)
        self._link.on(GpsReport, self._on_gps)
        self._link.on(BoardEvent, self._on_board_event)
        services.cpu.spawn("telemetry", self._run())
        if config.report_period_s > 0:
            self._ask_for_reports()

    def _ask_for_reports(self) -> None:
        config = self._config
        with suppress(LinkFull):  # a fresh link has room; one that is full has asked already
            self._link.send(SetReporting(config.report_period_s, config.gps_enabled))

    def _store(self, message: object, wanted: bool = True) -> Firmware[None]:
        payload = LINK_MESSAGES.encode(message)
        self._services.hooks.sample(message, payload)
        if not wanted:
            return
        number = yield from self._storage.store(payload)
        if number is not None:
            self._services.hooks.appended(number, payload)

    def _on_report(self, message: SensorReport) -> Firmware[None]:
        self.report = message
        if self.on_report is not None:
            self.on_report(message)
        yield REPORT_CYCLES
        # A report may be a little early: half of a report's period is no reason to leave it out.
        due = self._store_from_us
        wanted = message.time_us >= due or message.time_us < due - 2 * self._store_period_us
        if wanted:
            self._store_from_us = message.time_us + self._store_period_us
        yield from self._store(message, wanted)

    def _on_gps(self, message: GpsReport) -> Firmware[None]:
        self._gps_fix = message.latitude_deg is not None
        yield REPORT_CYCLES
        yield from self._store(message)

    def _on_board_event(self, message: BoardEvent) -> Firmware[None]:
        if message.code == BoardEventCode.FAIL_SAFE_ON:
            self.fail_safe = True
        elif message.code == BoardEventCode.FAIL_SAFE_OFF:
            self.fail_safe = False
        elif message.code == BoardEventCode.RESET:
            self._ask_for_reports()  # it came up with its defaults
        yield REPORT_CYCLES
        yield from self._store(message)

    def message(self) -> Telemetry:
        """Return the state as it goes to the base station."""
        services, report = self._services, self.report
        now_us = services.alarms.now_us()
        storage, wanted = self._storage, self._swimmer.wanted
        silent = now_us - self._link.last_heard_us > LINK_DOWN_US or not self._link.link.connected
        flags = 0
        for flag, condition in (
            (TelemetryFlag.FAIL_SAFE, self.fail_safe),
            (TelemetryFlag.HEADING_CONTROL, self.heading_control),
            (TelemetryFlag.TARGET_REACHED, self.target_reached),
            (TelemetryFlag.GPS_FIX, self._gps_fix),
            (TelemetryFlag.LINK_DOWN, silent),
            (TelemetryFlag.STORAGE_FULL, storage.full or bool(storage.failure)),
            (TelemetryFlag.RESET, self._sequence == 0),
        ):
            if condition:
                flags |= int(flag)
        return Telemetry(
            time_s=now_us / 1e6,
            sequence=self._sequence,
            heading_rad=report.heading_rad if report else None,
            gyro_z_rad_s=report.gyro_z_rad_s if report else None,
            tail_bias_rad=wanted.bias_rad if wanted else None,
            battery_v=report.battery_v if report else None,
            temperature_c=report.temperature_c if report else None,
            water_quality_ug_l=report.water_quality_ug_l if report else None,
            samples_stored=storage.stored,
            samples_lost=min(255, storage.lost),
            last_command_id=self._desk.last_command_id,
            flags=flags,
        )

    def _run(self) -> Firmware[None]:
        alarms, config = self._services.alarms, self._config
        period = round(config.telemetry_period_s * 32_768)
        if period <= 0:
            return
        due = alarms.now()
        while True:
            due += period
            yield from alarms.sleep_until(due)
            yield TELEMETRY_CYCLES
            if send_message(self._services, config.base_address, self.message()):
                self._sequence = (self._sequence + 1) & 0xFFFF
