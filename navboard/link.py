"""SPI controller: the slave's side of the link, an interrupt for every two bytes.

The SPI module works in 16-bit words, which halves the interrupts; the master clocks an even number
of bytes while it holds the chip select, and zeros between frames are filler. The handler takes the
word that came in and loads the next to go out; the link's state machine runs in a task, woken by a
delimiter. The module's double buffer is kept full, so what is loaded goes out two words later: a
handler may be late by a whole word before the master sees a gap. The data-ready line is up until
the last word of a frame has left the chip, not only the buffer.
"""

from __future__ import annotations

from collections.abc import Callable, Generator

from firmware_model.cpu import Coroutine, Flag
from firmware_model.dspic30f.mcu import DsPic30F6014A
from navboard import costs
from navboard.drivers.board_clock import BoardClock
from spi_bus.errors import LinkFull
from spi_bus.link import Link, LinkConfig, MessageReceived, Role
from spi_bus.messages import BoardEvent, BoardEventCode, ClockRequest

SPI1_BIT = 1 << 8  # SPI1IE, SPI1IF: IEC0, IFS0
DATA_READY_BIT = 1 << 4  # RD4
_SPIEN = 1 << 15
_SPIROV = 1 << 6
_MODE16_CKE_SSEN = 1 << 10 | 1 << 8 | 1 << 7
_FILLER = 0
_BUFFERED = 2  # words between SPI1BUF and the wire: transmit buffer and shift register
_RECEIVE_LIMIT = 256

LINK_CONFIG = LinkConfig(window=8, queue_limit=64, retransmit_us=300_000)
"""The master acknowledges with the next report, 0.1 s later, instead of a frame of its own; so a
frame is missed only after three reports. The queue takes 2.5 of the 8 KiB of RAM (40 bytes each):
at 100 reports a second it bridges 0.6 s, a sector erase of the processing board's flash."""

RESERVED = 6
"""Places of the queue that readings leave to confirmations and events: without them a rough link
would fill with reports, and a command that was carried out would look lost."""

OnMessage = Callable[[object, int], None]
"""Takes a message and the board's time in µs."""


