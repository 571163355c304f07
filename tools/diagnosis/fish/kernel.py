"""Prediction of measurements with fixed gains, compiled: the plant's own right-hand side.

Steps of ``longest`` of the classical Runge–Kutta method, shorter ones before the drive changes.
Measurements are not stepped to: they are predicted by the cubic through states and rates at a
step's ends, and what they correct is carried along to its end, where the dynamics take it over: a
step late at most, beside times of the motion that are longer than a tenth of a second. Coloured
disturbances are three further states, accelerations of surge, sway and yaw that decay with their
correlation times. They act as kicks of the velocities around each step, half before and half after
it (Strang's splitting, whose error is of second order in the step, and proportional to the
disturbance), so that the right-hand side stays the plant's and a prediction without disturbance is
a run of the plant with these steps.

Unexplained forces act in the same way. A force F makes F/(m_b − X_u̇) and so on: the tail's own
share of the inertia is left out, since such a force is an empirical one anyhow.

A servo that was in motion when a run began stands where the commands before have brought it
(``brought``), however hard the robot shakes at first.

Each measurement is then predicted and the state corrected, one scalar after the other. Gains were
made elsewhere (``design``), so whoever is predicted with them, the errors can be compared.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from plant.compiled import compiled, compiled_apart, fixed_tuple
from plant.integrate import shifted
from plant.layout import DRIVE, PACKED, STATE, Drive, Packed, State
from plant.pushed import pushes
from plant.rigid_tail import rates
from plant.servo import carried_over, standing, tail_motion
from plant.tail_input import exp, sincos
from tools.diagnosis.fish.records import (
    ESTIMATED,
    INSTRUMENTS,
    RESTLESS,
    Instruments,
    Kind,
    Restless,
)

_X, _Y, _HEADING = int(Kind.X), int(Kind.Y), int(Kind.HEADING)
_GYRO, _COMPASS = int(Kind.GYRO), int(Kind.COMPASS)
_ACCEL_X, _ACCEL_Y = int(Kind.ACCEL_X), int(Kind.ACCEL_Y)
_GPS_X, _GPS_Y, _TAIL = int(Kind.GPS_X), int(Kind.GPS_Y), int(Kind.TAIL)

START = Drive._fields.index("start")
LAGS, OF_LAG = 8.0, 0.5
"""So many lags a transient lasts (it is 3e-4 then), in steps of this share of the lag."""
SAME_S = 1e-9
"""Moments that are nearer to each other than this are one."""

_SPEED_BOUND, _RATE_BOUND = 100.0, 1.0e4  # as the plant's integrator
_TWO_PI = 2.0 * math.pi

Kick = tuple[float, float, float]


@compiled
def wrapped(angle: float) -> float:
    """Return an angle's equal in [−π, π)."""
    return angle - _TWO_PI * math.floor((angle + math.pi) / _TWO_PI)


@compiled
def observe(
    p: Packed, drive: Drive, time_s: float, s: State, push: Kick, lens: Instruments, kind: int
) -> float:
    """Predict one measurement. ``push``: the disturbances (m/s², m/s², rad/s²)."""
    if kind == _GYRO:
        return (1.0 + lens.gyro_scale) * s.r + lens.gyro_bias
    if kind == _HEADING:
        return s.psi + lens.camera_rotation
    if kind == _X:
        return (1.0 + lens.camera_scale) * (lens.camera_cos * s.x - lens.camera_sin * s.y)
    if kind == _Y:
        return (1.0 + lens.camera_scale) * (lens.camera_sin * s.x + lens.camera_cos * s.y)
    if kind == _COMPASS:
        error = lens.compass_offset
        if lens.hard_iron != 0.0:
            error += lens.hard_iron * sincos(s.psi - lens.hard_iron_at)[0]
        if lens.soft_iron != 0.0:
            error += lens.soft_iron * sincos(2.0 * s.psi - lens.soft_iron_at)[0]
        return s.psi + error
    if kind == _GPS_X:
        return s.x
    if kind == _GPS_Y:
        return s.y
    return observe_forces(p, drive, time_s, s, push, kind)


