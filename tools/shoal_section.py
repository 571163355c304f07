"""`[shoal]` of a scenario: how many robots there are, and where they start.

A shoal is one scenario for all: every robot has the body, boards and application that the scenario
describes. They differ by their radio addresses, which count up from `procboard.address`, by their
starts, and by all that chance decides. What may differ besides names the addresses that it is for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from msgspec import Meta

from tools.ranges import Angle, Extent, PanId, Position, Section

if TYPE_CHECKING:
    from tools.configuration import Initial, Scenario

FEW = 4
"""Up to so many robots have their wires recorded unasked: a robot's spi.vcd is 1 MB a second."""
RESERVED = 0xFFFE
"""From here on addresses are no robot's: no short address, and broadcast (802.15.4)."""

KeyPaths: TypeAlias = "tuple[tuple[str | int, ...], ...]"
Finding: TypeAlias = "tuple[KeyPaths, str]"
Pose: TypeAlias = "tuple[float, float, float]"  # x in m, y in m, heading in rad


class ShoalStart(Section, frozen=True):
    """`[[shoal.starts]]`: where a robot begins, in the order of the addresses."""

    x_m: Position
    y_m: Position
    heading_rad: Angle = 0.0


class Shoal(Section, frozen=True):
    """`[shoal]`: several robots with one base station, in one tank and on one radio channel.

    `robots` above 0 makes a shoal; 0 is the one robot of all other scenarios. Their radio addresses
    count up from `procboard.address`, and they are called after these: fish01, fish02, … The
    formation is laid around the pose of `[initial]`, neighbours `spacing_m` apart: rows across that
    heading, the first robot ahead; or a circle in which each heads outwards, turned by that
    heading. `starts` has their poses one by one in its place. Body velocities are those of
    `[initial]`.

    Robots are switched on at random within `switch_on_s`, and their crystals are off by the boards'
    `clock_drift_ppm` and a random share with the standard deviation `clock_spread_ppm`: at zero all
    boards work in step, as no real ones do.

    `spi_vcd`: addresses of those whose wires between the boards are recorded; empty: all of up to
    four, none of more.
    """

    robots: Annotated[int, Meta(ge=0, le=1000)] = 0
    formation: Literal["grid", "circle"] = "grid"
    spacing_m: Extent = 0.5
    starts: tuple[ShoalStart, ...] = ()
    switch_on_s: Annotated[float, Meta(ge=0, le=60)] = 0.0
    clock_spread_ppm: Annotated[float, Meta(ge=0, le=1000)] = 0.0
    spi_vcd: tuple[PanId, ...] = ()


def addresses(config: Scenario) -> range:
    """Radio addresses of the robots, those of a shoal or the one."""
    first = config.procboard.address
    return range(first, first + max(1, config.shoal.robots))


def names(config: Scenario) -> tuple[str, ...]:
    """Names of the robots of a shoal, which sort as their addresses do."""
    every = addresses(config)
    digits = max(2, len(str(every[-1])))
    return tuple(f"fish{address:0{digits}d}" for address in every)


def recorded(config: Scenario) -> tuple[int, ...]:
    """Addresses of those of a shoal whose wires are recorded."""
    few = addresses(config) if config.shoal.robots <= FEW else ()
    return config.shoal.spi_vcd or tuple(few)


def starts(config: Scenario) -> tuple[Pose, ...]:
    """Where the robots of a shoal start: (x in m, y in m, heading in rad)."""
    shoal = config.shoal
    if shoal.starts:
        return tuple((start.x_m, start.y_m, start.heading_rad) for start in shoal.starts)
    places = {"grid": _grid, "circle": _circle}[shoal.formation](shoal.robots, shoal.spacing_m)
    return tuple(_laid(place, config.initial) for place in places)


