"""The processing board of a robot and the mote of the base station, ready for a bench.

Both are a TelosB with firmware; they differ in what hangs on it. Trace channels are named after the
board, values are numbers, bytes and tuples of them, so that every view can read them.
"""

from __future__ import annotations

from dataclasses import asdict, astuple, dataclass, field
from typing import Any

from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.signals import Signal
from firmware_model.trace import Trace
from firmware_model.wires import SpiPort
from procboard.applications.base_station import BaseStationApp
from procboard.applications.services import Application, Hooks, Services
from procboard.applications.survey import Survey
from procboard.applications.target_tracking import TargetTracking
from procboard.chips.m25p80 import FlashGeometry, FlashImage
from procboard.errors import ProcConfigError
from procboard.firmware import FirmwareConfig, MoteFirmware
from procboard.log_format import Record
from procboard.log_image import recover_records
from procboard.network import NetworkConfig, SendStatus
from procboard.routing.collection import RecordDelivered
from procboard.routing.config import RoutingConfig
from procboard.routing.stores import receipts
from procboard.storage_controller import StorageController
from procboard.telosb import TelosB
from radio_802154 import messages
from radio_802154.air import Air
from radio_802154.messages import CommandReply
from spi_bus.link import Event, Link, LinkError, LinkUp, PeerReset
from spi_bus.messages import CommandApplied


@dataclass(frozen=True, slots=True)
class MoteHardware:
    """What differs from mote to mote."""

    crystal_drift_ppm: float = 0.0
    dco_factor: float = 1.0
    flash_geometry: FlashGeometry = field(default_factory=FlashGeometry)


class Mote:
    """What all have: a TelosB, its firmware, its trace of radio traffic."""

    def __init__(
        self,
        scheduler: Scheduler,
        trace: Trace,
        rail: Rail,
        air: Air,
        config: FirmwareConfig,
        application: Application,
        name: str,
        seed: int,
        flash_image: FlashImage | None,
        hardware: MoteHardware,
    ) -> None:
        self.name = name
        self.scheduler = scheduler
        self.hooks = Hooks(booted=self._booted, sent=self._sent, received=self._received)
        self.firmware = MoteFirmware(config, application, self.hooks)
        self._boots = trace.channel(f"{name}.boot")
        self._radio_sent = trace.channel(f"{name}.radio.sent")
        self._radio_received = trace.channel(f"{name}.radio.received")
        self.boot_number = 0
        """Number of the last complete boot, from information flash; 0 before the first."""
        self.sent_messages = 0
        self.received_messages = 0
        self.mote = TelosB(
            scheduler,
            rail,
            air,
            self.firmware,
            name,
            seed,
            flash_image,
            hardware.crystal_drift_ppm,
            hardware.dco_factor,
            hardware.flash_geometry,
        )

    @property
    def services(self) -> Services | None:
        """Controllers of the present boot; None until it is complete."""
        return self.firmware.services

    def _booted(self, number: int) -> None:
        self.boot_number = number
        self._boots.record(self.scheduler.now, number)

    def _sent(self, destination: int, message: object, status: SendStatus) -> None:
        self.sent_messages += status in (SendStatus.ACKNOWLEDGED, SendStatus.SENT)
        am_type, payload = messages.encode(message)
        self._radio_sent.record(self.scheduler.now, (destination, am_type, payload, status.value))

    def _received(self, source: int, message: object) -> None:
        self.received_messages += 1
        am_type, payload = messages.encode(message)
        self._radio_received.record(self.scheduler.now, (source, am_type, payload))

    def _mote_statistics(self) -> dict[str, Any]:
        services = self.services
        return {
            "boots": self.boot_number,
            "last_reset": self.mote.mcu.last_reset,
            "cpu_busy_cycles": self.mote.mcu.cpu.busy_cycles,
            "interrupts": self.mote.mcu.cpu.interrupts_taken,
            "radio_messages_sent": self.sent_messages,
            "radio_messages_received": self.received_messages,
            "network": asdict(services.network.statistics) if services else {},
        }


