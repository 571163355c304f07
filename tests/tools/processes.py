"""Programs in processes of their own, as tests start them, hear them and end them in any case."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PATIENCE_S = 90.0
"""Longest that anything is waited for, on a machine that has better things to do."""


@contextmanager
def python(*args: str, **more: Any) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, *args],
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), "TERM": "xterm", "COLUMNS": "160"},
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **more},
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def program(*args: str, **more: Any) -> AbstractContextManager[subprocess.Popen[str]]:
    """Start `fishbed` with arguments."""
    return python("-m", "tools", *args, **more)


def where(process: subprocess.Popen[str], who: str = "the other board is expected at") -> str:
    """Return the last word of what a program announces: a path, or a port."""
    assert process.stderr is not None
    line = ""
    while not line.startswith(f"fishbed: {who} "):  # it may compile first, and say so
        line = process.stderr.readline()
        assert line, "it ended"
    return line.split()[-1]


def result(process: subprocess.Popen[str]) -> dict[str, Any]:
    """Wait for a program and return its document."""
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, err
    document: dict[str, Any] = json.loads(out)
    return document


def stopped(process: subprocess.Popen[str]) -> dict[str, Any]:
    """End a program as Ctrl-C does and return its document."""
    process.send_signal(signal.SIGINT)
    return result(process)
