"""FILE.partial: what a sweep has computed so far, so that nothing is computed twice.

A line of JSON for each point, on the disk before the next is taken. The first line says which sweep
it is of: a digest of its definition and of the sources, because results of two versions must not
end in one table. A line that was torn by a power cut is dropped and its point computed again; so
is a point that was given up because its processes died. One process writes at a time.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from tools.errors import UserError

if sys.platform != "win32":  # there, two sweeps with one journal are not noticed
    import fcntl

FORM = 1
"""Of the journal."""
BEGIN = b'{"fishbed_sweep": '
"""Of its first line: what begins otherwise is somebody's file, and is left alone."""


class JournalError(UserError, OSError):
    """A journal cannot be read or written, or is not this sweep's."""


class Journal:
    """Use as a context manager; `records` are those that an earlier sweep has left."""

    def __init__(self, path: Path, header: Mapping[str, Any], *, restart: bool = False) -> None:
        """Open the journal, or begin one; raises `JournalError`.

        `header` must hold `definition` and `code`; `restart` drops what is there.
        """
        self.path = path
        self.header = {"fishbed_sweep": FORM, **header}
        self.records: dict[int, dict[str, Any]] = {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self.file: IO[bytes] = path.open("a+b")
        except OSError as error:
            raise JournalError(f"{path}: cannot be written: {error.strerror}") from error
        try:
            self._lock()
            self._read(restart)
        except BaseException:
            self.file.close()
            raise

    def add(self, point: int, record: Mapping[str, Any]) -> None:
        """Write one point; it is on the disk when this returns."""
        self.records[point] = dict(record)  # first: Ctrl-C may come while the disk is waited for
        self._append({"point": point, "record": record})

    def remove(self) -> None:
        """Take the journal away: everything of it is in the table."""
        self.path.unlink(missing_ok=True)

    def _lock(self) -> None:
        if sys.platform == "win32":
            return
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise JournalError(f"{self.path}: another sweep is writing it just now") from None

    def _read(self, restart: bool) -> None:
        """Read what is there, cut off what is torn; an empty journal gets its header."""
        self.file.seek(0)
        content = self.file.read()
        if content[: len(BEGIN)] != BEGIN[: len(content)]:
            raise JournalError(f"{self.path}: is no journal of a sweep; name another --out")
        whole, _, torn = content.rpartition(b"\n")
        if restart or not whole:
            self.file.truncate(0)
            self._append(self.header)
            return
        if torn:
            self.file.truncate(len(whole) + 1)
        header, *lines = whole.split(b"\n")
        self._check(_parsed(header))
        for line in lines:
            entry = _parsed(line)
            with contextlib.suppress(KeyError, TypeError):  # a line that a disk has spoilt
                if not entry["record"].get("given_up"):
                    self.records[int(entry["point"])] = entry["record"]

    def _check(self, header: Mapping[str, Any]) -> None:
        if header == self.header:
            return
        points = f"{header.get('points')} points of {header.get('scenario')}"
        if header.get("definition") != self.header["definition"]:
            what = f"another sweep is unfinished there ({points})"
        else:
            what = f"it was begun with other sources of fishbed ({header.get('version')})"
        raise JournalError(
            f"{self.path}: {what}; name another --out, or drop its results with --restart"
        )

    def _append(self, entry: Mapping[str, Any]) -> None:
        try:
            self.file.write(json.dumps(entry, allow_nan=False).encode() + b"\n")
            self.file.flush()
            os.fsync(self.file.fileno())
        except OSError as error:
            raise JournalError(f"{self.path}: cannot be written: {error.strerror}") from error

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.file.close()


def _parsed(line: bytes) -> dict[str, Any]:
    """A line as data; empty where it is none."""
    try:
        entry = json.loads(line)
    except ValueError:
        return {}
    return entry if isinstance(entry, dict) else {}
