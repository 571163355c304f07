"""Both ends of the TinyOS serial protocol: stop-and-wait one way, best effort the other.

A host sends each packet with type 0x44 and waits for its acknowledgement before the next; a mote
sends with 0x45 and forgets. Both are this one state machine with a different `SerialConfig`, since
either end must understand all that the other may send. It is sans-IO, like the boards' link: the
caller brings octets and the time in microseconds.

The BaseStation application acknowledges a packet only once it is queued for the radio. `room` is
that queue: with 0 left a packet is neither delivered nor acknowledged, and comes again.

A packet whose acknowledgement was lost comes again with the same number and the same octets and is
acknowledged, not delivered. Only within `duplicate_us`, though: TinyOS's C tools begin each run
with the same number, and a command that a user gives twice is two commands.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

from radio_802154.errors import LocalFrameError
from radio_802154.tinyos_serial import (
    AM_DISPATCH,
    AmMessage,
    Decoder,
    PacketType,
    SerialPacket,
    encode,
    encode_am,
)


@dataclass(frozen=True, slots=True)
class SerialConfig:
    """How an end of the line sends.

    Raises:
        ValueError: a time or count out of its range.

    """

    acknowledged: bool
    """Stop-and-wait (host), or best effort (mote)."""
    retransmit_us: int = 200_000
    """Until a packet is sent again (assumed): the longest frame and its acknowledgement take 25 ms
    at 115 200 baud, the rest is the mote's."""
    attempts: int = 25
    """Transmissions of a packet before it is given up (assumed): 5 s."""
    duplicate_us: int = 1_000_000
    """How long the same number and octets are the same packet (assumed)."""
    queue_limit: int = 64
    """Most packets waiting."""

    def __post_init__(self) -> None:
        if not 0 < self.retransmit_us < self.duplicate_us:
            raise ValueError(
                f"not 0 < retransmit_us ({self.retransmit_us}) < duplicate_us "
                f"({self.duplicate_us}): a packet sent again would be taken for a new one"
            )
        if self.attempts < 1 or self.queue_limit < 1:
            raise ValueError("attempts and queue_limit are at least 1")


HOST: Final = SerialConfig(acknowledged=True)
MOTE: Final = SerialConfig(acknowledged=False)


@dataclass(frozen=True, slots=True)
class PacketReceived:
    """A packet of the other end, each once."""

    packet: SerialPacket


@dataclass(frozen=True, slots=True)
class PacketAcknowledged:
    """The other end has taken the packet; `token` is what `send` returned."""

    token: int


@dataclass(frozen=True, slots=True)
class PacketGivenUp:
    """No acknowledgement after all attempts. The other end may have taken it nevertheless."""

    token: int


@dataclass(frozen=True, slots=True)
class OctetsDiscarded:
    """Damaged frames, as many within one `receive`."""

    count: int


Event = PacketReceived | PacketAcknowledged | PacketGivenUp | OctetsDiscarded


@dataclass(slots=True)
class SerialStatistics:
    """Counters since the link began."""

    sent: int = 0
    """Packets accepted by `send`."""
    acknowledged: int = 0
    given_up: int = 0
    retransmissions: int = 0
    received: int = 0
    """Packets delivered."""
    duplicates: int = 0
    refused: int = 0
    """Packets not taken because there was no room."""
    stray_acks: int = 0
    """Acknowledgements of a packet that is not on its way."""
    damaged: int = 0


