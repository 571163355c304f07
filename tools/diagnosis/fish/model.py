"""The fish as the engine sees it: ``FishModel`` implements ``diagnosis.model.Model``.

A set of values makes a ``Setup`` (tolerances first, then causes in the order of their table), the
setup makes the records of the compiled predictor, a run's inputs make its drives, and the predictor
does the rest. Whatever shifts a measurement in time (a clock that runs fast, a camera that is late
or stalls) shifts the moment at which it is predicted: measurements are taken in the order in which
they truly came about, each with the gain that it was given.

The start of a run is part of the estimator's own uncertainty: its pose is taken from the first
samples with a wide one, the velocities of a run from rest with a tight one. That integrates the
start out, as exactly as the filter is linear there, so no cause can hide behind a start or be
blamed for one. ``starts`` holds the biases that the robot's boards have anew in each run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from plant.errors import InvalidParameterError
from plant.extra_force import PLACES
from plant.parameters import PlantParameters
from tools.diagnosis.causes import CAUSES, unknown
from tools.diagnosis.fish.believed import Wrong, believing
from tools.diagnosis.fish.channels import CHANNELS, NAMES
from tools.diagnosis.fish.design import design
from tools.diagnosis.fish.dropped import Path, Paths, chosen, priced, search
from tools.diagnosis.fish.inputs import FishInputs, drives
from tools.diagnosis.fish.kernel import LAGS, OF_LAG, START, brought, predict
from tools.diagnosis.fish.nuisances import (
    ACCEL_BIAS_M_S2,
    TOLERANCE,
    of_each_run,
    sample_age_s,
    tolerances,
    within_tolerances,
)
from tools.diagnosis.fish.plan import Plan, Plans
from tools.diagnosis.fish.prepared import Prepared, prepare
from tools.diagnosis.fish.records import ESTIMATED, Kind, Restless
from tools.diagnosis.fish.setup import Setup
from tools.diagnosis.fish.signals import known
from tools.diagnosis.fish.start import at, guessed, moved_by, when
from tools.diagnosis.fish.tangent import respond
from tools.diagnosis.model import (
    Cause,
    Channel,
    Filter,
    FloatArray,
    IntArray,
    Noise,
    Parameter,
    Run,
    Values,
    by_differences,
)

LOST = 1e3
"""Standard deviations that each measurement is off which a model cannot predict at all."""

ALL_BUT = 0.999
"""Largest share of commands that may be lost: nothing arrives at one."""

_NO_CONTEXT = ("tolerance.", "dropped_commands.", f"{unknown.NAME}.")
"""What does not matter to which commands were lost: as small as it is, or theirs."""
_STILL = np.empty((0, 3))
OF_A_CHANGE = 2 + math.ceil(LAGS / OF_LAG) + 1
"""Steps that a change of the drive may add, at most."""
_LOOSE = 1e4
"""Stages of a flexible tail are solved to 1e-7: it moves whitened innovations by some 1e-6."""
_START_S = 1.0
"""From this much of a run's beginning a replay takes its start."""
_ACCELEROMETER = (int(Kind.ACCEL_X), int(Kind.ACCEL_Y))


@dataclass(frozen=True, slots=True)
class FishFilter(Filter):
    """Fixed gains, and the correlation times of the disturbances that they estimate.

    ``run``: along which they were designed.
    """

    correlation_s: FloatArray
    run: Run


