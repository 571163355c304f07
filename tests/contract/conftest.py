"""Lines for the transport kit: for each way of opening a transport, both of its ends.

A line opens its ends by URL, as a user does. What is needed around it (a TCP server, an RFC 2217
server, two slcan adapters) is played here, with real sockets and real ptys.
"""

from __future__ import annotations

import select
import socket
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from spi_bus.errors import TransportLost
from spi_bus.transports import OpenContext, Transport, open_transport
from spi_bus.transports.pty import PtyTransport
from spi_bus.transports.tcp import SocketTransport

PATIENCE_S = 20.0
"""How long anything may take before a test fails: far more than it does."""


@dataclass
class Place:
    """What the lines of one test share."""

    folder: Path
    context: OpenContext = field(default_factory=OpenContext)
    stack: ExitStack = field(default_factory=ExitStack)
    number: int = 0

    def open(self, url: str) -> Transport:
        """Open a transport that is closed at the end of the test."""
        transport = open_transport(url, self.context)
        self.stack.callback(transport.close)
        return transport

    def file(self, suffix: str) -> Path:
        """Return a path that nothing has yet."""
        self.number += 1
        return self.folder / f"{self.number}{suffix}"


Ends = tuple[Transport, Transport]


@dataclass(frozen=True)
class Line:
    """One way of opening transports: which rows it covers, and what it promises."""

    name: str
    rows: tuple[str, ...]
    open: Callable[[Place], Ends]
    notices: tuple[bool, bool] = (True, True)
    """Whether each end notices that the other has closed."""
    blocks: bool = True
    """Whether `room` falls to 0 while the other end does not read."""
    slow: bool = False


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    found = Place(tmp_path)
    with found.stack:
        yield found


def pair(place: Place) -> Ends:
    place.number += 1
    url = f"pair:{place.number}"
    return place.open(url), place.open(url)


def pty_and_serial(place: Place) -> Ends:
    link = place.file(".pty")
    return place.open(f"pty:?link={link}"), place.open(f"serial://{link}?baud=921600")


def tcp(place: Place) -> Ends:
    with socket.create_server(("127.0.0.1", 0)) as server:
        near = place.open(f"socket://127.0.0.1:{server.getsockname()[1]}")
        connection, _ = server.accept()
    far = SocketTransport(connection, "the server's end")
    place.stack.callback(far.close)
    return near, far


def rfc2217(place: Place) -> Ends:
    """The port that a server offers is the far side of a pty; we have the near one."""
    import serial.rfc2217

    class NoModemLines(serial.Serial):
        cts = dsr = ri = cd = property(lambda self: True)

        def _update_dtr_state(self) -> None: ...

        def _update_rts_state(self) -> None: ...

    near = PtyTransport()
    place.stack.callback(near.close)
    port = NoModemLines(near.path, timeout=0)
    server = socket.create_server(("127.0.0.1", 0))
    stopping = threading.Event()

    class Session:
        def __init__(self, connection: socket.socket) -> None:
            self.connection = connection
            self.lock = threading.Lock()

        def write(self, data: bytes) -> None:  # the PortManager answers through this
            with self.lock:
                self.connection.sendall(data)

    def serve() -> None:
        connection, _ = server.accept()
        session = Session(connection)
        manager = serial.rfc2217.PortManager(port, session)
        with connection:
            try:
                while not stopping.is_set():
                    ready, _, _ = select.select([connection, port], [], [], 0.02)
                    if connection in ready:
                        data = connection.recv(1024)
                        if not data:
                            return
                        port.write(b"".join(manager.filter(data)))
                    if waiting := port.in_waiting:
                        session.write(b"".join(manager.escape(port.read(waiting))))
            except OSError:  # the pty is gone: such a server keeps its client, and says nothing
                stopping.wait(PATIENCE_S)

    thread = threading.Thread(target=serve)
    thread.start()

    def stop() -> None:
        stopping.set()
        thread.join(PATIENCE_S)
        port.close()
        server.close()

    place.stack.callback(stop)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # pyserial 3.5's Thread.setDaemon
        return place.open(f"rfc2217://127.0.0.1:{server.getsockname()[1]}?baud=115200"), near


def can_virtual(place: Place, options: str = "") -> Ends:
    place.number += 1
    base = f"can://virtual/{place.folder.name}-{place.number}"
    return (
        place.open(f"{base}?tx=0x101&rx=0x201{options}"),
        place.open(f"{base}?tx=0x201&rx=0x101{options}"),
    )


def can_fd(place: Place) -> Ends:
    return can_virtual(place, "&fd=1&brs=1&block=3")


