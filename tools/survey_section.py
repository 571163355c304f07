"""`[survey]` of a scenario: the mission of robots whose application is the survey."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta

from tools.ranges import Extent, Fraction, Point, Section

if TYPE_CHECKING:
    from tools.configuration import Scenario
    from tools.shoal_section import Finding, KeyPaths

Wait = Annotated[float, Meta(ge=0, le=3600)]
Period = Annotated[float, Meta(ge=1, le=36_000)]
Deviation = Annotated[float, Meta(ge=0, le=1e5)]

QUANTITIES = {
    "temperature": ("temperature_c", "°C"),
    "pollutant": ("water_quality_ug_l", "µg/L"),
}
"""What can be surveyed: a field of `[tank]`, its name in a sensor report, and its unit."""
MOST_CELLS_A_SIDE = 24
"""As the source's field has."""
ROBOTS = 24
"""That a board has room for (`procboard.survey.cost`; a test keeps them together)."""


class Survey(Section, frozen=True):
    """`[survey]`: a grid of cells to be sampled by a shoal (`procboard.application` = survey).

    The centre of cell (0, 0) is `corner_m`; rows lie along y, columns along x. `method`: expansion
    (few cells, the others follow from the field's low rank), everywhere, or random (a `share` of
    the cells, completed at the base). `rank` of the field, for exact readings; 0: it is found on
    the way, and noise is allowed for. Deviations are standard ones, in the field's unit:
    `reading_deviation` of one reading's error, `place_deviation` of what the error of a robot's
    place, and the tolerance between robots' sensors, make of a sample.

    A robot rests `dwell_s` at a cell, and its readings count that were taken then and up to
    `before_s` before; 0: it passes. Robots listen for `gather_s` first, say that they live every
    `heartbeat_s`, are taken for gone after `silence_s`, have `reach_s` for a cell, and try again
    `rest_s` after they could not go on. `lines`: rows and columns for which the boards have
    memory; `items`: what all boards may say together. The run ends with the mission where
    `ends_run`, else at `scenario.duration_s` in any case.
    """

    rows: Annotated[int, Meta(ge=1, le=MOST_CELLS_A_SIDE)] = 6
    columns: Annotated[int, Meta(ge=1, le=MOST_CELLS_A_SIDE)] = 6
    cell_m: Extent = 0.25
    corner_m: Point = (0.0, 0.0)
    quantity: Literal["temperature", "pollutant"] = "pollutant"
    method: Literal["expansion", "everywhere", "random"] = "expansion"
    rank: Annotated[int, Meta(ge=0, le=MOST_CELLS_A_SIDE)] = 0
    share: Fraction = 0.5
    reading_deviation: Deviation = 0.2
    place_deviation: Deviation = 1.0
    dwell_s: Wait = 0.0
    before_s: Wait = 1.0
    gather_s: Wait = 30.0
    heartbeat_s: Period = 60.0
    silence_s: Period = 200.0
    reach_s: Period = 180.0
    rest_s: Period = 600.0
    lines: Annotated[int, Meta(ge=1, le=MOST_CELLS_A_SIDE)] = 6
    items: Annotated[int, Meta(ge=16, le=512)] = 384
    ends_run: bool = True


def surveys(config: Scenario) -> bool:
    """Whether it is a survey."""
    return config.procboard.application == "survey"


def survey_contradictions(config: Scenario) -> Iterator[Finding]:
    """What the keys of a survey ask of each other and of the rest."""
    survey = config.survey
    application = ("procboard", "application")
    if not config.shoal.robots:
        yield (
            (application, ("shoal", "robots")),
            "a survey is a shoal's: set shoal.robots",
        )
        return
    if config.shoal.robots > ROBOTS:
        yield (
            (("shoal", "robots"), application),
            f"boards have room for {ROBOTS} robots",
        )
    (left, low), (width, height) = config.tank.corner_m, config.tank.size_m
    right, high = left + width, low + height
    x, y = survey.corner_m
    grid: KeyPaths = (("survey", "corner_m"), ("survey", "cell_m"), ("survey", "columns"))
    if not (left <= x and x + (survey.columns - 1) * survey.cell_m <= right):
        yield grid, f"cells must lie in the tank, x {left:g} … {right:g} m"
    if not (low <= y and y + (survey.rows - 1) * survey.cell_m <= high):
        grid = (("survey", "corner_m"), ("survey", "cell_m"), ("survey", "rows"))
        yield grid, f"cells must lie in the tank, y {low:g} … {high:g} m"
    if survey.rank > min(survey.rows, survey.columns):
        yield (("survey", "rank"),), "must not be above the number of rows or columns"
    if survey.method == "random" and survey.share == 0.0:
        yield (("survey", "share"),), "must be > 0: nothing else is known of the field"
    if survey.before_s + survey.dwell_s == 0.0:
        yield (("survey", "before_s"), ("survey", "dwell_s")), "one of them must be > 0"
    if survey.silence_s < 2 * survey.heartbeat_s:
        both: KeyPaths = (("survey", "silence_s"), ("survey", "heartbeat_s"))
        yield both, "must be two heartbeats or more: one may be late"
    if survey.quantity == "pollutant" and not config.navboard.water_probe.fitted:
        both = (("navboard", "water_probe", "fitted"), ("survey", "quantity"))
        yield both, "must be true: it measures the pollutant"
