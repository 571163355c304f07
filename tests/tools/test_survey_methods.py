"""The parts of the comparison of surveys: energies by hand, errors of samples, known fields."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from procboard.survey.energy import EnergyModel
from tools.studies import survey_methods
from tools.studies.survey_methods import (
    METHODS,
    PASSING,
    SIZE,
    STOPPING,
    SWEEPS,
    Water,
    draw,
    expanded,
    fields,
    interpolated,
    joules_of_rows,
    kriged_of,
    random_for,
    rows_for,
    spread_rows,
    table,
)

X = np.arange(SIZE, dtype=np.float64)
PLANE = 2.0 * X[:, None] + 1.5 * X


def water(field, noise=0.0, place_m=0.0, seed=0):
    return Water(field, noise, place_m, PASSING, seed)


def test_fields_have_a_span_of_100():
    for field in fields().values():
        assert (field.min(), field.max()) == pytest.approx((0.0, 100.0))
        assert field.shape == (24, 24)


def test_energy_of_rows_by_hand():
    """Two rows, one for each robot: from the start to the row, along it, and straight back."""
    way = EnergyModel(1.0)
    one = 0.25 + 5.75 + math.hypot(5.75, 0.25)  # from (0, 0.25) by row 0
    two = math.hypot(0.25, 5.75) + 5.75 + math.hypot(5.5, 5.75)  # from (0.25, 0) by row 23
    assert joules_of_rows([0, 23], way) == pytest.approx(one + two)
    assert joules_of_rows([0, 23], EnergyModel(0.0, 1.0)) == 48.0
    # all rows: along each, from each to the next but between the two robots, and there and back
    there = 0.25 + math.hypot(0.25, 3.0)
    back = math.hypot(0.0, 2.5) + math.hypot(0.25, 5.75)
    everything = 24 * 5.75 + 22 * 0.25 + there + back
    assert joules_of_rows(list(range(24)), way) == pytest.approx(everything)


def test_as_many_rows_as_are_paid_for():
    joules = joules_of_rows(spread_rows(10), STOPPING)
    assert len(rows_for(joules, STOPPING)) == 10
    assert len(rows_for(joules - 1.0, STOPPING)) == 9
    assert rows_for(1e9, STOPPING) == list(range(24))
    assert spread_rows(3) == [0, 12, 23]


def test_samples_are_as_wrong_as_is_said():
    tilted = water(PLANE, noise=3.0, place_m=0.1)
    assert tilted.sigma == pytest.approx(math.hypot(3.0, 0.1 * math.hypot(8.0, 6.0)))
    inside = (slice(2, -2), slice(2, -2))  # the field ends with its grid
    off = [(replace(tilted, seed=seed).samples() - PLANE)[inside] for seed in range(20)]
    assert np.std(off) == pytest.approx(tilted.sigma, rel=0.03)
    assert np.array_equal(water(PLANE).samples(), PLANE)


def test_each_way_gives_back_a_field_that_it_can():
    rng = np.random.default_rng(0)
    low = 30.0 * rng.standard_normal((SIZE, 2)) @ rng.standard_normal((2, SIZE))
    found, cells = expanded(water(low), low)
    assert found.matrix == pytest.approx(low, abs=1e-8)
    assert found.samples == len(cells) == len(set(cells))
    assert interpolated(PLANE, spread_rows(4)) == pytest.approx(PLANE)
    smooth = 50.0 * np.sin(X[:, None] / 8.0) * np.cos(X / 9.0)
    some = [(row, column) for row in (*range(0, 24, 3), 23) for column in range(0, 24, 2)]
    assert kriged_of(smooth, some, 0) == pytest.approx(smooth, abs=0.5)


def test_random_cells_are_as_many_as_are_paid_for():
    field = np.outer(1.0 + X / 24.0, 2.0 - X / 24.0)
    found = random_for(field, 9000.0, PASSING, 0)
    assert 0.95 * 9000.0 < found.joules <= 9000.0
    assert found.matrix == pytest.approx(field, abs=1e-3)
    fewer = random_for(field, 9000.0, STOPPING, 0)
    assert fewer.samples < found.samples


def test_tables_and_picture_have_every_method(tmp_path: Path):
    curves = {name: [(1.0 + n, 10.0, 2.0) for n in range(5)] for name in METHODS}
    short = {name: points[:4] for name, points in curves.items()}
    text = table("heater", SWEEPS[0], curves)
    assert text.splitlines()[0].startswith("| heater, passing | noise 0.1 % |")
    assert "| rows | 1 (10, 2.0) |" in text
    assert len(text.splitlines()) == 2 + len(METHODS)
    picture = tmp_path / "it.svg"
    draw([("heater", (curves, curves, short))], picture)
    first = picture.read_bytes()
    draw([("heater", (curves, curves, short))], picture)
    assert picture.read_bytes() == first
    assert all(name.encode() in first for name in ("random completion", "heater, stopping"))


def test_the_command_compares_what_it_says(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(
        survey_methods, "compared", lambda water: dict.fromkeys(METHODS, (water.noise, 7, 1e3))
    )
    assert survey_methods.main(["--picture", str(tmp_path / "it.svg"), "--draws", "2"]) == 0
    out = capsys.readouterr().out
    assert out.count("| expansion |") == 9
    assert "| expansion | 0.1 (7, 1.0) | 0.3 (7, 1.0) |" in out
