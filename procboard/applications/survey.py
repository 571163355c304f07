"""A robot's part in a survey: `procboard.survey.mission` on the board, with its network and fish.

Three tasks. One swims: at every pose it tells the mission where the robot is, notices that a cell
was passed, asks `avoidance` for a way past the others, and has `pursuit` swim it. One shares what
the mission has to say and lets its time pass. One computes: what a C program would need for its
floating point is paid there, a few milliseconds at a time, so that all others go on.

A sample is two things: a record, which goes to the base and stays on flash until the base has
acknowledged it, and an item, which all boards get. The record is stored first. An item counts for
this board, too, when it is on flash and not before; after a reset all of them come from there.

Poses of all robots come in batches that everybody hears. The sensor is the navigation board's, and
its reports come over the link ten times a second.

- *No pose for long*: the robot stops (`pursuit`), and joins nothing before it had a first one.
- *The navigation board is silent*: no readings, so the cell goes to another robot in the end.
- *The flash is full or broken*: what cannot be kept is not said, and counted.
- *A tail-beat command*: the robot leaves the survey for good and obeys; others find it silent.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from firmware_model.cpu import Flag
from procboard.alarms import TICKS_PER_S
from procboard.applications.commands import CommandDesk, Reply, listen
from procboard.applications.open_loop import tail_beat_handler
from procboard.applications.pursuit import POSE_CYCLES, Place, Pursuit, PursuitConfig
from procboard.applications.services import Services
from procboard.applications.surroundings import KEPT_BYTES, Surroundings
from procboard.applications.swimming import Swimmer
from procboard.applications.telemetry import TelemetryConfig, TelemetryTask
from procboard.applications.tracking_law import TrackingLaw
from procboard.coroutines import Firmware
from procboard.errors import ProcConfigError
from procboard.routing.controller import Routing
from procboard.routing.sharing import ItemReceived
from procboard.survey import cost
from procboard.survey.avoidance import Room, Seen, chosen
from procboard.survey.expansion import Expansion
from procboard.survey.items import ITEMS, SAMPLE, Sample
from procboard.survey.mission import Mission, MissionConfig, Phase
from procboard.survey.rank import Cell
from radio_802154 import messages
from radio_802154.messages import PoseBatch, TailBeatCommand
from spi_bus.messages import SensorReport

TRACK_BYTES: Final = 16 * 6 + 4 * 12
"""Headings of a beat at ten a second, with some to spare, and the last poses."""
SLICE_CYCLES: Final = 20_000
"""Computed at a stretch: 5 ms, in which a link's message or a frame may wait."""
PAUSE_US: Final = 61
"""Between two stretches, for all other tasks: two ticks."""
FLASH_POLL_US: Final = 50_000
"""How often it is looked whether an item is on flash, which takes up to a second."""
GLIDE_S: Final = 10.0
"""So long a robot is taken to go on that was told to rest, or to give way."""
BEAT_CYCLES: Final = 800
"""Looking at the mission and at the neighbours once a beat (estimate)."""
GLIDING_M_S: Final = 0.005
"""A robot that rests and is faster has to look where it glides."""
GLIDE_M: Final = 0.3
"""How far: v falls as 1/(1 + t v c/m), with c/m = 3.2 per metre of the bundled robot from 3 cm/s to
half of that in 10 s and 0.2 m, to 5 mm/s in 50 s and 0.55 m, slower than others need to notice."""
READING_CYCLES: Final = 60
"""A reading into the ring: about 20 instructions (estimate)."""


@dataclass(frozen=True, slots=True)
class SurveyConfig(PursuitConfig):
    """What the mission is, which sensor it is about, and how the robot swims."""

    mission: MissionConfig | None = None
    survey: Callable[[], Expansion] | None = None
    """Makes the survey in its first state."""
    quantity: str = "temperature_c"
    """Of a sensor report."""
    room: Room = field(default_factory=lambda: Room(trust_s=GLIDE_S))

    def __post_init__(self) -> None:
        PursuitConfig.__post_init__(self)
        if self.mission is None or self.survey is None:
            raise ProcConfigError("a survey needs a mission and a way to survey")


def ram_bytes(shape: tuple[int, int], lines: int) -> int:
    """RAM of the application for a grid, where at most so many lines are the basis."""
    return cost.ram_bytes(shape, lines) + KEPT_BYTES + TRACK_BYTES


