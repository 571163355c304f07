"""Where a tracker's octets come from: a port that listens, datagrams, or any transport.

| URL | Is |
|---|---|
| `listen://:5005` | a TCP port here, to which the tracker connects; the newest counts |
| `udp://:5005` | datagrams sent to a port here, each of whole lines |
| `tcp://host:5005`, `socket://host:5005` | a TCP server of the tracker's, to which we connect |
| `pty:`, `serial:///dev/…`, `replay:FILE`, `record:FILE:URL` | as of any transport |

Both of our own ports are on the loopback interface unless a host is named: whoever reaches the port
steers a fish. A tracker only talks, which is why these two are no transports: nothing is ever sent.
What comes is told in order as `Octets` or `Datagram`, with `Came` and `Went` between.
"""

from __future__ import annotations

import socket
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Final, Protocol
from urllib.parse import urlsplit

from spi_bus.errors import TransportError, TransportLost, TransportUrlError
from spi_bus.transports import SCHEMES, BackOff, OpenContext, open_transport
from spi_bus.transports.base import Clock, Waitable
from spi_bus.transports.outage import OutageBegan, OutageEnded, OutageEvent
from spi_bus.transports.urls import Url, nearest, parse, take

LOOPBACK: Final = "127.0.0.1"
MOST_OCTETS: Final = 65_536
"""Of one look: more than a tracker says in a second; the rest waits for the next look."""
MOST_DATAGRAMS: Final = 256
"""Of one look."""


@dataclass(frozen=True, slots=True)
class Octets:
    """A piece of the stream."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Datagram:
    """Whole lines."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Came:
    """A tracker is there: a new stream begins."""

    who: str


@dataclass(frozen=True, slots=True)
class Went:
    """It is gone: the stream is at its end."""

    why: str


Heard = Octets | Datagram | Came | Went


class Source(Protocol):
    """A place that octets come from; nothing blocks."""

    @property
    def description(self) -> str:
        """What it is and where, for a person."""

    def waitables(self) -> list[Waitable]:
        """Return what to wait on."""

    def read(self) -> list[Heard]:
        """Return what has come."""

    def close(self) -> None:
        """Give it back."""


def open_source(url: str, clock: Clock, notify: Callable[[OutageEvent], None]) -> Source:
    """Open a source; `notify` hears when the tracker goes and returns.

    Raises:
        TransportError: it cannot be opened; the text is one line with the remedy.

    """
    parsed = parse(url, "listen://:5005, udp://:5005 or tcp://HOST:5005")
    if parsed.scheme == "listen":
        return ListenSource(*place_of(parsed), clock, notify)
    if parsed.scheme == "udp":
        return UdpSource(*place_of(parsed))
    if parsed.scheme == "tcp":
        host, port = place_of(parsed)
        url = f"socket://[{host}]:{port}" if ":" in host else f"socket://{host}:{port}"
    elif parsed.scheme not in SCHEMES:
        known = nearest(parsed.scheme, ("listen", "udp", "tcp", *SCHEMES))
        raise TransportUrlError(f"{url}: no transport is called {parsed.scheme!r}{known}")
    return TransportSource(url, clock, notify)


def place_of(url: Url) -> tuple[str, int]:
    """Return host and port of `scheme://[HOST]:PORT`; without a host, of the loopback interface.

    Raises:
        TransportUrlError: it says something else.

    """
    take(url, {})
    try:
        parts = urlsplit(f"{url.scheme}:{url.rest}")
        host, port = parts.hostname or LOOPBACK, parts.port
    except ValueError:
        port = None
    if port is None or not url.rest.startswith("//"):
        hint = f"{url.scheme}://HOST:PORT, as {url.scheme}://localhost:5005"
        if url.scheme != "tcp":
            hint = (
                f"{url.scheme}://:PORT for this machine only, as {url.scheme}://:5005, or "
                f"{url.scheme}://0.0.0.0:5005 for others, too"
            )
        raise TransportUrlError(f"{url.text}: write {hint}")
    return host, port


def _bound(kind: socket.SocketKind, host: str, port: int) -> socket.socket:
    words = "listen" if kind is socket.SOCK_STREAM else "udp"
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=kind)[0]
        bound = socket.socket(family, kind)
    except OSError as error:
        raise TransportError(
            f"{words}://{host}:{port}: {error.strerror}: name an address"
        ) from error
    try:
        if kind is socket.SOCK_STREAM:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind(address)
        if kind is socket.SOCK_STREAM:
            bound.listen(4)
        bound.setblocking(False)
    except OSError as error:
        bound.close()
        raise TransportError(
            f"{words}://{host}:{port}: {error.strerror}: take another port, or an address of this "
            "machine"
        ) from error
    return bound


class _Descriptor:
    """Something with a descriptor to wait on."""

    wants_writable = False

    def __init__(self, handle: socket.socket) -> None:
        self._handle = handle

    def fileno(self) -> int:
        return self._handle.fileno()

    def next_deadline_s(self) -> float | None:
        return None

    def wait(self, timeout_s: float) -> None:
        raise NotImplementedError("waited for together with others, by its descriptor")


