"""When a measurement truly came about, and where a run truly began, under a setup."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from plant.layout import State
from plant.trajectory import Start
from tools.diagnosis.fish.plan import Plan, first_motion, first_pose
from tools.diagnosis.fish.records import Kind
from tools.diagnosis.fish.setup import Setup
from tools.diagnosis.model import FloatArray, IntArray

LITTLE = 1e-4
"""m, rad: by how much readings are changed to see how a guess follows them."""
_COMPASS, _ACCEL = int(Kind.COMPASS), (int(Kind.ACCEL_X), int(Kind.ACCEL_Y))
_SERVO, _MEAN, _LOOSE = (State._fields.index(n) for n in ("servo", "alpha_mean", "loose"))
_SURGE, _SWAY, _TURNING = (State._fields.index(n) for n in ("u", "v", "r"))


def when(setup: Setup, plan: Plan) -> tuple[FloatArray, IntArray]:
    """Return true times (n,) of what was measured, and the order of these times.

    A stalled camera shows what it saw when the frame was new, ``hold_s`` ago at most.
    """
    time_s = plan.time_s
    if setup.clock_drift != 0.0:
        time_s = time_s / (1.0 + setup.clock_drift)
    if setup.command_late_s != 0.0:
        time_s = np.maximum(time_s - setup.command_late_s, 0.0)
    old = setup.accel_late_s != 0.0 or setup.compass_late_s != 0.0
    if setup.camera_delay_s == 0.0 and (setup.hold_s == 0.0 or not plan.stalls) and not old:
        return time_s, plan.order
    late_s = np.where(plan.camera, setup.camera_delay_s, 0.0)
    if old:
        late_s += np.where(plan.kind == _COMPASS, setup.compass_late_s, 0.0)
        late_s += np.where(np.isin(plan.kind, _ACCEL), setup.accel_late_s, 0.0)
    if setup.hold_s != 0.0:
        held_s = np.minimum(plan.age_s / (1.0 + setup.clock_drift), setup.hold_s)
        late_s += np.where(plan.camera, held_s, 0.0)
    true_s = np.maximum(time_s - late_s, 0.0)
    return true_s, np.argsort(true_s, kind="stable")


def guessed(setup: Setup, plan: Plan, at_rest: bool) -> FloatArray:
    """Return the first guess of the true state (STATE,) at the first row."""
    x, y, heading = plan.pose
    turn, scale = setup.camera_rotation_rad, 1.0 + setup.camera_scale
    if plan.seen[0]:
        cosine, sine = math.cos(turn) / scale, math.sin(turn) / scale
        x, y = cosine * x + sine * y, cosine * y - sine * x
    if plan.seen[1]:
        heading -= turn
    state = at(setup, (x, y, heading), at_rest, plan.tail)
    if not at_rest:
        state[[_SURGE, _SWAY, _TURNING]] = _moving(setup, plan, (x, y, heading))
    return state


def _moving(
    setup: Setup, plan: Plan, pose: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return (u, v, r) through the water as guessed, none where the camera sees no motion."""
    x_dot, y_dot, rate = plan.motion
    if x_dot == 0.0 and y_dot == 0.0:
        return 0.0, 0.0, rate
    if plan.seen[0]:
        turn, scale = setup.camera_rotation_rad, 1.0 + setup.camera_scale
        cosine, sine = math.cos(turn) / scale, math.sin(turn) / scale
        x_dot, y_dot = cosine * x_dot + sine * y_dot, cosine * y_dot - sine * x_dot
    flow = setup.plant.water.current_m_s(pose[0], pose[1])
    x_dot, y_dot = x_dot - flow[0], y_dot - flow[1]
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    return cosine * x_dot + sine * y_dot, cosine * y_dot - sine * x_dot, rate


def moved_by(setup: Setup, plan: Plan, at_rest: bool, errors: FloatArray) -> FloatArray:
    """Return by how much errors (n, k), taken from the readings, move the guessed start (6, k)."""
    found = np.zeros((6, errors.shape[1]))
    here = guessed(setup, plan, at_rest)[:6]
    for column, error in enumerate(errors.T):
        step = LITTLE / max(float(np.max(np.abs(error), initial=0.0)), 1e-300)
        read = plan.time_s, plan.kind, plan.value - step * error
        motion = plan.motion if at_rest else first_motion(*read)
        other = replace(plan, pose=first_pose(*read)[0], motion=motion)
        there = guessed(setup, other, at_rest)[:6]
        found[:, column] = (there - here) / step
    return found


def at(
    setup: Setup,
    pose: tuple[float, float, float],
    at_rest: bool,
    tail: tuple[float, float] = (0.0, 0.0),
) -> FloatArray:
    """Return the state (STATE,) at a pose: at rest in the tank, or with the water.

    ``tail``: angle of a servo, and the mean that it had before.
    """
    x, y, heading = pose
    if at_rest:
        start = Start.at_rest(setup.plant.water, float(x), float(y), float(heading))
    else:
        start = Start(float(x), float(y), float(heading))
    state = np.array(start.state(), dtype=np.float64)
    state[[_SERVO, _LOOSE]], state[_MEAN] = tail
    return state
