"""What readers and decoders hand on: octets with times, findings, and the count of them.

A reader of files yields `Octets` and, where the file itself is damaged, `Item`s; a decoder turns
octets into items and counts in a `Tally`. All of it is streamed: nothing here grows with the file.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import Any, Protocol


class What(StrEnum):
    """Kind of an item."""

    MESSAGE = "message"
    AGAIN = "retransmission"
    CONTROL = "control"
    """Acknowledgements, greetings, states: what protocols say to each other."""
    ERROR = "error"
    GAP = "gap"
    LINE = "line"
    """What happened to the line, as the recorder wrote it down."""


@dataclass(frozen=True, slots=True)
class Item:
    """One finding; a line of text, or an object of JSON.

    Attributes:
        what: its kind.
        name: of the message, or of the error.
        time_s: when it began; None where the file has no times.
        direction: who said it; empty where the file does not tell.
        offset: of its first octet in the file.
        text: what a person wants to know beside the name.
        fields: the message's values.
        header: the frame's own: numbers, acknowledgement. Apart from the values, because a message
            may have a `sequence` of its own, as SensorReport has.

    """

    what: What
    name: str
    time_s: float | None = None
    direction: str = ""
    offset: int = 0
    text: str = ""
    fields: dict[str, Any] = field(default_factory=dict)
    header: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Octets:
    """Some octets of one direction.

    Attributes:
        data: the octets.
        direction: who sent them; empty where the file does not tell.
        time_s: of the first; None where the file has no times.
        offset: in the file.
        stride: bytes of the file for an octet, to tell where within `data` something was; 0 where
            that cannot be told.
        times_s: of each octet, where the file has them.
        frame: they are one whole frame of a packet capture.
        has_fcs: the frame ends in its FCS.
        note: what the capture says of the frame.

    """

    data: bytes
    direction: str = ""
    time_s: float | None = None
    offset: int = 0
    stride: int = 0
    times_s: tuple[float, ...] = ()
    frame: bool = False
    has_fcs: bool = True
    note: str = ""

    def at(self, index: int) -> tuple[float | None, int]:
        """Return time and file offset of one octet."""
        time_s = self.times_s[index] if self.times_s else self.time_s
        return time_s, self.offset + index * self.stride


@dataclass(slots=True)
class Tally:
    """What one file held."""

    octets: Counter[str] = field(default_factory=Counter)
    """By direction."""
    frames: int = 0
    """All, damaged ones included."""
    messages: Counter[str] = field(default_factory=Counter)
    """By name, each once."""
    control: Counter[str] = field(default_factory=Counter)
    errors: Counter[str] = field(default_factory=Counter)
    crc_errors: int = 0
    lost: int = 0
    """Sequence numbers that never came."""
    retransmissions: int = 0
    first_s: float | None = None
    last_s: float | None = None

    @property
    def good(self) -> int:
        """Frames that said something."""
        return self.messages.total() + self.control.total() + self.retransmissions

    def count(self, item: Item) -> None:
        """Take one item into account."""
        if item.what is What.MESSAGE:
            self.messages[item.name] += 1
        elif item.what is What.CONTROL:
            self.control[item.name] += 1
        elif item.what is What.AGAIN:
            self.retransmissions += 1
        elif item.what is What.ERROR:
            self.errors[item.name] += 1

    def heard(self, octets: Octets) -> None:
        """Take octets into account."""
        self.octets[octets.direction] += len(octets.data)
        if octets.time_s is not None:
            if self.first_s is None:
                self.first_s = octets.time_s
            self.last_s = octets.times_s[-1] if octets.times_s else octets.time_s

    def as_dict(self) -> dict[str, Any]:
        """Return the summary for JSON."""
        return {
            "octets": dict(self.octets),
            "frames": self.frames,
            "messages": dict(sorted(self.messages.items())),
            "messages_total": self.messages.total(),
            "control": dict(sorted(self.control.items())),
            "errors": dict(sorted(self.errors.items())),
            "crc_errors": self.crc_errors,
            "lost_sequence_numbers": self.lost,
            "retransmissions": self.retransmissions,
            "first_s": self.first_s,
            "last_s": self.last_s,
        }


def values(message: Any) -> dict[str, Any]:
    """Return a message's fields that have a value (`asdict` would copy each of them deeply)."""
    found = ((row.name, getattr(message, row.name)) for row in fields(message))
    return {name: value for name, value in found if value is not None}


class StreamDecoder(Protocol):
    """A protocol's decoder: octets in, items out; counts frames, CRC errors, losses in a tally."""

    def feed(self, octets: Octets) -> Iterator[Item]:
        """Yield what these octets complete."""

    def finish(self) -> Iterator[Item]:
        """Yield what is left when the file ends."""
