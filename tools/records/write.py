"""Everything of a run folder that is written when the run is over."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tools.errors import RunFolderError
from tools.field_files import beside, stage
from tools.records.csv import write_channels, write_truth
from tools.records.summary import to_json
from tools.scenario import to_toml

if TYPE_CHECKING:
    from tools.configuration import Scenario
    from tools.records.data import RunData
    from tools.records.folder import RunFolder


def write_run(folder: RunFolder, config: Scenario, data: RunData) -> None:
    """Write the scenario, the tables, the summary, the report and its pictures.

    Where the report cannot be made, which is our fault, the folder is committed without: the run
    may have been one of hours, with a real board.
    """
    from tools.report.page import render
    from tools.report.path import path_picture

    folder.write("scenario.toml", to_toml(beside(stage(folder, config))))
    try:
        write_channels(folder.file("channels.csv"), data.channels)
        write_truth(folder.file("truth.csv"), data.truth, data.truth_every)
    except OSError as error:
        raise RunFolderError(f"{folder.path}: cannot be written: {error.strerror}") from error
    folder.write("summary.json", to_json(data))
    try:
        page, picture = render(data), path_picture(data)
    except Exception as error:
        folder.commit()
        error.add_note(f"fishbed: the run is kept without a report in {folder.path}")
        raise
    folder.write("report.html", page)
    folder.write("path.svg", picture)
