"""Surveys to make pictures of, in the plane without dynamics of `tests.procboard.survey.shoal`."""

from __future__ import annotations

import math

import numpy as np

from plant.field_matrices import SampleGrid, as_field, sampled
from plant.field_sources import HeatedTank
from plant.tank import Tank
from procboard.survey.knowledge import Grid
from procboard.survey.mission import MissionConfig
from procboard.survey.tolerant import noise_tolerant
from tests.procboard.routing.air import clique
from tests.procboard.survey.shoal import Robot, Shoal, Swimmer
from tools.records.survey_data import Happening, SurveyEvent
from tools.report.survey_replay import doings, known_over_time
from tools.report.survey_view import Known, SampleRow, SurveyRobot, SurveyView

CELL_M = 0.25
SIGMA = 0.05  # °C


class Watched(Shoal):
    """Notes where robots are, and what becomes of their shares."""

    def __init__(self, *arguments, **named):
        self.paths = {}
        self.happened = []
        self.plans = {}
        super().__init__(*arguments, **named)

    def _beat(self):
        for robot in self.robots[1:]:
            row = self.time / 1000, robot.swimmer.x_m, robot.swimmer.y_m
            self.paths.setdefault(robot.address, []).append(row)
        witness = self.living()[-1].mission
        for address, share in self.plans.items():
            if not witness.knowledge.lives(address) and address in witness.knowledge.latest:
                left = tuple(cell for cell in share if cell not in witness.knowledge.samples)
                self.happened.append(SurveyEvent(self.time / 1000, Happening.MISSED, address))
                self.happened.append(
                    SurveyEvent(self.time / 1000, Happening.TAKEN_OVER, address, left)
                )
        self.plans = {
            address: share
            for address, share in witness.plan.items()
            if witness.knowledge.lives(address)
        }
        super()._beat()

    def reach(self, links):
        self.links = links


def heated(rows, columns):
    """Temperature over a grid in a tank with a heater off its middle, and as a field."""
    width, height = columns * CELL_M, rows * CELL_M
    tank = Tank(-CELL_M, -CELL_M, width, height)
    source = HeatedTank(tank, 0.62 * width, 0.3 * height)
    grid = SampleGrid(rows, columns, CELL_M)
    matrix = sampled(source, grid)
    return matrix, as_field(matrix, grid)


