"""What a survey costs a board: operations of floating point, in cycles of its processor.

The MSP430 of the processing board has no floating point. Its C library's additions and
multiplications of 4 octets take 150 to 400 cycles (an estimate, as for the tracking law). What a
board computes for each request that is answered is one decomposition of the samples where the lines
cross, and weights of all rows and columns of the block.
"""

from __future__ import annotations

from typing import Final

OPERATION_CYCLES: Final = 300
"""Of an addition or multiplication; divisions and roots are few."""
SWEEPS: Final = 6
"""Of Jacobi rotations over all pairs of columns: what blocks up to 12 × 12 take, the last one
finding nothing to turn."""


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


def octets(shape: tuple[int, int], lines: int) -> int:
    """Working memory of a survey in floats of 4 octets, with at most so many lines.

    The samples, W⁺, and A and V of the decomposition; weights are made row by row.
    """
    return 4 * (shape[0] * shape[1] + lines * lines + 2 * lines * lines + 2 * lines)
