"""Firmware of the navigation board: start-up, handlers and tasks.

Everything in `NavFirmware` is RAM: it is made anew at every release from reset. Handlers do what
cannot wait; the rest is tasks: control (50 Hz, woken by the end of the ADC scan), IMU (I²C), GPS,
link. The tail comes first in a tick, since the servo's next frame begins a millisecond after it.

Two guards: the hardware watchdog catches code that spins (the CPU's idle instruction clears it), a
count-down in the tick handler catches a control task that does not come round any more.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Protocol

from firmware_model.cpu import Coroutine, Flag
from firmware_model.dspic30f.mcu import DsPic30F6014A
from navboard import costs
from navboard.config import NavConfig
from navboard.drivers.adc_scan import AdcScan
from navboard.drivers.board_clock import BoardClock
from navboard.drivers.gps18x import FixBuilder, GpsReceiver
from navboard.drivers.i2c import I2cDriver
from navboard.drivers.lsm303dlh import Lsm303dlh
from navboard.drivers.reset_counter import ResetCounter
from navboard.drivers.servo import ServoPulse
from navboard.errors import BusError, SentenceError
from navboard.link import LinkController
from navboard.motion import ONE_RAD, TailBeatGenerator
from navboard.sensor_controller import Sample, SensorController, gps_report
from navboard.sensors import SENSORS, AnalogSensor
from spi_bus.link import Link
from spi_bus.messages import (
    BoardEvent,
    BoardEventCode,
    CommandApplied,
    Ping,
    Pong,
    SetReporting,
    TailBeat,
)

TICK_BIT = 1 << 7  # T3IE, T3IF: IEC0, IFS0
PPS_BIT = 1 << 0  # INT1IE, INT1IF: IEC1, IFS1
LEAD_S = 0.001
"""How long before the servo's frame the control tick comes, where both run at 50 Hz."""
SUPERVISOR_S = 0.5
"""Longest absence of the control task."""
RETRY_TICKS = 50
PPS_FRESH_US = 1_000_000
_ACCELEROMETER_ROW = next(i for i, s in enumerate(SENSORS) if s.name == "accel_x_m_s2")
_COMPASS_ROW = next(i for i, s in enumerate(SENSORS) if s.name == "compass_rad")
_SWDTEN = 1 << 5
_CAUSES = 0xC0D3  # the bits of RCON that say why


class Probe(Protocol):
    """Who watches the firmware from outside the emulation; costs it no cycles."""

    def sample(self, values: Sample) -> None:
        """Take the sample of a control tick."""

    def event(self, text: str) -> None:
        """Take something that happened, in words."""

    def link_started(self, link: Link) -> None:
        """Take this boot's link, for its counters."""


