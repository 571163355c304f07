"""The page of the benchmark: its table, causes, curves, failures, and how to make it again."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from tools.practice.cases import PARTS, TIMING, cases
from tools.practice.tally import (
    Line,
    Point,
    Row,
    Share,
    by_cause,
    by_strength,
    crashed,
    failures,
    table,
)

_MET = {True: "yes", False: "**no**", None: ""}

INTRODUCTION = """\
# How well the diagnosis finds what was hidden

Each set is six runs of 60 s with camera, gyro and compass, made by a generator that shares no
simulator with the diagnosis, and diagnosed as a folder. λ is the expected gain in twice the
log-likelihood of a model that knows the effect (`tools/practice/strength.py`). The interval is that
of Clopper and Pearson, 95 %, two-sided. A set that crashed is a miss in every line; sets are those
that a line counts.

The oracle knows the true causes by name and estimates them on the same training runs. Both are
judged on the same held-out runs, under the noise that the generator truly made
(`tools/practice/oracle.py`); where nothing was named, nothing was gained.
"""

MAKING = """\
## To make it again

```sh
python -m tools.practice.benchmark            # goes on where it stopped; --part, --seeds, --sets
python -m tools.practice.benchmark --sets 0   # this page again, from the journal alone
fishbed practice --seed 7 --out tank3         # one set of your own
```

Wall times are those of `fishbed diagnose DIR` as a process of its own, from its start to its last
file: once with an empty cache of calibrations and once more.
"""


def markdown(rows: Sequence[Row], left_out: Mapping[str, int], picture: str | None) -> str:
    """Return the page; ``left_out``: rows of the journal that other engines made, by engine."""
    lines = [INTRODUCTION, *_origin(rows, left_out), "", *_table(table(rows)), "", *_machine(rows)]
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
        lines += [
            "| λ | Sets | Something seen | Exact | In the reported set |",
            "|---|---|---|---|---|",
        ]
        lines += [
            f"| {p.strength:g} | {p.seen.total} | {_both(p.seen)} | {_both(p.exact)} "
            f"| {_both(p.in_set)} |"
            for p in curve
        ]
        lines.append("")
    failed = failures(rows)
    if failed:
        lines += ["## What went wrong", "", "| Set | Hidden | Said |", "|---|---|---|"]
        lines += [f"| `{row['key']}` | {_hidden(row)} | {_said(row)} |" for row in failed]
        lines.append("")
    return "\n".join([*lines, MAKING])


def _origin(rows: Sequence[Row], left_out: Mapping[str, int]) -> list[str]:
    commits = sorted({row.get("commit") or "none" for row in rows})
    engines = sorted({row.get("engine", "unknown") for row in rows})
    told = ", ".join(f"`{each}`" for each in commits) or "none"
    engine = ", ".join(engines)
    whole = sum(1 for part in PARTS for _ in cases(part, None))
    lines = [
        f"{len(rows)} sets; the whole benchmark has {whole}.",
        f"Engine {engine} (a digest of its sources); commit {told}.",
    ]
    if left_out:
        count = ", ".join(f"{many} of {name}" for name, many in sorted(left_out.items()))
        lines.append(f"Left out, because other engines made them: {count}.")
    return lines


def _table(lines: Sequence[Line]) -> list[str]:
    return [
        "| Measure | Wanted | Found | 95 % interval | Sets | Crashed | Met |",
        "|---|---|---|---|---|---|---|",
        *(
            f"| {line.measure} | {line.wanted} | {line.found} | {line.interval} "
            f"| {line.sets} | {line.crashed} | {_MET[line.met]} |"
            for line in lines
        ),
    ]


def _machine(rows: Sequence[Row]) -> list[str]:
    """Return what else the machine did while commands were timed."""
    timed = [row for row in rows if row["part"] == TIMING and not crashed(row)]
    runs = [each for row in timed for each in row["times"].values()]
    if not runs:
        return []
    count = "/".join(sorted({str(each["processors"]) for each in runs}))
    others = [each["others"] for each in runs if each["others"] is not None]
    busy = (
        f"; other work kept {min(others):.2f} to {max(others):.2f} of them busy" if others else ""
    )
    used = sum(each["cpu_s"] for each in runs) / sum(each["wall_s"] for each in runs)
    loads = [each["load"] for each in runs]
    told = f"Wall times: {count} processors, of which the command used {used:.2f}{busy}"
    return [f"{told}; load average at its start {min(loads):.2f} to {max(loads):.2f}.", ""]


def _both(share: Share) -> str:
    return f"{share.figure}; {share.interval}"


def _hidden(row: Row) -> str:
    sizes, reached = row.get("sizes", ()), row.get("reached", ())
    if len(sizes) != len(row["hidden"]) or len(reached) != len(row["hidden"]):
        return " and ".join(f"`{name}`" for name in row["hidden"]) or "nothing"
    told = [
        f"`{name}` of {size:.3g} (λ = {strength:.0f})"
        for name, size, strength in zip(row["hidden"], sizes, reached, strict=True)
    ]
    return " and ".join(told) or "nothing"


def _said(row: Row) -> str:
    if crashed(row):
        return f"crashed: {_cell(row.get('error', ''))}"
    named = ", ".join(f"`{name}`" for name in row.get("named", ()))
    verdict = str(row.get("verdict", row["score"]))
    return f"{verdict}: {named}" if named else verdict


def _cell(text: str) -> str:
    """Return text that a cell of a table can hold."""
    return text.replace("|", "¦").replace("\n", " ")[:200]


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


def write(rows: Sequence[Row], left_out: Mapping[str, int], page: Path, picture: Path) -> None:
    """Write the page, and its picture where there is a curve."""
    curve = by_strength(rows)
    if curve:
        draw(curve, picture)
    where = os.path.relpath(picture, page.parent) if curve else None
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(markdown(rows, left_out, where), encoding="utf-8")
