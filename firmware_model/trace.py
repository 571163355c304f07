"""One trace, many views: channels of (time, value) records, hashed and handed on in blocks.

A channel keeps nothing but its current block. When the block is full, or at the end, the block is
hashed and every sink (CSV, VCD, pcap, report) sees it once. A run in real time hands smaller pieces
on whenever it has a moment to spare (`flush_some`). The trace's hash is over the channels'
hashes in the order of their names, so it does not depend on how blocks of different channels
interleave. Values are ints, floats, bytes, strings, and tuples of them, and of no other class: what
is hashed is their form in version 2 of the marshal format, which is exact, knows nothing of the
identity of objects, and has been the same in every Python since 2.5.
"""

from __future__ import annotations

import hashlib
import marshal
from collections.abc import Callable
from typing import TypeAlias

Value: TypeAlias = "int | float | bytes | str | bool | tuple[Value, ...] | None"
Record: TypeAlias = tuple[int, Value]
Sink: TypeAlias = Callable[[list[Record]], None]

_BLOCK = 2048
_FORMAT = 2
_LIST_HEAD = 5  # octets before a marshalled list's items: its type and their number


class Channel:
    """One named stream of records in the order in which they were made."""

    __slots__ = ("_block", "_digest", "_sinks", "count", "name")

    def __init__(self, name: str) -> None:
        self.name = name
        self.count = 0
        self._block: list[Record] = []
        self._digest = hashlib.sha256()
        self._sinks: tuple[Sink, ...] = ()

    def record(self, time_fs: int, value: Value) -> None:
        """Add a record; sinks see it with its block."""
        block = self._block
        block.append((time_fs, value))
        if len(block) >= _BLOCK:
            self.flush()

    @property
    def waiting(self) -> bool:
        """Whether there are records that no sink has seen."""
        return bool(self._block)

    def sink(self, sink: Sink) -> None:
        """Hand every block from now on to `sink`; what was recorded before is flushed first."""
        self.flush()
        self._sinks = (*self._sinks, sink)

    def flush(self, most: int | None = None) -> None:
        """Hash the block, or the first `most` records of it, and hand them to the sinks."""
        block = self._block
        if block:
            self._block = [] if most is None else block[most:]
            if most is not None:
                block = block[:most]
            self.count += len(block)
            self._digest.update(memoryview(marshal.dumps(block, _FORMAT))[_LIST_HEAD:])
            for sink in self._sinks:
                sink(block)

    def digest(self) -> bytes:
        """Return the SHA-256 of all records so far, whatever the blocks were."""
        self.flush()
        return self._digest.digest()


class Trace:
    """All channels of a run."""

    def __init__(self) -> None:
        self._channels: dict[str, Channel] = {}
        self._turn: list[Channel] = []  # those that `flush_some` has still to look at, backwards

    def channel(self, name: str) -> Channel:
        """Return the channel of that name, made at first use."""
        channel = self._channels.get(name)
        if channel is None:
            channel = self._channels[name] = Channel(name)
        return channel

    def names(self) -> tuple[str, ...]:
        """Return the names of all channels, sorted."""
        return tuple(sorted(self._channels))

    def flush(self) -> None:
        """Hand all that is still held to the sinks."""
        for name in self.names():
            self._channels[name].flush()

    def flush_some(self, most: int) -> bool:
        """Hand on up to `most` records of one channel, each channel in its turn; False: none had.

        For moments in which a run in real time would wait: a whole block at once may take longer
        than it has.
        """
        for _ in range(2 * len(self._channels)):  # the rest of this round, and one more
            if not self._turn:
                self._turn = list(self._channels.values())
            channel = self._turn.pop()
            if channel.waiting:
                channel.flush(most)
                return True
        return False

    def sha256(self) -> str:
        """Return the hash of the whole trace so far, in hexadecimal."""
        total = hashlib.sha256()
        for name in self.names():
            total.update(name.encode() + b"\0" + self._channels[name].digest())
        return total.hexdigest()
