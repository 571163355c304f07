"""Figures of a shoal: tiles, a row for each robot, and what each used of its energy."""

from __future__ import annotations

from collections.abc import Callable
from html import escape

from tools.records.data import Metric
from tools.records.shoal_data import ShoalData, SwumRobot
from tools.report.charts import xy
from tools.report.scale import number
from tools.report.tables import tile

COLUMNS: tuple[tuple[str, str, float, str], ...] = (
    ("speed_m_s", "speed, cm/s", 100.0, ""),
    ("path_length_m", "path, m", 1.0, ""),
    ("energy_j", "energy, J", 1.0, ""),
    ("radio_sent", "sent", 1.0, ""),
    ("radio_received", "received", 1.0, ""),
    ("telemetry_received", "at the base", 1.0, ""),
    ("spi_frames", "SPI frames", 1.0, ""),
    ("spi_crc_errors", "damaged", 1.0, "bad"),
    ("samples_stored", "stored", 1.0, ""),
    ("samples_lost", "refused", 1.0, "bad"),
)
"""Metric, head of its column, factor from SI, and the style of what is above zero."""
RADIO_CHIP, RADIO = "CC2420", "radio"
PARTS = (
    ("tail", "c2", "tail"),
    ("navigation board", "c1", "navigation"),
    ("processing board", "c3", "processing"),
    (RADIO, "c4", "radio"),
    ("power supply", "c6", "supply"),
)
"""Parts of the energy, their colours, and short words: boards, and the radio apart from its own."""
WIDTH, ROW, NAME, VALUE = 520.0, 20.0, 62.0, 64.0
MARGIN = 4.0
LEAST_ROW = 6.0
BARS_HIGH = 720.0
"""Bars of a large shoal become as thin as fits this height."""


def shoal_tiles(data: ShoalData) -> str:
    """The figures that one looks at first."""
    whole, count = data.whole, len(data.robots)
    sent = sum(robot.metrics.get("radio_sent") or 0 for robot in data.robots)
    found = whole.get("telemetry_received") or 0
    stored, kept = whole.get("samples_stored"), whole.get("samples_recovered")
    energy, least = whole.get("energy_j"), whole.get("least_distance_m")
    ratio = whole.get("base_reception_ratio")
    shown = [
        tile("robots", number(count), "", f"for {data.duration_s:g} s"),
        tile("least distance", _scaled(least, 100.0), "cm", "between two robots"),
        tile("path", _scaled(whole.get("path_length_m"), 1.0 / count), "m", "each, on average"),
        tile("energy", _scaled(energy, 1.0 / count), "J", "each, on average"),
        tile("telemetry", number(found), "", f"at the base, of {number(sent)} sent"),
        tile("frames in the air", number(whole.get("radio_frames")), "", _found(ratio)),
        tile("records stored", number(stored), "", f"{number(kept)} recovered", stored != kept),
    ]
    return f'<div class="tiles">{"".join(shown)}</div>'


def _found(ratio: Metric) -> str:
    return "" if ratio is None else f"the base heard {number(100 * ratio)} %"


def _scaled(value: Metric, factor: float) -> str:
    return number(None if value is None else value * factor)


def robots_table(data: ShoalData) -> str:
    """A row for each robot, and one for all of them."""
    heads = "".join(f'<th class="n">{escape(head)}</th>' for _, head, _, _ in COLUMNS)
    rows = [f"<tr><td>{robot.name}</td>{_cells(robot.metrics.get)}</tr>" for robot in data.robots]
    whole = dict(data.whole)
    for name in ("radio_sent", "radio_received"):  # without the base station's
        whole[name] = sum(robot.metrics.get(name) or 0 for robot in data.robots)
    return (
        '<div class="panel scroll"><table class="dense">'
        f"<tr><th>robot</th>{heads}</tr>{''.join(rows)}"
        f'<tr class="total"><td>all</td>{_cells(whole.get)}</tr></table></div>'
    )


def _cells(metric: Callable[[str], Metric]) -> str:
    cells = []
    for name, _, factor, bad in COLUMNS:
        value = metric(name)
        style = f"n {bad}" if bad and value else "n"
        shown = number(value if value is None or factor == 1.0 else factor * value)
        cells.append(f'<td class="{style}">{shown}</td>')
    return "".join(cells)


def energy_figure(data: ShoalData) -> str:
    """A bar for each robot, in parts; and the table behind it."""
    keys = "".join(
        f'<span class="key"><i class="swatch box {style}"></i>{escape(board)}</span>'
        for board, style, _ in PARTS
    )
    return (
        '<div class="grid2 top"><figure><div class="head"><h3>Energy by robot</h3>'
        f'<div class="legend">{keys}</div></div><div class="scroll">{_bars(data)}</div></figure>'
        f'<div class="panel scroll">{_energy_table(data)}</div></div>'
    )