class ProcBoard(Mote):
    """The robot's processing board.

    Args:
        scheduler, trace: the run's.
        rail: the board's 3 V supply; cutting it resets the board, contents of flash stay.
        air: the medium, in which an antenna called `name` has been placed.
        config: addresses, log, link.
        application: `OpenLoop`, `HeadingControl` or another.
        name: prefix of trace channels, power consumers and the antenna's name.
        seed: of what chance does to the flash when its supply is cut.
        flash_image: contents of the serial flash; blank where None.
        hardware: this mote's deviations.

    Wire `connect_link(port)` and drive `data_ready`; `link_select` is the chip select (low active).

    Trace channels, records (time in fs, value):
        NAME.boot              boot number
        NAME.samples           payload bytes of a link message received (`LINK_MESSAGES.decode`)
        NAME.appended          (record number, payload bytes): waits in RAM
        NAME.stored            record number: all up to it are stored
        NAME.commands          (command id, status) answered to the base station
        NAME.tail_beat         (command id, bias_rad, amplitude_rad, frequency_hz, valid_for_s)
        NAME.control           (heading error, bias) in rad
        NAME.tracking          of `TargetTracking` only: ("target", number, x_m, y_m): pursued from
                               now on; ("reached", number, x_m, y_m); ("mode", name);
                               ("pose lost",): it stops; ("pose found",). Of `Survey`: these but
                               the first two; ("goal", row, column, x_m, y_m); ("rest",);
                               ("sample", record, row, column, value, deviation); ("phase", name)
        NAME.link              name of a link event, with its numbers
        NAME.radio.sent        (destination, AM type, payload, outcome)
        NAME.radio.received    (source, AM type, payload)

    """

    def __init__(
        self,
        scheduler: Scheduler,
        trace: Trace,
        rail: Rail,
        air: Air,
        config: FirmwareConfig,
        application: Application,
        name: str = "proc",
        seed: int = 0,
        flash_image: FlashImage | None = None,
        hardware: MoteHardware | None = None,
    ) -> None:
        hardware = hardware or MoteHardware()
        log, flash = config.log, hardware.flash_geometry
        if (log.sector_bytes, log.page_bytes) != (flash.sector_bytes, flash.page_bytes) or (
            config.flash_sectors > flash.sector_count
        ):
            raise ProcConfigError(
                f"log of {config.flash_sectors} sectors of {log.sector_bytes} bytes: the flash has "
                f"{flash.sector_count} of {flash.sector_bytes}"
            )
        super().__init__(
            scheduler, trace, rail, air, config, application, name, seed, flash_image, hardware
        )
        self.samples_received = 0
        """Sensor, GPS and event reports that came over the link, over all boots."""
        self.samples_stored = 0
        """Records reported as stored, over all boots."""
        self.samples_lost = 0
        """Records that former boots did not store though a flash was there: full or failed."""
        self.mounts: list[tuple[int, int]] = []
        """Of every boot: when its log was mounted, and how many records it found."""
        self.links: list[Link] = []
        """The link of every boot, for its counters."""
        self._samples = trace.channel(f"{name}.samples")
        self._appended = trace.channel(f"{name}.appended")
        self._stored = trace.channel(f"{name}.stored")
        self._commands = trace.channel(f"{name}.commands")
        self._tail_beat = trace.channel(f"{name}.tail_beat")
        self._control = trace.channel(f"{name}.control")
        self._link = trace.channel(f"{name}.link")
        self._last_stored = -1
        self._storage: StorageController | None = None
        self.hooks.sample = self._on_sample
        self.hooks.appended = self._on_appended
        self.hooks.stored = self._on_stored
        self.hooks.command = self._on_command
        self.hooks.tail_beat = self._on_tail_beat
        self.hooks.control = self._on_control
        if isinstance(application, TargetTracking | Survey):
            # only of these: a channel would change others' trace hash
            self._tracking = trace.channel(f"{name}.tracking")
            self.hooks.tracking = self._on_tracking
        self.firmware.on_services = self._watch_services

    # --- wiring -------------------------------------------------------------------------

    def connect_link(self, port: SpiPort) -> None:
        """Wire USART1 to the bus that leads to the navigation board."""
        self.mote.mcu.usart1.connect_spi(port)

    @property
    def data_ready(self) -> Signal[bool]:
        """Input P2.0: the navigation board has something to say."""
        return self.mote.data_ready

    @property
    def link_select(self) -> Signal[bool]:
        """Output P2.3: chip select of the link, active low."""
        return self.mote.link_select

    # --- what is to be seen -------------------------------------------------------------

    @property
    def flash_image(self) -> FlashImage:
        """Contents of the serial flash: keep them, and a later board finds its log again."""
        return self.mote.flash_image

    def stored_records(self) -> list[Record]:
        """Return the records that mounting the flash as it is now would find."""
        return recover_records(bytes(self.flash_image.memory), self.firmware.config.log)

    def statistics(self) -> dict[str, Any]:
        """Return counters, for a summary."""
        services = self.services
        result = self._mote_statistics()
        result.update(
            samples_received=self.samples_received,
            samples_stored=self.samples_stored,
            samples_lost=self._lost(),
            flash_erase_counts=list(self.flash_image.erase_counts),
            flash_programs=self.mote.flash.programs,
            link={},
            storage={},
        )
        if services is not None and services.link is not None and services.storage is not None:
            result["link"] = asdict(services.link.link.statistics)
            result["link"]["exchanges"] = services.link.exchanges
            result["link"]["bytes_clocked"] = services.link.bytes_clocked
            result["storage"] = asdict(services.storage.log.statistics)
            result["storage"]["failure"] = services.storage.failure
        return result

    def _lost(self) -> int:
        return self.samples_lost + (self._storage.lost if self._storage is not None else 0)

    def _watch_services(self, services: Services) -> None:
        if services.link is not None:
            services.link.on_event = self._on_link_event
            self.links.append(services.link.link)
        if self._storage is not None:
            self.samples_lost += self._storage.lost  # of the boot before
        self._storage = services.storage
        if services.storage is not None:
            self._last_stored = services.storage.log.stored_sequence
            self.mounts.append((self.scheduler.now, services.storage.stored))

    def _on_sample(self, message: object, payload: bytes) -> None:
        self.samples_received += not isinstance(message, CommandApplied)
        self._samples.record(self.scheduler.now, payload)

    def _on_appended(self, number: int, payload: bytes) -> None:
        self._appended.record(self.scheduler.now, (number, payload))

    def _on_stored(self, number: int) -> None:
        self.samples_stored += number - self._last_stored
        self._last_stored = number
        self._stored.record(self.scheduler.now, number)

    def _on_command(self, reply: CommandReply) -> None:
        self._commands.record(self.scheduler.now, (reply.command_id, int(reply.status)))

    def _on_tail_beat(self, command: Any) -> None:
        self._tail_beat.record(self.scheduler.now, astuple(command))

    def _on_control(self, error_rad: float, bias_rad: float) -> None:
        self._control.record(self.scheduler.now, (error_rad, bias_rad))

    def _on_tracking(self, *values: str | int | float) -> None:
        self._tracking.record(self.scheduler.now, values)

    def _on_link_event(self, event: Event) -> None:
        now = self.scheduler.now
        if isinstance(event, LinkUp):
            self._link.record(now, ("LinkUp", event.peer_epoch))
        elif isinstance(event, PeerReset):
            self._link.record(now, ("PeerReset", event.peer_epoch, event.previous_epoch))
        elif isinstance(event, LinkError):
            self._link.record(now, ("LinkError", str(event.kind), event.count))


