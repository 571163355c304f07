"""The whole benchmark of the diagnosis: ``python -m tools.practice.benchmark``.

Every set is a row of the journal as soon as it is done; begun again, it goes on where it stopped.
Rows that another engine made are neither continued nor counted: the page
`docs/diagnosis-benchmark.md` is of one engine, the one that is here if the journal knows it.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

from tools.practice.cases import PARTS, TIMING, Case, cases, perform
from tools.practice.origin import of_one_engine, origin
from tools.practice.tally import Row, table
from tools.practice.told import write

PAGE = Path("docs/diagnosis-benchmark.md")
PICTURE = Path("docs/pictures/diagnosis-benchmark.svg")


def parser() -> argparse.ArgumentParser:
    """Return the parser of its arguments."""
    made = argparse.ArgumentParser(prog="python -m tools.practice.benchmark", description=__doc__)
    made.add_argument("--part", action="append", choices=PARTS, help="default: all of them")
    made.add_argument("--seeds", type=int, metavar="N", help="seeds of each part")
    made.add_argument("--sets", type=int, metavar="N", help="at most so many new sets")
    made.add_argument("--workers", type=int, default=1, metavar="N", help="processes (default: 1)")
    made.add_argument("--journal", type=Path, default=Path("diagnosis-benchmark.jsonl"))
    made.add_argument("--page", type=Path, default=PAGE)
    made.add_argument("--picture", type=Path, default=PICTURE)
    return made


def read(journal: Path) -> list[Row]:
    """Read a journal; a last line that was cut off is left out."""
    if not journal.exists():
        return []
    rows = []
    for line in journal.read_text(encoding="utf-8").splitlines():
        try:
            rows.append(json.loads(line))
        except ValueError:
            continue
    return rows


def performed(todo: Sequence[Case], workers: int) -> Iterator[Row]:
    """Perform sets, in this process or in several; yield rows as they are done."""
    from tools.diagnosis.calibration import cache_directory
    from tools.diagnosis.options import Options

    cache = cache_directory()
    if workers <= 1:
        for case in todo:
            yield perform(case, Options(cache=cache))
        return
    threads = max(1, (os.cpu_count() or 1) // workers)
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        options = Options(workers=threads, cache=cache)
        waiting = [pool.submit(perform, case, options) for case in todo]
        for done in as_completed(waiting):
            yield done.result()


def main(arguments: Sequence[str] | None = None) -> int:
    """Perform what the journal lacks, print the table, write the page."""
    args = parser().parse_args(arguments)
    made_by = origin()
    rows, _ = of_one_engine(read(args.journal), made_by["engine"])
    done = {row["key"] for row in rows}
    todo = [
        case
        for part in args.part or PARTS
        for case in cases(part, args.seeds)
        if case.key not in done
    ]
    todo = todo[: args.sets] if args.sets is not None else todo
    with args.journal.open("a+b") as cut:  # a line that was cut off ends here
        if cut.tell():
            cut.seek(-1, os.SEEK_END)
            if cut.read() != b"\n":
                cut.write(b"\n")
    with args.journal.open("a", encoding="utf-8") as journal:
        together = [case for case in todo if case.part != TIMING]
        alone = [case for case in todo if case.part == TIMING]
        rows_done = itertools.chain(performed(together, args.workers), performed(alone, 1))
        for count, row in enumerate(rows_done, start=1):
            journal.write(json.dumps(row | made_by) + "\n")
            journal.flush()
            print(f"{count}/{len(todo)} {row['key']}: {row['score']}", file=sys.stderr, flush=True)
    everything = read(args.journal)
    rows, left_out = of_one_engine(everything, made_by["engine"])
    if everything and not rows:
        rows, left_out = of_one_engine(everything, everything[-1].get("engine", "unknown"))
    write(rows, left_out, args.page, args.picture)
    for line in table(rows):
        met = {True: "met", False: "NOT MET", None: ""}[line.met]
        sets = f"{line.sets} sets, {line.crashed} crashed"
        print(f"{line.measure}: {line.found} [{line.interval}] of {sets}; {line.wanted} {met}")
    for name, count in sorted(left_out.items()):
        print(f"left out: {count} rows that engine {name} made", file=sys.stderr)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
