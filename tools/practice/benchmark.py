"""The whole benchmark of the diagnosis: ``python -m tools.practice.benchmark``.

Every set is a row of the journal as soon as it is done; begun again, it goes on where it stopped.
The page `docs/diagnosis-benchmark.md` with its curves is written from the whole journal.
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
from tools.practice.tally import Point, Row, by_strength, markdown, table

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

    cache = cache_directory()
    if workers <= 1:
        for case in todo:
            yield perform(case, None, cache)
        return
    threads = max(1, (os.cpu_count() or 1) // workers)
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        waiting = [pool.submit(perform, case, threads, cache) for case in todo]
        for done in as_completed(waiting):
            yield done.result()


def draw(points: Sequence[Point], place: Path) -> None:
    """Draw the shares over λ with their bounds."""
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    strengths = [point.strength for point in points]
    curves = {
        "something seen": [point.seen for point in points],
        "exact": [point.exact for point in points],
        "in the reported set": [point.in_set for point in points],
    }
    with mpl.rc_context({"svg.hashsalt": "fishbed", "svg.fonttype": "none"}):
        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
        FigureCanvasSVG(figure)
        axes = figure.add_subplot()
        for index, (word, shares) in enumerate(curves.items()):
            middle = [s.count / s.total for s in shares]
            below = [m - s.least for m, s in zip(middle, shares, strict=True)]
            above = [s.most - m for m, s in zip(middle, shares, strict=True)]
            moved = [x * 1.04 ** (index - 1) for x in strengths]
            axes.errorbar(moved, middle, (below, above), marker="s^o"[index], capsize=3, label=word)
        axes.set(xscale="log", ylim=(0.0, 1.02), xlabel="λ", ylabel="share of sets")
        axes.set_xticks(strengths, [f"{x:g}" for x in strengths], minor=False)
        axes.minorticks_off()
        axes.legend(loc="lower right")
        place.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(place, format="svg", metadata={"Date": None})


def main(arguments: Sequence[str] | None = None) -> int:
    """Perform what the journal lacks, print the table, write the page."""
    args = parser().parse_args(arguments)
    done = {row["key"] for row in read(args.journal)}
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
            journal.write(json.dumps(row) + "\n")
            journal.flush()
            print(f"{count}/{len(todo)} {row['key']}: {row['score']}", file=sys.stderr, flush=True)
    rows = read(args.journal)
    curve = by_strength(rows)
    if curve:
        draw(curve, args.picture)
    args.page.parent.mkdir(parents=True, exist_ok=True)
    where = os.path.relpath(args.picture, args.page.parent) if curve else None
    args.page.write_text(markdown(rows, where), encoding="utf-8")
    for line in table(rows):
        print(f"{line.measure:58} {line.wanted:>12}  {line.found}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