def _parts(robot: SwumRobot) -> list[float]:
    """Joules of each of `PARTS`."""
    sums = dict.fromkeys((part for part, *_ in PARTS), 0.0)
    for row in robot.energy:
        sums[RADIO if row.consumer == RADIO_CHIP else row.board] += row.joules
    return list(sums.values())


def _bars(data: ShoalData) -> str:
    high = max(LEAST_ROW, min(ROW, BARS_HIGH / len(data.robots)))
    height = high * len(data.robots) + 2 * MARGIN
    longest = max((sum(_parts(robot)) for robot in data.robots), default=0.0) or 1.0
    room = WIDTH - NAME - VALUE
    every = 1 if high >= 12 else -(-12 // int(high))
    parts = [
        (
            f'<svg class="chart" viewBox="0 0 {WIDTH:g} {xy(height)}" role="img" '
            'aria-label="energy by robot">'
        )
    ]
    for place, robot in enumerate(data.robots):
        x, y = NAME, MARGIN + place * high
        for joules, (board, style, _) in zip(_parts(robot), PARTS, strict=True):
            width = joules / longest * room
            if width > 0.05:
                hint = f"{robot.name}, {board}: {number(joules)} J"
                parts.append(
                    f'<rect class="{style}" x="{xy(x)}" y="{xy(y + 0.1 * high)}" '
                    f'width="{xy(width)}" height="{xy(0.8 * high)}"><title>{escape(hint)}</title>'
                    "</rect>"
                )
            x += max(width, 0.0)
        if place % every == 0:
            middle = xy(y + high / 2)
            parts.append(
                f'<text class="note" x="{NAME - 6:g}" y="{middle}" dy=".32em" text-anchor="end">'
                f'{robot.name}</text><text class="note" x="{xy(x + 6)}" y="{middle}" dy=".32em">'
                f"{number(robot.metrics.get('energy_j'))} J</text>"
            )
    return "".join(parts) + "</svg>"


def _energy_table(data: ShoalData) -> str:
    heads = "".join(f'<th class="n">{escape(word)}</th>' for *_, word in PARTS)
    rows = [
        (
            f'<table class="dense"><tr><th>robot</th>{heads}<th class="n">all</th>'
            '<th class="n">power</th></tr>'
        )
    ]
    sums = [0.0] * len(PARTS)
    for robot in data.robots:
        joules = _parts(robot)
        sums = [a + b for a, b in zip(sums, joules, strict=True)]
        rows.append(f"<tr><td>{robot.name}</td>{_joules(joules, data.duration_s)}</tr>")
    rows.append(f'<tr class="total"><td>all</td>{_joules(sums, data.duration_s)}</tr></table>')
    return "".join(rows)


def _joules(joules: list[float], seconds: float) -> str:
    cells = "".join(f'<td class="n">{number(part)} J</td>' for part in joules)
    whole = sum(joules)
    power = number(whole / seconds) if seconds > 0 else "—"
    return f'{cells}<td class="n">{number(whole)} J</td><td class="n soft">{power} W</td>'


def commands_summary(data: ShoalData) -> str:
    """Commands by what they say and when: how many robots answered, and after how long."""
    groups: dict[tuple[float, str], list[tuple[str, float | None, int]]] = {}
    for command in data.commands:
        what, _, _ = command.what.rpartition(" to ")
        after = None if command.answered_s is None else command.answered_s - command.sent_s
        row = (command.outcome, after, command.attempts)
        groups.setdefault((command.sent_s, what), []).append(row)
    if not groups:
        return ""
    rows = []
    for (sent_s, what), answers in groups.items():
        known = [after for _, after, _ in answers if after is not None]
        outcomes = sorted({outcome for outcome, _, _ in answers})
        said = ", ".join(
            f"{sum(outcome == one for outcome, _, _ in answers)} {one}" for one in outcomes
        )
        style = "bad" if any(one.startswith("no answer") for one in outcomes) else ""
        latest = f"{1e3 * max(known):.0f} ms" if known else "—"
        attempts = sum(attempts for _, _, attempts in answers)
        rows.append(
            f'<tr><td class="n">{sent_s:g} s</td><td>{escape(what)}</td>'
            f'<td class="n">{len(answers)}</td><td class="n">{attempts}</td>'
            f'<td class="{style}">{escape(said)}</td><td class="n">{latest}</td></tr>'
        )
    return (
        '<div class="panel scroll"><h3>Commands by radio</h3><table class="dense">'
        '<tr><th class="n">sent at</th><th>command</th><th class="n">robots</th>'
        '<th class="n">attempts</th><th>outcome</th><th class="n">the last answered after</th></tr>'
        f"{''.join(rows)}</table></div>"
    )
