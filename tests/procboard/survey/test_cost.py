"""The stated cost of a survey against operations counted while it runs."""

from __future__ import annotations

import numpy as np
import pytest

from procboard.survey import algebra, sweeps, tolerant
from procboard.survey.cost import (
    CHANGES_A_CELL,
    octets,
    ram_bytes,
    request_cycles,
    request_operations,
    svd_operations,
)
from procboard.survey.tolerant import noise_tolerant
from tests.procboard.survey.known_fields import low_rank, swim


@pytest.fixture
def counted(monkeypatch):
    """Operations of rotations and products, counted where they are made."""
    count = {"svd": 0, "product": 0}
    rotate, product = algebra._rotate, algebra.product

    def counting_rotate(work, top, left, right):
        count["svd"] += len(left) * (6 * top + 6 * len(work) + 20)
        return rotate(work, top, left, right)

    def counting_product(a, b):
        count["product"] += 2 * a.shape[0] * a.shape[1] * b.shape[1]
        return product(a, b)

    monkeypatch.setattr(algebra, "_rotate", counting_rotate)
    monkeypatch.setattr(tolerant, "product", counting_product)
    monkeypatch.setattr(algebra, "product", counting_product)
    return count


@pytest.mark.parametrize("size", [5, 8, 12])
def test_a_decomposition_takes_about_what_is_stated(counted, size):
    for seed in range(20):
        algebra.svd(np.random.default_rng(seed).standard_normal((size, size)))
    assert 0.5 < counted["svd"] / 20 / svd_operations(size, size) < 1.3


def test_a_request_takes_no_more_than_is_stated(counted):
    """Mean over a survey of 24 × 24 cells; its lines are two more than the rank at most times."""
    field = 40.0 * low_rank(np.random.default_rng(0), (24, 24), 6)
    survey = noise_tolerant((24, 24), 0.5)
    swim(survey, field)
    assert counted["svd"] / survey.answered < request_operations((24, 24), 9)


def test_a_board_has_the_memory_and_the_time():
    assert octets((24, 24), 12) < 5000  # of 10 KB
    assert request_cycles((24, 24), 8) < 4.2e6 * 4.0  # s of a TelosB's 4.2 MHz


def test_work_is_counted_again_where_a_survey_begins_anew():
    field = low_rank(np.random.default_rng(1), (6, 6), 1)
    survey = noise_tolerant((6, 6), 0.0)
    path = swim(survey, field)
    before = survey.answered
    assert before > 5
    survey.correct(path[-1], float(field[path[-1]]))
    assert survey.answered == before
    survey.correct(path[0], 2.0 * float(field[path[0]]))
    assert survey.answered > before


@pytest.mark.parametrize(("cells", "robots"), [(4, 2), (12, 2), (24, 4), (40, 20)])
def test_sharing_out_tries_no_more_orders_than_is_stated(monkeypatch, cells, robots):
    tried = []
    take = sweeps._Refined._take
    monkeypatch.setattr(
        sweeps._Refined, "_take", lambda self, changed: tried.append(1) or take(self, changed)
    )
    random = np.random.default_rng(cells)
    places = random.choice(144, cells, replace=False)
    wanted = [(int(place) // 12, int(place) % 12) for place in places]
    poses = {robot: sweeps.Pose(*random.uniform(0.0, 3.0, 2), 0.0) for robot in range(robots)}
    sweeps.shares(wanted, poses, 0.25)
    assert 0 < len(tried) < CHANGES_A_CELL * cells


def test_what_is_reserved_grows_with_grid_and_lines():
    assert ram_bytes((12, 12), 6) - ram_bytes((12, 12), 0) == 4 * (3 * 36 + 12)
    assert ram_bytes((12, 12), 0) - ram_bytes((6, 6), 0) == 4 * (144 - 36)
