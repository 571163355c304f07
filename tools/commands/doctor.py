"""`fishbed doctor`: what this machine can do, and what would help.

Every line is a fact that was looked at now; the lines that matter carry a remedy, and the remedies
are repeated at the end. Nothing is changed, and no port is opened.
"""

from __future__ import annotations

import argparse
import platform
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass

from tools.errors import MissingProgramError

NAME = "doctor"
HELP = "what this machine can do, and what would help"

PACKAGES = (
    "numpy",
    "scipy",
    "numba",
    "msgspec",
    "tomli-w",
    "rich",
    "matplotlib",
    "crcmod-plus",
    "pyserial",
    "python-can",
)
ORACLES = (
    ("tshark", "tshark", "checks radio.pcap"),
    ("sigrok-cli", "sigrok-cli", "decodes spi.vcd"),
    ("gpsdecode", "gpsd-clients", "reads the NMEA stream"),
)


@dataclass(frozen=True, slots=True)
class Finding:
    """One line: what was looked at, what was found, and what would help (empty: all is well)."""

    what: str
    found: str
    help: str = ""
    needed: bool = False
    """Whether `fishbed run` cannot do without it."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the contract."""
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout")


def run(args: argparse.Namespace) -> int:
    """Do it; exit 2 where something that every run needs is missing."""
    findings = list(examine())
    if args.json:
        import json
        from dataclasses import asdict

        print(json.dumps([asdict(finding) for finding in findings], indent=2))
    else:
        width = max(len(finding.what) for finding in findings)
        for finding in findings:
            mark = "✗" if finding.needed and finding.help else "·" if finding.help else "✓"
            print(f"{mark} {finding.what:<{width}}  {finding.found}")
        wishes = [finding.help for finding in findings if finding.help]
        print("\nWhat would help:" if wishes else "\nNothing is missing.")
        for wish in dict.fromkeys(wishes):
            print(f"  {wish}")
    missing = [finding.what for finding in findings if finding.needed and finding.help]
    if missing:
        raise MissingProgramError(f"a run needs: {', '.join(missing)}")
    return 0


def examine() -> Iterator[Finding]:
    """Look at everything, in the order of the printed list."""
    from tools.version import version

    yield Finding("fishbed", version())
    old = sys.version_info < (3, 11)
    remedy = "install Python 3.11 or newer" if old else ""
    yield Finding("Python", platform.python_version(), remedy, needed=True)
    yield Finding("machine", f"{platform.system()} {platform.machine()}, {_processors()}")
    yield from _packages()
    yield _compiled_code()
    yield from _oracles()
    yield _serial_ports()
    yield _can()


def _processors() -> str:
    import os

    if hasattr(os, "sched_getaffinity"):
        usable = len(os.sched_getaffinity(0))
    else:
        usable = os.cpu_count() or 1
    return f"{usable} processor{'s' if usable != 1 else ''}"


def _packages() -> Iterator[Finding]:
    from importlib.metadata import PackageNotFoundError
    from importlib.metadata import version as installed

    for package in PACKAGES:
        try:
            yield Finding(package, installed(package))
        except PackageNotFoundError:
            remedy = "python3 tools/bootstrap.py env  installs the missing packages"
            yield Finding(package, "missing", remedy, needed=True)


def _compiled_code() -> Finding:
    """Whether the compiled dynamics are cached; without them the first run compiles for a while."""
    import importlib.util
    from pathlib import Path

    spec = importlib.util.find_spec("plant")
    folders = list(spec.submodule_search_locations or ()) if spec else []
    files = [file for folder in folders for file in Path(folder).rglob("*.nbi")]
    if files:
        return Finding("compiled dynamics", f"{len(files)} functions in the cache")
    return Finding(
        "compiled dynamics",
        "not yet compiled",
        "fishbed run  compiles the dynamics once, which takes some seconds; later runs are fast",
    )


def _oracles() -> Iterator[Finding]:
    for program, package, purpose in ORACLES:
        path = shutil.which(program)
        if path:
            yield Finding(program, f"{path} ({purpose})")
        else:
            remedy = f"apt install {package}  brings {program}, which {purpose} in the tests"
            yield Finding(program, "absent; its tests are skipped", remedy)


def _serial_ports() -> Finding:
    try:
        from serial.tools import list_ports
    except ModuleNotFoundError:
        return Finding("serial ports", "unknown: pyserial is missing")
    ports = [
        port.device if port.description in ("n/a", "") else f"{port.device} ({port.description})"
        for port in list_ports.comports()
    ]
    return Finding("serial ports", ", ".join(sorted(ports)) or "none")


def _can() -> Finding:
    import socket

    if not hasattr(socket, "AF_CAN"):
        return Finding("CAN", "this system has no CAN sockets; virtual and serial-line CAN work")
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        return Finding("CAN", f"no CAN in this kernel ({error.strerror}); virtual CAN works")
    names = [name for _, name in socket.if_nameindex() if "can" in name]
    return Finding("CAN", ", ".join(names) or "the kernel has it; no interface is up")
