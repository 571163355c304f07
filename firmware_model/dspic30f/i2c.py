"""I²C master: an operation is computed when firmware starts it, done when its bits are over.

The target hears an operation at its first bit, a few microseconds early; status bits change when
its last bit is over. They are computed when firmware looks, so that a driver which waits for the
known time of a byte costs no event. An event is made only if the interrupt is enabled. SCL comes
from I2CBRG: bit time = (I2CBRG + 1) TCY + 1 / 1 111 111 Hz (DS70046, equation 21-1).
"""

from __future__ import annotations

from firmware_model.dspic30f.errors import LimitError, UnsupportedModeError
from firmware_model.interrupts import InterruptLine
from firmware_model.registers import Register, RegisterBank, RegisterSpec
from firmware_model.scheduler import Event, Scheduler
from firmware_model.time import Clock
from firmware_model.wires import I2cBus

I2CEN = 1 << 15
A10M = 1 << 10
ACKDT = 1 << 5
ACKEN = 1 << 4
RCEN = 1 << 3
PEN = 1 << 2
RSEN = 1 << 1
SEN = 1 << 0
_OPERATIONS = ACKEN | RCEN | PEN | RSEN | SEN

ACKSTAT = 1 << 15
TRSTAT = 1 << 14
IWCOL = 1 << 7
I2COV = 1 << 6
P = 1 << 4
S = 1 << 3
RBF = 1 << 1
TBF = 1 << 0

PULSE_GOBBLER_FS = 900_000_090  # 1 / 1 111 111 Hz
MAX_SCL_HZ = 400_000

# DS70143, table 15-1 (I2C register map).
I2C_REGISTERS = (
    RegisterSpec("I2CRCV", 0x0200, writable=0),
    RegisterSpec("I2CTRN", 0x0202, reset=0x00FF, writable=0x00FF),
    RegisterSpec("I2CBRG", 0x0204, writable=0x01FF),
    RegisterSpec("I2CCON", 0x0206, reset=0x1000, writable=0xBFFF),
    RegisterSpec("I2CSTAT", 0x0208, writable=0x00C0),
    RegisterSpec("I2CADD", 0x020A, writable=0x03FF),
)


class I2cMaster:
    """The I²C module as a single master; `bus` is what its two wires lead to."""

    def __init__(
        self, scheduler: Scheduler, clock: Clock, line: InterruptLine, enables: Register
    ) -> None:
        self.bank = RegisterBank(
            I2C_REGISTERS,
            on_read={
                "I2CRCV": self._read_receive,
                "I2CCON": self._read_control,
                "I2CSTAT": self._read_status,
            },
            on_write={
                "I2CBRG": self._write_rate,
                "I2CTRN": self._write_transmit,
                "I2CCON": self._write_control,
            },
        )
        self.bus = I2cBus(())
        self._scheduler = scheduler
        self._clock = clock
        self._line = line
        self._enables = enables  # IECx of the interrupt
        self._enable_bit = 1 << line.number % 16
        self._receive = self.bank["I2CRCV"]
        self._transmit = self.bank["I2CTRN"]
        self._brg = self.bank["I2CBRG"]
        self._control = self.bank["I2CCON"]
        self._status = self.bank["I2CSTAT"]
        self._done_fs: int | None = None  # end of the operation under way
        # What the operation under way leaves behind at its end:
        self._keep = -1  # bits of I2CCON that stay
        self._clears = 0  # bits of I2CSTAT that go …
        self._sets = 0  # … and that come
        self._incoming: int | None = None  # a byte for I2CRCV
        self._address_next = False  # a start was sent: the next byte is an address
        self._event: Event | None = None
        self.bit_fs = 0
        """Length of a bit on the bus."""
        self._write_rate(0)

    def _write_rate(self, value: int) -> None:
        self._brg.value = value
        self.bit_fs = self._clock.span(value + 1) + PULSE_GOBBLER_FS
        self._too_fast = self.bit_fs * MAX_SCL_HZ < 99 * 10**13  # 1 % beyond 400 kHz

    def reset(self) -> None:
        """Let go of the bus."""
        self._scheduler.cancel(self._event)
        self._event = None
        self._done_fs = self._incoming = None
        self._address_next = False
        self.bus.stop()
        self.bank.reset()
        self._write_rate(0)

    def settle(self) -> None:
        """Bring flags up to date: an operation whose time is over is done."""
        done = self._done_fs
        if done is not None and self._scheduler.now >= done:
            self._done_fs = None
            self._control.value &= self._keep
            status = self._status
            sets = self._sets
            if (incoming := self._incoming) is not None:
                self._incoming = None
                if status.value & RBF:
                    sets = I2COV
                else:
                    self._receive.value = incoming
            status.value = status.value & ~self._clears | sets
            if not self._line.pending:
                self._line.request()

    # --- registers -------------------------------------------------------------------

    def _read_status(self) -> int:
        if self._done_fs is not None:
            self.settle()
        return self._status.value

    def _read_control(self) -> int:
        if self._done_fs is not None:
            self.settle()
        return self._control.value

    def _read_receive(self) -> int:
        if self._done_fs is not None:
            self.settle()
        self._status.value &= ~RBF
        return self._receive.value

    def _write_control(self, value: int) -> None:
        if self._done_fs is not None:
            self.settle()
        if value & A10M:
            raise UnsupportedModeError("I2C: 10-bit addresses are left out")
        control = self._control
        old = control.value
        if self._done_fs is not None:
            value = (value & ~_OPERATIONS) | (old & _OPERATIONS)  # busy: no new operation
        control.value = value
        if not value & I2CEN:
            self._done_fs = self._incoming = None
            return
        started = value & ~old & _OPERATIONS
        if not started:
            return
        if started & RCEN:
            self._incoming = self.bus.read()
            self._begin(8, RCEN, 0, RBF)
        elif started & ACKEN:
            self._begin(1, ACKEN, 0, 0)
        elif started & SEN:
            self._address_next = True
            self._begin(1, SEN, P, S)
        elif started & RSEN:
            self._address_next = True
            self._begin(1, RSEN, 0, 0)
        else:
            self.bus.stop()
            self._begin(1, PEN, S, P)

    def _write_transmit(self, value: int) -> None:
        if self._done_fs is not None:
            self.settle()
        if not self._control.value & I2CEN:
            return
        if self._done_fs is not None:
            self._status.value |= IWCOL
            return
        self._transmit.value = value
        self._status.value |= TBF | TRSTAT
        if self._address_next:
            self._address_next = False
            acknowledged = self.bus.start(value >> 1, bool(value & 1))
        else:
            acknowledged = self.bus.write(value)
        self._begin(9, 0, TBF | TRSTAT | ACKSTAT, 0 if acknowledged else ACKSTAT)

    # --- operations ------------------------------------------------------------------

    def _begin(self, bits: int, request: int, clears: int, sets: int) -> None:
        """Start an operation of so many bits.

        At its end the hardware clears `request` in I2CCON, `clears` in I2CSTAT, and sets `sets`.
        """
        if self._too_fast:
            raise LimitError(f"I2C: SCL at {10**15 / self.bit_fs:.0f} Hz is beyond 400 kHz")
        self._keep = ~request
        self._clears = clears
        self._sets = sets
        self._done_fs = done = self._scheduler.now + bits * self.bit_fs
        if self._enables.value & self._enable_bit:
            self._event = self._scheduler.at(done, self.settle)
