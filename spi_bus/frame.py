"""Frames: five header bytes, a payload, a CRC, stuffed by COBS and closed by a zero.

    byte 0   version (high nibble), frame type (low nibble)
    byte 1   session: low nibbles of the sender's and of the receiver's epoch
    byte 2   sequence: number of this message (DATA), of the next one (ACK), 0 (HELLO)
    byte 3   acknowledge: number of the message that the sender expects next
    byte 4   flags (high nibble), receive window (low nibble): messages it takes from there on
    ...      payload, at most 247 bytes
    last 2   CRC-16/GENIBUS of all before it, high byte first

A frame is at most 254 bytes, so that COBS always adds exactly one byte and its 0xFF code never
occurs with bytes behind it: a small MCU can stuff in place. On the wire a frame ends with a zero.
Zeros between frames are filler and cost nothing: an SPI master that only listens clocks zeros.

The decoder cuts at zeros and nothing else. Whatever came before, the first zero puts it in step
again; it keeps at most one frame's bytes, never raises, and counts what it throws away by kind.
It hands out verified bodies (header and payload as bytes) and not objects, because the link looks
at two or three header bytes of a frame and is done; `Frame.parse` makes an object for those who
want to read.
"""

from binascii import crc_hqx  # as in spi_bus.crc, without a call more for every frame
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum, IntFlag, StrEnum
from typing import Final

from spi_bus import cobs
from spi_bus.crc import CRC_BYTES, INVERTED, RESIDUE, START
from spi_bus.errors import CobsError, FrameError

__all__ = [
    "ACKNOWLEDGE",
    "FLAGS_WINDOW",
    "HEADER_BYTES",
    "MAX_PAYLOAD_BYTES",
    "MAX_WINDOW",
    "SEQUENCE",
    "SESSION",
    "VERSION",
    "VERSION_TYPE",
    "Decoder",
    "ErrorKind",
    "Flag",
    "Frame",
    "FrameType",
    "seal",
]

VERSION: Final = 1

# Offsets of the header bytes in a body.
VERSION_TYPE, SESSION, SEQUENCE, ACKNOWLEDGE, FLAGS_WINDOW, HEADER_BYTES = range(6)

MAX_FRAME_BYTES: Final = cobs.LONGEST_RUN  # header, payload and CRC: one COBS block
MAX_PAYLOAD_BYTES: Final = MAX_FRAME_BYTES - HEADER_BYTES - CRC_BYTES
MAX_STUFFED_BYTES: Final = MAX_FRAME_BYTES + 1
MIN_STUFFED_BYTES: Final = HEADER_BYTES + CRC_BYTES + 1
MAX_WINDOW: Final = 15  # what the nibble holds
_REMAINDER: Final = RESIDUE ^ INVERTED


class FrameType(IntEnum):
    """Low nibble of byte 0."""

    HELLO = 1
    DATA = 2
    ACK = 3
    STREAM = 4
    """A message that is sent once, without acknowledgement: of a stream, only the newest counts."""


class Flag(IntFlag):
    """High nibble of byte 4."""

    FROM_SLAVE = 0x10
    """Sent by the slave: a link that hears its own side (an echo, a short) takes no notice."""
    GAP = 0x20
    """Something between was missed: send again from `acknowledge` on."""
    REPLY = 0x40
    """HELLO only: the sender wants a HELLO in return."""


class ErrorKind(StrEnum):
    """What was wrong with received bytes."""

    COBS = "cobs"
    SHORT = "short"
    OVERSIZE = "oversize"
    CRC = "crc"
    VERSION = "version"
    MALFORMED = "malformed"
    ECHO = "echo"
    PAYLOAD = "payload"