class SerialLink:
    """One end of a serial line.

    Attributes:
        room: packets to be acknowledged that the application takes; None: any number. Counts down
            with every one delivered; the application raises it again.
        statistics: counters.
        decoder: of what arrives; counts damage by kind.

    """

    def __init__(self, config: SerialConfig, first_sequence: int = 0) -> None:
        self.config = config
        self.room: int | None = None
        self.statistics = SerialStatistics()
        self.decoder = Decoder()
        self._sequence = first_sequence & 0xFF
        self._token = 0
        self._queue: deque[tuple[int, SerialPacket]] = deque()
        self._attempts = 0  # of the first in the queue
        self._deadline_us: int | None = None
        self._acks: deque[int] = deque()
        self._out = b""
        self._last: tuple[int, SerialPacket] | None = None  # when, and what, was delivered

    @property
    def queued(self) -> int:
        """Packets not sent, or not acknowledged."""
        return len(self._queue)

    def send(self, body: bytes, dispatch: int = AM_DISPATCH) -> int:
        """Queue a packet; return its token.

        Raises:
            LocalFrameError: the body does not fit a frame, or the queue is full.

        """
        if len(self._queue) >= self.config.queue_limit:
            raise LocalFrameError(f"{len(self._queue)} packets wait already: try again later")
        reliable = self.config.acknowledged
        kind = PacketType.DATA_ACK if reliable else PacketType.DATA
        packet = SerialPacket(kind, self._sequence if reliable else None, dispatch, body)
        encode(packet)  # refused now rather than later
        if reliable:
            self._sequence = (self._sequence + 1) & 0xFF
        self._token += 1
        self._queue.append((self._token, packet))
        self.statistics.sent += 1
        return self._token

    def send_am(self, message: AmMessage) -> int:
        """Queue an active message; return its token.

        Raises:
            LocalFrameError: a field does not fit, or the queue is full.

        """
        return self.send(encode_am(message))

    def receive(self, data: bytes, now_us: int) -> list[Event]:
        """Take octets that arrived; return what they mean."""
        before = self.decoder.error_count
        events: list[Event] = []
        for packet in self.decoder.receive(data):
            if packet.kind is PacketType.ACK:
                self._acknowledged(packet, events)
            elif packet.kind is PacketType.DATA or self._take(packet, now_us):
                self.statistics.received += 1
                events.append(PacketReceived(packet))
        damaged = self.decoder.error_count - before
        if damaged:
            self.statistics.damaged += damaged
            events.append(OctetsDiscarded(damaged))
        return events

    def _acknowledged(self, ack: SerialPacket, events: list[Event]) -> None:
        if self._attempts and self._queue[0][1].sequence == ack.sequence:
            token, _ = self._queue.popleft()
            self._attempts = 0
            self._deadline_us = None
            self.statistics.acknowledged += 1
            events.append(PacketAcknowledged(token))
        else:
            self.statistics.stray_acks += 1

    def _take(self, packet: SerialPacket, now_us: int) -> bool:
        """Whether a packet that wants an acknowledgement is delivered; it is answered here."""
        sequence = packet.sequence or 0
        last = self._last
        if last is not None and last[1] == packet and now_us - last[0] < self.config.duplicate_us:
            self.statistics.duplicates += 1
            self._last = (now_us, packet)
            self._acks.append(sequence)
            return False
        if self.room is not None:
            if self.room <= 0:
                self.statistics.refused += 1
                return False
            self.room -= 1
        self._last = (now_us, packet)
        self._acks.append(sequence)
        return True

    @property
    def wants_to_send(self) -> bool:
        """Whether `data_to_send` has octets now."""
        return bool(self._out or self._acks or (self._queue and not self._attempts))

    def data_to_send(self, now_us: int, limit: int | None = None) -> bytes:
        """Return octets for the line, at most `limit`; what was cut comes with the next call."""
        parts = [self._out]
        while self._acks:
            parts.append(encode(SerialPacket(PacketType.ACK, self._acks.popleft())))
        if self.config.acknowledged:
            if self._queue and not self._attempts:
                parts.append(self._transmit(now_us))
        else:
            while self._queue:
                parts.append(encode(self._queue.popleft()[1]))
        data = b"".join(parts)
        cut = len(data) if limit is None else limit
        self._out = data[cut:]
        return data[:cut]

    def _transmit(self, now_us: int) -> bytes:
        self._attempts += 1
        self._deadline_us = now_us + self.config.retransmit_us
        return encode(self._queue[0][1])

    def next_deadline_us(self) -> int | None:
        """Return when `handle_timer` is to be called, or None."""
        return self._deadline_us

    def handle_timer(self, now_us: int) -> list[Event]:
        """Send again, or give up, what was not acknowledged in time."""
        if self._deadline_us is None or now_us < self._deadline_us:
            return []
        if self._attempts >= self.config.attempts:
            token, _ = self._queue.popleft()
            self._attempts = 0
            self._deadline_us = None
            self.statistics.given_up += 1
            return [PacketGivenUp(token)]
        self.statistics.retransmissions += 1
        self._out += self._transmit(now_us)
        return []
