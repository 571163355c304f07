"""Ways to survey a noisy field at equal energy: `python -m tools.studies.survey_methods`.

It prints the tables of docs/survey.md and draws its picture, in some minutes. Two robots sample
24 × 24 cells of 0.25 m, from a corner and back: while they pass, or, for a slow sensor, with a stop
of 20 s at each. The noise-tolerant expansion takes what energy it takes, by (6.5) with the emulated
robot's coefficients; the others get as much:

- **rows**: as many whole rows as that pays for, evenly spread, swum to and fro. Between them the
  field is interpolated linearly, or kriged. All 24 rows are what sampling everywhere is.
- **random completion**: as many cells of a random order as that pays for, by short closed tours;
  the rest by Algorithm 1.
- **kriging of the expansion's samples**: the same cells, another reconstruction.

Fields are scaled to a span of 100 and bilinear between the cells' centres. Every sample has noise,
and is taken off its cell's centre by the robot's error of place, which nobody knows. The expansion
is told the standard deviation that both make together, kriging finds its own.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from plant.field_matrices import SampleGrid, as_field, sampled
from plant.field_sources import HeatedTank, Leak
from plant.tank import Tank
from procboard.survey.completion import complete
from procboard.survey.energy import EMULATED, Effort, EnergyModel, effort
from procboard.survey.rank import Cell
from procboard.survey.sweeps import Pose, walk
from procboard.survey.tolerant import noise_tolerant
from procboard.survey.tours import LONGEST, tours_from
from tools.studies.kriging import Kriged, kriged
from tools.studies.study import FloatArray

SIZE, CELL_M = 24, 0.25
GRID = SampleGrid(SIZE, SIZE, CELL_M)
SHAPE = (SIZE, SIZE)
STARTS = {1: Pose(0.0, CELL_M), 2: Pose(CELL_M, 0.0)}
SPAN = 100.0
NOISES = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Standard deviation of a sample's noise, in per cent of the field's span."""
PLACES_M = (0.0, 0.02, 0.05, 0.1)
"""Standard deviation of a place along x and y; 2 cm is the radius of arrival."""
PLACE_M, NOISE = 0.02, 0.3
"""What the one is while the other changes."""
WATTS = 1.4
"""Of a robot that waits (docs/tours.md)."""
PASSING, STOPPING = EMULATED, replace(EMULATED, joules_per_sample=20.0 * WATTS)
"""What a sample costs: next to nothing, or a stop of 20 s."""
DRAWS = 2
LIKELIHOOD_SAMPLES = 120
"""Samples, drawn of all, that kriging takes its lengths and its noise from: it is slow."""
PICTURE = Path("docs/pictures/survey-methods.svg")


@cache
def fields() -> dict[str, FloatArray]:
    """The fields by name, (24, 24), spans of 100."""
    tank = Tank(x_min_m=-0.5, y_min_m=-0.5, x_max_m=6.25, y_max_m=6.25, depth_m=0.6)
    rng = np.random.default_rng(0)
    made = {
        "matrix of rank 4": rng.standard_normal((SIZE, 4)) @ rng.standard_normal((4, SIZE)),
        "heater": sampled(HeatedTank(tank, 2.1, 3.6), GRID),
        "oil slick": sampled(Leak(1.1, 1.6, 1.0, 0.01, 0.6), GRID),
    }
    return {name: (field - field.min()) * (SPAN / np.ptp(field)) for name, field in made.items()}


