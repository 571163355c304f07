"""The robot's body in the emulation: a plant that moves only when somebody looks or acts.

Time is a count of femtoseconds. The grid is k · step from zero, whoever looks when; a sensor's look
is answered from the grid by cubic Hermite interpolation (rates are known at both ends, so the error
is of fourth order, as the integrator's). An input takes effect at the first grid point at or after
its time, 1 ms later at most. So what is seen never depends on who else looked.

Looks are many (500/s) and steps are cheap, so one compiled call runs ahead for a servo frame and
looks read its rows. An input that arrives meanwhile cuts the run short at its grid point; what lay
beyond is computed again with the new input. Between the input and its grid point the old rows hold.

Looks may go back within the interval of the latest look (chips convert at slightly different
moments), not further; an input may not precede what has been looked at.
"""

from array import array
from collections.abc import Callable

import numpy as np

from plant.arrays import FloatArray
from plant.checks import check_number
from plant.divergence import diverged
from plant.elementary import sincos
from plant.errors import InvalidParameterError, LookBackError, PlantError
from plant.integrate import motion_of, take_over
from plant.layout import Column, Drive
from plant.parameters import PlantParameters, Servo
from plant.servo import current_slopes, lag_share
from plant.tail_input import TailBeat, drive_of
from plant.trajectory import Start, Trajectory

FS_PER_S = 10**15
"""Femtoseconds in a second."""

TRUTH_COLUMNS = (
    "time_s",
    "x_m",
    "y_m",
    "heading_rad",
    "u_m_s",
    "v_m_s",
    "r_rad_s",
    "tail_angle_rad",
    "tail_rate_rad_s",
    "hinge_moment_n_m",
    "servo_current_a",
    "accel_x_m_s2",
    "accel_y_m_s2",
)
"""Columns of ``Vehicle.truth``."""

BEND_COLUMN = "tail_tip_m"
"""A further column where the tail bends: how far its tip is from the line of its base, m; where
the angle α of the base is positive."""

_AHEAD = 20  # steps computed at a time: a servo frame at 1 ms
_MOST_AHEAD = 1000  # where a look is far away

_X, _Y, _PSI = int(Column.X), int(Column.Y), int(Column.PSI)
_U, _V, _R = int(Column.U), int(Column.V), int(Column.R)
_ALPHA, _ALPHA_DOT, _ALPHA_DDOT = (
    int(Column.ALPHA),
    int(Column.ALPHA_DOT),
    int(Column.ALPHA_DDOT),
)
_X_DOT, _Y_DOT = int(Column.X_DOT), int(Column.Y_DOT)
_U_DOT, _V_DOT, _R_DOT = int(Column.U_DOT), int(Column.V_DOT), int(Column.R_DOT)
_MOMENT = int(Column.HINGE_MOMENT)
_SERVO_DOT = int(Column.SERVO_DOT)
_LIMIT = Drive._fields.index("speed_limit")


