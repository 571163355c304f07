"""A real mote of a run: TinyOS BaseStation on USB, through which emulated radio meets real air.

In the emulated air a gateway stands where the base station's antenna is: it hears everything and
speaks for the nodes that are not emulated. `radio_802154.mote_bridge` decides what crosses; here it
meets the serial line, the clock and the summary.

Times are honest in that they begin when this machine knows: a packet's way to an emulated node is
measured from the octets' arrival, what the air and the mote took before is in nobody's figure. A
frame's way out ends with the mote's acknowledgement, which says that it waits for the mote's radio.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from firmware_model.histogram import DurationHistogram
from firmware_model.scheduler import Event as Scheduled
from firmware_model.signals import constant
from firmware_model.time import FS_PER_S, FS_PER_US
from radio_802154 import tinyos
from radio_802154.gateway import Gateway, Outcome
from radio_802154.medium import Antenna
from radio_802154.mote_bridge import BridgeConfig, Dropped, MoteBridge
from radio_802154.tinyos_serial import MAX_FRAME_OCTETS
from tools.bench.outages import LineOutages, open_line
from tools.bench.telemetry_log import TelemetryLog
from tools.words import away, ms

if TYPE_CHECKING:
    from radio_802154.medium import Medium
    from radio_802154.tinyos import AmPacket
    from spi_bus.transports.base import Waitable
    from tools.bench.pace import LineScheduler
    from tools.configuration import Scenario
    from tools.records.data import Event, Series

ANTENNA = "mote"
ROOM_OCTETS = 2 * MAX_FRAME_OCTETS + 2
"""What the transport must take before a packet is handed to it: the longest, all escaped."""
FAILURES = {
    Outcome.SENT: None,
    Outcome.ACKNOWLEDGED: None,
    Outcome.NOT_ACKNOWLEDGED: Dropped.NOT_RECEIVED,
    Outcome.CHANNEL_BUSY: Dropped.CHANNEL_BUSY,
}


def emulated_addresses(config: Scenario) -> dict[str, int]:
    """Return the radio nodes that are emulated here, by name."""
    nodes = {}
    if config.hil.emulates_robot_radio:
        nodes["robot"] = config.procboard.address
    if config.hil.emulates_base:
        nodes["base"] = config.base_station.address
    return nodes


class RealMote:
    """The mote on its line.

    Raises:
        ScenarioError: the line cannot be opened; the text is one line with the remedy.

    """

    def __init__(self, config: Scenario, clock: Callable[[], float] = time.monotonic) -> None:
        self.url = config.hil.mote
        self.outages = LineOutages()
        self.nodes = emulated_addresses(config)
        self.bridge = MoteBridge(
            BridgeConfig(frozenset(self.nodes.values()), config.radio.pan_id), int(clock())
        )
        self.bridge.on_acknowledged = self._on_acknowledged
        self.telemetry = TelemetryLog()
        self.bytes_in = 0
        self.bytes_before = 0
        """Octets that lay in the line when the run began: heard before, and not of the run."""
        self.resumptions = 0
        self.round_trip = DurationHistogram()
        self.acknowledged = DurationHistogram()
        self.to_air = DurationHistogram()
        self._config = config
        self.transport = open_line("mote", self.url, clock, self.outages)
        self.where = self.transport.description
        self._openings = self.transport.openings
        self._begun = False
        self._came = b""
        self._blocked = False  # by a line that takes nothing now
        self._timer: Scheduled | None = None
        self._timer_us: int | None = None
        self._scheduler: LineScheduler | None = None
        self._gateway: Gateway | None = None

    def attach(self, scheduler: LineScheduler, medium: Medium) -> None:
        """Put the gateway into the air, where the base station's antenna is."""
        base = self._config.base_station
        medium.place(
            ANTENNA,
            Antenna(x_m=constant(base.x_m), y_m=constant(base.y_m), height_m=base.height_m),
        )
        self._scheduler = scheduler
        self._gateway = Gateway(
            scheduler,
            medium,
            ANTENNA,
            self._config.radio.channel,
            self._heard,
            self._config.scenario.seed,
        )

    # --- the line, as the scheduler sees it -------------------------------------------------

    def waitables(self) -> list[Waitable]:
        """Return what to wait on."""
        return [self.transport]

    def poll(self) -> bool:
        """Move what can be moved now; return whether `on_incoming` is wanted."""
        transport = self.transport
        data = transport.read()
        if not self._begun:
            self._begun = True
            while data:
                self.bytes_before += len(data)
                data = transport.read()
        transport.flush()
        if transport.openings != self._openings:
            self._openings = transport.openings
            self.resumptions += 1
            self.bridge.reopened()
            self._came = b""
        self.bytes_in += len(data)
        self._came += data
        return bool(self._came) or (self._blocked and transport.room >= ROOM_OCTETS)

    def on_incoming(self) -> None:
        """Hand on what came, at the emulated time of its arrival."""
        data, self._came = self._came, b""
        arrived_fs = self._now_fs()
        for packet in self.bridge.receive(data, self._now_us()):
            self._to_air(packet, arrived_fs)
        self._pump()

    def _pump(self) -> None:
        """Give the line what the bridge has for it, and set the timer."""
        bridge, transport = self.bridge, self.transport
        self._blocked = False
        if transport.room >= ROOM_OCTETS:
            deadline_us = bridge.next_deadline_us()
            if deadline_us is not None and deadline_us <= self._now_us():
                bridge.handle_timer(self._now_us())
            while bridge.wants_to_send and transport.room >= ROOM_OCTETS:
                transport.write(bridge.data_to_send(self._now_us()))
            transport.flush()
        # A line that is away takes nothing: attempts are not used up, all waits for its return.
        self._blocked = bridge.wants_to_send or transport.room < ROOM_OCTETS
        deadline_us = None if self._blocked else bridge.next_deadline_us()
        if deadline_us != self._timer_us:
            scheduler = self._running()
            scheduler.cancel(self._timer)
            self._timer_us, self._timer = deadline_us, None
            if deadline_us is not None:
                due_fs = max(deadline_us * FS_PER_US, scheduler.now)
                self._timer = scheduler.at(due_fs, self._due)

    def _due(self) -> None:
        self._timer = self._timer_us = None
        self._pump()

    # --- the emulated air -------------------------------------------------------------------

    def _heard(self, octets: bytes) -> bool:
        """Decide on a frame at its end, and send it off at once."""
        answer = self.bridge.heard(octets, self._now_us())
        self._pump()
        return answer

    def _to_air(self, packet: AmPacket, arrived_fs: int) -> None:
        assert self._gateway is not None

        def done(outcome: Outcome) -> None:
            failure = FAILURES[outcome]
            self.bridge.sent(failure)
            if failure is None:
                self.to_air.record((self._now_fs() - arrived_fs) / FS_PER_S)

        if not self._gateway.send(tinyos.encode(packet), done):
            self.bridge.sent(Dropped.AIR_QUEUE_FULL)

    def _running(self) -> LineScheduler:
        assert self._scheduler is not None  # attached
        return self._scheduler

    def _now_fs(self) -> int:
        return self._running().now

    def _now_us(self) -> int:
        return self._now_fs() // FS_PER_US

    # --- what is known at the end -----------------------------------------------------------

    def _on_acknowledged(self, waited_us: int, trip_us: int | None) -> None:
        self.acknowledged.record(waited_us / 1e6)
        if trip_us is not None:
            self.round_trip.record(trip_us / 1e6)

    @property
    def connected(self) -> bool:
        """Whether the mote has ever acknowledged or said anything."""
        return bool(self.bridge.statistics.acknowledged or self.bridge.statistics.packets)

    def diagnosis(self) -> str:
        """Why nothing came of it, in a line; empty where something did."""
        if self.connected:
            return ""
        counts = self.bridge.statistics
        if self.bytes_in:
            return (
                f"{self.where}: {self.bytes_in} bytes came and no packet was intact: is the rate "
                "115200 baud, and is BaseStation on that mote?"
            )
        if counts.taken:
            return (
                f"{self.where}: the mote acknowledged none of {counts.taken} packets: is "
                "BaseStation on it, and is this its port?"
            )
        return (
            f"{self.where}: nothing was heard and nothing to be said: is anybody on the air, on "
            f"channel {self._config.radio.channel} and group 0x{self._config.radio.pan_id:02x}?"
        )

    def events(self) -> list[Event]:
        """Begin and end of each outage of the line."""
        return self.outages.events(self._running(), "mote")

    def channels(self) -> dict[str, Series]:
        """What a robot that is not emulated told by telemetry, at the times of its arrival."""
        if "robot" in self.nodes:
            return {}
        return self.telemetry.channels(self._config.procboard.address)

    def summary(self) -> dict[str, Any]:
        """Everything for a `summary.json`, under `hil.mote`."""
        counts, line = self.bridge.statistics, self.bridge.link.statistics
        assert self._gateway is not None
        outside = {address: log for address, log in self.telemetry.summary().items()
                   if address not in self.nodes.values()}  # fmt: skip
        return {
            "url": self.url,
            "line": self.where,
            "emulated": self.nodes,
            "connected": self.connected,
            "diagnosis": self.diagnosis(),
            "out": {
                "heard": counts.heard,
                "taken": counts.taken,
                "repeated": counts.repeated,
                "acknowledged": counts.acknowledged,
                "sent_again": line.retransmissions,
                "waiting": self.bridge.link.queued,
                "dropped": _reasons(counts.outward.items()),
            },
            "in": {
                "packets": counts.packets,
                "admitted": counts.admitted,
                "delivered": counts.delivered,
                "sent_again": self._gateway.retries,
                "waiting": self._gateway.queue_limit - self._gateway.room,
                "dropped": _reasons(counts.inward.items()),
                "damaged": {kind.value: count for kind, count in self._damage()},
                "bytes_before": self.bytes_before,
            },
            "round_trip": self.round_trip.summary(),
            "acknowledged": self.acknowledged.summary(),
            "to_air": self.to_air.summary(),
            "serial": asdict(line),
            "telemetry": {str(address): log for address, log in outside.items()},
            "outages": {**self.outages.summary(), "resumptions": self.resumptions},
        }

    def _damage(self) -> Iterable[tuple[Any, int]]:
        return ((kind, n) for kind, n in self.bridge.link.decoder.errors.items() if n)

    def close(self) -> None:
        """Give the line back."""
        self.transport.close()