@dataclass(frozen=True, slots=True)
class Water:
    """A field with what makes its samples wrong; one draw."""

    field: FloatArray
    noise: float
    place_m: float
    model: EnergyModel
    seed: int

    def samples(self) -> FloatArray:
        """What a sample of each cell would be, (24, 24)."""
        rng = np.random.default_rng((self.seed, 7))
        off = self.place_m * rng.standard_normal((*SHAPE, 2))
        noise = self.noise * rng.standard_normal(SHAPE)
        between, most = as_field(self.field, GRID), (SIZE - 1) * CELL_M
        values = np.empty(SHAPE)
        for row, column in np.ndindex(SHAPE):
            x, y = np.clip(np.array(GRID.centre(row, column)) + off[row, column], 0.0, most)
            values[row, column] = between.value(float(x), float(y))
        return values + noise

    @property
    def sigma(self) -> float:
        """Standard deviation of a sample's error: noise, and place times the mean square slope."""
        slopes = np.gradient(self.field, CELL_M)
        return math.hypot(self.noise, self.place_m * math.sqrt(sum(np.mean(s**2) for s in slopes)))


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What a way to survey found, from how many samples, for how much energy."""

    matrix: FloatArray
    samples: int
    joules: float


def expanded(water: Water, values: FloatArray) -> tuple[Found, list[Cell]]:
    """Survey by the noise-tolerant expansion; also the cells that it sampled."""
    survey = noise_tolerant(SHAPE, water.sigma, seed=water.seed)

    def requests() -> Iterator[tuple[Cell, ...]]:
        while not survey.done:
            wanted = survey.wanted()
            yield wanted
            for cell in wanted:
                survey.tell(cell, float(values[cell]))

    way = walk(requests(), STARTS, CELL_M, water.model)
    cells = [cell for order in way.cells.values() for cell in order]
    return Found(survey.reconstruction(), len(cells), water.model.joules(way.effort)), cells


def joules_of_rows(rows: Sequence[int], model: EnergyModel) -> float:
    """Energy of two robots that swim rows to and fro, each half of them, and back."""
    swum = Effort()
    half = (len(rows) + 1) // 2
    for start, part in zip(STARTS.values(), (rows[:half], rows[half:]), strict=True):
        path = [start.place]
        for number, row in enumerate(part):
            ends = [(0.0, row * CELL_M), ((SIZE - 1) * CELL_M, row * CELL_M)]
            path += ends[::-1] if number % 2 else ends
        path.append(start.place)
        swum += effort(np.array(path), SIZE * len(part))
    return model.joules(swum)


def spread_rows(count: int) -> list[int]:
    """Rows, evenly spread from the first to the last."""
    return [int(row) for row in np.linspace(0, SIZE - 1, count).round()]


def rows_for(joules: float, model: EnergyModel) -> list[int]:
    """As many rows as an energy pays for, two at least."""
    counts = range(SIZE, 1, -1)
    affordable = (c for c in counts if joules_of_rows(spread_rows(c), model) <= joules)
    return spread_rows(next(affordable, 2))


def interpolated(values: FloatArray, rows: list[int]) -> FloatArray:
    """Each column linearly between the rows."""
    return np.column_stack(
        [np.interp(np.arange(SIZE), rows, values[rows, column]) for column in range(SIZE)]
    )


def random_for(values: FloatArray, joules: float, model: EnergyModel, seed: int) -> Found:
    """Cells in a random order, as many as an energy pays for, completed by Algorithm 1."""
    order = np.random.default_rng((seed, 3)).permutation(SIZE * SIZE)
    starts = np.array([pose.place for pose in STARTS.values()])
    places = CELL_M * np.column_stack((order % SIZE, order // SIZE)).astype(np.float64)

    def cost(count: int) -> float:
        tours = tours_from(starts, places[:count], objective=LONGEST)
        paths = [
            np.vstack((start, places[list(tour)], start))
            for start, tour in zip(starts, tours.orders, strict=True)
        ]
        return model.joules(sum((effort(path, len(path) - 2) for path in paths), Effort()))

    low, high = 8, SIZE * SIZE
    while high - low > 8:  # a hundredth of the cells
        middle = (low + high) // 2
        low, high = (middle, high) if cost(middle) <= joules else (low, middle)
    mask = np.zeros(SIZE * SIZE, dtype=np.bool_)
    mask[order[:low]] = True
    found = complete(values, mask.reshape(SHAPE))
    return Found(found.matrix, low, cost(low))


def kriged_of(values: FloatArray, cells: Sequence[Cell], seed: int) -> FloatArray:
    """The field by kriging from some cells, in units of cells."""
    points = np.array([(column, row) for row, column in cells], dtype=np.float64)
    measured = np.array([values[cell] for cell in cells])
    rng = np.random.default_rng((seed, 5))
    some = rng.permutation(len(points))[:LIKELIHOOD_SAMPLES]
    likely = kriged(points[some], measured[some])
    all_of_them = Kriged(points, measured, likely.lengths, likely.noise_ratio)
    everywhere = np.array([(column, row) for row, column in np.ndindex(SHAPE)], dtype=np.float64)
    found, _ = all_of_them.at(everywhere)
    return found.reshape(SHAPE)


METHODS = (
    "expansion",
    "rows",
    "rows, kriged",
    "random completion",
    "expansion's samples, kriged",
    "everywhere",
    "everywhere, kriged",
)
"""The last two cost what they cost; see the energy of the tables."""


def compared(water: Water) -> dict[str, tuple[float, int, float]]:
    """By method: root mean square error in per cent of the span, samples, J."""
    values, seed, model = water.samples(), water.seed, water.model
    expansion, cells = expanded(water, values)
    rows = rows_for(expansion.joules, model)
    row_cells = [(row, column) for row in rows for column in range(SIZE)]
    joules, every = joules_of_rows(rows, model), [(r, c) for r, c in np.ndindex(SHAPE)]
    all_rows = joules_of_rows(spread_rows(SIZE), model)
    found = (
        expansion,
        Found(interpolated(values, rows), len(row_cells), joules),
        Found(kriged_of(values, row_cells, seed), len(row_cells), joules),
        random_for(values, expansion.joules, model, seed),
        Found(kriged_of(values, cells, seed), len(cells), expansion.joules),
        Found(values, SIZE * SIZE, all_rows),
        Found(kriged_of(values, every, seed), SIZE * SIZE, all_rows),
    )
    return {
        name: (float(np.sqrt(np.mean((one.matrix - water.field) ** 2))), one.samples, one.joules)
        for name, one in zip(METHODS, found, strict=True)
    }


Curves = dict[str, list[tuple[float, float, float]]]
"""By method, at each point of a curve: error (geometric mean of the draws), samples, kJ."""


def curves(name: str, at: Sequence[tuple[float, float]], model: EnergyModel, draws: int) -> Curves:
    """Errors of a field's methods at pairs of noise and error of place."""
    made: Curves = {method: [] for method in METHODS}
    for noise, place_m in at:
        waters = [Water(fields()[name], noise, place_m, model, seed) for seed in range(draws)]
        told = [compared(water) for water in waters]
        for method in METHODS:
            errors, samples, joules = zip(*(one[method] for one in told), strict=True)
            mean = math.exp(fmean(math.log(error) for error in errors))
            made[method].append((mean, fmean(samples), fmean(joules) / 1e3))
    return made


