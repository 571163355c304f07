"""`python -m tools.hil_soak`: the two boards as two programs, in real time, for any time.

One program is `fishbed board`, the other `fishbed hil`; between them is a pty, or with `--pulls` a
cable between two of them that is pulled now and then: to either program its serial port vanishes.
Sensor reports come at `--rate`. At the end both say what they sent, what was acknowledged and what
came, and the two accounts must agree: what one link acknowledged the other has delivered, once and
in order, and no number of a report is missing that its board did not say it had no room for.

Exit code 0: nothing lost or repeated; 1: something was; 2: the options are wrong, or a program did
not run; 130: interrupted. How late it was is reported and decides nothing: that is the machine's.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from spi_bus.transports import open_transport
from spi_bus.transports.base import Transport
from spi_bus.transports.cable import Cable
from tools.errors import UserError
from tools.words import away, ms

__all__ = ["faults", "main", "soak"]

AWAY_S: Final = 0.5
"""How long a pulled cable is out."""
START_S: Final = 120.0
"""Longest wait for a program to come up; on a busy machine without compiled code it takes long."""
STORE_S: Final = 0.1
"""Between reports that go to the flash: it is too slow for a hundred a second."""
LEAST_RATE_HZ, MOST_RATE_HZ = 10.0, 200.0
"""Of the navigation board's control tick."""
EXIT_LOST: Final = 1
EXIT_INTERRUPTED: Final = 130
ROOT: Final = Path(__file__).resolve().parents[1]


@dataclass(frozen=True, slots=True)
class Soak:
    """What is run: `real` is the board that `fishbed board` plays, "nav" or "proc"."""

    seconds: float = 600.0
    rate_hz: float = 100.0
    pulls: int = 0
    real: str = "nav"

    @property
    def settings(self) -> list[str]:
        """Options of both programs that make the reports come at that rate."""
        sets = (
            f"navboard.control_hz={self.rate_hz!r}",
            f"navboard.report_period_s={1.0 / self.rate_hz!r}",
            f"procboard.storage.period_s={STORE_S!r}",
            "procboard.storage.when_full='overwrite-oldest'",
        )
        return [word for text in sets for word in ("--set", text)]


class Program:
    """A `fishbed` command whose output goes to files: a full pipe would hold it up."""

    def __init__(self, folder: Path, name: str, *arguments: str) -> None:
        self._out, self._err = folder / f"{name}.out", folder / f"{name}.err"
        self._name = name
        path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        with self._out.open("wb") as out, self._err.open("wb") as err:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "tools", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                env={**os.environ, "PYTHONPATH": path},
            )

    def wait_until_open(self) -> None:
        """Wait until it has opened its line."""
        end_s = time.monotonic() + START_S
        while "is expected at" not in self._err.read_text(encoding="utf-8"):
            if self.process.poll() is not None or time.monotonic() > end_s:
                raise self._failed("did not open its line")
            time.sleep(0.02)

    def document(self) -> dict[str, Any]:
        """Return what it printed at its end."""
        self.process.wait(START_S)
        try:
            found: dict[str, Any] = json.loads(self._out.read_text(encoding="utf-8"))
        except ValueError:
            raise self._failed(f"ended with code {self.process.returncode}") from None
        return found

    def stop(self) -> dict[str, Any]:
        """End it as Ctrl-C does, and return what it printed."""
        self.process.send_signal(signal.SIGINT)
        return self.document()

    def kill(self) -> None:
        """End it in any case."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()

    def _failed(self, what: str) -> UserError:
        said = self._err.read_text(encoding="utf-8").strip().splitlines()
        return UserError(f"fishbed {self._name} {what}: {said[-1] if said else 'it said nothing'}")


def soak(plan: Soak) -> dict[str, Any]:
    """Run both programs; return their figures under "hil" and "board", and `faults` of them.

    Raises:
        UserError: a program did not run.

    """
    with tempfile.TemporaryDirectory(prefix="fishbed-soak-") as name, contextlib.ExitStack() as end:
        folder = Path(name)
        near, far = folder / "near", folder / "far"
        cable: Cable | None = None
        board_url, hil_url = f"pty:?link={near}", f"serial://{near}"
        if plan.pulls:
            cable = Cable(_pty(near), _pty(far))
            end.callback(cable.close)
            board_url = f"serial://{far}"
        arguments = ("--on", board_url, "--json", *plan.settings)
        board = Program(folder, "board", "board", plan.real, *arguments)
        end.callback(board.kill)
        board.wait_until_open()
        arguments = ("--json", "--out", str(folder / "run"), *plan.settings)
        duration = ("--duration", repr(plan.seconds))
        hil = Program(folder, "hil", "hil", f"--{plan.real}", hil_url, *duration, *arguments)
        end.callback(hil.kill)
        if cable is not None:
            _pull(cable, plan, hil.process)
        hil.process.wait()
        near_side = hil.document()["hil"]
        figures = {"hil": near_side, "board": board.stop()}
    return {"faults": faults(plan, figures), **figures}


def faults(plan: Soak, figures: dict[str, Any]) -> list[str]:
    """Return what must not be, a line each: messages lost or repeated, or a run that was none."""
    found = []
    sides = (("hil", "board"), ("board", "hil"))
    for one, other in sides:
        link, peer = figures[one]["link"], figures[other]["link"]
        if not figures[one]["connected"]:
            found.append(f"{one}: the link never came up")
        if not link["acknowledged"] <= peer["received"] <= link["sent"]:
            found.append(
                f"{one} sent {link['sent']} messages, of which {link['acknowledged']} were "
                f"acknowledged; {other} received {peer['received']}"
            )
        if link["lost"]:
            found.append(f"{one}: {link['lost']} messages were acknowledged and not delivered")
        if link["peer_resets"]:
            found.append(f"{one}: the other side was reset {link['peer_resets']} times")
        reports, commands = figures[one]["reports"], figures[one]["commands"]
        found += [
            f"{one}: {reports[key]} sensor reports {key}"
            for key in ("lost", "repeated")
            if reports[key]
        ]
        if commands["surplus"]:
            found.append(f"{one}: {commands['surplus']} commands were carried out twice")
    came = max(figures[one]["reports"]["delivered"] for one, _ in sides)
    if not came:
        found.append("no sensor report came")
    outages = figures["hil"]["outages"]["outages"]
    if outages < plan.pulls:
        found.append(f"the cable was pulled {plan.pulls} times, and hil saw {outages} outages")
    return found


def _pty(link: Path) -> Callable[[], Transport]:
    return lambda: open_transport(f"pty:?link={link}")


def _pull(cable: Cable, plan: Soak, hil: subprocess.Popen[bytes]) -> None:
    """Carry bytes until hil has ended, and pull the cable at equal distances."""
    while hil.poll() is None and cable.carried < 2000:  # the two have begun to talk
        cable.run(0.05)
    between_s = plan.seconds / (plan.pulls + 1)
    for _ in range(plan.pulls):
        for _slice in _until(hil, max(0.0, between_s - AWAY_S)):
            cable.run(0.05)
        cable.pull()
        time.sleep(AWAY_S)
        cable.plug()
    for _slice in _until(hil, plan.seconds + START_S):
        cable.run(0.05)


def _until(process: subprocess.Popen[bytes], seconds: float) -> Iterator[None]:
    """Go on for a time, or until a program has ended."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s and process.poll() is None:
        yield


