"""docs/sweep.md: its commands are commands, its code runs, and its numbers are what comes out."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tools import scenario
from tools.cli import build_parser
from tools.sweep.cluster import ADDRESS
from tools.sweep.compute import compute, encode
from tools.sweep.plan import make_plan

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "sweep.md").read_text(encoding="utf-8")
COMMANDS = dict(
    zip(
        re.findall(r"^fishbed (sweep .*)$", PAGE, re.MULTILINE),
        (5, 12, 6, 4, 50, 20, 200),
        strict=True,
    )
)


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_of_the_page_has_its_points(line: str) -> None:
    args = build_parser().parse_args(shlex.split(line))
    plan = make_plan(
        args.scenario,
        args.vary,
        sets=args.set,
        duration_s=args.duration,
        seed=args.seed,
        sample=args.sample,
        repeat=args.repeat,
    )
    assert len(plan) == COMMANDS[line]
    assert args.scheduler is None or ADDRESS.fullmatch(args.scheduler)


def test_the_code_of_the_page_runs(tmp_path: Path) -> None:
    code = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert code is not None
    file = tmp_path / "page.py"
    file.write_text(code[1].replace("duration_s=30", "duration_s=1"))
    done = subprocess.run(
        [sys.executable, str(file)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "[None, None]\n", "")


def test_the_table_of_the_page_holds() -> None:
    rows = re.findall(
        r"^\| \d \| ([\d.]+) \| 1 \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|$", PAGE, re.MULTILINE
    )
    assert [row[0] for row in rows] == ["0.1", "0.2", "0.3", "0.4", "0.5"]
    bias, speed, radius, period = rows[-1]
    config = scenario.load("circle", [f"procboard.tail_beat.bias_rad={bias}"], duration_s=60)
    record = compute(encode(config))
    assert record is not None
    metrics = record["metrics"]
    assert f"{metrics['speed_m_s']:.4f}" == speed
    assert f"{metrics['turn_radius_m']:.3f}" == radius
    assert f"{metrics['turn_period_s']:.1f}" == period
