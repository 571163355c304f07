"""A diagnosis from folder to folder: read, diagnose with progress, write everything at once.

What is written: `diagnosis.json`, `report.html`, and where something was found that a scenario can
express, `extended.toml`. The measured files are only read.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from tools.records.folder import Kind, RunFolder

if TYPE_CHECKING:
    from tools.diagnosis.data.experiment import Experiment
    from tools.diagnosis.model import Progress
    from tools.diagnosis.result import Diagnosis, Report

EXTENDED = "extended.toml"
DIAGNOSIS = Kind(
    "diagnosis",
    ("report.html", EXTENDED, "experiment.toml", "separating.toml", "diagnosis.json"),
    ("report.html", "diagnosis.json"),
)


@dataclass(frozen=True, slots=True)
class Told:
    """What a diagnosis says on stdout: as a document, or in words."""

    json: str
    words: str


def diagnose_folder(place: Path, out: Path, seed: int, *, show_progress: bool) -> Told:
    """Diagnose the experiment at ``place`` into the folder ``out``.

    Raises ``UserError`` for data that cannot be used, and for a folder that cannot be written.
    """
    from tools.diagnosis.calibration import cache_directory
    from tools.diagnosis.data.experiment import believed_model, read_experiment
    from tools.diagnosis.engine import diagnose
    from tools.diagnosis.options import Options
    from tools.diagnosis.page.page import render
    from tools.version import version

    experiment = read_experiment(place)
    with RunFolder(out, DIAGNOSIS) as folder:
        options = Options(seed=seed, cache=cache_directory())
        with _progress(show=show_progress) as report:
            found = diagnose(believed_model(experiment), experiment.runs, options, report)
        found = _with_extended_model(folder, experiment, found)
        remarks = [notice.text for notice in experiment.notices]
        name = experiment.name or place.name
        believed = experiment.config.scenario.name
        text = to_json(found.report)
        folder.write("report.html", render(found, name, believed, remarks, version()))
        folder.write("diagnosis.json", text)
        folder.commit()
    return Told(text, "\n".join(_words(found, remarks, out)))


def _with_extended_model(folder: RunFolder, experiment: Experiment, found: Diagnosis) -> Diagnosis:
    """Write the extended model where a cause was found; what it cannot say is noted."""
    if not found.report.causes:
        return found
    from tools.diagnosis.extended import extended

    made = extended(
        experiment.config, found.after.shared, f"{experiment.config.scenario.name}-extended"
    )
    folder.write(EXTENDED, made.to_toml())
    notes = [
        *found.report.notes,
        *(f"{EXTENDED} cannot say {name}; it holds the rest." for name in made.left_out),
    ]
    report = msgspec.structs.replace(found.report, extended_model=EXTENDED, notes=notes)
    return replace(found, report=report)


def to_json(report: Report) -> str:
    """Return diagnosis.json."""
    return msgspec.json.format(msgspec.json.encode(report), indent=2).decode() + "\n"


def _words(found: Diagnosis, remarks: list[str], out: Path) -> list[str]:
    from tools.diagnosis.page import words

    report = found.report
    lines = [words.headline(report)]
    lines += [f"  note: {remark}" for remark in (*remarks, *report.notes)]
    for cause in report.causes:
        for name, value in cause.parameters.items():
            unit = f" {value.unit}" if value.unit else ""
            lines.append(
                f"  {cause.name}.{name} = {value.estimate:.4g} ± {value.standard_error:.2g}{unit}"
            )
    if worth := words.worth(report):
        lines.append(f"  {worth}")
    lines += [f"  next: {step}" for step in words.next_steps(report)]
    lines.append(f"  report: {out / 'report.html'}")
    return lines


@contextlib.contextmanager
def _progress(*, show: bool) -> Iterator[Progress]:
    """A bar of what is being done, where somebody can see it."""
    if not show or not sys.stderr.isatty():
        yield lambda what, share: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("reading", total=1.0)
        yield lambda what, share: bar.update(task, description=what, completed=share)
