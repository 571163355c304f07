"""The loops of an `OdeModel`, around its two functions: predict, design a filter, perform.

They are ordinary Python over small arrays, and compiled by Numba together with the user's
functions. Where Numba cannot compile those, the very same loops run uncompiled.

The vector z holds the states and, after them, the disturbances d, which decay with their
correlation times and add to the rates of the states that they disturb.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np

from tools.diagnosis.model import IntArray


@dataclass(frozen=True, slots=True)
class Kernels:
    """The compiled loops; arguments as in `OdeModel`."""

    predict: Callable[..., Any]
    design: Callable[..., Any]
    perform: Callable[..., Any]


def build(
    rates: Callable[..., Any], outputs: Callable[..., Any], states: int, where: IntArray
) -> Kernels:
    """Return the loops around ``rates`` and ``outputs``, compiled if Numba can.

    ``where`` (disturbances,) says which state each disturbance acts on.
    """
    compile_ = numba.njit(nogil=True, error_model="numpy")
    compiled = _loops(compile_(rates), compile_(outputs), states, where, compile_)
    plain = _loops(rates, outputs, states, where, lambda function: function)

    def choose(fast: Callable[..., Any], slow: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            try:
                return fast(*arguments)
            except numba.core.errors.NumbaError:
                return slow(*arguments)

        return call

    return Kernels(
        choose(compiled.predict, plain.predict),
        choose(compiled.design, plain.design),
        choose(compiled.perform, plain.perform),
    )


def _loops(
    rates: Callable[..., Any],
    outputs: Callable[..., Any],
    states: int,
    where: IntArray,
    compile_: Callable[[Callable[..., Any]], Callable[..., Any]],
) -> Kernels:
    """Return the loops with these functions inside; nested, so that Numba can specialise them."""
    disturbances = int(where.size)
    size = states + disturbances

    @compile_
    def derivative(t, z, u, p, library, tau, out):  # type: ignore[no-untyped-def]
        rate = rates(t, z[:states], u, p)
        for i in range(states):
            out[i] = rate[i]
        for j in range(disturbances):
            i = where[j]
            out[i] += z[states + j] + library[j, 0]
            for k in range(states):
                x = z[k]
                out[i] += library[j, 1 + k] * x + library[j, 1 + states + k] * x * abs(x)
            for k in range(u.size):
                out[i] += library[j, 1 + 2 * states + k] * u[k]
            out[states + j] = -z[states + j] / tau[j]

    @compile_
    def step(t, z, u, p, library, tau, h, work):  # type: ignore[no-untyped-def]
        """Advance z by h in place: Runge-Kutta of fourth order; ``work`` (5, size) is scratch."""
        derivative(t, z, u, p, library, tau, work[0])
        for i in range(size):
            work[4, i] = z[i] + 0.5 * h * work[0, i]
        derivative(t + 0.5 * h, work[4], u, p, library, tau, work[1])
        for i in range(size):
            work[4, i] = z[i] + 0.5 * h * work[1, i]
        derivative(t + 0.5 * h, work[4], u, p, library, tau, work[2])
        for i in range(size):
            work[4, i] = z[i] + h * work[2, i]
        derivative(t + h, work[4], u, p, library, tau, work[3])
        for i in range(size):
            z[i] += h / 6.0 * (work[0, i] + 2.0 * work[1, i] + 2.0 * work[2, i] + work[3, i])

    @compile_
    def held(t, row, in_time):  # type: ignore[no-untyped-def]
        """Return the last row of the inputs that has begun at t."""
        while row + 1 < in_time.size and in_time[row + 1] <= t + 1e-9:
            row += 1
        return row

    @compile_
    def predict(  # type: ignore[no-untyped-def]
        time, channel, value, angle, in_time, in_value, start, p, library, gain, tau, longest
    ):
        n = time.size
        innovation = np.zeros(n)
        predicted = np.zeros(n)
        known = np.zeros((n, states))
        z = np.zeros(size)
        z[:states] = start
        work = np.zeros((5, size))
        row = 0
        t = time[0]
        for k in range(n):
            gap = time[k] - t
            steps = max(math.ceil(gap / longest), 1)
            h = gap / steps
            for s in range(steps):
                row = held(t + s * h, row, in_time)
                if h > 0.0:
                    step(t + s * h, z, in_value[row], p, library, tau, h, work)
            t = time[k]
            row = held(t, row, in_time)
            y = outputs(t, z[:states], in_value[row], p)[channel[k]]
            e = value[k] - y
            if angle[channel[k]] > 0.0:
                e = (e + math.pi) % math.tau - math.pi
            predicted[k] = y
            innovation[k] = e
            for i in range(states):
                known[k, i] = z[i]
            for i in range(size):
                z[i] += gain[k, i] * e
        return innovation, predicted, known

    @compile_
    def design(  # type: ignore[no-untyped-def]
        time, channel, value, angle, in_time, in_value, start, p, library, sigma, sd, tau, longest
    ):
        n = time.size
        gain = np.zeros((n, size))
        variance = np.zeros(n)
        z = np.zeros(size)
        z[:states] = start
        covariance = np.zeros((size, size))
        for j in range(disturbances):
            covariance[states + j, states + j] = sd[j] ** 2
        work = np.zeros((5, size))
        moved = np.zeros((size, size))
        base = np.zeros(size)
        slope = np.zeros(size)
        row = 0
        t = time[0]
        for k in range(n):
            gap = time[k] - t
            steps = max(math.ceil(gap / longest), 1)
            h = gap / steps
            for s in range(steps):
                row = held(t + s * h, row, in_time)
                if h <= 0.0:
                    continue
                at = t + s * h
                base[:] = z
                step(at, z, in_value[row], p, library, tau, h, work)
                for i in range(size):
                    small = 1e-6 * max(abs(base[i]), 1e-3)
                    moved[i, :] = base
                    moved[i, i] += small
                    step(at, moved[i], in_value[row], p, library, tau, h, work)
                    for m in range(size):
                        moved[i, m] = (moved[i, m] - z[m]) / small
                covariance = moved.T @ covariance @ moved
                for j in range(disturbances):
                    decay = math.exp(-2.0 * h / tau[j])
                    covariance[states + j, states + j] += sd[j] ** 2 * (1.0 - decay)
            t = time[k]
            row = held(t, row, in_time)
            c = channel[k]
            y = outputs(t, z[:states], in_value[row], p)[c]
            slope[:] = 0.0
            for i in range(states):
                small = 1e-6 * max(abs(z[i]), 1e-3)
                before = z[i]
                z[i] = before + small
                slope[i] = (outputs(t, z[:states], in_value[row], p)[c] - y) / small
                z[i] = before
            cross = covariance @ slope
            variance[k] = slope @ cross + sigma[c] ** 2
            e = value[k] - y
            if angle[c] > 0.0:
                e = (e + math.pi) % math.tau - math.pi
            for i in range(size):
                gain[k, i] = cross[i] / variance[k]
                z[i] += gain[k, i] * e
            for i in range(size):
                for m in range(size):
                    covariance[i, m] -= gain[k, i] * cross[m]
            covariance = 0.5 * (covariance + covariance.T)
        return gain, variance

    @compile_
    def perform(  # type: ignore[no-untyped-def]
        time, channel, in_time, in_value, start, p, library, first, shocks, sd, tau, longest
    ):
        n = time.size
        predicted = np.zeros(n)
        z = np.zeros(size)
        z[:states] = start
        z[states:] = first
        work = np.zeros((5, size))
        row = 0
        used = 0
        t = time[0]
        for k in range(n):
            gap = time[k] - t
            steps = max(math.ceil(gap / longest), 1)
            h = gap / steps
            for s in range(steps):
                row = held(t + s * h, row, in_time)
                if h > 0.0:
                    step(t + s * h, z, in_value[row], p, library, tau, h, work)
                    for j in range(disturbances):
                        spread = math.sqrt(1.0 - math.exp(-2.0 * h / tau[j]))
                        z[states + j] += sd[j] * spread * shocks[used, j]
                used += 1
            t = time[k]
            row = held(t, row, in_time)
            predicted[k] = outputs(t, z[:states], in_value[row], p)[channel[k]]
        return predicted

    return Kernels(predict, design, perform)
