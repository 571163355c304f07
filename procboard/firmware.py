"""`main` of the mote's firmware: what runs at every release from reset, for robot and base station.

RAM is lost at a reset, so every controller is made anew. The order of the boot: clock, alarms,
buses, flash log, radio, application, link; then the watchdog, which a heartbeat feeds from then on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from firmware_model.msp430.mcu import Msp430F1611
from procboard.alarms import Alarms
from procboard.applications.services import Application, Hooks, Services
from procboard.boot_count import count_boot
from procboard.clock import calibrate_dco
from procboard.coroutines import Firmware, Lock
from procboard.drivers.cc2420 import Cc2420Driver
from procboard.drivers.m25p80 import M25P80Driver
from procboard.drivers.sfd_capture import SfdCapture
from procboard.drivers.spi import BUFFER_BYTES as SPI_BUFFER_BYTES
from procboard.drivers.spi import DmaPair, SpiMaster
from procboard.drivers.spi_bus0 import SpiBus0, SpiChip
from procboard.drivers.uart import REST, RING_OCTETS, Uart
from procboard.errors import ProcConfigError
from procboard.flash_regions import FlashRegion
from procboard.link import LinkController
from procboard.network import Network, NetworkConfig
from procboard.routing.config import RoutingConfig
from procboard.routing.controller import Routing
from procboard.storage import LogConfig
from procboard.storage_controller import StorageController
from radio_802154.timing import MAX_PSDU_OCTETS
from radio_802154.tinyos_serial import BAUD
from spi_bus.frame import MAX_STUFFED_BYTES
from spi_bus.link import LinkConfig

BUS0_DIVIDER: Final = 2
"""SMCLK / 2 = 2.1 MHz, the fastest of USART0 (SLAU049F, section 14.2.4)."""
BUS1_DIVIDER: Final = 16
"""SMCLK / 16 = 262 kHz: a byte in 30.5 µs, which the slave takes in an interrupt each."""

# P4: CC2420 CSn .2, flash S# .4, VREG_EN .5, RESETn .6, HOLD# .7; P5: LEDs .4 to .6; P2: link .3.
_P4_HIGH, _P4_OUTPUTS = 0x04 | 0x10 | 0x80, 0x04 | 0x10 | 0x20 | 0x40 | 0x80
_P5_LEDS: Final = 0x70
_P2_SELECT: Final = 0x08
_RED: Final = 0x10
_P3_SPI0, _P5_SPI1 = 0x0E, 0x0E  # SIMO, SOMI, UCLK

_WDT_HOLD: Final = 0x5A80
_WDT_ACLK_1S: Final = 0x5A00 | 0x0008 | 0x0004  # WDTPW, WDTCNTCL, WDTSSEL; 32768 periods
STACK_BYTES: Final = 768
"""One stack, as tasks are cooperative: the deepest call chain and a handler on top (estimate)."""
QUEUED_FRAME_BYTES: Final = 64
"""A queued radio message: TinyOS's message_t with 28 octets of payload and its metadata."""
QUEUED_MESSAGE_BYTES: Final = 40
"""A queued link message: the longest that the master sends, and what goes with it."""

HEARTBEAT_US: Final = 500_000
HEARTBEAT_CYCLES: Final = 15


LINK_CONFIG: Final = LinkConfig(window=8, ack_delay_us=120_000, retransmit_us=300_000)
"""Acknowledgements wait for the next report, ten of which come a second, and ride along."""


@dataclass(frozen=True, slots=True)
class FirmwareConfig:
    """What is compiled into a mote."""

    network: NetworkConfig
    with_robot: bool = True
    """Whether there are a navigation board and a log: a robot, not a base station."""
    log: LogConfig = field(default_factory=LogConfig)
    link: LinkConfig = LINK_CONFIG
    store_latency_s: float = 1.0
    """Longest time until a record is stored, flash erasing apart."""
    usb_queue: int = 0
    """Messages that may wait for the USB port; 0: the port is not used. It is the USART of a
    robot's link."""
    routing: RoutingConfig | None = None
    """The network layer; its sectors of the flash come after those of the log."""
    application_bytes: int = 0
    """RAM of the application, where it is more than the stack has room for."""

    def __post_init__(self) -> None:
        if self.usb_queue and self.with_robot:
            raise ProcConfigError("USART1 is the link's on a robot: no USB port there")
        if self.routing is not None and self.routing.base and self.with_robot:
            raise ProcConfigError("the root of the collection tree is a base station, not a robot")
        if not 0 < self.store_latency_s <= 60:
            raise ProcConfigError(f"store_latency_s = {self.store_latency_s}: 0 to 60 s")

    @property
    def flash_sectors(self) -> int:
        """Sectors of the flash that are used."""
        log = self.log.sector_count if self.with_robot else 0
        return log + (self.routing.sectors if self.routing is not None else 0)

    @property
    def ram_blocks(self) -> list[int]:
        """Bytes of RAM that a C program would have as stack and static arrays, a block each."""
        blocks = [
            STACK_BYTES,
            self.network.queue_limit * QUEUED_FRAME_BYTES + MAX_PSDU_OCTETS,
            self.usb_queue * QUEUED_FRAME_BYTES,
            self.application_bytes,
        ]
        if self.routing is not None:
            blocks.append(self.routing.ram_bytes(self.log.page_bytes) + QUEUED_FRAME_BYTES)
        if self.with_robot:
            blocks.append(self.log.buffer_bytes + self.log.page_bytes)
            blocks.append(self.link.queue_limit * QUEUED_MESSAGE_BYTES + MAX_STUFFED_BYTES)
        return blocks

    @property
    def ram_bytes(self) -> int:
        """Bytes of RAM that are taken in all, the drivers' buffers included."""
        drivers = [SPI_BUFFER_BYTES, SPI_BUFFER_BYTES, RING_OCTETS if self.usb_queue else 0]
        return sum(size + (size & 1) for size in (*self.ram_blocks, *drivers))


