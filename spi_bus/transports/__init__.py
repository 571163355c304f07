"""Where link bytes leave the protocol: a table of what there is, loaded when it is wanted.

A transport is chosen by its URL: `open_transport("serial:///dev/ttyUSB0?baud=115200")`. To add one:
a file with a class and `open_url`, and a row here. `docs/transports.md` is for users.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any, Final

from spi_bus.errors import TransportUrlError
from spi_bus.transports.base import OpenContext, Transport
from spi_bus.transports.outage import BackOff, OutageLog
from spi_bus.transports.reconnect import ReconnectingTransport
from spi_bus.transports.urls import Url, nearest, parse

__all__ = [
    "SCHEMES",
    "TRANSPORTS",
    "BackOff",
    "OpenContext",
    "OutageLog",
    "Transport",
    "TransportRow",
    "open_transport",
]


@dataclass(frozen=True, slots=True)
class TransportRow:
    """One transport: its name, where it lives, a line for the user, and the URLs that open it."""

    name: str
    module: str
    factory: str
    description: str
    schemes: tuple[str, ...] = ()
    """Empty: not opened by URL, wired by the bench."""
    opener: str = "open_url"
    reopens: bool = True
    """Whether opening it again after its loss makes sense."""

    def load(self) -> Any:
        """Return the class, importing its module now."""
        return getattr(import_module(self.module), self.factory)

    def open(self, url: Url, context: OpenContext) -> Transport:
        """Open it."""
        opener: Callable[[Url, OpenContext], Transport] = getattr(
            import_module(self.module), self.opener
        )
        return opener(url, context)


TRANSPORTS: Final = (
    TransportRow(
        "emulated",
        "spi_bus.transports.emulated",
        "SpiWires",
        "SCK, MOSI, MISO, chip select and data ready between two emulated boards, bit errors too",
    ),
    TransportRow(
        "pair",
        "spi_bus.transports.pair",
        "PairEnd",
        "pair:NAME  both ends in one process",
        ("pair",),
    ),
    TransportRow(
        "pty",
        "spi_bus.transports.pty",
        "PtyTransport",
        "pty:[?link=PATH]  a pseudo-terminal that another program opens as its serial port",
        ("pty",),
    ),
    TransportRow(
        "serial",
        "spi_bus.transports.serial_port",
        "SerialTransport",
        "serial:///dev/ttyUSB0?baud=115200  a serial device",
        ("serial",),
    ),
    TransportRow(
        "pyserial",
        "spi_bus.transports.serial_port",
        "PortTransport",
        "rfc2217://HOST:PORT, loop://, spy://…, hwgrep://…  pyserial's other ports",
        ("rfc2217", "loop", "spy", "hwgrep", "alt"),
    ),
    TransportRow(
        "socket",
        "spi_bus.transports.tcp",
        "SocketTransport",
        "socket://HOST:PORT  a byte stream over TCP, as of ser2net or socat",
        ("socket",),
    ),
    TransportRow(
        "can",
        "spi_bus.transports.can_bus",
        "CanTransport",
        "can://INTERFACE/CHANNEL?tx=0x101&rx=0x201  CAN or CAN FD by python-can, ISO-TP inside",
        ("can",),
    ),
    TransportRow(
        "record",
        "spi_bus.transports.recording",
        "Recorder",
        "record:FILE:URL  any of these, with all bytes and outages written to a new file",
        ("record",),
        "open_recorder",
        reopens=False,
    ),
    TransportRow(
        "replay",
        "spi_bus.transports.recording",
        "Replayer",
        "replay:FILE[?pace=at-once][&play=sent]  what a recording heard, or said",
        ("replay",),
        reopens=False,
    ),
)

SCHEMES: Final = {scheme: row for row in TRANSPORTS for scheme in row.schemes}


def open_transport(url: str, context: OpenContext | None = None) -> Transport:
    """Open a transport by its URL; with `context.reconnect`, one that survives its line's loss.

    Raises:
        TransportError: it cannot be opened; the text is one line with the remedy.

    """
    context = context or OpenContext()
    parsed = parse(url)
    row = SCHEMES.get(parsed.scheme)
    if row is None:
        raise TransportUrlError(
            f"{url}: no transport is called {parsed.scheme!r}{nearest(parsed.scheme, SCHEMES)}"
        )
    if context.reconnect is None or not row.reopens:
        return row.open(parsed, context)
    line_context = replace(context, reconnect=None)
    return ReconnectingTransport(
        lambda: row.open(parsed, line_context), context.reconnect, context.clock, context.notify
    )
