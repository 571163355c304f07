"""`python -m spi_bus.transports.soak`: two processes on a pty pair, for as long as you like.

One plays the processing board and sends a tail-beat command a tick, the other the navigation board
and sends a sensor report a tick; both number what they send and check what they get. What a full
link does not take waits in the application, as it would in a board's memory, so that at the end
every number made must have arrived, once and in order. With `--pulls` a third process carries the
bytes between two ptys and closes both now and then: to either board its serial port vanishes.

Exit code 0: nothing lost, repeated or out of order; 1: something was; 2: the options are wrong.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from spi_bus.errors import LinkFull, TransportError
from spi_bus.link import Event, Link, MessageReceived, Role
from spi_bus.messages import SensorReport, TailBeat
from spi_bus.transports import BackOff, OpenContext, OutageLog, open_transport
from spi_bus.transports.cable import Cable
from spi_bus.transports.runner import LinkRunner

__all__ = ["Board", "main"]

SETTLE_S: Final = 30.0
"""Longest wait for what is under way at the end; the link states 3 s once faults have stopped."""
AWAY_S: Final = 0.5
"""How long a pulled cable is out."""
_WRAP: Final = 0x10000


class Board:
    """Numbers what it sends, checks what it gets."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._backlog: deque[object] = deque()
        self.made = 0
        self.received = 0
        self.wrong = 0
        """Messages that were not the next one: lost, repeated or out of order."""
        self.longest_backlog = 0

    @property
    def idle(self) -> bool:
        """Whether everything made has been taken by the link."""
        return not self._backlog

    def tick(self, number: int) -> None:
        """Make a message."""
        count = self.made % _WRAP
        if self._link.role is Role.MASTER:
            message: object = TailBeat(count, 0.1, 0.25, 0.9, 5.0)
        else:
            readings = (0.1, 0.0, 0.0, 9.81, 0.5, 0.5, 0.2, 7.4, 0.3, 18.0, None)
            message = SensorReport(number, count, *readings)
        self.made += 1
        self._backlog.append(message)
        self.longest_backlog = max(self.longest_backlog, len(self._backlog))
        self.drain()

    def drain(self) -> None:
        """Give the link what it takes."""
        while self._backlog:
            try:
                self._link.send(self._backlog[0])
            except LinkFull:
                return
            self._backlog.popleft()

    def hear(self, event: Event) -> None:
        """Check a message."""
        match event:
            case MessageReceived(TailBeat(command_id=count) | SensorReport(sequence=count)):
                self.wrong += count != self.received % _WRAP
                self.received += 1
        self.drain()


def _side(arguments: argparse.Namespace) -> int:
    """One board: runs, settles, says so, serves its peer until told to stop, and reports."""
    role = Role(arguments.side)
    link = Link(role, os.getpid() % 0xFFFF + 1)
    board = Board(link)
    outages = OutageLog()
    context = OpenContext(reconnect=BackOff(first_s=0.02, longest_s=0.5), notify=outages.note)
    transport = open_transport(arguments.url, context)
    print(json.dumps({"open": transport.description}), flush=True)
    runner = LinkRunner(
        link,
        transport,
        on_event=board.hear,
        on_tick=board.tick,
        period_s=1.0 / arguments.rate,
        ping_period_s=0.1,
    )
    runner.run(arguments.seconds)
    settled = _settle(runner, board)
    print(json.dumps({"settled": settled, "made": board.made}), flush=True)
    _serve(runner, board)
    report = {
        "made": board.made,
        "received": board.received,
        "wrong": board.wrong,
        "settled": settled,
        "longest_backlog": board.longest_backlog,
        "retransmissions": link.statistics.retransmissions,
        "crc_errors": link.statistics.crc_errors,
        "framing_errors": link.statistics.framing_errors,
        "peer_resets": link.statistics.peer_resets,
        **outages.summary(),
        **runner.statistics.summary(),
    }
    transport.close()
    print(json.dumps(report), flush=True)
    return 0


def _settle(runner: LinkRunner, board: Board) -> bool:
    end_s = time.monotonic() + SETTLE_S
    while time.monotonic() < end_s:
        board.drain()
        if runner.settle(0.5) and board.idle:
            return True
    return False


def _serve(runner: LinkRunner, board: Board) -> None:
    """Keep acknowledging, for a peer that has not settled yet."""

    def told_to_stop() -> bool:
        board.drain()
        return bool(select.select([sys.stdin], [], [], 0)[0])

    end_s = time.monotonic() + 2 * SETTLE_S
    while time.monotonic() < end_s and not told_to_stop():
        runner.run_quietly(0.1)


