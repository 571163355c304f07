"""Emulated radio to a TinyOS mote and back: what is carried, what is not, and why; sans-IO.

Outwards: a data frame of an emulated node that holds an active message becomes a serial packet,
stop-and-wait (`serial_link.py`). MAC acknowledgements are not carried, since the mote's answer
would come milliseconds too late; the bridge acknowledges in the place of a node that is not
emulated, and only a frame that it has put into its queue, exactly as that node's radio would. A
full queue stays silent: the sender's retries are the back-pressure. A retry of a frame that was
taken is acknowledged again and not carried again.

Inwards: a packet from the mote becomes a frame with the source and destination it names and a
sequence number of the bridge's, because the serial protocol carries none. Only what an emulated
node could accept goes on the emulated air, and nothing whose source is an emulated node: that is
our own voice, or a mote with the same address. Neither way is anything carried twice across, so
there is no loop.

Every frame and packet is counted once, in `BridgeStatistics`, where it ended.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from radio_802154 import mac, tinyos
from radio_802154.errors import RadioError
from radio_802154.serial_link import (
    HOST,
    Event,
    PacketAcknowledged,
    PacketGivenUp,
    PacketReceived,
    SerialConfig,
    SerialLink,
)
from radio_802154.tinyos import AmPacket
from radio_802154.tinyos_serial import AM_DISPATCH, AmMessage, SerialPacket, decode_am

REPEAT_US: Final = 1_000_000
"""How long the same source, number and contents are a MAC retry: four attempts with the longest
back-offs take 0.16 s (802.15.4-2006, 7.5.1.4)."""
REMEMBERED: Final = 16
"""Frames among which a retry is looked for; a radio finishes one before it begins the next."""
GROUP_MASK: Final = 0xFF
"""The serial header's group has 8 bits: of a PAN id the low octet."""


class Dropped(StrEnum):
    """Why a frame or packet was not carried."""

    # of the emulated air, towards the mote
    NOT_AM = "no active message"
    OTHER_PAN = "another PAN"
    NOT_OURS = "not from an emulated node"
    TOO_LONG = "longer than the mote's buffers"
    QUEUE_FULL = "queue full"
    GIVEN_UP = "not acknowledged by the mote"
    # of the mote, towards the emulated air
    DISPATCH = "no active message of the serial line"
    OTHER_GROUP = "another group"
    OWN_SOURCE = "from the address of an emulated node"
    ELSEWHERE = "for no emulated node"
    AIR_QUEUE_FULL = "queue to the emulated air full"
    CHANNEL_BUSY = "emulated channel busy"
    NOT_RECEIVED = "not acknowledged by the emulated node"


@dataclass(frozen=True, slots=True)
class BridgeConfig:
    """Who is emulated, and what the mote can take.

    Attributes:
        addresses: short addresses of the emulated nodes.
        pan_id: their PAN; its low octet is the group on the serial line.
        longest_payload: TOSH_DATA_LENGTH with which the mote was built [octets].
        queue_limit: frames that wait for the serial line. The line does 11 520 octets/s: 32 frames
            of 28 octets payload and their acknowledgements are 0.13 s.

    """

    addresses: frozenset[int]
    pan_id: int = tinyos.DEFAULT_PAN_ID
    longest_payload: int = 28
    queue_limit: int = 32
    serial: SerialConfig = HOST


@dataclass(slots=True)
class BridgeStatistics:
    """Counters since the run began; `SerialLink.statistics` has the line's own."""

    heard: int = 0
    """Data frames with a right FCS of the emulated air, retries included."""
    taken: int = 0
    """Of those, queued for the mote, each once."""
    repeated: int = 0
    """Of those, retries of a frame that had been taken."""
    acknowledged: int = 0
    """Of those taken, acknowledged by the mote: queued for its radio."""
    packets: int = 0
    """Intact packets of the mote."""
    admitted: int = 0
    """Of those, queued for the emulated air."""
    delivered: int = 0
    """Of those, acknowledged by the emulated node, or broadcast."""
    outward: Counter[Dropped] = field(default_factory=Counter)
    inward: Counter[Dropped] = field(default_factory=Counter)


@dataclass(frozen=True, slots=True)
class _Waiting:
    heard_us: int
    sent_us: int | None = None


