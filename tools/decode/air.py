"""Frames of IEEE 802.15.4, whole ones: of a packet capture, or one to a line or chunk."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from radio_802154 import mac, tinyos
from radio_802154.errors import RadioError, UnsupportedFrameError
from radio_802154.fcs import FCS_OCTETS, fcs_ok
from radio_802154.timing import MAX_PSDU_OCTETS
from tools.decode.framing import Numbers
from tools.decode.items import Item, Octets, Tally, What
from tools.decode.mote import active_message

MOST_SENDERS: Final = 4096
"""Senders whose numbers are followed; the rest of a larger network are not."""


class _Sender:
    def __init__(self) -> None:
        self.numbers = Numbers()
        self.last = b""


class MacFrames:
    """MAC frames, active messages in them, acknowledgements, repetitions and missing numbers."""

    def __init__(self, tally: Tally) -> None:
        self._tally = tally
        self._senders: dict[mac.Address, _Sender] = {}

    def feed(self, octets: Octets) -> Iterator[Item]:
        """Yield what a frame says."""
        self._tally.frames += 1
        place = (octets.time_s, octets.direction, octets.offset)
        data = octets.data
        if len(data) > MAX_PSDU_OCTETS:
            text = f"{len(data)} octets: a frame has at most {MAX_PSDU_OCTETS}"
            yield Item(What.ERROR, "length", *place, text)
            return
        if octets.has_fcs:
            if not fcs_ok(data):
                self._tally.crc_errors += 1
                yield Item(What.ERROR, "crc", *place, f"wrong FCS: {len(data)} octets")
                return
            data = data[:-FCS_OCTETS]
        try:
            frame = mac.decode(data)
        except UnsupportedFrameError as error:
            yield Item(What.CONTROL, "not read", *place, str(error))
            return
        except RadioError as error:
            yield Item(What.ERROR, "malformed", *place, str(error))
            return
        yield from self._frame(frame, data, place, octets.note)

    def finish(self) -> Iterator[Item]:
        """Count the numbers that never came."""
        for sender in self._senders.values():
            self._tally.lost += sender.numbers.lost + sender.numbers.missing
        yield from ()

    def _frame(
        self, frame: mac.Frame, data: bytes, place: tuple[float | None, str, int], note: str
    ) -> Iterator[Item]:
        header: dict[str, Any] = {"sequence": frame.sequence}
        if frame.frame_type is mac.FrameType.ACK:
            text = f"of number {frame.sequence}"
            yield Item(What.CONTROL, "ack", *place, _joined(text, note), header=header)
            return
        again = False
        source = frame.source
        if source is not None and frame.frame_type is not mac.FrameType.BEACON:
            sender = self._senders.get(source)
            if sender is None and len(self._senders) < MOST_SENDERS:
                sender = self._senders[source] = _Sender()
            if sender is not None:
                again = sender.last == data
                sender.last = data
                gap = 0 if again else sender.numbers.heard(frame.sequence)
                if gap:
                    words = f"{gap} of {_address(source)} before number {frame.sequence}"
                    yield Item(What.GAP, "numbers missing", *place, words, {"missing": gap})
        way = f"{_address(source)} to {_address(frame.destination)} number {frame.sequence}"
        text = _joined(way, note)
        name, values = _content(frame)
        if frame.frame_type is mac.FrameType.DATA:
            what = What.AGAIN if again else What.MESSAGE
            yield Item(what, name, *place, text, values, header)
        else:
            yield Item(What.CONTROL, name, *place, text, values, header)


def _content(frame: mac.Frame) -> tuple[str, dict[str, Any]]:
    if frame.frame_type is mac.FrameType.DATA:
        try:
            packet = tinyos.from_frame(frame)
        except RadioError:
            return "data", {"data": frame.payload.hex(" ")}
        return active_message(packet.am_type, packet.payload)
    if frame.frame_type is mac.FrameType.COMMAND:
        command = frame.command
        name = f"command {command}"
        if isinstance(command, mac.CommandId):
            name = command.name.lower().replace("_", " ")
        return name, {"data": frame.payload[1:].hex(" ")}
    return "beacon", {"data": frame.payload.hex(" ")}


def _address(address: mac.Address | None) -> str:
    if address is None:
        return "coordinator"
    digits = 2 * mac.ADDRESS_OCTETS[address.mode]
    return "all" if address.is_broadcast else f"0x{address.value:0{digits}x}"


def _joined(text: str, note: str) -> str:
    return f"{text} ({note})" if note else text
