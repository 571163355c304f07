"""An experiment: the model that is believed, and the runs that were measured.

Read from a folder with `experiment.toml`, from a run folder of an emulated robot or one with real
boards (or a folder of several), or from one table. Nothing is written, nothing is changed.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec
import numpy as np

from plant.errors import InvalidParameterError
from plant.parameters import PlantParameters
from tools import scenario
from tools.configuration import Effects, Scenario
from tools.diagnosis.data.course import check_course
from tools.diagnosis.data.csv import Table, read_table
from tools.diagnosis.data.description import (
    BELIEVED,
    Description,
    believed_scenario,
    read_description,
)
from tools.diagnosis.data.notice import DataError, Notice
from tools.diagnosis.data.pieces import at_silences, pieces
from tools.diagnosis.data.screen import (
    LEAST_S,
    Reading,
    Recorded,
    recorded,
)
from tools.diagnosis.data.steady_table import COLUMNS as STEADY
from tools.diagnosis.data.steady_table import steady_runs
from tools.diagnosis.data.units import check_units
from tools.diagnosis.fish.believed import Wrong, believing
from tools.diagnosis.fish.channels import NAMES
from tools.diagnosis.fish.inputs import FishInputs, in_motion
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.fish.pulses import followed
from tools.diagnosis.fish.scatter import Scatter
from tools.diagnosis.fish.setup import Setup
from tools.diagnosis.fish.steady import CAUSES_OF_STEADY_MOTION, SteadyModel, scatter_of
from tools.diagnosis.model import Run
from tools.effects import INSTRUMENTS

FILE = "experiment.toml"

FEW = 5
"""With fewer degrees of freedom a table's own scatter says little."""


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

    @property
    def wrong(self) -> Wrong:
        """Effects of instruments, clock and link that are believed."""
        return _wrong(self.config)


def _wrong(config: Scenario) -> Wrong:
    effects = msgspec.to_builtins(config.effects)
    return {name: effects[name] for name in INSTRUMENTS}


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
    document = read_description(file)
    folder = file.parent
    config = believed_scenario(file, document)
    readings, sigmas = document.readings, document.sigmas
    notices: list[Notice] = []
    tables = [read_table(folder / run.file, notices) for run in document.runs]
    _check_named(file, document, tables, notices)
    steady = [_is_steady(table, readings) for table in tables]
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


def _from_tables(place: Path, files: Sequence[Path], config: Scenario) -> Experiment:
    """One table: steady motion, or a single run."""
    notices = [Notice("believed", f"{place.name}: compared with the bundled model {BELIEVED}")]
    tables = [read_table(file, notices) for file in files]
    if all(_is_steady(table, {}) for table in tables):
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
    readings: Mapping[str, Reading],
    notices: list[Notice],
) -> Experiment:
    """Make runs of the rows of steady-state tables."""
    readings = _true_sizes(config, readings, notices)
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


def _true_sizes(
    config: Scenario, readings: Mapping[str, Reading], notices: list[Notice]
) -> dict[str, Reading]:
    """Return readings that take the believed errors of camera and clock out of a table's numbers.

    Standard deviations have the unit of what they are of.
    """
    setup = believing(Setup(_plant(config)), _wrong(config))
    scale, clock = 1.0 + setup.camera_scale, 1.0 + setup.clock_drift
    made = dict(readings)
    for name, size in zip(STEADY, (scale, clock, scale / clock), strict=True):
        own = readings.get(name) or Reading(name)
        sd = readings.get(f"{name}_sd") or Reading(f"{name}_sd", own.scale)
        made[name] = replace(own, scale=own.scale / size)
        made[f"{name}_sd"] = replace(sd, scale=sd.scale / size)
    believed = [name for name, numbers in _wrong(config).items() if any(numbers.values())]
    for name in believed:
        used = name in CAUSES_OF_STEADY_MOTION
        says = "is taken out of the table's numbers" if used else "has no part in steady motion"
        notices.append(Notice("believed", f"effects.{name}: is believed, and {says}"))
    return made


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


def _is_steady(table: Table, readings: Mapping[str, Reading]) -> bool:
    """Whether a table is one of steady motion: it has no times, and some size of a motion."""

    def holds(name: str) -> bool:
        return (readings.get(name) or Reading(name)).column in table.columns

    return not holds("time_s") and any(holds(name) for name in STEADY)


def _check_named(
    file: Path, document: Description, tables: Sequence[Table], notices: list[Notice]
) -> None:
    """Say which columns that `[channels.X]` names are missing; refuse one that no file has."""
    for name, reading in document.readings.items():
        without = [table.name for table in tables if reading.column not in table.columns]
        if not without:
            continue
        text = f"[channels.{name}]: no column {reading.column}"
        if document.channels[name].column is not None and len(without) == len(tables):
            close = difflib.get_close_matches(reading.column, tables[0].columns, n=1, cutoff=0.6)
            hint = f" (is it {close[0]}?)" if close else ""
            raise DataError(
                f"{file}: [channels.{name}] column = {reading.column!r}: no file has such a "
                f"column{hint}; there are {', '.join(tables[0].columns)}"
            )
        notices.append(Notice("no column", f"{text} in {', '.join(without)}"))


_RECORD = f"record {LEAST_S:g} s at least, better 30"


def _why(notices: Sequence[Notice]) -> str:
    """Return why the first run was left out."""
    return next((f" ({notice.text})" for notice in notices if notice.kind == "short"), "")


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
        raise DataError(f"{place}: no run is long enough to be used; {_RECORD}{_why(notices)}")
    measured = tuple(name for name in NAMES if any(name in run.channels for run, _, _ in runs))
    made = [_run(run, at_rest, held_out, measured, config) for run, at_rest, held_out in runs]
    for run in made:
        check_course(run, measured, notices)
    made = [piece for run in made for piece in at_silences(run, notices)]
    if not made:
        raise DataError(f"{place}: no run is long enough to be used; {_RECORD}")
    if len(made) == 1:
        made = pieces(made[0], notices)
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
    told = None
    if run.told and not (ideal and run.beats):
        told = run.told.time_s, run.told.value
    if told and not ideal:
        step_s, drift_ppm = config.plant.step_s, config.navboard.clock_drift_ppm
        told = followed(*told, step_s, drift_ppm, at_rest=at_rest)
        if not at_rest:
            told = in_motion(*told)
    return Run(
        run.name,
        time_s[order],
        np.concatenate(indices)[order],
        np.concatenate(values)[order],
        FishInputs(
            run.programme,
            told[0] if told else None,
            told[1] if told else None,
            run.supply_v,
        ),
        at_rest,
        held_out,
        sealed=held_out is True,
    )


def fish_model(experiment: Experiment) -> FishModel:
    """Return the model of an experiment's runs, as it is believed.

    Raises ``DataError`` where a channel is in another unit, which only the model can tell.
    """
    control_hz = experiment.config.navboard.control_hz if experiment.boards else None
    model = FishModel(
        experiment.plant,
        experiment.channels,
        experiment.sigmas,
        control_hz=control_hz,
        wrong=experiment.wrong,
    )
    check_units(model, experiment.runs)
    return model


def believed_model(experiment: Experiment) -> FishModel | SteadyModel:
    """Return the model of what was measured: runs, or steady motion."""
    if experiment.steady:
        return SteadyModel(experiment.plant, sorted(experiment.known), experiment.shares)
    return fish_model(experiment)
