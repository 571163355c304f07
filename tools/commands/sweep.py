"""`fishbed sweep`: a scenario at many points of its keys, and one table of what came of each.

Everything that can be wrong with a point's scenario is found before the first one runs. Ctrl-C ends
the sweep at once; what is computed is kept beside the table, and the same command goes on from it.
"""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from tools.commands.run import positive
from tools.errors import ScenarioError

if TYPE_CHECKING:
    from tools.sweep.table import Table

NAME = "sweep"
HELP = "run a scenario over a grid or a sample of its keys and write one table"
EXIT_INTERRUPTED = 130
SHOWN_ERRORS = 3


def count(text: str) -> int:
    """An argument that is a whole number above zero."""
    try:
        value = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number") from None
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} must be above 0")
    return value


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the contract."""
    parser.add_argument(
        "scenario",
        metavar="SCENARIO|FILE.toml",
        help="a bundled scenario (see: fishbed list scenarios) or a file",
    )
    parser.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="KEY=A,B,…|A:B:N",
        help="values of one key, or N of them evenly from A to B; may be repeated: the product",
    )
    parser.add_argument(
        "--sample",
        type=count,
        metavar="N",
        help="N points of a Latin hypercube instead of the product; ranges are KEY=A:B",
    )
    parser.add_argument(
        "--repeat", type=count, default=1, metavar="N", help="each point with N seeds"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="override one key at every point; may be repeated",
    )
    parser.add_argument("--duration", type=positive, metavar="S", help="simulated seconds")
    parser.add_argument(
        "--seed", type=int, metavar="N", help="seed of all random numbers, of --sample too"
    )
    parser.add_argument(
        "--out",
        default="sweep.csv",
        metavar="FILE",
        help="table, .csv or .json; an earlier one is replaced; default: sweep.csv",
    )
    parser.add_argument(
        "--jobs", type=count, metavar="N", help="processes; default: one for each core"
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="compute on a Dask cluster, such as tcp://127.0.0.1:8786",
    )
    parser.add_argument(
        "--restart", action="store_true", help="drop what an interrupted sweep has left"
    )
    parser.add_argument("--json", action="store_true", help="print the table on stdout as JSON")
    parser.add_argument(
        "--quiet", action="store_true", help="no progress and no summary; only what failed"
    )


def run(args: argparse.Namespace) -> int:
    """Do it; 1 where a point has failed."""
    import time
    from pathlib import Path

    from tools.sweep.plan import make_plan

    if args.jobs is not None and args.scheduler is not None:
        raise ScenarioError("--jobs and --scheduler: the cluster's own workers compute")
    plan = make_plan(
        args.scenario,
        args.vary,
        sets=args.set,
        duration_s=args.duration,
        seed=args.seed,
        sample=args.sample,
        repeat=args.repeat,
    )

    from tools.sweep.progress import shown
    from tools.sweep.sweep import open_journal, sweep
    from tools.sweep.table import check_place, to_json, write_table

    out = Path(args.out)
    check_place(out)
    talks = not (args.quiet or args.json)
    begin = time.monotonic()
    with open_journal(plan, out, restart=args.restart) as journal:
        known = len(journal.records)
        if known and not args.quiet:
            _say(f"going on: {known} of {len(plan)} points are in {journal.path}")
        try:
            with shown(len(plan), known, wanted=not args.quiet) as step:
                table = sweep(plan, journal, jobs=args.jobs, scheduler=args.scheduler, step=step)
        except BaseException as error:
            stopped = isinstance(error, KeyboardInterrupt)
            kept = f"{len(journal.records)} of {len(plan)} points are kept in {journal.path}"
            if not journal.records:
                journal.remove()
                kept = "no point was done yet"
            else:
                kept += ": the same command goes on from there"
            if stopped or (journal.records and not args.quiet):
                _say(f"interrupted; {kept}" if stopped else kept)
            if stopped:
                return EXIT_INTERRUPTED
            raise
        write_table(out, table)
        unfinished = [point for point, one in journal.records.items() if one.get("given_up")]
        faults = [one["fault"] for one in journal.records.values() if "fault" in one]
        if not unfinished:
            journal.remove()
    if faults:
        print(faults[0], file=sys.stderr)
    if args.json:
        print(to_json(table), end="")
    _complain(table, 1 if args.quiet else SHOWN_ERRORS)
    if unfinished and not args.quiet:
        _say(f"the same command tries the {len(unfinished)} given up again")
    if talks:
        took_s = time.monotonic() - begin
        failed = f", {table.failed} failed" if table.failed else ""
        print(f"{len(plan)} points of {plan.name}{failed}, in {took_s:.1f} s: {out}")
    return 1 if table.failed else 0


def _complain(table: Table, shown: int) -> None:
    """Say what was wrong with the first points that have failed; a single line says all."""
    errors = [(row[0], row[-1]) for row in table.rows if row[-1] is not None]
    more = len(errors) - shown
    if shown == 1 and more > 0:
        point, error = errors[0]
        _say(f"{len(errors)} points have failed, the first is point {point}: {error}")
        return
    for point, error in errors[:shown]:
        _say(f"point {point}: {error}")
    if more > 0:
        _say(f"{more} more points have failed: see the column 'error'")


def _say(text: str) -> None:
    print(f"fishbed: {text}", file=sys.stderr)
