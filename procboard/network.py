"""The network controller: active messages over unslotted CSMA-CA with acknowledgements.

Clauses are those of IEEE Std 802.15.4-2006. The chip recognises addresses, checks the FCS and
acknowledges; everything else of the MAC is here: back-off (7.5.1.4), acknowledgement wait and
retries (7.5.6.4.3), sequence numbers, and the suppression of what arrives twice because its
acknowledgement was lost. One task sends, one receives.

Times are alarms of the watch crystal, rounded up to its ticks of 30.5 µs.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Final, TypeAlias

from firmware_model.cpu import Flag
from firmware_model.msp430.mcu import Msp430F1611
from procboard.alarms import Alarms, ticks_of_us
from procboard.coroutines import Firmware
from procboard.drivers.cc2420 import Cc2420Driver, Stamp
from procboard.drivers.sfd_capture import SfdCapture, belongs
from procboard.errors import ProcConfigError
from radio_802154 import timing
from radio_802154.fcs import FCS_OCTETS
from radio_802154.tinyos import AM_BROADCAST, DEFAULT_PAN_ID, MAX_PAYLOAD_OCTETS, NALP_DISPATCH

UNIT_BACKOFF_US: Final = timing.UNIT_BACKOFF_SYMBOLS * timing.SYMBOL_US
TURNAROUND_US: Final = timing.TURNAROUND_SYMBOLS * timing.SYMBOL_US
ACK_WAIT_US: Final = timing.ACK_WAIT_SYMBOLS * timing.SYMBOL_US
READ_GRACE_US: Final = 1_500
"""How much longer to wait where, at the end of the wait, a frame stands in the RXFIFO unread: the
bus may be taken by a flash page, 1.1 ms."""
OFF_POLL_US: Final = 1_000
"""How often it is looked whether the radio can be switched off (our choice)."""
DUPLICATE_US: Final = 1_000_000
"""How long a sequence number is remembered: four attempts with the longest back-offs: 0.16 s."""
DUPLICATE_WINDOW: Final = 4
"""Sequence numbers remembered for each source."""

HEADER_OCTETS: Final = 11
_FCF_DATA: Final = 0x8841  # data, PAN compression, short addresses (TEP 125)
_FCF_ACK_REQUEST: Final = 0x0020
_ACK_OCTETS: Final = 3

SEND_CYCLES: Final = 250
"""Building a header and deciding, per attempt: about 80 instructions (estimate from TinyOS
CC2420CsmaP and CC2420TransmitP)."""
RECEIVE_CYCLES: Final = 300
"""Judging a received frame and its dispatch (estimate from TinyOS CC2420ReceiveP)."""
COPY_CYCLES_PER_OCTET: Final = 5

_FIFOP: Final = 0x01  # P1.0


class SendStatus(Enum):
    """What became of a message."""

    ACKNOWLEDGED = "acknowledged"
    SENT = "sent"
    """Gone out without asking for an acknowledgement."""
    NOT_ACKNOWLEDGED = "not acknowledged"
    CHANNEL_BUSY = "channel busy"


@dataclass(frozen=True, slots=True)
class NetworkConfig:
    """Address and parameters of the MAC; names and defaults of 802.15.4, Table 86."""

    address: int
    pan_id: int = DEFAULT_PAN_ID
    channel: int = 26
    pa_level: int = 31
    queue_limit: int = 8
    min_be: int = timing.MIN_BE
    max_be: int = timing.MAX_BE
    max_csma_backoffs: int = timing.MAX_CSMA_BACKOFFS
    max_frame_retries: int = timing.MAX_FRAME_RETRIES
    promiscuous: bool = False
    """Hear frames for every address and PAN, and acknowledge none: address recognition is off, and
    the chip's acknowledgements with it."""

    def __post_init__(self) -> None:
        if not 0 <= self.address < AM_BROADCAST:
            raise ProcConfigError(f"address {self.address:#x}: 0 to {AM_BROADCAST - 1:#x}")
        if not timing.FIRST_CHANNEL <= self.channel <= timing.LAST_CHANNEL:
            raise ProcConfigError(f"channel {self.channel}: 2.4 GHz has 11 to 26")
        if not 0 <= self.min_be <= self.max_be <= 8:
            raise ProcConfigError(f"back-off exponents {self.min_be}, {self.max_be}: 0 to 8")
        if not 0 <= self.pa_level <= 31 or self.queue_limit < 1:
            raise ProcConfigError("pa_level lies between 0 and 31, queue_limit is at least 1")


