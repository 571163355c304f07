"""`fishbed reproduce`: the source's figures and tables computed again, beside what it prints.

Without `--json` a report page is written as well; its place is checked before anything is computed.
Exit code 1 says that a number is off, or a study failed, without a known reason.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from tools.commands.run import folder_name
from tools.errors import UserError

if TYPE_CHECKING:
    from tools.studies.table import Row

NAME = "reproduce"
HELP = "compute the source's figures and tables again and compare with what it prints"
PLACE = "reproduction"
NEAREST = 4
COMPILING = (
    "fishbed: compiling the equations for this machine, which takes the most time of a first "
    "reproduction (one to three minutes for all studies); later ones find the code"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the contract."""
    parser.add_argument(
        "studies",
        nargs="*",
        metavar="ID",
        help="such as fig-3.4 or table-5.2 (see: fishbed list studies); default: all",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout")
    parser.add_argument(
        "--out",
        type=folder_name,
        metavar="DIR",
        help="folder of the report page; an earlier one there is replaced; "
        f"default: {PLACE}, or none with --json",
    )


def run(args: argparse.Namespace) -> int:
    """Do it; 1 where a number is off without a known reason."""
    from pathlib import Path

    from tools.records.folder import Kind, RunFolder

    rows = chosen(args.studies)
    kind = Kind("reproduction", ("report.html", "results.json"), ("report.html", "results.json"))
    with contextlib.ExitStack() as stack:
        folder = None
        if args.out is not None or not args.json:
            folder = stack.enter_context(RunFolder(Path(args.out or PLACE), kind))
        from tools.compiling import say
        from tools.studies.workers import run_studies

        with _progress(rows) as report:
            outcomes = run_studies(
                rows,
                report,
                pictures=folder is not None,
                compiling=lambda: None if args.json else say(COMPILING),
            )
        import json

        from tools.studies.account import Account, document, lines
        from tools.version import version

        account = Account(outcomes)
        text = json.dumps(document(account, version()), indent=2, ensure_ascii=False) + "\n"
        if folder is not None:
            from tools.studies.page import render

            folder.write("report.html", render(account, version()))
            folder.write("results.json", text)
            folder.commit()
    for reason, names in account.failures().items():
        print(f"fishbed: failed: {', '.join(names)}\n{reason}", file=sys.stderr)
    if args.json:
        print(text, end="")
    else:
        print("\n".join(lines(account)))
        assert folder is not None
        print(f"report: {folder.path / 'report.html'}")
    return 0 if account.ok else 1


def chosen(names: Sequence[str]) -> tuple[Row, ...]:
    """The named rows in table order, each once; all without names. Raises `UserError`."""
    from tools.studies.table import STUDIES

    known = {row.name: row for row in STUDIES}
    for name in names:
        if name not in known:
            import difflib

            near = difflib.get_close_matches(name, known, NEAREST, 0.5)
            hint = f"nearest: {', '.join(near)}" if near else "see: fishbed list studies"
            raise UserError(f"no study {name!r} ({hint})")
    return tuple(row for row in STUDIES if not names or row.name in names)


@contextlib.contextmanager
def _progress(rows: Sequence[Row]) -> Iterator[Callable[[int, float], None]]:
    """A bar over all studies and the names of those under way, where somebody can see it."""
    if not sys.stderr.isatty():
        yield lambda index, share: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("studies"),
        BarColumn(),
        TextColumn("{task.fields[done]} of {task.fields[count]}"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[busy]}"),
    )
    shares: dict[int, float] = {}
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("all", total=len(rows), done=0, count=len(rows), busy="")

        def report(index: int, share: float) -> None:
            shares[index] = share
            progress.update(
                task,
                completed=sum(shares.values()),
                done=sum(at >= 1 for at in shares.values()),
                busy=", ".join(rows[i].name for i, at in shares.items() if at < 1),
            )

        yield report
