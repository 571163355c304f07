"""Sampling and reconstruction of a low-rank field: Figs. 6.4 to 6.6 and 6.9 to 6.12.

The source prints pictures of its two fields and no data. They are made again
(`plant.field_matrices`) with what the text says of them, and the algorithms run on those. Rows are
y and columns are x, in cells of an inch.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from plant.field_matrices import late_rank, tank_temperature
from procboard.survey.completion import BoolArray, complete
from procboard.survey.expansion import Expansion
from procboard.survey.successive import algorithm_2, algorithm_3
from tools.studies.study import Cells, Check, Curve, Figure, FloatArray, Panel, Progress, Result

RANK = 6  # of the temperature field, as truncated in section 6.5.1
LATE_RANK = 8  # of the field of section 6.6.2
GREYS = (0.0, 255.0)
SEED = 1  # of the random samples of Algorithm 1, and of the extra ones of Algorithm 3
DRAWS = 20  # other random samples, for the spread of Algorithm 1's error
IDENTICAL = 1e-6
"""Of 255: what "identical" and "perfectly" allow for the rounding of an ill-conditioned corner."""

temperature = cache(tank_temperature)
late = cache(late_rank)


def swim(survey: Expansion, field: FloatArray) -> list[tuple[int, int]]:
    """Tell a survey what it wants until it is done; the cells in the order of the visit."""
    path: list[tuple[int, int]] = []
    while not survey.done:
        wanted = survey.wanted()
        for cell in wanted:
            survey.tell(cell, float(field[cell]))
        path += wanted
    return path


def random_half(shape: tuple[int, int], seed: int) -> BoolArray:
    """A mask of half the cells, drawn without repetition."""
    count = shape[0] * shape[1]
    order = np.random.default_rng(seed).permutation(count)
    return np.reshape(order < count // 2, shape)


def relative_error(found: FloatArray, field: FloatArray) -> float:
    """‖found − field‖ / ‖field‖ in the Frobenius norm, in per cent."""
    return 100.0 * float(np.linalg.norm(found - field) / np.linalg.norm(field))


def the_field(progress: Progress) -> Result:
    """Fig. 6.4: the temperature, truncated to rank 6."""
    field = temperature()
    s = np.linalg.svd(field, compute_uv=False)
    condition = float(np.linalg.cond(field[:RANK, :RANK]))
    return Result(
        checks=(_rank_check("rank of the field", RANK, field),),
        figures=(_pictures("Fig. 6.4", "Temperature field of rank 6.", ("", field)),),
        notes=(
            (
                "The source's data are not printed. Here a kilowatt heats a tank of 3 m × 2 m "
                "(steady heat with losses, closed form), a thermometer reads 24 × 24 points an "
                "inch apart with noise of 0.4 % of the span, the readings are scaled to 0 … 255 "
                "and then truncated to rank 6. Scaled after the truncation, as section 6.5.1 "
                f"words it, it would have rank 7. σ₆/σ₁ is {s[5] / s[0]:.4f}; the corner of 6 × 6 "
                f"cells that Algorithm 2 starts from has the condition {condition:.0e}."
            ),
        ),
    )


def random_completion(progress: Progress) -> Result:
    """Fig. 6.5: half of the cells at random, and the field by Algorithm 1."""
    field = temperature()
    masks = [random_half((24, 24), SEED + draw) for draw in range(1 + DRAWS)]
    errors = []
    for number, mask in enumerate(masks):
        found = complete(field, mask)
        errors.append(relative_error(found.matrix, field))
        if not number:
            first = found
        progress((number + 1) / len(masks))
    share = 100.0 * float(masks[0].mean())
    return Result(
        checks=(Check("cells sampled", 50.0, share, "%", 0.05, absolute=True),),
        figures=(
            _pictures(
                "Fig. 6.5",
                "Algorithm 1: (a) sampled cells, (b) reconstruction.",
                ("(a) sampled", np.where(masks[0], field, np.nan)),
                ("(b) reconstructed", first.matrix),
            ),
        ),
        notes=(
            (
                f"'Good fidelity': the error is {errors[0]:.1f} % of the field (Frobenius norms) "
                f"after {first.iterations} iterations, and in the median of {len(errors)} draws "
                f"{np.median(errors):.1f} % ({min(errors):.1f} to {max(errors):.1f} %). It cannot "
                "be exact: 288 samples stand against the 252 degrees of freedom of a 24 × 24 "
                "matrix of rank 6."
            ),
        ),
    )


def successive(progress: Progress) -> Result:
    """Fig. 6.6: the same field by Algorithm 2."""
    field = temperature()
    survey = algorithm_2((24, 24), RANK)
    swim(survey, field)
    found = survey.reconstruction()
    return Result(
        checks=(
            Check("cells sampled", 43.75, 100.0 * survey.sampled.mean(), "%", 0.005, absolute=True),
            _identical(found, field),
        ),
        figures=(
            _pictures(
                "Fig. 6.6",
                "Algorithm 2: sampled cells, and the reconstruction.",
                ("sampled", np.where(survey.sampled, field, np.nan)),
                ("reconstructed", found),
            ),
        ),
        notes=(
            (
                "Its time against that of Algorithm 1 (0.04 s and 0.4 s) is a measurement: "
                "python -m tools.benchmark --only survey."
            ),
        ),
    )


def the_late_field(progress: Progress) -> Result:
    """Fig. 6.9: the field whose corner has a smaller rank."""
    field = late()
    return Result(
        checks=(
            _rank_check("rank of the field", LATE_RANK, field),
            _rank_check("rank of its first 10 × 10 block", 7, field[:10, :10]),
            _rank_check("rank of its first 11 × 11 block", 8, field[:11, :11]),
        ),
        figures=(_pictures("Fig. 6.9", "Field of 20 × 20 with rank 8.", ("", field)),),
        notes=(
            (
                "The source's matrix is not printed; this one is drawn with the ranks it has. Its "
                "eighth direction begins in row 11."
            ),
        ),
    )


def defeated(progress: Progress) -> Result:
    """Fig. 6.10: Algorithm 2 on it."""
    field = late()
    survey = algorithm_2((20, 20), LATE_RANK)
    swim(survey, field)
    found = survey.reconstruction()
    rank = int(np.linalg.matrix_rank(found))
    return Result(
        figures=(
            _pictures(
                "Fig. 6.10",
                "Algorithm 2 on the field of Fig. 6.9, and its error.",
                ("reconstructed", found),
                ("error", np.abs(found - field)),
            ),
        ),
        notes=(
            (
                f"'A big error': {relative_error(found, field):.0f} % of the field (Frobenius "
                f"norms), up to {np.abs(found - field).max():.0f} of 255. It finds 7 independent "
                f"columns in the first 8 × 8 block, and what it makes of them has rank {rank}."
            ),
        ),
    )


def recovered(progress: Progress) -> Result:
    """Fig. 6.11: Algorithm 3 on it."""
    field = late()
    survey = algorithm_3((20, 20), LATE_RANK, SEED)
    swim(survey, field)
    found = survey.reconstruction()
    return Result(
        checks=(_identical(found, field),),
        figures=(
            _pictures(
                "Fig. 6.11",
                "Algorithm 3 on the field of Fig. 6.9.",
                ("reconstructed", found),
            ),
        ),
    )


def extra_samples(progress: Progress) -> Result:
    """Fig. 6.12: where Algorithm 3 samples, and what Algorithm 2 would not have."""
    field = late()
    plain, looking = algorithm_2((20, 20), LATE_RANK), algorithm_3((20, 20), LATE_RANK, SEED)
    swim(plain, field)
    swim(looking, field)
    more = looking.sampled & ~plain.sampled
    full = LATE_RANK * (20 + 20 - LATE_RANK)
    return Result(
        figures=(
            Figure(
                "Fig. 6.12",
                "Cells sampled by Algorithm 3, numbered from 1 as in the source.",
                (
                    Panel(
                        "",
                        "x (cells)",
                        "y (cells)",
                        (
                            _places("also by Algorithm 2", plain.sampled),
                            _places("additional", more),
                        ),
                        equal=True,
                    ),
                ),
            ),
        ),
        notes=(
            (
                f"Algorithm 3 samples {looking.sampled.sum()} cells, {more.sum()} of them "
                f"additional to the {plain.sampled.sum()} of Algorithm 2, which stays with 7 "
                f"columns and rows; with 8 from the start it would be {full}. How many stars the "
                "source's picture has is not printed."
            ),
        ),
    )


def _rank_check(what: str, published: int, matrix: FloatArray) -> Check:
    return Check(what, published, float(np.linalg.matrix_rank(matrix)), "", 0.5, absolute=True)


def _identical(found: FloatArray, field: FloatArray) -> Check:
    apart = int((np.abs(found - field) > IDENTICAL * GREYS[1]).sum())
    what = "cells that differ by more than a millionth of 255: 'identical', 'perfectly'"
    return Check(what, 0.0, float(apart), "", 0.5, absolute=True)


def _pictures(name: str, caption: str, *named: tuple[str, FloatArray]) -> Figure:
    cells = tuple(
        Cells(
            title,
            "x (cells)",
            "y (cells)",
            "grey value",
            np.arange(1.0, 1.0 + matrix.shape[1]),
            np.arange(1.0, 1.0 + matrix.shape[0]),
            matrix,
            GREYS,
        )
        for title, matrix in named
    )
    return Figure(name, caption, cells)


def _places(label: str, mask: BoolArray) -> Curve:
    rows, columns = np.nonzero(mask)
    return Curve(label, columns.astype(np.float64) + 1.0, rows.astype(np.float64) + 1.0, "marks")