class NavFirmware:
    """RAM and code of one boot."""

    def __init__(
        self,
        mcu: DsPic30F6014A,
        config: NavConfig,
        sensors: tuple[AnalogSensor, ...],
        probe: Probe,
    ) -> None:
        self.mcu = mcu
        self.config = config
        self._probe = probe
        reg = mcu.reg
        self.reset_cause = reg["RCON"].read() & _CAUSES
        reg["RCON"].write(_SWDTEN)
        self.clock = BoardClock(mcu)
        self.motion = TailBeatGenerator(config.limits, config.control_hz)
        self.servo = ServoPulse(mcu)
        self.scan = AdcScan(
            mcu,
            often=tuple(c for sensor in sensors if not sensor.slow for c in sensor.channels),
            seldom=tuple(c for sensor in sensors if sensor.slow for c in sensor.channels),
        )
        self.sensors = SensorController(config, sensors, self.scan)
        self.imu = Lsm303dlh(I2cDriver(mcu), config.hard_iron_calibration_t)
        self.gps = GpsReceiver(mcu) if config.gps is not None else None
        self.link: LinkController | None = None
        self.ticks = 0
        self.late_ticks = 0
        """Control ticks that came before the one before was done."""
        self._scan_done = Flag("scan")
        self._imu_due = Flag("imu")
        self._flags0 = reg["IFS0"]
        self._flags1 = reg["IFS1"]
        self._supervisor_ticks = round(SUPERVISOR_S * config.control_hz)
        self._supervisor = self._supervisor_ticks
        self._report_ticks = round(config.report_period_s * config.control_hz)
        self._until_report = self._report_ticks
        self._gps_enabled = True
        self._applied: int | None = None  # command to confirm at the next tick
        self._pps_us: int | None = None
        self._busy = False
        cpu = mcu.cpu
        cpu.on_interrupt("T3", self._tick_handler)
        cpu.on_interrupt("ADC", self._adc_handler)
        cpu.on_interrupt("INT1", self._pps_handler)
        cpu.spawn("main", self._main())

    # --- start-up ---------------------------------------------------------------------

    def _main(self) -> Coroutine:
        yield costs.INITIALISE
        mcu, cpu = self.mcu, self.mcu.cpu
        counter = ResetCounter(mcu)
        epoch = counter.next()
        yield from counter.store(epoch)
        self.link = link = LinkController(mcu, self.clock, epoch, self._message)
        self._probe.link_started(link.link)
        cpu.on_interrupt("SPI1", link.handler)
        cpu.spawn("link", link.task())
        cpu.spawn("control", self._control(link))
        cpu.spawn("imu", self._imu(link))
        if self.gps is not None:
            cpu.on_interrupt("U2RX", self.gps.handler)
            cpu.spawn("gps", self._gps(self.gps, link))
        self._start_timers()
        now_us = self.clock.now_us()
        link.send(BoardEvent(now_us, BoardEventCode.RESET, self.reset_cause), now_us)
        self._probe.event(f"boot {epoch}, RCON {self.reset_cause:#06x}")

    def _start_timers(self) -> None:
        """Timer3 is the control tick; at 50 Hz it leads the servo's frame by a millisecond."""
        reg = self.mcu.reg
        fcy = float(self.mcu.clock.frequency_hz)
        prescaler, tckps = (8, 1) if fcy / 8 / self.config.control_hz <= 65536 else (64, 2)
        period = round(fcy / prescaler / self.config.control_hz)
        lead = round(LEAD_S * fcy / 8)
        if prescaler == 8 and period == self.servo.frame_ticks:
            reg["TMR3"].write((reg["TMR2"].read() + lead) % period)
        reg["PR3"].write(period - 1)
        reg["IPC1"].write(0x5444)  # T3: 5
        reg["IPC4"].write(0x4447)  # INT1: 7, a time stamp
        reg["IPC6"].write(0x4445)  # U2RX: 5
        reg["IEC0"].set_bits(TICK_BIT)
        if self.gps is not None:
            reg["IEC1"].set_bits(PPS_BIT)
        reg["T3CON"].write(1 << 15 | tckps << 4)

    # --- handlers ---------------------------------------------------------------------

    def _tick_handler(self) -> int:
        self._flags0.clear_bits(TICK_BIT)
        self.scan.start()
        self.ticks += 1
        self._supervisor -= 1
        if self._supervisor <= 0:
            self._probe.event("supervisor reset")
            self.mcu.request_reset()
        return costs.TICK_ISR

    def _adc_handler(self) -> int:
        cycles = self.scan.finish()
        if self._busy:
            self.late_ticks += 1
        self._scan_done.set()
        return cycles

    def _pps_handler(self) -> int:
        self._flags1.clear_bits(PPS_BIT)
        self._pps_us = self.clock.now_us()
        return costs.PPS_ISR

    # --- tasks ------------------------------------------------------------------------

    def _control(self, link: LinkController) -> Coroutine:
        motion, sensors, servo, clock = self.motion, self.sensors, self.servo, self.clock
        watchdog, probe = self.mcu.watchdog, self._probe
        while True:
            self._busy = False
            yield self._scan_done
            self._busy = True
            watchdog.clear()
            self._supervisor = self._supervisor_ticks
            fail_safe = motion.step()
            servo.set_angle(motion.alpha)
            now_us = clock.now_us()
            cycles = costs.MOTION_STEP + costs.SERVO_WRITE + costs.CONTROL_LOOP
            if self._applied is not None or fail_safe:
                self._tell_motion(link, now_us, fail_safe)
            if self.gps is not None:
                cycles += self.gps.receive()
            yield cycles
            probe.sample(sensors.tick(motion))
            if sensors.accelerometer_due or sensors.magnetometer_due:
                self._imu_due.set()
            yield sensors.tick_cycles
            if self._report_ticks:
                self._until_report -= 1
                if self._until_report <= 0:
                    self._until_report = self._report_ticks
                    link.send_sample(sensors.report(now_us), now_us)
                    yield costs.REPORT
            link.poll(now_us)

    def _tell_motion(self, link: LinkController, now_us: int, fail_safe: bool) -> None:
        """Confirm a command at the tick that first follows it; report a fail-safe."""
        applied, self._applied = self._applied, None
        if applied is not None:
            link.send(CommandApplied(applied, now_us), now_us)
        if fail_safe:
            command_id = self.motion.command_id or 0
            link.send(BoardEvent(now_us, BoardEventCode.FAIL_SAFE_ON, command_id), now_us)
            self._probe.event(f"fail-safe on after command {command_id}")

    def _imu(self, link: LinkController) -> Coroutine:
        sensors = self.sensors
        up = yield from self._set_up_imu(link)
        retry = RETRY_TICKS
        while True:
            yield self._imu_due
            if not up:
                sensors.accelerometer_due = sensors.magnetometer_due = False
                retry -= 1
                if retry <= 0:
                    retry = RETRY_TICKS
                    up = yield from self._set_up_imu(link)
                continue
            row = _ACCELEROMETER_ROW
            try:
                if sensors.accelerometer_due:
                    sensors.accelerometer_due = False
                    acceleration = yield from self.imu.acceleration()
                    yield costs.ACCELEROMETER
                    sensors.acceleration(acceleration)
                if sensors.magnetometer_due:
                    sensors.magnetometer_due = False
                    row = _COMPASS_ROW
                    heading = yield from self.imu.heading()
                    yield costs.COMPASS + costs.FILTER_UPDATE
                    if heading is not None:
                        sensors.magnetic_heading(heading)
            except BusError:
                up = False
                self._fault(link, row)

    def _set_up_imu(self, link: LinkController) -> Generator[int, None, bool]:
        try:
            yield from self.imu.set_up()
        except BusError:
            self._fault(link, _ACCELEROMETER_ROW)
            return False
        return True

    def _fault(self, link: LinkController, row: int) -> None:
        now_us = self.clock.now_us()
        for name in ("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2", "compass_rad"):
            self.sensors.latest[name] = None
        link.send(BoardEvent(now_us, BoardEventCode.SENSOR_FAULT, row), now_us)
        self._probe.event(f"{SENSORS[row].part} does not answer")

    def _gps(self, gps: GpsReceiver, link: LinkController) -> Coroutine:
        builder = FixBuilder()
        while True:
            yield gps.sentence_ready
            while gps.sentences:
                sentence = gps.sentences.popleft()
                yield costs.NMEA_CHARACTER * len(sentence)
                try:
                    fix = builder.sentence(sentence)
                except SentenceError as error:
                    self._probe.event(str(error))
                    continue
                if fix is None:
                    continue
                now_us = self.clock.now_us()
                self.sensors.fix(fix)
                if self._gps_enabled:
                    pps_us = self._pps_us
                    fresh = pps_us is not None and now_us - pps_us < PPS_FRESH_US
                    time_us = pps_us if fresh and pps_us is not None else now_us
                    link.send_sample(gps_report(fix, time_us), now_us)
                    yield costs.REPORT

    # --- messages ---------------------------------------------------------------------

    def _message(self, message: object, now_us: int) -> None:
        assert self.link is not None
        if isinstance(message, TailBeat):
            ended = self.motion.command(
                message.command_id,
                message.bias_rad,
                message.amplitude_rad,
                message.frequency_hz,
                message.valid_for_s or self.config.fail_safe_s,
            )
            self._applied = message.command_id
            if ended:
                event = BoardEvent(now_us, BoardEventCode.FAIL_SAFE_OFF, message.command_id)
                self.link.send(event, now_us)
                self._probe.event(f"fail-safe off by command {message.command_id}")
        elif isinstance(message, SetReporting):
            self._report_ticks = round(message.period_s * self.config.control_hz)
            if message.period_s and not self._report_ticks:
                self._report_ticks = 1
            self._until_report = self._report_ticks
            self._gps_enabled = message.gps_enabled
        elif isinstance(message, Ping):
            self.link.send(Pong(message.token), now_us)

    @property
    def tail_command_rad(self) -> float:
        """Present tail command, rad."""
        return self.motion.alpha / ONE_RAD
