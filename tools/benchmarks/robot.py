"""The whole robot, and the program as a user meets it."""

from __future__ import annotations

import contextlib
import io
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from tools.benchmarks.measure import Effort, Figures, Row, best_s


def robot(effort: Effort) -> Figures:
    """Whole robot: both boards, byte-level SPI, radio, plant at 1 ms; simulated over wall time."""
    from tools import scenario
    from tools.bench import Bench

    config = scenario.load(duration_s=effort.robot_s)
    Bench.from_scenario(scenario.load(duration_s=1.0)).run(_ignore, _never)
    (best,) = best_s(effort.repeats, lambda: Bench.from_scenario(config).run(_ignore, _never))
    return {"ratio": config.scenario.duration_s / best}


def robot_rows(figures: Figures) -> Sequence[Row]:
    """How much faster than the robot itself."""
    return [Row("whole robot", f"{figures['ratio']:,.0f} × real time", "≥ 50 × real time")]


def files(effort: Effort) -> Figures:
    """The same as a run does it: spi.vcd and radio.pcap are written meanwhile."""
    from tools import scenario
    from tools.execution import execute
    from tools.records.folder import RunFolder

    execute(scenario.load(duration_s=1.0))
    config = scenario.load(duration_s=3.0 * effort.robot_s)
    wall_s = float("inf")
    for _ in range(effort.repeats):
        with tempfile.TemporaryDirectory() as place, RunFolder(Path(place) / "run") as folder:
            wall_s = min(wall_s, execute(config, folder).wall_s)
    return {"ratio": config.scenario.duration_s / wall_s}


def files_rows(figures: Figures) -> Sequence[Row]:
    """As ``robot_rows``."""
    what = "the same, files and comparison included"
    return [Row(what, f"{figures['ratio']:,.0f} × real time")]


def default() -> Figures:
    """Peak memory of the default scenario as a user runs it, report and all, in this process."""
    from tools.cli import main

    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        code = main(["run", "--quiet", "--out", str(Path(folder) / "run")])
    if code:
        raise RuntimeError(f"the default scenario ended with {code}")
    # Linux counts in KiB, macOS in bytes.
    unit = 1 if sys.platform == "darwin" else 1024
    return {"bytes": float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit)}


def shell(effort: Effort) -> Figures:
    """The default scenario and the help from the shell: wall time, s, and memory of the first."""
    command = [sys.executable, "-m", __name__]
    walls, memory = [], 0.0
    for _ in range(effort.repeats):
        begin = time.perf_counter()
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        walls.append(time.perf_counter() - begin)
        memory = max(memory, json.loads(done.stdout)["bytes"])
    command = [sys.executable, "-m", "tools", "--help"]
    (told,) = best_s(
        effort.repeats + 2,
        lambda: subprocess.run(command, check=True, stdout=subprocess.DEVNULL),
    )
    return {"default_s": min(walls), "bytes": memory, "help_s": told}


def shell_rows(figures: Figures) -> Sequence[Row]:
    """Time and memory."""
    return [
        Row("default scenario from the shell", f"{figures['default_s']:.2f} s", "< 10 s"),
        Row("its peak memory", f"{figures['bytes'] / 1e6:.0f} MB", "< 400 MB"),
        Row("fishbed --help", f"{figures['help_s']:.3f} s", "< 0.15 s"),
    ]


def _ignore(seconds: float) -> None:
    """Progress that nobody watches."""


def _never() -> bool:
    return False


if __name__ == "__main__":  # a process of its own, for the memory
    print(json.dumps(default()))
