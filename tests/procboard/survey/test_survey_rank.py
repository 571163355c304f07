"""The rank of a block: noise against its law, and blocks grown until the rank stays."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procboard.survey.rank import around, boustrophedon, grown_block, rank_of, threshold
from tests.procboard.survey.known_fields import low_rank

PASSES = {(1, 1): 130, (2, 2): 70, (4, 4): 50, (3, 9): 50, (12, 12): 40}
"""Of 40000 blocks of noise; stated are 40, thrice as many for one cell, nearly twice for four."""


@pytest.mark.parametrize("shape", PASSES)
def test_noise_passes_for_a_rank_as_often_as_stated(shape):
    noise = np.random.default_rng(7).standard_normal((40_000, *shape))
    gram = noise @ np.swapaxes(noise, 1, 2)
    largest = np.sqrt(np.linalg.eigvalsh(gram)[:, -1])
    passed = int((largest > threshold(shape, 1.0, 0.0)).sum())
    assert abs(passed - PASSES[shape]) <= 3.0 * PASSES[shape] ** 0.5


@given(st.integers(0, 500), st.integers(1, 5), st.floats(0.0, 1.0))
def test_what_stands_above_the_threshold_twice_is_found(seed, rank, sigma):
    """Weyl: the noise moves no singular value by more than its own largest one."""
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.standard_normal((8, rank)))
    p, _ = np.linalg.qr(rng.standard_normal((8, rank)))
    clean = 2.01 * max(threshold((8, 8), sigma, 0.0), 1.0) * q @ p.T
    noisy = clean + sigma * rng.standard_normal((8, 8))
    assert rank_of(np.linalg.svd(noisy)[1], (8, 8), sigma) == rank


def test_without_noise_the_rank_is_numpys():
    rng = np.random.default_rng(3)
    for rank in range(6):
        field = low_rank(rng, (9, 7), rank)
        assert rank_of(np.linalg.svd(field)[1], (9, 7)) == np.linalg.matrix_rank(field) == rank
    assert rank_of(np.zeros(0), (0, 3)) == 0


def grow(field, sigma=0.0, patience=1):
    known, asked = np.full(field.shape, np.nan), []
    growing = grown_block(known, sigma, patience)
    cells = next(growing)
    while True:
        asked += cells
        try:
            cells = growing.send(np.array([field[cell] for cell in cells]))
        except StopIteration as end:
            assert np.isfinite(known).sum() == len(asked)
            return end.value, asked


@given(st.integers(0, 300), st.integers(0, 6), st.integers(1, 3))
def test_a_block_grows_until_its_rank_has_stayed(seed, rank, patience):
    field = low_rank(np.random.default_rng(seed), (12, 14), rank)
    side, asked = grow(field, patience=patience)
    assert side == rank + patience
    assert sorted(asked) == sorted(boustrophedon(range(side), range(side)))


def test_a_full_rank_fills_the_grid_and_noise_alone_ends_at_once():
    rng = np.random.default_rng(0)
    assert grow(rng.standard_normal((5, 7)))[0] == 5
    assert grow(rng.standard_normal((9, 9)), sigma=1.0)[0] == 1
    noisy = low_rank(rng, (9, 9), 2) * 50.0 + rng.standard_normal((9, 9))
    assert grow(noisy, sigma=1.0)[0] == 3


def test_visits_step_from_a_cell_to_its_neighbour():
    walk = list(boustrophedon(range(2, 5), range(4)))
    grown = [cell for side in range(1, 9) for cell in around(side)]
    assert sorted(grown) == sorted(boustrophedon(range(8), range(8)))
    for path in (walk, grown):
        steps = [abs(a[0] - b[0]) + abs(a[1] - b[1]) for a, b in itertools.pairwise(path)]
        assert set(steps) == {1}