class ListenSource:
    """A TCP port that trackers connect to.

    One tracker counts, the newest: one that crashed may look connected for minutes.
    """

    def __init__(
        self, host: str, port: int, clock: Clock, notify: Callable[[OutageEvent], None]
    ) -> None:
        self._server = _bound(socket.SOCK_STREAM, host, port)
        self._client: socket.socket | None = None
        self._clock = clock
        self._notify = notify
        self._began: OutageBegan | None = None
        name = self._server.getsockname()
        self.port = int(name[1])
        """The port in use, where 0 asked for any."""
        self.description = f"tcp port {name[0]}:{name[1]}"

    def waitables(self) -> list[Waitable]:
        """Return the port, and the tracker that is connected."""
        handles = [self._server] + ([self._client] if self._client is not None else [])
        return [_Descriptor(handle) for handle in handles]

    def read(self) -> list[Heard]:
        """Return what the tracker said, and who came and went."""
        heard: list[Heard] = self._read_client()
        while True:
            try:
                client, address = self._server.accept()
            except (BlockingIOError, ConnectionError):
                break
            if self._client is not None:
                heard.append(self._gone("another tracker connected"))
            client.setblocking(False)
            self._client = client
            if self._began is not None:
                began, now_s = self._began, self._clock()
                self._notify(OutageEnded(now_s, began.time_s, 1, began.reason))
                self._began = None
            heard.append(Came(f"{address[0]}:{address[1]}"))
            heard += self._read_client()
        return heard

    def _read_client(self) -> list[Heard]:
        heard: list[Heard] = []
        while self._client is not None and len(heard) < MOST_DATAGRAMS:
            try:
                data = self._client.recv(MOST_OCTETS)
            except BlockingIOError:
                break
            except OSError as error:
                heard.append(self._gone(str(error.strerror or error)))
                break
            heard.append(Octets(data) if data else self._gone("it closed the connection"))
        return heard

    def _gone(self, why: str) -> Went:
        assert self._client is not None
        self._client.close()
        self._client = None
        self._began = OutageBegan(self._clock(), f"{self.description}: {why}")
        self._notify(self._began)
        return Went(why)

    def write(self, line: bytes) -> bool:
        """Say something to who is connected; False where nobody hears it.

        Not for a run, which only listens: for whoever plays the tracker at such a port.
        """
        if self._client is None:
            return False
        try:
            return self._client.send(line) == len(line)
        except OSError as error:
            if not isinstance(error, BlockingIOError):
                self._gone(str(error.strerror or error))
            return False

    def close(self) -> None:
        """Close both."""
        if self._client is not None:
            self._client.close()
            self._client = None
        self._server.close()


class UdpSource:
    """A UDP port: no connection, so nobody comes and goes; silence is a gap."""

    def __init__(self, host: str, port: int) -> None:
        self._socket = _bound(socket.SOCK_DGRAM, host, port)
        name = self._socket.getsockname()
        self.port = int(name[1])
        """The port in use, where 0 asked for any."""
        self.description = f"udp port {name[0]}:{name[1]}"

    def waitables(self) -> list[Waitable]:
        """Return the port."""
        return [_Descriptor(self._socket)]

    def read(self) -> list[Heard]:
        """Return the datagrams that came."""
        heard: list[Heard] = []
        with suppress(BlockingIOError):
            while len(heard) < MOST_DATAGRAMS:
                heard.append(Datagram(self._socket.recv(MOST_OCTETS)))
        return heard

    def close(self) -> None:
        """Close it."""
        self._socket.close()


class TransportSource:
    """Any transport, opened again when it is lost."""

    def __init__(self, url: str, clock: Clock, notify: Callable[[OutageEvent], None]) -> None:
        self._news: list[Heard] = []
        self._notify = notify
        self._clock = clock
        self._over = False

        def hear(event: OutageEvent) -> None:
            began = isinstance(event, OutageBegan)
            self._news.append(Went(event.reason) if began else Came(url))
            notify(event)

        self._transport = open_transport(url, OpenContext(clock, reconnect=BackOff(), notify=hear))

    @property
    def description(self) -> str:
        """The transport's."""
        return self._transport.description

    def waitables(self) -> list[Waitable]:
        """Return the transport, until it is at its end."""
        return [] if self._over else [self._transport]

    def read(self) -> list[Heard]:
        """Return what has come."""
        if self._over:
            return []
        data = b""
        try:
            data = self._transport.read(MOST_OCTETS)
            self._transport.flush()  # during an outage: tries the line
        except TransportLost as error:  # one that cannot be opened again: a recording
            self._over = True
            self._notify(OutageBegan(self._clock(), str(error)))
            self._news.append(Went(str(error)))
        news, self._news = self._news, []
        return [Octets(data), *news] if data else news

    def close(self) -> None:
        """Close it."""
        self._transport.close()
