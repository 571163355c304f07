"""ISO-TP (ISO 15765-2:2016): payloads longer than a CAN frame, with flow control. Sans-IO.

Frames' data fields and the time (integer microseconds) come in, events and data fields go out; no
bus, no thread, no clock, so that every time-out of the standard can be tested without waiting for
it. That is why this is not the can-isotp package, which reads its own clock and sends from its own
thread: it serves as an oracle in the tests instead. Normal addressing only: one identifier each
way, the whole data field is ours.

    single frame       0L data…                    L = 1 to 7; 00 LL data… where a frame has over 8
    first frame        1L LL data…                 12-bit length; 10 00 LLLLLLLL data… above 4095
    consecutive frame  2N data…                    N counts 1, 2, … 15, 0, 1 …
    flow control       3S BS STmin                 S: 0 continue, 1 wait, 2 overflow

Both directions are independent. One payload is sent at a time; the next may be given when
`sending` is false. A payload that fails, either way, is gone: ISO-TP repeats nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

__all__ = [
    "CAN_LENGTHS",
    "IsoTp",
    "IsoTpConfig",
    "Payload",
    "ReceiveFailed",
    "Result",
    "SendFailed",
    "Sent",
    "separation_us",
]

CAN_LENGTHS: Final = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
"""Lengths that a CAN FD data field can have (ISO 11898-1); classic CAN has the first nine."""
_CLASSIC: Final = 8
_SHORT_LENGTH: Final = 0xFFF
_SINGLE, _FIRST, _CONSECUTIVE, _FLOW = range(4)
_CONTINUE, _WAIT, _OVERFLOW = range(3)


class Result(StrEnum):
    """Why a transfer failed: the standard's N_Result, clause 8.3.7."""

    TIMEOUT_BS = "N_TIMEOUT_Bs"
    """No flow control came."""
    TIMEOUT_CR = "N_TIMEOUT_Cr"
    """No consecutive frame came."""
    WRONG_SN = "N_WRONG_SN"
    """A consecutive frame is missing, repeated or out of order."""
    INVALID_FS = "N_INVALID_FS"
    """A flow status that does not exist."""
    UNEXPECTED = "N_UNEXP_PDU"
    """A new payload began before the last had ended."""
    WFT_OVERRUN = "N_WFT_OVRN"
    """The receiver said "wait" too often."""
    OVERFLOW = "N_BUFFER_OVFLW"
    """The payload is longer than the receiver takes."""
    ERROR = "N_ERROR"
    """A data field that is no frame of the standard."""


@dataclass(frozen=True, slots=True)
class Payload:
    """A payload arrived whole."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Sent:
    """The last frame of our payload was handed out, under the receiver's flow control."""


@dataclass(frozen=True, slots=True)
class SendFailed:
    """Our payload was given up."""

    result: Result


@dataclass(frozen=True, slots=True)
class ReceiveFailed:
    """A payload that had begun to arrive was given up, or a stray frame was ignored."""

    result: Result


Event = Payload | Sent | SendFailed | ReceiveFailed


@dataclass(frozen=True, slots=True)
class IsoTpConfig:
    """Sizes and times of one end.

    Raises:
        ValueError: one out of its range.

    """

    frame_bytes: int = _CLASSIC
    """Longest data field that we send (TX_DL): 8, or up to 64 with CAN FD."""
    block_size: int = 0
    """Consecutive frames that we take between two flow controls; 0: all."""
    separation_us: int = 0
    """Least time between consecutive frames that we ask for: 0, 100…900, or whole milliseconds."""
    padding: int | None = 0xCC
    """Fills short frames (the standard's value: fewest stuff bits); None sends them short."""
    flow_timeout_us: int = 1_000_000
    """N_Bs: longest wait for flow control (table 16)."""
    frame_timeout_us: int = 1_000_000
    """N_Cr: longest wait for a consecutive frame (table 16)."""
    waits: int = 10
    """N_WFTmax as the sender sees it: flow controls in a row that may say "wait"."""
    receive_limit: int = 4095
    """Longest payload that we take; a longer one is answered with "overflow"."""

    def __post_init__(self) -> None:
        if self.frame_bytes not in CAN_LENGTHS[8:]:
            raise ValueError(f"frame_bytes = {self.frame_bytes}: CAN has {CAN_LENGTHS[8:]}")
        if not 0 <= self.block_size <= 255:
            raise ValueError(f"block_size = {self.block_size} is outside 0 to 255")
        if self.padding is not None and not 0 <= self.padding <= 255:
            raise ValueError(f"padding = {self.padding} is no byte")
        _encode_separation(self.separation_us)


def separation_us(code: int) -> int:
    """Return the time of an STmin byte; reserved ones mean the longest (clause 9.6.5.5)."""
    if code <= 0x7F:
        return code * 1_000
    if 0xF1 <= code <= 0xF9:
        return (code - 0xF0) * 100
    return 127_000