def can_extended(place: Place) -> Ends:
    place.number += 1
    base = f"can://virtual/{place.folder.name}-{place.number}"
    return (
        place.open(f"{base}?tx=0x18DA10F1&rx=0x18DAF110&padding=none"),
        place.open(f"{base}?tx=0x18DAF110&rx=0x18DA10F1&block=8&stmin_ms=0.1"),
    )


def can_udp(place: Place) -> Ends:
    from spi_bus.errors import TransportError

    port = 43_200 + hash(place.folder.name) % 2_000
    base = f"can://udp_multicast/239.74.163.2?port={port}&hop_limit=0"
    try:
        ends = place.open(f"{base}&tx=0x101&rx=0x201"), place.open(f"{base}&tx=0x201&rx=0x101")
    except TransportError as error:
        pytest.skip(f"no multicast here: {error}")
    ends[0].write(b"?")
    end_s = time.monotonic() + 1.0
    while not (heard := ends[1].read()) and time.monotonic() < end_s:
        ends[1].wait(0.1)
    if not heard:
        pytest.skip("this machine does not loop multicast back")
    return ends


def slcan(place: Place) -> Ends:
    """Two slcan adapters on one bus: what one is told to send, the other hears."""
    adapters = [PtyTransport(), PtyTransport()]
    stopping = threading.Event()

    def serve() -> None:
        texts = [b"", b""]
        while not stopping.is_set():
            for index, adapter in enumerate(adapters):
                with suppress(TransportLost):
                    texts[index] += adapter.read()
                *lines, texts[index] = texts[index].split(b"\r")
                for line in lines:
                    answer = b"\r"
                    if line[:1] in b"tTdDbB" and line:
                        other = adapters[1 - index]
                        while other.room < len(line) + 1 and not stopping.is_set():
                            other.flush()
                            time.sleep(0.001)
                        other.write(line + b"\r")
                        answer = b"z\r"
                    if adapter.room >= len(answer):
                        adapter.write(answer)
                adapter.flush()
            time.sleep(0.0005)

    thread = threading.Thread(target=serve)
    thread.start()

    def stop() -> None:
        stopping.set()
        thread.join(PATIENCE_S)
        for adapter in adapters:
            adapter.close()

    place.stack.callback(stop)
    options = "bitrate=1000000&sleep_after_open=0"
    one, other = (f"can://slcan/{adapter.path}?{options}" for adapter in adapters)
    return place.open(f"{one}&tx=0x101&rx=0x201"), place.open(f"{other}&tx=0x201&rx=0x101")


def recorded(place: Place) -> Ends:
    place.number += 1
    url = f"pair:{place.number}"
    return place.open(f"record:{place.file('.log')}:{url}"), place.open(url)


def recorded_can(place: Place) -> Ends:
    """A recorder around a line that never notices anything, with its queues and flow control."""
    place.number += 1
    base = f"can://virtual/{place.folder.name}-{place.number}"
    return (
        place.open(f"record:{place.file('.log')}:{base}?tx=0x101&rx=0x201"),
        place.open(f"{base}?tx=0x201&rx=0x101"),
    )


def recorded_serial(place: Place) -> Ends:
    """Both ends are recorded: a serial device, and the pty that it is."""
    link = place.file(".pty")
    near = place.open(f"record:{place.file('.log')}:pty:?link={link}")
    return near, place.open(f"record:{place.file('.log')}:serial://{link}?baud=921600")


LINES = (
    Line("pair", ("pair",), pair),
    Line("pty-serial", ("pty", "serial"), pty_and_serial, notices=(False, True)),
    Line("socket", ("socket",), tcp),
    Line("rfc2217", ("pyserial",), rfc2217, notices=(False, False), blocks=False, slow=True),
    Line("can-virtual", ("can",), can_virtual, notices=(False, False)),
    Line("can-fd", ("can",), can_fd, notices=(False, False)),
    Line("can-extended", ("can",), can_extended, notices=(False, False)),
    Line("can-udp", ("can",), can_udp, notices=(False, False)),
    Line("can-slcan", ("can",), slcan, notices=(False, False), slow=True),
    Line("record", ("record",), recorded),
    Line("record-can", ("record", "can"), recorded_can, notices=(False, False)),
    Line("record-serial", ("record", "pty", "serial"), recorded_serial, notices=(False, True)),
)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "line" in metafunc.fixturenames:
        metafunc.parametrize("line", LINES, ids=[line.name for line in LINES])


@pytest.fixture(scope="session")
def lines() -> tuple[Line, ...]:
    return LINES


@pytest.fixture(autouse=True)
def _ptys_only_where_there_are_some(request: pytest.FixtureRequest) -> None:
    line = request.node.funcargs.get("line")
    if line is None or sys.platform != "win32":
        return
    if "pty" in line.rows or line.name == "can-slcan":
        pytest.skip("Windows has no pseudo-terminals")
