"""Everything of a run folder that is written when the run is over."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tools.errors import RunFolderError
from tools.field_files import beside, stage
from tools.records.csv import write_channels, write_truth
from tools.records.shoal_data import ShoalData
from tools.records.summary import to_json
from tools.records.survey_data import reconstruction_csv, samples_csv, survey_json
from tools.scenario import to_toml

if TYPE_CHECKING:
    from tools.configuration import Scenario
    from tools.records.data import RunData
    from tools.records.folder import RunFolder


def write_run(folder: RunFolder, config: Scenario, data: RunData | ShoalData) -> None:
    """Write the scenario, the tables, the summary, the report and its pictures.

    The tables of each robot of a shoal lie in a folder of its name. Where the report cannot be
    made, which is our fault, the folder is committed without: the run may have been one of hours,
    with a real board.
    """
    folder.write("scenario.toml", to_toml(beside(stage(folder, config))))
    try:
        if isinstance(data, ShoalData):
            for robot in data.robots:
                write_channels(folder.file(f"{robot.name}/channels.csv"), robot.channels)
                write_truth(folder.file(f"{robot.name}/truth.csv"), robot.truth)
            if data.survey is not None:
                folder.write("survey.json", survey_json(data.survey))
                folder.write("samples.csv", samples_csv(data.survey))
                folder.write("reconstruction.csv", reconstruction_csv(data.survey))
        else:
            write_channels(folder.file("channels.csv"), data.channels)
            write_truth(folder.file("truth.csv"), data.truth, data.truth_every)
    except OSError as error:
        raise RunFolderError(f"{folder.path}: cannot be written: {error.strerror}") from error
    folder.write("summary.json", to_json(data))
    try:
        page, picture = _report(config, data)
    except Exception as error:
        folder.commit()
        error.add_note(f"fishbed: the run is kept without a report in {folder.path}")
        raise
    folder.write("report.html", page)
    folder.write("path.svg", picture)


def _report(config: Scenario, data: RunData | ShoalData) -> tuple[str, str]:
    """Make the page and its main picture; what draws a shoal is loaded for a shoal only."""
    if isinstance(data, ShoalData):
        from tools.report.shoal_page import render_shoal
        from tools.report.shoal_paths import paths_picture
        from tools.report.survey_source import survey_view

        return render_shoal(data, survey_view(config, data)), paths_picture(data)
    from tools.report.page import render
    from tools.report.path import path_picture

    return render(data), path_picture(data)
