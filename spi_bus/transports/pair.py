"""Two ends in one process: a socket pair, so that they behave like any other descriptor.

`pair:NAME` opened twice with the same context gives both ends; a third time begins a new pair,
which is what both sides do after one of them closed. There is no table of names beside the context:
who opens both ends has it in hand.
"""

from __future__ import annotations

import socket

from spi_bus.transports.base import OpenContext
from spi_bus.transports.descriptor import DescriptorTransport
from spi_bus.transports.urls import Url, take

__all__ = ["PairEnd", "open_pair", "open_url"]


class PairEnd(DescriptorTransport):
    """One end of a pair; what is written here is read at the other."""

    def __init__(self, end: socket.socket, description: str) -> None:
        end.setblocking(False)
        super().__init__(end.fileno(), description, close=end.close)


def open_pair(name: str = "pair") -> tuple[PairEnd, PairEnd]:
    """Return both ends of a new pair."""
    one, other = socket.socketpair()
    return PairEnd(one, f"{name}, one end"), PairEnd(other, f"{name}, other end")


def open_url(url: Url, context: OpenContext) -> PairEnd:
    """Return the waiting end of this name, or a new one whose other end then waits."""
    take(url, {})
    waiting = context.pairs.pop(url.rest, None)
    if waiting is not None:
        if _other_end_is_there(waiting):
            return waiting
        waiting.close()
    mine, context.pairs[url.rest] = open_pair(f"pair:{url.rest}")
    return mine


def _other_end_is_there(end: PairEnd) -> bool:
    with socket.socket(fileno=socket.dup(end.fileno())) as look:
        look.setblocking(False)
        try:
            return look.recv(1, socket.MSG_PEEK) != b""
        except BlockingIOError:
            return True
        except OSError:
            return False
