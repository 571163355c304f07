"""A diagnosis from folder to folder: read, diagnose with progress, write everything at once.

What is written: `diagnosis.json`, `report.html`; `extended.toml` where something was found that a
scenario can say; `separating.toml` where a manoeuvre tells apart what these data could not. The
measured files are only read, and the results appear whole or not at all.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from tools.records.folder import Kind, RunFolder

if TYPE_CHECKING:
    from tools.diagnosis.data.experiment import Experiment
    from tools.diagnosis.model import Progress
    from tools.diagnosis.options import Options
    from tools.diagnosis.result import Diagnosis, Report

EXTENDED = "extended.toml"
SEPARATING = "separating.toml"
DIAGNOSIS = Kind(
    "diagnosis",
    ("report.html", EXTENDED, SEPARATING, "diagnosis.json"),
    ("diagnosis.json",),
)


@dataclass(frozen=True, slots=True)
class Told:
    """What a diagnosis says on stdout: as a document, or in words."""

    json: str
    words: str


@dataclass(frozen=True, slots=True)
class Written:
    """A diagnosis with the files that go with it, by their names."""

    found: Diagnosis
    files: dict[str, str]


def default_out(place: Path) -> Path:
    """Return where results go unless told: inside an experiment's folder, else beside the data."""
    from tools.records.folder import is_run_folder

    if place.is_file():
        folder = place.parent
        return folder / ("diagnosis" if place.suffix == ".toml" else f"{place.stem}-diagnosis")
    if is_run_folder(place):
        whole = place.resolve()
        return whole.with_name(f"{whole.name}-diagnosis")
    return place / "diagnosis"


def diagnose_folder(
    place: Path,
    out: Path,
    seed: int,
    *,
    show_progress: bool,
    options: Options | None = None,
) -> Told:
    """Diagnose the experiment at ``place`` into the folder ``out``.

    Where the page cannot be made, which is our fault, the folder is committed without it: a
    diagnosis of minutes is not lost to it. Raises ``UserError`` for data that cannot be used, and
    for a folder that cannot be written.
    """
    from tools.diagnosis.calibration import cache_directory
    from tools.diagnosis.data.experiment import believed_model, read_experiment
    from tools.diagnosis.engine import diagnose
    from tools.diagnosis.options import Options
    from tools.diagnosis.page.page import render
    from tools.version import version

    with _interruptible():
        experiment = read_experiment(place)
        model = believed_model(experiment)
    chosen = replace(options or Options(cache=cache_directory()), seed=seed)
    with _interruptible(), RunFolder(out, DIAGNOSIS) as folder:
        with _progress(show=show_progress) as report:
            found = diagnose(model, experiment.runs, chosen, report)
            report("Designing the next experiment", 0.0)
            written = with_files(found, experiment, chosen)
        found = written.found
        name = experiment.name or place.resolve().name
        text = to_json(found.report)
        for file, content in written.files.items():
            folder.write(file, content)
        folder.write("diagnosis.json", text)
        try:
            page = render(found, name, experiment.config.scenario.name, version())
        except Exception as error:
            folder.commit()
            error.add_note(f"fishbed: the diagnosis is kept without a report in {out}")
            raise
        folder.write("report.html", page)
        folder.commit()
    return Told(text, "\n".join(_words(found, out)))


def with_files(found: Diagnosis, experiment: Experiment, options: Options) -> Written:
    """Return the diagnosis with its extended model, separating experiment and notices."""
    from tools.diagnosis.result import ProposedExperiment

    report = found.report
    files: dict[str, str] = {}
    notes = [notice.text for notice in experiment.notices] + list(report.notes)
    extended_model = None
    text, remark = _extended(found, experiment)
    notes += [note for note in (found.calibration.note, remark) if note]
    if text is not None:
        files[EXTENDED] = text
        extended_model = EXTENDED
    proposed = None
    if report.verdict == "ambiguous":
        from tools.diagnosis.fish.separating import propose

        proposal = propose(found, experiment.config, options)
        if proposal is not None:
            told = SEPARATING if proposal.toml is not None else None
            proposed = ProposedExperiment(proposal.why, told, proposal.separation)
            if proposal.toml is not None:
                files[SEPARATING] = proposal.toml
    whole = msgspec.structs.replace(
        report, notes=notes, extended_model=extended_model, proposed_experiment=proposed
    )
    return Written(replace(found, report=whole), files)


def _extended(found: Diagnosis, experiment: Experiment) -> tuple[str | None, str]:
    """Return extended.toml, or None and why there is none although something was found."""
    from tools.diagnosis.extended import extended
    from tools.errors import ScenarioError

    names = {name.partition(".")[0] for name, value in found.values.items() if value != 0.0}
    if not found.report.causes or not names:
        return None, ""
    try:
        name = f"{experiment.config.scenario.name}-extended"
        model = extended(experiment.config, found.after.shared, name)
    except ScenarioError as error:
        return None, f"No {EXTENDED} was written: {error}"
    said = names - set(model.left_out)
    if not said:
        return None, f"No {EXTENDED} was written: no scenario can say {' or '.join(sorted(names))}."
    remark = ""
    if model.left_out:
        remark = f"{EXTENDED} leaves out {', '.join(model.left_out)}: no scenario can say it."
    return model.to_toml(), remark


def to_json(report: Report) -> str:
    """Return diagnosis.json."""
    return msgspec.json.format(msgspec.json.encode(report), indent=2).decode() + "\n"


def _words(found: Diagnosis, out: Path) -> list[str]:
    from tools.diagnosis.page import words

    report = found.report
    lines = [words.headline(report)]
    lines += [f"  note: {remark}" for remark in report.notes]
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
def _interruptible() -> Iterator[None]:
    """Let Ctrl-C end what compiles: there it may be swallowed, and come out as another error."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    asked = False

    def interrupt(_number: int, _frame: object) -> None:
        nonlocal asked
        asked = True
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    except Exception as error:
        if asked:
            raise KeyboardInterrupt from error
        raise
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def _progress(*, show: bool) -> Iterator[Progress]:
    """A bar of what is being done, where somebody can see it."""
    if not show or not sys.stderr.isatty():
        yield lambda what, share: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("Reading", total=1.0)

        def told(what: str, share: float) -> None:
            # a part that does not know how far it is shows a bar that only moves
            bar.update(task, description=what, completed=share, total=1.0 if share > 0.0 else None)

        yield told