@dataclass(slots=True)
class NetworkStatistics:
    """Counted since the last boot."""

    queued: int = 0
    refused: int = 0
    """Messages that found the queue full."""
    transmissions: int = 0
    acknowledged: int = 0
    sent_unacknowledged: int = 0
    not_acknowledged: int = 0
    channel_busy: int = 0
    retries: int = 0
    backoffs: int = 0
    received: int = 0
    """Messages handed to handlers."""
    duplicates: int = 0
    bad_frames: int = 0
    """FCS wrong, no active message, or a handler's AM type unknown."""
    late_stamps: int = 0
    """Messages that were broken off because their time came too late into them."""


@dataclass(frozen=True, slots=True)
class Received:
    """An active message that came."""

    source: int
    destination: int
    am_type: int
    payload: bytes
    rssi_dbm: int
    sfd_ticks: int | None = None
    """Count of the alarms at its SFD, where the network takes stamps and this one is sure."""


@dataclass(frozen=True, slots=True)
class Sent:
    """What became of a message, and what it took."""

    status: SendStatus
    attempts: int
    """Transmissions of it; 0 where the channel was never clear."""


Done: TypeAlias = Callable[[Sent], None]
AmHandler: TypeAlias = Callable[[Received], Firmware[None]]


@dataclass(slots=True)
class _Outgoing:
    destination: int
    am_type: int
    payload: bytes
    done: Done | None
    reserved: bool
    stamp: Stamp | None


class RandomMlcg:
    """The multiplicative generator of TinyOS (RandomMlcgP): x ← 16807 x mod (2^31 − 1)."""

    __slots__ = ("_state",)

    def __init__(self, seed: int) -> None:
        self._state = seed % 0x7FFFFFFF or 1

    def below(self, limit: int) -> int:
        """Return a number from 0 to limit − 1."""
        self._state = self._state * 16_807 % 0x7FFFFFFF
        return (self._state >> 8) % limit


