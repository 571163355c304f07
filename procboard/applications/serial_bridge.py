"""BaseStation: active messages between USB (TEP 113) and the radio, as in TinyOS's application.

From the host: a packet is acknowledged when it has a place in the radio's queue, and sent under
this mote's own address and PAN, whatever source and group it names (TinyOS's CC2420 stack writes
both over). From the radio: each message goes up with the addresses it had, best effort; one that
finds the queue full is lost and counted. The depths of the queues are BaseStationP's.

Acknowledgements go before messages, and one frame at a time goes to the UART, so that what waits is
in a queue whose length means something.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from firmware_model.cpu import Flag
from procboard.applications.services import Services
from procboard.coroutines import Firmware
from procboard.errors import ProcConfigError
from procboard.network import Received, SendStatus, Sent
from radio_802154.errors import RadioError
from radio_802154.messages import TOSH_DATA_LENGTH
from radio_802154.serial_link import MOTE, PacketReceived, SerialLink
from radio_802154.tinyos_serial import AM_DISPATCH, AmMessage, PacketType, SerialPacket, decode_am

UART_QUEUE: Final = 12
RADIO_QUEUE: Final = 12
"""UART_QUEUE_LEN and RADIO_QUEUE_LEN of TinyOS's BaseStationP.nc."""

OCTET_CYCLES: Final = 70
"""De-framing and CRC of an octet: HdlcTranslateC and SerialP, about 23 instructions (estimate)."""
PACKET_CYCLES: Final = 250
"""Dispatching and copying a packet, either way: about 80 instructions (estimate)."""


@dataclass(slots=True)
class BridgeCounts:
    """Over all boots."""

    from_host: int = 0
    """Active messages of the host that were queued for the radio, each acknowledged."""
    refused: int = 0
    """Packets that found the radio's queue full: neither taken nor acknowledged."""
    repeated: int = 0
    """Packets that came again because their acknowledgement was lost."""
    not_carried: int = 0
    """Packets that are no active message, or longer than TOSH_DATA_LENGTH: acknowledged, as SerialP
    does, and dropped; and those that do not ask for an acknowledgement, which SerialP ignores."""
    damaged: int = 0
    """Frames of the host that were not intact."""
    on_air: int = 0
    """Of the messages of the host: acknowledged by their receiver, or sent as broadcast."""
    unanswered: int = 0
    """Of them: not acknowledged by anybody, or the channel stayed busy."""
    from_radio: int = 0
    """Messages heard."""
    to_host: int = 0
    """Of them, sent to the host."""
    dropped: int = 0
    """Of them, lost because the queue to the host was full."""


def _nothing(*_arguments: object) -> None:
    """Stand in where nobody listens."""


class SerialBridgeApp:
    """The application; `counts` is what a laboratory may look at."""

    def __init__(self) -> None:
        self.counts = BridgeCounts()
        self.on_sent: Callable[[AmMessage, SendStatus], None] = _nothing
        """Called with each message of the host that the radio is done with."""
        self.on_heard: Callable[[Received], None] = _nothing

    def start(self, services: Services) -> None:
        """Begin. What waited in a former boot's queues was in RAM and is lost."""
        if services.usb is None:
            raise ProcConfigError("the serial bridge needs the USB port: usb_queue")
        self._services = services
        self._uart = services.usb
        self._link = SerialLink(MOTE)
        self._up: deque[AmMessage] = deque()
        self._work = Flag("serial bridge: something for the host")
        services.network.on_any(self._radio)
        services.cpu.spawn("serial receive", self._receive())
        services.cpu.spawn("serial send", self._send())

    # --- host to radio ----------------------------------------------------------------------

    def _receive(self) -> Firmware[None]:
        uart, link, counts = self._uart, self._link, self.counts
        network, alarms = self._services.network, self._services.alarms
        while True:
            octets = uart.read()
            if not octets:
                yield uart.arrived
                continue
            yield OCTET_CYCLES * len(octets)
            link.room = network.room
            before = (link.statistics.refused, link.statistics.duplicates, link.statistics.damaged)
            events = link.receive(octets, alarms.now_us())
            counts.refused += link.statistics.refused - before[0]
            counts.repeated += link.statistics.duplicates - before[1]
            counts.damaged += link.statistics.damaged - before[2]
            for event in events:
                if isinstance(event, PacketReceived):
                    yield PACKET_CYCLES
                    self._to_radio(event.packet)
            if link.wants_to_send:
                self._work.set()

    def _to_radio(self, packet: SerialPacket) -> None:
        message = None
        if packet.kind is PacketType.DATA_ACK and packet.dispatch == AM_DISPATCH:
            try:
                message = decode_am(packet.body)
            except RadioError:
                message = None
        if message is None or len(message.payload) > TOSH_DATA_LENGTH:
            self.counts.not_carried += 1
            return
        accepted = message

        def done(sent: Sent) -> None:
            fine = sent.status in (SendStatus.ACKNOWLEDGED, SendStatus.SENT)
            self.counts.on_air += fine
            self.counts.unanswered += not fine
            self.on_sent(accepted, sent.status)

        self.counts.from_host += 1
        queued = self._services.network.send(
            message.destination, message.am_type, message.payload, done
        )
        assert queued  # `room` said so, and nothing else fills this queue

    # --- radio to host ----------------------------------------------------------------------

    def _radio(self, received: Received) -> Firmware[None]:
        yield PACKET_CYCLES
        self.counts.from_radio += 1
        self.on_heard(received)
        if len(self._up) >= UART_QUEUE:
            self.counts.dropped += 1
            return
        self._up.append(
            AmMessage(
                received.destination,
                received.am_type,
                received.payload,
                received.source,
                self._services.network.config.pan_id & 0xFF,
            )
        )
        self._work.set()

    def _send(self) -> Firmware[None]:
        uart, link, waiting = self._uart, self._link, self._up
        alarms = self._services.alarms
        while True:
            if not uart.idle:
                yield uart.drained
                continue
            if not link.wants_to_send and waiting:
                link.send_am(waiting.popleft())
                self.counts.to_host += 1
                yield PACKET_CYCLES
            if not link.wants_to_send:
                yield self._work
                continue
            octets = link.data_to_send(alarms.now_us())
            yield OCTET_CYCLES * len(octets)
            uart.write(octets)
