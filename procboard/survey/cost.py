"""What a survey costs a board: operations of floating point, in cycles of its processor.

The MSP430 of the processing board has no floating point. Its C library's additions and
multiplications of 4 octets take 150 to 400 cycles (an estimate, as for the tracking law). What a
board computes for each request that is answered is one decomposition of the samples where the lines
cross, and weights of all rows and columns of the block; then who samples what of the next one, in
whole numbers; and once a beat, past the other robots, where to swim.
"""

from __future__ import annotations

from typing import Final

OPERATION_CYCLES: Final = 300
"""Of an addition or multiplication; divisions and roots are few."""
SWEEPS: Final = 6
"""Of Jacobi rotations over all pairs of columns: what blocks up to 12 × 12 take, the last one
finding nothing to turn."""


TRIGONOMETRY_CYCLES: Final = 1_500
"""Of a sine, cosine or arctangent of the C library: a polynomial of five terms (estimate)."""
WAY_STEPS: Final = 20
"""Of a way that is predicted (`procboard.survey.avoidance`)."""
LEG_CYCLES: Final = 100
"""Of a leg between two cells: its length and direction, by the difference of rows and columns, out
of a table in the program's memory, and a sum (about 30 instructions; estimate)."""
CHANGES_A_CELL: Final = 600
"""Orders that are tried: some five times round, 2 reversals and 12 moves beside each of 8."""
CHANGED_LEGS: Final = 4
"""Of an order that differs in one place from the one before."""
ITEM_CYCLES: Final = 3_000
"""Taking an item in: its fields, the table of robots, who lives, which cells are left to do; some
tens of comparisons for each of the robots (estimate)."""


def svd_operations(rows: int, columns: int) -> int:
    """Operations of `procboard.survey.algebra.svd`."""
    if rows < columns:
        rows, columns = columns, rows
    pairs = columns * (columns - 1) // 2
    # three sums of products, then two columns of A and V turned
    return SWEEPS * pairs * (6 * rows + 6 * (rows + columns) + 20)


def request_operations(shape: tuple[int, int], lines: int) -> int:
    """Operations for a request of the noise-tolerant survey, with so many rows and columns known.

    The decomposition, the inverse, weights of rows and columns, and what they amplify each cell by.
    """
    rows, columns = shape
    inverse = 2 * lines**3
    weights = 2 * (rows + columns) * lines * (lines + 1)
    return svd_operations(lines, lines) + inverse + weights + 4 * rows * columns


def request_cycles(shape: tuple[int, int], lines: int) -> int:
    """Cycles of the board's processor for a request that was answered."""
    return OPERATION_CYCLES * request_operations(shape, lines)


def plan_cycles(cells: int) -> int:
    """Cycles for sharing out so many cells (`procboard.survey.sweeps`)."""
    return LEG_CYCLES * CHANGED_LEGS * CHANGES_A_CELL * cells


def steering_cycles(ways: int, near: int) -> int:
    """Cycles for trying so many directions against so many robots."""
    step = 3 * TRIGONOMETRY_CYCLES + 12 * OPERATION_CYCLES
    # twice the distance from a robot, swimming or standing, of the steps that it is near for at all
    other = 2 * 5 * OPERATION_CYCLES
    return ways * WAY_STEPS * (step + near * other)


ROBOTS: Final = 24
"""That a board has room for (our choice)."""
TABLES_BYTES: Final = ROBOTS * 12 + 64 * 2 + 32 * 4
"""Of each robot what it said last of itself: the numbers of its last item and of that after which
it was gone, two places, a digest. Own cells of a request. Readings of three seconds."""


def ram_bytes(shape: tuple[int, int], lines: int) -> int:
    """RAM of a mission that has so many lines at most; items themselves are on flash."""
    return octets(shape, lines) + TABLES_BYTES


def octets(shape: tuple[int, int], lines: int) -> int:
    """Working memory of a survey in floats of 4 octets, with at most so many lines.

    The samples, W⁺, and A and V of the decomposition; weights are made row by row.
    """
    return 4 * (shape[0] * shape[1] + lines * lines + 2 * lines * lines + 2 * lines)
