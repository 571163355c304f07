"""Prediction with a flexible tail, compiled: the plant's own implicit steps, looked at between.

An implicit step of fixed length suits a stiff tail, so measurements are not stepped to: they are
predicted within a step by the cubic through states and rates at its ends, and what they correct is
carried along to its end. A step is 16 ms, so a correction is that much late at most. Steps end
where the drive changes. Each step begins a drive of its own with the phase that the beat has there,
so the plant's march may always count from zero.

Everything else is as in ``kernel``: disturbances as kicks, one scalar after the other.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from plant.compiled import compiled_apart, fixed_tuple
from plant.flexible.radau import march_flexible
from plant.layout import DRIVE, PACKED, ROW, STATE, Column, Drive, Packed, State
from plant.pushed import pushes
from plant.servo import carried_over, standing, tail_motion
from plant.tail_input import exp
from tools.diagnosis.fish.kernel import (
    SAME_S,
    START,
    between,
    decay,
    is_angle,
    observe,
    pushed,
    resolved,
    step_to,
    wrapped,
)
from tools.diagnosis.fish.records import INSTRUMENTS, RESTLESS, Instruments, Kind, Restless

_X_DOT, _Y_DOT = int(Column.X_DOT), int(Column.Y_DOT)
_U_DOT, _V_DOT, _R_DOT = int(Column.U_DOT), int(Column.V_DOT), int(Column.R_DOT)
_ALPHA, _ALPHA_DOT = int(Column.ALPHA), int(Column.ALPHA_DOT)
_U, _V, _R = int(Column.U), int(Column.V), int(Column.R)
_ACCEL_X, _ACCEL_Y, _TAIL = int(Kind.ACCEL_X), int(Kind.ACCEL_Y), int(Kind.TAIL)
_ROUNDING = 1e-10  # rad, rad/s: the same beat commanded again is no jump


@compiled_apart
def begun(p: Packed, drive: Drive, after_s: float) -> Drive:
    """Return the drive that begins some time after another one and goes on as it does."""
    t = after_s
    transient = drive.transient
    if p.lag_rate != 0.0 and transient != 0.0:
        transient *= exp(-after_s * p.lag_rate)
    return Drive(
        drive.bias,
        drive.amplitude,
        drive.omega,
        drive.phase + drive.omega * after_s,
        drive.speed_limit,
        drive.start + after_s,
        transient,
        drive.curved,
        drive.offset + t * (drive.slope + t * (drive.bend + t * drive.twist)),
        drive.slope + t * (2.0 * drive.bend + t * 3.0 * drive.twist),
        drive.bend + 3.0 * t * drive.twist,
        drive.twist,
    )


@compiled_apart
def jumped(p: Packed, before: Drive, after: Drive, state: Any, bend: int, modes: int) -> None:
    """Have servo and tail jump where a drive takes over from another (in place)."""
    if p.servo_ideal == 0.0:
        return
    old_s = State(*fixed_tuple(state, STATE))
    old = tail_motion(p, before, after.start - before.start, old_s)
    new_s = carried_over(p, before, after, old_s)
    new = tail_motion(p, after, 0.0, new_s)
    for i, value in enumerate(new_s):
        state[i] = value
    turn, turn_dot = new.alpha - old.alpha, new.alpha_dot - old.alpha_dot
    if modes > 0 or (abs(turn) < _ROUNDING and abs(turn_dot) < _ROUNDING):
        return
    n = STATE + 2 * bend
    for i in range(bend):
        state[STATE + i] += turn
        state[STATE + bend + i] += turn_dot
    state[n:] = 0.0


@compiled_apart
def predict_bending(
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
    tables: Any,
    bend: int,
) -> int:
    """As ``kernel.predict``; ``tables``: those of a ``FlexibleMotion``, ``bend`` coordinates."""
    (
        parts,
        modes,
        active,
        passive,
        scales,
        inverse,
        own,
        matrix,
        stages,
        vectors,
        work,
    ) = tables
    p = Packed(*fixed_tuple(packed, PACKED))
    eye = Instruments(*fixed_tuple(lens, INSTRUMENTS))
    noise = Restless(*fixed_tuple(restless, RESTLESS))
    drive = Drive(*fixed_tuple(drives[0], DRIVE))
    first = State(*fixed_tuple(start, STATE))
    if p.servo_ideal != 0.0:
        first = standing(p, drive, first)
    n = STATE + 2 * bend
    state = np.zeros(4 * n)
    for i, element in enumerate(first):
        state[i] = element
    if modes == 0:
        base = tail_motion(p, drive, 0.0, first)
        for i in range(bend):
            state[STATE + i] = base.alpha
            state[STATE + bend + i] = base.alpha_dot
    rows = np.zeros((2, ROW + 2 * bend))
    told = np.zeros(DRIVE)
    push = np.zeros(3)
    carry = np.zeros(9)
    shaken = shaking.shape[0] > 0
    deviation = (noise.surge, noise.sway, noise.yaw)
    if shaken:
        for i in range(3):
            push[i] = deviation[i] * shaking[0, i]
    taken = 1
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
            jumped(p, before, drive, state, bend, modes)
            continue
        h = step_to(now_s, change_s, resolved(p, drive, now_s, longest))
        left1, kick1 = decay(0.5 * h, noise.surge_s)
        left2, kick2 = decay(0.5 * h, noise.sway_s)
        left3, kick3 = decay(0.5 * h, noise.yaw_s)
        here = begun(p, drive, now_s - drive.start)
        for i, element in enumerate(here):
            told[i] = element
        early = (kick1 * push[0], kick2 * push[1], kick3 * push[2])
        if forced:
            begin = State(*fixed_tuple(state, STATE))
            early = pushed(early, 0.5 * h, pushes(p, here, 0.0, begin, force))
        for i in range(3):
            state[3 + i] += early[i]
        reached = march_flexible(
            packed,
            told,
            0,
            0,
            1,
            h,
            state,
            rows,
            0,
            1,
            parts,
            modes,
            active,
            passive,
            scales,
            inverse,
            own,
            matrix,
            stages,
            vectors,
            work,
        )
        if reached != 1:
            return place
        push[0] *= left1
        push[1] *= left2
        push[2] *= left3
        late = (kick1 * push[0], kick2 * push[1], kick3 * push[2])
        if forced:
            end = begun(p, drive, now_s + h - drive.start)
            after = State(*fixed_tuple(state, STATE))
            late = pushed(late, 0.5 * h, pushes(p, end, 0.0, after, force))
        push[0] *= left1
        push[1] *= left2
        push[2] *= left3
        if shaken:
            push[0] += noise.surge * math.sqrt(1.0 - left1**4) * shaking[taken, 0]
            push[1] += noise.sway * math.sqrt(1.0 - left2**4) * shaking[taken, 1]
            push[2] += noise.yaw * math.sqrt(1.0 - left3**4) * shaking[taken, 2]
            taken += 1
        a, b = rows[0], rows[1]
        while place < count and time_s[order[place]] <= now_s + h + SAME_S:
            i = order[place]
            part = (time_s[i] - now_s) / h
            kick = (
                part * late[0] - (1.0 - part) * early[0] + carry[3],
                part * late[1] - (1.0 - part) * early[1] + carry[4],
                part * late[2] - (1.0 - part) * early[2] + carry[5],
            )
            s = State(
                between(a[0], b[0], a[_X_DOT], b[_X_DOT], part, h) + carry[0],
                between(a[1], b[1], a[_Y_DOT], b[_Y_DOT], part, h) + carry[1],
                between(a[2], b[2], a[5], b[5], part, h) + carry[2],
                between(a[3], b[3], a[_U_DOT], b[_U_DOT], part, h) + kick[0],
                between(a[4], b[4], a[_V_DOT], b[_V_DOT], part, h) + kick[1],
                between(a[5], b[5], a[_R_DOT], b[_R_DOT], part, h) + kick[2],
                0.0,
                0.0,
                0.0,
                0.0,
                0.0,
            )
            if kind[i] == _ACCEL_X:
                at_a = a[_U_DOT] - a[_V] * a[_R]
                at_b = b[_U_DOT] - b[_V] * b[_R]
                seen = at_a + part * (at_b - at_a) + push[0] + carry[6]
            elif kind[i] == _ACCEL_Y:
                at_a = a[_V_DOT] + a[_U] * a[_R]
                at_b = b[_V_DOT] + b[_U] * b[_R]
                seen = at_a + part * (at_b - at_a) + push[1] + carry[7]
            elif kind[i] == _TAIL:
                seen = between(a[_ALPHA], b[_ALPHA], a[_ALPHA_DOT], b[_ALPHA_DOT], part, h)
            else:
                seen = observe(p, here, 0.0, s, (0.0, 0.0, 0.0), eye, kind[i])
            error = value[i] - seen
            if is_angle(kind[i]):
                error = wrapped(error)
            result[i] = error
            for j in range(9):
                carry[j] += gain[i, j] * error
            place += 1
        for i in range(3):
            state[i] += carry[i]
            state[3 + i] += carry[3 + i] + late[i]
            push[i] += carry[6 + i]
        carry[:] = 0.0
        now_s += h
    return count
