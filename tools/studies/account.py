"""What came of the studies, in words and as a document: the same facts for every reader.

A study agrees where it has published numbers to compare and none of them is off without a known
reason. A known difference counts neither for nor against.
"""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from tools.studies.study import Check
from tools.studies.workers import Outcome


@dataclass(frozen=True, slots=True)
class Account:
    """The outcomes in table order, counted."""

    outcomes: tuple[Outcome, ...]

    @property
    def checks(self) -> tuple[tuple[str, Check], ...]:
        """Study name and check, for all that must agree."""
        return tuple(item for item in self._all() if not item[1].known_difference)

    @property
    def differences(self) -> tuple[tuple[str, Check], ...]:
        """Study name and check, for all that are known to part, and why."""
        return tuple(item for item in self._all() if item[1].known_difference)

    @property
    def failed(self) -> tuple[Outcome, ...]:
        """Studies that did not come to an end."""
        return tuple(outcome for outcome in self.outcomes if outcome.result is None)

    @property
    def off(self) -> tuple[tuple[str, Check], ...]:
        """Study name and check, for all that part without a known reason."""
        return tuple(item for item in self._all() if item[1].failed)

    @property
    def ok(self) -> bool:
        """Whether every study came to an end and no check is off."""
        return not self.failed and not self.off

    def failures(self) -> dict[str, list[str]]:
        """Traceback → studies, with one traceback for all that failed in the same way."""
        found: dict[str, tuple[str, list[str]]] = {}
        for outcome in self.failed:
            _, names = found.setdefault(last_line(outcome), (outcome.failure, []))
            names.append(outcome.row.name)
        return dict(found.values())

    def compared(self) -> tuple[Outcome, ...]:
        """Studies that have a published number to compare."""
        return tuple(outcome for outcome in self.outcomes if state(outcome) in ("agrees", "off"))

    def sentence(self) -> str:
        """The verdict in one sentence."""
        compared = self.compared()
        good = sum(state(outcome) == "agrees" for outcome in compared)
        drawn = sum(state(outcome) == "drawn" for outcome in self.outcomes)
        known, broken = len(self.differences), len(self.failed)
        some = "published figures and tables with printed numbers agree"
        if not compared:
            said = "No printed numbers to compare here"
        elif len(compared) == 1:
            said = f"The printed numbers of {compared[0].row.name} {'' if good else 'do not '}agree"
        else:
            said = (
                f"All {good} {some}"
                if good == len(compared)
                else f"{good} of {len(compared)} {some}"
            )
        parts = []
        if drawn:
            more = "more " if compared else ""
            parts.append(f"{drawn} {more}{'is' if drawn == 1 else 'are'} drawn without any")
        if known:
            parts.append(
                f"{known} {'number differs' if known == 1 else 'numbers differ'} for a known reason"
            )
        if broken:
            parts.append(f"{broken} {'study' if broken == 1 else 'studies'} failed")
        return "; ".join([said, *parts]) + "."

    def _all(self) -> Iterator[tuple[str, Check]]:
        for outcome in self.outcomes:
            if outcome.result is not None:
                for check in outcome.result.checks:
                    yield outcome.row.name, check


def state(outcome: Outcome) -> str:
    """`agrees`, `off`, `differs` (for known reasons only), `drawn` (nothing printed), `failed`."""
    if outcome.result is None:
        return "failed"
    checks = outcome.result.checks
    must = [check for check in checks if not check.known_difference]
    if not must:
        return "differs" if checks else "drawn"
    return "agrees" if all(check.ok for check in must) else "off"


def document(account: Account, version: str) -> dict[str, Any]:
    """The account as plain data; numbers that are none become null."""
    return {
        "version": version,
        "ok": account.ok,
        "summary": account.sentence(),
        "checks": [_plain(name, check) for name, check in account.checks],
        "known_differences": [
            {**_plain(name, check), "reason": check.known_difference}
            for name, check in account.differences
        ],
        "studies": [
            {
                "name": outcome.row.name,
                "description": outcome.row.description,
                "state": state(outcome),
                "figures": [figure.name for figure in outcome.result.figures]
                if outcome.result
                else [],
                "notes": list(outcome.result.notes) if outcome.result else [],
                **({"failure": outcome.failure} if outcome.failure else {}),
            }
            for outcome in account.outcomes
        ],
    }


