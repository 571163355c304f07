"""Nothing that a run does not need is imported: start-up is what a user waits for every time.

Looked at from outside, by Python's own account of what it imports (`-X importtime`).
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOLVERS = ("optimize", "integrate", "interpolate", "signal", "stats")
HEAVY = {"numpy", "numba", "scipy", "matplotlib", "llvmlite"}


def imported(*arguments: str, cwd: Path) -> set[str]:
    """Modules that a command line imports."""
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "tools", *arguments],
        capture_output=True,
        text=True,
        check=True,
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    modules = re.findall(r"^import time: +\d+ \| +\d+ \| +(\S+)$", done.stderr, re.MULTILINE)
    assert len(modules) > 50, "Python's account has another form"
    return set(modules)


@pytest.mark.parametrize(
    "arguments",
    [("--help",), ("run", "--help"), ("--version",), ("list", "scenarios")],
    ids=" ".join,
)
def test_what_computes_nothing_imports_nothing_heavy(
    arguments: tuple[str, ...], tmp_path: Path
) -> None:
    modules = imported(*arguments, cwd=tmp_path)
    assert "tools" in modules
    assert {module.split(".")[0] for module in modules} & HEAVY == set()


def test_a_default_run_imports_no_plots_no_ports_no_solvers(tmp_path: Path) -> None:
    modules = imported("run", "--duration", "0.2", "--quiet", cwd=tmp_path)
    packages = {module.split(".")[0] for module in modules}
    assert {"numpy", "plant", "navboard", "procboard"} <= packages
    assert packages & {"matplotlib", "serial", "can", "rich", "pytest"} == set()
    # Numba itself looks at scipy's version and at its BLAS; nothing asks for more of it.
    assert not {f"scipy.{part}" for part in SOLVERS} & modules
    assert (tmp_path / "runs" / "swim-forward-1" / "summary.json").is_file()
