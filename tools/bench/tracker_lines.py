"""Poses of an external tracker as JSON lines: octets in, poses and complaints out; no clock.

    {"time_s": 12.345, "x_m": 0.51, "y_m": -0.20, "heading_rad": 1.57}

One object a line, UTF-8, ended by a line feed; `id` (text or whole number) and `quality` (0 to 1)
may stand beside, other keys are let pass. A tracker is somebody else's program: whatever comes, no
line raises and none is taken on trust. A line that is not a pose is refused with a reason and what
to do about it, and the next one is read as if nothing had been.

What looks like another unit is refused, too: a heading beyond a whole turn (degrees?) and a place
beyond what a `Pose` message carries (millimetres, pixels?). Smaller degrees cannot be told apart.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from difflib import get_close_matches
from enum import StrEnum
from typing import Final

import msgspec

MAX_LINE_BYTES: Final = 4096
"""A pose has a hundred; what has more before its line feed is something else (assumed)."""
MOST_PLACE_M: Final = 32.767
"""What the radio's `Pose` message carries (`radio_802154.messages`)."""
MOST_HEADING_RAD: Final = 2 * math.pi + 1e-6
"""A whole turn, for trackers that count from 0 to 2π, and their rounding."""
_KEYS: Final = ("time_s", "x_m", "y_m", "heading_rad")
_SHOWN: Final = 60  # characters of a refused line that are quoted


class LineFault(StrEnum):
    """Why a line was refused."""

    ENCODING = "encoding"
    """Not UTF-8, or with a byte-order mark."""
    SYNTAX = "syntax"
    """No JSON object."""
    KEYS = "keys"
    """A key is missing, or has a value of another type."""
    NOT_FINITE = "not_finite"
    """NaN or infinity: JSON has neither, though some writers write them."""
    RANGE = "range"
    """A value beyond what it can be: another unit, most likely."""
    LONG = "long"
    """More than `MAX_LINE_BYTES` without a line feed."""
    CUT = "cut"
    """Octets without a line feed when the connection ended."""


class TrackerPose(msgspec.Struct, frozen=True):
    """A pose as the tracker says it; `time_s` is the exposure, by the tracker's own clock."""

    time_s: float
    x_m: float
    y_m: float
    heading_rad: float
    """Counter-clockwise from the tank's x axis."""
    id: str | int = ""
    quality: float = 1.0


@dataclass(frozen=True, slots=True)
class Refused:
    """A line that is no pose: which one since the start, why, and what to do."""

    line: int
    fault: LineFault
    reason: str

    def __str__(self) -> str:
        return f"line {self.line}: {self.reason}"


_decoder: Final = msgspec.json.Decoder(TrackerPose)


class LineReader:
    """Cuts octets, split anywhere, into lines and reads each as a pose.

    `receive` for octets; `end` when the connection is over (or the datagram: each is whole lines).
    """

    __slots__ = ("_buffer", "_skipping", "lines")

    def __init__(self) -> None:
        self.lines = 0
        """Lines so far, empty ones too."""
        self._buffer = bytearray()
        self._skipping = False  # within a line that was refused as too long

    @property
    def buffered(self) -> int:
        """Octets kept of a line that has not ended."""
        return len(self._buffer)

    def receive(self, data: bytes) -> list[TrackerPose | Refused]:
        """Return what the lines that end in these octets hold, in order."""
        found: list[TrackerPose | Refused] = []
        *ended, rest = data.split(b"\n")
        for piece in ended:
            self._buffer += piece
            line = bytes(self._buffer)
            self._buffer.clear()
            self.lines += 1
            if self._skipping:
                self._skipping = False
            elif len(line) > MAX_LINE_BYTES:
                found.append(self._too_long(line, self.lines))
            elif line.strip():
                found.append(read_pose(line, self.lines))
        if not self._skipping:
            self._buffer += rest
            if len(self._buffer) > MAX_LINE_BYTES:
                found.append(self._too_long(bytes(self._buffer), self.lines + 1))
                self._buffer.clear()
                self._skipping = True
        return found

    def end(self, *, whole: bool = False) -> list[TrackerPose | Refused]:
        """Say that nothing more comes; a last line without its end is a pose if `whole`."""
        line = bytes(self._buffer)
        self._buffer.clear()
        skipping, self._skipping = self._skipping, False
        if skipping:
            self.lines += 1
        if skipping or not line.strip():
            return []
        self.lines += 1
        if whole:
            return [read_pose(line, self.lines)]
        reason = f"{_shown(line)} has no line feed, and nothing more came: write whole lines"
        return [Refused(self.lines, LineFault.CUT, reason)]

    def _too_long(self, line: bytes, number: int) -> Refused:
        reason = (
            f"{_shown(line)} is longer than {MAX_LINE_BYTES} octets: write one JSON object a line, "
            "each ended by a line feed"
        )
        return Refused(number, LineFault.LONG, reason)


