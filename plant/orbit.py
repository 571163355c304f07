"""Steady motion of a tail beat as a periodic orbit: speed, turning radius and period, stability.

Simulating until transients have died costs some hundred beats, and nobody knows beforehand how
many. The steady beat itself is the fixed point of the map over one beat (``shooting``), found with
about two beats on the full grid; the eigenvalues of the map's derivative there are the Floquet
multipliers, which say whether, and how fast, a robot comes to swim so.

Position and heading are no part of the orbit. Over a beat the body moves by d and turns by ψ, and
all beats are this one, turned and put end to end: the motion is a circle exactly. Its radius is
that of the motion freed from the to and fro within the beat, in the frame that turns evenly:
with X(t) the position as a complex number, Ω = ψ/T and ΔX(t) = d + (e^{iψ} − 1) X(t) what a beat
that begins at t adds,

    D = 1/T ∫ e^{−iΩt} ΔX dt,     R = |D| / (2 |sin ½ψ|),     turning period 2π/|Ω|.

A uniform current carries the whole along; the orbit is that through the water.
"""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from plant.arrays import FloatArray
from plant.checks import check_number
from plant.divergence import diverged
from plant.errors import InvalidParameterError, NoOrbitError
from plant.layout import ROW, STATE, Column, Drive, Packed, State
from plant.metrics import mean_thrust_n
from plant.no_orbit import is_slowed, not_closed, undecided
from plant.packing import pack
from plant.parameters import PlantParameters
from plant.shooting import DIVERGED, FOUND, SINGULAR, IntArray, shoot
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start, Trajectory

if TYPE_CHECKING:
    from plant.flexible.motion import FlexibleMotion

ComplexArray = npt.NDArray[np.complex128]

STRAIGHT_RAD = 1e-7
"""An orbit that turns by less than this in a beat counts as straight: rounding turns as much."""

_COARSEST = 12  # steps per beat: the fewest with which the beat's harmonics are resolved
_NEAR = 3  # a full grid not finer than this times the coarsest has no others before it
_LONG = 600  # steps of a full grid before which a beat on every other point pays
_SERVO_STEPS = 1.0  # step in motor lags: RK4 is stable up to 2.8
_TRANSIENT_BEATS = 6
_BEND_BEATS = 1  # the same for a tail that bends, where a beat costs and P′ does not
_LONG_SWIM_BEATS = 500
_MARGIN = 1e-6  # of |multiplier| around 1, about what differences can tell
_UNSLOWED = 0.99  # largest |multiplier| that a body without any drag is believed
_BODY = tuple(State._fields.index(name) for name in ("u", "v", "r"))
_SERVO = tuple(State._fields.index(name) for name in ("servo", "servo_dot"))
_MEAN = State._fields.index("alpha_mean")
_LOOSE = tuple(State._fields.index(name) for name in ("loose", "loose_dot"))


@dataclass(frozen=True, slots=True)
class PeriodicOrbit:
    """The steady motion of one tail beat, through the water.

    ``trajectory``: one beat at ``step_s``, from the origin with heading 0 (n + 1 rows).
    ``speed_m_s``: net displacement over a beat / time; ``path_speed_m_s``: along the path freed
    from the to and fro. Radius and period are None where the path is straight. ``turn_rate_rad_s``
    counter-clockwise. ``mean_abs_beta_rad`` (3.31), ``mean_thrust_n`` (3.29).
    ``floquet_multipliers``: of the relative state (velocities, servo), largest first; a deviation
    shrinks by the largest each beat where it is below 1. ``error``: estimated error of the
    relative state on this grid, as a share of the scales of the motion.
    """

    beat: TailBeat
    step_s: float
    trajectory: Trajectory
    floquet_multipliers: ComplexArray
    monodromy: FloatArray
    error: float
    speed_m_s: float
    path_speed_m_s: float
    turn_rate_rad_s: float
    turn_radius_m: float | None
    turn_period_s: float | None
    mean_abs_beta_rad: float
    mean_thrust_n: float

    @property
    def stable(self) -> bool:
        """Whether small deviations die out."""
        return bool(abs(self.floquet_multipliers[0]) < 1.0 - _MARGIN)

    @property
    def settling_beats(self) -> float:
        """Beats in which a small deviation falls by 1/e; infinite for an unstable orbit."""
        largest = float(abs(self.floquet_multipliers[0]))
        if largest >= 1.0:
            return math.inf
        return -1.0 / math.log(largest) if largest > 0.0 else 0.0

    @property
    def start(self) -> Start:
        """A start on the orbit, at the beginning of a beat, for ``simulate`` with an ideal tail."""
        row = self.trajectory.rows[0]
        return Start(
            u_m_s=float(row[Column.U]),
            v_m_s=float(row[Column.V]),
            r_rad_s=float(row[Column.R]),
            tail_angle_rad=float(row[Column.ALPHA]),
        )


