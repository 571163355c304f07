"""`socket://host:port`: a byte stream over TCP, as serial servers (ser2net, socat) offer it.

The URL is pyserial's; the socket is ours, because pyserial's sleeps 0.3 s when it is closed and
spins while its buffer is full. Small frames go out at once (no Nagle).
"""

from __future__ import annotations

import socket
from typing import Final
from urllib.parse import urlsplit

from spi_bus.errors import PortNotFoundError, TransportUrlError
from spi_bus.transports.base import OpenContext
from spi_bus.transports.descriptor import DescriptorTransport
from spi_bus.transports.urls import Url, number, take

__all__ = ["SocketTransport", "open_url"]

CONNECT_S: Final = 5.0
"""Longest wait for a host that does not answer (pyserial's value)."""
SYSTEM_BYTES: Final = 65_536
"""Each way, of the system's own buffers: left alone they hold megabytes of what is old by then."""


class SocketTransport(DescriptorTransport):
    """A connected TCP socket, which it closes at the end."""

    def __init__(self, connection: socket.socket, description: str) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SYSTEM_BYTES)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SYSTEM_BYTES)
        super().__init__(connection.fileno(), description, close=connection.close)


def open_url(url: Url, context: OpenContext) -> SocketTransport:
    """Connect to `socket://host:port`.

    Raises:
        TransportUrlError: host or port missing.
        PortNotFoundError: nobody answers there.

    """
    del context
    timeout_s = take(url, {"timeout_s": number(0.01, 60.0)}).get("timeout_s", CONNECT_S)
    try:
        parts = urlsplit(f"socket:{url.rest}")
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port:
        raise TransportUrlError(f"{url.text}: write socket://host:port, as socket://localhost:5331")
    try:
        connection = socket.create_connection((host, port), timeout_s)
    except OSError as error:
        raise PortNotFoundError(
            f"{url.text}: no connection ({error.strerror or error}): is the server running there, "
            "and is the port right?"
        ) from error
    return SocketTransport(connection, f"socket {host}:{port}")
