"""The diagnosis in plain words: the verdict in a sentence, what it is worth, and what to do next.

A reader who knows no statistics reads these and no more.
"""

from __future__ import annotations

from collections.abc import Sequence

from tools.diagnosis.result import Report

UNKNOWN = "unknown_force"


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
    runs = _and(held.runs)
    return (
        f"On {runs}, which no fit has seen, the extended model removes {_percent(held.gain)} "
        f"(95 % interval {_percent(low)} to {_percent(high)}) of the error that noise does not "
        "explain."
    )


def next_steps(report: Report) -> list[str]:
    """Say what to do next, most useful first."""
    steps: list[str] = []
    proposed = report.proposed_experiment
    if report.verdict == "nothing_wrong":
        steps.append(
            "Use the model. The table of smallest effects below says what these data could not "
            "have shown; longer or livelier runs show smaller ones."
        )
    if report.verdict in ("named", "ambiguous"):
        steps.append(
            "Look at the robot and its instruments for what is named; where it is real and can be "
            "repaired, repair it and measure again."
        )
    if proposed is not None:
        steps.append(f"Swim {proposed.scenario}: {proposed.why}")
    if report.extended_model is not None:
        steps.append(
            f"Where it is to stay, believe {report.extended_model} from now on: "
            f"fishbed run {report.extended_model}"
        )
    if report.verdict == "unexplained":
        steps.append(
            "Look where the structure is (below): what is special about the robot, the water or "
            "the instruments there? A run that dwells in that regime tells more."
        )
    if report.remaining_structure.found and report.verdict != "unexplained":
        steps.append(
            f"Something remains: {report.remaining_structure.where}. It is small beside what "
            "was found."
        )
    return steps


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def _and(words: Sequence[str]) -> str:
    return _joined(words, "and")


def _or(words: Sequence[str]) -> str:
    return _joined(words, "or")


def _joined(words: Sequence[str], last: str) -> str:
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {last} {words[-1]}"
