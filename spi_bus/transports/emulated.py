"""Emulated SPI wires between one master and one slave: SCK, MOSI, MISO, chip select, data ready.

A byte is two calls of the master: `begin` at its first clock edge, when the slave's shift register
is latched, and `end` at its last, when both have the other's byte. To a slave that works in words
of two bytes, both may go in one such pair of calls. Between them time passes as the master's clock
says; the bits in between follow from start and bit period and are drawn only where somebody looks
at a waveform. Bytes that follow each other without a gap are one trace record.

SPI mode 0, most significant bit first: SCK idles low, data are valid at rising edges. The k-th
rising edge of a byte (k from 0) is at start + k · period, the falling edge half a period later;
MOSI and MISO change with the falling edge before. Chip select is active low.

Bit errors strike both directions alike. The number of good bits to the next bad one is geometric,
so it is drawn once an error and a clean link pays a comparison a byte. The trace holds what
arrived, damage included: it is what a probe at the receiving pins would see.

Trace channels, for a wire named `spi`:

    spi.bytes   at the first edge of a run of bytes: (bit period in fs, MOSI bytes, MISO bytes);
                byte k of the run begins 8 k bit periods later
    spi.cs      level of the chip select pin: 0 while selected
    spi.ready   level of the data-ready pin: 1 while the slave has something to say
"""

from __future__ import annotations

from math import floor, log, log1p
from random import Random
from typing import Final, cast

from firmware_model.scheduler import Scheduler
from firmware_model.signals import Signal
from firmware_model.trace import Trace
from firmware_model.wires import SpiPairTarget, SpiTarget

__all__ = ["FLOATING", "SpiWires"]

FLOATING: Final = 0x00
"""What the master reads when nobody drives MISO: assumed pulled down, so it reads as filler."""

_NEVER: Final = 1 << 62  # bits: longer than any run
_BITS: Final = 16  # a byte each way


def _pair_target(target: SpiTarget | None) -> SpiPairTarget | None:
    return cast("SpiPairTarget", target) if hasattr(target, "takes_pairs") else None


