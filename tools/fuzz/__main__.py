"""`python -m tools.fuzz TARGET|all [--runs N] [--seconds S]`: fuzz decoders, report in a table.

Each target runs in its own process with libFuzzer's limits on memory and on the time of one input.
A finding leaves its input in `--artifacts` and makes the exit code 1; the input is replayed with
`--input FILE`, which needs no atheris.
"""

from __future__ import annotations

import argparse
import importlib.util
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from tools.errors import UserError

if TYPE_CHECKING:
    from tools.fuzz.targets import Target

RSS_LIMIT_MB: Final = 1024
INPUT_SECONDS: Final = 5
"""An input that takes longer is a finding."""
_DONE: Final = re.compile(r"^Done (\d+) runs? in (\d+) second", re.MULTILINE)
_COVER: Final = re.compile(r"cov: (\d+)")
_RSS: Final = re.compile(r"rss: (\d+)Mb")


def main(argv: Sequence[str] | None = None) -> int:
    """Fuzz; returns 0, 1 where something was found, 2 for a user's mistake."""
    try:
        return _main(argv)
    except UserError as error:
        print(f"fuzz: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("fuzz: interrupted", file=sys.stderr)
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
    args = parser.parse_args(argv)
    chosen = [target for target in TARGETS if args.target in (target.name, "all")]
    if args.input is not None:
        try:
            data = args.input.read_bytes()
        except OSError as error:
            raise UserError(f"{args.input} cannot be read: {error.strerror}") from None
        for target in chosen:
            target.run(data)
        print(f"{args.input}: {len(data)} bytes, nothing found")
        return 0
    if importlib.util.find_spec("atheris") is None:
        raise UserError("atheris is not installed: pip install 'fishbed[fuzz]'")
    if args.runs is None and args.seconds is None:
        raise UserError("say how long: --runs N or --seconds S")
    found = 0
    print(f"{'target':<12}{'executions':>12}{'per s':>10}{'cover':>8}{'MB':>6}  finding")
    for target in chosen:
        with tempfile.TemporaryDirectory() as scratch:
            corpus = Path(scratch) / "corpus" if args.corpus is None else args.corpus / target.name
            seeds = Path(scratch) / "seeds"
            for folder in (corpus, seeds, args.artifacts):
                folder.mkdir(parents=True, exist_ok=True)
            for number, seed in enumerate(target.seeds):
                (seeds / str(number)).write_bytes(seed)
            found += _fuzz(target, corpus, seeds, args)
    return 1 if found else 0


def _fuzz(target: Target, corpus: Path, seeds: Path, args: argparse.Namespace) -> bool:
    name = target.name
    prefix = f"{args.artifacts}/{name}-"
    command = [
        sys.executable,
        "-m",
        "tools.fuzz.worker",
        name,
        str(corpus),
        str(seeds),
        f"-rss_limit_mb={RSS_LIMIT_MB}",
        f"-timeout={INPUT_SECONDS}",
        f"-max_len={target.longest}",
        f"-seed={args.seed}",
        f"-artifact_prefix={prefix}",
    ]
    if args.runs is not None:
        command.append(f"-runs={args.runs}")
    if args.seconds is not None:
        command.append(f"-max_total_time={args.seconds}")
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    log = done.stderr + done.stdout
    done_line = _DONE.search(log)
    runs, spent_s = (int(done_line[1]), int(done_line[2])) if done_line else (0, 1)
    cover = int(all_cover[-1]) if (all_cover := _COVER.findall(log)) else 0
    memory = int(all_rss[-1]) if (all_rss := _RSS.findall(log)) else 0
    finding = ""
    if done.returncode:
        Path(f"{prefix}log.txt").write_text(log, encoding="utf-8")
        finding = f"exit {done.returncode}, see {prefix}log.txt"
    speed = runs / max(1, spent_s)  # without the start; libFuzzer counts whole seconds
    print(f"{name:<12}{runs:>12}{speed:>10.0f}{cover:>8}{memory:>6}  {finding or 'none'}")
    sys.stdout.flush()
    return bool(done.returncode)


if __name__ == "__main__":
    sys.exit(main())
