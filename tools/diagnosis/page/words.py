"""The diagnosis in plain words: the verdict in a sentence, what it is worth, and what to do next.

A reader who knows no statistics reads these and no more.
"""

from __future__ import annotations

from collections.abc import Sequence

from tools.diagnosis.result import Diagnosis, NamedCause, Report

UNKNOWN = "unknown_force"
NEARLY = 0.8
"""Cosine of sensitivities from which two causes are said to look much alike."""
_PLACES = (
    (("x_m", "y_m"), "position is off by", 1e3, "mm"),
    (("heading_rad",), "heading is off by", 57.29577951308232, "°"),
    (("turn_radius_m",), "turning radius is off by", 1e3, "mm"),
    (("turn_period_s",), "turning period is off by", 1.0, "s"),
)
"""Channels of which the first screen speaks: what, factor to its unit, unit."""


def headline(report: Report) -> str:
    """Return the verdict in one sentence."""
    if report.verdict == "nothing_wrong":
        return (
            "The model agrees with the measurements: nothing is wrong that these data could show."
        )
    if report.verdict == "named":
        told = _and([cause.statement.rstrip(".") for cause in report.causes])
        return f"{told[:1].upper()}{told[1:]}."
    if report.verdict == "ambiguous":
        names = _or([spoken(name) for name in (report.confusable[0] if report.confusable else ())])
        sure = [
            c.statement.rstrip(".")
            for c in report.causes
            if all(c.name not in group for group in report.confusable)
        ]
        first = f"{_and(sure)}; besides, " if sure else ""
        return (
            f"{first}{'s' if first else 'S'}omething is wrong, and it is {names}: "
            "these data cannot tell which."
        )
    if any(cause.name == UNKNOWN for cause in report.causes):
        return (
            "Something is wrong that has no name in the table of causes; "
            "a force fitted to the data describes it."
        )
    return "Something is wrong that no cause of the table explains."


def spoken(name: str) -> str:
    """Return a name of the table as words."""
    return name.replace("_", " ")


def worth(report: Report) -> str:
    """Say what the extension gains on data that its fit never saw."""
    held = report.held_out
    if report.verdict == "nothing_wrong" or not report.causes:
        return ""
    low, high = held.gain_ci95
    some = len(held.runs) > 3
    runs = f"{len(held.runs)} runs" if some else _and(held.runs)
    share = _with_interval(held.gain, low, high, "95 % interval ")
    if low <= 0.0:
        return (
            f"What it is worth, {runs} cannot show: fitted without them, the extended model "
            f"removes {share} of the error there that noise does not explain."
        )
    return (
        f"Fitted without {runs}, the extended model removes {share} of the error there that noise "
        "does not explain."
    )


def chance(p_value: float) -> str:
    """Return a probability as people say it."""
    if p_value <= 1e-6:
        return "below 1 in a million"
    if p_value < 0.01:
        return f"1 in {1.0 / p_value:,.0f}".replace(",", " ")
    return f"{100.0 * p_value:.0f} %"


def evidence(diagnosis: Diagnosis, cause: NamedCause) -> tuple[list[str], list[str]]:
    """Return what speaks for a cause, and what against it."""
    report = diagnosis.report
    speaks: list[str] = []
    doubts: list[str] = []
    alone = next((row for row in diagnosis.ranking if row.name == cause.name), None)
    if alone is not None:
        place = "above" if alone.gain > diagnosis.threshold else "below"
        line = (
            f"It explains {alone.gain:.0f} (twice the log-likelihood), {place} the "
            f"{diagnosis.threshold:.0f} that chance alone may reach."
        )
        (speaks if place == "above" else doubts).append(line)
    if cause.p_value < 0.01:
        speaks.append(f"The chance of as much in healthy data: {chance(cause.p_value)}.")
    else:
        doubts.append(f"The chance of as much in healthy data: {chance(cause.p_value)}.")
    held = report.held_out
    low, high = held.gain_ci95
    told = _with_interval(held.gain, low, high)
    if low > 0.0:
        speaks.append(f"On held-out runs the extension removes {told} of the error above noise.")
    else:
        doubts.append(f"On held-out runs the gain may be nothing: {told}.")
    if len(cause.parameters) == 1:
        (value,) = cause.parameters.values()
        if value.standard_error > 0.0:
            away = abs(value.estimate) / value.standard_error
            (speaks if away > 3.0 else doubts).append(
                f"The estimate is {away:.0f} standard errors from zero."
            )
    doubts += _alike(diagnosis, cause)
    if report.remaining_structure.found:
        doubts.append(f"Something remains: {report.remaining_structure.where}.")
    return speaks, doubts


