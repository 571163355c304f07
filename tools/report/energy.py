"""Where the energy went: a bar for each consumer, grouped by board, and the table behind it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from tools.records.data import EnergyState, RunData
from tools.report.charts import xy
from tools.report.scale import number

WIDTH, ROW, HEAD, NAME, VALUE = 520.0, 23.0, 25.0, 116.0, 104.0
STYLES = ("c1", "c3", "c2", "c6", "c4", "c5")
SHOWN = 3
"""So many states of a consumer are named in its row; the full table has them all."""


@dataclass(frozen=True, slots=True)
class Consumer:
    """All states of one consumer, the thirstiest first."""

    name: str
    board: str
    states: tuple[EnergyState, ...]

    @property
    def joules(self) -> float:
        """Energy in all states."""
        return sum(state.joules for state in self.states)

    @property
    def seconds(self) -> float:
        """Time with supply."""
        return sum(state.seconds for state in self.states)


def energy_panels(data: RunData) -> str:
    """Bars, what each consumer did, and every state."""
    groups = _groups(data)
    if not groups:
        return '<p class="soft">The run keeps no account of its energy.</p>'
    whole = sum(row.joules for _, rows in groups for row in rows)
    power = whole / data.duration_s if data.duration_s > 0 else 0.0
    caption = f"{number(whole)} J in {data.duration_s:g} s: {number(power)} W on average"
    return (
        '<div class="grid2 top"><figure><div class="head"><h3>Energy by consumer</h3></div>'
        f'<div class="scroll">{_bars(groups, whole)}</div>'
        f"<figcaption>{caption}</figcaption></figure>"
        f'<div class="panel scroll">{_table(groups)}'
        f"<details><summary>Every state</summary>{_states(groups, whole)}</details></div></div>"
    )


def _groups(data: RunData) -> list[tuple[str, list[Consumer]]]:
    """Consumers by board, boards and consumers by what they took."""
    found: dict[tuple[str, str], list[EnergyState]] = {}
    for row in data.energy:
        if row.joules > 0 or row.seconds > 0:
            found.setdefault((row.board, row.consumer), []).append(row)
    boards: dict[str, list[Consumer]] = {}
    for (board, name), states in found.items():
        states.sort(key=lambda state: -state.joules)
        boards.setdefault(board, []).append(Consumer(name, board, tuple(states)))
    for rows in boards.values():
        rows.sort(key=lambda row: (-row.joules, row.name))
    return sorted(boards.items(), key=lambda entry: -sum(row.joules for row in entry[1]))


def _bars(groups: Sequence[tuple[str, list[Consumer]]], whole: float) -> str:
    rows = sum(len(consumers) for _, consumers in groups)
    height = ROW * rows + HEAD * len(groups)
    room = WIDTH - NAME - VALUE
    longest = max(row.joules for _, consumers in groups for row in consumers) or 1.0
    box = f'viewBox="0 0 {WIDTH:g} {height:g}"'
    parts = [f'<svg class="chart" {box} role="img" aria-label="energy by consumer">']
    y = 0.0
    for place, (board, consumers) in enumerate(groups):
        total = sum(row.joules for row in consumers)
        share = 100 * total / whole if whole else 0.0
        parts.append(
            f'<text class="strong" x="{NAME - 8:g}" y="{xy(y + 17)}" text-anchor="end">'
            f"{escape(board)}</text>"
            f'<text class="label" x="{NAME:g}" y="{xy(y + 17)}">{number(total)} J, '
            f"{share:.1f} %</text>"
        )
        y += HEAD
        for row in consumers:
            parts.append(_bar(row, STYLES[place % len(STYLES)], y, room / longest))
            y += ROW
    return "".join(parts) + "</svg>"


def _bar(row: Consumer, style: str, y: float, scale: float) -> str:
    parts, x = [], NAME
    for place, state in enumerate(row.states):
        width = state.joules * scale
        if width < 0.3 and place:
            continue
        hint = f"{row.name}, {_word(state.state)}: {number(state.joules)} J"
        parts.append(
            f'<rect class="{style}" x="{xy(x)}" y="{xy(y + 3)}" '
            f'width="{xy(max(width - 0.8, 0.8))}" height="14" rx="2" '
            f'opacity="{max(0.25, 1 - 0.35 * place):.2f}">'
            f"<title>{escape(hint)}</title></rect>"
        )
        x += max(width, 0.8)
    parts.append(
        f'<text class="note" x="{NAME - 8:g}" y="{xy(y + 14)}" text-anchor="end">'
        f"{escape(row.name)}</text>"
        f'<text class="note" x="{xy(x + 6)}" y="{xy(y + 14)}">{_joules(row.joules)}</text>'
    )
    return "".join(parts)


def _table(groups: Sequence[tuple[str, list[Consumer]]]) -> str:
    rows = [
        '<table class="dense">',
        '<tr><th>consumer</th><th class="n">mean power</th><th>its time</th></tr>',
    ]
    for _, consumers in groups:
        for row in consumers:
            power = row.joules / row.seconds if row.seconds > 0 else 0.0
            rows.append(
                f'<tr><td>{escape(row.name)}</td><td class="n">{_watts(power)}</td>'
                f'<td class="soft">{escape(_times(row))}</td></tr>'
            )
    return "".join(rows) + "</table>"


def _times(row: Consumer) -> str:
    """Shares of the time in the states that took most of it."""
    if len(row.states) == 1:
        return _word(row.states[0].state)
    longest = sorted(row.states, key=lambda state: -state.seconds)
    parts = []
    for state in longest[:SHOWN]:
        share = 100 * state.seconds / row.seconds if row.seconds > 0 else 0.0
        if share >= 0.01:
            parts.append(f"{_word(state.state)} {number(share, 2)} %")
    return ", ".join(parts)


def _states(groups: Sequence[tuple[str, list[Consumer]]], whole: float) -> str:
    heads = ("time", "energy", "mean power")
    right = "".join(f'<th class="n">{head}</th>' for head in heads)
    rows = [f'<table class="dense"><tr><th>consumer</th><th>state</th>{right}</tr>']
    for _, consumers in groups:
        for row in consumers:
            for place, state in enumerate(row.states):
                power = state.joules / state.seconds if state.seconds > 0 else 0.0
                rows.append(
                    f"<tr><td>{escape(row.name) if place == 0 else ''}</td>"
                    f'<td class="soft">{escape(_word(state.state))}</td>'
                    f'<td class="n">{number(state.seconds)} s</td>'
                    f'<td class="n">{_joules(state.joules)}</td>'
                    f'<td class="n soft">{_watts(power)}</td></tr>'
                )
    rows.append(
        f'<tr class="total"><td>all</td><td></td><td></td>'
        f'<td class="n">{number(whole)} J</td><td></td></tr></table>'
    )
    return "".join(rows)


def _word(state: str) -> str:
    """A state's name for people."""
    words = {"rx": "receive", "tx": "transmit", "vreg_off": "regulator off"}
    if state.startswith("lpm"):
        return state.upper()
    return words.get(state, state.replace("_", " "))


def _joules(value: float) -> str:
    return _scaled(value, "J")


def _watts(value: float) -> str:
    return _scaled(value, "W")


def _scaled(value: float, unit: str) -> str:
    """A value with the prefix that leaves one to three digits before the point."""
    for factor, prefix in ((1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n")):
        if value * factor >= 1 or factor == 1e9:
            return f"{number(value * factor)} {prefix}{unit}" if value else f"0 {unit}"
    return ""
