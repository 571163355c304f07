"""The journal of the benchmark counted: shares with exact bounds, and the page of them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from tools.practice.cases import ALIKE, CURVE, EXACT, TIMING, UNKNOWN

Row = dict[str, Any]

_WEAK, _STRONG = 0.8, 1.25
"""Sets whose effect has less than this share of the wanted strength are counted apart; those with
more (one lost command is as strong as it is) belong on no curve."""


@dataclass(frozen=True, slots=True)
class Share:
    """How many of how many, with the bounds of Clopper and Pearson (1934), 95 % two-sided."""

    count: int
    total: int

    @property
    def least(self) -> float:
        """Lower bound of the probability."""
        from scipy.stats import beta

        if self.count == 0:
            return 0.0
        return float(beta.ppf(0.025, self.count, self.total - self.count + 1))

    @property
    def most(self) -> float:
        """Upper bound of the probability."""
        from scipy.stats import beta

        if self.count == self.total:
            return 1.0
        return float(beta.ppf(0.975, self.count + 1, self.total - self.count))

    @property
    def most_one_sided(self) -> float:
        """Upper bound alone, at 95 %."""
        from scipy.stats import beta

        if self.count == self.total:
            return 1.0
        return float(beta.ppf(0.95, self.count + 1, self.total - self.count))

    def __str__(self) -> str:
        if not self.total:
            return "not run"
        share = self.count / self.total
        return f"{share:.1%} ({self.count} of {self.total}; {self.least:.1%} … {self.most:.1%})"


def share(rows: Iterable[Row], good: Callable[[Row], bool]) -> Share:
    """Count the rows that are good."""
    judged = [good(row) for row in rows]
    return Share(sum(judged), len(judged))


def strong(row: Row) -> bool:
    """Tell whether the effects of a set have the wanted strength; crashed sets count."""
    return all(x >= _WEAK * row["strength"] for x in row.get("reached", ()))


def distinct(row: Row) -> bool:
    """Tell whether no other cause looks like the hidden one to these data."""
    return not row.get("look_alikes")


def _exact(row: Row) -> bool:
    return bool(row["score"] == "exact")


def _in_set(row: Row) -> bool:
    return row["score"] in ("exact", "in_set")


def _honest(row: Row) -> bool:
    """Unexplained, or a name that these data could not tell from what is missing."""
    return bool(row["score"] == "unexplained" or row.get("likeness", 0.0) >= ALIKE)


@dataclass(frozen=True, slots=True)
class Line:
    """One line of the table."""

    measure: str
    wanted: str
    found: str


@dataclass(frozen=True, slots=True)
class Point:
    """What becomes of sets whose effects have one strength."""

    strength: float
    seen: Share
    exact: Share
    in_set: Share


def table(rows: Sequence[Row]) -> list[Line]:
    """Return the lines of the table."""
    part = {
        name: [row for row in rows if row["part"] == name and strong(row)]
        for name in ("exact", "healthy", "two", "unlisted", "taken-out", "emulated")
    }
    exact = part["exact"]
    alarms = share(part["healthy"], lambda row: not _exact(row))
    bound = f"; at most {alarms.most_one_sided:.1%} (95 %)" if alarms.total else ""
    oracle = [row for row in exact if row.get("held_out_share") is not None]
    errors = [
        {"error": abs(error)}
        for row in exact
        if _exact(row)
        for error in row["errors"].values()
        if error is not None and math.isfinite(error)
    ]
    lines = [
        Line(
            "exact cause named at λ = 100, no look-alike",
            "90 %",
            str(share(filter(distinct, exact), _exact)),
        ),
        Line("the same, all sets", "–", str(share(exact, _exact))),
        Line("true cause in the reported set", "97 %", str(share(exact, _in_set))),
        Line("false alarms on healthy sets", "at most 2 %", str(alarms) + bound),
        Line(
            "held-out gain at least 90 % of the oracle's",
            "90 %",
            str(share(oracle, lambda row: row["held_out_share"] >= 0.9)),
        ),
        Line("two causes (λ = 150 each), both named", "80 %", str(share(part["two"], _exact))),
        Line("two causes, up to look-alikes", "88 %", str(share(part["two"], _in_set))),
        *_unknown(part["unlisted"]),
        Line(
            "cause taken out of the table: unexplained or look-alike",
            "80 %",
            str(share(part["taken-out"], _honest)),
        ),
        Line(
            "parameter within three standard errors",
            "95 %",
            str(share(errors, lambda row: row["error"] <= 3.0)),
        ),
        Line("made by the emulated robot, exact", "–", str(share(part["emulated"], _exact))),
        Line("made by the emulated robot, in set", "–", str(share(part["emulated"], _in_set))),
    ]
    return [*lines, *_times(rows)]


def _unknown(rows: Sequence[Row]) -> list[Line]:
    """Return what is said of effects that are in no table, for each strength."""
    lines = []
    for strength in UNKNOWN:
        mine = [row for row in rows if row["strength"] == strength]
        what = f"in no table, λ = {strength:g}: "
        lines.append(
            Line(f"{what}unexplained or an unknown force", "80 %", str(share(mine, _exact)))
        )
        named = share(mine, lambda row: row["score"] == "wrong")
        lines.append(Line(f"{what}a wrong name", "–", str(named)))
    return lines


def _times(rows: Sequence[Row]) -> list[Line]:
    timed = [row for row in rows if row["part"] == TIMING and "diagnosis_s" in row]
    if not timed:
        return []
    whole = sorted(row["diagnosis_s"] for row in timed)
    cached = sorted(row["diagnosis_s"] - row["calibration_s"] for row in timed)
    return [
        Line("wall time, calibration cached", "60 s", _seconds(cached)),
        Line("wall time, calibration drawn", "300 s", _seconds(whole)),
    ]


def _seconds(values: Sequence[float]) -> str:
    high = values[math.ceil(0.9 * len(values)) - 1]
    middle = values[len(values) // 2]
    return f"median {middle:.0f} s, nine of ten within {high:.0f} s, longest {values[-1]:.0f} s"


def by_cause(rows: Sequence[Row]) -> list[tuple[str, Counter[str]]]:
    """Count the scores of each cause of the exact part."""
    found: dict[str, Counter[str]] = {}
    for row in rows:
        if row["part"] == "exact":
            scored = row["score"] if strong(row) else "too weak"
            found.setdefault(row["hidden"][0], Counter())[scored] += 1
    return sorted(found.items())


def by_strength(rows: Sequence[Row]) -> list[Point]:
    """Return for each λ the shares that were seen, named exactly, and in the reported set."""
    found = []
    for wanted in sorted((*CURVE, EXACT)):
        mine = [
            row
            for row in rows
            if row["part"] in ("exact", "curve")
            and row["strength"] == wanted
            and strong(row)
            and all(x <= _STRONG * wanted for x in row.get("reached", ()))
        ]
        if mine:
            seen = share(mine, lambda row: row["score"] not in ("missed", "crashed"))
            found.append(Point(wanted, seen, share(mine, _exact), share(mine, _in_set)))
    return found


def markdown(rows: Sequence[Row], picture: str | None) -> str:
    """Return the page."""
    lines = [
        "# How well the diagnosis finds what was hidden",
        "",
        "Written by `python -m tools.practice.benchmark`. Each set is six runs of 60 s with",
        "camera, gyro and compass, made by a generator that shares no simulator with the",
        "diagnosis, and diagnosed as a folder. λ is the expected gain in twice the log-likelihood",
        "of a model that knows the effect (`tools/practice/strength.py`). In brackets: how many of",
        "how many, and the bounds of Clopper and Pearson at 95 %. A crash is a miss.",
        "",
        "| Measure | At least | Found |",
        "|---|---|---|",
        *(f"| {line.measure} | {line.wanted} | {line.found} |" for line in table(rows)),
        "",
    ]
    causes = by_cause(rows)
    if causes:
        lines += ["## Cause by cause, λ = 100", "", "| Hidden | Sets | Scores |", "|---|---|---|"]
        for name, scores in causes:
            told = ", ".join(f"{count} {word}" for word, count in scores.most_common())
            lines.append(f"| `{name}` | {scores.total()} | {told} |")
        lines.append("")
    curve = by_strength(rows)
    if curve:
        lines += ["## Over the strength of the effect", ""]
        if picture:
            lines += [f"![share of sets over λ]({picture})", ""]
        lines += ["| λ | Something seen | Exact | In the reported set |", "|---|---|---|---|"]
        lines += [f"| {p.strength:g} | {p.seen} | {p.exact} | {p.in_set} |" for p in curve]
        lines.append("")
    failures = [row for row in rows if row["score"] in ("wrong", "false_alarm", "crashed")]
    if failures:
        lines += ["## What went wrong", "", "| Set | Score | Said |", "|---|---|---|"]
        for row in failures:
            said = row.get("error") or " and ".join(row.get("named", ())) or row.get("verdict")
            lines.append(f"| `{row['key']}` | {row['score']} | {said} |")
        lines.append("")
    return "\n".join(lines)
