"""From the records of a run to what the pictures of its survey are made of."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tools.bench.mission import mission_config, way
from tools.records.survey_data import Happening, SurveyEvent
from tools.report.survey_replay import doings, known_over_time
from tools.report.survey_view import SampleRow, Span, SurveyRobot, SurveyView

if TYPE_CHECKING:
    from tools.configuration import Scenario
    from tools.records.shoal_data import ShoalData, SwumRobot


def survey_view(config: Scenario, data: ShoalData) -> SurveyView | None:
    """Return what is shown of a run's survey; None where there was none."""
    survey = data.survey
    if survey is None:
        return None
    addresses = {robot.name: robot.address for robot in data.robots}
    rows = [
        SampleRow(
            one.arrived_s if one.time_s is None else one.time_s,
            addresses[one.robot],
            (one.row, one.column),
            one.x_m,
            one.y_m,
            one.value,
            one.deviation,
        )
        for one in survey.samples
        if one.shared
    ]
    rows.sort(key=lambda row: (row.time_s, row.robot))
    robots = [_robot(robot, _dead(robot, data.duration_s)) for robot in data.robots]
    events = [
        SurveyEvent(start, Happening.DIED, robot.address)
        for robot in robots
        for start, _ in robot.dead()
    ]
    events += survey.events
    given_up = {
        cell: event.time_s
        for event in survey.events
        if event.what is Happening.GIVEN_UP
        for cell in event.cells
    }
    station = config.base_station
    return SurveyView(
        quantity=survey.quantity,
        unit=survey.unit,
        grid=mission_config(config).grid,
        duration_s=data.duration_s,
        robots=tuple(robots),
        samples=tuple(rows),
        reconstruction=survey.matrix,
        deviation=survey.deviation,
        field=survey.true,
        given_up=survey.given_up,
        complete_s=survey.figures["agreed_s"],
        known=known_over_time(rows, way(config), given_up),
        events=tuple(sorted(events, key=lambda event: event.time_s)),
        base_m=(station.x_m, station.y_m),
        base_outages=tuple(
            (outage.at_s, outage.at_s + outage.duration_s) for outage in config.faults.base_outages
        ),
        parents=survey.parents,
    )


def _dead(robot: SwumRobot, end_s: float) -> tuple[Span, ...]:
    """When a robot had no supply, but for the time before it was switched on."""
    return tuple((start, min(end, end_s)) for start, end in robot.outages if start > 0.0)


def _robot(robot: SwumRobot, dead: tuple[Span, ...]) -> SurveyRobot:
    time_s, x_m, y_m = (robot.truth[name] for name in ("time_s", "x_m", "y_m"))
    return SurveyRobot(robot.address, robot.name, time_s, x_m, y_m, doings(time_s, x_m, y_m, dead))