class Vehicle:
    """One robot in the water. Every quantity takes a time in fs and returns SI units.

    ``step_fs``: grid; ``history_fs``: interval of the kept truth, a whole number of steps;
    ``supply_v``: servo supply at the start. A servo that has heard no pulse yet is limp.
    """

    __slots__ = (
        "_ahead",
        "_delay_fs",
        "_drive",
        "_drive_start",
        "_h",
        "_history",
        "_history_steps",
        "_idle_a",
        "_interval",
        "_k0",
        "_kept",
        "_last_input",
        "_latest",
        "_limit",
        "_load_a_n_m",
        "_motion",
        "_n",
        "_pending",
        "_phase",
        "_place",
        "_rest",
        "_row",
        "_rows",
        "_running_a_s",
        "_seen_fs",
        "_sheared",
        "_span",
        "_stall_a",
        "_state",
        "_step",
        "_supplies",
        "_t0",
        "_target",
        "parameters",
    )

    def __init__(
        self,
        parameters: PlantParameters,
        start: Start | None = None,
        *,
        step_fs: int = FS_PER_S // 1000,
        history_fs: int = FS_PER_S // 100,
        supply_v: float = 7.4,
    ) -> None:
        if step_fs <= 0:
            raise InvalidParameterError("step_fs", f"must be positive, got {step_fs}")
        if history_fs <= 0 or history_fs % step_fs:
            raise InvalidParameterError(
                "history_fs", f"must be a whole number of steps of {step_fs} fs, got {history_fs}"
            )
        check_number("supply_v", supply_v, least=0.0)
        self.parameters = parameters
        self._sheared = parameters.water.sheared
        self._step = step_fs
        self._h = step_fs / FS_PER_S
        self._motion = motion_of(parameters, self._h)
        self._history_steps = history_fs // step_fs
        self._history = array("d")
        self._stall_a = parameters.servo.stall_current_a
        self._supplies: list[tuple[int, tuple[float, float, float]]] = []
        """From which row of the history on the servo drew current by which slopes."""
        self._power(0, supply_v)
        self._target: float | None = None
        self._drive = np.zeros(len(Drive._fields))
        self._delay_fs = round(parameters.servo.command_delay_s * FS_PER_S)
        self._phase = 0.0, 0.0, 0
        """Of the command, before its delay: frequency (rad/s), phase, from which grid point."""
        self._last_input = 0  # grid point of the latest input
        self._drive_start = 0
        self._pending: list[tuple[int, Callable[[int], None]]] = []
        # rows one after the other, read as Python floats; and the same memory for compiled code
        self._row = row = self._motion.whole_width
        self._kept = self._motion.width
        self._rows = array("d", bytes(8 * (_MOST_AHEAD + 1) * row))
        self._ahead: FloatArray = np.frombuffer(self._rows, dtype=np.float64).reshape(-1, row)
        # an empty run ahead at the start: its only row carries the state
        self._state = self._motion.state(np.array((start or Start()).state()))
        self._motion.straighten(self._drive, self._state)
        self._motion.place(self._state, self._ahead[0])
        self._k0 = 0  # grid point of the first row
        self._n = 0  # steps in the run ahead
        self._t0 = 0
        self._span = 0
        self._interval = 0  # of the latest look, counted from k0
        self._latest = 0
        # Several instruments look at one instant: what the second need not work out again.
        self._seen_fs = -1
        self._rest = 0  # its time within the interval
        self._place: tuple[float, float] | None = None

    @property
    def servo(self) -> Servo:
        """The servo's data."""
        return self.parameters.servo

    @property
    def truth_columns(self) -> tuple[str, ...]:
        """Names of the columns of ``truth``."""
        return (*TRUTH_COLUMNS, BEND_COLUMN) if self.parameters.tail.flexible else TRUTH_COLUMNS

    # Inputs

    def set_servo_target(self, t_fs: int, angle_rad: float | None) -> None:
        """Give the servo a new target, or release it (None: limp, held by gear friction)."""
        if self.parameters.servo.ideal:
            raise PlantError("an ideal servo takes a tail beat, since its tail needs its rates")
        if angle_rad is not None:
            check_number("servo target", angle_rad, least=-np.pi, most=np.pi)

        def apply(k: int) -> None:
            self._target = angle_rad if self._limit > 0.0 else None
            self._drive_servo(k)

        self._schedule(t_fs, self._delay_fs, apply)

    def set_supply(self, t_fs: int, volts: float) -> None:
        """Change the servo's supply. Too little stops it, and it forgets its target."""
        check_number("supply", volts, least=0.0)

        def apply(k: int) -> None:
            self._power(k, volts)
            if self._limit <= 0.0:
                self._target = None
            if not self.parameters.servo.ideal:
                self._drive_servo(k)

        self._schedule(t_fs, 0, apply)

    def set_tail_beat(self, t_fs: int, beat: TailBeat) -> None:
        """Command an ideal tail; the phase runs on from the beat before.

        A beat that is commanded at time zero counts as going on since ever, as in ``simulate``.
        """
        if not self.parameters.servo.ideal:
            raise PlantError("a real servo takes targets, not beats")
        told = -(-t_fs // self._step)  # grid point of the command; it arrives later by the delay

        def apply(k: int) -> None:
            omega, phase, since = self._phase
            phase += omega * ((told - since) * self._h)
            omega = 2.0 * np.pi * beat.frequency_hz
            self._phase = omega, phase, told
            late_s = k * self._h - told * self._h - self._delay_fs / FS_PER_S
            self._begin(k, beat, phase + omega * late_s, 0.0, told == 0)

        self._schedule(t_fs, self._delay_fs if told else 0, apply)

    def advance(self, t_fs: int) -> None:
        """Move to a time without looking at anything."""
        self._locate(t_fs)

    # Quantities

    def x(self, t_fs: int) -> float:
        """Position of the body centre in the tank, m."""
        return self._hermite(t_fs, _X, _X_DOT)

    def y(self, t_fs: int) -> float:
        """Position of the body centre in the tank, m."""
        return self._hermite(t_fs, _Y, _Y_DOT)

    def position(self, t_fs: int) -> tuple[float, float]:
        """``x`` and ``y`` in one look, m."""
        place = self._place
        if place is None or t_fs != self._seen_fs:
            self._place = place = (
                self._hermite(t_fs, _X, _X_DOT),
                self._hermite(t_fs, _Y, _Y_DOT),
            )
        return place

    def heading(self, t_fs: int) -> float:
        """Heading ψ counter-clockwise from +x, unwrapped, rad."""
        return self._hermite(t_fs, _PSI, _R)

    def u(self, t_fs: int) -> float:
        """Surge velocity through the water, m/s."""
        return self._hermite(t_fs, _U, _U_DOT)

    def v(self, t_fs: int) -> float:
        """Sway velocity through the water, m/s."""
        return self._hermite(t_fs, _V, _V_DOT)

    def r(self, t_fs: int) -> float:
        """Yaw rate, rad/s."""
        return self._hermite(t_fs, _R, _R_DOT)

    def tail_angle(self, t_fs: int) -> float:
        """Angle α of the true tail, rad."""
        return self._hermite(t_fs, _ALPHA, _ALPHA_DOT)

    def tail_rate(self, t_fs: int) -> float:
        """Rate α̇ of the true tail, rad/s."""
        return self._hermite(t_fs, _ALPHA_DOT, _ALPHA_DDOT)

    def ground_velocity_x(self, t_fs: int) -> float:
        """Velocity over the tank's floor along its x axis, m/s (what a GPS measures)."""
        return self._linear(t_fs, _X_DOT)

    def ground_velocity_y(self, t_fs: int) -> float:
        """Velocity over the tank's floor along its y axis, m/s."""
        return self._linear(t_fs, _Y_DOT)

    def hinge_moment(self, t_fs: int) -> float:
        """Moment of the water on the tail joint, N·m."""
        return self._linear(t_fs, _MOMENT)

    def body_acceleration_x(self, t_fs: int) -> float:
        """Proper acceleration u̇ − v r at the body centre along body x, m/s² (without gravity)."""
        part = self._locate(t_fs) / self._step
        rows, a = self._rows, self._interval * self._row
        b = a + self._row
        at_a = rows[a + _U_DOT] - rows[a + _V] * rows[a + _R]
        result = at_a + part * (rows[b + _U_DOT] - rows[b + _V] * rows[b + _R] - at_a)
        return result + self._carried(t_fs)[0] if self._sheared else result

    def body_acceleration_y(self, t_fs: int) -> float:
        """Proper acceleration v̇ + u r at the body centre along body y, m/s² (without gravity)."""
        part = self._locate(t_fs) / self._step
        rows, a = self._rows, self._interval * self._row
        b = a + self._row
        at_a = rows[a + _V_DOT] + rows[a + _U] * rows[a + _R]
        result = at_a + part * (rows[b + _V_DOT] + rows[b + _U] * rows[b + _R] - at_a)
        return result + self._carried(t_fs)[1] if self._sheared else result

    def _carried(self, t_fs: int) -> tuple[float, float]:
        """What a sheared current adds to the acceleration, body axes: G times the velocity."""
        water = self.parameters.water
        sine, cosine = sincos(self.heading(t_fs))
        ax = water.shear_x_per_y_s * self.ground_velocity_y(t_fs)
        ay = water.shear_y_per_x_s * self.ground_velocity_x(t_fs)
        return ax * cosine + ay * sine, ay * cosine - ax * sine

    def servo_current(self, t_fs: int) -> float:
        """Supply current of the servo, A."""
        part = self._locate(t_fs) / self._step
        rows, a = self._rows, self._interval * self._row
        b = a + self._row
        speed, moment = rows[a + _SERVO_DOT], rows[a + _MOMENT]
        return self._current(
            speed + part * (rows[b + _SERVO_DOT] - speed),
            moment + part * (rows[b + _MOMENT] - moment),
        )

    # Truth

    def truth(self, until_fs: int) -> FloatArray:
        """Rows (n, columns of ``truth_columns``) at every history point from 0 to a time."""
        rows = self._past(until_fs)
        every = self._history_steps * self._step
        whole = np.empty((len(rows), len(self.truth_columns)))
        truth = whole[:, : len(TRUTH_COLUMNS)]
        truth[:, 0] = [k * every / FS_PER_S for k in range(len(rows))]
        truth[:, 1 : _ALPHA_DOT + 2] = rows[:, : _ALPHA_DOT + 1]
        truth[:, -4] = moment = rows[:, _MOMENT]
        truth[:, -3] = self._currents(rows[:, _SERVO_DOT], moment)
        u, v, r = rows[:, _U], rows[:, _V], rows[:, _R]
        truth[:, -2] = rows[:, _U_DOT] - v * r
        truth[:, -1] = rows[:, _V_DOT] + u * r
        if self._sheared:
            water = self.parameters.water
            turns = np.array([sincos(psi) for psi in rows[:, _PSI].tolist()])
            sine, cosine = turns[:, 0], turns[:, 1]
            ax, ay = (
                water.shear_x_per_y_s * rows[:, _Y_DOT],
                water.shear_y_per_x_s * rows[:, _X_DOT],
            )
            truth[:, -2] += ax * cosine + ay * sine
            truth[:, -1] += ay * cosine - ax * sine
        if self.parameters.tail.flexible:
            alpha = rows[:, _ALPHA]
            x_m, y_m = self._points(rows)[:, -1].T
            whole[:, -1] = x_m * np.sin(alpha) - y_m * np.cos(alpha)
        return whole

    def tail_points(self, until_fs: int, last: int) -> FloatArray:
        """Points along the tail, joint to tip, (rows, points, 2), body axes from the joint, m.

        At the ``last`` of the history points up to a time. A rigid tail has its two ends.
        """
        rows = self._past(until_fs)
        return self._points(rows[max(0, len(rows) - last) :])

    def _points(self, rows: FloatArray) -> FloatArray:
        from plant.flexible.shape import tail_points

        return tail_points(self.parameters, Trajectory(np.zeros(len(rows)), rows))

    def _past(self, until_fs: int) -> FloatArray:
        """Rows as ``Motion.width`` has them at every history point from 0 to a time."""
        self._locate(until_fs)
        kept = self._history + self._samples(until_fs // self._step + 1)
        return np.frombuffer(kept, dtype=np.float64).reshape(-1, self._kept)

    def _samples(self, end: int) -> "array[float]":
        """Rows of the run ahead at history points below grid point ``end``."""
        every, first = self._history_steps, self._k0
        part = self._ahead[-first % every : max(0, end - first) : every, : self._kept]
        samples = array("d")
        samples.frombytes(part.tobytes())
        return samples

    def _currents(self, speed_rad_s: FloatArray, moment_n_m: FloatArray) -> FloatArray:
        """``servo_current`` at history points, each with the supply that was in force."""
        currents = np.empty(len(speed_rad_s))
        ends = [*(row for row, _ in self._supplies[1:]), len(currents)]
        for (row, (idle, running, load)), end in zip(self._supplies, ends, strict=True):
            part = slice(row, end)
            current = idle + running * abs(speed_rad_s[part]) + load * abs(moment_n_m[part])
            currents[part] = np.minimum(self._stall_a, current)
        return currents

    # The run ahead

    def _locate(self, t_fs: int) -> int:
        """Make the rows around a time current; return the time within its interval, fs."""
        if t_fs == self._seen_fs:
            return self._rest
        offset = t_fs - self._t0
        if offset >= self._span:
            self._move(t_fs)
            offset = t_fs - self._t0
        interval, rest = divmod(offset, self._step)
        if interval != self._interval:
            if interval < self._interval:
                raise LookBackError(
                    f"a look at {t_fs} fs, but the plant has gone on to {self._latest} fs"
                )
            self._interval = interval
        if t_fs > self._latest:
            self._latest = t_fs
        self._seen_fs = t_fs
        self._rest = rest
        self._place = None
        return rest

    def _move(self, t_fs: int) -> None:
        """Compute runs ahead until one holds the time."""
        while t_fs >= self._t0 + self._span:
            k = self._k0 + self._n
            state = self._state
            self._motion.resume(self._ahead[self._n], state)
            samples = self._samples(k)
            pending = self._pending
            while pending and pending[0][0] <= k:
                pending.pop(0)[1](k)
            steps = max(_AHEAD, min(t_fs // self._step + 1 - k, _MOST_AHEAD))
            if pending:
                steps = min(steps, pending[0][0] - k)
            reached = self._motion.march(
                self._drive, self._drive_start, k, k + steps, state, self._ahead, k, 1
            )
            self._history.extend(samples)
            self._k0, self._n = k, reached - k
            self._seen_fs = -1
            self._t0, self._span = k * self._step, (reached - k) * self._step
            self._interval = 0
            # a run ahead may diverge where nobody has looked yet
            if reached != k + steps and t_fs >= self._t0 + self._span:
                raise diverged(
                    self.parameters, self._drive, self._drive_start, reached, self._h, state
                )

    def _schedule(self, t_fs: int, delay_fs: int, apply: Callable[[int], None]) -> None:
        """Have an input take effect at the first grid point at or after a time and a delay."""
        k = -(-t_fs // self._step)
        if k * self._step < self._latest or t_fs < 0:
            raise LookBackError(
                f"an input at {t_fs} fs, but the plant has been looked at up to {self._latest} fs"
            )
        if k < self._last_input:
            raise LookBackError(f"an input at {t_fs} fs after one for a later time")
        self._last_input = k
        if delay_fs:
            k = -(-(k * self._step + delay_fs) // self._step)
        pending = self._pending
        place = len(pending)
        while place and pending[place - 1][0] > k:
            place -= 1
        pending.insert(place, (k, apply))
        self._seen_fs = -1  # the next look may be at what this input changes
        if k < self._k0 + self._n:
            self._n = k - self._k0
            self._span = self._n * self._step

    def _drive_servo(self, k: int) -> None:
        """Hold the present target from grid point ``k`` on."""
        if self._target is None:
            self._drive[_LIMIT] = 0.0
        else:
            self._begin(k, TailBeat(self._target), 0.0, self._limit, False)

    def _begin(self, k: int, beat: TailBeat, phase: float, limit: float, beginning: bool) -> None:
        """Have a beat in force from grid point ``k`` on; it goes on where the one before ended."""
        servo = self.parameters.servo
        before = None if beginning else Drive(*self._drive.tolist())
        new = drive_of(
            beat, phase, k * self._h, servo.command_lag_s, limit, before, lag_share(servo)
        )
        self._drive_start = k
        self._drive[:] = take_over(self.parameters, self._motion, before, new, self._state)

    def _power(self, k: int, volts: float) -> None:
        """Take over what depends on the supply voltage, from grid point ``k`` on."""
        servo = self.parameters.servo
        self._limit = servo.speed_limit_rad_s(volts)
        self._idle_a, self._running_a_s, self._load_a_n_m = slopes = current_slopes(servo, volts)
        self._supplies.append((-(-k // self._history_steps), slopes))

    def _current(self, speed_rad_s: float, moment_n_m: float) -> float:
        """``servo.supply_current_a`` with the slopes at the present supply."""
        current = (
            self._idle_a + self._running_a_s * abs(speed_rad_s) + self._load_a_n_m * abs(moment_n_m)
        )
        return min(self._stall_a, current)

    # Interpolation

    def _hermite(self, t_fs: int, value: int, rate: int) -> float:
        """Cubic through values and rates at both ends of the interval."""
        rest = self._rest if t_fs == self._seen_fs else self._locate(t_fs)
        rows, a = self._rows, self._interval * self._row
        at_a = rows[a + value]
        if rest == 0:
            return at_a
        b = a + self._row
        part = rest / self._step
        slope_a = rows[a + rate] * self._h
        rise = rows[b + value] - at_a
        bend = slope_a + rows[b + rate] * self._h - 2.0 * rise
        return at_a + part * (slope_a + part * (rise - slope_a - bend + part * bend))

    def _linear(self, t_fs: int, value: int) -> float:
        """Straight line between both ends of the interval."""
        rest = self._locate(t_fs)
        width = self._row
        rows, a = self._rows, self._interval * width + value
        at_a = rows[a]
        return at_a + rest / self._step * (rows[a + width] - at_a)
