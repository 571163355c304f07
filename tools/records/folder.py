"""The run folder, and other folders of results: nothing is seen until all of it is there.

Files are written into a hidden folder beside the place they are meant for, and moved there at the
end. So a folder that exists is whole, a killed run leaves the earlier results alone, and a place
that cannot be written is found out before the run, not after it. A folder that holds anything but
a run is never written to: neither are somebody's files lost, nor do they lie among new results.

What a folder holds is a `Kind`, so that other results than runs are kept with the same care. A run
of several robots has a folder below for each, in which are some of the same files.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from tools.errors import RunFolderError
from tools.field_files import COPIES

FILES = (
    "scenario.toml",
    "channels.csv",
    "truth.csv",
    "spi.vcd",
    "radio.pcap",
    "report.html",
    "path.svg",
    "summary.json",  # moved last: it is what makes a folder a run folder
)
OF_A_SURVEY = ("survey.json", "samples.csv", "reconstruction.csv")
MARKS = ("scenario.toml", "summary.json")


@dataclass(frozen=True, slots=True)
class Kind:
    """What a folder of results is called, its files (the last one is moved last), and its marks."""

    name: str
    files: tuple[str, ...]
    marks: tuple[str, ...]
    parts: str = ""
    """Names of folders below that hold some of the same files, as a regular expression."""

    def is_part(self, path: Path) -> bool:
        """Whether a folder is one of those below, with nothing in it that is not ours."""
        named = bool(self.parts) and re.fullmatch(self.parts, path.name) is not None
        if not named or path.is_symlink() or not path.is_dir():
            return False
        return all(entry.name in self.files and not entry.is_dir() for entry in path.iterdir())


RUN = Kind("run", (*COPIES, *OF_A_SURVEY, *FILES), MARKS, r"fish\d{2,}")
"""Copies of the scenario's own files are there where it names some."""


def default_path(scenario: str, seed: int, under: Path = Path("runs")) -> Path:
    """`runs/NAME-SEED`, with a number behind it where that is taken."""
    first = under / f"{scenario}-{seed}"
    path, number = first, 1
    while path.exists():
        number += 1
        path = first.with_name(f"{first.name}.{number}")
    return path


def is_run_folder(path: Path, kind: Kind = RUN) -> bool:
    """Whether a folder holds a run, or results of another kind."""
    return all((path / name).is_file() for name in kind.marks)


class RunFolder:
    """A folder in the making; use as a context manager and call `commit` when all is written."""

    def __init__(self, path: Path, kind: Kind = RUN) -> None:
        """Check the place and make the hidden folder; raises `RunFolderError`."""
        self.path = path
        self.kind = kind
        try:
            refused = _objection(path, kind)
            if not refused:
                parent = path.absolute().parent
                parent.mkdir(parents=True, exist_ok=True)
                self.staging = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=parent))
        except OSError as error:
            raise RunFolderError(f"{path}: cannot be written: {error.strerror}") from error
        if refused:
            raise RunFolderError(f"{path}: {refused}")

    def file(self, name: str) -> Path:
        """Where to write a file of the folder for now; `name` may lie in a folder below."""
        place = self.staging / name
        if place.parent != self.staging:
            place.parent.mkdir(exist_ok=True)
        return place

    def write(self, name: str, text: str) -> None:
        """Write one text file; a full disk is the user's to mend."""
        try:
            self.file(name).write_text(text, encoding="utf-8")
        except OSError as error:
            raise RunFolderError(f"{self.path / name}: cannot be written: {error.strerror}") from (
                error
            )

    def commit(self) -> Path:
        """Move everything to its place; returns the folder."""
        try:
            self.staging.chmod(0o755)  # mkdtemp makes it private
            if not self.path.exists():
                self.staging.rename(self.path)
                return self.path
            for name in reversed(self.kind.files):
                (self.path / name).unlink(missing_ok=True)
            for part in [entry for entry in self.path.iterdir() if self.kind.is_part(entry)]:
                shutil.rmtree(part)
            for file in sorted(self.staging.iterdir(), key=self._place):
                file.replace(self.path / file.name)
        except OSError as error:
            raise RunFolderError(f"{self.path}: cannot be written: {error.strerror}") from error
        return self.path

    def _place(self, file: Path) -> int:
        return self.kind.files.index(file.name) if file.name in self.kind.files else -1

    def __enter__(self) -> RunFolder:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with contextlib.suppress(FileNotFoundError):  # renamed by commit
            shutil.rmtree(self.staging)


def _objection(path: Path, kind: Kind) -> str:
    """Why results must not be written here; empty where they may."""
    if not path.exists():
        above = next(parent for parent in path.absolute().parents if parent.exists())
        return "" if above.is_dir() else f"cannot be written: {above} is a file"
    if not path.is_dir():
        return "is a file; --out wants a folder"
    if any(path.iterdir()) and not is_run_folder(path, kind):
        return f"holds other files and no {kind.name}; name a new or an empty folder"
    foreign = sorted(
        entry.name
        for entry in path.iterdir()
        if entry.name not in kind.files and not kind.is_part(entry)
    )
    if foreign:
        more = f" and {len(foreign) - 1} more" if len(foreign) > 1 else ""
        return f"holds {foreign[0]}{more} beside a {kind.name}; name a new or an empty folder"
    if not os.access(path, os.W_OK | os.X_OK):
        return "cannot be written: Permission denied"
    return ""
