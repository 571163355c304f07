"""From `[survey]` of a scenario to what boards and base are made of."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from firmware_model.msp430.memory import RAM_END, RAM_START
from procboard.applications.survey import ram_bytes
from procboard.firmware import FirmwareConfig
from procboard.routing.config import RoutingConfig
from procboard.storage import FullPolicy, LogConfig
from procboard.survey.expansion import Expansion
from procboard.survey.fixed import at_random, everywhere
from procboard.survey.knowledge import Grid
from procboard.survey.mission import MissionConfig
from procboard.survey.successive import algorithm_3
from procboard.survey.tolerant import noise_tolerant
from tools.errors import ScenarioError

if TYPE_CHECKING:
    from procboard.network import NetworkConfig
    from tools.configuration import Scenario

LOG_SECTORS: Final = 10
"""Of sixteen, those that the network layer leaves."""
LOG_BUFFER_BYTES: Final = 256
"""Five reports: those of half a second, or, stored once a second, of five flash erasures."""


def grid(config: Scenario) -> Grid:
    """Return the cells."""
    survey = config.survey
    return Grid(survey.rows, survey.columns, survey.cell_m, *survey.corner_m)


def mission_config(config: Scenario) -> MissionConfig:
    """Return the constants of the mission."""
    survey = config.survey

    def ms(seconds: float) -> int:
        return round(1e3 * seconds)

    return MissionConfig(
        grid(config),
        reading_sigma=survey.reading_deviation,
        place_sigma=survey.place_deviation,
        before_ms=ms(survey.before_s),
        dwell_ms=ms(survey.dwell_s),
        gather_ms=ms(survey.gather_s),
        heartbeat_ms=ms(survey.heartbeat_s),
        silence_ms=ms(survey.silence_s),
        reach_ms=ms(survey.reach_s),
        rest_ms=ms(survey.rest_s),
    )


def way(config: Scenario) -> Callable[[], Expansion]:
    """Return what makes the survey in its first state."""
    survey = config.survey
    shape = survey.rows, survey.columns
    period_s = config.navboard.report_period_s
    readings = max(1, round((survey.before_s + survey.dwell_s) / period_s))
    sigma = mission_config(config).deviation(readings)
    if survey.method == "everywhere":
        return lambda: everywhere(shape, sigma)
    if survey.method == "random":
        return lambda: at_random(shape, survey.share, sigma, seed=config.scenario.seed)
    if survey.rank:
        return lambda: algorithm_3(shape, survey.rank, config.scenario.seed)
    return lambda: noise_tolerant(shape, sigma, seed=config.scenario.seed)


def routing_config(config: Scenario, *, base: bool = False) -> RoutingConfig:
    """Return the network layer of a robot, or of the base."""
    return RoutingConfig(base=base, item_limit=config.survey.items)


def firmware_config(
    config: Scenario, network: NetworkConfig, policy: FullPolicy, latency_s: float
) -> FirmwareConfig:
    """Return what is compiled into the processing board of a robot that surveys."""
    survey = config.survey
    lines = min(survey.lines, max(survey.rows, survey.columns))
    firmware = FirmwareConfig(
        network,
        log=LogConfig(sector_count=LOG_SECTORS, buffer_bytes=LOG_BUFFER_BYTES, policy=policy),
        store_latency_s=latency_s,
        routing=routing_config(config),
        application_bytes=ram_bytes(
            (survey.rows, survey.columns), lines if survey.method == "expansion" else 0
        ),
    )
    too_much = firmware.ram_bytes - (RAM_END - RAM_START)
    if too_much > 0:
        raise ScenarioError(
            f"survey.rows, columns, lines, items: {too_much} bytes more than the 10 KB of RAM that "
            "a board has; take fewer"
        )
    return firmware
