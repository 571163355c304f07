"""What a scenario says, as types: every key, its unit, its range and its default.

Plain frozen structs, one for each table of the TOML file. Defaults are the source's robot (Table
3.1 of J. Wang's dissertation, in which the coefficients of chapter 3 hold) and the parts' datasheet
values, so that an empty scenario is the robot at rest in still water. Loading, inheritance and
messages are in `tools.scenario`; nothing here reads a file.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec
from msgspec import Meta, defstruct

from tools.effects import ALL, UNKNOWN_FORCE
from tools.hil_section import Hil
from tools.ranges import (
    AddedMass,
    Angle,
    BodyRate,
    Coefficient,
    CrystalPpm,
    Current,
    Delay,
    DriftPpm,
    Duration,
    ErrorRate,
    Extent,
    Fraction,
    MagneticField,
    Mass,
    Moment,
    NoiseScale,
    PanId,
    Point,
    Position,
    Probability,
    ProfileFactor,
    Section,
    Seed,
    Shear,
    Slope,
    TailAmplitude,
    TailBias,
    TailExtent,
    TailFrequency,
    Torque,
    TurnRate,
    Voltage,
)
from tools.shoal_section import Shoal
from tools.survey_section import Survey


class Identity(Section, frozen=True):
    """`[scenario]`: what it is called, how long it lasts, which random numbers it draws."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")] = "scenario"
    description: str = ""
    duration_s: Annotated[float, Meta(gt=0, le=1e6)] = 40.0
    seed: Seed = 1


class Initial(Section, frozen=True):
    """`[initial]`: pose and body velocities at time zero, in the tank frame."""

    x_m: Position = 0.0
    y_m: Position = 0.0
    heading_rad: Angle = 0.0
    surge_m_s: BodyRate = 0.0
    sway_m_s: BodyRate = 0.0
    yaw_rate_rad_s: BodyRate = 0.0


class Plume(Section, frozen=True):
    """An elliptic Gaussian on top of a field; `peak` is in the field's unit, may be negative."""

    peak: Annotated[float, Meta(ge=-1e5, le=1e5)]
    x_m: Position = 0.0
    y_m: Position = 0.0
    sigma_along_m: Extent = 1.0
    sigma_across_m: Extent = 1.0
    axis_rad: Angle = 0.0


class TemperatureField(Section, frozen=True):
    """`[tank.temperature]`: of the water; by default with a heated corner, as in the source.

    With `file`, a grid from CSV or NPZ in place of the formula.
    """

    file: str = ""
    base_c: Annotated[float, Meta(ge=0, le=50)] = 20.0
    gradient_x_c_m: Annotated[float, Meta(ge=-100, le=100)] = 0.0
    gradient_y_c_m: Annotated[float, Meta(ge=-100, le=100)] = 0.0
    plumes: tuple[Plume, ...] = (Plume(peak=4.0, x_m=2.0, y_m=2.0),)


class PollutantField(Section, frozen=True):
    """`[tank.pollutant]`: fluorescent pollutant (oil or algae); never below zero.

    With `file`, a grid from CSV or NPZ in place of the formula.
    """

    file: str = ""
    base_ug_l: Annotated[float, Meta(ge=0, le=1e5)] = 2.0
    gradient_x_ug_l_m: Annotated[float, Meta(ge=-1e5, le=1e5)] = 0.0
    gradient_y_ug_l_m: Annotated[float, Meta(ge=-1e5, le=1e5)] = 0.0
    plumes: tuple[Plume, ...] = (
        Plume(peak=80.0, x_m=1.0, y_m=0.5, sigma_along_m=1.2, sigma_across_m=0.4, axis_rad=0.6),
    )


class Tank(Section, frozen=True):
    """`[tank]`: size, where the origin lies in it, where north is, what is in the water."""

    size_m: tuple[Extent, Extent] = (4.0, 3.0)
    corner_m: Point = (-1.0, -1.5)
    depth_m: Extent = 0.6
    north_rad: Angle = 0.0
    temperature: TemperatureField = TemperatureField()
    pollutant: PollutantField = PollutantField()


class Body(Section, frozen=True):
    """`[plant.body]`: Table 3.1 of the source; added masses are positive numbers (−X_u̇, …)."""

    mass_kg: Mass = 0.311
    hinge_distance_m: Annotated[float, Meta(ge=0, le=10)] = 0.07
    wetted_area_m2: Annotated[float, Meta(gt=1e-6, le=100)] = 0.0108
    yaw_inertia_kg_m2: Annotated[float, Meta(gt=1e-9, le=1e4)] = 0.311 * 0.14**2 / 12.0
    added_mass_surge_kg: AddedMass = 0.0621
    added_mass_sway_kg: AddedMass = 0.2299
    added_inertia_yaw_kg_m2: Annotated[float, Meta(ge=0, le=1e4)] = 1.0413e-4


