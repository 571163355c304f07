"""`fishbed teleop`: a joystick, a keyboard or a script drives a fish through an XBee module.

The module is on a serial port, or an emulated one of `fishbed board xbee`.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from tools.commands.run import EXIT_INTERRUPTED, positive
from tools.errors import UserError

if TYPE_CHECKING:
    from tools.teleop.console import Operator
    from tools.teleop.pilot import Pilot
    from tools.teleop.setpoint import Bounds

NAME = "teleop"
HELP = "drive a fish by keyboard, joystick or script, through an XBee in API mode"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--on", required=True, metavar="URL", help="the module's serial port")
    parser.add_argument(
        "--address", default="1", metavar="A", help="of the fish: 16 bits, or 64; default 1"
    )
    parser.add_argument(
        "--input", default="keyboard", metavar="WHAT",
        help="keyboard, joystick:/dev/input/js0 or script:FILE",
    )  # fmt: skip
    parser.add_argument("--mapping", metavar="FILE.toml", help="which axis and button does what")
    for name, text in (
        ("frequency", "most tail beats a second; default 2"),
        ("bias", "most bias, degrees; default 30"),
        ("amplitude", "most amplitude, degrees; default 30"),
    ):
        parser.add_argument(f"--max-{name}", type=positive, metavar="X", help=text)
    parser.add_argument(
        "--amplitude", type=positive, default=15.0, metavar="DEG", help="to begin with; default 15"
    )
    parser.add_argument(
        "--rate", type=positive, default=10.0, metavar="HZ", help="commands a second; default 10"
    )
    parser.add_argument(
        "--valid", type=positive, default=1.0, metavar="S",
        help="how long the fish goes on without commands; default 1",
    )  # fmt: skip
    for name, text in (
        ("channel", "11 to 26"), ("pan", "PAN identifier"), ("own-address", "16 bits")
    ):  # fmt: skip
        parser.add_argument(f"--{name}", metavar="N", help=f"set in the module: {text}")
    parser.add_argument(
        "--set-api", action="store_true", help="switch a module in transparent mode to API mode 2"
    )
    parser.add_argument("--duration", type=positive, metavar="S", help="stop after this time")
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout")
    parser.add_argument("--quiet", action="store_true", help="no status line and no summary")


def run(args: argparse.Namespace) -> int:
    """Do it."""
    import contextlib
    import json
    import secrets
    import time

    from spi_bus.errors import TransportError
    from spi_bus.transports import BackOff, OpenContext, OutageLog, open_transport
    from tools.teleop.console import Console, screen
    from tools.teleop.module import ModuleSession, SetUp
    from tools.teleop.pilot import Pilot, Plan
    from tools.teleop.setpoint import Helm
    from tools.teleop.status import result_lines

    bounds = _bounds(args)
    plan = Plan(address(args.address), _between(args.rate, 1, 50, "--rate"),
                _between(args.valid, 0.1, 60, "--valid"))  # fmt: skip
    set_up = SetUp(
        _number(args.channel, 11, 26, "--channel"),
        _number(args.pan, 0, 0xFFFE, "--pan"),
        _number(args.own_address, 0, 0xFFFD, "--own-address"),
        args.set_api,
    )
    helm = Helm(bounds, _radians(args.amplitude))
    pilot = Pilot(helm, ModuleSession(set_up, time.monotonic()), plan, secrets.randbelow(0x10000))
    with contextlib.ExitStack() as stack:
        operator = open_operator(args.input, args.mapping, bounds, pilot, stack)
        outages = OutageLog()
        try:
            line = open_transport(
                url(args.on), OpenContext(reconnect=BackOff(), notify=outages.note)
            )
        except TransportError as error:
            raise UserError(f"--on: {error}") from error
        stack.callback(line.close)
        pilot.module.reopened(time.monotonic())
        say, draw = stack.enter_context(screen(args.quiet or args.json))
        console = Console(pilot, operator, line, duration_s=args.duration, say=say, draw=draw)
        if args.input == "keyboard":
            from tools.teleop import keyboard

            say(keyboard.HELP)
        console.run()
    if args.json:
        print(json.dumps({**pilot.summary(), "outages": outages.summary()}, indent=2))
    elif not args.quiet and not pilot.failure:
        print("\n".join(result_lines(pilot)))
    if pilot.failure:
        raise UserError(f"--on {args.on}: {pilot.failure}")
    return EXIT_INTERRUPTED if console.interrupted else 0


def url(text: str) -> str:
    """Return the module's URL; a serial device without a baud rate gets the module's default."""
    from radio_802154.xbee import BAUD

    if text == "emulated":
        raise UserError(
            "--on emulated: start `fishbed board xbee --on pty:?link=/tmp/xbee` in another "
            "terminal, then --on serial:///tmp/xbee"
        )
    if text.startswith("serial:") and "baud=" not in text:
        return f"{text}{'&' if '?' in text else '?'}baud={BAUD}"
    return text


def address(text: str) -> int:
    """Return a fish's address: up to FFFF one of 16 bits, above one of 64.

    Decimal, 0x… or sixteen hexadecimal digits as they stand on the module.
    """
    digits = text.replace(" ", "")
    try:
        hexadecimal = len(digits) == 16 and not digits.lower().startswith("0x")
        value = int(digits, 16 if hexadecimal else 0)
    except ValueError:
        value = -1
    if not 0 <= value < 1 << 64:
        raise UserError(
            f"--address {text}: write 16 bits as 1 or 0x0001, or 64 bits as 0013A200400A0127"
        )
    return value


def open_operator(
    what: str, mapping: str | None, bounds: Bounds, pilot: Pilot, stack: object
) -> Operator:
    """Open the operator's input; `stack` (an ExitStack) gives it back."""
    import contextlib
    import os
    import sys
    from pathlib import Path

    from tools.teleop import console, joystick, keyboard, script

    assert isinstance(stack, contextlib.ExitStack)
    kind, _, place = what.partition(":")
    if mapping is not None and kind != "joystick":
        raise UserError("--mapping: only a joystick has one")
    if what == "keyboard":
        descriptor = sys.stdin.fileno()
        stack.enter_context(keyboard.cbreak(descriptor))
        return console.KeyboardOperator(descriptor)
    if kind == "joystick" and place:
        table = joystick.Mapping() if mapping is None else joystick.read_mapping(Path(mapping))
        device = joystick.open_device(place)
        stack.callback(os.close, device)
        return console.JoystickOperator(device, joystick.Stick(table, bounds))
    if kind == "script" and place:
        return console.ScriptOperator(script.read(Path(place)), pilot)
    raise UserError(f"--input {what}: write keyboard, joystick:/dev/input/js0 or script:FILE")