def _soak(arguments: argparse.Namespace) -> int:
    """Both boards, and the cable where one is to be pulled."""
    with tempfile.TemporaryDirectory(prefix="fishbed-soak-") as folder:
        one, other = f"{folder}/master", f"{folder}/slave"
        cable: Cable | None = None
        if arguments.pulls:
            cable = Cable(_pty(one), _pty(other))
            urls = {Role.MASTER: f"serial://{one}", Role.SLAVE: f"serial://{other}"}
        else:
            urls = {Role.MASTER: f"pty:?link={one}", Role.SLAVE: f"serial://{one}"}
        boards: dict[Role, subprocess.Popen[str]] = {}
        try:
            for role, url in urls.items():
                boards[role] = _start(role, url, arguments)
                _line(boards[role], 20.0, cable)  # its port is open: the other may open its own
            _run_cable(cable, arguments)
            for board in boards.values():
                _line(board, 2 * SETTLE_S, cable)
            reports = {}
            for role in (Role.SLAVE, Role.MASTER):  # who holds the pty goes last
                board = boards[role]
                assert board.stdin is not None  # asked for a pipe
                board.stdin.write("stop\n")
                board.stdin.flush()
                reports[str(role)] = _line(board, 20.0, cable)
        finally:
            for board in boards.values():
                board.kill()
                board.communicate()
            if cable is not None:
                cable.close()
    return _report(reports, arguments)


def _pty(link: str) -> Callable[[], Any]:
    return lambda: open_transport(f"pty:?link={link}")


def _start(role: Role, url: str, arguments: argparse.Namespace) -> subprocess.Popen[str]:
    root = str(Path(__file__).resolve().parents[2])
    command = [sys.executable, "-m", "spi_bus.transports.soak", "--side", str(role), "--url", url]
    command += ["--seconds", str(arguments.seconds), "--rate", str(arguments.rate)]
    path = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    return subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        bufsize=1,
        env={**os.environ, "PYTHONPATH": path},
    )


def _run_cable(cable: Cable | None, arguments: argparse.Namespace) -> None:
    """Pull the cable at equal distances; with none, wait."""
    if cable is None:
        time.sleep(arguments.seconds)
        return
    between_s = arguments.seconds / (arguments.pulls + 1)
    for _ in range(arguments.pulls):
        cable.run(max(0.0, between_s - AWAY_S))
        cable.pull()
        time.sleep(AWAY_S)
        cable.plug()
    cable.run(between_s)


def _line(board: subprocess.Popen[str], timeout_s: float, cable: Cable | None) -> dict[str, Any]:
    """Return the next line of a board, carrying bytes meanwhile."""
    assert board.stdout is not None  # asked for a pipe
    end_s = time.monotonic() + timeout_s
    while not select.select([board.stdout], [], [], 0.0 if cable else 0.1)[0]:
        if cable is not None:
            cable.run(0.01)
        if time.monotonic() > end_s:
            raise SystemExit("soak: a board did not answer in time")
    text = board.stdout.readline()
    if not text:
        raise SystemExit("soak: a board stopped; its message is above")
    found: dict[str, Any] = json.loads(text)
    return found


def _report(reports: dict[str, dict[str, Any]], arguments: argparse.Namespace) -> int:
    master, slave = reports["master"], reports["slave"]
    lost = master["made"] - slave["received"] + slave["made"] - master["received"]
    wrong = master["wrong"] + slave["wrong"]
    if arguments.json:
        document = {"lost": lost, "wrong": wrong, "pulls": arguments.pulls, **reports}
        print(json.dumps(document, indent=2))
    else:
        print(f"{arguments.seconds:g} s at {arguments.rate:g} Hz, cable pulled {arguments.pulls}×")
        for name, board in reports.items():
            late, trip = board["tick_lateness"], board["round_trip"]
            print(
                f"  {name}: made {board['made']}, received {board['received']}, "
                f"retransmitted {board['retransmissions']}, outages {board['outages']} "
                f"({board['down_s']:.2f} s)\n"
                f"    lateness p99 {1e3 * late['p99_s']:.3f} ms, max "
                f"{1e3 * late['maximum_s']:.3f} ms, late {board['ticks_late']}, "
                f"skipped {board['ticks_skipped']} of {board['ticks']}"
            )
            if trip["count"]:
                print(
                    f"    round trip median {1e3 * trip['median_s']:.3f} ms, p99 "
                    f"{1e3 * trip['p99_s']:.3f} ms, max {1e3 * trip['maximum_s']:.3f} ms"
                )
        print(f"  lost {lost}, repeated or out of order {wrong}")
    return int(bool(lost or wrong))


def main(argv: list[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m spi_bus.transports.soak")
    parser.add_argument("--seconds", type=float, default=600.0, help="how long (default 600)")
    parser.add_argument("--rate", type=float, default=100.0, help="ticks a second (default 100)")
    parser.add_argument("--pulls", type=int, default=0, help="pull the cable so often")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--side", choices=[str(role) for role in Role], help="one board alone")
    parser.add_argument("--url", help="what that board opens")
    arguments = parser.parse_args(argv)
    if not (arguments.seconds > 0 and arguments.rate > 0 and arguments.pulls >= 0):
        parser.error("--seconds and --rate are positive, --pulls is not negative")
    if bool(arguments.side) != bool(arguments.url):
        parser.error("--side and --url belong together")
    try:
        return _side(arguments) if arguments.side else _soak(arguments)
    except TransportError as error:
        print(f"soak: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
