"""Surveys swum by emulated robots: boards, radio, flash, sensors and bodies, to the end."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware_model.msp430.memory import RAM_END, RAM_START
from procboard.log_image import recover_records
from procboard.survey.items import SAMPLE, Sample
from procboard.survey.mission import Phase
from tools import scenario
from tools.cli import main
from tools.errors import ScenarioError
from tools.records.survey_data import BASE, Happening
from tools.report.survey_source import survey_view
from tools.shoal import ShoalBench

BODY_M = 0.05
"""Width of a robot's body."""
SMALL = (
    "survey.rows=2",
    "survey.columns=3",
    "survey.cell_m=0.4",
    "survey.gather_s=6",
    "survey.heartbeat_s=15",
    "survey.silence_s=40",
    "survey.method=everywhere",
    "procboard.tracking.arrival_radius_m=0.05",
    "shoal.starts=[{x_m=-0.3, y_m=0.0}, {x_m=-0.3, y_m=0.4}]",
    "procboard.telemetry_period_s=600",
)


class Swum:
    """A run that stops where the scenario says, and what its robots said meanwhile."""

    def __init__(self, *sets: str, duration_s: float = 400.0, seed: int = 1) -> None:
        config = scenario.load("survey-tank", (*SMALL, *sets), duration_s=duration_s, seed=seed)
        self.bench = ShoalBench.from_scenario(config)
        self.said: list[tuple[int, str, Any]] = []
        for member in self.bench.members:
            channel = self.bench.trace.channel(f"{member.name}.proc.tracking")
            channel.sink(
                lambda block, name=member.name: self.said.extend((t, name, v) for t, v in block)
            )

    def swim(self) -> Swum:
        self.bench.run(lambda seconds: None, lambda: False)
        self.data = self.bench.run_data()
        assert self.data.survey is not None
        self.survey = self.data.survey
        assert self.bench.survey is not None
        self.base = self.bench.survey
        return self

    def taken(self, name: str) -> list[int]:
        """Numbers of the records in which a robot put its samples."""
        return [v[1] for _, who, v in self.said if who == name and v[0] == "sample"]

    def on_flash(self, robot: int) -> dict[int, Sample]:
        """Samples in the log of a robot's records, read from its flash alone."""
        proc = self.bench.robots[robot - 1].proc
        config = proc.firmware.config
        assert config.routing is not None
        log = config.routing.record_log(config.log)
        first = config.log.sector_count * log.sector_bytes
        octets = bytes(proc.flash_image.memory[first : first + log.sector_count * log.sector_bytes])
        return {
            record.sequence: SAMPLE.decode(record.payload)
            for record in recover_records(octets, log)
        }

    def nothing_is_lost_and_nothing_twice(self) -> None:
        at_base = {(one.robot, one.record) for one in self.survey.samples if one.record is not None}
        assert (
            len(at_base)
            == self.base.records
            == len(self.survey.samples) - sum(one.record is None for one in self.survey.samples)
        )
        for number, member in enumerate(self.bench.members, start=1):
            flash = self.on_flash(number)
            lives = self.base.mission.knowledge.lives(member.address)
            for record in flash:
                assert (member.name, record) in at_base or not lives
            numbers = self.taken(member.name)
            assert len(numbers) == len(set(numbers))
        told = [
            (origin, sample.cell, sample.time_ms)
            for samples in self.base.mission.knowledge.samples.values()
            for (origin, _), sample in samples.items()
        ]
        assert len(told) == len(set(told))

    def all_agree(self) -> None:
        """Boards and base have the same samples and so the same field."""
        digests = {self.base.mission.knowledge.digest()}
        for member, robot in zip(self.bench.members, self.bench.robots, strict=True):
            if self.base.mission.knowledge.lives(member.address):
                mission = robot.proc.firmware.application.mission  # type: ignore[attr-defined]
                assert mission.phase is Phase.COMPLETE
                digests.add(mission.knowledge.digest())
        assert len(digests) == 1