class FishModel:
    """A robotic fish that is believed to be ``plant``.

    ``names``: its channels (default: all of ``CHANNELS``), ``sigmas``: noise where it is known,
    ``tolerance``: half width of the robot's own tolerances. ``control_hz``: of its own boards,
    where these recorded the runs. ``wrong``: effects of its instruments, clock and link that are
    believed as well.
    """

    def __init__(
        self,
        plant: PlantParameters,
        names: Sequence[str] = NAMES,
        sigmas: Mapping[str, float] | None = None,
        tolerance: float = TOLERANCE,
        *,
        control_hz: float | None = None,
        wrong: Wrong | None = None,
    ) -> None:
        known = {channel.name: kind for kind, channel in enumerate(CHANNELS)}
        sigmas = sigmas or {}
        self.plant = plant
        boards = control_hz is not None
        age_s = 0.0 if control_hz is None else sample_age_s(control_hz)
        healthy = Setup(
            plant,
            accel_late_s=age_s,
            compass_late_s=age_s,
            force={PLACES[n]: x for n, x in plant.force.coefficients},
        )
        self._believed = believing(healthy, wrong or {})
        self._kinds = np.array([known[name] for name in names], dtype=np.int64)
        self._channels = tuple(
            replace(CHANNELS[known[name]], sigma=sigmas.get(name)) for name in names
        )
        accelerometer = any(name.startswith("accel") for name in names)
        self._tolerances = tolerances(tolerance, accelerometer=accelerometer, boards=boards)
        self._starts = of_each_run(accelerometer=accelerometer) if boards else ()
        self._causes = tuple(
            possible(row.cause, plant) for row in CAUSES.values() if row.name != unknown.NAME
        )
        self._plans = Plans(self._kinds)
        self._paths = Paths()
        self._prepared = lru_cache(maxsize=512)(lambda key: prepare(self.setup(dict(key))))

    # What there is

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What can be measured."""
        return self._channels

    @property
    def tolerances(self) -> tuple[Parameter, ...]:
        """Tolerances of robot and instruments."""
        return self._tolerances

    @property
    def causes(self) -> tuple[Cause, ...]:
        """The rows of the table that have a name."""
        return self._causes

    def restrict(self, names: Sequence[str]) -> None:
        """Leave only some rows of the table, by their names."""
        self._causes = tuple(cause for cause in self._causes if cause.name in names)

    @property
    def library(self) -> tuple[Parameter, ...]:
        """Terms of unexplained forces along the axes of body and tank."""
        return unknown.LIBRARY

    @property
    def disturbances(self) -> tuple[str, ...]:
        """Accelerations by restless water."""
        return ("surge", "sway", "yaw")

    def starts(self, run: Run) -> tuple[Parameter, ...]:
        """What the boards have anew in each run; the estimator integrates the start itself out."""
        return self._starts

    def first_noise(self, runs: Sequence[Run]) -> Noise:
        """Noise from how rough each channel is; water that is a little restless (assumed).

        The yaw is that of the sway's force some 2 cm off the centre.

        The third difference of a record at some 10 Hz or more hardly knows the motion, and has a
        standard deviation of √20 σ under white noise (median of absolute values over 0.6745).
        """
        sigma = np.ones(len(self._channels))
        for index, channel in enumerate(self._channels):
            if channel.sigma is not None:
                sigma[index] = channel.sigma
                continue
            rough = []
            for run in runs:
                values = run.value[run.channel == index]
                if channel.angle:
                    values = np.unwrap(values)
                rough.append(np.abs(np.diff(values, 3)))
            together = np.concatenate(rough) if rough else np.empty(0)
            if together.size:
                least = 1e-4
                sigma[index] = max(least, float(np.median(together)) / 0.6745 / math.sqrt(20.0))
        return Noise(sigma, np.array([5e-4, 5e-4, 3e-3]), np.array([1.0, 1.0, 1.0]))

    # What it does

    def setup(self, values: Values) -> Setup:
        """Return the believed robot with some values, tolerances first.

        Raises ``InvalidParameterError`` for what no robot can be.
        """
        setup = within_tolerances(self._believed, values)
        if any(not name.startswith("tolerance.") for name in values):
            for row in CAUSES.values():
                setup = row.apply(setup, _own(row.name, values))
        return setup

    def filter(self, run: Run, values: Values, noise: Noise) -> Filter:
        """Design the extended Kalman filter along a run; for what cannot be, the believed one's."""
        plan = self._plans.of(run)
        try:
            prepared = self._of(values)
        except InvalidParameterError:
            prepared = self._of({})
        time_s, order = when(prepared.setup, plan)
        stiff = prepared.packed  # of a tail that bends, too: gains need not know it
        count = plan.time_s.size
        gain, variance, result = np.zeros((count, ESTIMATED)), np.ones(count), np.empty(count)
        table = self._drives(prepared, run)
        design(
            stiff,
            prepared.lens,
            _restless(noise),
            table,
            _guessed(prepared, run, plan, table),
            plan.unsure,
            prepared.longest_s,
            time_s,
            plan.kind,
            plan.value - _biases(prepared.setup, plan),
            order,
            _sigmas(run, plan, noise),
            gain,
            variance,
            result,
        )
        return FishFilter(gain, variance, noise.correlation_s, run)

    def innovations(self, run: Run, values: Values, fixed: Filter) -> FloatArray:
        """Measured minus predicted (n,), angles wrapped; what cannot be is far off."""
        try:
            return self._possible(run, values, fixed)
        except InvalidParameterError:
            return LOST * np.sqrt(fixed.variance)

    def _possible(self, run: Run, values: Values, fixed: Filter) -> FloatArray:
        """Innovations of what can be; raises ``InvalidParameterError`` for anything else."""
        plan, prepared = self._plans.of(run), self._of(values)
        changes = run.inputs.changes if prepared.setup.dropped > 0.0 else 0
        if changes == 0:
            return self._errors(prepared, run, plan, fixed)
        lost = self._lost(run, values, fixed)
        scale = np.sqrt(fixed.variance)
        whitened = self._errors(prepared, run, plan, fixed, lost) / scale
        share = min(prepared.setup.dropped, ALL_BUT)
        return scale * priced(whitened, len(lost), changes, share)

    def _lost(self, run: Run, values: Values, fixed: Filter) -> tuple[int, ...]:
        """Return the commands that were likeliest lost.

        Those of the run along which the filter was made: what was lost in a run was lost however
        its measurements are corrected meanwhile.
        """
        assert isinstance(fixed, FishFilter)
        swum = fixed.run if fixed.run.inputs is run.inputs else run
        path = self._paths.of(
            (swum, fixed), _context(values), lambda: self._losses(swum, values, fixed)
        )
        return chosen(path, run.inputs.changes)

    def _errors(
        self,
        prepared: Prepared,
        run: Run,
        plan: Plan,
        fixed: Filter,
        lost: tuple[int, ...] = (),
        until_s: float = math.inf,
    ) -> FloatArray:
        """Innovations without some of the commands; none after ``until_s``."""
        result = np.where(plan.time_s <= until_s, np.nan, 0.0)
        assert isinstance(fixed, FishFilter)
        self._predict(
            prepared,
            run,
            plan,
            result,
            fixed.gain,
            value=plan.value - _biases(prepared.setup, plan),
            restless=np.array([0.0, 0.0, 0.0, *fixed.correlation_s]),
            lost=lost,
            until=int(np.searchsorted(plan.time_s[plan.order], until_s, side="right")),
        )
        unseen = ~np.isfinite(result)
        if unseen.any():
            result[unseen] = LOST * np.sqrt(fixed.variance[unseen])
        return result

    def responses(
        self, run: Run, values: Values, fixed: Filter, terms: Sequence[str], errors: FloatArray
    ) -> FloatArray:
        """Return the change of innovations by forces and sensors' errors, all in one march.

        Not for tails that bend, beside other forces, or where commands are lost.
        """
        found = by_differences(terms, errors)
        try:
            prepared = self._of(values)
        except InvalidParameterError:
            return found
        setup, plan = prepared.setup, self._plans.of(run)
        if setup.plant.tail.flexible or prepared.forced or setup.dropped > 0.0:
            return found
        assert isinstance(fixed, FishFilter)
        forces = [i for i, name in enumerate(terms) if name in unknown.PLACE_OF]
        axes, places = np.array(
            [unknown.PLACE_OF[terms[i]] for i in forces] or np.empty((0, 2)), dtype=np.int64
        ).T.copy()
        time_s, order = when(setup, plan)
        table = self._drives(prepared, run)
        result = np.full((run.time_s.size, len(forces) + errors.shape[1]), np.nan)
        respond(
            prepared.packed,
            prepared.lens,
            np.array([0.0, 0.0, 0.0, *fixed.correlation_s]),
            table,
            _guessed(prepared, run, plan, table),
            prepared.longest_s,
            time_s,
            plan.kind,
            plan.value - _biases(setup, plan),
            order,
            fixed.gain,
            axes,
            places,
            np.ascontiguousarray(errors),
            moved_by(setup, plan, run.at_rest, errors),
            result,
        )
        found[:, [*forces, *range(len(terms), found.shape[1])]] = result
        return found

    def _losses(self, run: Run, values: Values, fixed: Filter) -> Path:
        """Look for the commands that may be lost, with the causes at about their values."""
        prepared, plan = self._of(dict(_context(values))), self._plans.of(run)

        starts_s = (*run.inputs.programme.starts_s, math.inf)

        def squares(lost: tuple[int, ...], until: int) -> float:
            errors = self._errors(prepared, run, plan, fixed, lost, starts_s[until])
            return float(np.sum(errors * errors / fixed.variance))

        return search(run.inputs.changes, squares)

    def replay(self, run: Run, values: Values, fixed: Filter | None = None) -> FloatArray:
        """Return what the run would have measured without noise or disturbance (n,).

        The start is that which fits the first second best. With a filter, where a share of the
        commands is lost, without those that were likeliest lost.
        """
        plan, prepared = self._plans.of(run), self._of(values)
        start = self._fitted_start(prepared, run, plan)
        lossy = fixed is not None and prepared.setup.dropped > 0.0 and run.inputs.changes > 0
        lost = self._lost(run, values, fixed) if fixed is not None and lossy else ()
        result = np.full(plan.time_s.size, np.nan)
        nothing = np.zeros_like(plan.value)
        self._predict(prepared, run, plan, result, None, start=start, value=nothing, lost=lost)
        return -result + _biases(prepared.setup, plan)

    def signals(self, run: Run, values: Values) -> Mapping[str, FloatArray | IntArray]:
        """Return inputs, the replayed yaw rate and the place at the measurements, and the time."""
        plan, prepared = self._plans.of(run), self._of(values)
        start = self._fitted_start(prepared, run, plan)
        turning = np.full(plan.time_s.size, np.nan)
        gyro = replace(plan, kind=np.full_like(plan.kind, int(Kind.GYRO)))
        nothing = np.zeros_like(plan.value)
        self._predict(prepared, run, gyro, turning, None, start=start, value=nothing)
        assert isinstance(run.inputs, FishInputs)
        return known(run.inputs, plan, -np.nan_to_num(turning), self._drives(prepared, run))

    def draw(self, run: Run, values: Values, noise: Noise, generator: np.random.Generator) -> Run:
        """Return a run with the same times and inputs that this model has performed.

        With disturbance and noise. Where the camera stalls, it does so when the measured one did,
        noise and all. No command is lost, whatever share is: what is drawn is compared with a
        replay that knows of no loss, and a loss is no noise around it.
        """
        plan, prepared = self._plans.of(run), self._of(values)
        table = self._drives(prepared, run)
        last_s = plan.time_s[plan.order[-1]] if plan.order.size else 0.0
        most = math.ceil(last_s * 1.5 / prepared.longest_s)
        steps = most + OF_A_CHANGE * (table.shape[0] + 2)
        shaking = generator.standard_normal((steps, 3))
        result = np.full(plan.time_s.size, np.nan)
        nothing = np.zeros_like(plan.value)
        self._predict(
            prepared,
            run,
            plan,
            result,
            None,
            start=None if run.at_rest else self._fitted_start(prepared, run, plan),
            value=nothing,
            shaking=shaking,
            restless=_restless(noise),
        )
        deviates = generator.standard_normal(result.size)
        if prepared.setup.hold_s > 0.0 and plan.stalls:
            deviates = deviates[_shown(plan, prepared.setup.hold_s)]
        value = -result + _biases(prepared.setup, plan) + noise.sigma[run.channel] * deviates
        angle = np.array([channel.angle for channel in self._channels])[run.channel]
        value[angle] = np.arctan2(np.sin(value[angle]), np.cos(value[angle]))
        return replace(run, value=value, inputs=copy(run.inputs))  # another run, with none lost

    # Its parts

    def _of(self, values: Values) -> Prepared:
        return self._prepared(tuple(sorted((n, float(x)) for n, x in values.items() if x != 0.0)))

    def _drives(self, prepared: Prepared, run: Run, lost: tuple[int, ...] = ()) -> FloatArray:
        setup, inputs = prepared.setup, run.inputs
        assert isinstance(inputs, FishInputs)
        memory_s = setup.plant.hydrodynamics.bias_memory_s
        return drives(inputs, setup.plant.servo, setup.clock_drift, lost, memory_s)

    def _predict(
        self,
        prepared: Prepared,
        run: Run,
        plan: Plan,
        result: FloatArray,
        gain: FloatArray | None,
        *,
        start: FloatArray | None = None,
        value: FloatArray | None = None,
        until: int | None = None,
        shaking: FloatArray = _STILL,
        restless: FloatArray | None = None,
        lost: tuple[int, ...] = (),
    ) -> None:
        """Run the predictor; without gains it is open loop."""
        time_s, order = when(prepared.setup, plan)
        table = self._drives(prepared, run, lost)
        step = predict
        more: tuple[Any, ...] = ()
        if prepared.setup.plant.tail.flexible:
            step, more = self._bending(prepared)
        step(
            prepared.packed,
            prepared.lens,
            _QUIET if restless is None else restless,
            prepared.force,
            prepared.forced,
            table,
            _guessed(prepared, run, plan, table) if start is None else start,
            prepared.longest_s,
            time_s,
            plan.kind,
            plan.value if value is None else value,
            order if until is None else order[:until],
            np.zeros((result.size, ESTIMATED)) if gain is None else gain,
            shaking,
            result,
            *more,
        )

    @staticmethod
    def _bending(prepared: Prepared) -> tuple[Callable[..., int], tuple[Any, ...]]:
        """Return the predictor of a flexible tail and what it needs besides: its own each time.

        Its scratch space is not for two threads at once. Loaded for flexible tails only.
        """
        from plant.flexible.motion import FlexibleMotion
        from tools.diagnosis.fish.bending import predict_bending

        motion = FlexibleMotion(prepared.setup.plant, prepared.longest_s)
        motion = motion.on_grid(prepared.longest_s, _LOOSE)
        return predict_bending, (motion.tables, motion.bend)

    def _fitted_start(self, prepared: Prepared, run: Run, plan: Plan) -> FloatArray:
        """Fit the pose (and velocities, where they are unknown) to a run's first second."""
        time_s, order = when(prepared.setup, plan)
        until = int(np.searchsorted(time_s[order], _START_S, side="right"))
        used = order[:until]
        start = _guessed(prepared, run, plan, self._drives(prepared, run))
        if until == 0:
            return start
        free = 3 if run.at_rest else 6
        little = np.array([1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-3])
        weight = 1.0 / self.first_noise([run]).sigma[run.channel[used]]

        def errors(pose: FloatArray) -> FloatArray:
            result = np.zeros(plan.time_s.size)
            self._predict(prepared, run, plan, result, None, start=pose, until=until)
            return result[used] * weight

        def moved(by: FloatArray) -> FloatArray:
            pose = start + by
            if run.at_rest:
                pose[3:6] = at(prepared.setup, (pose[0], pose[1], pose[2]), True)[3:6]
            return pose

        shift = np.zeros(start.size)
        for _ in range(3):
            base = errors(moved(shift))
            slopes = np.empty((base.size, free))
            for i in range(free):
                one = shift.copy()
                one[i] += little[i]
                slopes[:, i] = (errors(moved(one)) - base) / little[i]
            # the guess itself counts as one measurement, so that what is not seen stays put
            prior = np.diag(1.0 / plan.unsure[:free])
            left = np.vstack((slopes, prior))
            right = np.concatenate((-base, -prior @ shift[:free]))
            shift[:free] += np.linalg.lstsq(left, right, rcond=None)[0]
        return moved(shift)