class LinkController:
    """Owns SPI1, the data-ready pin and the link."""

    def __init__(
        self, mcu: DsPic30F6014A, clock: BoardClock, epoch: int, on_message: OnMessage
    ) -> None:
        reg = mcu.reg
        self._status = reg["SPI1STAT"]
        self._buffer = reg["SPI1BUF"]
        self._flags = reg["IFS0"]
        self._latch = reg["LATD"]
        self._clock = clock
        self._on_message = on_message
        self.link = Link(Role.SLAVE, epoch, LINK_CONFIG)
        self.work = Flag("link work")
        self.overruns = 0
        """Times that the receiver was found overrun."""
        self.unsent = 0
        """Messages given up because the link's queue was full."""
        self._reported_overruns = 0
        self._reported_unsent = 0
        self._incoming = bytearray()
        self._begun = False  # the last byte that came was no zero
        self._outgoing = b""
        self._index = 0
        self._behind = 0  # words of ours that have been loaded and have not left the chip
        self._ready = False
        self._deadline_us: int | None = 0
        reg["TRISD"].clear_bits(DATA_READY_BIT)
        reg["SPI1CON"].write(_MODE16_CKE_SSEN)  # slave, data changes at the trailing edge
        self._status.write(_SPIEN)
        for _ in range(_BUFFERED):
            self._buffer.write(_FILLER)
        reg["IPC2"].write(0x4446)  # SPI1 at priority 6: a word is 61 µs, all else can wait
        reg["IEC0"].set_bits(SPI1_BIT)

    # --- interrupt -------------------------------------------------------------------

    def handler(self) -> int:
        """SPI1 interrupt: two bytes in, two bytes out; returns its cycles."""
        self._flags.clear_bits(SPI1_BIT)
        word = self._buffer.read()
        index, outgoing = self._index, self._outgoing
        if index < len(outgoing):
            self._buffer.write(outgoing[index] << 8 | outgoing[index + 1])
            self._index = index + 2
            self._behind = _BUFFERED
        else:
            self._buffer.write(_FILLER)
            if self._behind:
                self._behind -= 1
                if not self._behind:
                    self.work.set()  # all is out: is there more?
        if self._status.value & _SPIROV:
            self._status.clear_bits(_SPIROV)
            self.overruns += 1
        incoming = self._incoming
        if word or self._begun:  # the task may have taken a frame's beginning: its end counts
            self._begun = bool(word & 0xFF)
            if len(incoming) < _RECEIVE_LIMIT:
                incoming += word.to_bytes(2, "big")
            if not word & 0xFF or not word >> 8 or len(incoming) >= _RECEIVE_LIMIT:
                self.work.set()  # a delimiter, or noise without one, which the decoder throws away
        return costs.SPI_ISR

    # --- task ------------------------------------------------------------------------

    def task(self) -> Coroutine:
        """Run the link whenever something came, all went out, or a deadline passed."""
        while True:
            yield self.work
            now_us = self._clock.now_us()
            if self._incoming:
                data = bytes(self._incoming)
                self._incoming.clear()
                yield costs.LINK_CALL + costs.LINK_BYTE * len(data)
                for event in self.link.receive(data, now_us):
                    if isinstance(event, MessageReceived):
                        self._on_message(event.message, now_us)
                        yield costs.MESSAGE
            deadline = self.link.next_deadline_us()
            if deadline is not None and deadline <= now_us:
                self.link.handle_timer(now_us)
            yield from self._refill(now_us)

    def _refill(self, now_us: int) -> Generator[int, None, None]:
        """Give the handler the next frames when the last are out, and drive data-ready."""
        if self._index >= len(self._outgoing) and self.link.wants_to_send:
            data = self.link.data_to_send(now_us)
            yield costs.LINK_CALL + costs.LINK_BYTE * len(data)
            self._outgoing = data + bytes(len(data) & 1)
            self._index = 0
        self._deadline_us = self.link.next_deadline_us()
        self._drive_ready()

    def _drive_ready(self) -> None:
        pending = self._index < len(self._outgoing) or self._behind > 0
        ready = pending or self.link.wants_to_send
        if ready != self._ready:
            self._ready = ready
            if ready:
                self._latch.set_bits(DATA_READY_BIT)
            else:
                self._latch.clear_bits(DATA_READY_BIT)

    # --- what the rest of the firmware uses --------------------------------------------

    def poll(self, now_us: int) -> None:
        """Wake the task if a deadline of the link has passed: called every control tick."""
        deadline = self._deadline_us
        if deadline is not None and deadline <= now_us:
            self.work.set()

    def send_sample(self, message: object, now_us: int) -> bool:
        """Queue a reading, with places left for confirmations and events; False: it is lost."""
        if self.link.queued >= LINK_CONFIG.queue_limit - RESERVED:
            self.unsent += 1
            return False
        return self.send(message, now_us)

    def send(self, message: object, now_us: int) -> bool:
        """Queue a message; False (and counted) where the link is full."""
        try:
            self._report_losses(now_us)
            self.link.send(message)
        except LinkFull:
            self.unsent += 1
            return False
        self.work.set()
        return True

    def ask_clock(self, token: int) -> None:
        """Ask for the processing board's clock.

        Raises:
            LinkFull: nothing was asked.

        """
        self.link.send(ClockRequest(token))
        self.work.set()

    def _report_losses(self, now_us: int) -> None:
        """Tell of overruns and of messages given up, once there is room to tell."""
        if self.overruns != self._reported_overruns:
            lost = self.overruns - self._reported_overruns
            self.link.send(BoardEvent(now_us, BoardEventCode.OVERRUN, min(lost, 0xFFFF)))
            self._reported_overruns = self.overruns
        if self.unsent != self._reported_unsent:
            lost = self.unsent - self._reported_unsent
            self.link.send(BoardEvent(now_us, BoardEventCode.QUEUE_FULL, min(lost, 0xFFFF)))
            self._reported_unsent = self.unsent
