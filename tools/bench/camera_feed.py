"""Play the poses of a run folder as a tracker would.

    python -m tools.bench.camera_feed RUN --on URL

For trying `fishbed hil --camera` with two processes and no camera. Poses go out in real time, each
as a JSON line (docs/camera.md) and stamped by a clock of its own, which starts anywhere and may
drift. URLs, seen from the tracker:

    tcp://HOST:PORT     connects to `hil --camera listen://:PORT`, again when the connection is lost
    listen://:PORT      waits for `hil --camera tcp://HOST:PORT`, one after the other
    udp://HOST:PORT     sends datagrams to `hil --camera udp://:PORT`
    anything else       a transport, as pty: or serial:///dev/ttyUSB0
"""

from __future__ import annotations

import argparse
import csv
import json
import socket
import sys
import time
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from spi_bus.errors import TransportError
from spi_bus.transports import OpenContext, open_transport
from spi_bus.transports.urls import parse
from tools.bench.tracker_source import ListenSource, place_of
from tools.errors import UserError

COLUMNS: Final = ("time_s", "x_m", "y_m", "heading_rad")
RETRY_S: Final = 0.2
"""Between attempts to connect."""

Row = tuple[float, float, float, float]
Send = Callable[[bytes], bool]
"""Sends a line; False where nobody is there to hear it."""


def read_rows(folder: Path, table: str = "channels", rate_hz: float | None = None) -> list[Row]:
    """Return (time, x, y, heading) of a run folder's table, thinned out to `rate_hz`.

    Raises:
        UserError: no such table, or no pose in it.

    """
    path = folder / f"{table}.csv"
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = [
                (
                    float(row["time_s"]),
                    float(row["x_m"]),
                    float(row["y_m"]),
                    float(row["heading_rad"]),
                )
                for row in csv.DictReader(file)
                if row.get("x_m") and row.get("y_m") and row.get("heading_rad")
            ]
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}: name a run folder") from error
    except (KeyError, ValueError) as error:
        raise UserError(f"{path}: no table of {', '.join(COLUMNS)} ({error})") from error
    if not rows:
        raise UserError(f"{path}: no pose in it; --table truth has the true ones")
    if rate_hz is None:
        return rows
    times = [row[0] for row in rows]
    count = int((times[-1] - times[0]) * rate_hz) + 1
    wanted = [bisect_left(times, times[0] + number / rate_hz) for number in range(count)]
    return [rows[index] for index in dict.fromkeys(wanted) if index < len(rows)]


def lines(
    rows: Sequence[Row], *, began_s: float = 0.0, drift_ppm: float = 0.0, name: str = ""
) -> Iterator[tuple[float, bytes]]:
    """Yield (seconds from the start, line) for each pose, stamped by the tracker's clock."""
    for at_s, x_m, y_m, heading_rad in rows:
        since_s = at_s - rows[0][0]
        pose: dict[str, float | str] = {
            "time_s": round(began_s + since_s * (1.0 + 1e-6 * drift_ppm), 6),
            "x_m": x_m,
            "y_m": y_m,
            "heading_rad": heading_rad,
        }
        if name:
            pose["id"] = name
        yield since_s, json.dumps(pose, allow_nan=False).encode() + b"\n"


def _connecting(host: str, port: int) -> Send:
    connection: socket.socket | None = None
    tried_s = float("-inf")

    def send(line: bytes) -> bool:
        nonlocal connection, tried_s
        if connection is None and time.monotonic() - tried_s >= RETRY_S:
            tried_s = time.monotonic()
            with suppress(OSError):
                connection = socket.create_connection((host, port), RETRY_S)
        if connection is None:
            return False
        try:
            connection.sendall(line)
        except OSError:
            connection.close()
            connection = None
            return False
        return True

    return send


def _listening(host: str, port: int) -> Send:
    source = ListenSource(host, port, time.monotonic, lambda event: None)
    print(f"camera_feed: the poses are at {source.description}", file=sys.stderr, flush=True)

    def send(line: bytes) -> bool:
        source.read()
        return source.write(line)

    return send


def _datagrams(host: str, port: int) -> Send:
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(line: bytes) -> bool:
        try:
            sender.sendto(line, (host, port))
        except ConnectionRefusedError:  # nobody is there yet
            return False
        return True

    return send


def _transport(url: str) -> Send:
    line_to = open_transport(url, OpenContext())
    print(f"camera_feed: the poses are at {line_to.description}", file=sys.stderr, flush=True)

    def send(line: bytes) -> bool:
        line_to.flush()
        if line_to.room < len(line):
            return False
        line_to.write(line)
        return True

    return send


def open_sender(url: str) -> Send:
    """Return what sends lines to a URL.

    Raises:
        TransportError: it cannot be.

    """
    parsed = parse(url)
    if parsed.scheme == "tcp":
        return _connecting(*place_of(parsed))
    if parsed.scheme == "listen":
        return _listening(*place_of(parsed))
    if parsed.scheme == "udp":
        return _datagrams(*place_of(parsed))
    return _transport(url)


def play(
    told: Iterator[tuple[float, bytes]],
    send: Send,
    silences: Sequence[tuple[float, float]] = (),
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> tuple[int, int]:
    """Send lines at their times; return how many went and how many nobody heard.

    `silences` are (from, to) in which the tracker sees nothing.
    """
    began_s = clock()
    went = unheard = 0
    for since_s, line in told:
        ahead_s = began_s + since_s - clock()
        if ahead_s > 0:
            sleep(ahead_s)
        if any(start <= since_s < end for start, end in silences):
            continue
        if send(line):
            went += 1
        else:
            unheard += 1
    return went, unheard


def main(argv: Sequence[str] | None = None) -> int:
    """Do it; exit code 2 for a user's mistake."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.bench.camera_feed",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="a run folder")
    parser.add_argument("--on", required=True, metavar="URL", help="where the poses go")
    parser.add_argument("--table", choices=("channels", "truth"), default="channels")
    parser.add_argument("--rate", type=float, metavar="HZ", help="poses a second; default: all")
    parser.add_argument("--began", type=float, default=1000.0, metavar="S", help="clock at start")
    parser.add_argument("--drift", type=float, default=0.0, metavar="PPM", help="of that clock")
    parser.add_argument("--id", default="", help="what the tracker calls the robot")
    parser.add_argument("--silence", action="append", default=[], metavar="FROM:TO",
                        help="seconds in which it sees nothing; may be repeated")  # fmt: skip
    args = parser.parse_args(argv)
    try:
        silences = [_silence(text) for text in args.silence]
        rows = read_rows(args.run, args.table, args.rate)
        told = lines(rows, began_s=args.began, drift_ppm=args.drift, name=args.id)
        went, unheard = play(told, open_sender(args.on), silences)
    except (UserError, TransportError) as error:
        print(f"camera_feed: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    print(f"{went} poses sent, {unheard} while nobody listened")
    return 0


def _silence(text: str) -> tuple[float, float]:
    begin, _, end = text.partition(":")
    try:
        return float(begin), float(end)
    except ValueError as error:
        raise UserError(f"--silence {text}: write FROM:TO in seconds, as 5:8") from error


if __name__ == "__main__":
    sys.exit(main())
