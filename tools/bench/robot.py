"""One robot: a vehicle in the water, two boards, the wires between them, and what they look at."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from firmware_model.dspic30f.mcu import DspicConfig
from navboard.board import NavBoard
from navboard.chips.gps18x import Gps18xConfig
from navboard.config import NavConfig
from navboard.drivers import reset_counter
from navboard.motion import MotionLimits
from navboard.sensor_controller import Sample
from plant.tail_input import TailBeat
from procboard import boot_count
from procboard.applications.heading import HeadingConfig, HeadingControl
from procboard.applications.open_loop import OpenLoop
from procboard.applications.services import Application
from procboard.applications.survey import Survey, SurveyConfig
from procboard.applications.swimming import TailBeatSetting
from procboard.applications.target_tracking import TargetTracking, TrackingConfig
from procboard.applications.telemetry import TelemetryConfig
from procboard.applications.tracking_law import TrackingGains
from procboard.board import MoteHardware, ProcBoard
from procboard.firmware import FirmwareConfig
from procboard.network import NetworkConfig
from procboard.storage import FullPolicy, LogConfig
from radio_802154.cc2420_registers import PA_LEVELS
from radio_802154.medium import Antenna, Medium
from spi_bus.transports.bridge import BridgeMaster, BridgeSlave
from spi_bus.transports.emulated import SpiWires
from tools.bench import mission, wrong
from tools.bench.starts import start_number
from tools.bench.swimmer import Swimmer
from tools.survey_section import QUANTITIES, surveys

if TYPE_CHECKING:
    from firmware_model.scheduler import Scheduler
    from firmware_model.trace import Trace
    from navboard.chips.remote import RemoteChips
    from spi_bus.transports.bridge import FrameLine
    from tools.configuration import Scenario
    from tools.configuration import TargetTracking as TargetTrackingSection


def _ignore(_time_fs: int, _angle_rad: float | None) -> None:
    """Stand in for a servo that an ideal tail has no use for."""


class Robot:
    """Everything that swims."""

    def __init__(
        self,
        config: Scenario,
        scheduler: Scheduler,
        trace: Trace,
        medium: Medium,
        line: FrameLine | None = None,
        remote: RemoteChips | None = None,
        *,
        keep: bool = True,
        name: str = "",
        on: bool = True,
    ) -> None:
        """Put it together; with `line`, the board that `config.hil` names is at its other end.

        One of several has a `name`, with which its trace channels, its antenna and its random
        numbers begin.

        The emulated board in whose place it stands is there without supply, and its wires end in
        a bridge. With `remote` the navigation board's chips are elsewhere, and the water is too.
        Without `keep` neither truth nor voltage is kept over time. One that is not `on` waits for
        its supply (`power.restore`).
        """
        seed = config.scenario.seed
        before = wrong.prefix(name)
        self.swimmer = swimmer = Swimmer(
            config,
            scheduler,
            keep=keep,
            on=on,
            nav=config.hil.emulates_robot and not config.hil.nav,
            proc=config.hil.emulates_robot and not config.hil.proc,
        )
        self.battery, self.power = swimmer.battery, swimmer.power
        self.temperature, self.pollutant = swimmer.temperature, swimmer.pollutant
        self.parameters = swimmer.parameters
        self.vehicle = vehicle = swimmer.vehicle
        self.wires = SpiWires(
            scheduler,
            None,
            trace,
            f"{before}spi",
            config.link.bit_error_rate,
            random.Random(f"{seed}/{before}spi"),
        )
        self.nav = NavBoard(
            scheduler,
            trace,
            self.power.nav,
            swimmer.inputs(),
            _ignore if remote or vehicle.servo.ideal else vehicle.set_servo_target,
            nav_config(config, f"{before}nav"),
            seed,
            gps_rail=self.power.gps,
            remote=remote,
        )
        if vehicle.servo.ideal and remote is None:
            self.nav.on_sample = self._follow
            self._beat: Sample = ()
            self._arrives = wrong.arrives(config, name)
            self._settled, self._obeyed = False, True
        proc = f"{before}proc"
        medium.place(proc, Antenna(x_m=vehicle.x, y_m=vehicle.y))
        self.proc = ProcBoard(
            scheduler,
            trace,
            self.power.proc,
            medium,
            firmware_config(config),
            application(config),
            proc,
            seed,
            hardware=MoteHardware(
                config.procboard.clock_drift_ppm, 1.0 + 1e-6 * config.procboard.dco_drift_ppm
            ),
        )
        if line is not None:  # the other board outlives this program: see `starts`
            reset_counter.keep_count(self.nav.mcu.eeprom.cells, start_number())
            boot_count.keep_count(self.proc.mote.mcu, start_number())
        # The link: SCK, MOSI and MISO, chip select (low active), data ready.
        self.bridge: BridgeMaster | None = None
        if line is not None and config.hil.proc:
            self.bridge = BridgeMaster(scheduler, self.wires, line)
        else:
            self.proc.connect_link(self.wires)
            self.proc.link_select.watch(lambda level: self.wires.select(not level))
            self.wires.data_ready.watch(self.proc.data_ready.set)
        if line is not None and config.hil.nav:
            slave = BridgeSlave(line)
            self.wires.connect(slave)
            slave.data_ready.watch(self.wires.data_ready.set)
        else:
            self.wires.connect(self.nav.spi)
            self.nav.data_ready.watch(self.wires.data_ready.set)
        self.power.start(vehicle)

    def _follow(self, time_fs: int, sample: Sample) -> None:
        """Hand the beat that the motion controller makes to an ideal tail, past all pulses.

        A tail without lag would jump at every pulse; so it follows the beat as a formula. What the
        motion controller slews from tick to tick is one command, and arrives or is lost whole.
        """
        beat = sample[:3]
        if beat == self._beat:
            self._settled = True
            return
        if self._settled and any(self._beat):  # who has never beaten gets the first command
            self._obeyed = self._arrives()
        self._beat, self._settled = beat, False
        if self._obeyed:
            self.vehicle.set_tail_beat(time_fs, TailBeat(*(value or 0.0 for value in beat)))


def gps_config(config: Scenario) -> Gps18xConfig:
    """Return the GPS receiver that the scenario describes, fitted or not."""
    gps = config.navboard.gps
    return Gps18xConfig(
        latitude_deg=gps.latitude_deg,
        longitude_deg=gps.longitude_deg,
        noise_m=gps.noise_m,
        sentences=gps.sentences,
        north_rad=config.tank.north_rad,
    )


def nav_config(config: Scenario, name: str = "nav") -> NavConfig:
    """Return the navigation board that the scenario describes."""
    board, compass = config.navboard, config.navboard.compass
    return NavConfig(
        name=name,
        mcu=DspicConfig(drift_ppm=board.clock_drift_ppm),
        control_hz=board.control_hz,
        report_period_s=board.report_period_s,
        fail_safe_s=board.fail_safe_s,
        north_rad=config.tank.north_rad,
        limits=MotionLimits(angle_rad=board.tail_limit_rad),
        gyro_bias_rad_s=board.gyro.bias_rad_s,
        gyro_noise_scale=board.gyro.noise_scale,
        hard_iron_t=(compass.hard_iron_x_t, compass.hard_iron_y_t, 0.0),
        compass_noise_scale=compass.noise_scale,
        gps=gps_config(config) if board.gps.fitted else None,
        water_probe_fitted=board.water_probe.fitted,
        water_probe_noise_scale=board.water_probe.noise_scale,
        tail_potentiometer_fitted=board.tail_potentiometer.fitted,
        tail_potentiometer_noise_rad=board.tail_potentiometer.noise_rad,
    )


def network_config(config: Scenario, address: int) -> NetworkConfig:
    """Return the radio settings of a mote."""
    level = next(level for level, dbm, _ in PA_LEVELS if round(dbm) == config.radio.tx_power_dbm)
    return NetworkConfig(
        address, pan_id=config.radio.pan_id, channel=config.radio.channel, pa_level=level
    )


def firmware_config(config: Scenario) -> FirmwareConfig:
    """Return what is compiled into the processing board."""
    board = config.procboard
    network, policy = network_config(config, board.address), FullPolicy(board.storage.when_full)
    latency_s = board.storage.latency_s
    if surveys(config):
        return mission.firmware_config(config, network, policy, latency_s)
    return FirmwareConfig(network, log=LogConfig(policy=policy), store_latency_s=latency_s)


def _gains(tracking: TargetTrackingSection) -> TrackingGains:
    """Return the constants of the law that swims to places."""
    return TrackingGains(
        approach_per_s=tracking.approach_per_s,
        speed_per_s=tracking.speed_per_s,
        bias_max_rad=tracking.bias_max_rad,
        approach_below_rad=tracking.approach_below_rad,
        turn_above_rad=tracking.turn_above_rad,
        arrival_m=tracking.arrival_radius_m,
        lead_s=tracking.lead_s,
        leave_radii=tracking.leave_radii,
    )


def application(config: Scenario) -> Application:
    """Return the application that the scenario names."""
    board = config.procboard
    telemetry = TelemetryConfig(
        base_address=config.base_station.address,
        telemetry_period_s=board.telemetry_period_s,
        report_period_s=config.navboard.report_period_s,
        store_period_s=board.storage.period_s,
        gps_enabled=config.navboard.gps.fitted,
    )
    beat, heading = board.tail_beat, board.heading
    if board.application == "heading":
        return HeadingControl(
            HeadingConfig(
                target_m=heading.target_m,
                gain=heading.gain,
                bias_limit_rad=heading.bias_limit_rad,
                amplitude_rad=beat.amplitude_rad,
                frequency_hz=beat.frequency_hz,
                period_s=heading.update_period_s,
                arrival_m=heading.arrival_radius_m,
                rest_at_target=heading.rest_at_target,
            ),
            telemetry,
        )
    tracking = board.tracking
    if board.application == "target-tracking":
        return TargetTracking(
            TrackingConfig(
                targets_m=tracking.targets_m,
                amplitude_rad=beat.amplitude_rad,
                frequency_hz=beat.frequency_hz,
                coast_s=tracking.coast_s,
                gains=_gains(tracking),
            ),
            telemetry,
        )
    if surveys(config):
        return Survey(
            SurveyConfig(
                mission=mission.mission_config(config),
                survey=mission.way(config),
                quantity=QUANTITIES[config.survey.quantity][0],
                amplitude_rad=beat.amplitude_rad,
                frequency_hz=beat.frequency_hz,
                coast_s=tracking.coast_s,
                gains=_gains(tracking),
            ),
            telemetry,
        )
    initial = TailBeatSetting(beat.bias_rad, beat.amplitude_rad, beat.frequency_hz)
    return OpenLoop(initial if board.application == "open-loop" else None, telemetry)
