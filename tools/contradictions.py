"""What no single key of a scenario can know: which keys contradict each other, and what is allowed.

Each finding is the keys of which one is wrong, and words that say what would be right; who asks
knows where they came from.
"""

from __future__ import annotations

from collections.abc import Iterator
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from typing import TYPE_CHECKING, Any

from plant.errors import InvalidParameterError
from plant.extra_force import check_name
from tools.shoal_section import shoal_contradictions
from tools.survey_section import survey_contradictions, surveys

if TYPE_CHECKING:
    from tools.configuration import Scenario, TailBeat, TimedTailBeat

Step = str | int
KeyPath = tuple[Step, ...]

MOST_TARGETS = 16
"""Of target tracking (`procboard.applications.target_tracking`; a test keeps them together)."""


def contradictions(config: Scenario) -> Iterator[tuple[tuple[KeyPath, ...], str]]:
    """What no single field can know: the keys of which one is wrong, and what is allowed."""
    (left, low), (width, height) = config.tank.corner_m, config.tank.size_m
    right, high = left + width, low + height
    inside = f"must lie in the tank, x {left:g} … {right:g} m, y {low:g} … {high:g} m"

    def outside(x: float, y: float) -> bool:
        return not (left <= x <= right and low <= y <= high)

    if outside(config.initial.x_m, config.initial.y_m):
        bad_x = not left <= config.initial.x_m <= right
        yield (("initial", "x_m" if bad_x else "y_m"),), inside
    heads_for_target = config.procboard.application == "heading"
    if heads_for_target and outside(*config.procboard.heading.target_m):
        yield (("procboard", "heading", "target_m"),), inside
    tracking = config.procboard.tracking
    for index, place in enumerate(tracking.targets_m):
        if outside(*place):
            yield (("procboard", "tracking", "targets_m", index),), inside
    for index, target in enumerate(config.base_station.targets):
        if outside(target.x_m, target.y_m):
            bad_x = not left <= target.x_m <= right
            yield (("base_station", "targets", index, "x_m" if bad_x else "y_m"),), inside
    limit_rad = config.navboard.tail_limit_rad
    beats: list[tuple[KeyPath, TailBeat | TimedTailBeat]] = [
        (("procboard", "tail_beat"), config.procboard.tail_beat),
        *(
            (("base_station", "tail_beats", index), beat)
            for index, beat in enumerate(config.base_station.tail_beats)
        ),
    ]
    for at, beat in beats:
        if abs(beat.bias_rad) + beat.amplitude_rad > limit_rad:
            both = ((*at, "amplitude_rad"), (*at, "bias_rad"))
            shown = inwards(limit_rad, up=False)
            yield both, f"must stay within navboard.tail_limit_rad together, {shown} rad"
    tracks = config.procboard.application == "target-tracking" or surveys(config)
    if (heads_for_target or tracks) and config.procboard.tail_beat.frequency_hz == 0.0:
        at_rest = (("procboard", "tail_beat", "frequency_hz"),)
        yield at_rest, "must be > 0: who heads for a target beats its tail"
    if tracks:
        yield from _tracking_contradictions(config)
    if surveys(config):
        yield from survey_contradictions(config)
    period_s, tick_s = config.navboard.report_period_s, 1.0 / config.navboard.control_hz
    if period_s < tick_s * (1.0 - 1e-9):
        both = (("navboard", "report_period_s"), ("navboard", "control_hz"))
        yield both, f"a report is made in a control tick: at least {inwards(tick_s, up=True)} s"
    effects: Any = config.effects
    for name in effects.unknown_force:
        try:
            check_name(name, name)
        except InvalidParameterError as error:
            yield (("effects", "unknown_force", name),), error.reason
    if config.procboard.address == config.base_station.address:
        both = (("base_station", "address"), ("procboard", "address"))
        yield both, "must not be the address of the other station"
    if config.hil.nav and config.hil.proc:
        both = (("hil", "proc"), ("hil", "nav"))
        yield both, "one board at least is emulated: name one line, not both"
    hil = config.hil
    others = (hil.nav, hil.proc, hil.plant, hil.camera, hil.xbee, hil.mote, hil.base_port)
    if hil.plant_for and any(others):
        yield (("hil", "plant_for"),), "the plant is alone there, without any other line"
    yield from _shared_lines(config)
    yield from shoal_contradictions(config)
    if hil.plant and not hil.proc:
        yield (("hil", "plant"),), "is for an emulated navigation board beside hil.proc"
    yield from _air_contradictions(config)
    if config.hil.xbee:
        yield from _operator_contradictions(config)
    for who in ("procboard", "base_station"):
        if getattr(config, who).address >= 0xFFFE:
            yield ((who, "address"),), "must be < 65534: 0xFFFE and 0xFFFF are reserved in 802.15.4"


