"""An experiment: the model that is believed, and the runs that were measured.

Read from a folder with `experiment.toml`, from a run folder of an emulated robot or one with real
boards (or a folder of several), or from one table. Nothing is written, nothing is changed.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from plant.errors import InvalidParameterError
from plant.parameters import PlantParameters
from plant.tail_input import TailProgramme
from tools import scenario
from tools.configuration import Effects, Scenario
from tools.diagnosis.data.csv import Table, read_table
from tools.diagnosis.data.notice import DataError, Notice
from tools.diagnosis.data.screen import (
    BEAT_COLUMNS,
    LEAST_S,
    Reading,
    Recorded,
    Samples,
    recorded,
)
from tools.diagnosis.data.steady_table import COLUMNS as STEADY
from tools.diagnosis.data.steady_table import steady_runs
from tools.diagnosis.data.units import check_units
from tools.diagnosis.fish.channels import NAMES
from tools.diagnosis.fish.inputs import FishInputs
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.fish.pulses import followed
from tools.diagnosis.fish.scatter import Scatter
from tools.diagnosis.fish.steady import SteadyModel, scatter_of
from tools.diagnosis.model import Run
from tools.errors import ScenarioError

FILE = "experiment.toml"
BELIEVED = "wang2014"
"""What a table alone is compared with."""

FEW = 5
"""With fewer degrees of freedom a table's own scatter says little."""

PIECES = 4
"""A single run is cut into so many, as long as each of them is long enough."""
_LEAST_PIECE_S = 3.0 * LEAST_S