@pytest.fixture(scope="module")
def swum() -> Swum:
    return Swum("survey.method=expansion", "survey.rows=3", "survey.place_deviation=1.5").swim()


def test_two_robots_survey_a_field_and_the_base_reconstructs_it(swum: Swum) -> None:
    assert swum.base.over
    assert not swum.data.interrupted
    assert swum.data.duration_s < 400.0
    figures = swum.survey.figures
    assert figures["complete"]
    assert figures["cells_given_up"] == []
    off = np.abs(swum.survey.matrix - swum.survey.true)
    assert (off < 4.0 * swum.survey.deviation).all()
    assert figures["error"]["rms_relative"] < 0.05
    assert {one.robot for one in swum.survey.samples} == {"fish01", "fish02"}
    swum.all_agree()


def test_every_sample_comes_to_the_base_once(swum: Swum) -> None:
    swum.nothing_is_lost_and_nothing_twice()
    figures = swum.survey.figures
    assert figures["samples_without_record"] == figures["samples_not_shared"] == 0
    assert (
        figures["records"]
        == figures["samples"]
        == sum(len(swum.taken(name)) for name in ("fish01", "fish02"))
    )


def test_the_robots_keep_off_each_other(swum: Swum) -> None:
    assert swum.data.whole["least_distance_m"] > BODY_M


def test_samples_have_the_place_and_the_time_at_which_they_were_taken(swum: Swum) -> None:
    known = [one for one in swum.survey.samples if one.time_s is not None]
    assert len(known) >= 0.5 * len(swum.survey.samples)  # until clocks agree takes a minute
    for one in known:
        assert one.time_s is not None
        assert 0.0 < one.arrived_s - one.time_s < 10.0
        truth = next(r for r in swum.data.robots if r.name == one.robot).truth
        x, y = (np.interp(one.time_s - 0.5, truth["time_s"], truth[a]) for a in ("x_m", "y_m"))
        assert np.hypot(x - one.x_m, y - one.y_m) < 0.05  # a robot without the time has its own
        value = np.interp(one.time_s - 0.5, truth["time_s"], truth["pollutant_ug_l"])
        assert abs(value - one.value) < 3.0


def test_with_loss_and_a_robot_killed_the_mission_completes() -> None:
    swum = Swum(
        "radio.loss_probability=0.3",
        "faults.supply_cuts=[{at_s=38.0, duration_s=3600.0, robots=[2]}]",
        "survey.columns=2",
    ).swim()
    assert swum.base.over
    assert not swum.base.mission.knowledge.lives(2)
    assert swum.base.mission.knowledge.lives(1)
    assert swum.survey.figures["cells_sampled"] == 4
    swum.nothing_is_lost_and_nothing_twice()
    swum.all_agree()
    assert swum.data.whole["least_distance_m"] > BODY_M
    view = survey_view(swum.bench.config, swum.data)
    assert view is not None
    told = [(event.what, event.robot) for event in view.events]
    died, missed = (told.index((what, 2)) for what in (Happening.DIED, Happening.MISSED))
    assert died < missed < told.index((Happening.COMPLETE, BASE))
    assert view.events[died].time_s == pytest.approx(38.0)
    assert dict(view.parents)[1] == BASE
    assert np.array_equal(view.known[-1].matrix, swum.survey.matrix)


def test_a_board_that_was_reset_goes_on_from_its_flash() -> None:
    swum = Swum("survey.columns=2")
    robot = swum.bench.robots[0].proc
    scheduler = swum.bench.scheduler
    when: list[float] = []

    def reset() -> None:
        """Soon after the first sample is on flash."""
        if any(name == "fish01" and value[0] == "sample" for _, name, value in swum.said):
            when.append(scheduler.now)
            robot.mote.mcu.press_reset()
        else:
            swum.bench.trace.flush()
            scheduler.after(2 * 10**15, reset, 0)

    scheduler.after(2 * 10**15, reset, 0)
    swum.swim()
    assert when
    assert robot.boot_number == 2
    assert swum.base.over
    phases = [value[1] for _, name, value in swum.said if name == "fish01" and value[0] == "phase"]
    assert phases == ["gathering", "surveying", "gathering", "surveying", "complete"]
    assert swum.survey.figures["samples_repeated"] == 0
    swum.nothing_is_lost_and_nothing_twice()
    swum.all_agree()


