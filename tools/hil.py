"""What `fishbed hil` and `fishbed board` share: the scenario with a line in it, and its figures.

Both are runs in which one board is real, seen from either side: `board nav` has an emulated
navigation board and a real processing board, as `hil --proc`. They differ in what they leave.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import msgspec

from tools import scenario
from tools.bench.lateness import Stall
from tools.errors import UserError
from tools.hil_section import Hil
from tools.words import away, ms, pace

if TYPE_CHECKING:
    from tools.configuration import Scenario

ONE_PROCESS = "pair:"
SHOWN_STALLS = 3
"""Of the worst stalls, those on the terminal; summary.json has ten."""
EXIT_LATE = 1
"""`--late stop`, and it was: a check that the user asked for failed."""


def with_line(
    source: str | None,
    overrides: Sequence[str],
    *,
    nav: str = "",
    proc: str = "",
    plant_for: str = "",
    plant: str = "",
    rate_hz: float | None = None,
    camera: str = "",
    camera_id: str = "",
    xbee: str = "",
    mote: str = "",
    radio_nodes: str | None = None,
    base_port: str = "",
    duration_s: float | None = None,
    seed: int | None = None,
    late: str | None = None,
    late_bound_s: float | None = None,
) -> Scenario:
    """Load a scenario in which what is named is real; what is None is the scenario's own.

    Raises:
        UserError: no such scenario, or one that cannot be; no line, or two.

    """
    config = scenario.load(source or scenario.DEFAULT, overrides, duration_s=duration_s, seed=seed)
    asked = {
        "nav": nav,
        "proc": proc,
        "plant_for": plant_for,
        "plant": plant,
        "plant_rate_hz": rate_hz,
        "camera": camera,
        "camera_id": camera_id,
        "xbee": xbee,
        "mote": mote,
        "radio_nodes": radio_nodes,
        "base_port": base_port,
        "late": late,
        "late_bound_s": late_bound_s,
    }
    changes = {key: value for key, value in asked.items() if value}
    hil = msgspec.structs.replace(config.hil, **changes)
    if hil.url.startswith(ONE_PROCESS):
        where = "hil.nav" if hil.nav else "hil.proc" if hil.proc else "hil.plant_for"
        raise UserError(
            f"{where}: {hil.url} joins two ends in one process; pty: joins two programs"
        )
    if not hil.live:
        raise UserError(
            "no line to a real board: give --nav URL, --proc, --plant-for, --camera or --mote"
        )
    if hil.nav and hil.proc:
        raise UserError("one board at least is emulated: name one line, not both")
    try:
        msgspec.convert(msgspec.to_builtins(hil), Hil)
    except msgspec.ValidationError as error:
        raise UserError(
            f"--rate: {hil.plant_rate_hz:g} is outside 10 to 1000 samples a second"
            if "plant_rate_hz" in str(error)
            else f"--late-bound: {hil.late_bound_s:g} is outside 0.0005 to 60 s"
        ) from error
    changed = msgspec.structs.replace(config, hil=hil)
    scenario.check(changed)
    return changed


@contextmanager
def called(names: Mapping[str, str]) -> Iterator[None]:
    """Have messages that begin with a key of the scenario begin with the option that set it."""
    try:
        yield
    except UserError as error:
        for key, option in names.items():
            if str(error).startswith(f"{key}: "):
                raise UserError(option + str(error).removeprefix(key)) from error
        raise


def words(hil: Mapping[str, Any]) -> list[str]:
    """Lines on whoever took part from outside, for the terminal."""
    late = hil["lateness"]
    lines = [f"  {'real':<14}{hil['real']} at {hil['line']}"] if "real" in hil else []
    lines.append(
        f"  {'lateness':<14}p99 {ms(late['p99_s'])}, max {ms(late['maximum_s'])}, "
        f"{late['missed']} later than {ms(late['deadline_s'])}"
    )
    worst = [Stall(**stall) for stall in late["worst"]]
    if worst and worst[0].late_s > late["deadline_s"]:
        lines.append(f"  {'worst':<14}{worst[0].words()}")
        lines += [f"  {'':<14}{stall.words()}" for stall in worst[1:SHOWN_STALLS]]
    if late["stopped"]:
        lines.append(f"  {'':<14}stopped: later than {ms(late['bound_s'])}")
    if "samples" in hil:  # a plant in the loop: it has no messages of the boards
        from tools.bench.plant_figures import words as plant_words

        lines += [*plant_words(hil), _outages(hil["outages"])]
    elif "real" in hil:
        lines += _board_words(hil)
    if "plant" in hil:
        from tools.bench.plant_figures import port_words as plant_port_words

        lines += plant_port_words(hil["plant"])
    if "camera" in hil:
        from tools.bench.tracker import words as camera_words

        lines += camera_words(hil["camera"])
    if "xbee" in hil:
        from tools.bench.xbee_port import words as xbee_words

        lines += xbee_words(hil["xbee"])
    if "mote" in hil:
        from tools.bench.mote import words as mote_words

        lines += mote_words(hil["mote"])
    if "base_port" in hil:
        from tools.bench.base_port import words as port_words

        lines += port_words(hil["base_port"])
    return lines


def _board_words(hil: Mapping[str, Any]) -> list[str]:
    """Lines on the real board."""
    trip = hil["round_trip"]
    lines = []
    if trip["count"]:
        lines.append(
            f"  {'round trip':<14}median {ms(trip['median_s'])}, p99 {ms(trip['p99_s'])}, "
            f"max {ms(trip['maximum_s'])} ({trip['count']} of {trip['pings_sent']} pings)"
        )
    told = hil["acknowledged"]
    if told["count"]:
        lines.append(
            f"  {'acknowledged':<14}after {ms(told['median_s'])}, p99 {ms(told['p99_s'])} "
            f"({told['count']} messages)"
        )
    clock = hil["clock"]
    if clock:
        lines.append(f"  {'its clock':<14}{pace(clock)}, began at {clock['offset_s']:.4f} s")
    reports, commands = hil["reports"], hil["commands"]
    if reports["delivered"]:
        lines.append(
            f"  {'reports':<14}{reports['delivered']} delivered ({reports['backlog']} of before), "
            f"{reports['missing']} missing, {reports['repeated']} repeated, {reports['lost']} lost"
        )
    if commands["given"]:
        lines.append(
            f"  {'commands':<14}{commands['given']} given, {commands['applied']} applied, "
            f"{commands['surplus']} too often"
        )
    lines.append(_outages(hil["outages"]))
    return lines


def _outages(out: Mapping[str, Any]) -> str:
    return f"  {'outages':<14}{out['outages']}, {away(out)}"
