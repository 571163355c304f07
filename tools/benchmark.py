"""How fast it is: `python -m tools.benchmark` prints a table.

A benchmark, not a test: nothing fails on a slow machine. Each row is measured in a process of its
own, so that memory and imports are that row's alone; compiled code is compiled (and cached) before
anything is timed, and the best of several repetitions counts, since a busy machine can only slow
things down.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

WANTED = {
    "robot": "≥ 50 × real time",
    "default": "< 10 s",
    "memory": "< 400 MB",
    "help": "< 0.15 s",
}
"""What the project has set itself; the table shows it beside the measured figure."""


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table."""

    what: str
    measured: str
    wanted: str = ""


def robot() -> dict[str, float]:
    """Whole robot: both boards, byte-level SPI, radio, plant at 1 ms; simulated over wall time."""
    from tools import scenario
    from tools.bench import Bench

    config = scenario.load(duration_s=20.0)
    Bench.from_scenario(scenario.load(duration_s=1.0)).run(_ignore, _never)
    bench = Bench.from_scenario(config)
    begin = time.perf_counter()
    bench.run(_ignore, _never)
    return {"ratio": config.scenario.duration_s / (time.perf_counter() - begin)}


def files() -> dict[str, float]:
    """The same as a run does it: spi.vcd and radio.pcap are written meanwhile."""
    from tools import scenario
    from tools.execution import execute
    from tools.records.folder import RunFolder

    execute(scenario.load(duration_s=1.0))
    config = scenario.load(duration_s=60.0)
    with tempfile.TemporaryDirectory() as place, RunFolder(Path(place) / "run") as folder:
        data = execute(config, folder)
    return {"ratio": config.scenario.duration_s / data.wall_s}


def plant() -> dict[str, float]:
    """The plant alone with an ideal servo at 1 ms."""
    from plant.integrate import simulate
    from plant.parameters import wang2014
    from plant.tail_input import TailBeat, TailProgramme

    beat = TailBeat(bias_rad=0.0, amplitude_rad=0.2617993877991494, frequency_hz=0.9)
    programme = TailProgramme.steady(beat)
    simulate(wang2014(), programme, 1.0)
    begin = time.perf_counter()
    simulate(wang2014(), programme, 300.0)
    return {"ratio": 300.0 / (time.perf_counter() - begin)}


def default() -> dict[str, float]:
    """The default scenario as a user runs it, in this process: folder, report and all."""
    import resource

    from tools.cli import main

    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        code = main(["run", "--quiet", "--out", str(Path(folder) / "run")])
    if code:
        raise RuntimeError(f"the default scenario ended with {code}")
    # Linux counts in KiB, macOS in bytes.
    unit = 1 if sys.platform == "darwin" else 1024
    return {"bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit}


CASES: dict[str, Callable[[], dict[str, float]]] = {
    "robot": robot,
    "files": files,
    "plant": plant,
    "default": default,
}


def main() -> int:
    """Print the table; `--case NAME` measures one case and prints it as JSON."""
    parser = argparse.ArgumentParser(prog="python -m tools.benchmark", description=__doc__)
    parser.add_argument("--case", choices=CASES, help="measure this one, print JSON")
    parser.add_argument("--repeat", type=int, default=3, help="repetitions; the best one counts")
    args = parser.parse_args()
    if args.case:
        print(json.dumps(CASES[args.case]()))
        return 0
    print(f"Python {platform.python_version()}, {_processor()}")
    for row in measure(max(1, args.repeat)):
        print(f"{row.what:<44}{row.measured:>20}   {row.wanted}", flush=True)
    return 0


def measure(repeat: int) -> Iterator[Row]:
    """All rows, each as soon as it is known."""
    ratio = max(_case("plant")["ratio"] for _ in range(repeat))
    yield Row("plant alone, ideal servo, 1 ms", f"{ratio:,.0f} × real time")
    ratio = max(_case("robot")["ratio"] for _ in range(repeat))
    yield Row("whole robot", f"{ratio:,.0f} × real time", WANTED["robot"])
    ratio = max(_case("files")["ratio"] for _ in range(repeat))
    yield Row("the same, files and comparison included", f"{ratio:,.0f} × real time")
    walls, memory = [], 0.0
    for _ in range(repeat):
        begin = time.perf_counter()
        memory = max(memory, _case("default")["bytes"])
        walls.append(time.perf_counter() - begin)
    yield Row("default scenario from the shell", f"{min(walls):.2f} s", WANTED["default"])
    yield Row("its peak memory", f"{memory / 1e6:.0f} MB", WANTED["memory"])
    yield Row("fishbed --help", f"{min(_help() for _ in range(repeat + 2)):.3f} s", WANTED["help"])


def _case(name: str) -> dict[str, float]:
    command = [sys.executable, "-m", "tools.benchmark", "--case", name]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    measured: dict[str, float] = json.loads(done.stdout)
    return measured


def _help() -> float:
    begin = time.perf_counter()
    command = [sys.executable, "-m", "tools", "--help"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - begin


def _processor() -> str:
    """The processor's name, where the system tells it."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def _ignore(seconds: float) -> None:
    """Progress that nobody watches."""


def _never() -> bool:
    return False


if __name__ == "__main__":
    sys.exit(main())