def _shared_lines(config: Scenario) -> Iterator[tuple[tuple[KeyPath, ...], str]]:
    """Two parties on one line: the second pty would take the link from the first, unseen."""
    taken: dict[str, str] = {}
    for key in ("nav", "proc", "plant", "camera", "xbee", "mote", "base_port"):
        url = getattr(config.hil, key)
        if not url or url == "pty:":  # each is a new one
            continue
        if url in taken:
            both = (("hil", key), ("hil", taken[url]))
            yield both, f"{url} is the line of hil.{taken[url]} already: each has its own"
        taken[url] = key


def _air_contradictions(config: Scenario) -> Iterator[tuple[tuple[KeyPath, ...], str]]:
    """What cannot be emulated and real on the air at once."""
    hil = config.hil
    nodes = ("hil", "radio_nodes")
    if hil.radio_nodes == "base" and hil.nav:
        both = (nodes, ("hil", "nav"))
        yield both, "must not be base with hil.nav: then the processing board and its radio are"
    if hil.radio_nodes == "robot" and hil.proc:
        both = (nodes, ("hil", "proc"))
        yield both, "must not be robot with hil.proc: that board has a radio of its own"
    if hil.radio_nodes == "robot" and hil.base_port:
        both = (nodes, ("hil", "base_port"))
        yield both, "must not be robot with hil.base_port: the base station is emulated for it"
    if hil.xbee and hil.base_port:
        both = (("hil", "xbee"), ("hil", "base_port"))
        yield both, "stands in the place of the base station, whose port hil.base_port is"
    if hil.xbee and hil.mote:
        both = (("hil", "xbee"), ("hil", "mote"))
        yield both, "hil.mote does not carry the frames of an XBee module: name one of them"
    if hil.radio_nodes != "both" and not (hil.mote or hil.base_port):
        yield (
            (nodes,),
            "must be both: no hil.mote leads to the other one",
        )


def _operator_contradictions(config: Scenario) -> Iterator[tuple[tuple[KeyPath, ...], str]]:
    """What nobody does where an operator's XBee module stands in the place of the base station."""
    base, xbee = config.base_station, ("hil", "xbee")
    instead = "is for the base station, in whose place hil.xbee is: leave one of the two out"
    for key, value in (
        ("tail_beats", base.tail_beats), ("targets", base.targets), ("send_pose", base.send_pose)
    ):  # fmt: skip
        if value:
            yield (("base_station", key), xbee), instead
    if config.hil.proc:
        both = (xbee, ("hil", "proc"))
        yield both, "a real processing board does not hear an emulated module: name one of them"


def _tracking_contradictions(config: Scenario) -> Iterator[tuple[tuple[KeyPath, ...], str]]:
    """What target tracking asks of other keys, and of its own among each other."""
    at, beat = ("procboard", "tracking"), config.procboard.tail_beat
    tracking, limit_rad = config.procboard.tracking, config.navboard.tail_limit_rad
    if len(tracking.targets_m) > MOST_TARGETS:
        says = f"{len(tracking.targets_m)} targets; the board has room for {MOST_TARGETS}"
        yield ((*at, "targets_m"),), says
    if beat.amplitude_rad == 0.0:
        still = (("procboard", "tail_beat", "amplitude_rad"),)
        yield still, "must be > 0: who heads for a target beats its tail"
    if tracking.bias_max_rad + beat.amplitude_rad > limit_rad:
        both: tuple[KeyPath, ...] = (
            (*at, "bias_max_rad"),
            ("procboard", "tail_beat", "amplitude_rad"),
        )
        shown = inwards(limit_rad, up=False)
        yield both, f"must stay within navboard.tail_limit_rad together, {shown} rad"
    if tracking.approach_below_rad > tracking.turn_above_rad:
        both = ((*at, "approach_below_rad"), (*at, "turn_above_rad"))
        yield both, "approach_below_rad must not be above turn_above_rad"
    if 0.0 < tracking.leave_radii < 2.0:
        yield ((*at, "leave_radii"),), "must be 0, or at least 2: a turn is two radii wide"
    if not config.base_station.send_pose:
        unseen = (("base_station", "send_pose"), ("procboard", "application"))
        yield unseen, "must be true: who swims to places lives on poses by radio"
    if not config.camera.fitted:
        blind = (("camera", "fitted"), ("procboard", "application"))
        yield blind, "must be true: who swims to places lives on the camera's poses"


def inwards(limit: float, *, up: bool) -> str:
    """A limit in six digits, rounded up or down to the side that is allowed."""
    context = Context(prec=6, rounding=ROUND_CEILING if up else ROUND_FLOOR)
    return f"{float(context.create_decimal(repr(limit))):g}"