def _grid(robots: int, spacing_m: float) -> list[Pose]:
    """Rows across the heading, as square as it gets; the last one centred. From ahead to behind."""
    columns = math.ceil(math.sqrt(robots))
    rows = math.ceil(robots / columns)
    places = []
    for place in range(robots):
        row, column = divmod(place, columns)
        wide = min(columns, robots - row * columns)
        ahead, left = (rows - 1) / 2 - row, (wide - 1) / 2 - column
        places.append((spacing_m * ahead, spacing_m * left, 0.0))
    return places


def _circle(robots: int, spacing_m: float) -> list[Pose]:
    """On a circle whose chord between neighbours is the spacing, from ahead to the left."""
    if robots == 1:
        return [(0.0, 0.0, 0.0)]
    radius = spacing_m / (2.0 * math.sin(math.pi / robots))
    turns = [2.0 * math.pi * place / robots for place in range(robots)]
    return [(radius * math.cos(turn), radius * math.sin(turn), turn) for turn in turns]


def _laid(place: Pose, around: Initial) -> Pose:
    """Turn a place of a formation by the heading around which it is laid."""
    ahead, left, turn = place
    heading = around.heading_rad
    cosine, sine = math.cos(heading), math.sin(heading)
    x = around.x_m + cosine * ahead - sine * left
    y = around.y_m + sine * ahead + cosine * left
    return x, y, heading if turn == 0.0 else math.remainder(heading + turn, 2.0 * math.pi)


def shoal_contradictions(config: Scenario) -> Iterator[Finding]:
    """What the keys of a shoal ask of each other and of the rest."""
    shoal = config.shoal
    every = addresses(config)
    if shoal.starts and len(shoal.starts) != shoal.robots:
        both: KeyPaths = (("shoal", "robots"), ("shoal", "starts"))
        yield both, f"there are {len(shoal.starts)} shoal.starts: one for each robot, or none"
        return
    yield from _unknown_robots(config)
    if not shoal.robots:
        return
    if config.base_station.address in every[1:]:
        both = (("base_station", "address"), ("shoal", "robots"), ("procboard", "address"))
        yield both, f"must not be the address of a robot: they have {every[0]} to {every[-1]}"
    if every[-1] >= RESERVED:
        both = (("shoal", "robots"), ("procboard", "address"))
        yield both, "addresses of all robots must be < 65534: 0xFFFE and 0xFFFF are reserved"
    for key in ("nav", "proc", "plant_for", "plant", "camera", "xbee", "mote", "base_port"):
        if getattr(config.hil, key):
            both = (("shoal", "robots"), ("hil", key))
            yield both, f"a shoal is emulated as a whole: leave hil.{key} out"
    (left, low), (width, height) = config.tank.corner_m, config.tank.size_m
    right, high = left + width, low + height
    inside = f"in the tank, x {left:g} … {right:g} m, y {low:g} … {high:g} m"
    for index, (x, y, _) in enumerate(starts(config)):
        if left <= x <= right and low <= y <= high:
            continue
        if shoal.starts:
            axis = "y_m" if left <= x <= right else "x_m"
            yield (("shoal", "starts", index, axis),), f"must lie {inside}"
        else:
            both = (("shoal", "spacing_m"), ("shoal", "robots"), ("shoal", "formation"))
            yield both, f"robot {index + 1} of the {shoal.formation} does not start {inside}"
        return


def _unknown_robots(config: Scenario) -> Iterator[Finding]:
    """Addresses that no robot has."""
    every = addresses(config)
    says = "no robot has this address: " + (
        f"they have {every[0]} to {every[-1]}" if len(every) > 1 else f"the robot has {every[0]}"
    )
    for section, key in (
        ("base_station", "tail_beats"),
        ("base_station", "targets"),
        ("faults", "supply_cuts"),
        ("faults", "flash_cuts"),
    ):
        for index, row in enumerate(getattr(getattr(config, section), key)):
            for place, address in enumerate(row.robots):
                if address not in every:
                    yield ((section, key, index, "robots", place),), says
    for place, address in enumerate(config.shoal.spi_vcd):
        if address not in every or not config.shoal.robots:
            yield (("shoal", "spi_vcd", place),), says
