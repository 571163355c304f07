"""The run folder of a shoal: files, metrics for each robot, the report, and its replay."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tools import scenario
from tools.cli import main
from tools.errors import RunFolderError
from tools.records.csv import read_columns
from tools.records.data import CHANNEL_COLUMNS, METRICS, TRUTH_COLUMNS
from tools.records.read import read_run_folder
from tools.records.shoal_data import Hearing
from tools.report.shoal_page import render_shoal
from tools.report.shoal_paths import paths_picture
from tools.shoal import ShoalBench
from tools.shoal.whole import nearest

ROBOTS = ("fish01", "fish02", "fish03")
SETS = ("--set", "shoal.robots=3", "--set", "shoal.spi_vcd=[2]")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("shoal") / "run"
    assert main(["run", "shoal", *SETS, "--duration", "3", "--quiet", "--out", str(place)]) == 0
    return place


def test_the_folder_has_the_files_of_the_contract(folder: Path) -> None:
    whole = {"scenario.toml", "summary.json", "radio.pcap", "report.html", "path.svg"}
    assert {entry.name for entry in folder.iterdir()} == whole | set(ROBOTS)
    for name in ROBOTS:
        tables = {"channels.csv", "truth.csv"} | ({"spi.vcd"} if name == "fish02" else set())
        assert {entry.name for entry in (folder / name).iterdir()} == tables


def test_a_robots_tables_are_those_of_one_robot(folder: Path) -> None:
    for name in ROBOTS:
        for file, columns in (("channels.csv", CHANNEL_COLUMNS), ("truth.csv", TRUTH_COLUMNS)):
            head = (folder / name / file).read_text(encoding="utf-8").partition("\n")[0]
            assert tuple(head.split(","))[: len(columns)] == columns
        truth = read_columns(folder / name / "truth.csv")
        assert truth["time_s"].value == pytest.approx(np.arange(31) * 0.1)


def test_the_summary_has_metrics_for_each_robot_and_for_all(folder: Path) -> None:
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    metrics = summary["metrics"]
    assert list(metrics) == [*ROBOTS, "shoal"]
    for name in ROBOTS:
        assert set(METRICS) <= set(metrics[name])
    assert metrics["shoal"]["robots"] == 3
    energies = [metrics[name]["energy_j"] for name in ROBOTS]
    assert metrics["shoal"]["energy_j"] == pytest.approx(sum(energies))
    assert len(summary["trace_sha256"]) == 64


def test_the_capture_holds_every_frame_of_all(folder: Path) -> None:
    """Frames are counted by the records' own lengths (libpcap's file format)."""
    octets = (folder / "radio.pcap").read_bytes()
    position, frames = 24, 0
    while position < len(octets):
        position += 16 + struct.unpack_from("<I", octets, position + 8)[0]
        frames += 1
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert frames == summary["metrics"]["shoal"]["radio_frames"]


def test_a_waveform_has_the_wires_of_its_robot(folder: Path) -> None:
    text = (folder / "fish02" / "spi.vcd").read_text(encoding="ascii")
    for wire in ("SCK", "MOSI", "MISO", "CS", "READY"):
        assert f" {wire} $end" in text
    assert text.count("\n#") > 1000


def test_replay_finds_the_same_trace(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["same"] is True
    summary = folder / "summary.json"
    text = summary.read_text(encoding="utf-8")
    told = json.loads(text)
    told["trace_sha256"] = "0" * 64
    summary.write_text(json.dumps(told), encoding="utf-8")
    assert main(["replay", str(folder), "--quiet"]) == 1
    summary.write_text(text, encoding="utf-8")


def test_a_later_run_takes_the_place_of_a_larger_one(folder: Path, tmp_path: Path) -> None:
    place = tmp_path / "run"
    command = ["run", "shoal", "--duration", "0.2", "--quiet", "--out", str(place)]
    assert main([*command, "--set", "shoal.robots=2"]) == 0
    assert (place / "fish02").is_dir()
    assert main([*command, "--set", "shoal.robots=1"]) == 0
    assert (place / "fish01" / "truth.csv").is_file()
    assert not (place / "fish02").exists()
    (place / "fish01" / "notes.txt").write_text("mine", encoding="utf-8")
    assert main(command) == 2
    assert (place / "fish01" / "notes.txt").read_text(encoding="utf-8") == "mine"


def test_json_and_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["run", "shoal", "--set", "shoal.robots=2", "--duration", "0.5"]
    assert main([*command, "--json", "--out", str(tmp_path / "a")]) == 0
    assert list(json.loads(capsys.readouterr().out)["metrics"]) == ["fish01", "fish02", "shoal"]
    assert main([*command, "--out", str(tmp_path / "b")]) == 0
    out = capsys.readouterr().out
    assert "robots      2" in out
    assert "cm between two" in out


def test_it_is_not_read_as_the_run_of_one(folder: Path) -> None:
    with pytest.raises(RunFolderError, match="each robot's tables are in its folder"):
        read_run_folder(folder)


class _Balanced(HTMLParser):
    """Follows tags; `open` is empty where each was closed."""

    VOID = ("meta", "br")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.headings: list[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: Any) -> None:
        """Nothing is open after it."""

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)


def test_the_report_is_whole_and_shows_what_a_shoal_has(folder: Path) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    parser = _Balanced()
    parser.feed(page)
    assert parser.open == []
    assert parser.headings == ["Motion", "Who heard whom", "Energy", "Robots", "Events"]
    for name in ROBOTS:
        assert f"<td>{name}</td>" in page
    assert "http" not in page.replace("http://www.w3.org", "")
    assert (folder / "path.svg").read_text(encoding="utf-8").startswith("<svg xmlns=")


@pytest.mark.parametrize("robots", [1, 60])
def test_a_report_of_one_and_of_many(robots: int) -> None:
    sets = (f"shoal.robots={min(robots, 2)}",)
    bench = ShoalBench.from_scenario(scenario.load("shoal", sets, duration_s=0.3))
    bench.run(lambda seconds: None, lambda: False)
    data = bench.run_data()
    if robots > 2:  # the same two many times: what is looked at is the page
        many = tuple(
            replace(data.robots[n % 2], name=f"fish{n + 1:02d}", address=n + 1)
            for n in range(robots)
        )
        names = (*(robot.name for robot in many), "base")
        heard = np.full((robots + 1, robots + 1), 3)
        sent = np.full(robots + 1, 4)
        data = replace(data, robots=many, hearing=Hearing(names, sent, heard))
    parser = _Balanced()
    parser.feed(render_shoal(data))
    assert parser.open == []
    assert paths_picture(data).count("<path") > robots


def test_the_reception_ratio_is_of_what_was_sent() -> None:
    sent, heard = np.array([4, 0, 10]), np.array([[0, 1, 4], [0, 0, 0], [5, 10, 0]])
    ratio = Hearing(("fish01", "fish02", "base"), sent, heard).ratio()
    np.testing.assert_array_equal(
        ratio, [[np.nan, 0.25, 1.0], [np.nan, np.nan, np.nan], [0.5, 1.0, np.nan]]
    )


def test_the_least_distance_is_the_least_of_all_pairs_at_all_times() -> None:
    """Against every pair and moment, one by one."""
    bench = ShoalBench.from_scenario(scenario.load("shoal", ("shoal.robots=2",), duration_s=0.2))
    (one, _) = bench.run_data().robots
    chance = np.random.default_rng(7)
    time = np.arange(20) * 0.1
    robots = [
        replace(
            one,
            address=n + 1,
            truth={"time_s": time, "x_m": chance.random(20), "y_m": chance.random(20)},
        )
        for n in range(5)
    ]
    expected = min(
        (
            float(np.hypot(*(a.truth[axis][k] - b.truth[axis][k] for axis in ("x_m", "y_m")))),
            float(time[k]),
            (a.address, b.address),
        )
        for i, a in enumerate(robots)
        for b in robots[i + 1 :]
        for k in range(20)
    )
    assert nearest(robots) == expected
    assert nearest(robots[:1]) == (None, None, (None, None))
