"""`fishbed board`: one emulated board alone on a line, for developing the other one's firmware.

It runs in real time until Ctrl-C, or for `--duration`. The navigation board swims in its scenario's
water; the processing board has its base station. `base` is the base station's mote with TinyOS
BaseStation on it, for host tools, and `xbee` an XBee module in its place, for whoever drives the
fish (`fishbed teleop`); both have the scenario's robot on their air. It leaves nothing behind but
its figures.
"""

from __future__ import annotations

import argparse

from tools.commands.hil import add_common, add_radio_nodes
from tools.errors import UserError

NAME = "board"
HELP = "one emulated board alone, behind a pty, a serial port or CAN"
NAMES = {"nav": "nav board", "proc": "proc board", "base": "base station", "xbee": "XBee module"}
KEYS = {"nav": "hil.proc", "proc": "hil.nav", "base": "hil.base_port", "xbee": "hil.xbee"}
"""What the scenario calls the line to the other side."""
UNTIL_INTERRUPTED_S = 1e6
"""The longest run that a scenario may ask for: eleven days."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the contract."""
    parser.add_argument("board", choices=tuple(NAMES), help="which board is emulated here")
    parser.add_argument("scenario", nargs="?", metavar="SCENARIO|FILE.toml", help="as of run")
    parser.add_argument("--on", required=True, metavar="URL", help="the line to the other side")
    parser.add_argument(
        "--plant",
        default="",
        metavar="URL",
        help="nav: the line to a plant in the loop, which stands for all its chips",
    )
    add_radio_nodes(parser)
    parser.add_argument(
        "--promiscuous",
        action="store_true",
        help="base: hear frames for everybody, acknowledge none (TinyOS's default build)",
    )
    add_common(parser)


def run(args: argparse.Namespace) -> int:
    """Do it."""
    import json

    from tools import hil
    from tools.execution import serve

    if args.board != "base" and (args.promiscuous or args.emulate):
        raise UserError(f"--promiscuous and --emulate are for board base, not for {args.board}")
    if args.plant and args.board != "nav":
        raise UserError("--plant: sensors and servo are on the navigation board: board nav")
    promiscuous = ["hil.base_promiscuous=true"] if args.promiscuous else []
    with hil.called({KEYS[args.board]: "--on", "hil.plant": "--plant"}):
        config = hil.with_line(
            args.scenario,
            [*args.set, *promiscuous],
            nav=args.on if args.board == "proc" else "",
            proc=args.on if args.board == "nav" else "",
            plant=args.plant,
            xbee=args.on if args.board == "xbee" else "",
            base_port=args.on if args.board == "base" else "",
            radio_nodes=args.emulate,
            duration_s=args.duration or UNTIL_INTERRUPTED_S,
        )
        figures = serve(config)
    if args.json:
        print(json.dumps({"board": args.board, **figures}, indent=2))
    else:
        print(f"the emulated {NAMES[args.board]} ran for {figures['duration_s']:g} s")
        print("\n".join(hil.words(figures)))
    if figures["diagnosis"]:
        raise UserError(figures["diagnosis"])
    return 0