def _sigmas(run: Run, plan: Plan, noise: Noise) -> FloatArray:
    """Return standard deviations of the measurements (n,) as the filter is to take them.

    While it does not know yet how fast the robot moves, it would take an accelerometer's bias for
    a velocity, and forces go with the square of velocities.
    """
    sigma = np.ascontiguousarray(noise.sigma[run.channel], dtype=np.float64)
    if not run.at_rest:
        early = np.isin(plan.kind, _ACCELEROMETER) & (plan.time_s <= _START_S)
        sigma[early] = np.hypot(sigma[early], ACCEL_BIAS_M_S2)
    return sigma


def _guessed(prepared: Prepared, run: Run, plan: Plan, table: FloatArray) -> FloatArray:
    """Guess the true state (STATE,) at the first row, a servo where its commands brought it."""
    start = guessed(prepared.setup, plan, run.at_rest)
    if table[0, START] < 0.0:
        brought(prepared.packed, table, prepared.longest_s, start)
    return start


def _context(values: Values) -> tuple[tuple[str, float], ...]:
    """Causes beside lost commands, to two digits: which are lost depends on them hardly at all."""
    return tuple(
        sorted(
            (name, float(f"{x:.1e}"))
            for name, x in values.items()
            if x != 0.0 and not name.startswith(_NO_CONTEXT)
        )
    )