class Tail(Section, frozen=True):
    """`[plant.tail]`: rigid as in chapter 3 of the source, or flexible as in chapter 4.

    `segments` above 1 makes rigid pieces joined by springs, `modes` above 0 a beam. A flexible
    tail needs `modulus_pa` and `thickness_m`, or `joint_stiffness_n_m`. Profiles are factors of
    depth and thickness at equally spaced stations from joint to tip; empty is uniform.
    """

    length_m: TailExtent = 0.08
    depth_m: TailExtent = 0.025
    segments: Annotated[int, Meta(ge=1, le=64)] = 1
    modes: Annotated[int, Meta(ge=0, le=20)] = 0
    modulus_pa: Annotated[float, Meta(ge=0, le=1e13)] = 0.0
    thickness_m: Annotated[float, Meta(ge=0, le=1)] = 0.0
    joint_stiffness_n_m: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    damping_s: Annotated[float, Meta(ge=0, le=1e3)] = 0.0
    depth_profile: tuple[ProfileFactor, ...] = ()
    thickness_profile: tuple[ProfileFactor, ...] = ()


class Hydrodynamics(Section, frozen=True):
    """`[plant.hydrodynamics]`: coefficients of chapter 3 at 20° bias; adapted drag (3.32, 3.33).

    `lift_per_bias` is the surrogate (3.34) and wants `lift = 0`; `linear_drag_n_s_m` is a force
    −b V beside the quadratic drag.
    """

    drag: Coefficient = 0.2231
    drag_per_bias_squared: Slope = 0.0
    lift: Coefficient = 4.50
    lift_per_bias: Coefficient = 0.0
    yaw_drag_n_m_s2: Coefficient = 11.29e-4
    yaw_drag_per_bias_n_m_s2: Slope = 0.0
    linear_drag_n_s_m: Coefficient = 0.0
    body_motion_in_tail: Fraction = 1.0
    munk_coupling: Fraction = 1.0
    bias_memory_s: Annotated[float, Meta(gt=0.01, le=1e3)] = 2.0


class Water(Section, frozen=True):
    """`[plant.water]`: density, and a steady current in the tank frame, uniform or sheared.

    At (x, y) the water moves with (current_x + shear_x_per_y · y, current_y + shear_y_per_x · x).
    """

    density_kg_m3: Annotated[float, Meta(gt=0.1, le=2e4)] = 1000.0
    current_x_m_s: Annotated[float, Meta(ge=-10, le=10)] = 0.0
    current_y_m_s: Annotated[float, Meta(ge=-10, le=10)] = 0.0
    shear_x_per_y_s: Shear = 0.0
    shear_y_per_x_s: Shear = 0.0


class Walls(Section, frozen=True):
    """`[plant.walls]`: what the walls of `[tank]` do to the robot; by default it passes through.

    `drag_rise` k: drag × (1 + k exp(−distance/0.1 m)); `stiffness_n_m`: of a soft contact.
    """

    drag_rise: Annotated[float, Meta(ge=-1, le=1e3)] = 0.0
    stiffness_n_m: Annotated[float, Meta(ge=0, le=1e3)] = 0.0


class Servo(Section, frozen=True):
    """`[plant.servo]`: Hitec HS-5646WP; `ideal` is a tail that is where it is told to be.

    The origin of each value stands beside its twin in `plant.parameters`. Delay, lag, slowness
    (1 / largest speed) and extra dead band are neutral at zero and hold for an ideal servo, too.
    """

    ideal: bool = False
    command_delay_s: Delay = 0.0
    command_lag_s: Delay = 0.0
    slowness_s_rad: Coefficient = 0.0
    extra_dead_band_rad: Fraction = 0.0
    position_gain_per_s: Annotated[float, Meta(gt=0.1, le=1e4)] = 30.0
    motor_lag_s: Annotated[float, Meta(gt=1e-4, le=10)] = 0.010
    dead_band_rad: Annotated[float, Meta(ge=0, le=1)] = math.radians(0.2)
    low_voltage_v: Voltage = 6.0
    low_voltage_speed_rad_s: TurnRate = math.radians(60.0) / 0.20
    low_voltage_stall_torque_n_m: Torque = 11.3 * 9.80665e-2
    high_voltage_v: Voltage = 7.4
    high_voltage_speed_rad_s: TurnRate = math.radians(60.0) / 0.18
    high_voltage_stall_torque_n_m: Torque = 12.9 * 9.80665e-2
    least_voltage_v: Annotated[float, Meta(ge=0, le=100)] = 4.0
    idle_current_a: Current = 4.5e-3
    running_current_a: Current = 0.330
    stall_current_a: Annotated[float, Meta(gt=1e-3, le=100)] = 2.1