class MoteBridge:
    """One mote's bridge. Times are microseconds of any one clock.

    Attributes:
        on_acknowledged: called for each packet that the mote has acknowledged with the time since
            its frame ended, and since it was handed to the line where it was sent only once (of
            one that was sent again nobody knows which one is acknowledged), in µs.

    """

    def __init__(self, config: BridgeConfig, first_sequence: int = 0) -> None:
        self.config = config
        self.statistics = BridgeStatistics()
        self.link = SerialLink(config.serial, first_sequence)
        self.on_acknowledged: Callable[[int, int | None], None] = lambda waited, trip: None
        self._seen: deque[tuple[int, bytes]] = deque(maxlen=REMEMBERED)
        self._waiting: dict[int, _Waiting] = {}
        self._resent = False  # the packet at the head of the queue
        self._sequence = first_sequence & 0xFF

    # --- from the emulated air ------------------------------------------------------------------

    def heard(self, octets: bytes, now_us: int) -> bool:
        """Take a frame (MAC header and payload) at its end; return whether to acknowledge it.

        Acknowledgements and beacons are nobody's message and pass without being counted.
        """
        try:
            frame = mac.decode(octets)
        except RadioError:
            self.statistics.heard += 1
            self.statistics.outward[Dropped.NOT_AM] += 1
            return False
        if frame.frame_type in (mac.FrameType.ACK, mac.FrameType.BEACON):
            return False
        self.statistics.heard += 1
        try:
            packet = tinyos.from_frame(frame)
        except RadioError:
            return self._drop(Dropped.NOT_AM)
        config = self.config
        if packet.pan_id != config.pan_id:
            return self._drop(Dropped.OTHER_PAN)
        if packet.source not in config.addresses:
            return self._drop(Dropped.NOT_OURS)
        if len(packet.payload) > config.longest_payload:
            return self._drop(Dropped.TOO_LONG)
        # A node that is emulated answers for itself; nobody answers a broadcast.
        answer = packet.ack_request and packet.destination not in config.addresses
        if any(octets == seen and now_us - at < REPEAT_US for at, seen in self._seen):
            self.statistics.repeated += 1
            return answer
        if self.link.queued >= min(config.queue_limit, config.serial.queue_limit):
            return self._drop(Dropped.QUEUE_FULL)
        token = self.link.send_am(
            AmMessage(
                packet.destination,
                packet.am_type,
                packet.payload,
                packet.source,
                packet.pan_id & GROUP_MASK,
            )
        )
        self._seen.append((now_us, octets))
        self._waiting[token] = _Waiting(now_us)
        self.statistics.taken += 1
        return answer

    def _drop(self, reason: Dropped) -> bool:
        self.statistics.outward[reason] += 1
        return False

    # --- the serial line ------------------------------------------------------------------------

    @property
    def wants_to_send(self) -> bool:
        """Whether `data_to_send` has octets now."""
        return self.link.wants_to_send

    def data_to_send(self, now_us: int) -> bytes:
        """Return octets for the line; the whole of them is the caller's from now on."""
        data = self.link.data_to_send(now_us)
        if data and self._waiting:
            token = next(iter(self._waiting))  # stop-and-wait: only the oldest is on its way
            if self._waiting[token].sent_us is None:
                self._waiting[token] = _Waiting(self._waiting[token].heard_us, now_us)
                self._resent = False
        return data

    def next_deadline_us(self) -> int | None:
        """Return when `handle_timer` is to be called, or None."""
        return self.link.next_deadline_us()

    def handle_timer(self, now_us: int) -> None:
        """Send again, or give up, what the mote has not acknowledged in time."""
        again = self.link.statistics.retransmissions
        self._events(self.link.handle_timer(now_us), now_us)
        self._resent |= self.link.statistics.retransmissions != again

    def receive(self, data: bytes, now_us: int) -> list[AmPacket]:
        """Take octets of the line; return active messages for the emulated air, numbered."""
        return self._events(self.link.receive(data, now_us), now_us)

    def reopened(self) -> None:
        """Forget the half of a packet that went with the line that was lost."""
        self.link.decoder.reset()

    def _events(self, events: list[Event], now_us: int) -> list[AmPacket]:
        admitted = []
        for event in events:
            if isinstance(event, PacketAcknowledged):
                waited = self._waiting.pop(event.token)
                self.statistics.acknowledged += 1
                sent_us = waited.sent_us
                once = sent_us is not None and not self._resent
                trip_us = now_us - sent_us if sent_us is not None and once else None
                self.on_acknowledged(now_us - waited.heard_us, trip_us)
            elif isinstance(event, PacketGivenUp):
                del self._waiting[event.token]
                self.statistics.outward[Dropped.GIVEN_UP] += 1
            elif isinstance(event, PacketReceived):
                self.statistics.packets += 1
                packet = self._inward(event.packet)
                if packet is not None:
                    admitted.append(packet)
        return admitted

    def _inward(self, packet: SerialPacket) -> AmPacket | None:
        """Return what goes on the emulated air; None and a count where it does not."""
        config, inward = self.config, self.statistics.inward
        try:
            message = decode_am(packet.body) if packet.dispatch == AM_DISPATCH else None
        except RadioError:
            message = None
        if message is None or len(message.payload) > tinyos.MAX_PAYLOAD_OCTETS:
            inward[Dropped.DISPATCH] += 1
        elif message.group != config.pan_id & GROUP_MASK:
            inward[Dropped.OTHER_GROUP] += 1
        elif message.source in config.addresses:
            inward[Dropped.OWN_SOURCE] += 1
        elif message.destination not in config.addresses | {tinyos.AM_BROADCAST}:
            inward[Dropped.ELSEWHERE] += 1
        else:
            self.statistics.admitted += 1
            self._sequence = (self._sequence + 1) & 0xFF
            return AmPacket(
                message.destination,
                message.source,
                message.am_type,
                message.payload,
                self._sequence,
                config.pan_id,
            )
        return None

    # --- to the emulated air --------------------------------------------------------------------

    def sent(self, failure: Dropped | None) -> None:
        """Hear what became of an admitted message: None, delivered."""
        if failure is None:
            self.statistics.delivered += 1
        else:
            self.statistics.inward[failure] += 1
