"""What a survey came to: samples and field as the base knows them, against the field as it is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tools.bench import model
from tools.records.survey_data import SurveyData, SurveySample, errors
from tools.survey_section import QUANTITIES

if TYPE_CHECKING:
    from plant.fields import Field
    from tools.configuration import Scenario
    from tools.records.shoal_data import Hearing, SwumRobot
    from tools.shoal.base_survey import BaseSurvey


def survey_data(
    survey: BaseSurvey,
    robots: Sequence[SwumRobot],
    hearing: Hearing,
    parents: tuple[tuple[int, int], ...],
) -> SurveyData:
    """Return what is known at the end of a run; `parents` as in `SurveyData`."""
    config = survey.config
    section = config.survey
    grid = survey.mission.config.grid
    names = {robot.address: robot.name for robot in robots}
    found = survey.mission.outcome()
    source = field(config)
    true = np.array(
        [
            [source.value(*grid.centre((row, column))) for column in range(grid.columns)]
            for row in range(grid.rows)
        ]
    )
    samples = tuple(
        SurveySample(
            one.time_s,
            one.arrived_s,
            names.get(one.robot, str(one.robot)),
            one.sample.row,
            one.sample.column,
            grid.centre(one.sample.cell)[0] + one.sample.offset_x_m,
            grid.centre(one.sample.cell)[1] + one.sample.offset_y_m,
            one.sample.value,
            one.sample.deviation,
            one.sample.readings,
            one.record,
            one.shared,
        )
        for one in survey.taken()
    )
    taken = Counter(one.robot for one in samples)
    unit = QUANTITIES[section.quantity][1]
    cells, sampled = grid.rows * grid.columns, int(found.sampled.sum())
    figures: dict[str, Any] = {
        "method": section.method,
        "quantity": section.quantity,
        "unit": unit,
        "complete": found.complete,
        "agreed_s": survey.agreed_s,
        "cells": cells,
        "cells_sampled": sampled,
        "share_sampled": sampled / cells,
        "cells_given_up": [list(cell) for cell in found.given_up],
        "samples": len(samples),
        "samples_repeated": sum(one.shared for one in samples) - sampled,
        "samples_without_record": sum(one.record is None for one in samples),
        "samples_not_shared": sum(not one.shared for one in samples),
        "records": survey.records,
        "lines": survey.mission.lines,
        "lines_with_memory": section.lines,
        "error": errors(found.matrix, true),
        "error_sampled": errors(np.where(found.sampled, found.matrix, np.nan), true),
        "error_recovered": errors(np.where(found.sampled, np.nan, found.matrix), true),
        "span": float(np.ptp(true)),
        "frames": int(hearing.sent.sum()),
        "robots": {
            robot.name: {
                "samples": taken[robot.name],
                "path_length_m": _plain(robot.metrics.get("path_length_m")),
                "energy_j": _plain(robot.metrics.get("energy_j")),
                "frames": int(hearing.sent[place]),
            }
            for place, robot in enumerate(robots)
        },
    }
    return SurveyData(
        section.quantity,
        unit,
        section.method,
        np.array([grid.centre((0, column))[0] for column in range(grid.columns)]),
        np.array([grid.centre((row, 0))[1] for row in range(grid.rows)]),
        samples,
        found.matrix,
        found.deviation,
        true,
        found.sampled,
        found.given_up,
        tuple(survey.watch.events),
        parents,
        figures,
    )


def field(config: Scenario) -> Field:
    """Return the field that is surveyed."""
    of = {"temperature": model.temperature_c, "pollutant": model.pollutant_ug_l}
    return of[config.survey.quantity](config)


def _plain(value: float | None) -> float | None:
    return None if value is None else float(value)