def _alike(diagnosis: Diagnosis, cause: NamedCause) -> list[str]:
    """Return what would have looked the same, or nearly so."""
    groups = diagnosis.report.confusable
    same = sorted({n for group in groups if cause.name in group for n in group} - {cause.name})
    found = []
    if same:
        found.append(f"These data are explained as well by {_or([spoken(n) for n in same])}.")
    if cause.name in diagnosis.names:
        row = diagnosis.cosines[diagnosis.names.index(cause.name)]
        near = [
            (float(value), name)
            for value, name in zip(row, diagnosis.names, strict=True)
            if name not in (cause.name, *same) and value >= NEARLY
        ]
        if near:
            listed = [f"{spoken(n)} ({v:.2f})" for v, n in sorted(near, reverse=True)[:3]]
            found.append(f"With these manoeuvres it looks much like {_and(listed)} (1: the same).")
    return found


def tiles(report: Report) -> list[tuple[str, str, str]]:
    """Return the figures of the first screen: name, value, and what it means."""
    held = report.held_out
    found: list[tuple[str, str, str]] = []
    if report.causes and held.gain_ci95 != (0.0, 0.0):
        low, high = held.gain_ci95
        found.append(
            (
                "error that is explained",
                _percent(held.gain),
                f"on runs it was not fitted to{_interval(low, high, '; ')}",
            )
        )
    for names, what, factor, unit in _PLACES:
        if not all(name in held.rmse_before for name in names):
            continue
        before, after, floor = (
            factor * sum(part[name] ** 2 for name in names) ** 0.5
            for part in (held.rmse_before, held.rmse_after, held.noise_floor)
        )
        value = f"{_short(before)} → {_short(after)} {unit}"
        if not report.causes:
            value = f"{_short(before)} {unit}"
        found.append((what, value, f"noise and restless water alone: {_short(floor)} {unit}"))
    if report.verdict != "nothing_wrong" and report.causes:
        value = chance(report.causes[0].p_value).removeprefix("below ")
        value = value.replace("1 in a million", "< 1 in 10⁶")
        found.append(("chance of a false alarm", value, "so often healthy data look like this"))
    return found


def _short(number: float) -> str:
    return f"{number:.3g}" if number < 100.0 else f"{number:.0f}"


def next_steps(report: Report) -> list[str]:
    """Say what to do next, most useful first."""
    steps: list[str] = []
    proposed = report.proposed_experiment
    if report.verdict == "nothing_wrong":
        steps.append(
            "Use the model. The table of smallest effects (report.html) says what these data could "
            "not have shown; longer or livelier runs show smaller ones."
        )
    if report.verdict in ("named", "ambiguous"):
        steps.append(
            "Look at the robot and its instruments for what is named; where it can be repaired, "
            "repair it and measure again."
        )
    if proposed is not None:
        steps.append(
            proposed.why
            if proposed.scenario is None
            else f"To tell them apart, swim {proposed.scenario} (fishbed run {proposed.scenario}, "
            f"or the robot in the tank): {proposed.why}"
        )
    if report.extended_model is not None:
        held = _and([spoken(group[0]) for group in report.confusable])
        which = f" (it holds {held}, the likeliest of what looks alike)" if held else ""
        steps.append(
            f"Where it is to stay, believe {report.extended_model} from now on{which}: "
            f"fishbed run {report.extended_model}"
        )
    if report.verdict == "unexplained":
        steps.append(
            "Look where the structure is (report.html): what is special about the robot, the water "
            "or the instruments there? A run that dwells in that regime tells more."
        )
    if report.remaining_structure.found and report.verdict != "unexplained":
        steps.append(
            f"Something remains: {report.remaining_structure.where}. It is small beside what "
            "was found."
        )
    return steps


def listed(names: Sequence[str]) -> str:
    """Return names as people list them; many are counted."""
    return f"{len(names)} runs" if len(names) > 4 else _and(names)


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def _interval(low: float, high: float, before: str, after: str = "") -> str:
    """Return an interval of shares; nothing where its ends are the same to the per cent."""
    ends = [_percent(low), _percent(high)]
    return "" if ends[0] == ends[1] else f"{before}{' to '.join(ends)}{after}"


def _with_interval(share: float, low: float, high: float, what: str = "") -> str:
    return _percent(share) + _interval(low, high, f" ({what}", ")")


def _and(words: Sequence[str]) -> str:
    return _joined(words, "and")


def _or(words: Sequence[str]) -> str:
    return _joined(words, "or")


def _joined(words: Sequence[str], last: str) -> str:
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {last} {words[-1]}"
