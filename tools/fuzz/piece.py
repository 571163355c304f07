"""A piece of a run: one process of one target, with libFuzzer's limits, and what it reports.

Short inputs run many times as fast as long ones, and most of what a decoder can meet fits them. So
of the pieces of a long run one in eight has inputs of the target's full length, the others of its
usual one; a run in one piece has the full length.
"""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from tools.fuzz.log import Done

if TYPE_CHECKING:
    from tools.fuzz.targets import Target

RSS_LIMIT_MB: Final = 1024
INPUT_SECONDS: Final = 5
"""An input that takes longer is a finding."""
PIECE_RUNS: Final = 500_000
PIECE_SECONDS: Final = 240
"""What an interrupted run loses at most."""
LONG_EVERY: Final = 8

_DONE: Final = re.compile(r"^Done (\d+) runs? in (\d+) second", re.MULTILINE)
_COVER: Final = re.compile(r"cov: (\d+)")
_RSS: Final = re.compile(r"rss: (\d+)Mb")


@dataclass(frozen=True, slots=True)
class Piece:
    """What one process is told."""

    target: str
    longest: int
    seed: int
    runs: int | None
    seconds: int | None

    @classmethod
    def next(
        cls,
        target: Target,
        number: int,
        runs: int | None,
        seconds: float | None,
        seed: int,
        *,
        whole: bool,
    ) -> Piece:
        """The piece of a number, of what is left of a run."""
        if not whole:
            runs = PIECE_RUNS if runs is None else min(runs, PIECE_RUNS)
            seconds = PIECE_SECONDS if seconds is None else min(seconds, PIECE_SECONDS)
        full = whole or number % LONG_EVERY == LONG_EVERY - 1
        return cls(
            target.name,
            target.longest if full else target.usual,
            seed + number,
            runs,
            None if seconds is None else max(1, int(seconds)),
        )


def run_piece(piece: Piece, folders: tuple[Path, Path], artifacts: Path) -> tuple[Done, str]:
    """Run a process to its end; return what it did, and where the finding is or ""."""
    prefix = f"{artifacts}/{piece.target}-"
    command = [
        sys.executable,
        "-m",
        "tools.fuzz.worker",
        piece.target,
        *map(str, folders),
        f"-rss_limit_mb={RSS_LIMIT_MB}",
        f"-timeout={INPUT_SECONDS}",
        f"-max_len={piece.longest}",
        f"-seed={piece.seed}",
        f"-artifact_prefix={prefix}",
    ]
    if piece.runs is not None:
        command.append(f"-runs={piece.runs}")
    if piece.seconds is not None:
        command.append(f"-max_total_time={piece.seconds}")
    ended = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    told = ended.stderr + ended.stdout
    line = _DONE.search(told)
    done = Done(
        executions=int(line[1]) if line else 0,
        seconds=int(line[2]) if line else 0,
        cover=max(map(int, _COVER.findall(told)), default=0),
        memory_mb=max(map(int, _RSS.findall(told)), default=0),
        pieces=1,
    )
    finding = ""
    if ended.returncode or not line:
        Path(f"{prefix}log.txt").write_text(told, encoding="utf-8")
        finding = f"exit {ended.returncode}, see {prefix}log.txt"
    return done, finding