class Linkage(Section, frozen=True):
    """`[plant.linkage]`: between servo and tail: (1 + gain_error)(1 − fade t) · angle + offset."""

    gain_error: Annotated[float, Meta(ge=-1, le=10)] = 0.0
    fade_per_s: Annotated[float, Meta(ge=-1, le=1)] = 0.0
    offset_rad: Annotated[float, Meta(ge=-math.pi, le=math.pi)] = 0.0
    play_rad: Annotated[float, Meta(ge=0, le=2)] = 0.0


class Plant(Section, frozen=True):
    """`[plant]`: the robot in the water; the step is the integrator's, not the sensors'.

    Its sections have the names and defaults of `plant.parameters`: a test keeps them together.
    """

    step_s: Annotated[float, Meta(ge=1e-5, le=0.02)] = 0.001
    body: Body = Body()
    tail: Tail = Tail()
    hydrodynamics: Hydrodynamics = Hydrodynamics()
    water: Water = Water()
    walls: Walls = Walls()
    servo: Servo = Servo()
    linkage: Linkage = Linkage()


def _effects() -> type[msgspec.Struct]:
    """Make `[effects]` of the table of effects: a section for each row, a key for a parameter."""
    tables: list[Any] = []
    for effect in ALL.values():
        if effect is UNKNOWN_FORCE:  # its keys are no names of fields; the plant checks them
            tables.append((effect.name, dict[str, float], {}))
            continue
        keys = [
            (item.name, Annotated[float, Meta(ge=item.least, le=item.most)], item.neutral)
            for item in effect.parameters
        ]
        described = {"__doc__": f"`[effects.{effect.name}]`: {effect.description}."}
        kind = defstruct(
            effect.name, keys, bases=(Section,), namespace=described, frozen=True, kw_only=True
        )
        tables.append((effect.name, kind, kind()))
    return defstruct(
        "Effects",
        tables,
        bases=(Section,),
        namespace={"__doc__": "`[effects]`: named changes, all neutral at zero."},
        frozen=True,
        kw_only=True,
    )


if TYPE_CHECKING:

    class Effects(Section, frozen=True):
        """`[effects]`: named changes, all neutral at zero."""

else:
    Effects = _effects()


class Battery(Section, frozen=True):
    """`[battery]`: two Li-ion polymer cells, 7.4 V, 13.32 Wh."""

    cells: Annotated[int, Meta(ge=1, le=20)] = 2
    capacity_ah: Annotated[float, Meta(gt=1e-5, le=1e3)] = 1.8
    internal_resistance_ohm: Annotated[float, Meta(ge=0, le=100)] = 0.12
    initial_charge: Fraction = 1.0
    cut_off_v_per_cell: Annotated[float, Meta(ge=0, le=5)] = 3.0


class Gyro(Section, frozen=True):
    """`[navboard.gyro]`: LPY503AL; bias stands in place of a drawn one."""

    bias_rad_s: BodyRate | None = None
    noise_scale: NoiseScale = 1.0


class Compass(Section, frozen=True):
    """`[navboard.compass]`: LSM303DLH, accelerometer and magnetometer."""

    hard_iron_x_t: MagneticField = 0.0
    hard_iron_y_t: MagneticField = 0.0
    noise_scale: NoiseScale = 1.0


class Gps(Section, frozen=True):
    """`[navboard.gps]`: GPS 18x LVC. Indoors there is no fix: it is not fitted by default."""

    fitted: bool = False
    latitude_deg: Annotated[float, Meta(ge=-89, le=89)] = 42.7249
    longitude_deg: Annotated[float, Meta(ge=-180, le=180)] = -84.4793
    noise_m: Annotated[float, Meta(ge=0, le=1e3)] = 1.5
    sentences: tuple[Literal["RMC", "GGA", "GSA", "GSV", "VTG", "GLL"], ...] = ("RMC", "GGA")


