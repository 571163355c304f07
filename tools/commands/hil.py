"""`fishbed hil`: a robot one board of which is real, at the other end of a line.

`--nav URL` puts a real navigation board (or one on a pty) beside the emulated processing board, and
`--proc URL` the other way round. `--plant-for URL` has a real navigation board swim the emulated
plant: raw sensor signals go there, servo pulses come back. Otherwise it is a run: real time, and a
run folder at its end.
"""

from __future__ import annotations

import argparse

from tools.commands.run import EXIT_INTERRUPTED, folder_name, positive, run_into_folder
from tools.errors import UserError

NAME = "hil"
ROLES = ("nav", "proc", "camera", "mote")
HELP = "hardware in the loop: run a robot one board or the camera of which is real"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("scenario", nargs="?", metavar="SCENARIO|FILE.toml", help="as of run")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--nav", default="", metavar="URL", help="the navigation board is real")
    which.add_argument("--proc", default="", metavar="URL", help="the processing board is real")
    which.add_argument(
        "--plant-for", default="", metavar="URL", help="a plant for a real navigation board"
    )
    parser.add_argument(
        "--camera", default="", metavar="URL", help="poses come from a tracker, as JSON lines"
    )
    parser.add_argument(
        "--camera-id", default="", metavar="ID", help="which of the tracker's objects is the robot"
    )
    parser.add_argument(
        "--mote", default="", metavar="URL", help="a TinyOS BaseStation, to the real air"
    )
    add_radio_nodes(parser)
    add_common(parser)
    parser.add_argument(
        "--rate", type=positive, metavar="HZ", help="samples a second of --plant-for; default: 100"
    )
    parser.add_argument("--seed", type=int, metavar="N", help="seed of all random numbers")
    parser.add_argument(
        "--out", type=folder_name, metavar="DIR", help="run folder; default: runs/NAME-SEED"
    )
    parser.add_argument(
        "--late", choices=("report", "stop"), help="what to do when this machine is too slow"
    )
    parser.add_argument(
        "--late-bound",
        type=positive,
        metavar="S",
        help="lateness at which --late stop ends it; default: 0.1",
    )
    parser.add_argument("--quiet", action="store_true", help="no progress and no summary")


def add_radio_nodes(parser: argparse.ArgumentParser) -> None:
    """Declare who is emulated on the air."""
    parser.add_argument(
        "--emulate",
        choices=("both", "base", "robot"),
        help="who is emulated on the air, the other one being real or absent; default: both",
    )


def add_common(parser: argparse.ArgumentParser) -> None:
    """Declare what `hil` and `board` have in common."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="override one key, such as procboard.tail_beat.bias_rad=0.2; may be repeated",
    )
    parser.add_argument("--duration", type=positive, metavar="S", help="seconds")
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout")


def run(args: argparse.Namespace) -> int:
    """Do it."""
    from tools import hil

    options = {f"hil.{role}": f"--{role}" for role in ROLES if getattr(args, role)}
    if args.plant_for:
        options["hil.plant_for"] = "--plant-for"
    if args.rate is not None:
        options["hil.plant_rate_hz"] = "--rate"
    if args.emulate:
        options["hil.radio_nodes"] = "--emulate"
    with hil.called(options):
        return _run(args)


def _run(args: argparse.Namespace) -> int:
    from tools import hil

    config = hil.with_line(
        args.scenario,
        args.set,
        nav=args.nav,
        proc=args.proc,
        plant_for=args.plant_for,
        rate_hz=args.rate,
        camera=args.camera,
        camera_id=args.camera_id,
        mote=args.mote,
        radio_nodes=args.emulate,
        duration_s=args.duration,
        seed=args.seed,
        late=args.late,
        late_bound_s=args.late_bound,
    )
    for option, value, partner, there in (
        ("--rate", args.rate, "--plant-for", config.hil.plant_for),
        ("--camera-id", args.camera_id, "--camera", config.hil.camera),
        ("--late-bound", args.late_bound, "--late stop", config.hil.late == "stop"),
    ):
        if value and not there:
            raise UserError(f"{option} goes with {partner}, which is not given")
    data, place = run_into_folder(args, config)
    if not (args.json or args.quiet):
        whom = "a real board" if config.hil.url else "the world outside"
        lines = [f"{data.scenario} (seed {data.seed}): {data.duration_s:g} s with {whom}"]
        print("\n".join([*lines, *hil.words(data.hil), f"  {'report':<14}{place / 'report.html'}"]))
    if data.hil["diagnosis"]:
        raise UserError(data.hil["diagnosis"])
    if data.hil["lateness"]["stopped"]:
        return hil.EXIT_LATE
    return EXIT_INTERRUPTED if data.interrupted else 0
