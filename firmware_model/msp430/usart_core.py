"""USART of the MSP430x1xx (SLAU049, chapters 13 and 14): SPI master and UART, an event a byte.

In SPI mode a byte takes eight bit periods from its first clock edge; at their end the port is asked
for what came back, and a byte that waits in UxTXBUF starts in the same instant. So a block without
gaps is one event a byte, whether DMA or firmware feeds it. Byte times are counted in BRCLK ticks,
never added up as rounded durations.

In UART mode a character is handed to listeners at the middle of its stop bit, where a receiver
decides; bit lengths follow UxBR and the modulation register. Reception is the same from the other
side: `uart_receive` is called at the middle of the stop bit.

Not modelled: SPI slave mode and the external clock UCLKI, I²C mode of USART0, multiprocessor
formats, the start-edge interrupt URXSE. Choosing the first three raises a `FirmwareError`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from firmware_model.errors import FirmwareError
from firmware_model.msp430.clocks import FOREVER_FS, GatedClock
from firmware_model.registers import Register, RegisterBank, RegisterSpec

if TYPE_CHECKING:
    from firmware_model.msp430.dma import Trigger
    from firmware_model.msp430.sfr import SfrFlag
    from firmware_model.scheduler import Event, Scheduler
    from firmware_model.wires import SpiPort, UartListener

# UxCTL.
SWRST = 0x01
MM = 0x02
SYNC = 0x04
LISTEN = 0x08
CHAR = 0x10
SPB = 0x20  # in SPI mode: I2C
PEV = 0x40
PENA = 0x80
# UxTCTL.
TXEPT = 0x01
STC = 0x02
SSEL0, SSEL1 = 0x10, 0x20
CKPL, CKPH = 0x40, 0x80
# UxRCTL.
RXERR = 0x01
URXEIE = 0x08
BRK = 0x10
OE = 0x20
PE = 0x40
FE = 0x80
_ERRORS = RXERR | BRK | OE | PE | FE


def registers(number: int) -> tuple[RegisterSpec, ...]:
    """Return the register summary of USART0 or USART1 (SLAU049, tables 13-3 and 13-4)."""
    base = 0x70 + 8 * number
    return (
        RegisterSpec(f"U{number}CTL", base, 8, reset=0x01),
        RegisterSpec(f"U{number}TCTL", base + 1, 8, reset=0x01, writable=0xFE),
        RegisterSpec(f"U{number}RCTL", base + 2, 8),
        RegisterSpec(f"U{number}MCTL", base + 3, 8),
        RegisterSpec(f"U{number}BR0", base + 4, 8),
        RegisterSpec(f"U{number}BR1", base + 5, 8),
        RegisterSpec(f"U{number}RXBUF", base + 6, 8, writable=0),
        RegisterSpec(f"U{number}TXBUF", base + 7, 8),
    )


class _OpenSpiPort:
    """Nothing wired: MISO floats high."""

    def begin(self, mosi: int, bit_period_fs: int) -> None:
        """Let the byte go nowhere."""

    def end(self) -> int:
        """Read ones."""
        return 0xFF


class _LoopedSpiPort:
    """LISTEN: the transmitter is fed back to the receiver."""

    def __init__(self) -> None:
        self._byte = 0xFF

    def begin(self, mosi: int, bit_period_fs: int) -> None:
        """Keep the byte."""
        self._byte = mosi

    def end(self) -> int:
        """Give it back."""
        return self._byte


class UsartCore:
    """A USART that shifts a byte at a time, in SPI master or UART mode."""

    def __init__(
        self,
        number: int,
        scheduler: Scheduler,
        aclk: GatedClock,
        smclk: GatedClock,
        module_enables: Register,
        rx_flag: SfrFlag,
        tx_flag: SfrFlag,
        triggers: list[Trigger | None],
        rx_trigger: int,
        tx_trigger: int,
    ) -> None:
        self.number = number
        self.bytes_shifted = 0
        self._scheduler = scheduler
        self._aclk, self._smclk = aclk, smclk
        self._clock = smclk
        self._me = module_enables
        self._rx_flag, self._tx_flag = rx_flag, tx_flag
        self._triggers = triggers
        self._rx_trigger, self._tx_trigger = rx_trigger, tx_trigger
        rx_flag.on_rise = self._rx_rose
        tx_flag.on_rise = self._tx_rose
        rx_flag.line.on_accept = rx_flag.clear
        tx_flag.line.on_accept = tx_flag.clear
        self._streaming = False  # DMA feeds the shift register: see `usart.Usart`
        self._wired: SpiPort = _OpenSpiPort()
        self._port: SpiPort = self._wired
        self._listeners: tuple[UartListener, ...] = ()
        prefix = f"U{number}"
        self.bank = RegisterBank(
            registers(number),
            on_read={f"{prefix}RXBUF": self._read_rx, f"{prefix}TCTL": self._read_tctl},
            on_write={
                f"{prefix}CTL": self._write_ctl,
                f"{prefix}TCTL": lambda value: self._write_format(f"{prefix}TCTL", value),
                f"{prefix}RCTL": self._write_rctl,
                f"{prefix}MCTL": lambda value: self._write_format(f"{prefix}MCTL", value),
                f"{prefix}BR0": lambda value: self._write_format(f"{prefix}BR0", value),
                f"{prefix}BR1": lambda value: self._write_format(f"{prefix}BR1", value),
                f"{prefix}TXBUF": self._write_tx,
            },
        )
        self._ctl = self.bank[f"{prefix}CTL"]
        self._tctl = self.bank[f"{prefix}TCTL"]
        self._rctl = self.bank[f"{prefix}RCTL"]
        self._mctl = self.bank[f"{prefix}MCTL"]
        self._br0, self._br1 = self.bank[f"{prefix}BR0"], self.bank[f"{prefix}BR1"]
        self._rxbuf = self.bank[f"{prefix}RXBUF"]
        self._txbuf = self.bank[f"{prefix}TXBUF"]
        self._event: Event | None = None
        self._action: Callable[[], None] = self._spi_over
        self._due_tick = 0
        self._start_tick = 0
        self._byte_ticks = 0
        self._bit_fs = 0
        self._tx_full = False
        self._unread = False
        self._shifting = False
        self._shift = 0
        self._frame_over_fs = 0
        self._frame: tuple[int, int] | None = None
        for clock in (aclk, smclk):
            clock.watch(self._clock_changed)

    # --- wiring -----------------------------------------------------------------------

    def connect_spi(self, port: SpiPort) -> None:
        """Wire SIMO, SOMI and UCLK to a bus."""
        self._wired = port
        self._select_port()

    def connect_uart(self, listener: UartListener) -> None:
        """Wire UTXD: `listener` gets each character at the middle of its stop bit."""
        self._listeners = (*self._listeners, listener)

    def uart_receive(self, character: int) -> None:
        """Hear a character on URXD, at the middle of its stop bit (a `UartListener`)."""
        if not self._ctl.value & (SYNC | SWRST) and self._me.value & self._tx_rx_bits()[1]:
            mask = 0xFF if self._ctl.value & CHAR else 0x7F
            self._received(character & mask)

    def uart_error(self, framing: bool = False, parity: bool = False) -> None:
        """Hear a damaged character: FE or PE and RXERR, and no URXIFG (URXEIE = 0)."""
        if not self._ctl.value & (SYNC | SWRST):
            bits = (FE if framing else 0) | (PE if parity else 0) | RXERR
            self._rctl.value |= bits
            if self._rctl.value & URXEIE:  # erroneous characters set URXIFG too
                self._received(self._rxbuf.value)

    @property
    def bit_period_fs(self) -> int:
        """Mean length of a bit with the present clock and divider."""
        return self._clock.span(max(1, self._divider()))

    def reset(self, por: bool) -> None:
        """Stop; at a PUC divider, modulation and buffers keep their values."""
        self._stop()
        for register in (self._ctl, self._tctl, self._rctl):
            register.value = register.reset_value
        if por:
            self.bank.reset()
        self._select_port()

    # --- registers --------------------------------------------------------------------

    def _divider(self) -> int:
        return self._br0.value | self._br1.value << 8

    def _tx_rx_bits(self) -> tuple[int, int]:
        return self._tx_flag.bit, self._rx_flag.bit  # UTXEx and URXEx stand at the same bits

    def _write_ctl(self, value: int) -> None:
        before, self._ctl.value = self._ctl.value, value
        if value & SWRST:
            self._stop()
            self._rctl.value &= ~_ERRORS
            self._rx_flag.clear()
            self._tx_flag.set()
        elif before & SWRST:
            self._check_mode(value)
            self._configure()
        self._select_port()

    def _check_mode(self, value: int) -> None:
        if value & SYNC and not value & MM:
            raise FirmwareError(f"USART{self.number}: SPI slave mode is not modelled")
        if value & SYNC and value & SPB:
            raise FirmwareError(f"USART{self.number}: I²C mode is not modelled")

    def _write_format(self, name: str, value: int) -> None:
        self.bank[name].value = value
        if not self._ctl.value & SWRST:
            self._configure()

    def _write_rctl(self, value: int) -> None:
        if not value & RXERR:  # SLAU049: clearing RXERR clears all error bits
            value &= ~_ERRORS
        self._rctl.value = value

    def _configure(self) -> None:
        ssel = self._tctl.value >> 4 & 3
        if ssel == 0:
            raise FirmwareError(f"USART{self.number}: the external clock UCLKI is not modelled")
        clock = self._aclk if ssel == 1 else self._smclk
        if clock is not self._clock:
            if self._shifting:
                self._clock.users -= 1
                clock.users += 1
            self._clock = clock
        divider = self._divider()
        if self._ctl.value & SYNC:
            divider = max(2, divider)  # SLAU049, section 14.2.4: UxBR ≥ 2
            self._byte_ticks = (8 if self._ctl.value & CHAR else 7) * divider
        self._bit_fs = clock.span(divider)
        self._frame = None

    def _select_port(self) -> None:
        self._port = _LoopedSpiPort() if self._ctl.value & LISTEN else self._wired

    def _read_tctl(self) -> int:
        busy = self._shifting or self._tx_full or self._scheduler.now < self._frame_over_fs
        return self._tctl.value & ~TXEPT | (0 if busy else TXEPT)

    def _read_rx(self) -> int:
        """Read UxRXBUF: it clears URXIFG, RXERR and the error bits."""
        if self._streaming:
            self._break_stream()
        flag = self._rx_flag
        if flag.flags.value & flag.bit:
            flag.clear()
        self._unread = False
        if self._rctl.value & _ERRORS:
            self._rctl.value &= ~_ERRORS
        return self._rxbuf.value

    def _write_tx(self, value: int) -> None:
        if self._streaming:
            self._break_stream()
        self._txbuf.value = value
        self._tx_full = True
        flag = self._tx_flag
        if flag.flags.value & flag.bit:
            flag.clear()
        if not self._shifting and not self._ctl.value & SWRST:
            self._start()

    # --- shifting ---------------------------------------------------------------------

    def _start(self) -> None:
        """Begin with an idle shift register, at the next tick of BRCLK."""
        if not self._ctl.value & SYNC:
            self._start_uart()
        elif self._me.value & self._rx_flag.bit:  # USPIEx
            self._shifting = True
            self._clock.users += 1
            self._action = self._spi_over
            self._due_tick = self._clock.ticks(self._scheduler.now) + 1
            receive = self._triggers[self._rx_trigger]
            transmit = self._triggers[self._tx_trigger]
            if receive is None or transmit is None or not self._open_stream(receive, transmit):
                self._load()

    def _open_stream(self, receive: Trigger, transmit: Trigger) -> bool:
        """Begin to stream what two DMA channels carry, if that is all they do; else False."""
        raise NotImplementedError

    def _break_stream(self) -> None:
        """Go on a byte at a time, in the middle of the byte that is under way."""
        raise NotImplementedError

    # --- a byte at a time -----------------------------------------------------------------

    def _load(self) -> None:
        """Move UxTXBUF to the shift register of the SPI and start the clock."""
        self._tx_full = False
        tick = self._due_tick + self._byte_ticks
        self._due_tick = tick
        self._port.begin(self._txbuf.value, self._bit_fs)
        self._event = self._scheduler.at(self._clock.edge(tick), self._spi_over)
        flag = self._tx_flag
        trigger = self._triggers[self._tx_trigger]
        if trigger is not None and not flag.enables.value & flag.bit:
            trigger()  # DMA refills the buffer in the same instant: UTXIFG never stands
        else:
            flag.set()

    def _spi_over(self) -> None:
        """End of the eighth bit period: take what came back, go on if there is more."""
        self._event = None
        self.bytes_shifted += 1
        received = self._port.end()
        flag = self._rx_flag
        trigger = self._triggers[self._rx_trigger]
        if trigger is not None and not self._unread and not flag.enables.value & flag.bit:
            self._rxbuf.value = received
            trigger()  # DMA reads the buffer in the same instant: URXIFG never stands
        else:
            self._received(received)
        if self._tx_full:
            self._load()
        else:
            self._shifting = False
            self._clock.users -= 1

    def _received(self, byte: int) -> None:
        """Fill UxRXBUF and set URXIFG; what was not read is overrun."""
        if self._unread:
            self._rctl.value |= OE | RXERR
        self._rxbuf.value = byte
        self._unread = True
        flag = self._rx_flag
        if flag.flags.value & flag.bit:
            return
        flag.set()

    def _rx_rose(self) -> None:
        trigger = self._triggers[self._rx_trigger]
        if trigger is not None:
            trigger()

    def _tx_rose(self) -> None:
        trigger = self._triggers[self._tx_trigger]
        if trigger is not None:
            trigger()

    # --- UART -------------------------------------------------------------------------

    def _frame_ticks(self) -> tuple[int, int]:
        """Return BRCLK ticks of a frame up to the middle of its (last) stop bit, and to its end.

        SLAU049, section 13.2.6: bit i takes UxBR + m_i ticks, where m is UxMCTL from its least
        significant bit, repeated, beginning with the start bit.
        """
        control, modulation, divider = self._ctl.value, self._mctl.value, self._divider()
        bits = 1 + (8 if control & CHAR else 7) + bool(control & PENA) + (2 if control & SPB else 1)
        ticks = [divider + (modulation >> i % 8 & 1) for i in range(bits)]
        return sum(ticks[:-1]) + ticks[-1] // 2, sum(ticks)

    def _start_uart(self) -> None:
        if not self._me.value & self._tx_flag.bit:  # UTXEx
            return
        if self._frame is None:
            self._frame = self._frame_ticks()
        clock, now = self._clock, self._scheduler.now
        # A character starts at a bit boundary: after the frame before, or at the next tick.
        start = max(self._start_tick, clock.ticks(now) + 1)
        self._shifting = True
        clock.users += 1
        self._action = self._uart_stop_bit
        self._load_uart(start)

    def _load_uart(self, start_tick: int) -> None:
        assert self._frame is not None
        middle, whole = self._frame
        self._tx_full = False
        self._shift = self._txbuf.value & (0xFF if self._ctl.value & CHAR else 0x7F)
        self._due_tick = start_tick + middle
        self._start_tick = start_tick + whole  # of a character that would follow at once
        self._event = self._scheduler.at(self._clock.edge(self._due_tick), self._uart_stop_bit)
        self._tx_flag.set()

    def _uart_stop_bit(self) -> None:
        """Middle of the stop bit: the character has arrived; the next follows without a gap."""
        self._event = None
        self.bytes_shifted += 1
        character = self._shift
        self._frame_over_fs = self._clock.edge(self._start_tick)
        if self._tx_full:
            if self._frame is None:
                self._frame = self._frame_ticks()
            self._load_uart(self._start_tick)
        else:
            self._shifting = False
            self._clock.users -= 1
        for listener in self._listeners:
            listener(character)
        if self._ctl.value & LISTEN:
            self.uart_receive(character)

    # --- clocks and resets ------------------------------------------------------------

    def _clock_changed(self) -> None:
        """Move the event of the byte under way: its ticks stand, their times have moved."""
        if not self._ctl.value & SWRST:
            self._bit_fs = self._clock.span(max(1, self._divider()))
        if self._event is not None:
            self._scheduler.cancel(self._event)
            due = max(self._clock.edge(self._due_tick), self._scheduler.now)
            if due < FOREVER_FS:
                self._event = self._scheduler.at(due, self._action)
            else:
                self._event = self._scheduler.at(FOREVER_FS, self._action)

    def _stop(self) -> None:
        if self._streaming:
            self._break_stream()
        self._scheduler.cancel(self._event)
        self._event = None
        if self._shifting:
            self._shifting = False
            self._clock.users -= 1
        self._tx_full = self._unread = False
        self._start_tick = 0
        self._frame_over_fs = 0