@compiled_apart
def observe_forces(
    p: Packed, drive: Drive, time_s: float, s: State, push: Kick, kind: int
) -> float:
    """Predict what depends on the tail: its angle, and accelerations."""
    if kind == _TAIL:
        return tail_motion(p, drive, time_s, s).alpha
    now = rates(p, drive, time_s, s)
    if kind == _ACCEL_X:
        return now.u_dot - s.v * s.r + push[0]
    return now.v_dot + s.u * s.r + push[1]


@compiled
def is_angle(kind: int) -> bool:
    """Whether differences of a kind of measurement are taken modulo 2π."""
    return kind in (_HEADING, _COMPASS)


@compiled
def kicked(s: State, du: float, dv: float, dr: float) -> State:
    """Return the state with other velocities."""
    return State(
        s.x,
        s.y,
        s.psi,
        s.u + du,
        s.v + dv,
        s.r + dr,
        s.servo,
        s.servo_dot,
        s.alpha_mean,
        s.loose,
        s.loose_dot,
    )


@compiled
def pushed(kick: Kick, share_s: float, force: Kick) -> Kick:
    """Return a kick with that of a force for some time."""
    return (
        kick[0] + share_s * force[0],
        kick[1] + share_s * force[1],
        kick[2] + share_s * force[2],
    )


@compiled
def corrected(s: State, gain: Any, error: float) -> State:
    """Return the state after a correction with a row of gains."""
    return State(
        s.x + gain[0] * error,
        s.y + gain[1] * error,
        s.psi + gain[2] * error,
        s.u + gain[3] * error,
        s.v + gain[4] * error,
        s.r + gain[5] * error,
        s.servo,
        s.servo_dot,
        s.alpha_mean,
        s.loose,
        s.loose_dot,
    )


@compiled_apart
def leap(
    p: Packed, drive: Drive, time_s: float, h: float, s: State
) -> tuple[State, tuple[float, ...], tuple[float, ...]]:
    """One step of the classical Runge–Kutta method: where it ends, and the rates at both ends.

    Rates are those of the first six states. The last stage's stand for the end's own: they are off
    by the third power of the step.
    """
    k = rates(p, drive, time_s, s)
    first = (k.x_dot, k.y_dot, k.psi_dot, k.u_dot, k.v_dot, k.r_dot)
    end = shifted(s, h / 6.0, k)
    for stage in range(3):
        part = h if stage == 2 else 0.5 * h
        k = rates(p, drive, time_s + part, shifted(s, part, k))
        end = shifted(end, h / 6.0 if stage == 2 else h / 3.0, k)
    return end, first, (k.x_dot, k.y_dot, k.psi_dot, k.u_dot, k.v_dot, k.r_dot)


@compiled
def between(a: float, b: float, slope_a: float, slope_b: float, part: float, h: float) -> float:
    """Return the cubic through values and slopes at both ends of a step, at a part of it."""
    rise = b - a
    bend = h * (slope_a + slope_b) - 2.0 * rise
    return a + part * (h * slope_a + part * (rise - h * slope_a - bend + part * bend))


@compiled
def straight(a: float, b: float, part: float) -> float:
    """Return the line through values at both ends of a step, at a part of it."""
    return a + part * (b - a)


@compiled
def felt_after(push: Kick, carry: Any) -> Kick:
    """Return the disturbances after what was corrected."""
    return push[0] + carry[6], push[1] + carry[7], push[2] + carry[8]


@compiled
def resolved(p: Packed, drive: Drive, now_s: float, longest: float) -> float:
    """Return how long a step may be: short beside a lag while its transient lasts."""
    if p.lag_rate == 0.0 or drive.transient == 0.0:
        return longest
    if (now_s - drive.start) * p.lag_rate > LAGS:
        return longest
    return min(longest, OF_LAG / p.lag_rate)


@compiled
def step_to(now_s: float, change_s: float, longest: float) -> float:
    """Return the length of the next step: whole steps, and two equal ones before a change."""
    left_s = change_s - now_s
    if left_s > 2.0 * longest - SAME_S:
        return longest
    return left_s if left_s <= longest + SAME_S else 0.5 * left_s


@compiled
def decay(h: float, correlation_s: float) -> tuple[float, float]:
    """Share of a disturbance that is left after a time, and its integral meanwhile (s).

    A step is short beside the correlation time, and then seven terms of the series are exact.
    """
    x = h / correlation_s
    if x < 0.03:
        fast = 1.0 / 24.0 - x * (1.0 / 120.0 - x * (1.0 / 720.0 - x / 5040.0))
        lost = x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x * fast)))
    else:
        lost = 1.0 - exp(-x)
    return 1.0 - lost, correlation_s * lost