class WaterProbe(Section, frozen=True):
    """`[navboard.water_probe]`: fluorescence of oil or algae."""

    fitted: bool = True
    noise_scale: NoiseScale = 1.0


class Potentiometer(Section, frozen=True):
    """`[navboard.tail_potentiometer]`: measures the true tail angle; few robots carry one."""

    fitted: bool = False
    noise_rad: Annotated[float, Meta(ge=0, le=3)] = 0.003


class Navboard(Section, frozen=True):
    """`[navboard]`: the board with the sensors and the servo."""

    clock_drift_ppm: CrystalPpm = 12.0
    control_hz: Annotated[float, Meta(ge=10, le=200)] = 50.0
    report_period_s: Annotated[float, Meta(ge=0.005, le=10)] = 0.1
    fail_safe_s: Annotated[float, Meta(ge=0.1, le=60)] = 3.0
    tail_limit_rad: Annotated[float, Meta(gt=0, le=math.pi / 2)] = math.radians(60)
    gyro: Gyro = Gyro()
    compass: Compass = Compass()
    gps: Gps = Gps()
    water_probe: WaterProbe = WaterProbe()
    tail_potentiometer: Potentiometer = Potentiometer()


class TailBeat(Section, frozen=True):
    """`[procboard.tail_beat]`: α(t) = bias + amplitude · sin φ, φ̇ = 2π · frequency."""

    bias_rad: TailBias = 0.0
    amplitude_rad: TailAmplitude = math.radians(15)
    frequency_hz: TailFrequency = 0.9


class HeadingControl(Section, frozen=True):
    """`[procboard.heading]`: proportional control of the bias towards a target (Fig. 5.10)."""

    target_m: Point = (2.0, 2.0)
    gain: Annotated[float, Meta(ge=0, le=100)] = 0.4
    bias_limit_rad: Annotated[float, Meta(ge=0, le=math.radians(50))] = math.radians(30)
    update_period_s: Annotated[float, Meta(ge=0.2, le=60)] = 5.0
    arrival_radius_m: Annotated[float, Meta(gt=1e-4, le=1e3)] = 0.1
    rest_at_target: bool = True


class TargetTracking(Section, frozen=True):
    """`[procboard.tracking]`: to one target after the other by the hybrid law (section 5.7).

    At most 16 targets; more may come by radio (`[[base_station.targets]]`) while it swims. The
    defaults' origin stands in `procboard.applications.tracking_law`.
    """

    targets_m: tuple[Point, ...] = ()
    arrival_radius_m: Annotated[float, Meta(gt=1e-4, le=1e3)] = 0.02
    approach_per_s: Annotated[float, Meta(gt=1e-4, le=100)] = 0.5
    speed_per_s: Annotated[float, Meta(gt=1e-4, le=100)] = 0.5
    bias_max_rad: Annotated[float, Meta(gt=0, le=math.radians(50))] = math.radians(40)
    approach_below_rad: Annotated[float, Meta(gt=0, le=math.pi)] = math.radians(20)
    turn_above_rad: Annotated[float, Meta(gt=0, le=math.pi)] = math.radians(40)
    lead_s: Annotated[float, Meta(ge=0, le=60)] = 0.75
    leave_radii: Annotated[float, Meta(ge=0, le=100)] = 2.5
    coast_s: Annotated[float, Meta(ge=0, le=3600)] = 5.0


class Storage(Section, frozen=True):
    """`[procboard.storage]`: the log on the M25P80 flash.

    `period_s`: least time between two sensor reports that are stored; 0 stores every one. The flash
    is busy for 0.6 s while it erases a sector, and the mote has RAM for nineteen reports meanwhile.
    """

    latency_s: Annotated[float, Meta(ge=0.05, le=60)] = 1.0
    period_s: Annotated[float, Meta(ge=0, le=3600)] = 0.0
    when_full: Literal["stop", "overwrite-oldest"] = "stop"


class Procboard(Section, frozen=True):
    """`[procboard]`: the TelosB mote and the application that it runs."""

    application: Literal["open-loop", "heading", "target-tracking", "survey", "telemetry"] = (
        "open-loop"
    )
    clock_drift_ppm: CrystalPpm = -18.0
    dco_drift_ppm: DriftPpm = 1500.0
    address: PanId = 1
    telemetry_period_s: Annotated[float, Meta(ge=0.1, le=3600)] = 0.5
    tail_beat: TailBeat = TailBeat()
    heading: HeadingControl = HeadingControl()
    tracking: TargetTracking = TargetTracking()
    storage: Storage = Storage()


