"""The same scenario and seed give the same trace, whoever runs them, where, and in what slices."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tools import scenario
from tools.bench import Bench

# Everything that draws random numbers is on: bit errors, losses, camera, GPS, sensors, back-offs.
NAME = "rough-link"
SETS = (
    "navboard.gps.fitted=true",
    "navboard.tail_potentiometer.fitted=true",
    "base_station.tail_beats=[{at_s=1.0, bias_rad=0.2}]",
    "base_station.send_pose=true",
    "faults.flash_cuts=[{after_s=1.5, duration_s=0.3}]",
)
DURATION_S = 3.0


def arguments(out: Path, seed: int = 1) -> list[str]:
    options = [option for text in SETS for option in ("--set", text)]
    ends = ("--duration", str(DURATION_S), "--seed", str(seed), "--out", str(out), "--json")
    return ["run", NAME, *options, *ends]


def fresh(seed: int = 1) -> Bench:
    return Bench.from_scenario(scenario.load(NAME, SETS, duration_s=DURATION_S, seed=seed))


@pytest.fixture(scope="session")
def expected() -> str:
    """The hash of a run in this process, in one piece."""
    bench = fresh()
    bench.scheduler.run(round(DURATION_S * 1e15))
    return bench.run_data().trace_sha256


@pytest.mark.parametrize("hash_seed", ["0", "4711"])
def test_another_process_another_folder_another_hash_seed(
    expected: str, fishbed: Callable[..., Any], tmp_path: Path, hash_seed: str
) -> None:
    done = fishbed(*arguments(tmp_path / "run"), cwd=tmp_path, PYTHONHASHSEED=hash_seed)
    assert done.code == 0, done.err
    assert json.loads(done.out)["trace_sha256"] == expected


@pytest.mark.parametrize("slicing", ["milliseconds", "random", "bench"])
def test_slices_and_looks_change_nothing(expected: str, slicing: str) -> None:
    bench, end_fs = fresh(), round(DURATION_S * 1e15)
    if slicing == "bench":
        bench.run(lambda _seconds: None, lambda: False)
    elif slicing == "milliseconds":
        for time_fs in range(10**12, end_fs + 1, 10**12):
            bench.scheduler.run(time_fs)
    else:
        chance = random.Random(3)
        while bench.scheduler.now < end_fs:
            step_fs = round(10 ** chance.uniform(6, 14.5))
            bench.scheduler.run(min(end_fs, bench.scheduler.now + step_fs))
            bench.robot.vehicle.heading(bench.scheduler.now)  # somebody looks in between
            if chance.random() < 0.1:
                bench.trace.flush()
    assert bench.run_data().trace_sha256 == expected


@pytest.mark.parametrize("stops", [(1,), (7, 8, 30)])
def test_a_run_that_was_interrupted_goes_on_as_if_it_had_not_been(
    expected: str, stops: tuple[int, ...]
) -> None:
    bench = fresh()
    looks = 0

    def interrupted() -> bool:
        nonlocal looks
        looks += 1
        return looks in stops

    for _ in stops:
        bench.run(lambda _seconds: None, interrupted)
        assert bench.interrupted
        bench.run_data()  # what was so far was written
    bench.run(lambda _seconds: None, lambda: False)
    assert bench.run_data().trace_sha256 == expected


@pytest.mark.parametrize("slices", [6, 7, 23])
def test_an_interrupted_run_is_repeated_up_to_the_same_moment(slices: int) -> None:
    """0.3 s is a little less than three tenths in binary; the camera looks in that very instant."""
    stopped = fresh()
    left = iter(range(slices))
    stopped.run(lambda _seconds: None, lambda: next(left, None) is None)
    first = stopped.run_data()
    assert first.interrupted
    again = Bench.from_scenario(scenario.load(NAME, SETS, duration_s=first.duration_s))
    again.run(lambda _seconds: None, lambda: False)
    assert again.scheduler.now == stopped.scheduler.now
    assert again.run_data().trace_sha256 == first.trace_sha256


def test_another_seed_is_another_trace(expected: str) -> None:
    bench = fresh(seed=2)
    bench.run(lambda _seconds: None, lambda: False)
    assert bench.run_data().trace_sha256 != expected


def test_an_instrument_less_is_another_trace(expected: str) -> None:
    sets = (*SETS, "navboard.water_probe.fitted=false")
    bench = Bench.from_scenario(scenario.load(NAME, sets, duration_s=DURATION_S))
    bench.run(lambda _seconds: None, lambda: False)
    assert bench.run_data().trace_sha256 != expected


def test_replay_from_another_place_and_the_written_scenario_itself(
    swim: Any, fishbed: Callable[..., Any], tmp_path: Path
) -> None:
    """The folder's scenario.toml, moved away, runs to the same hash; `replay` says so too."""
    run = swim(NAME, *SETS, duration_s=DURATION_S, keep=True)
    recorded = run.data.trace_sha256
    moved = tmp_path / "elsewhere"
    shutil.copytree(run.folder, moved)
    written = scenario.load(moved / "scenario.toml")
    assert written == run.config
    bench = Bench.from_scenario(written)
    bench.run(lambda _seconds: None, lambda: False)
    assert bench.run_data().trace_sha256 == recorded

    done = fishbed("replay", str(moved), "--json", cwd=tmp_path, PYTHONHASHSEED="77")
    assert (done.code, done.err) == (0, "")
    assert json.loads(done.out)["replayed"]["trace_sha256"] == recorded

    # Replay that could not say "another" would say nothing: one key is another than recorded.
    path = moved / "scenario.toml"
    text = path.read_text(encoding="utf-8")
    assert "mass_kg = 0.311" in text
    path.write_text(text.replace("mass_kg = 0.311", "mass_kg = 0.312"), encoding="utf-8")
    assert fishbed("replay", str(moved), "--quiet").code == 1
