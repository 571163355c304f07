"""The vectors that compiled code for flexible tails works on.

How many numbers a tail has depends on how many segments or modes it has, so they cannot be named
tuples: they are vectors, allocated once and never inside a step. With E = N − 1 joints or E modes,

    state   [STATE of the body and the servo | bend E | bend rates E]
    rates   [derivative of the state | loads, see below]
    row     [ROW as for a rigid tail | bend E | bend rates E | memory of the integrator, if kept]

"Bend" is α_2 … α_N (absolute angles of the segments, rad) or η_1 … η_E (amplitudes of the modes,
m). What a tail is made of is a table: ``segments.table`` and ``modes.table`` say which row holds
what. One compiled right-hand side serves both kinds; ``modes`` tells it which (0: segments).
"""

from plant.layout import STATE

BEND = STATE
"""Where the bend stands in the state."""

ALPHA, ALPHA_DOT, ALPHA_DDOT, MEAN, SERVO, LOOSE, FORCE_X, FORCE_Y, HINGE_MOMENT = range(9)
"""Loads, counted from the end of the derivatives: as the fields of ``layout.Rates``."""

LOADS = 9

B_U, B_V, B_R, H, C = range(4, 9)
"""Rows of the scratch space of a right-hand side: the first four are its own, then B, h and C of
``solve_blocks``."""


def work_shape(bend: int) -> tuple[int, int]:
    """Shape of the scratch space of a right-hand side for E bend coordinates."""
    return C + bend, bend + 1
