"""Algorithm 1 against what must hold at its optimum, and against matrices known to be recovered."""

from __future__ import annotations

import numpy as np
import pytest

from procboard.errors import SurveyError
from procboard.survey.completion import complete
from tests.procboard.survey.known_fields import low_rank


def random_mask(rng, shape, share):
    mask = np.zeros(shape, dtype=bool)
    mask.flat[rng.permutation(mask.size)[: round(share * mask.size)]] = True
    return mask


def nuclear(matrix):
    return float(np.linalg.svd(matrix, compute_uv=False).sum())


@pytest.mark.parametrize("shape", [(40, 40), (30, 50)])
def test_a_low_rank_is_recovered_from_random_samples(shape):
    """Rank 2 of 40 × 40 at 60 %: six times its degrees of freedom (Candès and Recht 2009)."""
    rng = np.random.default_rng(5)
    field = 30.0 * low_rank(rng, shape, 2)
    mask = random_mask(rng, shape, 0.6)
    found = complete(np.where(mask, field, np.nan), mask)  # what is not sampled is not looked at
    assert found.converged
    assert np.linalg.norm(found.matrix - field) < 1e-5 * np.linalg.norm(field)


def test_what_is_found_is_optimal_where_it_is_not_the_field():
    """Too few samples: still feasible, and no direction within them makes the norm smaller.

    The optimum's mark is a dual matrix on the samples: U Vᵀ on the singular spaces of A, of
    spectral norm at most 1 elsewhere. What falls out of the method as Y is it.
    """
    rng = np.random.default_rng(6)
    field = 40.0 * low_rank(rng, (12, 12), 4)
    mask = random_mask(rng, (12, 12), 0.5)
    found = complete(field, mask)
    assert found.converged
    assert np.abs(found.matrix - field)[mask].max() < 1e-4
    assert nuclear(found.matrix) < nuclear(field) - 1.0
    least = nuclear(found.matrix)
    for _ in range(200):
        step = np.where(mask, 0.0, rng.standard_normal((12, 12)))
        assert nuclear(found.matrix + 1e-2 * step) > least - 1e-6
    # and straight towards the field, and downhill by the gradient outside the samples
    u, s, vt = np.linalg.svd(found.matrix)
    rank = int((s > 1e-3).sum())
    slope = np.where(mask, 0.0, u[:, :rank] @ vt[:rank])
    for step in (field - found.matrix, slope, -slope):
        assert nuclear(found.matrix + 1e-3 * step) > least - 1e-6


def test_all_samples_give_the_matrix_and_none_is_refused():
    field = 50.0 * low_rank(np.random.default_rng(8), (9, 9), 3)
    whole = complete(field, np.ones((9, 9), dtype=bool))
    assert whole.converged
    assert whole.matrix == pytest.approx(field, abs=1e-4)
    nothing = complete(np.zeros((4, 3)), np.ones((4, 3), dtype=bool))
    assert (nothing.converged, nothing.matrix.any()) == (True, False)
    with pytest.raises(SurveyError, match="no samples"):
        complete(field, np.zeros((9, 9), dtype=bool))
    with pytest.raises(SurveyError, match="must agree"):
        complete(field, np.ones((9, 8), dtype=bool))
    with pytest.raises(SurveyError, match="not finite"):
        complete(np.full((2, 2), np.nan), np.ones((2, 2), dtype=bool))


def test_an_end_by_count_says_so():
    field = 50.0 * low_rank(np.random.default_rng(9), (12, 12), 2)
    mask = random_mask(np.random.default_rng(9), (12, 12), 0.6)
    found = complete(field, mask, most_iterations=3)
    assert (found.iterations, found.converged) == (3, False)
