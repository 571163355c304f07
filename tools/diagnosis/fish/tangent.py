"""How the predictor answers to small forces and small errors of sensors, compiled.

Both act additively, so all of them are carried along one march, as columns of a matrix: over a
step by the filter's own transition (``design``), at a measurement by its sensitivity and the fixed
gains. A column costs a twentieth of a prediction of its own. The transition is that of a rigid
tail, of second order in the step, and what lies within a step is taken as straight: against small
differences of predictions columns are off by some thousandths.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from plant.compiled import compiled_apart, fixed_tuple
from plant.layout import DRIVE, PACKED, STATE, Drive, Packed, State
from plant.pushed import library
from plant.servo import carried_over
from plant.tail_input import sincos
from tools.diagnosis.fish.design import sensitivity, transition
from tools.diagnosis.fish.kernel import (
    SAME_S,
    START,
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
    Restless,
)


@compiled_apart
def push_by_term(
    p: Packed, drive: Drive, time_s: float, s: State, axis: Any, term: Any, pushes: Any
) -> None:
    """Write the accelerations (3, terms) by a unit of each term along its axis."""
    terms = library(p, drive, time_s, s)
    sine, cosine = sincos(s.psi)
    for j in range(len(axis)):
        size = terms[term[j]]
        surge = sway = yaw = 0.0
        if axis[j] == 0:
            surge = size
        elif axis[j] == 1:
            sway = size
        elif axis[j] == 2:
            yaw = size
        elif axis[j] == 3:
            surge, sway = cosine * size, -sine * size
        else:
            surge, sway = sine * size, cosine * size
        pushes[0, j] = surge / p.m1
        pushes[1, j] = sway / p.m2
        pushes[2, j] = yaw / p.j3


@compiled_apart
def respond(
    packed: Any,
    lens: Any,
    restless: Any,
    drives: Any,
    start: Any,
    longest: float,
    time_s: Any,
    kind: Any,
    value: Any,
    order: Any,
    gain: Any,
    axis: Any,
    term: Any,
    errors: Any,
    moved: Any,
    result: Any,
) -> int:
    """Write the change of innovations (n, terms + k) by each term and each error of a sensor.

    ``axis``, ``term`` (terms,): places in ``extra_force``; ``errors`` (n, k): what is taken from
    the readings, and ``moved`` (6, k) by how much that moves the guess of the start. Other
    arguments and what is returned as of ``kernel.predict``.
    """
    p = Packed(*fixed_tuple(packed, PACKED))
    eye = Instruments(*fixed_tuple(lens, INSTRUMENTS))
    noise = Restless(*fixed_tuple(restless, RESTLESS))
    drive = Drive(*fixed_tuple(drives[0], DRIVE))
    s = first_state(p, drive, State(*fixed_tuple(start, STATE)))
    push = (0.0, 0.0, 0.0)
    nothing = np.zeros((0, 0))
    forces, width = len(axis), result.shape[1]
    D = np.zeros((ESTIMATED, width))  # of the state
    D[:6, forces:] = moved
    B = np.zeros((6, width))  # of the step's beginning
    E = np.zeros((6, width))  # of its end
    K = np.zeros((6, width))  # of both kicks
    C = np.zeros((ESTIMATED, width))  # of what is carried to the end
    G = np.zeros((3, forces))
    F = np.zeros((6, 6))
    A = np.zeros((6, 3))
    H = np.zeros(ESTIMATED)
    e = np.zeros(width)
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
        fade = fading(0.5 * h, noise)
        at_s = now_s - drive.start
        step = stride(p, drive, at_s, h, s, push, fade, nothing, False)
        push = step.push
        if not in_bounds(step.end):
            return place
        still = (h * p.current_x, h * p.current_y)
        transition(p, drive, at_s, h, step.begin, step.end, still, F, A)
        push_by_term(p, drive, at_s, s, axis, term, G)
        for i in range(3):
            left, kick = fade.left[i], fade.kick[i]
            for j in range(width):
                B[i, j] = D[i, j]
                K[i, j] = kick * D[6 + i, j] + (0.5 * h * G[i, j] if j < forces else 0.0)
                B[3 + i, j] = D[3 + i, j] + K[i, j]
                D[6 + i, j] *= left
        push_by_term(p, drive, at_s + h, step.end, axis, term, G)
        for i in range(3):
            left, kick = fade.left[i], fade.kick[i]
            for j in range(width):
                K[3 + i, j] = kick * D[6 + i, j] + (0.5 * h * G[i, j] if j < forces else 0.0)
                D[6 + i, j] *= left
        for i in range(6):
            f2, f3, f4, f5 = F[i, 2], F[i, 3], F[i, 4], F[i, 5]
            if i < 3:
                if i == 2:
                    f2 = 0.0
                for j in range(width):
                    E[i, j] = B[i, j] + f2 * B[2, j] + f3 * B[3, j] + f4 * B[4, j] + f5 * B[5, j]
            else:
                for j in range(width):
                    E[i, j] = f3 * B[3, j] + f4 * B[4, j] + f5 * B[5, j]
        carry[:] = 0.0
        C[:] = 0.0
        while place < count:
            i = order[place]
            if time_s[i] > now_s + h + SAME_S:
                break
            part = (time_s[i] - now_s) / h
            rest = 1.0 - part
            here = reached(step, part, h, carry)
            felt = felt_after(push, carry)
            after_s = time_s[i] - drive.start
            seen = observe(p, drive, after_s, here, felt, eye, kind[i])
            error = value[i] - seen
            if is_angle(kind[i]):
                error = wrapped(error)
            sensitivity(p, drive, after_s, here, felt, eye, kind[i], seen, H)
            e[:] = 0.0
            for j in range(forces, width):
                e[j] = -errors[i, j - forces]
            for k in range(6):
                if H[k] != 0.0:
                    early = rest if k >= 3 else 0.0
                    late = part if k >= 3 else 0.0
                    m = max(k - 3, 0)
                    for j in range(width):
                        e[j] -= H[k] * (
                            rest * B[k, j]
                            + part * E[k, j]
                            + late * K[3 + m, j]
                            - early * K[m, j]
                            + C[k, j]
                        )
            for k in range(6, ESTIMATED):
                if H[k] != 0.0:
                    for j in range(width):
                        e[j] -= H[k] * (D[k, j] + C[k, j])
            for j in range(width):
                result[i, j] = e[j]
            for k in range(ESTIMATED):
                g = gain[i, k]
                carry[k] += g * error
                for j in range(width):
                    C[k, j] += g * e[j]
            place += 1
        s = corrected(kicked(step.end, step.late[0], step.late[1], step.late[2]), carry, 1.0)
        push = felt_after(push, carry)
        for i in range(3):
            for j in range(width):
                D[i, j] = E[i, j] + C[i, j]
                D[3 + i, j] = E[3 + i, j] + K[3 + i, j] + C[3 + i, j]
                D[6 + i, j] += C[6 + i, j]
        now_s += h
    return count
