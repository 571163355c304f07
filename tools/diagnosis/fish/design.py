"""The extended Kalman filter that makes the gains, compiled.

States: x, y, ψ, u, v, r and three coloured disturbances; the servo's own states are taken as known,
since the command is. The transition of the velocities over a step is exp(hJ) to second order, J by
differences of the plant's own rates in the middle of the step; gains need no more. Derivatives with
respect to position and heading are exact in water that is the same everywhere: the motion turns
with the heading. (Walls and shear make them depend on the place a little, which gains need not
know.) Disturbances act as kicks of the velocities, so their columns follow from those of the
velocities.

Measurements are taken one scalar after the other, each with its own noise, so no matrix is
inverted. Steps are those of ``kernel``, and those within a step act on its end.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from plant.compiled import compiled, compiled_apart, fixed_tuple
from plant.layout import DRIVE, PACKED, STATE, Drive, Packed, State
from plant.rigid_tail import rates
from plant.servo import carried_over
from plant.tail_input import sincos
from tools.diagnosis.fish.kernel import (
    SAME_S,
    START,
    Kick,
    by_element,
    corrected,
    fading,
    felt_after,
    first_state,
    in_bounds,
    is_angle,
    kicked,
    observe,
    reached,
    resolved,
    step_to,
    stride,
    wrapped,
)
from tools.diagnosis.fish.records import (
    ESTIMATED,
    INSTRUMENTS,
    RESTLESS,
    Instruments,
    Kind,
    Restless,
)

_LITTLE = 1e-6  # m/s, rad/s, rad, m: differences are taken over it
_X, _Y, _HEADING, _GYRO = int(Kind.X), int(Kind.Y), int(Kind.HEADING), int(Kind.GYRO)
_GPS_X, _GPS_Y = int(Kind.GPS_X), int(Kind.GPS_Y)


@compiled
def halfway(a: State, b: State) -> State:
    """Return the mean of two states."""
    return State(
        0.5 * (a.x + b.x),
        0.5 * (a.y + b.y),
        0.5 * (a.psi + b.psi),
        0.5 * (a.u + b.u),
        0.5 * (a.v + b.v),
        0.5 * (a.r + b.r),
        0.5 * (a.servo + b.servo),
        0.5 * (a.servo_dot + b.servo_dot),
        0.5 * (a.alpha_mean + b.alpha_mean),
        0.5 * (a.loose + b.loose),
        0.5 * (a.loose_dot + b.loose_dot),
    )


@compiled_apart
def transition(
    p: Packed,
    drive: Drive,
    at_s: float,
    h: float,
    s: State,
    plain: State,
    still: tuple[float, float],
    slopes: Any,
    room: Any,
) -> None:
    """Write how a step moves on what differs before it: the first six rows and columns of F.

    ``s``: state after the first kick; ``plain``: a step later; ``still``: by how much the current
    moved the robot. ``room`` (6, 3) is overwritten. The first two columns are those of the unit
    matrix, and stay as they are.
    """
    F, A = slopes, room
    F[0, 2] = -(plain.y - s.y - still[1])
    F[1, 2] = plain.x - s.x - still[0]
    F[2, 2] = 1.0
    # J = ∂(u̇, v̇, ṙ)/∂(u, v, r) in the middle of the step, kept in the first rows of A
    middle = halfway(s, plain)
    at_s += 0.5 * h
    u_dot, v_dot, r_dot = 0.0, 0.0, 0.0
    for j in range(4):
        e = _LITTLE if j > 0 else 0.0
        now = rates(
            p,
            drive,
            at_s,
            kicked(middle, e if j == 1 else 0.0, e if j == 2 else 0.0, e if j == 3 else 0.0),
        )
        if j == 0:
            u_dot, v_dot, r_dot = now.u_dot, now.v_dot, now.r_dot
        else:
            A[0, j - 1] = (now.u_dot - u_dot) / e
            A[1, j - 1] = (now.v_dot - v_dot) / e
            A[2, j - 1] = (now.r_dot - r_dot) / e
    sine, cosine = sincos(middle.psi)
    for j in range(3):
        for i in range(3):
            twice = A[i, 0] * A[0, j] + A[i, 1] * A[1, j] + A[i, 2] * A[2, j]
            unit = 1.0 if i == j else 0.0
            F[3 + i, 3 + j] = unit + h * (A[i, j] + 0.5 * h * twice)
            A[3 + i, j] = h * (unit + 0.5 * h * (A[i, j] + h / 3.0 * twice))
        F[0, 3 + j] = cosine * A[3, j] - sine * A[4, j]
        F[1, 3 + j] = sine * A[3, j] + cosine * A[4, j]
        F[2, 3 + j] = A[5, j]


@compiled_apart
def spread(
    p: Packed,
    drive: Drive,
    at_s: float,
    h: float,
    s: State,
    plain: State,
    left: Kick,
    first: Kick,
    second: Kick,
    still: tuple[float, float],
    covariance: Any,
    slopes: Any,
    room: Any,
) -> None:
    """Carry the covariance over one step (in place).

    ``left``: share of the disturbances that is left; ``first``, ``second``: velocity per
    disturbance of both kicks (s); else as of ``transition``. The noise that drives the disturbances
    is added elsewhere.
    """
    P, F, A = covariance, slopes, room
    transition(p, drive, at_s, h, s, plain, still, F, A)
    for j in range(3):
        for i in range(6):
            F[i, 6 + j] = F[i, 3 + j] * first[j]
        F[3 + j, 6 + j] += second[j]
    # A = F P, then P = A Fᵀ; the last three rows of F are diagonal, the first two columns units
    for j in range(ESTIMATED):
        for i in range(6):
            total = P[i, j] if i < 2 else 0.0
            for k in range(2 if i < 3 else 3, ESTIMATED):
                total += F[i, k] * P[k, j]
            A[i, j] = total
        for i in range(3):
            A[6 + i, j] = left[i] * P[6 + i, j]
    for i in range(ESTIMATED):
        for j in range(i, ESTIMATED):
            if j >= 6:
                total = A[i, j] * left[j - 6]
            else:
                total = A[i, j] if j < 2 else 0.0
                for k in range(2 if j < 3 else 3, ESTIMATED):
                    total += A[i, k] * F[j, k]
            P[i, j] = total
            P[j, i] = total


@compiled
def moved(s: State, i: int, e: float) -> State:
    """Return the state with one of its estimated elements changed."""
    return State(
        s.x + (e if i == 0 else 0.0),
        s.y + (e if i == 1 else 0.0),
        s.psi + (e if i == 2 else 0.0),
        s.u + (e if i == 3 else 0.0),
        s.v + (e if i == 4 else 0.0),
        s.r + (e if i == 5 else 0.0),
        s.servo,
        s.servo_dot,
        s.alpha_mean,
        s.loose,
        s.loose_dot,
    )


@compiled_apart
def sensitivity(
    p: Packed,
    drive: Drive,
    time_s: float,
    s: State,
    push: Kick,
    lens: Instruments,
    kind: int,
    plain: float,
    slope: Any,
) -> None:
    """Write ∂(measurement)/∂(estimated state) into ``slope``."""
    H = slope
    H[:] = 0.0
    if kind == _GYRO:
        H[5] = 1.0 + lens.gyro_scale
        return
    if kind == _HEADING:
        H[2] = 1.0
        return
    if kind in (_X, _GPS_X):
        H[0] = 1.0 + lens.camera_scale if kind == _X else 1.0
        H[1] = -(1.0 + lens.camera_scale) * lens.camera_sin if kind == _X else 0.0
        return
    if kind in (_Y, _GPS_Y):
        H[0] = (1.0 + lens.camera_scale) * lens.camera_sin if kind == _Y else 0.0
        H[1] = 1.0 + lens.camera_scale if kind == _Y else 1.0
        return
    for i in range(2, 6):
        other = observe(p, drive, time_s, moved(s, i, _LITTLE), push, lens, kind)
        H[i] = (other - plain) / _LITTLE
    for i in range(3):
        e1 = _LITTLE if i == 0 else 0.0
        e2 = _LITTLE if i == 1 else 0.0
        other = observe(p, drive, time_s, s, (push[0] + e1, push[1] + e2, push[2]), lens, kind)
        H[6 + i] = (other - plain) / _LITTLE


@compiled_apart
def design(
    packed: Any,
    lens: Any,
    restless: Any,
    drives: Any,
    start: Any,
    unsure: Any,
    longest: float,
    time_s: Any,
    kind: Any,
    value: Any,
    order: Any,
    noise: Any,
    gain: Any,
    variance: Any,
    result: Any,
) -> int:
    """Run the filter along a record; return how many measurements it passed.

    ``unsure`` (6,): standard deviations of the start; ``noise`` (n,): those of the measurements.
    Writes ``gain`` (n, ESTIMATED), ``variance`` (n,) and innovations ``result`` (n,). Arguments
    else as of ``predict``.
    """
    p = Packed(*fixed_tuple(packed, PACKED))
    eye = Instruments(*fixed_tuple(lens, INSTRUMENTS))
    water = Restless(*fixed_tuple(restless, RESTLESS))
    drive = Drive(*fixed_tuple(drives[0], DRIVE))
    s = first_state(p, drive, State(*fixed_tuple(start, STATE)))
    P = np.zeros((ESTIMATED, ESTIMATED))
    F = np.zeros((ESTIMATED, ESTIMATED))
    A = np.zeros((ESTIMATED, ESTIMATED))
    H = np.zeros(ESTIMATED)
    PH = np.zeros(ESTIMATED)
    for i in range(6):
        P[i, i] = unsure[i] * unsure[i]
    P[6, 6] = water.surge * water.surge
    P[7, 7] = water.sway * water.sway
    P[8, 8] = water.yaw * water.yaw
    push = (0.0, 0.0, 0.0)
    nothing = np.zeros((0, 0))
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
        fade = fading(0.5 * h, water)
        at_s = now_s - drive.start
        step = stride(p, drive, at_s, h, s, push, fade, nothing, False)
        left, kick = fade
        spread(
            p,
            drive,
            at_s,
            h,
            step.begin,
            step.end,
            by_element(left, left),
            kick,
            by_element(left, kick),
            (h * p.current_x, h * p.current_y),
            P,
            F,
            A,
        )
        P[6, 6] += water.surge * water.surge * (1.0 - left[0] ** 4)
        P[7, 7] += water.sway * water.sway * (1.0 - left[1] ** 4)
        P[8, 8] += water.yaw * water.yaw * (1.0 - left[2] ** 4)
        push = step.push
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
            after_s = time_s[i] - drive.start
            seen = observe(p, drive, after_s, here, felt, eye, kind[i])
            error = value[i] - seen
            if is_angle(kind[i]):
                error = wrapped(error)
            sensitivity(p, drive, after_s, here, felt, eye, kind[i], seen, H)
            total = noise[i] * noise[i]
            for j in range(ESTIMATED):
                PH[j] = 0.0
                for k in range(ESTIMATED):
                    PH[j] += P[j, k] * H[k]
                total += H[j] * PH[j]
            for j in range(ESTIMATED):
                gain[i, j] = PH[j] / total
            for j in range(ESTIMATED):
                for k in range(ESTIMATED):
                    P[j, k] -= gain[i, j] * PH[k]
                carry[j] += gain[i, j] * error
            variance[i] = total
            result[i] = error
            place += 1
        s = corrected(kicked(step.end, step.late[0], step.late[1], step.late[2]), carry, 1.0)
        push = felt_after(push, carry)
        now_s += h
    return count