def seal(body: bytes) -> bytes:
    """Turn header and payload into wire bytes: CRC added, stuffed, closed by a zero.

    Raises:
        FrameError: the body is longer than a frame can be.

    """
    if len(body) > MAX_FRAME_BYTES - CRC_BYTES:
        raise FrameError(
            f"a payload of {len(body) - HEADER_BYTES} bytes; at most {MAX_PAYLOAD_BYTES} fit"
        )
    sealed = body + (crc_hqx(body, START) ^ INVERTED).to_bytes(CRC_BYTES, "big")
    return cobs.encode(sealed) + b"\0"


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame with its header taken apart; see the table at the top of this file."""

    frame_type: int
    session: int
    sequence: int
    acknowledge: int
    flags: int
    window: int
    payload: bytes = b""
    version: int = VERSION

    def body(self) -> bytes:
        """Return header and payload, without CRC and stuffing.

        Raises:
            FrameError: a field does not fit its bits.

        """
        if max(self.version, self.frame_type, self.window) > 15 or self.flags & ~0xF0:
            raise FrameError(f"a header field of {self} does not fit its nibble")
        try:
            header = bytes(
                (
                    self.version << 4 | self.frame_type,
                    self.session,
                    self.sequence,
                    self.acknowledge,
                    self.flags | self.window,
                )
            )
        except ValueError as error:
            raise FrameError(f"a header field of {self} does not fit its byte") from error
        return header + self.payload

    def encode(self) -> bytes:
        """Return the frame as it goes onto the wire."""
        return seal(self.body())

    @classmethod
    def parse(cls, body: bytes) -> "Frame":
        """Return the frame that a verified body holds.

        Raises:
            FrameError: the body is shorter than a header.

        """
        if len(body) < HEADER_BYTES:
            raise FrameError(f"a body of {len(body)} bytes is shorter than a header")
        version_type, session, sequence, acknowledge, flags_window = body[:HEADER_BYTES]
        return cls(
            frame_type=version_type & 0x0F,
            session=session,
            sequence=sequence,
            acknowledge=acknowledge,
            flags=flags_window & 0xF0,
            window=flags_window & 0x0F,
            payload=body[HEADER_BYTES:],
            version=version_type >> 4,
        )


class Decoder:
    """Cuts any byte stream, split anywhere, into verified bodies of our version.

    `errors` counts by kind what was thrown away. `foreign_version` is the last version seen that is
    not ours, for a clear word to the user.
    """

    __slots__ = ("_oversize", "_partial", "error_count", "errors", "foreign_version")

    def __init__(self) -> None:
        self._partial = b""
        self._oversize = False
        self.errors: dict[ErrorKind, int] = dict.fromkeys(ErrorKind, 0)
        self.error_count = 0
        self.foreign_version: int | None = None

    @property
    def buffered(self) -> int:
        """Bytes kept of a frame that has not ended, at most 255."""
        return len(self._partial)

    def receive(self, data: bytes) -> list[bytes]:
        """Return the bodies (header and payload) of all good frames that end in these bytes."""
        pieces = data.split(b"\0")
        if len(pieces) == 1:
            self._keep(self._partial + data)
            return []
        if self._oversize:
            self._oversize = False
            pieces[0] = b""  # the rest of what was too long, already counted
        elif self._partial:
            pieces[0] = self._partial + pieces[0]
        self._partial = b""
        tail = pieces.pop()
        bodies = self._decode(pieces)
        if tail:
            self._keep(tail)
        return bodies

    def reset(self) -> None:
        """Forget a frame half received, as after a transport was opened again."""
        self._partial = b""
        self._oversize = False

    def _keep(self, partial: bytes) -> None:
        if self._oversize:
            return
        if len(partial) > MAX_STUFFED_BYTES:
            self._oversize = True
            self._count(ErrorKind.OVERSIZE)
            partial = b""
        self._partial = partial

    def _decode(self, pieces: Iterable[bytes]) -> list[bytes]:
        bodies = []
        unstuff = cobs.decode
        for piece in pieces:
            if MIN_STUFFED_BYTES <= len(piece) <= MAX_STUFFED_BYTES:
                try:
                    checked = unstuff(piece)
                except CobsError:
                    self._count(ErrorKind.COBS)
                    continue
                if crc_hqx(checked, START) != _REMAINDER:
                    self._count(ErrorKind.CRC)
                elif checked[0] >> 4 != VERSION:
                    self.foreign_version = checked[0] >> 4
                    self._count(ErrorKind.VERSION)
                else:
                    bodies.append(checked[:-CRC_BYTES])
            elif piece:  # else filler
                short = len(piece) < MIN_STUFFED_BYTES
                self._count(ErrorKind.SHORT if short else ErrorKind.OVERSIZE)
        return bodies

    def _count(self, kind: ErrorKind) -> None:
        self.errors[kind] += 1
        self.error_count += 1