def _bounds(args: argparse.Namespace) -> Bounds:
    from tools.teleop.setpoint import Bounds

    bounds = Bounds()
    frequency_hz = args.max_frequency or bounds.frequency_hz
    bias_rad = _radians(args.max_bias) if args.max_bias else bounds.bias_rad
    amplitude_rad = _radians(args.max_amplitude) if args.max_amplitude else bounds.amplitude_rad
    _between(frequency_hz, 0, 4, "--max-frequency")
    _between(args.max_bias or 0, 0, 50, "--max-bias")
    _between(args.max_amplitude or 0, 0, 60, "--max-amplitude")
    return Bounds(frequency_hz, amplitude_rad, bias_rad)


def _radians(degrees: float) -> float:
    import math

    return math.radians(degrees)


def _between(value: float, least: float, most: float, option: str) -> float:
    if not least <= value <= most:
        raise UserError(f"{option} {value:g}: from {least:g} to {most:g}")
    return value


def _number(text: str | None, least: int, most: int, option: str) -> int | None:
    if text is None:
        return None
    try:
        value = int(text, 0)
    except ValueError:
        value = least - 1
    if not least <= value <= most:
        raise UserError(
            f"{option} {text}: a whole number from {least} to {most:#x}, decimal or 0x…"
        )
    return value