@dataclass(frozen=True, slots=True)
class Sweep:
    """What changes along a curve: pairs of noise and error of place, and how it is called."""

    title: str
    label: str
    model: EnergyModel
    at: tuple[tuple[float, float], ...]
    x: tuple[float, ...]
    unit: str
    log: bool


SWEEPS = (
    Sweep(
        "passing", f"noise, % of span; place {100 * PLACE_M:.0f} cm", PASSING,
        tuple((noise, PLACE_M) for noise in NOISES), NOISES, "noise {:g} %", log=True,
    ),
    Sweep(
        "stopping", f"noise, % of span; place {100 * PLACE_M:.0f} cm", STOPPING,
        tuple((noise, PLACE_M) for noise in NOISES), NOISES, "noise {:g} %", log=True,
    ),
    Sweep(
        "stopping", f"error of place, cm; noise {NOISE:g} %", STOPPING,
        tuple((NOISE, place_m) for place_m in PLACES_M),
        tuple(100.0 * place_m for place_m in PLACES_M), "place {:g} cm", log=False,
    ),
)  # fmt: skip


def table(name: str, sweep: Sweep, found: Curves) -> str:
    """A field's curve as Markdown: error, and in brackets samples and kJ."""
    heads = [sweep.unit.format(x) for x in sweep.x]
    lines = [f"| {name}, {sweep.title} | {' | '.join(heads)} |", "|---|" + "---:|" * len(heads)]
    for method, points in found.items():
        cells = (f"{e:.2g} ({n:.0f}, {kj:.1f})" for e, n, kj in points)
        lines.append(f"| {method} | {' | '.join(cells)} |")
    return "\n".join(lines)


def draw(found: Sequence[tuple[str, Sequence[Curves]]], place: Path) -> None:
    """Draw errors, a column for each field and a row for each sweep."""
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with mpl.rc_context({"svg.hashsalt": "fishbed", "svg.fonttype": "none", "font.size": 8}):
        figure = Figure(figsize=(8.4, 7.8), layout="constrained")
        FigureCanvasSVG(figure)
        axes: Any = figure.subplots(len(SWEEPS), len(found), sharey="row", squeeze=False)
        for column, (name, by_sweep) in enumerate(found):
            for row, (sweep, curve) in enumerate(zip(SWEEPS, by_sweep, strict=True)):
                axis = axes[row, column]
                for number, (method, points) in enumerate(curve.items()):
                    axis.plot(
                        sweep.x,
                        [point[0] for point in points],
                        marker="osd^v.."[number],
                        linestyle="--" if method.startswith("everywhere") else "-",
                        linewidth=1.0,
                        markersize=4.0,
                        label=method,
                    )
                axis.set(yscale="log", xlabel=sweep.label, title=f"{name}, {sweep.title}")
                axis.set_xscale("log" if sweep.log else "linear")
                axis.grid(visible=True, linewidth=0.3)
                if column == 0:
                    axis.set_ylabel("error, % of span (rms)")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
        place.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(place, format="svg", metadata={"Date": None})


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables, draw the picture."""
    parser = argparse.ArgumentParser(description="Surveys of noisy fields at equal energy.")
    parser.add_argument("--draws", type=int, default=DRAWS, metavar="N", help="of each noise")
    parser.add_argument("--picture", type=Path, default=PICTURE)
    args = parser.parse_args(arguments)
    found = []
    for name in fields():
        by_sweep = []
        for sweep in SWEEPS:
            by_sweep.append(curves(name, sweep.at, sweep.model, args.draws))
            print(table(name, sweep, by_sweep[-1]), "\n", flush=True)
        found.append((name, by_sweep))
    draw(found, args.picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