class BaseStation(Mote):
    """The mote on the PC: `app` has the host's side (`send_command`, `send_pose`, callbacks).

    Args: as `ProcBoard`; `network` is its radio configuration, `routing` makes it the root of the
    collection tree.

    Trace channels: NAME.boot, NAME.radio.sent, NAME.radio.received.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        trace: Trace,
        rail: Rail,
        air: Air,
        network: NetworkConfig,
        name: str = "base",
        seed: int = 0,
        hardware: MoteHardware | None = None,
        routing: RoutingConfig | None = None,
        flash_image: FlashImage | None = None,
    ) -> None:
        self.app = BaseStationApp()
        config = FirmwareConfig(network, with_robot=False, routing=routing)
        super().__init__(
            scheduler, trace, rail, air, config, self.app, name, seed, flash_image,
            hardware or MoteHardware(),
        )  # fmt: skip

    @property
    def flash_image(self) -> FlashImage:
        """Contents of the serial flash: keep them, and a later base goes on where this one was."""
        return self.mote.flash_image

    def collected(self) -> list[RecordDelivered]:
        """Return the records that are on the flash, in the order in which they came."""
        config = self.firmware.config
        if config.routing is None:
            return []
        log = config.routing.record_log(config.log)
        memory = bytes(self.flash_image.memory[: log.sector_count * log.sector_bytes])
        return [event for event, _, _ in receipts(iter(recover_records(memory, log)))]

    def statistics(self) -> dict[str, Any]:
        """Return counters, for a summary."""
        return self._mote_statistics()
