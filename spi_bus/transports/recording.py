"""A recorder around any transport, and a transport that plays a recording: `record:`, `replay:`.

A recording is text, a line a chunk, to be read by people, `grep` and `fishbed decode`:

    fishbed-transport-log 1
    # serial /dev/ttyUSB0 at 115200 baud
    0.000000 > 00 03 11 10 01 04 44 01 01 01 01 01 03 c1 c9 00
    0.004127 < 03 11 21 01 04 54 02 02 03 01 01 03 10 5f 00
    1.730201 ! down: serial /dev/ttyUSB0 at 115200 baud: the device is gone (end of file)
    2.131544 ! up: after 0.401 s and 3 attempts

Seconds since the recording began, to the microsecond, never falling; `>` is what we sent, `<` what
we received, `!` what happened to the line, `#` a remark. Lines are written as they come, so after a
crash at most the last one is torn: a last line without its end is left out. An existing file is
never overwritten.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Final

from spi_bus.errors import RecordingError, TransportClosedError, TransportLost, TransportUrlError
from spi_bus.transports import open_transport
from spi_bus.transports.base import BUFFER_BYTES, READ_BYTES, Clock, OpenContext, Transport
from spi_bus.transports.outage import OutageBegan, OutageEvent
from spi_bus.transports.urls import Url, take

__all__ = [
    "HEADER",
    "LogLine",
    "Recorder",
    "Replayer",
    "open_recorder",
    "open_url",
    "parse_line",
    "read_log",
]

HEADER: Final = "fishbed-transport-log 1"
SENT, RECEIVED, HAPPENED = ">", "<", "!"
_LINE: Final = re.compile(r"([0-9]{1,12})\.([0-9]{6}) ([<>!])(?: (.*))?")
_RECORD: Final = re.compile(r"record:(.+?):([A-Za-z][A-Za-z0-9+.-]*:.*)", re.DOTALL)


@dataclass(frozen=True, slots=True)
class LogLine:
    """One line of a recording: bytes one way, or words on what happened to the line."""

    time_us: int
    kind: str
    data: bytes = b""
    text: str = ""


def read_log(path: Path) -> Iterator[LogLine]:
    """Read a recording.

    Raises:
        RecordingError: the file cannot be read, is no recording, or is damaged within.

    """
    try:
        with path.open("rb") as file:
            first = file.readline()
            if first.decode("utf-8", "replace").rstrip() != HEADER:
                raise RecordingError(f"{path} is no recording: its first line is not {HEADER!r}")
            for number, raw in enumerate(file, 2):
                if not raw.endswith(b"\n"):
                    return  # torn: the program that wrote it was stopped here
                text = raw.decode("utf-8", "replace").rstrip("\r\n")
                if text and not text.startswith("#"):
                    yield _parse(text, path, number)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read ({error.strerror}): is the path right?") from (
            error
        )


def parse_line(text: str) -> LogLine:
    """Read one line, neither the first nor a remark, without its end.

    Raises:
        ValueError: it is not a line of a recording, or its bytes are not hexadecimal.

    """
    match = _LINE.fullmatch(text)
    if match is None:
        raise ValueError(f"not a line of a recording: {text[:40]!r}")
    time_us = int(match[1]) * 1_000_000 + int(match[2])
    if match[3] == HAPPENED:
        return LogLine(time_us, HAPPENED, text=match[4] or "")
    try:
        return LogLine(time_us, match[3], bytes.fromhex(match[4] or ""))
    except ValueError:
        raise ValueError("bytes that are not hexadecimal") from None


def _parse(text: str, path: Path, number: int) -> LogLine:
    try:
        return parse_line(text)
    except ValueError as error:
        raise RecordingError(f"{path}, line {number}: {error}") from error


class Recorder:
    """Passes everything on to a transport and writes it down.

    Args:
        open_line: opens the transport; its argument is told of outages, which are written down too.
        path: the new file.
        clock: monotonic, in seconds.

    Raises:
        RecordingError: the file exists, or cannot be made.

    """

    def __init__(
        self,
        open_line: Callable[[Callable[[OutageEvent], None]], Transport],
        path: Path,
        clock: Clock = time.monotonic,
    ) -> None:
        self._clock = clock
        self._start_s = clock()
        self._file = _create(path)
        try:
            self._line = open_line(self.note)
        except BaseException:
            self._file.close()
            path.unlink()  # it holds nothing, and would be in the way of the next attempt
            raise
        self._path = path
        self._file.write(f"# {self._line.description}\n")

    @property
    def description(self) -> str:
        """The transport's, and where it is recorded."""
        return f"{self._line.description}, recorded in {self._path}"

    @property
    def line(self) -> Transport:
        """The transport inside."""
        return self._line

    @property
    def openings(self) -> int:
        """The transport's."""
        return self._line.openings

    @property
    def room(self) -> int:
        """The transport's."""
        return self._line.room

    @property
    def pending(self) -> int:
        """The transport's."""
        return self._line.pending

    @property
    def wants_writable(self) -> bool:
        """The transport's."""
        return self._line.wants_writable

    def read(self, limit: int = READ_BYTES) -> bytes:
        """Read, and write down what came."""
        data = self._line.read(limit)
        if data:
            self._write(RECEIVED, data.hex(" "))
        return data

    def write(self, data: bytes) -> None:
        """Send, and write down what was taken."""
        self._line.write(data)
        if data:
            self._write(SENT, data.hex(" "))

    def flush(self) -> None:
        """Hand on what is pending."""
        self._line.flush()

    def fileno(self) -> int:
        """Return the transport's descriptor."""
        return self._line.fileno()

    def next_deadline_s(self) -> float | None:
        """Return the transport's deadline."""
        return self._line.next_deadline_s()

    def wait(self, timeout_s: float) -> None:
        """Wait as the transport does."""
        self._line.wait(timeout_s)

    def close(self) -> None:
        """Close transport and file."""
        self._line.close()
        self._file.close()

    def note(self, event: OutageEvent) -> None:
        """Write down what happened to the line."""
        if isinstance(event, OutageBegan):
            self._write(HAPPENED, f"down: {event.reason}")
        else:
            attempts = f"{event.attempts} attempt{'s' if event.attempts != 1 else ''}"
            self._write(HAPPENED, f"up: after {event.duration_s:.3f} s and {attempts}")

    def _write(self, kind: str, text: str) -> None:
        time_us = max(0, round((self._clock() - self._start_s) * 1e6))
        seconds, rest = divmod(time_us, 1_000_000)
        self._file.write(f"{seconds}.{rest:06d} {kind} {' '.join(text.split())}\n")