class Network:
    """Sends and receives active messages. `start` at every boot."""

    def __init__(
        self,
        mcu: Msp430F1611,
        driver: Cc2420Driver,
        alarms: Alarms,
        config: NetworkConfig,
        sfd: SfdCapture | None = None,
    ) -> None:
        self.config = config
        self.statistics = NetworkStatistics()
        self.on_sent: Callable[[int, int, bytes, SendStatus], None] | None = None
        """Called with destination, AM type, payload and outcome, for traces."""
        self.on_received: Callable[[Received], None] | None = None
        self._cpu = mcu.cpu
        self._driver = driver
        self._alarms = alarms
        self._sfd = sfd
        self._ended: tuple[int, int] | None = None  # counts at a frame's SFD and its end
        self._flags = mcu.reg["P1IFG"]
        self._edges = mcu.reg["P1IES"]
        self._enables = mcu.reg["P1IE"]
        self._queue: deque[_Outgoing] = deque()
        self._sends = True
        self._sending = False
        self._reserved = False  # the reserved place is taken
        self._work = Flag("network: a message to send")
        self._frame = Flag("network: FIFOP")
        self._outcome = Flag("network: acknowledgement or time-out")
        self._handlers: dict[int, AmHandler] = {}
        self._any: AmHandler | None = None
        self._seen: dict[int, deque[tuple[int, int]]] = {}
        self._random = RandomMlcg(config.address + 1)
        self._sequence = 0
        self._awaited = -1  # sequence number whose acknowledgement is waited for
        self._reading = False
        self._quiet_until = 0  # end of the interframe space, ticks

    def start(self, boot: int) -> Firmware[None]:
        """Bring the radio up and begin; `boot` makes back-offs and numbers differ every time."""
        config = self.config
        self._random = RandomMlcg((config.address + 1) * 65_599 + boot)
        self._sequence = self._random.below(256)
        self._cpu.on_interrupt("PORT1", self._port1)
        yield from self._driver.start(
            config.channel,
            config.pan_id,
            config.address,
            config.pa_level,
            recognise=not config.promiscuous,
        )
        self._edges.clear_bits(_FIFOP)
        self._flags.clear_bits(_FIFOP)
        self._enables.set_bits(_FIFOP)
        if self._sfd is not None:
            self._sfd.start()
        self._cpu.spawn("network send", self._send_task())
        self._cpu.spawn("network receive", self._receive_task())

    def on(self, am_type: int, handler: AmHandler) -> None:
        """Hand messages of an AM type to a sub-routine of the receiving task."""
        self._handlers[am_type] = handler

    def on_any(self, handler: AmHandler) -> None:
        """Hand messages of an AM type that has no handler of its own to a sub-routine."""
        self._any = handler

    @property
    def room(self) -> int:
        """Messages that the queue still takes."""
        return self.config.queue_limit - len(self._queue) + self._reserved

    def send(
        self,
        destination: int,
        am_type: int,
        payload: bytes,
        done: Done | None = None,
        *,
        reserved: bool = False,
        stamp: Stamp | None = None,
    ) -> bool:
        """Queue a message; False, and nothing queued, where the queue is full.

        A unicast is acknowledged or reported as lost; a broadcast is sent once. `done` hears.
        `reserved` is a place for one message that others cannot take, as each sender has one in
        TinyOS (AMQueueP): the network layer's. `stamp` puts the time of its SFD into a broadcast's
        payload (with `SfdCapture`).
        """
        if len(payload) > MAX_PAYLOAD_OCTETS:
            raise ValueError(f"AM payload of {len(payload)} octets: {MAX_PAYLOAD_OCTETS} fit")
        if self._reserved if reserved else self.room < 1:
            self.statistics.refused += 1
            return False
        self._reserved |= reserved
        self.statistics.queued += 1
        self._queue.append(_Outgoing(destination, am_type, payload, done, reserved, stamp))
        self._work.set()
        return True

    # --- times without radio ------------------------------------------------------------

    @property
    def sends(self) -> bool:
        """Whether messages go; if not they wait in the queue, `radio_off` or not."""
        return self._sends

    @sends.setter
    def sends(self, sends: bool) -> None:
        self._sends = sends
        if sends:
            self._work.set()

    def radio_off(self) -> Firmware[None]:
        """Switch the radio off, when what has begun is over; `sends` has to be False."""
        while self._sending or self._reading or self._driver.frame_waits:
            yield from self._alarms.sleep_us(OFF_POLL_US)
        yield from self._driver.off()

    def radio_on(self) -> Firmware[None]:
        """Switch the radio on again."""
        yield from self._driver.on()

    # --- sending ----------------------------------------------------------------------

    def _send_task(self) -> Firmware[None]:
        queue = self._queue
        while True:
            if not queue or not self._sends:
                yield self._work
                continue
            message = queue[0]
            self._sending = True
            sent = yield from self._send(message)
            self._sending = False
            queue.popleft()
            if message.reserved:
                self._reserved = False
            if self.on_sent is not None:
                self.on_sent(message.destination, message.am_type, message.payload, sent.status)
            if message.done is not None:
                message.done(sent)

    def _send(self, message: _Outgoing) -> Firmware[Sent]:
        config, statistics = self.config, self.statistics
        wants_ack = message.destination != AM_BROADCAST
        self._sequence = sequence = (self._sequence + 1) & 0xFF
        control = _FCF_DATA | (_FCF_ACK_REQUEST if wants_ack else 0)
        octets = (
            control.to_bytes(2, "little")
            + bytes((sequence,))
            + config.pan_id.to_bytes(2, "little")
            + message.destination.to_bytes(2, "little")
            + config.address.to_bytes(2, "little")
            + bytes((NALP_DISPATCH, message.am_type))
            + message.payload
        )
        yield SEND_CYCLES + COPY_CYCLES_PER_OCTET * len(octets)
        yield from self._driver.load(octets)
        air_us = TURNAROUND_US + timing.ppdu_us(len(octets) + 2)
        space = timing.interframe_space_symbols(len(octets) + 2) * timing.SYMBOL_US
        attempts = config.max_frame_retries + 1
        for attempt in range(1, attempts + 1):
            statistics.retries += attempt > 1
            if not (yield from self._csma(message.stamp)):
                statistics.channel_busy += 1
                return Sent(SendStatus.CHANNEL_BUSY, attempt - 1)
            statistics.transmissions += 1
            if not wants_ack:
                yield from self._alarms.sleep_us(air_us)
                self._quiet_until = self._alarms.now() + ticks_of_us(space)
                statistics.sent_unacknowledged += 1
                return Sent(SendStatus.SENT, attempt)
            if (yield from self._acknowledged(sequence, air_us)):
                self._quiet_until = self._alarms.now() + ticks_of_us(space)
                statistics.acknowledged += 1
                return Sent(SendStatus.ACKNOWLEDGED, attempt)
        statistics.not_acknowledged += 1
        return Sent(SendStatus.NOT_ACKNOWLEDGED, attempts)

    def _csma(self, stamp: Stamp | None) -> Firmware[bool]:
        """Unslotted CSMA-CA (7.5.1.4, Figure 69): return whether the frame is on its way."""
        config, alarms = self.config, self._alarms
        exponent = config.min_be
        for _ in range(config.max_csma_backoffs + 1):
            self.statistics.backoffs += 1
            delay_us = self._random.below(1 << exponent) * UNIT_BACKOFF_US
            start = max(alarms.now(), self._quiet_until)
            due = start + ticks_of_us(delay_us)
            if due > alarms.now():
                yield from alarms.sleep_until(due)
            if (yield from self._transmit(stamp)):
                return True
            exponent = min(exponent + 1, config.max_be)
        return False

    def _transmit(self, stamp: Stamp | None) -> Firmware[bool]:
        if stamp is None or self._sfd is None:
            return (yield from self._driver.transmit_if_clear())
        sent = yield from self._driver.transmit_stamped(
            self._sfd, HEADER_OCTETS, stamp, self._alarms
        )
        if sent is None:
            self.statistics.late_stamps += 1
        return sent is not False

    def _acknowledged(self, sequence: int, air_us: int) -> Firmware[bool]:
        """Wait for the acknowledgement: the frame's own time, then macAckWaitDuration."""
        alarms = self._alarms
        self._awaited = sequence
        self._outcome.clear()
        alarm = alarms.after_us(air_us + ACK_WAIT_US, self._outcome)
        yield self._outcome
        if self._awaited >= 0 and (self._reading or self._driver.frame_waits):
            self._outcome.clear()
            alarm = alarms.after_us(READ_GRACE_US, self._outcome)
            yield self._outcome
        alarms.cancel(alarm)
        came = self._awaited < 0
        self._awaited = -1
        return came

    # --- receiving --------------------------------------------------------------------

    def _port1(self) -> int:
        self._flags.clear_bits(_FIFOP)
        self._frame.set()
        if self._sfd is not None:
            self._ended = self._sfd.last(), self._alarms.now()
            return 45  # two counts of 32 bits more
        return 20  # bic.b #n, &P1IFG and posting a task

    def _receive_task(self) -> Firmware[None]:
        driver = self._driver
        while True:
            if not driver.frame_waits:
                self._reading = False
                yield self._frame
                continue
            self._reading = True
            ended, self._ended = self._ended, None
            frame = yield from driver.read_frame()
            if frame is None:
                continue
            octets = frame.octets
            if not frame.crc_ok:
                self.statistics.bad_frames += 1
            elif len(octets) == _ACK_OCTETS:
                if octets[2] == self._awaited:
                    self._awaited = -1
                    self._outcome.set()
            else:
                yield RECEIVE_CYCLES
                sfd_ticks = None
                if ended is not None and belongs(*ended, len(octets) + FCS_OCTETS):
                    sfd_ticks = ended[0]
                yield from self._receive(octets, frame.rssi_dbm, sfd_ticks)

    def _receive(self, octets: bytes, rssi_dbm: int, sfd_ticks: int | None) -> Firmware[None]:
        statistics = self.statistics
        control = octets[0] | octets[1] << 8
        if (
            control & ~_FCF_ACK_REQUEST != _FCF_DATA
            or len(octets) < HEADER_OCTETS
            or octets[9] != NALP_DISPATCH
        ):
            statistics.bad_frames += 1
            return
        source = octets[7] | octets[8] << 8
        if self._is_duplicate(source, octets[2]):
            statistics.duplicates += 1
            return
        received = Received(
            source,
            octets[5] | octets[6] << 8,
            octets[10],
            octets[HEADER_OCTETS:],
            rssi_dbm,
            sfd_ticks,
        )
        handler = self._handlers.get(received.am_type, self._any)
        if handler is None:
            statistics.bad_frames += 1
            return
        statistics.received += 1
        if self.on_received is not None:
            self.on_received(received)
        yield from handler(received)

    def _is_duplicate(self, source: int, sequence: int) -> bool:
        """Whether this number came from there lately; it has now."""
        now = self._alarms.now()
        seen = self._seen.get(source)
        if seen is None:
            seen = self._seen[source] = deque(maxlen=DUPLICATE_WINDOW)
        oldest = now - ticks_of_us(DUPLICATE_US)
        for number, heard in seen:
            if number == sequence and heard >= oldest:
                return True
        seen.append((sequence, now))
        return False