class MoteFirmware:
    """The program: call it with the MCU at every release from reset."""

    def __init__(self, config: FirmwareConfig, application: Application, hooks: Hooks) -> None:
        self.config = config
        self.application = application
        self.hooks = hooks
        self.services: Services | None = None
        """Controllers of the present boot once it is complete; None before."""
        self.driver: Cc2420Driver | None = None
        self.on_services: Callable[[Services], None] | None = None
        """Called with the controllers of each boot before the application starts, for traces."""

    def __call__(self, mcu: Msp430F1611) -> None:
        """Reset vector."""
        self.services = None
        reg = mcu.reg
        reg["WDTCTL"].write(_WDT_HOLD)
        reg["P4OUT"].write(_P4_HIGH)
        reg["P4DIR"].write(_P4_OUTPUTS)
        reg["P5OUT"].write(_P5_LEDS & ~_RED)  # LEDs are lit by a low level: red while booting
        reg["P5DIR"].write(_P5_LEDS)
        reg["P2OUT"].write(_P2_SELECT)
        reg["P2DIR"].write(_P2_SELECT)
        reg["P3SEL"].write(_P3_SPI0)
        reg["P5SEL"].write(_P5_SPI1)
        mcu.interrupts.gie = True
        mcu.cpu.spawn("boot", self._boot(mcu))

    def _boot(self, mcu: Msp430F1611) -> Firmware[None]:
        config = self.config
        yield from calibrate_dco(mcu)
        alarms = Alarms(mcu)
        alarms.start()
        dma = DmaPair(mcu, REST) if config.usb_queue else DmaPair(mcu)
        dma.start()
        master0 = SpiMaster(mcu, 0, BUS0_DIVIDER, dma)
        master0.start()
        bus0 = SpiBus0(master0)
        output4 = mcu.reg["P4OUT"]
        self._reserve_ram(mcu)
        boot = yield from count_boot(mcu)
        link: LinkController | None = None
        storage: StorageController | None = None
        flash = M25P80Driver(SpiChip(bus0, output4, 0x10), alarms.sleep_us)
        flash_lock = Lock("flash free")
        if config.with_robot:
            shared = config.routing is not None
            storage = StorageController(
                mcu.cpu,
                alarms,
                FlashRegion(flash, flash_lock, 0) if shared else flash,
                config.log,
                config.store_latency_s,
                self.hooks.stored,
            )
            yield from storage.start()
            master1 = SpiMaster(mcu, 1, BUS1_DIVIDER, dma)
            master1.start()
            link = LinkController(mcu, master1, alarms)
            link.open(boot, config.link)
        usb: Uart | None = None
        if config.usb_queue:
            usb = Uart(mcu, BAUD)
            usb.start()
        self.driver = driver = Cc2420Driver(mcu, SpiChip(bus0, output4, 0x04), alarms.sleep_us)
        sfd = SfdCapture(mcu, alarms) if config.routing is not None else None
        network = Network(mcu, driver, alarms, config.network, sfd)
        yield from network.start(boot)
        routing: Routing | None = None
        if config.routing is not None:
            records, items = self._routing_logs(mcu, alarms, flash, flash_lock, config.routing)
            yield from records.start()
            yield from items.start()
            routing = Routing(mcu.cpu, alarms, network, boot, config.routing, records, items)
        services = Services(mcu.cpu, alarms, network, boot, self.hooks, link, storage, usb, routing)
        if self.on_services is not None:
            self.on_services(services)
        self.application.start(services)
        if link is not None:
            link.start()  # not before every handler is there: what is acknowledged is dealt with
        if routing is not None:
            routing.start()
        self.services = services
        mcu.reg["P5OUT"].set_bits(_RED)
        mcu.cpu.spawn("heartbeat", self._heartbeat(mcu, alarms))
        self.hooks.booted(boot)

    def _routing_logs(
        self,
        mcu: Msp430F1611,
        alarms: Alarms,
        flash: M25P80Driver,
        lock: Lock,
        routing: RoutingConfig,
    ) -> list[StorageController]:
        """Return the logs of records and of items, on the sectors after the robot's log."""
        config = self.config
        sector = config.log.sector_count if config.with_robot else 0
        logs = []
        for log in (routing.record_log(config.log), routing.item_log(config.log)):
            region = FlashRegion(flash, lock, sector * log.sector_bytes)
            logs.append(
                StorageController(
                    mcu.cpu, alarms, region, log, config.store_latency_s, lambda _last: None
                )
            )
            sector += log.sector_count
        return logs

    def _reserve_ram(self, mcu: Msp430F1611) -> None:
        """Take from the 10 KiB what a C program would have as static arrays.

        Python keeps the contents elsewhere, but a configuration that no mote could hold fails here.
        """
        for size in self.config.ram_blocks:
            mcu.ram.allocate(size)

    def _heartbeat(self, mcu: Msp430F1611, alarms: Alarms) -> Firmware[None]:
        """Feed the watchdog: it runs out when tasks no longer get their turn."""
        watchdog = mcu.reg["WDTCTL"]
        while True:
            watchdog.write(_WDT_ACLK_1S)
            yield HEARTBEAT_CYCLES
            yield from alarms.sleep_us(HEARTBEAT_US)
