"""All cases by name, in the order of the table. A new one is a function, its rows, and a line."""

from __future__ import annotations

from tools.benchmarks import link, many, plant, robot, shoal, survey
from tools.benchmarks.measure import Case

CASES: dict[str, Case] = {
    "rigid": Case("plant", plant.rigid, plant.rigid_rows),
    "default-step": Case("plant", plant.default_step, plant.default_step_rows),
    "segments": Case("plant", plant.segments, plant.segments_rows),
    "ensemble": Case("many", many.ensemble, many.ensemble_rows),
    "orbit": Case("many", many.orbit, many.orbit_rows),
    "search": Case("many", many.search, many.search_rows),
    "robot": Case("robot", robot.robot, robot.robot_rows),
    "files": Case("robot", robot.files, robot.files_rows),
    "shell": Case("robot", robot.shell, robot.shell_rows),
    "shoal": Case("shoal", shoal.shoal, shoal.shoal_rows),
    "reconstruction": Case("survey", survey.reconstruction, survey.reconstruction_rows),
    "codec": Case("link", link.codec, link.codec_rows),
    "messages": Case("link", link.messages, link.messages_rows),
    "lines": Case("link", link.lines, link.lines_rows),
    "imports": Case("link", link.imports, link.imports_rows),
}
"""What is measured, and how the table tells it."""

PARTS = tuple(dict.fromkeys(case.part for case in CASES.values()))