def surveyed(rows, columns, count, *, deaths=(), base_outages=(), limit_s=4000.0, seed=0):
    """A survey by ``count`` robots; ``deaths`` are (address, time in s)."""
    matrix, field = heated(rows, columns)
    grid = Grid(rows, columns, CELL_M)
    config = MissionConfig(grid, reading_sigma=SIGMA, place_sigma=0.02, dwell_ms=2000)
    expected = config.deviation(10)

    def fresh():
        return noise_tolerant((rows, columns), expected)

    def held(x_m, y_m):
        x = min(max(x_m, 0.0), (columns - 1) * CELL_M)
        return field.value(x, min(max(y_m, 0.0), (rows - 1) * CELL_M))

    side = math.ceil(math.sqrt(count))
    robots = [
        Robot(
            number,
            config=config,
            survey=fresh,
            field_at=held,
            swimmer=Swimmer(
                0.35 * ((number - 1) % side), 0.35 * ((number - 1) // side) - 0.1, math.pi / 2
            ),
            reading_sigma=SIGMA,
            place_error_m=0.01,
        )
        for number in range(count + 1)
    ]
    links = clique(count + 1, 0.1)
    alone = {a: {b: loss for b, loss in heard.items() if a and b} for a, heard in links.items()}
    shoal = Watched(robots, links, seed, keeps_off=True)
    for address, time_s in deaths:
        shoal.at(1000 * time_s, shoal.kill, robots[address])
    for start, end in base_outages:
        shoal.at(1000 * start, shoal.reach, alone)
        shoal.at(1000 * end, shoal.reach, links)
    complete = shoal.swim(limit_s, step_s=5.0)
    return _view(shoal, grid, matrix, fresh, complete, deaths, base_outages)


def _view(shoal, grid, matrix, fresh, complete, deaths, base_outages):
    end_s = shoal.time / 1000
    mission = shoal.living()[-1].mission
    rows = []
    for cell, found in mission.knowledge.samples.items():
        for (origin, _), item in found.items():
            x, y = grid.centre(cell)
            place = x + item.offset_x_m, y + item.offset_y_m
            rows.append(
                SampleRow(item.time_ms / 1000, origin, cell, *place, item.value, item.deviation)
            )
    rows.sort(key=lambda row: (row.time_s, row.robot))
    died = dict(deaths)
    robots = []
    for address, path in shoal.paths.items():
        time, x, y = np.array(path).T
        dead = ((died[address], end_s),) if address in died else ()
        robots.append(
            SurveyRobot(address, f"fish{address:02d}", time, x, y, doings(time, x, y, dead))
        )
    events = [SurveyEvent(at, Happening.DIED, address) for address, at in deaths]
    events += shoal.happened
    if complete:
        events.append(SurveyEvent(end_s, Happening.COMPLETE))
    outcome = mission.outcome()
    return SurveyView(
        "temperature",
        "°C",
        grid,
        end_s,
        tuple(robots),
        tuple(rows),
        outcome.matrix,
        outcome.deviation,
        matrix,
        outcome.given_up,
        end_s if complete else None,
        known_over_time(rows, fresh),
        tuple(sorted(events, key=lambda event: event.time_s)),
        (-0.4, -0.4),
        tuple(base_outages),
        tuple((robot.address, (robot.address - 1) // 2) for robot in robots),
    )


def drawn(rows, columns, count, duration_s, *, step_s=0.1, seed=0):
    """A survey that nobody swam: robots sway along circles, each cell has a sample now and then."""
    chance = np.random.default_rng(seed)
    grid = Grid(rows, columns, CELL_M)
    matrix = chance.normal(20.0, 3.0, (rows, columns))
    time = np.arange(0.0, duration_s + step_s / 2, step_s)
    robots = []
    for address in range(1, count + 1):
        turn, phase = chance.uniform(0.05, 0.3), chance.uniform(0.0, math.tau)
        sway = 0.008 * np.sin(math.tau * 0.9 * time + phase)
        along = 0.03 * time / turn
        x = columns * CELL_M / 2 + (turn + sway) * np.cos(along) + 0.0005 * time
        y = rows * CELL_M / 2 + (turn + sway) * np.sin(along)
        doing = doings(time, x, y)
        robots.append(SurveyRobot(address, f"fish{address:02d}", time, x, y, doing))
    cells = [(row, column) for row in range(rows) for column in range(columns)]
    picked = chance.permutation(len(cells))[: len(cells) // 2]
    moments = np.sort(chance.uniform(0.0, duration_s, picked.size))
    samples, found, known = [], np.full((rows, columns), np.nan), []
    for number, place in enumerate(picked.tolist()):
        cell, robot = cells[place], 1 + number % count
        value = float(matrix[cell] + chance.normal(0.0, 0.1))
        x, y = grid.centre(cell)
        samples.append(SampleRow(float(moments[number]), robot, cell, x, y, value, 0.1))
        found[cell] = value
        if number % 10 == 0:
            known.append(Known(float(moments[number]), number + 10, found.copy()))
    error = chance.normal(0.0, 0.2, matrix.shape)
    return SurveyView(
        "temperature",
        "°C",
        grid,
        duration_s,
        tuple(robots),
        tuple(samples),
        matrix + error,
        np.full(matrix.shape, 0.2),
        matrix,
        known=tuple(known),
        complete_s=duration_s,
        base_m=(-0.5, -0.5),
    )


def nothing(rows, columns):
    """A survey that ended before it began."""
    empty = np.full((rows, columns), np.nan)
    none = np.zeros(0)
    robot = SurveyRobot(1, "fish01", none, none, none)
    return SurveyView("salt", "g/L", Grid(rows, columns, 0.5), 0.0, (robot,), (), empty, empty)
