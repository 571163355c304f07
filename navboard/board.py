"""The navigation board: chips wired to a dsPIC30F6014A. It reads as the list that it is.

The board meets the rest of the robot as signals and bytes: `spi` is where the processing board's
wires end, `data_ready` is the line back, `on_target` is the servo's shaft, `NavInputs` the world.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from firmware_model.dspic30f.eeprom import blank_eeprom
from firmware_model.dspic30f.mcu import DsPic30F6014A
from firmware_model.dspic30f.system import ResetCause
from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.signals import Quantity, Signal
from firmware_model.trace import Trace
from firmware_model.wires import I2cBus, SpiTarget
from navboard.chips.gps18x import SUPPLY_A as GPS_SUPPLY_A
from navboard.chips.gps18x import Gps18x
from navboard.chips.hs5646wp import Hs5646wp
from navboard.chips.lsm303dlh import Accelerometer, Magnetometer, earth_field
from navboard.chips.noise import chip_random
from navboard.chips.remote import RemoteChips, RemoteGps
from navboard.config import NavConfig, NavInputs
from navboard.firmware import NavFirmware
from navboard.sensor_controller import OnSample, Sample
from navboard.sensors import ANALOG_SENSORS, SENSORS, AnalogSensor
from spi_bus.link import Link

OnTarget = Callable[[int, "float | None"], None]
CHIPS_OFF_BELOW_V = 2.4
"""Supply below which the digital chips forget their registers (LSM303DLH: 2.5 V minimum)."""
GPS_SUPPLY_V = 5.0


class NavBoard:
    """One navigation board.

    Args:
        scheduler: time.
        trace: gets the channels `NAME.sample`, `NAME.servo`, `NAME.pulse`, `NAME.nmea`,
            `NAME.event`.
        rail: the 3.3 V supply.
        inputs: the physical world.
        on_target: called with (time_fs, angle in rad or None) when the servo's target changes.
        config: options and imperfections.
        seed: of every chip's noise and tolerances.
        gps_rail: the GPS's 5 V supply; without it the same power is drawn from `rail`.
        eeprom: cells of the data EEPROM, to keep them from one board object to the next.
        remote: stands where the chips would, with what they would say from elsewhere; then
            `inputs` and `seed` say nothing.

    """

    def __init__(
        self,
        scheduler: Scheduler,
        trace: Trace,
        rail: Rail,
        inputs: NavInputs,
        on_target: OnTarget,
        config: NavConfig | None = None,
        seed: int = 0,
        *,
        gps_rail: Rail | None = None,
        eeprom: bytearray | None = None,
        remote: RemoteChips | None = None,
    ) -> None:
        self.config = config = config or NavConfig()
        self.scheduler = scheduler
        self.rail = rail
        self.on_sample: OnSample | None = None
        """Called with (time_fs, values of `SAMPLE_CHANNELS`) at every control tick."""
        self.firmware: NavFirmware | None = None
        """RAM of the boot that runs; None before the first."""
        self.links: list[Link] = []
        """The link of every boot, for its counters."""
        name = config.name
        self._samples = trace.channel(f"{name}.sample")
        self._targets = trace.channel(f"{name}.servo")
        self._pulses = trace.channel(f"{name}.pulse")
        self._nmea = trace.channel(f"{name}.nmea")
        self._events = trace.channel(f"{name}.event")
        self._on_target = on_target

        # Analog inputs: AN3 to AN9.
        self._fitted: list[AnalogSensor] = []
        outputs: dict[int, Quantity] = {}
        for sensor in ANALOG_SENSORS:
            volts = sensor.outputs(inputs, config, seed)
            if volts is not None:
                self._fitted.append(sensor)
                if remote is not None:
                    volts = tuple(remote.volts(place, rail.volts) for place in sensor.channels)
                outputs.update(zip(sensor.channels, volts, strict=True))
        # The consumer of each chip on the rail.
        fitted = {sensor.name for sensor in self._fitted}
        analog = {sensor.name for sensor in ANALOG_SENSORS}
        self._loads = [
            rail.consumer(_chip(row.part), {"on": row.supply_a})
            for row in SENSORS
            if row.supply_a and (row.name in fitted or row.name not in analog)
        ]

        # MCU.
        self.mcu = mcu = DsPic30F6014A(
            name, scheduler, rail, self._boot, config.mcu, eeprom or blank_eeprom()
        )
        mcu.reset_listener = self._reset
        for channel, quantity in outputs.items():
            mcu.adc.connect(channel, quantity)

        # I²C: LSM303DLH.
        self.accelerometer: Accelerometer
        self.magnetometer: Magnetometer
        if remote is not None:
            self.accelerometer, self.magnetometer = remote.accelerometer, remote.magnetometer
        else:
            self.accelerometer, self.magnetometer = lsm303dlh(scheduler, inputs, config, seed)
        mcu.i2c.bus = I2cBus((self.accelerometer, self.magnetometer))

        # UART2 and INT1: GPS 18x LVC.
        gps: Gps18x | RemoteGps | None = gps18x(scheduler, inputs, config, seed)
        if remote is not None and gps is not None:
            gps = remote.gps
        self.gps = gps
        if gps is not None:
            gps.listener = mcu.uart2.receive
            gps.pps.watch(mcu.pin("RA12").set)
            gps.sentence_listeners = (self._nmea.record,)
            amps = GPS_SUPPLY_A * (1.0 if gps_rail else GPS_SUPPLY_V / rail.volts.value)
            self._loads.append((gps_rail or rail).consumer("GPS 18x LVC", {"on": amps}))

        # OC1: HS-5646WP.
        self.servo = Hs5646wp(scheduler, mcu.oc1.pin, self._target, config.servo)
        self.servo.listeners = (self._pulses.record,)
        if remote is not None:
            remote.watch_servo(mcu.oc1.pin)

        # To the processing board: SPI1 (SS1 is RB2), data-ready on RD4.
        self.spi: SpiTarget = mcu.spi1
        self.data_ready: Signal[bool] = mcu.pin("RD4")

        self._chips_on = False
        rail.volts.watch(self._supply_changed)
        self._supply_changed(rail.volts.value)

    @property
    def analog_inputs(self) -> int:
        """Bit n: the board converts ANn."""
        return sum(1 << place for sensor in self._fitted for place in sensor.channels)

    def event(self, text: str) -> None:
        """Put something that happened into the trace (channel `NAME.event`)."""
        self._events.record(self.scheduler.now, text)

    def link_started(self, link: Link) -> None:
        """Keep the link of a boot (the firmware's probe)."""
        self.links.append(link)

    def sample(self, values: Sample) -> None:
        """Take the firmware's sample of a control tick (the firmware's probe)."""
        now = self.scheduler.now
        self._samples.record(now, values)
        if self.on_sample is not None:
            self.on_sample(now, values)

    def _boot(self, mcu: DsPic30F6014A) -> None:
        self.firmware = NavFirmware(mcu, self.config, tuple(self._fitted), self)

    def _reset(self, cause: ResetCause) -> None:
        names = "|".join(flag.name or "" for flag in ResetCause if flag in cause)
        self.event(f"reset {names}")

    def _target(self, time_fs: int, angle_rad: float | None) -> None:
        self._targets.record(time_fs, angle_rad)
        self._on_target(time_fs, angle_rad)

    def _supply_changed(self, volts: float) -> None:
        on = volts >= CHIPS_OFF_BELOW_V
        if on == self._chips_on:
            return
        self._chips_on = on
        for load in self._loads:
            load.enter("on" if on else "off")
        self.accelerometer.power(on)
        self.magnetometer.power(on)
        if self.gps is not None:
            self.gps.power(on)
        if not on:
            self.event("supply lost")


def lsm303dlh(
    scheduler: Scheduler, inputs: NavInputs, config: NavConfig, seed: int
) -> tuple[Accelerometer, Magnetometer]:
    """Return both parts of the LSM303DLH of a board, looking at its world."""
    accelerometer = Accelerometer(
        scheduler,
        inputs.accel_x_m_s2,
        inputs.accel_y_m_s2,
        inputs.accel_z_m_s2,
        chip_random(seed, config.name, "lsm303dlh.a"),
        config.compass_noise_scale,
    )
    magnetometer = Magnetometer(
        scheduler,
        earth_field(inputs.heading_rad, config.north_rad),
        chip_random(seed, config.name, "lsm303dlh.m"),
        config.hard_iron_t,
        config.compass_noise_scale,
    )
    return accelerometer, magnetometer


def gps18x(scheduler: Scheduler, inputs: NavInputs, config: NavConfig, seed: int) -> Gps18x | None:
    """Return the GPS receiver of a board, where one is fitted."""
    if config.gps is None:
        return None
    gps = replace(config.gps, north_rad=config.north_rad)
    rng = chip_random(seed, config.name, "gps18x")
    return Gps18x(scheduler, inputs.x_m, inputs.y_m, rng, gps)


def _chip(part: str) -> str:
    """Return the type of a part, without its maker."""
    return part.rsplit(maxsplit=1)[-1]