class Survey:
    """Application of the processing board."""

    def __init__(self, config: SurveyConfig, telemetry: TelemetryConfig | None = None) -> None:
        self.config = config
        self.telemetry = telemetry or TelemetryConfig()
        self.mission: Mission | None = None
        """Of the present boot, for a laboratory to look at."""
        self._law = config.law()

    def start(self, services: Services) -> None:
        """Begin, or go on with what is on flash."""
        self.mission = _Surveyor(services, self.config, self.telemetry, self._law).mission


class _Surveyor:
    """One boot's life of the application."""

    def __init__(
        self,
        services: Services,
        config: SurveyConfig,
        telemetry: TelemetryConfig,
        law: TrackingLaw,
    ) -> None:
        if services.routing is None:
            raise ProcConfigError("a survey needs the network layer")
        assert config.mission is not None
        assert config.survey is not None
        self._services = services
        self._alarms = services.alarms
        self._routing: Routing = services.routing
        self._config = config
        self._address = self._routing.address
        self.mission = Mission(self._address, config.mission, config.survey)
        self._swimmer = Swimmer(services)
        self._pursuit = Pursuit(services, config, law, self._swimmer)
        self._surroundings = Surroundings()
        self._aim: Place | None = None
        self._goal: Cell | None = None
        self._held_us = 0
        self._looked_us = 0
        self._begun = False
        """Whether all that is on flash is known; before, poses are kept from the mission."""
        self._left = False
        self._phase: Phase | None = None
        self._changed = Flag("survey: something to say")
        self._owed_cycles = 0
        self._answered = 0
        self._plan: object = None
        self._work = Flag("survey: something to compute")
        desk = CommandDesk(services)
        self._telemetry = TelemetryTask(services, telemetry, self._swimmer, desk)
        self._telemetry.on_report = self._on_report
        self._obey_tail_beat = tail_beat_handler(self._swimmer)
        desk.on(TailBeatCommand, self._on_tail_beat)
        listen(services, PoseBatch, self._on_poses, messages.BASE)
        self._routing.on(ItemReceived, self._on_item)
        services.cpu.spawn("survey", self._swim())
        services.cpu.spawn("survey news", self._say())
        services.cpu.spawn("survey computing", self._compute())

    # --- what comes in ------------------------------------------------------------------

    def _on_report(self, report: SensorReport) -> None:
        self._pursuit.take_report(report)
        value: float | None = getattr(report, self._config.quantity)
        if value is not None:
            self.mission.tell_reading(value, self._routing.now_ms())
            self._owe(READING_CYCLES)

    def _on_poses(self, _source: int, batch: PoseBatch) -> Firmware[None]:
        yield POSE_CYCLES // 8  # of others nothing is computed but a difference
        now_s = self._alarms.now_us() / 1e6
        for address, pose in batch.poses:
            if address == self._address:
                yield from self._pursuit.take_pose(pose)
            else:
                self._surroundings.take(address, pose, now_s, self._pursuit.track.place)

    def _on_item(self, event: ItemReceived) -> Firmware[None]:
        yield 0
        self._learn(event.origin, event.number, event.item)

    def _learn(self, origin: int, number: int, item: bytes) -> None:
        self.mission.receive(origin, number, item, self._routing.now_ms())
        self._owe(cost.ITEM_CYCLES)
        self._look_at_mission()
        self._changed.set()

    def _on_tail_beat(self, command: TailBeatCommand, reply: Reply) -> Firmware[None]:
        self._left = True
        self._pursuit.swims = False
        self._telemetry.heading_control = False
        yield from self._obey_tail_beat(command, reply)

    # --- what it costs --------------------------------------------------------------------

    def _owe(self, cycles: int) -> None:
        self._owed_cycles += cycles
        self._work.set()

    def _look_at_mission(self) -> None:
        """See what the mission has computed, and how far it is."""
        mission = self.mission
        shape = mission.config.grid.shape
        answered = mission.answered - self._answered
        if answered > 0:
            self._owe(answered * cost.request_cycles(shape, mission.lines))
        self._answered = mission.answered
        if mission.plan is not self._plan:
            self._plan = mission.plan
            self._owe(cost.plan_cycles(sum(map(len, mission.plan.values()))))
        if self._begun and mission.phase is not self._phase:
            self._phase = mission.phase
            self._services.hooks.tracking("phase", mission.phase.name.lower())

    def _compute(self) -> Firmware[None]:
        """Pay for what was computed, and let others have their turns meanwhile."""
        while True:
            while self._owed_cycles > 0:
                cycles = min(self._owed_cycles, SLICE_CYCLES)
                self._owed_cycles -= cycles
                yield cycles
                if self._owed_cycles:
                    yield from self._alarms.sleep_us(PAUSE_US)
            yield self._work

    # --- what is said -----------------------------------------------------------------------

    def _say(self) -> Firmware[None]:
        """Let the mission's time pass and share what it says."""
        routing, mission, alarms = self._routing, self.mission, self._alarms
        while not routing.ready:  # until then items come from flash
            yield from alarms.sleep_us(FLASH_POLL_US)
        mission.start(routing.now_ms())
        self._begun = True
        while not self._left:
            mission.handle_timer(routing.now_ms())
            self._look_at_mission()
            item = mission.take_item()
            if item is not None:
                yield from self._share(item)
                continue
            due_ms = mission.next_deadline()
            alarm = None
            if due_ms is not None:
                alarm = alarms.at(-(-due_ms * TICKS_PER_S // 1_000), self._changed)
            yield BEAT_CYCLES
            yield self._changed
            alarms.cancel(alarm)

    def _share(self, octets: bytes) -> Firmware[None]:
        routing = self._routing
        item = ITEMS.decode(octets)
        if isinstance(item, Sample):
            record = yield from routing.record(SAMPLE.encode(item))
            number = -1 if record is None else record
            self._services.hooks.tracking(
                "sample", number, item.row, item.column, item.value, item.deviation
            )
        shared = yield from routing.share(octets)
        if shared is None:
            return
        while routing.sharing.versions.get(self._address, 0) < shared:
            yield from self._alarms.sleep_us(FLASH_POLL_US)
        self._learn(self._address, shared, octets)

    # --- how it swims -------------------------------------------------------------------------

    def _swim(self) -> Firmware[None]:
        pursuit = self._pursuit
        while True:
            self._telemetry.heading_control = self._aim is not None and not pursuit.stopped
            posed = yield from pursuit.wait(self._aim is not None)
            if self._left or not self._begun:
                continue
            yield BEAT_CYCLES
            if posed:
                self._tell()
            if not pursuit.due(posed):
                continue
            if not posed:
                pursuit.track.carry_on(self._alarms.now_us() / 1e6)
            yield from self._choose()
            if self._aim is not None:
                yield from pursuit.steer(posed, lambda: self._aim)
            elif pursuit.swims:
                pursuit.rest()

    def _tell(self) -> None:
        """Tell the mission where the robot is, what it came by, and who lives."""
        mission, track, now_ms = self.mission, self._pursuit.track, self._routing.now_ms()
        ticks = self._routing.global_ticks()
        if ticks is not None:
            mission.clock_offset_ms = ticks * 1_000 // TICKS_PER_S - now_ms
        for address, neighbour in self._routing.neighbours.table.items():
            mission.hear(address, neighbour.heard_ms)
        place, target = track.place, mission.target
        assert place is not None  # a pose has just come
        mission.tell_pose(place[0], place[1], now_ms)
        if target is not None and track.passed_m(target) <= self._config.gains.arrival_m:
            # readings count from before: their mean place is half way of the beat
            about = place if mission.config.dwell_ms else track.middle
            assert about is not None
            mission.arrive(about[0], about[1], now_ms)
        self._changed.set()
        self._look_at_mission()

    def _choose(self) -> Firmware[None]:
        """Choose where to swim for the next beat."""
        mission, track, now_us = self.mission, self._pursuit.track, self._alarms.now_us()
        goal, target, place = mission.goal, mission.target, track.place
        assert place is not None
        since_us, self._looked_us = now_us - self._looked_us, now_us
        if goal != self._goal:
            self._goal, self._held_us = goal, 0
            self._pursuit.begin_anew()
            self._say_goal(goal)
        if goal is not None and target is None:  # it rests at a cell
            self._aim = None
            return
        speed, ahead = track.speed_m_s, target
        if target is None and speed > GLIDING_M_S:
            x, y, heading = place
            ahead = x + GLIDE_M * math.cos(heading), y + GLIDE_M * math.sin(heading)
        choice = chosen(
            self._address,
            Seen(*place, speed),
            ahead,
            self._surroundings.seen(now_us / 1e6),
            self._held_us / 1e6,
            self._config.room,
        )
        yield cost.steering_cycles(min(choice.ways, 1), choice.near)
        self._owe(cost.steering_cycles(max(0, choice.ways - 1), choice.near))
        # who rests and glides where nobody is may go on gliding
        self._aim = choice.place if target is not None or choice.place != ahead else None
        if target is not None and choice.place != target:
            self._held_us += since_us

    def _say_goal(self, goal: Cell | None) -> None:
        if goal is None:
            self._services.hooks.tracking("rest")
        else:
            place = self.mission.config.grid.centre(goal)
            self._services.hooks.tracking("goal", *goal, *place)
