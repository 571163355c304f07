"""What `fishbed hil` and `fishbed board` share: the scenario with a line in it, and its figures.

Both are runs in which one board is real, seen from either side: `board nav` has an emulated
navigation board and a real processing board, as `hil --proc`. They differ in what they leave.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import msgspec

from tools import scenario
from tools.bench.lateness import Stall
from tools.bench.plant_figures import port_words
from tools.bench.plant_figures import words as plant_words
from tools.configuration import Hil
from tools.errors import UserError

if TYPE_CHECKING:
    from tools.configuration import Scenario

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
    duration_s: float | None = None,
    seed: int | None = None,
    late: str | None = None,
    late_bound_s: float | None = None,
) -> Scenario:
    """Load a scenario in which the named board is real; what is None is the scenario's own.

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
        "late": late,
        "late_bound_s": late_bound_s,
    }
    changes = {key: value for key, value in asked.items() if value}
    hil = msgspec.structs.replace(config.hil, **changes)
    if not hil.url:
        raise UserError("no line to a real board: give --nav, --proc or --plant-for URL")
    if hil.plant_for and (hil.nav or hil.proc or hil.plant):
        raise UserError("--plant-for: the plant is alone there, without any other line")
    if hil.nav and hil.proc:
        raise UserError("one board at least is emulated: name one line, not both")
    try:
        msgspec.convert(msgspec.to_builtins(hil), Hil)
    except msgspec.ValidationError as error:
        option = "--rate" if "plant_rate_hz" in str(error) else "--late-bound"
        raise UserError(f"{option}: {error}") from error
    return msgspec.structs.replace(config, hil=hil)


def words(hil: Mapping[str, Any]) -> list[str]:
    """Lines on the real board, for the terminal."""
    late, trip, out = hil["lateness"], hil["round_trip"], hil["outages"]
    lines = [
        f"  {'real':<14}{hil['real']} at {hil['line']}",
        (
            f"  {'lateness':<14}p99 {_ms(late['p99_s'])}, max {_ms(late['maximum_s'])}, "
            f"{late['missed']} later than {_ms(late['deadline_s'])}"
        ),
    ]
    worst = [Stall(**stall) for stall in late["worst"]]
    if worst and worst[0].late_s > late["deadline_s"]:
        lines.append(f"  {'worst':<14}{worst[0].words()}")
        lines += [f"  {'':<14}{stall.words()}" for stall in worst[1:SHOWN_STALLS]]
    if late["stopped"]:
        lines.append(f"  {'':<14}stopped: later than {_ms(late['bound_s'])}")
    if "samples" in hil:  # of a plant in the loop: it has no messages of the boards
        return [*lines, *plant_words(hil), _outages(out)]
    if trip["count"]:
        lines.append(
            f"  {'round trip':<14}median {_ms(trip['median_s'])}, p99 {_ms(trip['p99_s'])}, "
            f"max {_ms(trip['maximum_s'])} ({trip['count']} of {trip['pings_sent']} pings)"
        )
    told = hil["acknowledged"]
    if told["count"]:
        lines.append(
            f"  {'acknowledged':<14}after {_ms(told['median_s'])}, p99 {_ms(told['p99_s'])} "
            f"({told['count']} messages)"
        )
    clock = hil["clock"]
    if clock:
        lines.append(
            f"  {'its clock':<14}{clock['drift_ppm']:+.1f} ± {clock['drift_uncertainty_ppm']:.1f} "
            f"ppm to this machine's, began at {clock['offset_s']:.4f} s"
        )
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
    lines.append(_outages(out))
    if "plant" in hil:
        lines += port_words(hil["plant"])
    return lines


def _outages(out: Mapping[str, Any]) -> str:
    return (
        f"  {'outages':<14}{out['outages']}, {out['down_s']:.2f} s in all, longest "
        f"{out['longest_s']:.2f} s"
    )


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.2f} ms"