def _table(plan: Soak, figures: dict[str, Any]) -> str:
    """Both programs' figures for the terminal."""
    names = {"hil": f"fishbed hil --{plan.real}", "board": f"fishbed board {plan.real}"}
    lines = [f"{plan.seconds:g} s at {plan.rate_hz:g} Hz, cable pulled {plan.pulls} times"]
    for key, name in names.items():
        side = figures[key]
        link, late, trip = side["link"], side["lateness"], side["round_trip"]
        out, reports = side["outages"], side["reports"]
        lines.append(f"  {name}")
        lines.append(
            f"    messages      sent {link['sent']}, acknowledged {link['acknowledged']}, "
            f"received {link['received']}, sent again {link['retransmissions']}"
        )
        lines.append(
            f"    lateness      median {ms(late['median_s'])}, p99 {ms(late['p99_s'])}, max "
            f"{ms(late['maximum_s'])}; {late['missed']} of {late['count']} events later than "
            f"{ms(late['deadline_s'])}"
        )
        if trip["count"]:
            lines.append(
                f"    round trip    median {ms(trip['median_s'])}, p99 {ms(trip['p99_s'])}, max "
                f"{ms(trip['maximum_s'])} ({trip['count']} of {trip['pings_sent']} pings)"
            )
        if reports["delivered"]:
            lines.append(
                f"    reports       {reports['delivered']} delivered, {reports['lost']} lost, "
                f"{reports['repeated']} repeated, {reports['missing']} not made for want of room"
            )
        lines.append(f"    outages       {out['outages']}, {away(out)}")
    return "\n".join([*lines, *(f"  FAULT: {text}" for text in figures["faults"])])


def main(argv: list[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.hil_soak",
        description="two fishbed programs on a pty pair in real time: is any message lost?",
    )
    parser.add_argument("--seconds", type=float, default=600.0, help="how long (default 600)")
    parser.add_argument("--rate", type=float, default=100.0, help="reports a second (default 100)")
    parser.add_argument("--pulls", type=int, default=0, help="pull the cable so often")
    parser.add_argument(
        "--real",
        choices=("nav", "proc"),
        default="nav",
        help="the board that stands for a real one",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    arguments = parser.parse_args(argv)
    if not (arguments.seconds > 0 and 0 <= arguments.pulls <= arguments.seconds):
        parser.error("--seconds must be above 0, --pulls at least 0 and at most one a second")
    if not LEAST_RATE_HZ <= arguments.rate <= MOST_RATE_HZ:
        parser.error(f"--rate must be from {LEAST_RATE_HZ:g} to {MOST_RATE_HZ:g}")
    plan = Soak(arguments.seconds, arguments.rate, arguments.pulls, arguments.real)
    try:
        figures = soak(plan)
    except UserError as error:
        print(f"hil_soak: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    print(json.dumps(figures, indent=2) if arguments.json else _table(plan, figures))
    return EXIT_LOST if figures["faults"] else 0


if __name__ == "__main__":
    sys.exit(main())
