"""TelosB: an MSP430F1611, a CC2420 and an M25P80, wired as on the real mote.

Pins are those of the Tmote Sky data sheet (schematic, sheets 1 and 2), as TinyOS's
tos/platforms/telosa/hardware.h and HplStm25pPinsC name them. The expansion connector carries the
robot's link: USART1 as SPI, two general-purpose pins beside it.
"""

from __future__ import annotations

import random

from firmware_model.msp430.mcu import Firmware, Msp430F1611
from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.signals import Signal
from firmware_model.wires import SpiTarget
from procboard.chips.m25p80 import M25P80, FlashGeometry, FlashImage
from radio_802154.air import Air
from radio_802154.cc2420 import Cc2420


class SharedSpi:
    """SIMO0, SOMI0 and UCLK0: the byte goes to whichever chip is selected."""

    __slots__ = ("_miso", "_mosi", "_target", "contentions")

    def __init__(self) -> None:
        self._target: SpiTarget | None = None
        self._mosi = 0
        self._miso = 0xFF
        self.contentions = 0
        """Times that two chips were selected at once: they would fight over SOMI0."""

    def wire(self, target: SpiTarget, chip_select: Signal[bool]) -> None:
        """Put a chip on the bus, selected while `chip_select` is low."""

        def changed(level: bool) -> None:
            if not level:
                self.contentions += self._target is not None
                self._target = target
            elif self._target is target:
                self._target = None
            target.select(not level)

        chip_select.watch(changed)

    def begin(self, mosi: int, bit_period_fs: int) -> None:
        """First clock edge of a byte."""
        target = self._target
        self._mosi = mosi
        self._miso = 0xFF if target is None else target.begin()

    def end(self) -> int:
        """Last clock edge of a byte."""
        target = self._target
        if target is not None:
            target.end(self._mosi)
        return self._miso

    def takes_blocks(self) -> bool:
        """Whether the flash is selected: it answers the same whenever it is asked."""
        return isinstance(self._target, M25P80)

    def exchange_block(self, mosi: bytes) -> bytes:
        """Exchange bytes with the flash."""
        assert isinstance(self._target, M25P80)
        return self._target.exchange(mosi)


class TelosB:
    """The mote; `firmware` runs at every release from reset."""

    def __init__(
        self,
        scheduler: Scheduler,
        rail: Rail,
        air: Air,
        firmware: Firmware,
        name: str,
        seed: int,
        flash_image: FlashImage | None = None,
        crystal_drift_ppm: float = 0.0,
        dco_factor: float = 1.0,
        flash_geometry: FlashGeometry | None = None,
    ) -> None:
        self.name = name
        self.mcu = mcu = Msp430F1611(
            scheduler, rail, firmware, f"{name}.msp430", crystal_drift_ppm, dco_factor
        )
        self.radio = radio = Cc2420(scheduler, air, name, rail)
        self.flash = flash = M25P80(
            scheduler,
            rail,
            random.Random(f"{seed}/{name}/flash"),
            flash_image,
            flash_geometry,
            name="M25P80",
        )
        pins = {(p, b): mcu.ports[p].pins[b] for p in range(1, 7) for b in range(8)}
        bus = self.spi0 = SharedSpi()
        mcu.usart0.connect_spi(bus)  # P3.1 SIMO0, P3.2 SOMI0, P3.3 UCLK0

        # Pull-up resistors: nothing is selected, reset or held while the MCU is in reset.
        pins[4, 2].pull(True)  # CC2420 CSn
        pins[4, 4].pull(True)  # M25P80 S#
        pins[4, 6].pull(True)  # CC2420 RESETn
        pins[4, 7].pull(True)  # M25P80 HOLD#
        pins[2, 3].pull(True)  # chip select of the link

        # CC2420
        bus.wire(radio, pins[4, 2].output)
        pins[4, 5].output.watch(radio.vreg_en)
        pins[4, 6].output.watch(radio.resetn)
        radio.fifop.watch(pins[1, 0].input.set)
        radio.fifo.watch(pins[1, 3].input.set)
        radio.cca.watch(pins[1, 4].input.set)
        radio.sfd.watch(pins[4, 1].input.set)

        # M25P80
        bus.wire(flash, pins[4, 4].output)
        pins[4, 7].output.watch(lambda level: flash.hold(not level))

        # LEDs, lit when low
        self.leds = {
            "red": pins[5, 4].output,
            "green": pins[5, 5].output,
            "blue": pins[5, 6].output,
        }
        for bit in (4, 5, 6):
            pins[5, bit].pull(True)

        # Expansion connector: P5.1 SIMO1, P5.2 SOMI1, P5.3 UCLK1 (assumed to be brought out);
        # GIO0 is data-ready, GIO2 the link's chip select.
        self.data_ready = pins[2, 0].input
        self.link_select = pins[2, 3].output

    @property
    def flash_image(self) -> FlashImage:
        """Contents of the serial flash, which outlive everything."""
        return self.flash.image
