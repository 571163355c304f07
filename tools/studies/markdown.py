"""The numbers in docs/reproduction.md: `python -m tools.studies.markdown FILE` renews them.

The page holds tables and notes between marks; the text around them is written by hand. A test
compares what stands there with what the quick studies compute, so the page cannot say what is no
longer so.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from tools.studies.account import Account, error_text, pair, tolerance_text
from tools.studies.study import Check
from tools.studies.table import STUDIES
from tools.studies.workers import Outcome, run_studies

MARKS = {
    "checks": ("<!-- checks: generated -->", "<!-- checks: end -->"),
    "differences": ("<!-- differences: generated -->", "<!-- differences: end -->"),
    "notes": ("<!-- notes: generated -->", "<!-- notes: end -->"),
}


def check_lines(rows: Iterable[tuple[str, Check]]) -> list[str]:
    """A line of the table of checks for each."""
    return [
        f"| {name} | {check.what} | {_with_unit(check, 0)} | {_with_unit(check, 1)} "
        f"| {tolerance_text(check)} |"
        for name, check in rows
    ]


def difference_lines(rows: Iterable[tuple[str, Check]]) -> list[str]:
    """A line of the table of known differences for each."""
    return [
        f"| {name} | {check.what} | {_with_unit(check, 0)} | {_with_unit(check, 1)} "
        f"| {error_text(check)} | {check.known_difference} |"
        for name, check in rows
    ]


def note_lines(outcomes: Iterable[Outcome]) -> list[str]:
    """A line of the list of notes for each note of each study."""
    return [
        f"- {outcome.row.name}: {note}"
        for outcome in outcomes
        if outcome.result is not None
        for note in outcome.result.notes
    ]


def _with_unit(check: Check, which: int) -> str:
    return f"{pair(check)[which]} {check.unit}".rstrip()


def tables(account: Account) -> dict[str, str]:
    """Tables and notes, by the name of their marks."""
    checks = ["| study | what | published | computed | tolerance |", "|---|---|---:|---:|---:|"]
    known = [
        "| study | what | published | computed | error | reason |",
        "|---|---|---:|---:|---:|---|",
    ]
    return {
        "checks": "\n".join([*checks, *check_lines(account.checks)]),
        "differences": "\n".join([*known, *difference_lines(account.differences)]),
        "notes": "\n".join(note_lines(account.outcomes)),
    }


def section(text: str, name: str) -> str:
    """What stands between the marks of one table. Raises ``ValueError`` where they are missing."""
    begin, end = MARKS[name]
    return text[text.index(begin) + len(begin) : text.index(end)].strip("\n")


def renewed(text: str, account: Account) -> str:
    """The page with tables and notes replaced."""
    for name, made in tables(account).items():
        text = text.replace(section(text, name), made)
    return text


def main(path: Path) -> None:
    """Run all studies and rewrite the page."""
    account = Account(run_studies(STUDIES))
    if account.failed:
        raise SystemExit("\n".join(account.failures()))
    path.write_text(renewed(path.read_text(encoding="utf-8"), account), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