def _biases(setup: Setup, plan: Plan) -> FloatArray | float:
    """Return what the accelerometer shows of nothing, for each measurement (n,)."""
    x, y = setup.accel_x_bias_m_s2, setup.accel_y_bias_m_s2
    if x == 0.0 and y == 0.0:
        return 0.0
    along, across = plan.kind == int(Kind.ACCEL_X), plan.kind == int(Kind.ACCEL_Y)
    return np.where(along, x, np.where(across, y, 0.0))


def _shown(plan: Plan, hold_s: float) -> IntArray:
    """Return for each measurement the one whose noise it shows: a stalled camera's an earlier."""
    shown = np.arange(plan.time_s.size)
    for kind in np.unique(plan.kind[plan.camera]):
        rows = np.flatnonzero(plan.kind == kind)
        repeated = (plan.age_s[rows] > 0.0) & (plan.age_s[rows] <= hold_s)
        place = np.maximum.accumulate(np.where(repeated, 0, np.arange(rows.size)))
        shown[rows] = rows[place]
    return shown


def _own(name: str, values: Values) -> dict[str, float]:
    """Values of one cause by their short names."""
    prefix = f"{name}."
    return {key: x for key, x in values.items() if key.startswith(prefix)}


def possible(cause: Cause, plant: PlantParameters) -> Cause:
    """Narrow the bounds of a cause to what this robot can be."""
    if cause.name != "tail_body_coupling":
        return cause
    share = plant.hydrodynamics.body_motion_in_tail
    (parameter,) = cause.parameters
    return replace(cause, parameters=(replace(parameter, least=-share, most=1.0 - share),))


def _restless(noise: Noise) -> FloatArray:
    return np.array([*noise.disturbance, *noise.correlation_s], dtype=np.float64)


_QUIET = np.array(Restless(0.0, 0.0, 0.0, 1.0, 1.0, 1.0))
