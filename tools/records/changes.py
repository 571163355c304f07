"""What a run's scenario changes in the bundled model that it goes back to, in words.

A resolved scenario stands alone and has forgotten its `base`. So it is held against the bundled
scenario of its name, and where it has a name of its own, against the one that it differs from least
in the robot and its water. Name, seed, duration and what is recorded are no changes of the model.
"""

from __future__ import annotations

import re
from pathlib import PurePath
from typing import Any

from tools import scenario
from tools.configuration import Scenario
from tools.effects import ALL
from tools.records.data import Change, Changes

NOT_OF_THE_MODEL = ("scenario.", "records.", "hil.")
ROBOT = ("plant.", "effects.", "tank.")
"""Whose differences choose the model of a scenario with a name of its own, and are told first."""
PARTS = {
    "plant.body": "body",
    "plant.tail": "tail",
    "plant.hydrodynamics": "water on the body",
    "plant.water": "water",
    "plant.walls": "walls",
    "plant.servo": "servo",
    "plant.linkage": "linkage of the tail",
    "plant": "integration",
    "tank.temperature": "temperature of the water",
    "tank.pollutant": "pollutant in the water",
    "procboard.tail_beat": "tail-beat",
    "procboard.heading": "heading control",
    "procboard.tracking": "target tracking",
    "procboard": "processing board",
    "navboard": "navigation board",
    "base_station": "base station",
    "initial": "start",
}
"""Words for the sections of a scenario; others are named as they are."""
WORDS = {
    "plant.tail.segments": "the tail bends, rigid segments joined by springs",
    "plant.tail.modes": "the tail bends, a beam with so many modes",
    "plant.tail.modulus_pa": "tail: Young's modulus",
    "plant.tail.damping_s": "tail: damping over stiffness",
    "plant.tail.joint_stiffness_n_m": "tail: stiffness of each joint",
    "plant.water.current_x_m_s": "current along x",
    "plant.water.current_y_m_s": "current along y",
    "plant.water.shear_x_per_y_s": "current along x rises with y by",
    "plant.water.shear_y_per_x_s": "current along y rises with x by",
    "plant.walls.drag_rise": "drag at a wall rises by the factor 1 + k, k",
    "plant.walls.stiffness_n_m": "walls are solid: stiffness",
    "plant.servo.ideal": "the tail is where it is told to be (ideal servo)",
}
"""Keys whose names say too little."""
UNITS = (
    ("n_m_s2", "N·m·s²"),
    ("n_s_m", "N·s/m"),
    ("kg_m2", "kg·m²"),
    ("kg_m3", "kg/m³"),
    ("s_rad", "s/rad"),
    ("rad_s", "rad/s"),
    ("c_m", "°C/m"),
    ("ug_l_m", "µg/(L·m)"),
    ("m_s", "m/s"),
    ("n_m", "N·m"),
    ("ug_l", "µg/L"),
    ("per_s", "1/s"),
    ("x_s", "1/s"),
    ("y_s", "1/s"),
    ("m2", "m²"),
    ("rad", "rad"),
    ("v_per_cell", "V a cell"),
    ("deg", "°"),
    ("ohm", "Ω"),
    ("ppm", "ppm"),
    ("hz", "Hz"),
    ("kg", "kg"),
    ("pa", "Pa"),
    ("ah", "Ah"),
    ("db", "dB"),
    ("dbm", "dBm"),
    ("ms", "ms"),
    ("us", "µs"),
    ("m", "m"),
    ("s", "s"),
    ("v", "V"),
    ("a", "A"),
    ("t", "T"),
    ("c", "°C"),
)
"""Ends of keys and the units that they stand for; an end stands before what it ends with."""
OTHER_UNITS = {"plant.walls.stiffness_n_m": "N/m", "plant.tail.joint_stiffness_n_m": "N·m/rad"}


def changes(config: Scenario) -> Changes:
    """Return the model that a scenario goes back to, and where the two differ."""
    mine = scenario.keys(config)
    own, names = config.scenario.name, list(scenario.bundled())
    models = [own] if own in names else names
    known = {name: scenario.keys(scenario.load(name)) for name in models}

    def distance(name: str) -> tuple[int, int, str]:
        theirs = known[name]
        return len(_differing(mine, theirs, ROBOT)), len(_differing(mine, theirs)), name

    model = min(known, key=distance)
    theirs = known[model]
    keys = _differing(mine, theirs)
    keys.sort(key=lambda key: (not key.startswith("effects."), not key.startswith(ROBOT)))
    return Changes(model, tuple(_change(key, mine.get(key), theirs.get(key)) for key in keys))


def _differing(
    mine: dict[str, Any], theirs: dict[str, Any], among: tuple[str, ...] = ("",)
) -> list[str]:
    """Keys below `among` that have another value; a list that is not there is an empty one."""
    return [
        key
        for key in dict.fromkeys((*mine, *theirs))
        if key.startswith(among)
        and not key.startswith(NOT_OF_THE_MODEL)
        and mine.get(key, ()) != theirs.get(key, ())
    ]


def _change(key: str, value: Any, usual: Any) -> Change:
    section, _, name = re.sub(r"(\[\d+\])+$", "", key).rpartition(".")
    stem, unit = _parted(name)
    if section.startswith("effects."):
        effect = ALL[section.removeprefix("effects.")]
        unit = next(part.unit for part in effect.parameters if part.name == name)
        what = f"{effect.name.replace('_', ' ')}: {effect.description}"
        short = name if ":" in name else name.partition("_")[0]
        said = f"{short} = {_said(key, value, unit)}"
        return Change(what, key, said, _said(key, usual, unit))
    unit = OTHER_UNITS.get(f"{section}.{name}", unit)
    what = WORDS.get(f"{section}.{name}", f"{_part(section)}: {stem.replace('_', ' ')}")
    return Change(what, key, _said(key, value, unit), _said(key, usual, unit))


def _part(section: str) -> str:
    """Words for a section, or for the nearest around it that has some."""
    bare = re.sub(r"\[\d+\]", "", section)
    inner = ""
    while bare not in PARTS and "." in bare:
        bare, _, last = bare.rpartition(".")
        inner = f", {last}{inner}"
    return (PARTS.get(bare, bare) + inner).replace("_", " ")


def _parted(name: str) -> tuple[str, str]:
    """What a key's name says, and its unit."""
    for end, unit in UNITS:
        if name.endswith(f"_{end}"):
            return name.removesuffix(f"_{end}"), unit
    return name, ""


def _said(key: str, value: Any, unit: str) -> str:
    """A value with its unit; files without their folder."""
    if value is None or value in ("", ()):
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return PurePath(value).name if key.endswith(".file") else value
    if isinstance(value, int | float):
        return f"{value:.6g} {unit}".strip().replace("-", "−")
    return str(value)
