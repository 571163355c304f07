"""The link between the boards (`spi_bus`), both directions, as a probe on the wires hears it.

The line of a plant in the loop is the same link with another table; numbers of messages are in one
of the two, so nobody has to say which it is.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any, Final

from spi_bus.errors import SpiBusError
from spi_bus.frame import MAX_PAYLOAD_BYTES, Decoder, ErrorKind, Flag, Frame, FrameType
from spi_bus.messages import LINK_MESSAGES
from spi_bus.plant_messages import PLANT_MESSAGES
from tools.decode.framing import Piece, PieceStream, Side
from tools.decode.items import Item, Tally, What, values

LONGEST: Final = MAX_PAYLOAD_BYTES + 16
REMEMBERED: Final = 16
"""Frames of a direction among which a repetition is looked for: twice the largest window."""
_PLANT: Final = frozenset(row.kind for row in PLANT_MESSAGES.rows)
_CONTROL: Final[dict[int, str]] = {FrameType.HELLO: "hello", FrameType.ACK: "ack"}
WORDS: Final = {
    ErrorKind.COBS: "no COBS block",
    ErrorKind.SHORT: "too short for a frame",
    ErrorKind.OVERSIZE: "longer than any frame",
    ErrorKind.CRC: "wrong CRC",
    ErrorKind.VERSION: "another protocol version",
}


class _Side(Side):
    def __init__(self) -> None:
        super().__init__(b"\0", LONGEST)
        self.recent: deque[bytes] = deque(maxlen=REMEMBERED)
        self.session: int | None = None


class LinkStream(PieceStream[_Side]):
    """Frames, messages, repetitions and gaps of the link."""

    def __init__(self, tally: Tally) -> None:
        super().__init__(tally, _Side, "frame")

    def _piece(self, piece: Piece, direction: str, side: _Side) -> Iterator[Item]:
        decoder = Decoder()
        bodies = decoder.receive(piece.data + b"\0")
        place = (piece.time_s, direction, piece.offset)
        if not bodies:
            kind = next((kind for kind, count in decoder.errors.items() if count), ErrorKind.COBS)
            # What a damaged octet does to a frame depends on which it was: all of it is damage.
            if kind is not ErrorKind.VERSION:
                self._tally.crc_errors += 1
            yield Item(What.ERROR, kind.value, *place, f"{WORDS[kind]}: {len(piece.data)} octets")
            return
        frame = Frame.parse(bodies[0])
        header = {"sequence": frame.sequence, "acknowledge": frame.acknowledge}
        if frame.frame_type == FrameType.STREAM:
            yield self._stream(frame, header, place)
            return
        if frame.frame_type != FrameType.DATA:
            name = _CONTROL.get(frame.frame_type, f"type {frame.frame_type}")
            header["window"] = frame.window
            text = f"expects {frame.acknowledge}, takes {frame.window}"
            if frame.flags & Flag.GAP:
                text += ", missed one"
            yield Item(What.CONTROL, name, *place, text, header=header)
            return
        yield from self._data(frame, header, place, side)

    def _stream(
        self, frame: Frame, header: dict[str, Any], place: tuple[float | None, str, int]
    ) -> Item:
        """A message of a stream: it has no number, and whether one is missing only it can say."""
        try:
            message = _message(frame.payload)
        except SpiBusError as error:
            self._tally.crc_errors += 1
            return Item(What.ERROR, "payload", *place, str(error), header=header)
        name = type(message).__name__
        return Item(What.MESSAGE, name, *place, "of a stream", values(message), header)

    def _data(
        self,
        frame: Frame,
        header: dict[str, Any],
        place: tuple[float | None, str, int],
        side: _Side,
    ) -> Iterator[Item]:
        try:
            message = _message(frame.payload)
        except SpiBusError as error:
            self._tally.crc_errors += 1  # as the summary of a run counts it
            yield Item(What.ERROR, "payload", *place, str(error), header=header)
            return
        if frame.session != side.session:
            if side.session is not None:
                side.numbers.restart()
            side.session = frame.session
        gap = side.numbers.heard(frame.sequence)
        if gap:
            text = f"{gap} before number {frame.sequence}"
            yield Item(What.GAP, "numbers missing", *place, text, {"missing": gap})
        identity = bytes((frame.session, frame.sequence)) + frame.payload
        again = identity in side.recent
        side.recent.append(identity)
        what = What.AGAIN if again else What.MESSAGE
        text = f"number {frame.sequence}"
        yield Item(what, type(message).__name__, *place, text, values(message), header)


def _message(payload: bytes) -> object:
    """Return the message that a payload holds, by the table that its number is of."""
    table = PLANT_MESSAGES if payload[:1] and payload[0] in _PLANT else LINK_MESSAGES
    return table.decode(payload)
