"""`python -m tools.fuzz TARGET|all [--runs N] [--seconds S]`: fuzz decoders, report in a table.

Each target runs in a process of its own with libFuzzer's limits on memory and on the time of one
input. With `--corpus` it runs in pieces, and the corpus and what was done (`executions.csv`) are
kept: `--runs` then counts what was done before, so that a long run may be stopped at any time and
goes on with the same command. A finding leaves its input in `--artifacts` and makes the exit code
1; the input is replayed with `--input FILE`, which needs no atheris.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tools.errors import UserError
from tools.fuzz import log
from tools.fuzz.piece import Piece, run_piece

if TYPE_CHECKING:
    from tools.fuzz.targets import Target


def main(argv: Sequence[str] | None = None) -> int:
    """Fuzz; returns 0, 1 where something was found, 2 for a user's mistake."""
    try:
        return _main(argv)
    except UserError as error:
        print(f"fuzz: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("fuzz: interrupted; what --corpus holds is kept", file=sys.stderr)
        return 130


def _main(argv: Sequence[str] | None) -> int:
    from tools.fuzz.targets import TARGETS

    names = [target.name for target in TARGETS]
    parser = argparse.ArgumentParser(prog="python -m tools.fuzz", description=__doc__)
    parser.add_argument("target", choices=[*names, "all"])
    parser.add_argument("--runs", type=int, metavar="N", help="executions of each target")
    parser.add_argument("--seconds", type=int, metavar="S", help="longest time for each target")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of the mutations")
    parser.add_argument("--corpus", type=Path, metavar="DIR", help="kept and extended, by target")
    parser.add_argument("--artifacts", type=Path, default=Path("fuzz-findings"), metavar="DIR")
    parser.add_argument("--input", type=Path, metavar="FILE", help="run this one input and stop")
    parser.add_argument("--done", action="store_true", help="say what --corpus has seen and stop")
    args = parser.parse_args(argv)
    chosen = [target for target in TARGETS if args.target in (target.name, "all")]
    if args.input is not None:
        return _replay(args.input, chosen)
    if args.done:
        if args.corpus is None:
            raise UserError("--done: say of which --corpus DIR")
        print(_HEAD)
        for target in chosen:
            print(_row(target.name, log.total(args.corpus, target.name), ""))
        return 0
    if importlib.util.find_spec("atheris") is None:
        raise UserError("atheris is not installed: pip install 'fishbed[fuzz]'")
    if args.runs is None and args.seconds is None:
        raise UserError("say how long: --runs N or --seconds S")
    found = 0
    print(_HEAD)
    for target in chosen:
        with tempfile.TemporaryDirectory() as scratch:
            found += _fuzz(target, Path(scratch), args)
    return 1 if found else 0


def _replay(path: Path, chosen: Sequence[Target]) -> int:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror}") from None
    for target in chosen:
        target.run(data)
    print(f"{path}: {len(data)} bytes, nothing found")
    return 0


def _fuzz(target: Target, scratch: Path, args: argparse.Namespace) -> bool:
    """Run one target to its number or time; say whether something was found."""
    name = target.name
    kept: Path | None = args.corpus
    corpus = (scratch if kept is None else kept) / name
    seeds = scratch / "seeds"
    for folder in (corpus, seeds, args.artifacts):
        folder.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(target.seeds):
        (seeds / str(number)).write_bytes(seed)
    done = log.Done() if kept is None else log.total(kept, name)
    begun_s = time.monotonic()
    finding = ""
    while not finding:
        runs = None if args.runs is None else args.runs - done.executions
        left_s = None if args.seconds is None else args.seconds - (time.monotonic() - begun_s)
        if (runs is not None and runs <= 0) or (left_s is not None and left_s < 1.0):
            break
        # Where nothing is kept there is nothing to save on the way: one piece, as long as wanted.
        piece = Piece.next(target, done.pieces, runs, left_s, args.seed, whole=kept is None)
        result, finding = run_piece(piece, (corpus, seeds), args.artifacts)
        done = done.plus(result)
        if kept is not None:
            log.append(kept, name, result)
    print(_row(name, done, finding or "none"), flush=True)
    return bool(finding)


_HEAD = f"{'target':<12}{'executions':>12}{'per s':>10}{'cover':>8}{'MB':>6}  finding"


def _row(name: str, done: log.Done, finding: str) -> str:
    return (
        f"{name:<12}{done.executions:>12}{done.per_s:>10.0f}{done.cover:>8}{done.memory_mb:>6}"
        f"  {finding}"
    ).rstrip()


if __name__ == "__main__":
    sys.exit(main())