def _encode_separation(time_us: int) -> int:
    if 0 < time_us < 1_000 and time_us % 100 == 0:
        return 0xF0 + time_us // 100
    if 0 <= time_us <= 127_000 and time_us % 1_000 == 0:
        return time_us // 1_000
    raise ValueError(f"a separation of {time_us} µs has no STmin: 0, 100…900 µs, or 1…127 ms")


class IsoTp:
    """Both directions of one pair of CAN identifiers."""

    def __init__(self, config: IsoTpConfig | None = None) -> None:
        self.config = config or IsoTpConfig()
        self._flow: list[bytes] = []  # flow controls to send, before anything else

        self._payload: bytes | None = None  # being sent
        self._begun = False
        self._position = 0
        self._number = 0
        self._allowed: int | None = 0  # consecutive frames until the next flow control; None: all
        self._awaits_flow = False
        self._waited = 0
        self._flow_deadline_us = 0
        self._gap_us = 0
        self._next_us = 0  # when the next consecutive frame may go

        self._receiving: bytearray | None = None
        self._length = 0
        self._expected = 0
        self._data_length = 0  # RX_DL: what the first frame's data field had
        self._block_left = 0
        self._frame_deadline_us = 0

    @property
    def sending(self) -> bool:
        """Whether a payload is under way; another may be given only when not."""
        return self._payload is not None

    def single_limit(self) -> int:
        """Longest payload that goes into a single frame."""
        size = self.config.frame_bytes
        return size - 1 if size == _CLASSIC else size - 2

    def send(self, payload: bytes) -> None:
        """Begin to send a payload of 1 to 2³² − 1 bytes.

        Raises:
            ValueError: empty, or another is under way.

        """
        if not payload:
            raise ValueError("an empty payload has no frame")
        if self._payload is not None:
            raise ValueError("a payload is under way: wait for Sent or SendFailed")
        self._payload = bytes(payload)
        self._begun = False

    def next_deadline_us(self) -> int | None:
        """Return when `handle_timer` or `next_frame` has something to do."""
        deadlines = []
        if self._receiving is not None:
            deadlines.append(self._frame_deadline_us)
        if self._payload is not None and self._begun:
            deadlines.append(self._flow_deadline_us if self._awaits_flow else self._next_us)
        return min(deadlines, default=None)

    def handle_timer(self, now_us: int) -> list[Event]:
        """Give up what has timed out."""
        events: list[Event] = []
        if self._receiving is not None and now_us >= self._frame_deadline_us:
            self._receiving = None
            events.append(ReceiveFailed(Result.TIMEOUT_CR))
        if self._payload is not None and self._awaits_flow and now_us >= self._flow_deadline_us:
            events.append(self._give_up(Result.TIMEOUT_BS))
        return events

    def next_frame(self, now_us: int) -> tuple[bytes, list[Event]]:
        """Return the data field to send now (b"" for none), and `Sent` with the last one."""
        if self._flow:
            return self._flow.pop(0), []
        payload = self._payload
        if payload is None:
            return b"", []
        if not self._begun:
            return self._begin(payload, now_us)
        if self._awaits_flow or now_us < self._next_us:
            return b"", []
        size = self.config.frame_bytes - 1
        piece = payload[self._position : self._position + size]
        frame = self._padded(bytes((_CONSECUTIVE << 4 | self._number,)) + piece)
        self._position += len(piece)
        self._number = (self._number + 1) & 0xF
        self._next_us = now_us + self._gap_us
        if self._position >= len(payload):
            self._payload = None
            return frame, [Sent()]
        if self._allowed is not None:
            self._allowed -= 1
            if not self._allowed:
                self._await_flow(now_us)
        return frame, []

    def receive(self, data: bytes, now_us: int) -> list[Event]:
        """Return what a received data field means; none of them raises."""
        if not data:
            return [ReceiveFailed(Result.ERROR)]
        kind = data[0] >> 4
        if kind == _SINGLE:
            return self._receive_single(data)
        if kind == _FIRST:
            return self._receive_first(data, now_us)
        if kind == _CONSECUTIVE:
            return self._receive_consecutive(data, now_us)
        if kind == _FLOW:
            return self._receive_flow(data, now_us)
        return [ReceiveFailed(Result.ERROR)]

    # Sending.

    def _begin(self, payload: bytes, now_us: int) -> tuple[bytes, list[Event]]:
        size, length = self.config.frame_bytes, len(payload)
        if length < _CLASSIC:
            self._payload = None
            return self._padded(bytes((length,)) + payload), [Sent()]
        if length <= self.single_limit():
            self._payload = None
            return self._padded(bytes((0, length)) + payload), [Sent()]
        if length <= _SHORT_LENGTH:
            header = (_FIRST << 12 | length).to_bytes(2, "big")
        else:
            header = (_FIRST << 44 | length).to_bytes(6, "big")
        self._begun = True
        self._position = size - len(header)
        self._number = 1
        self._waited = 0
        self._next_us = now_us
        self._await_flow(now_us)
        return header + payload[: self._position], []

    def _await_flow(self, now_us: int) -> None:
        self._awaits_flow = True
        self._flow_deadline_us = now_us + self.config.flow_timeout_us

    def _give_up(self, result: Result) -> SendFailed:
        self._payload = None
        self._awaits_flow = False
        return SendFailed(result)

    def _padded(self, frame: bytes) -> bytes:
        padding, length = self.config.padding, len(frame)
        if length > _CLASSIC or padding is not None:
            target = next(size for size in CAN_LENGTHS[8:] if size >= length)
            fill = 0xCC if padding is None else padding  # FD's longer lengths come in steps
            frame += bytes((fill,)) * (target - length)
        return frame

    def _receive_flow(self, data: bytes, now_us: int) -> list[Event]:
        if self._payload is None or not self._awaits_flow:
            return []  # clause 9.8.3: flow control that nobody waits for is ignored
        if len(data) < 3:
            return [self._give_up(Result.ERROR)]
        status, block, code = data[0] & 0xF, data[1], data[2]
        if status == _CONTINUE:
            self._awaits_flow = False
            self._waited = 0
            self._allowed = block or None
            self._gap_us = separation_us(code)
            self._next_us = max(self._next_us, now_us)
            return []
        if status == _WAIT:
            self._waited += 1
            if self._waited > self.config.waits:
                return [self._give_up(Result.WFT_OVERRUN)]
            self._await_flow(now_us)
            return []
        return [self._give_up(Result.OVERFLOW if status == _OVERFLOW else Result.INVALID_FS)]

    # Receiving.

    def _receive_single(self, data: bytes) -> list[Event]:
        start, length = 1, data[0] & 0xF
        if len(data) > _CLASSIC:
            start, length = (2, data[1]) if not length else (1, 0)  # over 8: the second form only
        if not 0 < length <= len(data) - start or (start == 2 and length < _CLASSIC - 1):
            return [ReceiveFailed(Result.ERROR)]
        events: list[Event] = []
        if self._receiving is not None:
            self._receiving = None
            events.append(ReceiveFailed(Result.UNEXPECTED))
        events.append(Payload(data[start : start + length]))
        return events

    def _receive_first(self, data: bytes, now_us: int) -> list[Event]:
        if len(data) < _CLASSIC:
            return [ReceiveFailed(Result.ERROR)]
        start, length = 2, (data[0] & 0xF) << 8 | data[1]
        if not length:
            start, length = 6, int.from_bytes(data[2:6], "big")
            if length <= _SHORT_LENGTH:
                return [ReceiveFailed(Result.ERROR)]
        # FF_DLmin, table 14: what a single frame could have carried is no first frame.
        if length < (_CLASSIC if len(data) == _CLASSIC else len(data) - 1):
            return [ReceiveFailed(Result.ERROR)]
        events: list[Event] = []
        if self._receiving is not None:
            self._receiving = None
            events.append(ReceiveFailed(Result.UNEXPECTED))
        if length > self.config.receive_limit:
            self._flow.append(self._padded(bytes((_FLOW << 4 | _OVERFLOW, 0, 0))))
            return [*events, ReceiveFailed(Result.OVERFLOW)]
        self._receiving = bytearray(data[start:])
        self._length = length
        self._data_length = len(data)
        self._expected = 1
        self._take_block(now_us)
        return events

    def _take_block(self, now_us: int) -> None:
        config = self.config
        code = _encode_separation(config.separation_us)
        self._flow.append(self._padded(bytes((_FLOW << 4, config.block_size, code))))
        self._block_left = config.block_size
        self._frame_deadline_us = now_us + config.frame_timeout_us

    def _receive_consecutive(self, data: bytes, now_us: int) -> list[Event]:
        received = self._receiving
        if received is None:
            return []  # clause 9.8.3: ignored
        if data[0] & 0xF != self._expected:
            self._receiving = None
            return [ReceiveFailed(Result.WRONG_SN)]
        missing = self._length - len(received)
        if len(data) - 1 < min(missing, self._data_length - 1):
            return []  # shorter than what it must carry: ignored, clause 9.6.4; N_Cr will see to it
        received += data[1 : 1 + missing]
        if len(received) >= self._length:
            self._receiving = None
            return [Payload(bytes(received))]
        self._expected = (self._expected + 1) & 0xF
        self._frame_deadline_us = now_us + self.config.frame_timeout_us
        if self.config.block_size:
            self._block_left -= 1
            if not self._block_left:
                self._take_block(now_us)
        return []