def _plain(study: str, check: Check) -> dict[str, Any]:
    return {
        "study": study,
        "what": check.what,
        "published": _number(check.published),
        "computed": _number(check.computed),
        "unit": check.unit,
        "error": _number(check.error),
        "tolerance": check.tolerance,
        "absolute": check.absolute,
        "ok": bool(check.ok),
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


HEAD = ("study", "published", "computed", "error", "tolerance", "", "what")
"""Words last: a narrow terminal then breaks them, not the numbers."""


def cells(study: str, check: Check) -> tuple[str, ...]:
    """One check in words, a cell for each column of `HEAD`."""
    verdict = "ok" if check.ok else ("differs" if check.known_difference else "OFF")
    unit = f" {check.unit}" if check.unit else ""
    published, computed = pair(check)
    return (
        study,
        published + unit,
        computed + unit,
        error_text(check),
        tolerance_text(check),
        verdict,
        check.what,
    )


def pair(check: Check) -> tuple[str, str]:
    """The published and the computed number; ours with a digit more than is published."""
    published = _text(check.published, 10)
    if check.published == 0.0 and _nothing(check):
        return published, "0"
    if check.published == 0.0 or not math.isfinite(check.computed):
        return published, _text(check.computed, 3)
    digits = len(published.split("e")[0].lstrip("−0.").replace(".", ""))
    return published, _text(check.computed, max(4, digits + 1))


def _nothing(check: Check) -> bool:
    """Whether the error is rounding: a millionth of the tolerance."""
    return abs(check.error) < 1e-6 * check.tolerance


def _text(value: float, digits: int) -> str:
    """So many digits; powers of ten as the source writes them, from 1e-3 downwards."""
    sign, size = ("−" if value < 0.0 else ""), abs(value)
    if size == 0.0 or not math.isfinite(size) or size >= 1e-3:
        return f"{sign}{size:.{digits}g}"
    mantissa, _, power = f"{size:.{digits - 1}e}".partition("e")
    if "." in mantissa:
        mantissa = mantissa.rstrip("0").rstrip(".")
    return f"{sign}{mantissa}e{int(power)}"


def error_text(check: Check) -> str:
    """The error with its sign: in percent, or a bare number in the check's unit."""
    sign = "−" if check.error < 0 else "+"
    if _nothing(check):
        return "0"
    if not math.isfinite(check.error):
        return str(check.error)
    if check.absolute:
        return f"{sign}{_text(abs(check.error), 2)}"
    share = 100.0 * abs(check.error)
    return f"{sign}{share:.0f} %" if share >= 100.0 else f"{sign}{share:.2g} %"


def tolerance_text(check: Check) -> str:
    """The tolerance: in percent, or a bare number in the check's unit."""
    if check.absolute:
        return f"±{_text(check.tolerance, 3)}"
    return f"±{100.0 * check.tolerance:.3g} %"


def lines(account: Account) -> list[str]:
    """The account for a terminal: a line a check, then the known differences and the verdict."""
    rows = [cells(name, check) for name, check in account.checks]
    known = [cells(name, check) for name, check in account.differences]
    widths = [
        max((_width(row[column]) for row in (HEAD, *rows, *known)), default=0)
        for column in range(len(HEAD))
    ]
    said = [_line(row, widths) for row in (HEAD, *rows)] if rows else []
    if known:
        said += ["", "known differences"]
        for row, (_, check) in zip(known, account.differences, strict=True):
            said += [_line(row, widths), f"  {check.known_difference}"]
    for outcome in account.failed:
        said += ["", f"{outcome.row.name} failed: {last_line(outcome)}"]
    return [*said, *([""] if said else []), account.sentence()]


def last_line(outcome: Outcome) -> str:
    """What a failed study raised, in one line."""
    return outcome.failure.strip().split("\n")[-1]


def _line(row: Sequence[str], widths: Sequence[int]) -> str:
    made = []
    for column, (text, width) in enumerate(zip(row, widths, strict=True)):
        room = " " * (width - _width(text))
        made.append(room + text if column in (1, 2, 3, 4) else text + room)
    return "  ".join(made).rstrip()


def _width(text: str) -> int:
    """Columns on a terminal: the dot over a letter takes none."""
    return sum(not unicodedata.combining(letter) for letter in text)
