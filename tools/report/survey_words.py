"""A survey in words: what was found, how exactly, how long it took, by whom, what went wrong."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from tools.records.survey_data import Cell, Happening, SurveyEvent
from tools.report.scale import number
from tools.report.survey_scene import way_m
from tools.report.survey_view import Doing, SurveyRobot, SurveyView, root_mean_square
from tools.report.tables import tile

NAMED_CELLS = 6
"""More are counted, not named."""


def survey_tiles(view: SurveyView) -> str:
    """The figures that one looks at first."""
    unit = escape(view.unit)
    share = 100 * view.sampled / view.cells
    error = None if view.error is None else root_mean_square(view.error)
    unknown = int(np.isnan(view.reconstruction).sum())
    low, high = view.span
    off = "" if error is None else f"{number(100 * error / (high - low), 2)} % of the span"
    stated = root_mean_square(view.deviation)
    took = view.duration_s if view.complete_s is None else view.complete_s
    died = sum(1 for robot in view.robots if robot.dead_at(view.duration_s))
    shown = [
        tile("cells sampled", number(view.sampled), "", f"of {view.cells}: {share:.0f} %"),
        tile("error", number(error, 2), unit, off),
        tile("stated deviation", number(stated, 2), unit, "root mean square"),
        tile(
            "field known after" if view.complete_s is not None else "not known after",
            _minutes(took),
            "",
            f"{unknown} cells unknown" if unknown else "all cells",
            bool(unknown),
        ),
        tile(
            "robots alive",
            number(len(view.robots) - died),
            "",
            f"of {len(view.robots)}",
            bool(died),
        ),
    ]
    return f'<div class="tiles">{"".join(shown)}</div>'


def survey_words(view: SurveyView) -> str:
    """The same and what went wrong, in sentences."""
    said = [_what(view), _how_exact(view), *_trouble(view)]
    return f'<div class="panel lines">{"".join(f"<p>{escape(line)}</p>" for line in said)}</div>'


def _what(view: SurveyView) -> str:
    grid, count = view.grid, len(view.robots)
    robots = "one robot" if count == 1 else f"{count} robots"
    again = len(view.samples) - view.sampled
    cells = f"{grid.rows} × {grid.columns} cells of {100 * grid.spacing_m:g} cm"
    text = f"{view.quantity[:1].upper()}{view.quantity[1:]} over {cells}, surveyed by {robots}. "
    text += f"Of {view.cells} cells {_were(view.sampled)} sampled"
    text += f", and {again} samples more were of cells that had one" if again else ""
    unknown = int(np.isnan(view.reconstruction).sum())
    if view.complete_s is not None:
        return f"{text}; after {_minutes(view.complete_s)} the field was known to all that live."
    rest = f"{_were(unknown)} still unknown" if unknown else "not all robots had agreed"
    return f"{text}. At the end, after {_minutes(view.duration_s)}, {rest}."


def _how_exact(view: SurveyView) -> str:
    stated = root_mean_square(view.deviation)
    told = f"the boards state {number(stated, 2)} {view.unit}" if stated is not None else ""
    error = None if view.error is None else root_mean_square(view.error)
    if view.error is None or error is None:
        return f"What was there is not known; {told or 'nothing is stated of the error'}."
    low, high = view.span
    most = float(np.nanmax(np.abs(view.error)))
    return (
        f"The reconstruction is off by {number(error, 2)} {view.unit} (root mean square), "
        f"{number(most, 2)} {view.unit} at the most, in a field that spans "
        f"{number(high - low, 2)} {view.unit}; {told or 'nothing is stated'}."
    )


def _trouble(view: SurveyView) -> list[str]:
    """What went wrong, a sentence each; one that says that nothing did."""
    said = []
    for robot in view.robots:
        for start, end in robot.dead():
            said.append(_death(view, robot, start, end))
    for start, end in view.base_outages:
        said.append(
            f"From {_minutes(start)} to {_minutes(end)} nobody could reach the base station."
        )
    missed = [event for event in view.events if event.what is Happening.NOT_REACHED]
    if missed:
        said.append(
            f"Not reached in time: {_cells({cell for event in missed for cell in event.cells})}."
        )
    if view.given_up:
        said.append(
            f"Given up, with a mean of their neighbours for a value: {_cells(view.given_up)}."
        )
    return said or ["Nothing went wrong."]


def _death(view: SurveyView, robot: SurveyRobot, start: float, end: float) -> str:
    done = sum(1 for s in view.samples if s.robot == robot.address and s.time_s <= start)
    text = f"Robot {robot.address} died at {_minutes(start)}, with {_count(done, 'sample')} taken"
    after = [
        event
        for event in view.events
        if event.robot == robot.address and start <= event.time_s <= max(end, view.duration_s)
    ]
    noticed = _first(after, Happening.MISSED)
    text += "" if noticed is None else f"; the others noticed at {_minutes(noticed.time_s)}"
    taken = _first(after, Happening.TAKEN_OVER)
    if taken is not None and taken.cells:
        heirs = {
            sample.robot
            for sample in view.samples
            if sample.cell in taken.cells and sample.time_s >= taken.time_s
        }
        by = f" by {_robots(heirs)}" if heirs else ""
        text += f", and its {_cells(taken.cells)} {_verb(taken.cells)} taken over{by}"
    elif taken is not None:
        text += ", and it had no cell left to sample"
    back = _first(after, Happening.RETURNED)
    return f"{text}." if back is None else f"{text}. It was back at {_minutes(back.time_s)}."


def _first(events: Iterable[SurveyEvent], what: Happening) -> SurveyEvent | None:
    return next((event for event in events if event.what is what), None)


def happened_table(view: SurveyView) -> str:
    """All events, in their order."""
    if not view.events:
        return '<div class="panel"><h3>What happened</h3><p class="soft">Nothing.</p></div>'
    bad = {Happening.DIED, Happening.GIVEN_UP, Happening.NOT_REACHED}
    rows = []
    for event in view.events:
        robot = f"robot {event.robot}" if event.robot else ""
        style = "bad" if event.what in bad else ""
        cells = _cells(event.cells) if event.cells else ""
        rows.append(
            f'<tr><td class="n">{event.time_s:.0f} s</td><td>{robot}</td>'
            f'<td class="{style}">{escape(event.what.value)}</td>'
            f'<td class="soft">{escape(cells)}</td></tr>'
        )
    return (
        '<div class="panel scroll"><h3>What happened</h3><table class="dense">'
        f"{''.join(rows)}</table></div>"
    )


def shares_table(view: SurveyView) -> str:
    """A row for each robot: its samples, its way, and how it spent its time."""
    heads = ("samples", "first", "last", "way", "swims", "rests")
    rows = []
    for robot in view.robots:
        times = [sample.time_s for sample in view.samples if sample.robot == robot.address]
        spent = dict.fromkeys(Doing, 0.0)
        for (start, end), doing in robot.doing:
            spent[doing] += end - start
        whole = sum(spent.values()) or 1.0
        cells = [
            number(len(times)),
            f"{times[0]:.0f} s" if times else "—",
            f"{times[-1]:.0f} s" if times else "—",
            f"{number(way_m(robot))} m",
            f"{100 * spent[Doing.SWIMS] / whole:.0f} %",
            f"{100 * spent[Doing.RESTS] / whole:.0f} %",
        ]
        dead = "dead" if robot.dead_at(view.duration_s) else ""
        row = "".join(f'<td class="n">{cell}</td>' for cell in cells)
        rows.append(f'<tr><td>{escape(robot.name)}</td>{row}<td class="bad">{dead}</td></tr>')
    named = "".join(f'<th class="n">{head}</th>' for head in heads)
    return (
        '<div class="panel scroll"><h3>Shares</h3><table class="dense">'
        f"<tr><th>robot</th>{named}<th></th></tr>{''.join(rows)}</table></div>"
    )


def _minutes(seconds: float) -> str:
    """As in "12 min 5 s"."""
    whole = round(seconds)
    return f"{whole // 60} min {whole % 60} s" if whole >= 60 else f"{whole} s"


def _count(count: int, noun: str) -> str:
    return f"one {noun}" if count == 1 else f"{count or 'no'} {noun}s"


def _were(count: int) -> str:
    return "one was" if count == 1 else f"{count} were"


def _verb(cells: Sequence[Cell]) -> str:
    return "was" if len(cells) == 1 else "were"


def _cells(cells: Iterable[Cell]) -> str:
    """Cells by row and column, or how many."""
    listed = sorted(set(cells))
    if len(listed) > NAMED_CELLS:
        return f"{len(listed)} cells"
    names = ", ".join(f"({row},\N{NO-BREAK SPACE}{column})" for row, column in listed)
    return f"cell {names}" if len(listed) == 1 else f"cells {names}"


def _robots(addresses: Iterable[int]) -> str:
    listed = [str(address) for address in sorted(addresses)]
    if len(listed) == 1:
        return f"robot {listed[0]}"
    return f"robots {', '.join(listed[:-1])} and {listed[-1]}"
