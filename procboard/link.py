"""The SPI controller: the link to the navigation board, which is the slave and cannot begin.

The master clocks when it has bytes to send, or when the data-ready line asks for it; between these
the bus is still. It cannot know how long the slave's frame is, so it clocks blocks of a sensor
report's length while data-ready is up, and goes on, as far as the longest frame, while what came
last was no frame's end. The protocol itself is the sans-IO `spi_bus.link`; this file is its wires,
its clock and its one task.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, TypeAlias

from firmware_model.cpu import Flag
from firmware_model.msp430.mcu import Msp430F1611
from procboard.alarms import Alarms
from procboard.coroutines import Firmware
from procboard.drivers.spi import SpiMaster
from spi_bus.errors import LinkFull
from spi_bus.link import (
    Event,
    Link,
    LinkConfig,
    LinkUp,
    MessageAcknowledged,
    MessageReceived,
    PeerReset,
    Role,
)
from spi_bus.messages import ClockReport, ClockRequest

BLOCK_BYTES: Final = 48
"""A sensor report's frame, 43 bytes, and what an acknowledgement may add before it."""
LIMIT_BYTES: Final = 256
"""Most bytes of an exchange: the DMA buffer's, and the longest frame with its zero."""
DRAIN_BLOCKS: Final = 8
"""Blocks clocked at most for a frame whose end does not come and that data-ready does not announce:
longer than any frame."""

START_US: Final = 500_000
"""Longest wait for a navigation board that is silent: several times its start-up."""

EXCHANGE_CYCLES: Final = 150
"""Bookkeeping of an exchange: about 50 instructions of 3 cycles (estimate)."""
BYTE_CYCLES: Final = 40
"""COBS and CRC-16 of a byte: 14 + 26 cycles, as procboard.storage has the CRC (estimate)."""
EVENT_CYCLES: Final = 120
"""Decoding a message and calling its handler (estimate)."""

_CHIP_SELECT, _DATA_READY = 0x08, 0x01  # P2.3, P2.0

MessageHandler: TypeAlias = Callable[[Any], Firmware[None]]


def _no_event(_event: Event) -> None:
    """Stand in where nobody watches."""


