"""The journal of the benchmark counted: shares with exact bounds.

A set that crashed is a miss in every line that its part has, whatever it would have been: it was
not named, its parameters were not estimated, nothing was gained, and of a healthy set it is an
alarm. Sets that cannot say what a line asks (effects that stay too weak, held-out runs on which
even an oracle gains nothing) are left out of it, and counted beside it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from tools.practice.cases import ALIKE, CURVE, EXACT, HEALTHY_EMULATED, TIMING, UNKNOWN
from tools.practice.reveal import Estimate

Row = dict[str, Any]

_WEAK, _STRONG = 0.8, 1.25
"""Sets whose effect has less than this share of the wanted strength are counted apart; those with
more (one lost command is as strong as it is) belong on no curve."""

NOTHING = 6.0
"""On some held-out runs even an oracle gains no more, in twice the log-likelihood (odds of 20 to
1): a share of that would say nothing."""
MOST_ALARMS = 0.02
CACHED_S, DRAWN_S = 60.0, 300.0
STANDARD_ERRORS = 3.0


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

    @property
    def figure(self) -> str:
        """The share itself, in words."""
        return f"{self.count / self.total:.1%} ({self.count})" if self.total else "not run"

    @property
    def interval(self) -> str:
        """Both bounds, in words."""
        return f"{self.least:.1%} … {self.most:.1%}" if self.total else ""


def share(rows: Iterable[Row], good: Callable[[Row], bool]) -> Share:
    """Count the rows that are good."""
    judged = [good(row) for row in rows]
    return Share(sum(judged), len(judged))


def crashed(row: Row) -> bool:
    """Tell whether a set has no diagnosis."""
    return bool(row["score"] == "crashed")


def strong(row: Row) -> bool:
    """Tell whether the effects of a set have the wanted strength; crashed sets count."""
    return crashed(row) or all(x >= _WEAK * row["strength"] for x in row.get("reached", ()))


def distinct(row: Row) -> bool:
    """Tell whether no other cause looks like the hidden one to these data."""
    return not row.get("look_alikes")


def _exact(row: Row) -> bool:
    return bool(row["score"] == "exact")


def _in_set(row: Row) -> bool:
    return row["score"] in ("exact", "in_set")


def _wrong(row: Row) -> bool:
    """A wrong name, or none because of a crash."""
    return row["score"] in ("wrong", "crashed")


def honest(row: Row) -> bool:
    """Unexplained, or a name that these data could not tell from what is missing."""
    return bool(row["score"] == "unexplained" or row.get("likeness", 0.0) >= ALIKE)


def estimates(rows: Iterable[Row]) -> list[Row]:
    """Return the numbers of true causes that were named, a row for each; of a crash, one of each.

    ``errors``: distance from the truth in standard errors; None where there is no such number.
    """
    found = []
    for row in rows:
        told = row.get("estimates", ())
        found += [{**row, "errors": Estimate(**each).errors} for each in told]
        if crashed(row):
            found += [{**row, "errors": None} for _ in row["hidden"]]
    return found


def within(row: Row) -> bool:
    """Tell whether an estimate is as near the truth as its standard error says."""
    return row["errors"] is not None and abs(row["errors"]) <= STANDARD_ERRORS


def gained(row: Row, by: str) -> float:
    """Return what a model gains on held-out runs beside the believed one; nothing without a cause.

    ``by``: a name of ``tools.practice.oracle.HeldOut``. Zero, too, where the set has crashed.
    """
    held = row.get("held_out")
    if held is None or (by == "extended" and not row["named"]):
        return 0.0
    return float(held["believed"] - held[by])


def telling(row: Row, by: str = "oracle") -> bool:
    """Tell whether the oracle gains anything on held-out runs; where it crashed nobody knows."""
    return crashed(row) or gained(row, by) > NOTHING


def as_good(row: Row, by: str = "oracle") -> bool:
    """Tell whether a diagnosis gains nine tenths of what an oracle does, or the true values do."""
    return not crashed(row) and gained(row, "extended") >= 0.9 * gained(row, by)


@dataclass(frozen=True, slots=True)
class Line:
    """One line of the table; ``met`` None: nothing was wanted, or it was not run."""

    measure: str
    wanted: str
    found: str
    interval: str
    sets: int
    crashed: int
    met: bool | None = None


@dataclass(frozen=True, slots=True)
class Point:
    """What becomes of sets whose effects have one strength."""

    strength: float
    seen: Share
    exact: Share
    in_set: Share


def _line(
    measure: str, wanted: float | None, rows: Iterable[Row], good: Callable[[Row], bool]
) -> Line:
    """Return the line of a share that shall be at least so large."""
    mine = list(rows)
    found = share(mine, good)
    return Line(
        measure,
        "–" if wanted is None else f"{wanted:.0%}",
        found.figure,
        found.interval,
        found.total,
        sum(map(crashed, mine)),
        None if wanted is None or not mine else found.count >= wanted * found.total,
    )


def _alarms(measure: str, rows: Sequence[Row]) -> Line:
    """Return the line of healthy sets that were not said to be healthy."""
    found = share(rows, lambda row: not _exact(row))
    bound = f", at most {found.most_one_sided:.1%} (95 %, one-sided)" if rows else ""
    return Line(
        measure,
        f"bound at most {MOST_ALARMS:.0%}",
        found.figure + bound,
        found.interval,
        found.total,
        sum(map(crashed, rows)),
        found.most_one_sided <= MOST_ALARMS if rows else None,
    )


def _count(measure: str, rows: Sequence[Row], these: Callable[[Row], bool]) -> Line:
    """Return a line that only says how many."""
    found = share(rows, these)
    return Line(measure, "–", found.figure, "", found.total, sum(map(crashed, rows)))


def table(rows: Sequence[Row]) -> list[Line]:
    """Return the lines of the table."""
    everything: dict[str, list[Row]] = {}
    for row in rows:
        everything.setdefault(row["part"], []).append(row)
    part = {name: list(filter(strong, mine)) for name, mine in everything.items()}

    def of(name: str) -> list[Row]:
        return part.get(name, [])

    exact, two = of("exact"), of("two")
    weak = [row for row in rows if row["part"] not in ("curve", TIMING)]
    return [
        _line("exact cause named at λ = 100, no look-alike", 0.90, filter(distinct, exact), _exact),
        _line("the same, look-alikes included", None, exact, _exact),
        _line("true cause in the reported set", 0.97, exact, _in_set),
        _alarms("false alarms on healthy sets", of("healthy")),
        _alarms("false alarms on healthy sets of the emulated robot", of(HEALTHY_EMULATED)),
        _line("held-out gain at least 90 % of the oracle's", 0.90, filter(telling, exact), as_good),
        _count(
            "not in the line above: held-out runs on which the oracle gains nothing",
            exact,
            lambda row: not telling(row),
        ),
        _line(
            "held-out gain at least 90 % of that of the true values",
            None,
            [row for row in exact if telling(row, "truth")],
            lambda row: as_good(row, "truth"),
        ),
        _line("two causes (λ = 150 each), both named", 0.80, two, _exact),
        _line("two causes, up to look-alikes", 0.88, two, _in_set),
        _line(
            "two causes, held-out gain at least 90 % of the oracle's",
            None,
            filter(telling, two),
            as_good,
        ),
        *_unknown(of("unlisted")),
        _line(
            "cause taken out of the table: unexplained or look-alike",
            0.80,
            of("taken-out"),
            honest,
        ),
        _line(
            "parameter within three standard errors, wherever its cause was named (numbers)",
            0.95,
            estimates(row for row in rows if row["part"] != "taken-out"),
            within,
        ),
        _line("made by the emulated robot, exact", None, of("emulated"), _exact),
        _line("made by the emulated robot, in set", None, of("emulated"), _in_set),
        _count(
            "in no line above: effects that stay below 80 % of the wanted λ at any credible size",
            weak,
            lambda row: not strong(row),
        ),
        *(_time(rows, *each) for each in (("cached", CACHED_S), ("drawn", DRAWN_S))),
    ]


def _unknown(rows: Sequence[Row]) -> list[Line]:
    """Return what is said of effects that are in no table, for each strength."""
    lines = []
    for strength in UNKNOWN:
        mine = [row for row in rows if row["strength"] == strength]
        what = f"in no table, λ = {strength:g}: "
        lines.append(_line(f"{what}unexplained or an unknown force", 0.80, mine, _exact))
        lines.append(_line(f"{what}a wrong name, or a crash", None, mine, _wrong))
    return lines


def _time(rows: Sequence[Row], which: str, within_s: float) -> Line:
    """Return the line of the whole command's wall time; a crash takes for ever."""
    timed = [row for row in rows if row["part"] == TIMING]
    told = sorted(row["times"][which]["wall_s"] for row in timed if not crashed(row))
    values = [*told, *(math.inf for row in timed if crashed(row))]
    found, met = "not run", None
    if values:
        high = values[math.ceil(0.9 * len(values)) - 1]
        middle = values[len(values) // 2]
        found = (
            f"median {middle:.0f} s, nine of ten within {high:.0f} s, longest {values[-1]:.0f} s"
        )
        met = values[-1] <= within_s
    return Line(
        f"wall time of `fishbed diagnose`, calibration {which}",
        f"{within_s:.0f} s",
        found,
        "",
        len(timed),
        sum(map(crashed, timed)),
        met,
    )


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
            and (crashed(row) or all(x <= _STRONG * wanted for x in row.get("reached", ())))
        ]
        if mine:
            seen = share(mine, lambda row: row["score"] not in ("missed", "crashed"))
            found.append(Point(wanted, seen, share(mine, _exact), share(mine, _in_set)))
    return found


def failures(rows: Sequence[Row]) -> list[Row]:
    """Return the sets that were not answered as they should be, in the order of their keys.

    An effect that is weaker than those of the table may be missed: the curves tell of these.
    """
    found = []
    for row in rows:
        good = honest(row) if row["part"] == "taken-out" else _in_set(row)
        weak = not strong(row) or (row["part"] == "curve" and row["strength"] < EXACT)
        if not good and not (weak and row["score"] in ("missed", "unexplained")):
            found.append(row)
    return sorted(found, key=lambda row: str(row["key"]))
