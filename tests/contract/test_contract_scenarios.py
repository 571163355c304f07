"""Every bundled scenario, unasked: it loads, resolves, comes back from its own text, and runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tools import scenario
from tools.commands import listing
from tools.shoal import ShoalBench

NAMES = tuple(scenario.bundled())
SHOALS = tuple(name for name in NAMES if scenario.load(name).shoal.robots)
ALONE = tuple(name for name in NAMES if name not in SHOALS)


def test_there_are_the_scenarios_of_the_contract() -> None:
    assert {"swim-forward", "circle", "reach-target", "rough-link", "power-loss"} <= set(NAMES)
    assert [name for name, _ in listing.rows("scenarios")] == sorted(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_it_is_what_it_says_and_resolves_to_itself(name: str, tmp_path: Path) -> None:
    config = scenario.load(name)
    assert config.scenario.name == name
    assert len(config.scenario.description) > 10
    assert config == scenario.load(name), "loading has a memory"
    text = scenario.to_toml(config)
    assert "base" not in {line.split("=")[0].strip() for line in text.splitlines()}
    written = tmp_path / "resolved.toml"
    written.write_text(text, encoding="utf-8")
    assert scenario.load(written) == config
    assert scenario.to_toml(scenario.load(written)) == text


@pytest.mark.parametrize("name", ALONE)
def test_it_runs(name: str, swim: Any) -> None:
    run = swim(name, duration_s=1.5)
    assert run.data.duration_s == 1.5
    assert not run.data.interrupted
    for column, values in run.data.truth.items():
        known = values[~np.isnan(values)]
        assert known.size > 0, column
        assert np.isfinite(known).all(), column
    assert run.data.truth["time_s"][-1] == pytest.approx(1.5)
    # Both boards are up, and the links between everybody work.
    assert run.values("proc.boot") == [1]
    assert len(run.values("nav.sample")) > 60
    assert len(run.values("proc.samples")) > 8
    assert run.data.metrics["radio_sent"] >= 2
    assert run.data.metrics["energy_j"] > 0.1


@pytest.mark.parametrize("name", SHOALS)
def test_a_shoal_runs(name: str) -> None:
    bench = ShoalBench.from_scenario(scenario.load(name, duration_s=12.0))
    bench.run(lambda seconds: None, lambda: False)
    data = bench.run_data()
    assert not data.interrupted
    assert len(data.robots) == scenario.load(name).shoal.robots
    for robot in data.robots:
        assert robot.truth["time_s"][-1] == pytest.approx(12.0)
        assert len(robot.mounts) == 1
        assert robot.metrics["samples_stored"] > 0
        assert robot.metrics["spi_lost"] == 0
        assert robot.metrics["energy_j"] > 0.1
    assert data.whole["telemetry_received"] > 0