def test_while_the_base_is_out_of_range_robots_rest_and_then_go_on() -> None:
    swum = Swum(
        "survey.rows=1", "survey.columns=2", "faults.base_outages=[{at_s=12.0, duration_s=20.0}]"
    ).swim()
    words = [(time_fs / 1e15, value[0]) for time_fs, _, value in swum.said]
    lost = [at_s for at_s, word in words if word == "pose lost"]
    found = [at_s for at_s, word in words if word == "pose found"]
    assert 16.0 < min(lost) < 19.0  # 5 s after the last pose
    assert 32.0 < min(found) < 34.0
    assert swum.base.over
    assert swum.survey.figures["cells_sampled"] == 2
    swum.nothing_is_lost_and_nothing_twice()


def test_a_board_takes_the_memory_that_is_counted() -> None:
    swum = Swum("survey.rows=1", "survey.columns=1", duration_s=1.5).swim()
    proc = swum.bench.robots[0].proc
    assert RAM_END - RAM_START - proc.mote.mcu.ram.free == proc.firmware.config.ram_bytes


def test_the_same_seed_gives_the_same_trace() -> None:
    first = Swum(duration_s=20.0).swim()
    assert Swum(duration_s=20.0).swim().data.trace_sha256 == first.data.trace_sha256
    assert Swum(duration_s=20.0, seed=2).swim().data.trace_sha256 != first.data.trace_sha256
    assert not first.base.over


def test_the_folder_has_samples_field_and_figures(tmp_path: Path) -> None:
    place = tmp_path / "run"
    sets = [
        word for key in (*SMALL, "survey.rows=1", "survey.columns=1") for word in ("--set", key)
    ]
    assert (
        main(["run", "survey-tank", *sets, "--duration", "60", "--quiet", "--out", str(place)]) == 0
    )
    figures = json.loads((place / "survey.json").read_text(encoding="utf-8"))
    with (place / "samples.csv").open(encoding="utf-8", newline="") as file:
        samples = list(csv.DictReader(file))
    with (place / "reconstruction.csv").open(encoding="utf-8", newline="") as file:
        (cell,) = csv.DictReader(file)
    assert figures["cells_sampled"] == 1
    assert "1 cell" in (place / "report.html").read_text(encoding="utf-8")
    assert len(samples) == figures["samples"] == figures["records"]
    assert cell["sampled"] == "1"
    off = abs(float(cell["value"]) - float(cell["true"]))
    assert off == pytest.approx(figures["error"]["max"])
    assert float(samples[0]["value"]) == pytest.approx(float(cell["value"]), abs=2.5)


@pytest.mark.parametrize(
    ("sets", "says"),
    [
        (("shoal.robots=0", "shoal.starts=[]"), "a survey is a shoal's"),
        (("survey.columns=24",), "cells must lie in the tank"),
        (("survey.silence_s=20",), "two heartbeats"),
        (("base_station.send_pose=false",), "poses by radio"),
        (("navboard.water_probe.fitted=false",), "it measures the pollutant"),
    ],
)
def test_what_makes_no_survey_is_refused(sets: tuple[str, ...], says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        scenario.load("survey-tank", (*SMALL, *sets))


def test_a_grid_for_which_boards_have_no_memory_is_refused() -> None:
    sets = ("survey.rows=24", "survey.columns=24", "tank.size_m=[9, 9]")
    with pytest.raises(ScenarioError, match="10 KB of RAM"):
        ShoalBench.from_scenario(scenario.load("survey-tank", sets))
