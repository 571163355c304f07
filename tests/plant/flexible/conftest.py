"""Robots with flexible tails, and how far two paths of one robot are apart."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from plant.layout import ROW
from plant.parameters import PlantParameters, Tail
from plant.robots import wang2014_flexible
from plant.trajectory import Trajectory

Robot = Callable[..., PlantParameters]
Distance = Callable[[Trajectory, Trajectory], float]


@pytest.fixture
def robot() -> Robot:
    """Chapter 4's robot with a tail and a share of body motion in its forces."""

    def make(tail: Tail, share: float = 1.0) -> PlantParameters:
        p = wang2014_flexible(tail)
        return replace(p, hydrodynamics=replace(p.hydrodynamics, body_motion_in_tail=share))

    return make


@pytest.fixture
def distance() -> Distance:
    """Largest difference of any part of the state, over that part's own largest value."""

    def far(a: Trajectory, b: Trajectory) -> float:
        columns = [*range(6), *range(ROW, b.rows.shape[1])]
        difference = np.abs(a.rows - b.rows)[:, columns].max(axis=0)
        return float((difference / np.abs(b.rows[:, columns]).max(axis=0)).max())

    return far
