"""`SurveyData`: what a survey found, as plain rows and arrays, and the files of a run folder."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from tools.records.data import FloatArray

SAMPLE_COLUMNS: Final = (
    "order", "time_s", "arrived_s", "robot", "row", "column", "x_m", "y_m", "value", "deviation",
    "readings", "record", "shared",
)  # fmt: skip
"""Of samples.csv: in the order in which they were taken; where on the mean the readings were."""
FIELD_COLUMNS: Final = (
    "row", "column", "x_m", "y_m", "value", "deviation", "sampled", "given_up", "true",
)  # fmt: skip
"""Of reconstruction.csv: the centre of each cell, its value, its standard deviation, the truth."""


Cell: TypeAlias = tuple[int, int]
BASE: Final = 0
"""Of an event that concerns no robot."""


class Happening(Enum):
    """What may happen in a survey that is worth a line."""

    DIED = "died"
    """The robot has no supply, or is stuck, from here on."""
    RETURNED = "is back"
    """A robot that was dead takes part again."""
    MISSED = "missed by the others"
    """The others have noticed that the robot is gone."""
    TAKEN_OVER = "its cells taken over"
    """Cells that were the robot's are others' now."""
    NOT_REACHED = "not reached"
    """The robot did not reach a cell."""
    GIVEN_UP = "given up"
    """Nobody is left to try a cell."""
    COMPLETE = "the field is known"
    """The field is known to all that live."""


@dataclass(frozen=True, slots=True)
class SurveyEvent:
    """Something that happened."""

    time_s: float
    what: Happening
    robot: int = BASE
    """Whom it concerns; the base station's address where that is nobody."""
    cells: tuple[Cell, ...] = ()


@dataclass(frozen=True, slots=True)
class SurveySample:
    """A sample that the base knows of."""

    time_s: float | None
    arrived_s: float
    robot: str
    row: int
    column: int
    x_m: float
    y_m: float
    value: float
    deviation: float
    readings: int
    record: int | None
    """Number of its record, where that came to the base."""
    shared: bool
    """Whether it counts in the reconstruction."""


@dataclass(frozen=True, slots=True, eq=False)
class SurveyData:
    """What a survey found; arrays are (rows, columns), NaN where nothing is known."""

    quantity: str
    unit: str
    method: str
    x_m: FloatArray
    y_m: FloatArray
    """Of the cells' centres: (columns,) and (rows,)."""
    samples: tuple[SurveySample, ...]
    matrix: FloatArray
    deviation: FloatArray
    true: FloatArray
    sampled: npt.NDArray[np.bool_]
    given_up: tuple[Cell, ...]
    events: tuple[SurveyEvent, ...]
    parents: tuple[tuple[int, int], ...]
    """(robot, where it sent its records on to), at the end; the base station is `BASE`."""
    figures: Mapping[str, Any]
    """Of survey.json."""


def errors(matrix: FloatArray, true: FloatArray) -> dict[str, float | None]:
    """Root mean square and largest error, in the field's unit and of the field's span."""
    known = ~np.isnan(matrix)
    if not known.any():
        return dict.fromkeys(("rms", "max", "rms_relative", "max_relative"))
    off = np.abs(matrix - true)[known]
    rms, largest, span = float(np.sqrt((off**2).mean())), float(off.max()), float(np.ptp(true))
    relative = (rms / span, largest / span) if span > 0.0 else (None, None)
    return {
        "rms": rms, "max": largest, "rms_relative": relative[0], "max_relative": relative[1]
    }  # fmt: skip


def survey_json(data: SurveyData) -> str:
    """The text of survey.json."""
    return json.dumps(data.figures, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def samples_csv(data: SurveyData) -> str:
    """The text of samples.csv."""
    return _table(
        SAMPLE_COLUMNS,
        [
            (
                order, one.time_s, one.arrived_s, one.robot, one.row, one.column, one.x_m, one.y_m,
                one.value, one.deviation, one.readings, one.record, int(one.shared),
            )
            for order, one in enumerate(data.samples, start=1)
        ],
    )  # fmt: skip


def reconstruction_csv(data: SurveyData) -> str:
    """The text of reconstruction.csv."""
    rows, columns = data.matrix.shape
    return _table(
        FIELD_COLUMNS,
        [
            (
                row, column, float(data.x_m[column]), float(data.y_m[row]),
                float(data.matrix[row, column]), float(data.deviation[row, column]),
                int(data.sampled[row, column]), int((row, column) in data.given_up),
                float(data.true[row, column]),
            )
            for row in range(rows)
            for column in range(columns)
        ],
    )  # fmt: skip


def _table(head: tuple[str, ...], rows: list[tuple[Any, ...]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue()


def _cell(value: Any) -> str:
    """Numbers so that they read back exactly; nothing where nothing is known."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return repr(value) if isinstance(value, float) else str(value)