def _relative_state(packed: Packed) -> IntArray:
    """Which elements of the state a beat hands on to the next: velocities, and what the tail has.

    An ideal servo is where it is told to be, and has none.
    """
    picks = list(_BODY)
    if packed.servo_ideal == 0.0:
        picks += (*_SERVO, _MEAN)
    elif packed.servo_tracks != 0.0:
        picks += _SERVO
    if packed.play != 0.0:
        picks += _LOOSE
    return np.array(picks, dtype=np.int64)


def _scales(packed: Packed, drive: Drive) -> FloatArray:
    """What counts as one in each element of the state: a tenth of what the tail itself does."""
    rate = 0.1 * drive.amplitude * drive.omega
    speed = rate * packed.tail_length
    angle = drive.amplitude
    scale = State(
        x=1.0,
        y=1.0,
        psi=1.0,
        u=speed,
        v=speed,
        r=rate,
        servo=angle,
        servo_dot=angle * drive.omega,
        alpha_mean=angle,
        loose=angle,
        loose_dot=angle * drive.omega,
    )
    return np.array(scale)


def _bend_scales(
    parameters: PlantParameters, drive: Drive, bend: int
) -> tuple[FloatArray, FloatArray]:
    """The same for the bend and for its rates: angles of segments, or amplitudes of modes."""
    size = drive.amplitude
    if parameters.tail.modes > 0:
        size *= 0.1 * parameters.tail.length_m
    return np.full(bend, size), np.full(bend, size * drive.omega)


def _rough_start(packed: Packed, drive: Drive) -> FloatArray:
    """Speed at which the drag balances the thrust of a tail on an anchored body; tail as told.

    The mean over a beat of −½mL²α̈ sin α (3.30) is ¼mL²·α_A²ω² cos α₀ for small α_A.
    """
    stroke = drive.amplitude * drive.omega
    thrust = 0.5 * packed.tail_second * stroke * stroke * max(math.cos(drive.bias), 0.1)
    resistance = packed.half_rho_s * (packed.drag + packed.drag_bias * drive.bias**2)
    fastest = stroke * packed.tail_length
    # body motion takes a third off the thrust
    speed = min(math.sqrt(0.6 * thrust / resistance), fastest) if resistance > 0.0 else fastest
    sine, cosine = math.sin(drive.phase), math.cos(drive.phase)
    angle = drive.bias + drive.amplitude * sine
    state = State(
        x=0.0,
        y=0.0,
        psi=0.0,
        u=speed,
        v=0.0,
        r=0.0,
        servo=angle,
        servo_dot=stroke * cosine,
        alpha_mean=drive.bias,
        loose=angle,
        loose_dot=stroke * cosine,
    )
    return np.array(state)