class Fading(NamedTuple):
    """What a half step leaves of the disturbances, and how it kicks the velocities (s)."""

    left: Kick
    kick: Kick


@compiled
def fading(half_s: float, noise: Restless) -> Fading:
    """Work out how disturbances fade in half a step."""
    left1, kick1 = decay(half_s, noise.surge_s)
    left2, kick2 = decay(half_s, noise.sway_s)
    left3, kick3 = decay(half_s, noise.yaw_s)
    return Fading((left1, left2, left3), (kick1, kick2, kick3))


@compiled
def by_element(a: Kick, b: Kick) -> Kick:
    """Return the products of the elements of two kicks."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


class Stride(NamedTuple):
    """A step: from after the first kick to before the last, and what surrounds it."""

    begin: State
    end: State
    slopes_a: tuple[float, ...]
    slopes_b: tuple[float, ...]
    early: Kick
    late: Kick
    push: Kick


@compiled
def stride(
    p: Packed,
    drive: Drive,
    at_s: float,
    h: float,
    s: State,
    push: Kick,
    fade: Fading,
    force: Any,
    forced: bool,
) -> Stride:
    """Make a step from ``s`` with the disturbances ``push``; it returns those at its end."""
    early = by_element(fade.kick, push)
    if forced:
        early = pushed(early, 0.5 * h, pushes(p, drive, at_s, s, force))
    begin = kicked(s, early[0], early[1], early[2])
    end, slopes_a, slopes_b = leap(p, drive, at_s, h, begin)
    push = by_element(push, fade.left)
    late = by_element(fade.kick, push)
    if forced:
        late = pushed(late, 0.5 * h, pushes(p, drive, at_s + h, end, force))
    push = by_element(push, fade.left)
    return Stride(begin, end, slopes_a, slopes_b, early, late, push)


@compiled_apart
def reached(step: Stride, part: float, h: float, carry: Any) -> State:
    """Return the state at a part of a step, with what was corrected since its beginning.

    The first kick is in both ends of the step already, the last one in neither.
    """
    a, b, slopes_a, slopes_b, early, late, _ = step
    rest = 1.0 - part
    return State(
        between(a.x, b.x, slopes_a[0], slopes_b[0], part, h) + carry[0],
        between(a.y, b.y, slopes_a[1], slopes_b[1], part, h) + carry[1],
        between(a.psi, b.psi, slopes_a[2], slopes_b[2], part, h) + carry[2],
        between(a.u, b.u, slopes_a[3], slopes_b[3], part, h)
        + (part * late[0] - rest * early[0] + carry[3]),
        between(a.v, b.v, slopes_a[4], slopes_b[4], part, h)
        + (part * late[1] - rest * early[1] + carry[4]),
        between(a.r, b.r, slopes_a[5], slopes_b[5], part, h)
        + (part * late[2] - rest * early[2] + carry[5]),
        straight(a.servo, b.servo, part),
        straight(a.servo_dot, b.servo_dot, part),
        straight(a.alpha_mean, b.alpha_mean, part),
        straight(a.loose, b.loose, part),
        straight(a.loose_dot, b.loose_dot, part),
    )


@compiled
def in_bounds(s: State) -> bool:
    """Whether a state is one that a robot may have; written so that a NaN is not."""
    return (
        abs(s.u) < _SPEED_BOUND
        and abs(s.v) < _SPEED_BOUND
        and abs(s.r) < _RATE_BOUND
        and abs(s.servo_dot) < _RATE_BOUND
        and abs(s.loose_dot) < _RATE_BOUND
    )


@compiled_apart
def first_state(p: Packed, drive: Drive, s: State) -> State:
    """Return the start, with an ideal servo where it is told to be."""
    if p.servo_ideal == 0.0:
        return s
    return standing(p, drive, s)


@compiled_apart
def brought(packed: Any, drives: Any, longest: float, start: Any) -> None:
    """Bring a servo (in ``start``, in place) from the first of ``drives`` to time zero.

    The body stays where it is: what it does hardly moves a servo.
    """
    p = Packed(*fixed_tuple(packed, PACKED))
    drive = Drive(*fixed_tuple(drives[0], DRIVE))
    s = State(*fixed_tuple(start, STATE))
    now_s = drive.start
    current = 0
    while now_s < -SAME_S:
        change_s = drives[current + 1, START] if current + 1 < drives.shape[0] else 0.0
        if change_s <= now_s + SAME_S:
            current += 1
            drive = Drive(*fixed_tuple(drives[current], DRIVE))
            continue
        h = step_to(now_s, min(change_s, 0.0), longest)
        end = leap(p, drive, now_s - drive.start, h, s)[0]
        s = State(
            s.x,
            s.y,
            s.psi,
            s.u,
            s.v,
            s.r,
            end.servo,
            end.servo_dot,
            end.alpha_mean,
            end.loose,
            end.loose_dot,
        )
        now_s += h
    for i, element in enumerate(s):
        start[i] = element


@compiled_apart
def predict(
    packed: Any,
    lens: Any,
    restless: Any,
    force: Any,
    forced: bool,
    drives: Any,
    start: Any,
    longest: float,
    time_s: Any,
    kind: Any,
    value: Any,
    order: Any,
    gain: Any,
    shaking: Any,
    result: Any,
) -> int:
    """Write measured minus predicted into ``result`` (n,); return how many could be predicted.

    ``packed``, ``lens``, ``restless``, ``start``, rows of ``drives``: records as vectors.
    ``time_s``, ``kind``, ``value`` (n,), ``gain`` (n, ESTIMATED) and ``result`` stand in the order
    of the record; ``order`` (n,) sorts them by time. ``force`` (axes, terms) acts where ``forced``.
    ``shaking`` (m, 3): normal deviates that shake the water, one row for the beginning and one a
    step; none (0, 3) leaves it still.
    """
    p = Packed(*fixed_tuple(packed, PACKED))
    eye = Instruments(*fixed_tuple(lens, INSTRUMENTS))
    noise = Restless(*fixed_tuple(restless, RESTLESS))
    drive = Drive(*fixed_tuple(drives[0], DRIVE))
    s = first_state(p, drive, State(*fixed_tuple(start, STATE)))
    shaken = shaking.shape[0] > 0
    push = (
        noise.surge * shaking[0, 0] if shaken else 0.0,
        noise.sway * shaking[0, 1] if shaken else 0.0,
        noise.yaw * shaking[0, 2] if shaken else 0.0,
    )
    taken = 1
    last_h = 0.0
    fade = fading(0.0, noise)
    carry = np.zeros(ESTIMATED)
    now_s = 0.0
    current = 0
    changes = drives.shape[0]
    place = 0
    count = len(order)
    while place < count:
        change_s = drives[current + 1, START] if current + 1 < changes else math.inf
        if change_s <= now_s + SAME_S:
            before = drive
            current += 1
            drive = Drive(*fixed_tuple(drives[current], DRIVE))
            s = carried_over(p, before, drive, s)
            continue
        h = step_to(now_s, change_s, resolved(p, drive, now_s, longest))
        if h != last_h:
            last_h = h
            fade = fading(0.5 * h, noise)
        step = stride(p, drive, now_s - drive.start, h, s, push, fade, force, forced)
        push = step.push
        if shaken:
            left = fade.left
            push = (
                push[0] + noise.surge * math.sqrt(1.0 - left[0] ** 4) * shaking[taken, 0],
                push[1] + noise.sway * math.sqrt(1.0 - left[1] ** 4) * shaking[taken, 1],
                push[2] + noise.yaw * math.sqrt(1.0 - left[2] ** 4) * shaking[taken, 2],
            )
            taken += 1
        if not in_bounds(step.end):
            return place
        carry[:] = 0.0
        while place < count:
            i = order[place]
            if time_s[i] > now_s + h + SAME_S:
                break
            part = (time_s[i] - now_s) / h
            here = reached(step, part, h, carry)
            felt = felt_after(push, carry)
            error = value[i] - observe(p, drive, time_s[i] - drive.start, here, felt, eye, kind[i])
            if is_angle(kind[i]):
                error = wrapped(error)
            result[i] = error
            for j in range(ESTIMATED):
                carry[j] += gain[i, j] * error
            place += 1
        s = corrected(kicked(step.end, step.late[0], step.late[1], step.late[2]), carry, 1.0)
        push = felt_after(push, carry)
        now_s += h
    return count
