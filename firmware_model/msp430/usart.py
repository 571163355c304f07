"""The USART with its DMA: blocks that only pass from RAM to the port and back are streamed.

A block that DMA moves between RAM and the two buffers is streamed: the byte goes straight from RAM
to the port and back, and the registers, flags and channels that would only pass it on are brought
up to date at the end, or when anybody touches them. A slave that works in words of two bytes costs
one event a word. To a port that takes blocks (a memory, whose answer does not depend on when it is
asked) the whole stream is one event.

A stream is all of a block but its last two bytes: from the third last byte's end on, channels
finish and flags stand, and bytes go one at a time (`usart_core`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

from firmware_model.msp430.usart_core import UsartCore

if TYPE_CHECKING:
    from firmware_model.msp430.dma import DmaChannel, Trigger
    from firmware_model.wires import SpiBlockPort, SpiPairPort, SpiPort

STREAM_CYCLES = 4
"""Bus cycles of a streamed byte: two for each of its two DMA transfers (`dma.py`)."""


def _nothing_to_hold(_cycles: int) -> None:
    """Stand in for the CPU until a stream begins."""


class Usart(UsartCore):
    """One USART. Boards wire it by `connect_spi`, `connect_uart` and `uart_receive`."""

    def __init__(self, *arguments: Any) -> None:
        """Take the arguments of `UsartCore`."""
        super().__init__(*arguments)
        self.memory = bytearray()
        """The address space that DMA streams from and to; the MCU sets it."""
        self._receiver: DmaChannel | None = None  # of the stream that is running
        self._transmitter: DmaChannel | None = None
        self._streamed = 0  # bytes of it that are over
        self._stream_bytes = 0
        self._stream_first = self._stream_place = 0
        self._hold: Callable[[int], None] = _nothing_to_hold
        self._stream_tick = 0
        self._block: SpiBlockPort | None = None  # takes the running stream as a block
        self._block_port: SpiBlockPort | None = None
        self._pair_port: SpiPairPort | None = None
        self._pair_tick = 0  # beginning of the pair under way, 0 in any other stream

    def connect_spi(self, port: SpiPort) -> None:
        """Wire SIMO, SOMI and UCLK to a bus."""
        super().connect_spi(port)
        self._block_port = cast("SpiBlockPort", port) if hasattr(port, "takes_blocks") else None
        self._pair_port = cast("SpiPairPort", port) if hasattr(port, "takes_pairs") else None

    def _open_stream(self, receive: Trigger, transmit: Trigger) -> bool:
        """Begin a stream if DMA does nothing but carry bytes between RAM and our buffers."""
        receiver: DmaChannel | None = getattr(receive, "__self__", None)
        transmitter: DmaChannel | None = getattr(transmit, "__self__", None)
        rx, tx = self._rx_flag, self._tx_flag
        if (
            receiver is None
            or transmitter is None
            or self._unread
            or receiver.left <= 2
            or receiver.left != transmitter.left + 1
            or rx.enables.value & rx.bit
            or tx.enables.value & tx.bit
            or not receiver.streams_in(self._rxbuf)
            or not transmitter.streams_out(self._txbuf)
        ):
            return False
        self._receiver, self._transmitter = receiver, transmitter
        self._streaming = True
        receiver.on_touch = transmitter.on_touch = self._break_stream
        self._hold = receiver.hold
        self._tx_full = False
        self._streamed = 0
        self._stream_bytes = receiver.left - 2
        self._stream_place = receiver.place
        self._stream_first = transmitter.place
        self._stream_tick = self._due_tick
        port = self._block_port
        pairs = self._pair_port
        self._block = None
        self._pair_tick = 0
        if port is not None and self._port is port and port.takes_blocks():
            self._block = port
            self._due_tick += self._byte_ticks * self._stream_bytes
            self._action = self._block_over
        elif (
            pairs is not None
            and self._port is pairs
            and not self._stream_bytes & 1
            and pairs.takes_pairs()
        ):
            self._pair_tick = self._due_tick
            self._due_tick += 2 * self._byte_ticks
            self._action = self._pair_over
            first = self._txbuf.value
            pairs.begin_pair(first << 8 | self.memory[self._stream_first], self._bit_fs)
        else:
            self._due_tick += self._byte_ticks
            self._action = self._stream_over
            self._port.begin(self._txbuf.value, self._bit_fs)
        self._event = self._scheduler.at(self._clock.edge(self._due_tick), self._action)
        return True

    def _stream_over(self) -> None:
        """End of a byte of a stream."""
        done = self._streamed
        port, memory = self._port, self.memory
        memory[self._stream_place + done] = port.end()
        self._hold(STREAM_CYCLES)
        self._streamed = following = done + 1
        if following < self._stream_bytes:
            self._due_tick = tick = self._due_tick + self._byte_ticks
            port.begin(memory[self._stream_first + done], self._bit_fs)
            self._event = self._scheduler.at(self._clock.edge(tick), self._stream_over)
        else:
            self._event = None
            self._close_stream(following)
            self._load()

    def _pair_over(self) -> None:
        """End of two bytes of a stream."""
        done = self._streamed
        port, memory = self._pair_port, self.memory
        assert port is not None
        miso = port.end_pair()
        place = self._stream_place + done
        memory[place] = miso >> 8
        memory[place + 1] = miso & 0xFF
        self._hold(2 * STREAM_CYCLES)
        self._streamed = following = done + 2
        if following < self._stream_bytes:
            self._pair_tick = tick = self._due_tick
            self._due_tick = tick = tick + 2 * self._byte_ticks
            place = self._stream_first + done + 1
            port.begin_pair(memory[place] << 8 | memory[place + 1], self._bit_fs)
            self._event = self._scheduler.at(self._clock.edge(tick), self._pair_over)
        else:
            self._event = None
            self._close_stream(following)
            self._load()

    def _split_pair(self) -> None:
        """Go on a byte at a time from the byte of a pair that is under way."""
        port = self._pair_port
        assert port is not None
        ticks = self._clock.ticks(self._scheduler.now) - self._pair_tick
        first_is_over = ticks >= self._byte_ticks
        miso = port.split_pair(first_is_over)
        self._due_tick = self._pair_tick + self._byte_ticks
        if first_is_over:
            self.memory[self._stream_place + self._streamed] = miso
            self._streamed += 1
            self._due_tick += self._byte_ticks
            self._hold(STREAM_CYCLES)
        self._pair_tick = 0

    def _stream_block(self, until: int) -> None:
        """Hand the first bytes of a block to the port; keep what came back."""
        port = self._block
        assert port is not None
        first = self._stream_first
        data = bytes((self._txbuf.value,)) + self.memory[first : first + until - 1]
        place = self._stream_place
        self.memory[place : place + until] = port.exchange_block(data)
        self._streamed = until
        self._hold(STREAM_CYCLES * until)

    def _block_over(self) -> None:
        """End of a whole block."""
        self._event = None
        self._stream_block(self._stream_bytes)
        self._close_stream(self._stream_bytes)
        self._load()

    def _close_stream(self, received: int) -> None:
        """Bring buffers and channels to what they are when so many bytes have come, one at a time.

        The next byte stands in UxTXBUF: DMA always is one ahead of the shift register.
        """
        receiver, transmitter = self._receiver, self._transmitter
        assert receiver is not None
        assert transmitter is not None
        self._receiver = self._transmitter = None
        self._streaming = False
        receiver.on_touch = transmitter.on_touch = None
        self._action = self._spi_over
        self.bytes_shifted += received
        if received:
            self._rxbuf.value = self.memory[self._stream_place + received - 1]
            receiver.moved(received)
            transmitter.moved(received)
            self._txbuf.value = self.memory[self._stream_first + received - 1]
        self._tx_full = True

    def _break_stream(self) -> None:
        """Somebody looks: go on a byte at a time, in the middle of the byte that is under way."""
        transmitter = self._transmitter
        if transmitter is None:
            return
        if self._block is not None:
            ticks = self._clock.ticks(self._scheduler.now) - self._stream_tick
            over = min(max(0, ticks // self._byte_ticks), self._stream_bytes - 1)
            if over:
                self._stream_block(over)
            first = self._stream_first
            byte = self.memory[first + over - 1] if over else self._txbuf.value
            self._port.begin(byte, self._bit_fs)
            self._due_tick = self._stream_tick + self._byte_ticks * (over + 1)
        elif self._pair_tick:
            self._split_pair()
        self._close_stream(self._streamed)
        # The byte that closing put into UxTXBUF is under way already: the next one stands there.
        self._txbuf.value = self.memory[transmitter.place]
        transmitter.moved(1)
        self._hold(STREAM_CYCLES // 2)
        self._scheduler.cancel(self._event)
        due = max(self._clock.edge(self._due_tick), self._scheduler.now)
        self._event = self._scheduler.at(due, self._spi_over)
