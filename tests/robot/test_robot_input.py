"""Wrong input: one line that says where and what is allowed, exit 2, and nothing is written.

`test_every_number_at_its_bounds` asks every numeric key of a scenario for its limits and for values
that nobody wants: each is either refused in one line, or the robot runs with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tools import scenario
from tools.bench import Bench
from tools.cli import main
from tools.configuration import Scenario
from tools.errors import UserError

# Key and value → what the one line must hold: where it is, and what is allowed there.
REFUSED = {
    "plant.body.mas_kg=0.3": ("plant.body.mas_kg", "did you mean plant.body.mass_kg"),
    "body.mass_kg=0.3": ("body", "no such key"),
    "fish=3": ("fish", "no such key"),
    "plant.body.mass_g=311": ("plant.body.mass_g", "plant.body.mass_kg", "SI units"),
    "procboard.tail_beat.bias_deg=20": ("procboard.tail_beat.bias_deg", "bias_rad"),
    "procboard.tail_beat.frequency_rpm=54": ("frequency_rpm", "frequency_hz"),
    'plant.body.mass_kg="heavy"': ("plant.body.mass_kg", "must be a number > 0"),
    'plant.body.mass_kg="0.3 kg"': ("plant.body.mass_kg", "must be a number > 0"),
    "plant.body.mass_kg=true": ("plant.body.mass_kg", "must be a number > 0"),
    "plant.body=3": ("plant.body", "must be a table"),
    "camera.frames_per_s=29.97": ("camera.frames_per_s", "must be a whole number"),
    "camera.fitted=1": ("camera.fitted", "must be true or false"),
    "scenario.name=3": ("scenario.name", "must be a text"),
    "tank.size_m=[1.0]": ("tank.size_m", "2 elements"),
    "plant.body.mass_kg=0": ("plant.body.mass_kg", "> 0"),
    "plant.body.mass_kg=-0.3": ("plant.body.mass_kg = -0.3", "> 0"),
    "plant.body.mass_kg=inf": ("plant.body.mass_kg", "finite"),
    "plant.body.mass_kg=nan": ("plant.body.mass_kg", "finite"),
    "radio.channel=27": ("radio.channel = 27", ">= 11", "<= 26"),
    "radio.loss_probability=1.2": ("radio.loss_probability", ">= 0", "<= 1"),
    "radio.tx_power_dbm=3": ("radio.tx_power_dbm", "must be one of 0"),
    "link.bit_error_rate=0.9": ("link.bit_error_rate",),
    "procboard.application=dance": ("procboard.application", "open-loop"),
    'navboard.gps.sentences=["ABC"]': ("navboard.gps.sentences", "RMC"),
    "scenario.duration_s=-1": ("scenario.duration_s", "> 0"),
    "scenario.seed=-1": ("scenario.seed", ">= 0"),
    "scenario.seed=1.5": ("scenario.seed", "whole number"),
    "initial.x_m=100": ("initial.x_m = 100", "must lie in the tank"),
    "procboard.tail_beat.amplitude_rad=15": ("amplitude_rad = 15", "1.57"),
    "faults.supply_cuts=[{at_s=1}]": ("faults.supply_cuts[0].duration_s", "missing"),
    "faults.supply_cuts[0].at_s=1": ("faults.supply_cuts[0]",),
    "base_station.tail_beats=[{at_s=1, bias_deg=3}]": ("tail_beats[0].bias_deg", "bias_rad"),
    "plant.body.mass_kg": ("KEY=VALUE",),
    "plant.body.mass_kg=": ("KEY=VALUE",),
    "=3": ("KEY=VALUE",),
    "plant.body.mass_kg=0,3": ("plant.body.mass_kg",),
    "plant.body.mass_kg=[": ("plant.body.mass_kg",),
}

COMMANDS = {
    ("run", "nowhere"): "no scenario of this name",
    ("run", "swim-foward"): "did you mean swim-forward?",
    ("run", "missing.toml"): "missing.toml: cannot be read: No such file",
    ("run", "."): "cannot be read",
    ("run", "--duration", "-5"): "must be above 0",
    ("run", "--duration", "0"): "must be above 0",
    ("run", "--duration", "ten"): "no number",
    ("run", "--duration", "1e12"): "scenario.duration_s",
    ("run", "--seed", "-3"): "scenario.seed",
    ("run", "--speed", "-1"): "must be above 0",
    ("run", "--out", "/proc/nowhere/run"): "/proc/nowhere/run: cannot be written",
    ("run", "--out", "/dev/null/run"): "/dev/null/run: cannot be written",
    ("run", "--out", "taken.txt"): "taken.txt: is a file",
    ("run", "--out", "papers"): "papers: holds other files",
    ("replay", "papers"): "papers: no run folder",
    ("run", "broken.toml"): "broken.toml: not valid TOML",
    ("run", "binary.toml"): "binary.toml: not a text file in UTF-8",
    ("run", "wrong.toml"): "wrong.toml: plant.body.mass_kg",
    ("run", "circular.toml"): "goes round in a circle",
    ("run", "orphan.toml"): "no scenario of this name",
}


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with files of all kinds in it."""
    (tmp_path / "taken.txt").write_text("mine", encoding="utf-8")
    (tmp_path / "papers").mkdir()
    (tmp_path / "papers" / "thesis.tex").write_text("years of work", encoding="utf-8")
    (tmp_path / "broken.toml").write_text("[plant\nbody = 3", encoding="utf-8")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00\x01")
    (tmp_path / "wrong.toml").write_text("[plant.body]\nmass_kg = -1\n", encoding="utf-8")
    (tmp_path / "circular.toml").write_text('base = "circular.toml"\n', encoding="utf-8")
    (tmp_path / "orphan.toml").write_text('base = "no-such"\n', encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else b""
        for path in sorted(folder.rglob("*"))
    }


