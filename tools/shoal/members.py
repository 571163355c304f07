"""From the scenario of a shoal to that of each robot in it.

All that chance decides of a robot comes from the run's seed and the robot's own name, so that it
does not depend on how many others there are.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import TYPE_CHECKING

from msgspec.structs import replace

from tools.shoal_section import addresses, names, starts

if TYPE_CHECKING:
    from tools.configuration import FlashCut, Scenario, SupplyCut

CRYSTAL_PPM = 10_000.0
"""As far as a crystal may be off in a scenario (`tools.ranges`)."""


@dataclass(frozen=True, slots=True)
class Member:
    """One robot of a shoal before it is put together."""

    name: str
    address: int
    config: Scenario
    """The shoal's, with this robot's start, address, crystals and faults."""
    switch_on_s: float


def members(config: Scenario) -> tuple[Member, ...]:
    """Return the robots of a shoal, in the order of their addresses."""
    return tuple(
        _member(config, name, address, pose)
        for name, address, pose in zip(
            names(config), addresses(config), starts(config), strict=True
        )
    )


def _member(config: Scenario, name: str, address: int, pose: tuple[float, float, float]) -> Member:
    chance = random.Random(f"{config.scenario.seed}/{name}/member")
    spread, x_m, y_m = config.shoal.clock_spread_ppm, pose[0], pose[1]
    proc, nav = (
        min(max(round(drift + spread * chance.gauss(), 2), -CRYSTAL_PPM), CRYSTAL_PPM)
        for drift in (config.procboard.clock_drift_ppm, config.navboard.clock_drift_ppm)
    )

    def hits(cut: SupplyCut | FlashCut) -> bool:
        return not cut.robots or address in cut.robots

    faults = config.faults
    own = replace(
        config,
        initial=replace(config.initial, x_m=x_m, y_m=y_m, heading_rad=pose[2]),
        procboard=replace(config.procboard, address=address, clock_drift_ppm=proc),
        navboard=replace(config.navboard, clock_drift_ppm=nav),
        faults=replace(
            faults,
            supply_cuts=tuple(filter(hits, faults.supply_cuts)),
            flash_cuts=tuple(filter(hits, faults.flash_cuts)),
        ),
    )
    return Member(name, address, own, config.shoal.switch_on_s * chance.random())