def _grids(packed: Packed, flexible: bool, frequency_hz: float, step_s: float) -> IntArray:
    """Steps per beat on each grid, coarse to fine; the finest has no step above ``step_s``.

    The coarsest is stable for the servo, and so are all; Radau IIA, of flexible tails, is stable
    with any step, and needs a fine one only where a rate jumps. All are even: both half beats see
    the same grid, and what is the same to left and right stays so.
    """
    coarsest = _COARSEST
    jumps = packed.servo_tracks != 0.0 or packed.play != 0.0
    if jumps or (packed.servo_ideal == 0.0 and not flexible):
        coarsest = max(coarsest, math.ceil(packed.servo_rate / (frequency_hz * _SERVO_STEPS)))
    # a billionth, so that 1/f = n · step makes n steps whatever the rounding
    finest = max(coarsest, math.ceil(1.0 / (frequency_hz * step_s) - 1e-9))
    if finest < _NEAR * coarsest:
        grids = [finest]
    elif flexible:
        grids = [coarsest, min(_NEAR * coarsest, finest // 2), finest]
    elif finest < _LONG:
        grids = [coarsest, math.ceil(math.sqrt(coarsest * finest)), finest]
    else:
        middle = max(coarsest, math.ceil(0.5 * math.sqrt(coarsest * finest)))
        grids = [coarsest, middle, finest // 2, finest]
    return np.array([steps + steps % 2 for steps in grids], dtype=np.int64)


@dataclass(frozen=True, slots=True)
class _Search:
    """One search: what went in, and the arrays that ``shoot`` fills."""

    flexible: "FlexibleMotion | None"
    packed: FloatArray
    drive: FloatArray
    picks: IntArray
    grids: IntArray
    period_s: float
    tolerance: float
    z: FloatArray
    scale: FloatArray
    monodromy: FloatArray
    rows: FloatArray
    state: FloatArray
    report: FloatArray

    def run(self, transient_beats: int) -> int:
        """Shoot; where the coarsest grid diverges or leads nowhere, begin on the next."""
        begin = self.z.copy()
        for coarsest in range(self.grids.size):
            self.z[:] = begin
            self.report[:] = np.nan
            rest = (
                self.drive,
                self.picks,
                self.grids[coarsest:],
                self.period_s,
                transient_beats,
                self.tolerance,
                self.z,
                self.scale,
                self.monodromy,
                self.rows,
                self.state,
                self.report,
            )
            if self.flexible is not None:
                from plant.flexible.shooting import shoot_flexible

                status = shoot_flexible(self.flexible, *rest)
            else:
                status = shoot(self.packed, *rest)
            if status in (FOUND, SINGULAR):
                break
        return status


def periodic_orbit(
    parameters: PlantParameters,
    beat: TailBeat,
    step_s: float = 1e-3,
    *,
    tolerance: float = 1e-8,
    speed_limit_rad_s: float = math.inf,
) -> PeriodicOrbit:
    """Find the steady motion of a tail beat.

    The beat is divided into equal steps of at most ``step_s``; on that grid the orbit is that of
    ``simulate``, to ``tolerance`` (of the scales of the motion; the error of the grid itself is
    the integrator's). ``speed_limit_rad_s``: the servo's. Where the first orbit found is unstable,
    a long swim away from it looks for a stable one.
    Raises ``InvalidParameterError`` for a tail that does not beat, ``DivergedError`` where the
    motion leaves all bounds, ``NoOrbitError`` with the reason where no beat repeats.
    """
    check_number("periodic_orbit.step_s", step_s, above=0.0, most=1.0)
    check_number("periodic_orbit.tolerance", tolerance, least=1e-12, most=1e-2)
    if not speed_limit_rad_s > 0.0:
        raise InvalidParameterError("periodic_orbit.speed_limit_rad_s", "must be above 0")
    for name in ("amplitude_rad", "frequency_hz"):
        check_number(
            f"periodic_orbit.beat.{name}",
            getattr(beat, name),
            above=0.0,
            because="a tail at rest makes no steady motion",
        )
    still = _still_water(parameters)
    slowed = is_slowed(still)
    if not slowed and still.hydrodynamics.body_motion_in_tail == 0.0:
        raise NoOrbitError(
            "nothing slows the body: it has no drag, no yaw drag and no linear drag, and its "
            "motion no part in the tail's forces",
            math.inf,
        )
    packed = pack(still)
    picks = _relative_state(packed)
    grids = _grids(packed, still.tail.flexible, beat.frequency_hz, step_s)
    servo = parameters.servo
    limit = min(float(speed_limit_rad_s), servo.largest_speed_rad_s)
    segments = TailProgramme.steady(beat).segments(
        step_s, servo.command_delay_s, servo.command_lag_s, limit
    )
    drive = segments[0][1]
    z, scale, bend = _rough_start(packed, drive), _scales(packed, drive), 0
    motion = None
    if still.tail.flexible:
        from plant.flexible import motion as flexible

        motion = flexible.FlexibleMotion(still, 1.0 / beat.frequency_hz / int(grids[-1]))
        bend = (motion.width - ROW) // 2
        z = motion.state(z)
        motion.straighten(np.array(drive), z)
        scale = np.concatenate((scale, *_bend_scales(parameters, drive, bend)))
        picks = np.concatenate((picks, np.arange(STATE, STATE + 2 * bend)))
    search = _Search(
        flexible=motion,
        packed=np.array(packed),
        drive=np.array(drive),
        picks=picks,
        grids=grids,
        period_s=1.0 / beat.frequency_hz,
        tolerance=tolerance,
        z=z[picks],
        scale=scale[picks],
        monodromy=np.empty((picks.size, picks.size)),
        rows=np.empty((int(grids[-1]) + 1, ROW + 2 * bend)),
        state=np.empty_like(z),
        report=np.full(3, np.nan),
    )
    status = search.run(_BEND_BEATS if still.tail.flexible else _TRANSIENT_BEATS)
    if status == DIVERGED:
        _, point, h = search.report
        raise diverged(parameters, search.drive, 0, int(point), float(h), search.state)
    if status != FOUND:
        gap = float(search.report[0])
        grid_s = search.period_s / int(grids[-1])
        why = undecided(parameters) if status == SINGULAR else not_closed(gap, grid_s, tolerance)
        raise NoOrbitError(why, gap)
    orbit = _described(beat, search)
    if not slowed and abs(orbit.floquet_multipliers[0]) > _UNSLOWED:
        raise NoOrbitError(
            "nothing but its tail slows the body, which has no drag, no yaw drag and no linear "
            f"drag, and of a deviation {abs(orbit.floquet_multipliers[0]):.4g} remain after a beat",
            orbit.error,
        )
    if orbit.stable:
        return orbit
    away = replace(search, z=search.z + 0.01 * search.scale, rows=np.empty_like(search.rows))
    if away.run(_LONG_SWIM_BEATS) == FOUND:
        other = _described(beat, away)
        if other.stable:
            return other
    return orbit


def _still_water(parameters: PlantParameters) -> PlantParameters:
    """Parameters without the uniform current; what depends on place or time is refused."""
    water = parameters.water
    for name, here, because in (
        ("water.shear_x_per_y_s", water.shear_x_per_y_s, "place in a sheared current"),
        ("water.shear_y_per_x_s", water.shear_y_per_x_s, "place in a sheared current"),
        ("walls.drag_rise", parameters.walls.drag_rise, "place between walls"),
        ("walls.stiffness_n_m", parameters.walls.stiffness_n_m, "place between walls"),
        ("linkage.fade_per_s", parameters.linkage.fade_per_s, "age of a fading linkage"),
    ):
        if here != 0.0:
            raise InvalidParameterError(
                name, f"must be 0, no motion is steady that depends on the {because}, got {here!r}"
            )
    if parameters.force.acting:
        raise InvalidParameterError(
            "force.coefficients", "must be empty: the steady motion of a pushed robot is not known"
        )
    if water.current_x_m_s == 0.0 and water.current_y_m_s == 0.0:
        return parameters
    return replace(parameters, water=replace(water, current_x_m_s=0.0, current_y_m_s=0.0))


def _described(beat: TailBeat, search: _Search) -> PeriodicOrbit:
    """What one closed beat says of the motion for ever."""
    period, steps = search.period_s, int(search.grids[-1])
    h = period / steps
    trajectory = Trajectory(np.arange(steps + 1, dtype=np.float64) * h, search.rows)
    position = trajectory.x_m + 1j * trajectory.y_m
    turn = float(trajectory.heading_rad[-1])
    # Σ over the beat's grid points: the trapezoid rule, of any order for what is periodic
    gained = position[-1] + complex(np.expm1(1j * turn)) * position[:-1]
    net = abs(complex(np.exp(-1j * turn / steps * np.arange(steps)) @ gained)) / steps
    half = 0.5 * turn
    straight = abs(turn) < STRAIGHT_RAD
    beta = np.arctan2(trajectory.v_m_s[:-1], trajectory.u_m_s[:-1])
    multipliers = np.linalg.eigvals(search.monodromy).astype(np.complex128)
    order = np.lexsort((multipliers.imag, -abs(multipliers)))
    return PeriodicOrbit(
        beat=beat,
        step_s=h,
        trajectory=trajectory,
        floquet_multipliers=multipliers[order],
        monodromy=search.monodromy,
        error=float(search.report[0]),
        speed_m_s=net / period,
        path_speed_m_s=net / period * (1.0 if straight else half / math.sin(half)),
        turn_rate_rad_s=0.0 if straight else turn / period,
        turn_radius_m=None if straight else net / (2.0 * abs(math.sin(half))),
        turn_period_s=None if straight else 2.0 * math.pi * period / abs(turn),
        mean_abs_beta_rad=float(np.abs(beta).sum()) / steps,
        mean_thrust_n=mean_thrust_n(trajectory, beat.frequency_hz, 1),
    )