def _reasons(items: Iterable[tuple[Dropped, int]]) -> dict[str, int]:
    return {reason.value: count for reason, count in sorted(items) if count}


def words(told: dict[str, Any]) -> list[str]:
    """Lines on the mote, for the terminal; `told` is a `summary`."""
    out, back, trip = told["out"], told["in"], told["round_trip"]
    nodes = " and ".join(told["emulated"]) or "nobody"
    lines = [
        f"  {'mote':<14}{told['line']}; emulated: {nodes}",
        (
            f"  {'to the mote':<14}{out['taken']} frames, {out['acknowledged']} acknowledged, "
            f"{out['sent_again']} sent again, {out['waiting']} waiting"
        ),
        *_dropped(out["dropped"]),
        (
            f"  {'from the mote':<14}{back['packets']} packets, {back['admitted']} for emulated "
            f"nodes, {back['delivered']} delivered"
        ),
        *_dropped(back["dropped"]),
    ]
    if trip["count"]:
        lines.append(
            f"  {'mote answers':<14}after {ms(trip['median_s'])}, p99 {ms(trip['p99_s'])}, "
            f"max {ms(trip['maximum_s'])} (of {trip['count']} packets sent once)"
        )
    if told["to_air"]["count"]:
        to_air = told["to_air"]
        lines.append(
            f"  {'to the air':<14}after {ms(to_air['median_s'])}, p99 {ms(to_air['p99_s'])} "
            "(arrival to the end of the frame)"
        )
    for address, log in told["telemetry"].items():
        lines.append(
            f"  {'telemetry':<14}of {address}: {log['received']} received, {log['missing']} "
            f"missing, {log['repeated']} repeated"
        )
    outages = told["outages"]
    lines.append(f"  {'mote outages':<14}{outages['outages']}, {away(outages)}")
    return lines


def _dropped(reasons: dict[str, int]) -> list[str]:
    told = ", ".join(f"{count} {reason}" for reason, count in reasons.items())
    return [f"  {'':<14}not carried: {told}"] if told else []
