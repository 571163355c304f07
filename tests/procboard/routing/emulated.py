"""Boards of the tests: emulated motes with the network layer on the emulated medium.

In a row neighbours are 75 m apart: −90 dBm arrive. From the board after the next come −100 dBm,
less than the noise: it is neither heard nor, by who wants to send, noticed.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_MS
from firmware_model.trace import Trace
from procboard.applications.services import Hooks, Services
from procboard.chips.m25p80 import FlashGeometry, FlashImage
from procboard.firmware import FirmwareConfig, MoteFirmware
from procboard.log_image import recover_records
from procboard.network import NetworkConfig
from procboard.routing.collection import (
    LedgerAhead,
    NeighbourLost,
    ParentChanged,
    RecordDelivered,
    RecordsAcknowledged,
)
from procboard.routing.config import RoutingConfig
from procboard.routing.controller import Routing
from procboard.routing.duty import DutyConfig
from procboard.routing.sharing import ItemReceived
from procboard.routing.stores import receipts
from procboard.telosb import TelosB
from radio_802154 import mac
from radio_802154.medium import Antenna, Medium, MediumConfig, constant
from radio_802154.tinyos import from_frame

SPACING_M = 75.0
BASE = 0


class App:
    """Notes what it hears, and does what the test asks it to."""

    def __init__(self, mote: Mote) -> None:
        self.mote = mote
        self.events: list[Any] = []
        """Of the present boot."""
        self.delivered: list[RecordDelivered] = []
        """Of all boots."""

    def start(self, services: Services) -> None:
        self.services = services
        self.events = []
        routing = services.routing
        assert routing is not None
        for kind in (
            RecordDelivered, RecordsAcknowledged, LedgerAhead, NeighbourLost, ParentChanged,
            ItemReceived,
        ):  # fmt: skip
            routing.on(kind, self._note)

    def _note(self, event: Any) -> Any:
        self.events.append(event)
        if isinstance(event, RecordDelivered):
            self.delivered.append(event)
        yield 10


class Mote:
    """One board; its flash outlives its power."""

    def __init__(self, shoal: Shoal, address: int, config: RoutingConfig, **hardware: Any) -> None:
        self.shoal = shoal
        self.address = address
        self.name = f"mote{address}"
        self.app = App(self)
        self.promised: dict[int, bytes] = {}
        """Records that were on flash, by number."""
        network = NetworkConfig(address)
        self.config = FirmwareConfig(network, with_robot=False, routing=config, store_latency_s=0.2)
        self.rail = Rail(shoal.scheduler, self.name, 3.0)
        self.image = FlashImage.blank(FlashGeometry())
        self.mote = TelosB(
            shoal.scheduler, self.rail, shoal.medium, MoteFirmware(self.config, self.app, Hooks()),
            self.name, shoal.seed, self.image, **hardware,
        )  # fmt: skip

    @property
    def routing(self) -> Routing:
        routing = self.app.services.routing
        assert routing is not None
        return routing

    @property
    def parent(self) -> int | None:
        return self.routing.collection.tree.parent

    @property
    def up(self) -> bool:
        """Whether the boot is over: before, `app` has what was."""
        firmware = self.mote.mcu.firmware
        assert isinstance(firmware, MoteFirmware)
        return firmware.services is not None and bool(self.rail.volts.value)

    def record(self, content: bytes) -> None:
        """Store a record, where there is somebody to do it."""

        def store() -> Any:
            number = yield from self.routing.record(content)
            log = self.routing._records.log
            yield from log.flush()
            if log.stored_sequence >= number:
                self.promised[number] = content

        if self.up:
            self.mote.mcu.cpu.spawn("record", store())

    def share(self, content: bytes) -> None:
        self.mote.mcu.cpu.spawn("share", self._share(content))

    def _share(self, content: bytes) -> Any:
        yield from self.routing.share(content)

    def of(self, kind: type) -> list[Any]:
        return [event for event in self.app.events if isinstance(event, kind)]

    def items(self) -> dict[tuple[int, int], bytes]:
        return {(e.origin, e.number): e.item for e in self.of(ItemReceived)}

    def power(self, on: bool) -> None:
        self.rail.set_volts(3.0 if on else 0.0)

    def reset(self) -> None:
        self.mote.mcu.press_reset()

    def kept(self) -> list[tuple[int, int, bytes]]:
        """At the base: records on its flash, read from the image alone."""
        assert self.config.routing is not None
        log = self.config.routing.record_log(self.config.log)
        found = recover_records(
            bytes(self.image.memory[: log.sector_count * log.sector_bytes]), log
        )
        return [(e.origin, e.number, e.record) for e, _, _ in receipts(iter(found))]


def in_a_row(count: int) -> list[tuple[float, float]]:
    return [(n * SPACING_M, 0.0) for n in range(count)]


class Shoal:
    """Boards 0 (the base), 1, 2, … at their places [m]."""

    def __init__(
        self, places: list[tuple[float, float]], *, loss: float = 0.0, seed: int = 1,
        drifts: tuple[float, ...] = (), duty: DutyConfig | None = None,
    ) -> None:  # fmt: skip
        self.seed = seed
        self.scheduler = Scheduler()
        self.trace = Trace()
        channel = self.trace.channel("radio")
        self.medium = Medium(
            self.scheduler, MediumConfig(loss_probability=loss), seed=seed, channel=channel
        )
        self.frames: list[Any] = []
        channel.sink(self.frames.extend)
        self.motes = []
        for address, (x_m, y_m) in enumerate(places):
            antenna = Antenna(x_m=constant(x_m), y_m=constant(y_m))
            self.medium.place(f"mote{address}", antenna)
            config = RoutingConfig(base=address == BASE, duty=duty)
            drift = drifts[address] if drifts else 0.0
            self.motes.append(Mote(self, address, config, crystal_drift_ppm=drift))
        self.base = self.motes[BASE]

    def run(self, seconds: float) -> None:
        self.scheduler.run(self.scheduler.now + round(seconds * 1_000) * FS_PER_MS)

    def run_until(self, condition: Any, seconds: float, step: float = 1.0) -> None:
        end = self.scheduler.now + round(seconds * 1_000) * FS_PER_MS
        while not condition():
            assert self.scheduler.now < end, "not within the time"
            self.run(step)

    def promised(self) -> list[tuple[int, int, bytes]]:
        """All records that were on their boards' flash."""
        return [(m.address, n, r) for m in self.motes for n, r in sorted(m.promised.items())]

    def settled(self) -> bool:
        """Whether no board has a record that the base has not acknowledged."""
        return all(
            m.up and m.routing.ready and m.routing.collection.origin.oldest > max(m.promised)
            for m in self.motes
            if m.promised and m.rail.volts.value
        )

    def kinds(self) -> Counter[int]:
        """Frames on the air so far by AM type."""
        self.trace.flush()
        found: Counter[int] = Counter()
        for _, (_, _, _, _, psdu) in self.frames:
            frame = mac.decode(psdu[:-2])
            if frame.frame_type is mac.FrameType.DATA:
                found[from_frame(frame).am_type] += 1
        return found
