"""How fast it is: `python -m tools.benchmark` prints a table.

A benchmark, not a test: nothing fails on a slow machine. Each case is measured in a process of its
own (`tools.benchmarks`), so that memory and imports are that case's alone; compiled code is
compiled (and cached) before anything is timed, and the best of several repetitions counts. What is
compared is measured in the same process, in turns. The accuracy that was reached stands beside the
speed.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import platform
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from tools.benchmarks.measure import QUICK, Effort, Figures, Row
from tools.benchmarks.table import CASES, PARTS

_WHAT, _MEASURED, _WANTED = 50, 24, 30  # widths of columns


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; `--case NAME` measures one case and prints it as JSON."""
    parser = argparse.ArgumentParser(prog="python -m tools.benchmark", description=__doc__)
    parser.add_argument("--only", choices=PARTS, action="append", help="measure this part alone")
    parser.add_argument("--case", choices=CASES, help="measure this case here, print JSON")
    parser.add_argument("--repeat", type=int, help="repetitions; the best one counts")
    parser.add_argument("--quick", action="store_true", help="see that it works, in a minute")
    args = parser.parse_args(arguments)
    effort = QUICK if args.quick else Effort()
    if args.repeat is not None:
        effort = replace(effort, repeats=max(1, args.repeat))
    if args.case:
        print(json.dumps(CASES[args.case].measure(effort)))
        return 0
    print(f"Python {platform.python_version()}, {_processor()}")
    print(_line(Row("", "measured", "wanted", "accuracy")))
    options = ["--quick"] * args.quick + ["--repeat", str(effort.repeats)]
    for name, case in CASES.items():
        if not args.only or case.part in args.only:
            for row in case.rows(_apart(name, options)):
                print(_line(row), flush=True)
    return 0


def _apart(name: str, options: Sequence[str]) -> Figures:
    """Measure one case in a process of its own."""
    command = [sys.executable, "-m", "tools.benchmark", "--case", name, *options]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    figures: Figures = json.loads(done.stdout)
    return figures


def _line(row: Row) -> str:
    line = f"{row.what:<{_WHAT}}{row.measured:>{_MEASURED}}   {row.wanted:<{_WANTED}}{row.accuracy}"
    return line.rstrip()


def _processor() -> str:
    """The processor's name, where the system tells it."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


if __name__ == "__main__":
    sys.exit(main())