def read_pose(line: bytes, number: int) -> TrackerPose | Refused:
    """Return the pose that a line holds, or why it holds none; never raises."""
    try:
        pose = _decoder.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        fault, reason = _why_not(line, error)
        return Refused(number, fault, reason)
    for name in ("time_s", "x_m", "y_m", "heading_rad", "quality"):
        if not math.isfinite(getattr(pose, name)):
            reason = f"{name} is not finite: send no line while there is no pose"
            return Refused(number, LineFault.NOT_FINITE, reason)
    if abs(pose.heading_rad) > MOST_HEADING_RAD:
        reason = (
            f"heading_rad = {pose.heading_rad:g} is more than a turn: are these degrees? Send "
            "radians from −π to π"
        )
        return Refused(number, LineFault.RANGE, reason)
    for name in ("x_m", "y_m"):
        value = getattr(pose, name)
        if abs(value) > MOST_PLACE_M:
            reason = (
                f"{name} = {value:g} is beyond {MOST_PLACE_M:g} m: are these millimetres or "
                "pixels? Send metres in the tank's frame"
            )
            return Refused(number, LineFault.RANGE, reason)
    if not 0 <= pose.quality <= 1:
        reason = f"quality = {pose.quality:g} is outside 0 to 1: scale it, or leave it out"
        return Refused(number, LineFault.RANGE, reason)
    return pose


def _why_not(line: bytes, error: Exception) -> tuple[LineFault, str]:
    """Say what is wrong with a line that did not decode, in the terms of whoever wrote it."""
    try:
        text = line.decode("utf-8")
    except UnicodeDecodeError:
        text = ""
    if not text or text.startswith("\ufeff") or "\0" in text:
        return LineFault.ENCODING, f"{_shown(line)} is not plain UTF-8: write UTF-8 without a mark"
    if isinstance(error, msgspec.ValidationError) and text.lstrip().startswith("{"):
        return LineFault.KEYS, f"{_keys_words(text, str(error))}"
    if any(word in text for word in ("NaN", "nan", "Infinity", "inf")):
        reason = (
            f"{_shown(line)} has a NaN or an infinity, which JSON has not: send no line while "
            "there is no pose"
        )
        return LineFault.NOT_FINITE, reason
    reason = (
        f"{_shown(line)} is no JSON object ({_first_words(error)}): write one a line, such as "
        '{"time_s": 1.5, "x_m": 0.5, "y_m": 0.2, "heading_rad": 0.1}'
    )
    return LineFault.SYNTAX, reason


def _keys_words(text: str, error: str) -> str:
    """Complain of a missing key with the name that stands in its place, where one looks alike."""
    for key in _KEYS:
        if f"missing required field `{key}`" not in error:
            continue
        raw: dict[str, object] = {}
        with suppress(msgspec.DecodeError, RecursionError):  # what follows the object may be odd
            raw = msgspec.json.decode(text, type=dict[str, object])
        stem = key.partition("_")[0]
        there = [name for name in raw if name not in _KEYS]
        alike = [name for name in there if name.partition("_")[0].lower() == stem]
        alike += get_close_matches(key, there, n=1)
        hint = f"; there is {alike[0]!r}" if alike else ""
        return f"{key} is missing{hint}: each line has {', '.join(_KEYS)}"
    return f"{error[:1].lower()}{error[1:]}: each line has {', '.join(_KEYS)} as numbers"


def _first_words(error: Exception) -> str:
    if isinstance(error, RecursionError):
        return "nested too deeply"
    words = str(error).removeprefix("JSON is malformed: ").partition(" (byte")[0]
    return words[:1].lower() + words[1:]


def _shown(line: bytes) -> str:
    text = line[: _SHOWN + 1].decode("utf-8", "backslashreplace")
    return repr(text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…")