def complaint(arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> str:
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("fishbed: ")
    assert said.err.count("\n") == 1
    return said.err


@pytest.mark.parametrize("text", REFUSED)
def test_a_wrong_key_or_value_is_refused_in_one_line(
    text: str, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents(workplace)
    line = complaint(("run", "--set", text), capsys)
    for words in REFUSED[text]:
        assert words in line
    assert "--set" in line
    assert contents(workplace) == before


@pytest.mark.parametrize("arguments", COMMANDS, ids=" ".join)
def test_a_wrong_command_line_is_refused_in_one_line(
    arguments: tuple[str, ...], workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents(workplace)
    assert COMMANDS[arguments] in complaint(arguments, capsys)
    assert contents(workplace) == before


def test_from_outside_it_is_the_same(fishbed: Callable[..., Any], tmp_path: Path) -> None:
    done = fishbed("run", "--set", "plant.body.mass_kg=-1", cwd=tmp_path)
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert list(tmp_path.iterdir()) == []


# --- every key ------------------------------------------------------------------------------

ODD = (-1e6, 0.0, 1e-9, 1e6)
COSTLY = {"scenario.duration_s", "camera.frames_per_s", "plant.step_s"}
"""Keys whose large values are right and only take long."""


def numeric_keys(config: Scenario) -> Iterator[str]:
    for key, value in scenario.keys(config).items():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if number and "[" not in key and key not in COSTLY:
            yield key


def candidates(key: str, whole: bool) -> Iterator[str]:
    path = tuple(key.split("."))
    declared = scenario.field_types(path[:-1])[path[-1]]
    for meta in getattr(declared, "__metadata__", ()):
        for name in ("ge", "gt", "le", "lt"):
            limit = getattr(meta, name, None)
            if limit is not None:
                yield f"{key}={int(limit) if whole else float(limit)!r}"
    yield f"{key}={scenario.keys(scenario.load())[key]}"
    for odd in ODD:
        yield f"{key}={int(odd) if whole else odd!r}"


NUMERIC = tuple(numeric_keys(scenario.load()))


@pytest.mark.parametrize("key", NUMERIC)
def test_every_number_at_its_bounds_runs_or_is_refused_in_one_line(key: str) -> None:
    whole = isinstance(scenario.keys(scenario.load())[key], int)
    fitted = ("navboard.gps.fitted=true", "navboard.tail_potentiometer.fitted=true")
    ran = 0
    for text in dict.fromkeys(candidates(key, whole)):
        try:
            config = scenario.load("swim-forward", (*fitted, text), duration_s=0.15)
            bench = Bench.from_scenario(config)
            bench.run(lambda _seconds: None, lambda: False)
            data = bench.run_data()
        except UserError as error:
            line = str(error)
        else:
            line = ""
            ran += 1
            assert len(data.trace_sha256) == 64
        assert "\n" not in line
        assert len(line) < 300
    assert ran > 0, "no value at all was taken"