class SpiWires:
    """One slave on its wires; to the master a `firmware_model.wires.SpiPort` with a chip select.

    Args:
        scheduler: tells the time of edges.
        target: the slave; called with what arrives. May be set later, by `connect`.
        trace: gets the three channels.
        name: prefix of the channels' names.
        bit_error_rate: probability that a bit arrives inverted, for each direction.
        rng: source of the errors; needed where `bit_error_rate` is or becomes positive.

    Raises:
        ValueError: a rate outside 0 to 0.5, or errors without an `rng`.

    """

    __slots__ = (
        "_busy",
        "_bytes",
        "_cs",
        "_gap",
        "_log_good",
        "_miso",
        "_mosi",
        "_pairs",
        "_period_fs",
        "_ready",
        "_rng",
        "_run_miso",
        "_run_mosi",
        "_scheduler",
        "_selected",
        "_start_fs",
        "_target",
        "bits_inverted",
        "bytes_transferred",
        "data_ready",
    )

    def __init__(
        self,
        scheduler: Scheduler,
        target: SpiTarget | None,
        trace: Trace,
        name: str = "spi",
        bit_error_rate: float = 0.0,
        rng: Random | None = None,
    ) -> None:
        self._scheduler = scheduler
        self._target = target
        self._pairs = _pair_target(target)
        self._run_mosi = bytearray()
        self._run_miso = bytearray()
        self._bytes = trace.channel(f"{name}.bytes").record
        self._cs = trace.channel(f"{name}.cs").record
        self._ready = trace.channel(f"{name}.ready").record
        self._rng = rng
        self._selected = False
        self._busy = False
        self._mosi = self._miso = self._period_fs = self._start_fs = 0
        self._log_good = 0.0
        self._gap = _NEVER
        self.bytes_transferred = 0
        """Bytes clocked while selected."""
        self.bits_inverted = 0
        """Bits that arrived inverted, both directions."""
        self.data_ready: Signal[bool] = Signal(f"{name}.ready", False)
        """Slave to master: driven by the slave, watched by the master."""
        self.data_ready.watch(self._record_ready)
        self.set_bit_error_rate(bit_error_rate)
        self._cs(scheduler.now, 1)
        self._ready(scheduler.now, 0)

    def connect(self, target: SpiTarget) -> None:
        """Put a slave on the wires, in place of the one before; it hears the chip select."""
        self._target = target
        self._pairs = _pair_target(target)
        self._busy = False
        target.select(self._selected)

    def set_bit_error_rate(self, rate: float) -> None:
        """Change the probability of a bad bit from the next bit on.

        Raises:
            ValueError: a rate outside 0 to 0.5, or errors without an `rng`.

        """
        if not 0 <= rate <= 0.5:
            raise ValueError(f"bit_error_rate = {rate} is outside 0 to 0.5")
        if rate and self._rng is None:
            raise ValueError(f"bit_error_rate = {rate} needs a random source")
        self._log_good = log1p(-rate)
        self._gap = self._draw() if rate else _NEVER

    def select(self, selected: bool) -> None:
        """Chip select changed; True is active. Releasing it within a byte loses that byte."""
        if selected == self._selected:
            return
        self._selected = selected
        self._busy = False
        self.settle()
        self._cs(self._scheduler.now, 0 if selected else 1)
        if self._target is not None:
            self._target.select(selected)

    def begin(self, mosi: int, bit_period_fs: int) -> None:
        """First clock edge of a byte: the slave's answer is latched."""
        if not self._selected or self._target is None:
            return
        self._busy = True
        self._edge(bit_period_fs)
        self._mosi = mosi
        self._miso = self._target.begin()

    def end(self) -> int:
        """Last clock edge: the slave gets its byte, the master takes what this returns."""
        if not self._busy or self._target is None:
            return FLOATING
        self._busy = False
        mosi, miso = self._mosi, self._miso
        if self._gap < _BITS:
            mosi, miso = self._damage(mosi, miso)
        else:
            self._gap -= _BITS
        self._run_mosi.append(mosi)
        self._run_miso.append(miso)
        self._target.end(mosi)
        return miso

    def takes_pairs(self) -> bool:
        """Return whether the slave stands at the beginning of a word of two bytes."""
        return self._selected and self._pairs is not None and self._pairs.takes_pairs()

    def begin_pair(self, mosi: int, bit_period_fs: int) -> None:
        """First clock edge of two bytes: the slave's answer to both is latched."""
        pairs = self._pairs
        if not self._selected or pairs is None:
            return
        self._busy = True
        self._edge(bit_period_fs)
        self._mosi = mosi
        self._miso = pairs.begin_pair()

    def end_pair(self) -> int:
        """Last clock edge of the second byte."""
        pairs = self._pairs
        if not self._busy or pairs is None:
            return FLOATING << 8 | FLOATING
        self._busy = False
        mosi, miso = self._mosi, self._miso
        if self._gap < 2 * _BITS:
            mosi, miso = self._damage_pair(mosi, miso)
        else:
            self._gap -= 2 * _BITS
        self._run_mosi += mosi.to_bytes(2, "big")
        self._run_miso += miso.to_bytes(2, "big")
        pairs.end_pair(mosi)
        return miso

    def split_pair(self, first_is_over: bool) -> int:
        """Go on with `end` for the byte of a pair that is under way."""
        target = self._target
        if not self._busy or target is None:
            return FLOATING
        mosi, miso = self._mosi, self._miso
        self._mosi, self._miso = mosi >> 8, miso >> 8
        if not first_is_over:
            return FLOATING
        first = self.end()
        self._busy = True
        self._mosi = mosi & 0xFF
        self._miso = target.begin()
        return first

    def settle(self) -> None:
        """Record the run of bytes that is under way: it is over, or somebody wants to see it."""
        run = self._run_mosi
        if run:
            self.bytes_transferred += len(run)
            self._bytes(self._start_fs, (self._period_fs, bytes(run), bytes(self._run_miso)))
            self._start_fs += len(run) * 8 * self._period_fs
            run.clear()
            self._run_miso.clear()

    def _edge(self, bit_period_fs: int) -> None:
        """Begin a byte: it belongs to the run before it if there is no gap."""
        now = self._scheduler.now
        period_fs = self._period_fs
        gap_fs = now - self._start_fs - len(self._run_mosi) * 8 * period_fs
        if bit_period_fs != period_fs or not -period_fs < 16 * gap_fs < period_fs:
            self.settle()
            self._start_fs = now
            self._period_fs = bit_period_fs

    def _damage_pair(self, mosi: int, miso: int) -> tuple[int, int]:
        damaged = []
        for byte in ((mosi >> 8, miso >> 8), (mosi & 0xFF, miso & 0xFF)):
            if self._gap < _BITS:
                damaged.append(self._damage(*byte))
            else:
                self._gap -= _BITS
                damaged.append(byte)
        (mosi_1, miso_1), (mosi_2, miso_2) = damaged
        return mosi_1 << 8 | mosi_2, miso_1 << 8 | miso_2

    def _damage(self, mosi: int, miso: int) -> tuple[int, int]:
        word = mosi << 8 | miso
        gap = self._gap
        while gap < _BITS:
            word ^= 0x8000 >> gap
            self.bits_inverted += 1
            gap += 1 + self._draw()
        self._gap = gap - _BITS
        return word >> 8, word & 0xFF

    def _draw(self) -> int:
        # Good bits before the next bad one: P(n) = (1 - p)^n p, by inversion.
        assert self._rng is not None  # set_bit_error_rate saw to it
        return floor(log(1.0 - self._rng.random()) / self._log_good)

    def _record_ready(self, ready: bool) -> None:
        self._ready(self._scheduler.now, int(ready))
