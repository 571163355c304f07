"""The serial line of a TinyOS mote, and that of an XBee module in API mode."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from radio_802154 import messages, routing_messages, xbee
from radio_802154.errors import RadioError
from radio_802154.tinyos_serial import (
    AM_DISPATCH,
    MAX_FRAME_OCTETS,
    Decoder,
    PacketType,
    SerialError,
    SerialPacket,
    decode_am,
)
from tools.decode.framing import Piece, PieceStream, Side
from tools.decode.items import Item, Octets, Tally, What, values

Place = tuple[float | None, str, int]
_FLAG: Final = b"\x7e"
_TINYOS_WORDS: Final = {
    SerialError.SHORT: "too short for a packet",
    SerialError.OVERSIZE: "longer than any packet",
    SerialError.ESCAPE: "broken off within an escape",
    SerialError.CRC: "wrong CRC",
    SerialError.TYPE: "no known packet type",
}


class _Side(Side):
    def __init__(self) -> None:
        super().__init__(_FLAG, 2 * MAX_FRAME_OCTETS + 1)
        self.last: SerialPacket | None = None


class TinyOsStream(PieceStream[_Side]):
    """Packets, active messages, acknowledgements and repetitions of TEP 113."""

    def __init__(self, tally: Tally) -> None:
        super().__init__(tally, _Side, "packet")

    def _piece(self, piece: Piece, direction: str, side: _Side) -> Iterator[Item]:
        decoder = Decoder()
        packets = decoder.receive(_FLAG + piece.data + _FLAG)
        place = (piece.time_s, direction, piece.offset)
        if not packets:
            kind = next(kind for kind, count in decoder.errors.items() if count)
            self._tally.crc_errors += kind is SerialError.CRC
            text = f"{_TINYOS_WORDS[kind]}: {len(piece.data)} octets"
            yield Item(What.ERROR, kind.value, *place, text)
            return
        packet = packets[0]
        if packet.kind is PacketType.ACK:
            text = f"of number {packet.sequence}"
            yield Item(What.CONTROL, "ack", *place, text, header={"sequence": packet.sequence})
            return
        again = packet.sequence is not None and packet == side.last
        if packet.sequence is not None:
            side.last = packet
            gap = 0 if again else side.numbers.heard(packet.sequence)
            if gap:
                text = f"{gap} before number {packet.sequence}"
                yield Item(What.GAP, "numbers missing", *place, text, {"missing": gap})
        yield _packet(packet, place, again)


def _packet(packet: SerialPacket, place: Place, again: bool) -> Item:
    what = What.AGAIN if again else What.MESSAGE
    header: dict[str, Any] = {} if packet.sequence is None else {"sequence": packet.sequence}
    text = "" if packet.sequence is None else f"number {packet.sequence}"
    if packet.dispatch != AM_DISPATCH:
        header["dispatch"] = packet.dispatch
        told = {"data": packet.body.hex(" ")}
        return Item(what, f"dispatch {packet.dispatch}", *place, text, told, header)
    try:
        am = decode_am(packet.body)
    except RadioError as error:
        return Item(What.ERROR, "active message", *place, str(error), header=header)
    name, told = active_message(am.am_type, am.payload)
    header["group"] = am.group
    way = f"0x{am.source:04x} to 0x{am.destination:04x}"
    return Item(what, name, *place, f"{way} {text}".strip(), told, header)


def active_message(am_type: int, payload: bytes) -> tuple[str, dict[str, Any]]:
    """Return name and values of an active message; of one that is not ours its octets."""
    try:
        message: Any = messages.decode(am_type, payload)
        return type(message).__name__, values(message)
    except RadioError:
        pass
    try:
        message, rest = routing_messages.read(am_type, payload)
    except RadioError:
        return f"AM 0x{am_type:02x}", {"data": payload.hex(" ")}
    told = values(message)
    if isinstance(rest, list):
        told["entries"] = [values(entry) for entry in rest]
    elif rest:
        told["data"] = rest.hex(" ")
    return type(message).__name__, told


class XBeeStream:
    """Frames of an XBee module; it has no sequence numbers, so frame ids stand for themselves."""

    def __init__(self, tally: Tally, *, escaped: bool) -> None:
        self._tally = tally
        self._escaped = escaped
        self._sides: dict[str, xbee.Decoder] = {}
        self._last: dict[str, tuple[float | None, int]] = {}

    def feed(self, octets: Octets) -> Iterator[Item]:
        """Yield what these octets complete; the time is that of their first."""
        direction = octets.direction
        decoder = self._sides.get(direction)
        if decoder is None:
            decoder = self._sides[direction] = xbee.Decoder(escaped=self._escaped)
        # A frame's end is a checksum and no delimiter, so that it is known to the block only.
        for start in range(0, len(octets.data), _XBEE_BLOCK):
            self._last[direction] = octets.at(start)
            before = dict(decoder.errors)
            frames = decoder.receive(octets.data[start : start + _XBEE_BLOCK])
            yield from self._items(decoder, before, frames, direction)

    def finish(self) -> Iterator[Item]:
        """Yield what is hidden in a frame that was begun and not finished."""
        for direction, decoder in self._sides.items():
            before = dict(decoder.errors)
            yield from self._items(decoder, before, decoder.idle(), direction)

    def _items(
        self,
        decoder: xbee.Decoder,
        before: dict[xbee.XBeeError, int],
        frames: list[xbee.ApiFrame],
        direction: str,
    ) -> Iterator[Item]:
        time_s, offset = self._last.get(direction, (None, 0))
        for kind, count in decoder.errors.items():
            for _ in range(count - before[kind]):
                self._tally.frames += kind is not xbee.XBeeError.NOISE
                self._tally.crc_errors += kind is xbee.XBeeError.CHECKSUM
                yield Item(What.ERROR, kind.value, time_s, direction, offset, _XBEE_WORDS[kind])
        for frame in frames:
            self._tally.frames += 1
            told = {
                name: value.hex(" ") if isinstance(value, bytes) else value
                for name, value in values(frame).items()
            }
            if isinstance(frame, xbee.AtCommand | xbee.AtCommandQueued | xbee.AtResponse):
                told["command"] = frame.command.decode("ascii", "replace")
            control = isinstance(frame, xbee.TxStatus | xbee.ModemStatus)
            what = What.CONTROL if control else What.MESSAGE
            yield Item(what, type(frame).__name__, time_s, direction, offset, "", told)


_XBEE_BLOCK: Final = 16
_XBEE_WORDS: Final = {
    xbee.XBeeError.NOISE: "octets between frames",
    xbee.XBeeError.LENGTH: "no frame has that length",
    xbee.XBeeError.CHECKSUM: "wrong checksum",
    xbee.XBeeError.CUT: "ended before its length says",
    xbee.XBeeError.LAYOUT: "its fields do not fit its type",
}