class _Run(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    file: str
    start: Annotated[str, Meta(pattern="^(rest|unknown)$")] = "rest"
    held_out: bool | None = None


class _Channel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    sigma: Annotated[float, Meta(gt=0)] | None = None
    column: str | None = None
    scale: float = 1.0


class _Experiment(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    name: str = ""
    scenario: str = BELIEVED
    set: dict[str, str | float | int | bool | list[float]] = {}
    runs: list[_Run] = []
    channels: dict[str, _Channel] = {}


@dataclass(frozen=True, slots=True)
class Experiment:
    """Measured data and the model that is believed.

    ``channels``: names of those that were measured, in the order of the runs' indices; ``sigmas``:
    noise that the user gave. ``steady``: the runs are rows of steady-state tables; ``known``: those
    of its channels that came with standard deviations; ``shares``: the scatter of the others as a
    share of their values, by channel. ``boards``: the robot's own boards recorded the runs.
    """

    name: str
    place: Path
    config: Scenario
    runs: tuple[Run, ...]
    channels: tuple[str, ...]
    sigmas: dict[str, float]
    notices: tuple[Notice, ...]
    steady: bool = False
    known: frozenset[int] = frozenset()
    shares: Mapping[int, float] = field(default_factory=dict)
    boards: bool = False

    @property
    def plant(self) -> PlantParameters:
        """The robot that is believed."""
        return _plant(self.config)


def _plant(config: Scenario) -> PlantParameters:
    from tools.bench.model import plant_parameters

    return plant_parameters(config)


def read_experiment(place: Path) -> Experiment:
    """Read an experiment; raises ``UserError`` with one line for what cannot be used."""
    from tools.records.folder import is_run_folder

    if place.is_file() and place.suffix == ".toml":
        return _from_toml(place)
    if place.is_file():
        return _from_tables(place, [place], scenario.load(BELIEVED))
    if not place.is_dir():
        raise DataError(f"{place}: there is no such folder or file")
    if (place / FILE).is_file():
        return _from_toml(place / FILE)
    if is_run_folder(place):
        return _from_run_folders(place, [place])
    inside = sorted(folder for folder in place.iterdir() if is_run_folder(folder))
    if inside:
        return _from_run_folders(place, inside)
    raise DataError(
        f"{place}: holds no {FILE} and no run folder; write {FILE} (scenario and [[runs]]), or "
        "name a folder that `fishbed run` has written"
    )


def _from_toml(file: Path) -> Experiment:
    try:
        data = tomllib.loads(file.read_text(encoding="utf-8"))
        document = msgspec.convert(data, _Experiment)
    except tomllib.TOMLDecodeError as error:
        raise DataError(f"{file}: not valid TOML: {error}") from None
    except UnicodeDecodeError:
        raise DataError(f"{file}: not a text file in UTF-8") from None
    except msgspec.ValidationError as error:
        raise DataError(f"{file}: {_plainly(str(error))}") from None
    if not document.runs:
        raise DataError(f'{file}: names no run; add [[runs]] with file = "run01.csv"')
    folder = file.parent
    config = _believed(file, document)
    known = ("time_s", *BEAT_COLUMNS, "tail_command_rad", "battery_v", *NAMES, *STEADY)
    for name in document.channels:
        if name not in known:
            raise DataError(
                f"{file}: [channels.{name}]: no such channel; there are {', '.join(known)}"
            )
    readings = {
        name: Reading(channel.column or name, channel.scale)
        for name, channel in document.channels.items()
    }
    sigmas = {name: c.sigma for name, c in document.channels.items() if c.sigma is not None}
    notices: list[Notice] = []
    tables = []
    for run in document.runs:
        path = folder / run.file
        if not path.is_file():
            raise DataError(f"{file}: [[runs]] file = {run.file!r}: there is no such file")
        tables.append(read_table(path, notices))
    steady = [_is_steady(table) for table in tables]
    name = document.name or folder.resolve().name
    if all(steady):
        return _steady(name, folder, config, tables, readings, notices)
    if any(steady):
        wrong = tables[steady.index(True)].name
        raise DataError(f"{file}: {wrong} is a steady-state table among runs; diagnose it alone")
    runs = []
    for declared, table in zip(document.runs, tables, strict=True):
        made = recorded(table, NAMES, readings, notices)
        if made is not None:
            runs.append((made, declared.start == "rest", declared.held_out))
    return _assembled(name, folder, config, runs, sigmas, notices)


def _believed(file: Path, document: _Experiment) -> Scenario:
    """Load the believed scenario, a bundled one or a file beside the experiment."""
    source: str | Path = document.scenario
    if document.scenario not in scenario.bundled() and not Path(source).is_absolute():
        source = file.parent / document.scenario
    sets = [f"{key}={_toml(value)}" for key, value in document.set.items()]
    try:
        return scenario.load(source, sets)
    except ScenarioError as error:
        text = str(error).replace("--set", "[set]")
        raise ScenarioError(f"{file}: {text}") from None


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f'"{value}"'
    return repr(value)


def _plainly(message: str) -> str:
    """Turn msgspec's words into a line with the path."""
    what, _, where = message.partition(" - at `$")
    path = where.rstrip("`").lstrip(".")
    return f"{path}: {what[0].lower() + what[1:]}" if path else what


def _from_tables(place: Path, files: Sequence[Path], config: Scenario) -> Experiment:
    """One table: steady motion, or a single run."""
    notices = [Notice("believed", f"{place.name}: compared with the bundled model {BELIEVED}")]
    tables = [read_table(file, notices) for file in files]
    if all(_is_steady(table) for table in tables):
        return _steady(place.stem, place.parent, config, tables, {}, notices)
    runs = []
    for table in tables:
        made = recorded(table, NAMES, {}, notices)
        if made is not None:
            runs.append((made, True, None))
    return _assembled(place.stem, place.parent, config, runs, {}, notices)


def _from_run_folders(place: Path, folders: Sequence[Path]) -> Experiment:
    """Run folders: what their scenario says is believed, but for its named effects."""
    notices: list[Notice] = []
    configs = [scenario.load(folder / "scenario.toml") for folder in folders]
    believed = [_as_believed(config) for config in configs]
    for folder, config in zip(folders[1:], believed[1:], strict=True):
        if config.plant != believed[0].plant or config.tank != believed[0].tank:
            raise DataError(
                f"{folder / 'scenario.toml'}: is about another robot or tank than "
                f"{folders[0] / 'scenario.toml'}; diagnose them apart"
            )
    if configs[0].effects != Effects():
        notices.append(
            Notice(
                "effects",
                f"{folders[0].name}: its [effects] are not believed: they are what may be found",
            )
        )
    runs = []
    for folder in folders:
        table = read_table(folder / "channels.csv", notices)
        table = replace(table, name=f"{folder.name}/channels.csv")
        made = recorded(table, NAMES, {}, notices)
        if made is not None:
            runs.append((made, True, None))
    found = _assembled(place.resolve().name, place, believed[0], runs, {}, notices)
    return replace(found, boards=True)


def _as_believed(config: Scenario) -> Scenario:
    return msgspec.structs.replace(config, effects=Effects())


def _steady(
    name: str,
    place: Path,
    config: Scenario,
    tables: Sequence[Table],
    readings: dict[str, Reading],
    notices: list[Notice],
) -> Experiment:
    """Make runs of the rows of steady-state tables."""
    runs: list[Run] = []
    known: set[int] | None = None
    for table in tables:
        made, given = steady_runs(table, readings, notices)
        runs += made
        known = given if known is None else known & given
    try:
        scatter = scatter_of(_plant(config), runs, known or ())
    except InvalidParameterError as error:
        raise DataError(f"{place}: the believed robot has no steady motion: {error}") from None
    for channel, own in scatter.items():
        notices.append(Notice("scatter", _told_scatter(STEADY[channel], own)))
    return Experiment(
        name,
        place,
        config,
        tuple(runs),
        STEADY,
        {},
        tuple(notices),
        steady=True,
        known=frozenset(known or ()),
        shares={channel: own.share for channel, own in scatter.items()},
    )


def _told_scatter(column: str, own: Scatter) -> str:
    if own.assumed:
        return (
            f"{column}: so few rows do not say how much its numbers scatter; {own.share:.2%} is "
            f"assumed, which {column}_sd would replace"
        )
    text = f"{column}: its numbers scatter by {own.estimate:.2%} around a smooth curve"
    if own.freedom < FEW:
        return (
            f"{text}, of which {own.freedom} degrees of freedom say little: {own.share:.2%} is "
            f"used; measure each beat several times, or give {column}_sd"
        )
    return f"{text}; {own.share:.2%} is used, which {column}_sd would replace"


def _is_steady(table: Table) -> bool:
    return "time_s" not in table.columns and any(name in table.columns for name in STEADY)


def _assembled(
    name: str,
    place: Path,
    config: Scenario,
    runs: Sequence[tuple[Recorded, bool, bool | None]],
    sigmas: dict[str, float],
    notices: list[Notice],
) -> Experiment:
    """Make runs of the model of what was recorded."""
    if not runs:
        raise DataError(
            f"{place}: no run is long enough to be used; record {LEAST_S:g} s at least, better 30"
        )
    measured = tuple(name for name in NAMES if any(name in run.channels for run, _, _ in runs))
    made = [_run(run, at_rest, held_out, measured, config) for run, at_rest, held_out in runs]
    if len(made) == 1:
        made = _pieces(made[0], notices)
    boards = not config.plant.servo.ideal  # the model with a real servo is the one with the boards
    return Experiment(
        name, place, config, tuple(made), measured, sigmas, tuple(notices), boards=boards
    )


def _run(
    run: Recorded, at_rest: bool, held_out: bool | None, names: tuple[str, ...], config: Scenario
) -> Run:
    """Put the channels of a run into one list by time."""
    times, values, indices = [], [], []
    for index, name in enumerate(names):
        samples = run.channels.get(name)
        if samples is not None:
            times.append(samples.time_s)
            values.append(samples.value)
            indices.append(np.full(samples.time_s.size, index, dtype=np.int64))
    time_s = np.concatenate(times)
    order = np.argsort(time_s, kind="stable")
    # an ideal tail does the beats themselves where they are known: a formula has rates
    ideal = config.plant.servo.ideal
    told = None if ideal and run.beats else run.told
    if told and not ideal:
        step_s, drift_ppm = config.plant.step_s, config.navboard.clock_drift_ppm
        told = Samples(*followed(told.time_s, told.value, step_s, drift_ppm))
    return Run(
        run.name,
        time_s[order],
        np.concatenate(indices)[order],
        np.concatenate(values)[order],
        FishInputs(
            run.programme,
            told.time_s if told else None,
            told.value if told else None,
            run.supply_v,
        ),
        at_rest,
        held_out,
    )


def _pieces(run: Run, notices: list[Notice]) -> list[Run]:
    """Cut a single run into several, so that some can be held out; later ones start anywhere."""
    duration_s = float(run.time_s[-1])
    count = min(PIECES, int(duration_s // _LEAST_PIECE_S))
    inputs = run.inputs
    if count < 2 or not isinstance(inputs, FishInputs):
        notices.append(
            Notice(
                "single run",
                f"{run.name}: a single short run: nothing is left to test an explanation on; "
                "record several runs with varied manoeuvres",
            )
        )
        return [run]
    notices.append(
        Notice(
            "single run",
            f"{run.name}: a single run was cut into {count} pieces, so that some of it can be held "
            "out; several runs with varied manoeuvres say more",
        )
    )
    pieces = []
    for k in range(count):
        begin_s, end_s = k * duration_s / count, (k + 1) * duration_s / count
        last = k == count - 1
        inside = (run.time_s >= begin_s) & ((run.time_s < end_s) | last)
        pieces.append(
            Run(
                f"{run.name} {begin_s:.0f}–{end_s:.0f} s",
                run.time_s[inside] - begin_s,
                run.channel[inside],
                run.value[inside],
                later(inputs, begin_s),
                run.at_rest and k == 0,
                run.held_out,
            )
        )
    return pieces


def later(inputs: FishInputs, begin_s: float) -> FishInputs:
    """Return the inputs from a time on, with the phase that the beat has there."""
    programme = inputs.programme
    phase = programme.phase_rad
    beats, starts = [], []
    ends = (*programme.starts_s[1:], float("inf"))
    for beat, start, end in zip(programme.beats, programme.starts_s, ends, strict=True):
        if end <= begin_s:
            phase += 2.0 * np.pi * beat.frequency_hz * (end - start)
            continue
        if start < begin_s:
            phase += 2.0 * np.pi * beat.frequency_hz * (begin_s - start)
        beats.append(beat)
        starts.append(max(0.0, start - begin_s))
    told_s, told_rad = inputs.told_s, inputs.told_rad
    if told_s is not None and told_rad is not None:
        first = max(0, int(np.searchsorted(told_s, begin_s, side="right")) - 1)
        told_s, told_rad = np.maximum(told_s[first:] - begin_s, 0.0), told_rad[first:]
    return FishInputs(
        TailProgramme(tuple(beats), tuple(starts), phase), told_s, told_rad, inputs.supply_v
    )


def fish_model(experiment: Experiment) -> FishModel:
    """Return the model of an experiment's runs, as it is believed.

    Raises ``DataError`` where a channel is in another unit, which only the model can tell.
    """
    control_hz = experiment.config.navboard.control_hz if experiment.boards else None
    model = FishModel(
        experiment.plant, experiment.channels, experiment.sigmas, control_hz=control_hz
    )
    check_units(model, experiment.runs)
    return model


def believed_model(experiment: Experiment) -> FishModel | SteadyModel:
    """Return the model of what was measured: runs, or steady motion."""
    if experiment.steady:
        return SteadyModel(experiment.plant, sorted(experiment.known), experiment.shares)
    return fish_model(experiment)
