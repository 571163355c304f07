"""The wall time of the whole command, as a user has it.

`fishbed diagnose DIR` is a process of its own: it starts, reads, diagnoses, designs the separating
experiment, writes the page. It runs twice, with an empty cache of calibrations and with what the
first left there. A machine that others use makes a command slow, so their share is recorded.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
TIMES = ("drawn", "cached")
"""The first and the second time: the calibration is drawn, and found in the cache."""
_SAID = 2000  # last characters of what a command says when it fails


def timed(place: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Diagnose a folder twice; return the document of diagnosis.json, and the times.

    Raises ``RuntimeError`` where the command fails, with what it said.
    """
    took = {}
    with tempfile.TemporaryDirectory() as directory:
        for name in TIMES:
            took[name] = _run(place, Path(directory) / name, Path(directory) / "cache")
        text = (Path(directory) / TIMES[-1] / "diagnosis.json").read_text(encoding="utf-8")
        document: dict[str, Any] = json.loads(text)
    return document, took


def _run(place: Path, out: Path, cache: Path) -> dict[str, Any]:
    """Run the command; return its wall time and the machine's load.

    ``cpu_s`` is its own, of all its processors; ``others``: processors that were busy with other
    work meanwhile; ``load``: the load average of the minute before.
    """
    command = [sys.executable, "-m", "tools", "diagnose", str(place), "--out", str(out)]
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    known = {**os.environ, "XDG_CACHE_HOME": str(cache), "PYTHONPATH": path}
    load, busy, own, begin = os.getloadavg()[0], busy_s(), _children_s(), time.perf_counter()
    done = subprocess.run(command, env=known, capture_output=True, text=True, check=False)
    wall_s, cpu_s = time.perf_counter() - begin, _children_s() - own
    if done.returncode:
        raise RuntimeError(f"exit code {done.returncode}: {done.stderr[-_SAID:]}")
    after = busy_s()
    others = None
    if busy is not None and after is not None:
        others = round(max(after - busy - cpu_s, 0.0) / wall_s, 2)
    return {
        "wall_s": round(wall_s, 1),
        "cpu_s": round(cpu_s, 1),
        "processors": os.cpu_count(),
        "others": others,
        "load": round(load, 2),
    }


def busy_s(stat: Path = Path("/proc/stat")) -> float | None:
    """Return the time that this machine's processors were not idle; None: it does not say.

    proc(5): user, nice, system, idle, iowait, irq, softirq, steal in ticks of the clock.
    """
    try:
        ticks = [float(x) for x in stat.read_text().splitlines()[0].split()[1:9]]
    except OSError:
        return None
    return (sum(ticks) - ticks[3] - ticks[4]) / os.sysconf("SC_CLK_TCK")


def _children_s() -> float:
    spent = os.times()
    return spent.children_user + spent.children_system
