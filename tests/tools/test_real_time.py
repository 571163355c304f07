"""Against the clock: everything is loaded before the first deadline, and nothing else changes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from firmware_model.scheduler import RealTimeScheduler
from tools import scenario
from tools.bench import Bench

ROOT = Path(__file__).resolve().parents[2]

LOADED = """
import sys
from tools import scenario
from tools.bench import Bench

bench = Bench.from_scenario(scenario.load(duration_s=1.0), speed=1e6)
before = set(sys.modules)
bench.run(lambda _seconds: None, lambda: False)
print(sorted(set(sys.modules) - before))
"""


def test_nothing_is_imported_once_the_clock_runs() -> None:
    done = subprocess.run(
        [sys.executable, "-c", LOADED],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.stdout.strip() == "[]"


def test_the_clock_starts_with_the_run_and_the_trace_is_the_same() -> None:
    config = scenario.load(duration_s=1.0)
    fast, paced = Bench.from_scenario(config), Bench.from_scenario(config, speed=1e6)
    assert isinstance(paced.scheduler, RealTimeScheduler)
    assert paced.scheduler.now == 0
    assert len(paced.scheduler.lateness_s) == 0
    for bench in (fast, paced):
        bench.run(lambda _seconds: None, lambda: False)
    assert paced.run_data().trace_sha256 == fast.run_data().trace_sha256