class Replayer:
    """Plays one direction of a recording; what is written to it goes nowhere and is counted.

    Args:
        path: the recording.
        kind: `RECEIVED` to hear what was heard, `SENT` to hear what was said.
        at_once: give all without waiting, instead of at the recorded pace.
        clock: monotonic, in seconds; the recording begins now.

    A `read` returns at most one recorded chunk, so that the cuts are as they were. After the last
    one it raises `TransportLost`.

    """

    openings = 1
    wants_writable = False

    def __init__(
        self,
        path: Path,
        kind: str = RECEIVED,
        *,
        at_once: bool = False,
        clock: Clock = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._path = path
        self._chunks = (line for line in read_log(path) if line.kind == kind and line.data)
        self._next = next(self._chunks, None)
        self._at_once = at_once
        self._clock = clock
        self._sleep = sleep
        self._start_s = clock()
        self._closed = False
        self.pending = 0
        self.room = BUFFER_BYTES
        self.discarded = 0
        """Bytes written to the recording's other end, which nobody hears."""

    @property
    def description(self) -> str:
        """What is played."""
        return f"replay of {self._path}" + (" at once" if self._at_once else "")

    def read(self, limit: int = READ_BYTES) -> bytes:
        """Return the next chunk whose time has come; see `Transport`."""
        self._check_open()
        line = self._next
        if line is None:
            raise TransportLost(f"{self.description}: the recording has ended")
        due_s = self.next_deadline_s()
        if not limit or (due_s is not None and self._clock() < due_s):
            return b""
        if len(line.data) > limit:
            self._next = replace(line, data=line.data[limit:])
        else:
            self._next = next(self._chunks, None)
        return line.data[:limit]

    def write(self, data: bytes) -> None:
        """Count what is written."""
        self._check_open()
        self.discarded += len(data)

    def flush(self) -> None:
        """Do nothing: nothing is pending."""

    def fileno(self) -> int:
        """Return -1: there is nothing to select on."""
        return -1

    def next_deadline_s(self) -> float | None:
        """Return when the next chunk is due."""
        if self._next is None or self._at_once:
            return None
        return self._start_s + self._next.time_us / 1e6

    def wait(self, timeout_s: float) -> None:
        """Block until the next chunk is due."""
        self._check_open()
        if self._next is None or self._at_once:
            return
        due_s = self.next_deadline_s()
        assert due_s is not None  # there is a next one, at its pace
        wait_s = min(timeout_s, due_s - self._clock())
        if wait_s > 0:
            self._sleep(wait_s)

    def close(self) -> None:
        """Stop playing."""
        self._closed = True

    def _check_open(self) -> None:
        if self._closed:
            raise TransportClosedError(f"{self.description} was closed: open it again")


def open_recorder(url: Url, context: OpenContext) -> Recorder:
    """Open `record:FILE:URL`: the URL inside may be any other.

    Raises:
        TransportUrlError: file or URL missing.
        RecordingError: the file exists already, or cannot be made.

    """
    match = _RECORD.fullmatch(url.text)
    if match is None:
        raise TransportUrlError(f"{url.text}: write record:FILE:URL, as record:swim.log:pty:")

    def open_line(note: Callable[[OutageEvent], None]) -> Transport:
        def notify(event: OutageEvent) -> None:
            note(event)
            context.notify(event)

        return open_transport(match[2], replace(context, notify=notify))

    return Recorder(open_line, Path(match[1]), context.clock)


def open_url(url: Url, context: OpenContext) -> Replayer:
    """Open `replay:FILE[?pace=recorded|at-once&play=received|sent]`."""
    options = take(url, {"pace": _choice(PACES), "play": _choice(DIRECTIONS)})
    if not url.rest:
        raise TransportUrlError(f"{url.text}: which file? As replay:swim.log?pace=at-once")
    return Replayer(
        Path(url.rest),
        options.get("play", RECEIVED),
        at_once=options.get("pace", False),
        clock=context.clock,
    )


PACES: Final[dict[str, object]] = {"recorded": False, "at-once": True}
DIRECTIONS: Final[dict[str, object]] = {"received": RECEIVED, "sent": SENT}


def _choice(values: dict[str, object]) -> Callable[[str], object]:
    def convert(text: str) -> object:
        if text not in values:
            raise ValueError(f"there are {', '.join(values)}")
        return values[text]

    return convert


def _create(path: Path) -> IO[str]:
    try:
        file = path.open("x", buffering=1, encoding="utf-8", newline="\n")
    except FileExistsError as error:
        raise RecordingError(
            f"{path} exists and is not overwritten: name another file, or move this one away"
        ) from error
    except OSError as error:
        raise RecordingError(
            f"{path} cannot be made ({error.strerror}): does its folder exist, and may you write?"
        ) from error
    file.write(HEADER + "\n")
    return file