class LinkController:
    """The master's end. At every boot `open` it with a new epoch and `start` it.

    What comes is acknowledged when it is taken, so `start` follows when all handlers are there: in
    between messages may be queued, and nothing goes over the wires.
    """

    def __init__(self, mcu: Msp430F1611, master: SpiMaster, alarms: Alarms) -> None:
        self.on_event: Callable[[Event], None] = _no_event
        """Called with every event of the link, for traces."""
        self.exchanges = 0
        self.bytes_clocked = 0
        self._cpu = mcu.cpu
        self._master = master
        self._alarms = alarms
        self._in = mcu.reg["P2IN"]
        self._out = mcu.reg["P2OUT"]
        self._flags = mcu.reg["P2IFG"]
        self._edges = mcu.reg["P2IES"]
        self._enables = mcu.reg["P2IE"]
        self._link = Link(Role.MASTER, 1)
        self._wake = Flag("link: something to do")
        self._handlers: dict[type, MessageHandler] = {ClockRequest: self._tell_time}
        self._waiting: dict[int, Callable[[], None]] = {}
        self.last_heard_us = 0
        """When the last message came."""

    @property
    def link(self) -> Link:
        """The protocol's state, for statistics."""
        return self._link

    def open(self, epoch: int, config: LinkConfig) -> None:
        """Begin a session."""
        self._link = Link(Role.MASTER, epoch, config)
        self._waiting.clear()

    def start(self) -> None:
        """Begin to exchange: every handler is registered."""
        self._cpu.on_interrupt("PORT2", self._data_ready)
        self._edges.clear_bits(_DATA_READY)  # rising
        self._flags.clear_bits(_DATA_READY)
        self._enables.set_bits(_DATA_READY)
        self._cpu.spawn("link", self._run())

    def on(self, message: type, handler: MessageHandler) -> None:
        """Hand messages of a class to a sub-routine of the link's task."""
        self._handlers[message] = handler

    def send(self, message: object, on_acknowledged: Callable[[], None] | None = None) -> None:
        """Queue a message for the navigation board.

        Raises:
            LinkFull: the queue is full; nothing was queued.
            FieldError: a value does not fit.

        """
        token = self._link.send(message)
        if on_acknowledged is not None:
            self._waiting[token] = on_acknowledged
        self._wake.set()

    def _data_ready(self) -> int:
        self._flags.clear_bits(_DATA_READY)
        self._wake.set()
        return 20  # bic.b #n, &P2IFG and posting a task

    def _run(self) -> Firmware[None]:
        link, alarms = self._link, self._alarms
        yield from self._await_slave()
        partial = 0  # blocks clocked for a frame that has begun
        unfinished = False  # the last byte that came was no zero
        while True:
            now_us = alarms.now_us()
            deadline_us = link.next_deadline_us()
            if deadline_us is not None and deadline_us <= now_us:
                link.handle_timer(now_us)
            ready = self._in.read() & _DATA_READY
            if not ready and not partial and not link.wants_to_send:
                yield from self._sleep()
                continue
            data = link.data_to_send(now_us, LIMIT_BYTES, acknowledge=bool(ready))
            sent = len(data)
            if (ready or partial) and sent < BLOCK_BYTES:
                data += bytes(BLOCK_BYTES - sent)
            elif sent & 1:
                data += b"\0"  # the slave works in words of two bytes
            yield EXCHANGE_CYCLES + BYTE_CYCLES * sent
            self._out.clear_bits(_CHIP_SELECT)
            answer = yield from self._master.exchange(data)
            self._out.set_bits(_CHIP_SELECT)
            self.exchanges += 1
            self.bytes_clocked += len(answer)
            # Zero is filler and the end of a frame: anything else in the last place is its middle.
            begun, unfinished = unfinished, bool(answer) and answer[-1] != 0
            partial = partial + 1 if unfinished and partial < DRAIN_BLOCKS else 0
            if begun or any(answer):  # nothing but zeros may be the end of a frame
                events = link.receive(answer, alarms.now_us())
                yield BYTE_CYCLES * len(answer)
                for event in events:
                    yield EVENT_CYCLES
                    yield from self._handle(event)

    def _await_slave(self) -> Firmware[None]:
        """Let the navigation board come up first: until then nobody drives SOMI1.

        Its data-ready line rises when it is up, since it has to say hello. One that was up before
        us may have nothing to say, so the wait has an end.
        """
        alarms = self._alarms
        deadline_us = alarms.now_us() + START_US
        alarm = alarms.after_us(START_US, self._wake)
        while not self._in.read() & _DATA_READY and alarms.now_us() < deadline_us:
            yield self._wake
        alarms.cancel(alarm)

    def _sleep(self) -> Firmware[None]:
        """Wait for data-ready, for a message to send or for the link's next deadline."""
        deadline_us = self._link.next_deadline_us()
        if deadline_us is None:
            yield self._wake
            return
        alarms = self._alarms
        remaining_us = max(0, deadline_us - alarms.now_us())
        alarm = alarms.after_us(remaining_us, self._wake)
        yield self._wake
        alarms.cancel(alarm)

    def _tell_time(self, message: ClockRequest) -> Firmware[None]:
        """Answer, unless the queue is full: a late answer would say how full, not what time it is.

        Who asks counts what it asked and what was answered.
        """
        yield EVENT_CYCLES
        with suppress(LinkFull):
            self._link.send(ClockReport(message.token, self._alarms.now_us()))

    def _handle(self, event: Event) -> Firmware[None]:
        self.on_event(event)
        if isinstance(event, MessageReceived):
            self.last_heard_us = self._alarms.now_us()
            handler = self._handlers.get(type(event.message))
            if handler is not None:
                yield from handler(event.message)
        elif isinstance(event, MessageAcknowledged):
            told = self._waiting.pop(event.token, None)
            if told is not None:
                told()
        elif isinstance(event, LinkUp | PeerReset):
            handler = self._handlers.get(type(event))
            if handler is not None:
                yield from handler(event)