class Link(Section, frozen=True):
    """`[link]`: the SPI wires between the boards."""

    bit_error_rate: ErrorRate = 0.0


class Radio(Section, frozen=True):
    """`[radio]`: the CC2420s and the air between them; a loss on top of propagation."""

    channel: Annotated[int, Meta(ge=11, le=26)] = 26
    pan_id: PanId = 0x22
    tx_power_dbm: Literal[0, -1, -3, -5, -7, -10, -15, -25] = 0
    loss_probability: Probability = 0.0


class TimedTailBeat(Section, frozen=True):
    """`[[base_station.tail_beats]]`: a tail-beat commanded by radio at a time.

    `robots`: addresses of those of a shoal that it is for; empty: all.
    """

    at_s: Moment
    bias_rad: TailBias = 0.0
    amplitude_rad: TailAmplitude = math.radians(15)
    frequency_hz: TailFrequency = 0.9
    robots: tuple[PanId, ...] = ()


class TimedTarget(Section, frozen=True):
    """`[[base_station.targets]]`: a target commanded by radio at a time.

    `robots`: addresses of those of a shoal that it is for; empty: all.
    """

    at_s: Moment
    x_m: Position
    y_m: Position
    robots: tuple[PanId, ...] = ()


class BaseStation(Section, frozen=True):
    """`[base_station]`: the mote on the bench that commands the robot and collects telemetry."""

    address: PanId = 0
    x_m: Position = -1.0
    y_m: Position = 0.0
    height_m: Annotated[float, Meta(ge=0, le=1e3)] = 1.0
    send_pose: bool = False
    pose_period_s: Annotated[float, Meta(ge=0.1, le=60)] = 1.0
    tail_beats: tuple[TimedTailBeat, ...] = ()
    targets: tuple[TimedTarget, ...] = ()


class Camera(Section, frozen=True):
    """`[camera]`: the overhead camera sees two LEDs on the robot."""

    fitted: bool = True
    frames_per_s: Annotated[int, Meta(ge=1, le=10_000)] = 30
    led_noise_m: Annotated[float, Meta(ge=0, le=10)] = 0.001
    led_baseline_m: Annotated[float, Meta(gt=1e-3, le=10)] = 0.10
    step_m: Annotated[float, Meta(gt=1e-6, le=1)] = 1e-4
    latency_s: Annotated[float, Meta(ge=0, le=60)] = 0.050


class SupplyCut(Section, frozen=True):
    """`[[faults.supply_cuts]]`: the battery is away for a while. Both boards lose power.

    `robots`: addresses of those of a shoal that it hits; empty: all.
    """

    at_s: Moment
    duration_s: Duration
    robots: tuple[PanId, ...] = ()


class FlashCut(Section, frozen=True):
    """`[[faults.flash_cuts]]`: as a supply cut, begun in the middle of a flash operation.

    `after_s` arms it; the first program or erase that begins then is cut at `at_fraction` of it.
    `robots`: addresses of those of a shoal that it hits; empty: all.
    """

    after_s: Moment
    at_fraction: Fraction = 0.5
    duration_s: Duration = 1.0
    robots: tuple[PanId, ...] = ()


class BaseOutage(Section, frozen=True):
    """`[[faults.base_outages]]`: the base station is out of range of all others for a while."""

    at_s: Moment
    duration_s: Duration


class Faults(Section, frozen=True):
    """`[faults]`: what goes wrong on purpose."""

    supply_cuts: tuple[SupplyCut, ...] = ()
    flash_cuts: tuple[FlashCut, ...] = ()
    base_outages: tuple[BaseOutage, ...] = ()


class Records(Section, frozen=True):
    """`[records]`: how densely the true state is written."""

    truth_period_s: Annotated[float, Meta(ge=0.001, le=10)] = 0.02


class Scenario(Section, frozen=True):
    """Everything that decides a run: the same scenario gives the same trace, byte for byte."""

    scenario: Identity = Identity()
    initial: Initial = Initial()
    tank: Tank = Tank()
    plant: Plant = Plant()
    effects: Effects = Effects()
    battery: Battery = Battery()
    navboard: Navboard = Navboard()
    procboard: Procboard = Procboard()
    link: Link = Link()
    radio: Radio = Radio()
    base_station: BaseStation = BaseStation()
    camera: Camera = Camera()
    faults: Faults = Faults()
    hil: Hil = Hil()
    shoal: Shoal = Shoal()
    survey: Survey = Survey()
    records: Records = Records()
