"""The whole processing board against a scripted navigation board and a real base station."""

import math
import random
import sys
from itertools import pairwise

import pytest

from firmware_model.errors import FirmwareError
from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_MS, FS_PER_S, FS_PER_US
from firmware_model.trace import Trace
from procboard.applications.heading import HeadingConfig, HeadingControl
from procboard.applications.open_loop import OpenLoop
from procboard.applications.swimming import TailBeatSetting
from procboard.applications.telemetry import TelemetryConfig
from procboard.board import BaseStation, MoteHardware, ProcBoard
from procboard.chips.m25p80 import FlashGeometry
from procboard.errors import ProcConfigError
from procboard.firmware import FirmwareConfig
from procboard.link import BLOCK_BYTES
from procboard.network import NetworkConfig
from procboard.routing.config import RoutingConfig
from procboard.storage import FullPolicy, LogConfig
from radio_802154.medium import Antenna, Medium, MediumConfig
from radio_802154.messages import CommandStatus, Pose, TailBeatCommand, TargetCommand, TelemetryFlag
from spi_bus.link import Link, LinkConfig, MessageReceived, Role
from spi_bus.messages import (
    LINK_MESSAGES,
    CommandApplied,
    SensorReport,
    SetReporting,
    TailBeat,
)
from spi_bus.transports.emulated import SpiWires

BASE, ROBOT = 1, 2
SWIM = TailBeatSetting(0.0, math.radians(15), 0.9)


class NavStandIn:
    """An SPI slave that speaks the link: reports at 10 Hz, obeys and confirms tail beats."""

    def __init__(self, scheduler, epoch=1):
        self.scheduler = scheduler
        self.link = Link(Role.SLAVE, epoch)
        self.data_ready = None
        self.tail_beats = []
        self.confirms = True
        self.reporting = None
        self.heading_rad = 0.0
        self._out = b""
        self._in = bytearray()
        self._sequence = 0
        self._applied = None
        self._report_period = None
        self._tick()

    def now_us(self):
        return self.scheduler.now // FS_PER_US

    # SpiTarget
    def select(self, selected):
        pass

    def begin(self):
        if not self._out:
            self._out = self.link.data_to_send(self.now_us())
        byte = self._out[:1]
        self._out = self._out[1:]
        return byte[0] if byte else 0

    def end(self, mosi):
        self._in.append(mosi)
        if not mosi and len(self._in) > 1:
            data, self._in = bytes(self._in), bytearray()
            for event in self.link.receive(data, self.now_us()):
                if isinstance(event, MessageReceived):
                    self._take(event.message)
        self._drive()

    def _take(self, message):
        if isinstance(message, TailBeat):
            self.tail_beats.append((self.scheduler.now, message))
            if self.confirms and message.command_id != self._applied:
                self._applied = message.command_id
                self.link.send(CommandApplied(message.command_id, self.now_us()))
        elif isinstance(message, SetReporting):
            self.reporting = message

    def _drive(self):
        self.data_ready.set(bool(self._out) or self.link.wants_to_send)

    def _tick(self):
        self.scheduler.after(20 * FS_PER_MS, self._tick)
        if self.data_ready is None:
            return
        deadline = self.link.next_deadline_us()
        if deadline is not None and deadline <= self.now_us():
            self.link.handle_timer(self.now_us())
        if self.reporting is not None and self.scheduler.now % (100 * FS_PER_MS) == 0:
            self._sequence += 1
            if self.link.queued < 12:
                self.link.send(self.report())
        self._drive()

    def report(self):
        return SensorReport(
            self.now_us(), self._sequence & 0xFFFF, 0.1, 0.2, -0.3, 9.8, 0.4, self.heading_rad,
            0.05, 7.4, 0.33, 21.5, 12.0,
        )  # fmt: skip


class World:
    def __init__(
        self,
        application=None,
        loss=0.0,
        ber=0.0,
        seed=1,
        flash_image=None,
        base=True,
        config=None,
        hardware=None,
    ):
        self.scheduler = Scheduler()
        self.trace = Trace()
        self.rail = Rail(self.scheduler, "proc 3V", 3.0)
        self.base_rail = Rail(self.scheduler, "base 3V", 3.0)
        self.medium = Medium(
            self.scheduler,
            MediumConfig(loss_probability=loss),
            seed=seed,
            channel=self.trace.channel("radio"),
        )
        self.medium.place("proc", Antenna())
        self.medium.place("base", Antenna(height_m=1.0))
        self.board = ProcBoard(
            self.scheduler,
            self.trace,
            self.rail,
            self.medium,
            config or FirmwareConfig(NetworkConfig(ROBOT)),
            application or OpenLoop(SWIM),
            seed=seed,
            flash_image=flash_image,
            hardware=hardware,
        )
        self.nav = NavStandIn(self.scheduler)
        self.wires = SpiWires(
            self.scheduler, self.nav, self.trace, bit_error_rate=ber, rng=random.Random(seed)
        )
        self.board.connect_link(self.wires)
        self.board.link_select.watch(lambda level: self.wires.select(not level))
        self.wires.data_ready.watch(self.board.data_ready.set)
        self.nav.data_ready = self.wires.data_ready
        self.telemetry = []
        self.base = None
        if base:
            self.base = BaseStation(
                self.scheduler, self.trace, self.base_rail, self.medium, NetworkConfig(BASE)
            )
            self.base.app.on_telemetry = lambda source, m: self.telemetry.append((source, m))

    def run(self, seconds):
        self.scheduler.run(self.scheduler.now + round(seconds * 1000) * FS_PER_MS)

    def payloads(self):
        return [r.payload for r in self.board.stored_records()]

    def records(self, name):
        found = []
        self.trace.channel(name).sink(found.extend)
        return found


@pytest.fixture
def world():
    return World()


def test_clock_and_boot(world):
    world.run(1.0)
    mcu = world.board.mote.mcu
    assert world.board.boot_number == 1
    assert float(mcu.clocks.mclk.frequency_hz) == pytest.approx(4 * 2**20, rel=0.01)
    assert world.board.mote.spi0.contentions == 0
    assert all(world.board.mote.leds.values())  # lit when low


def test_reports_are_stored_and_telemetry_arrives(world):
    world.run(12.0)
    assert world.nav.reporting == SetReporting(0.1, True)
    board = world.board
    assert 95 <= board.samples_received <= 120
    assert board.samples_received - board.samples_stored <= 12 + 1  # within the latency
    stored = world.payloads()
    assert len(stored) == board.samples_stored
    reports = [LINK_MESSAGES.decode(p) for p in stored]
    sequences = [r.sequence for r in reports]
    assert sequences == list(range(sequences[0], sequences[0] + len(sequences)))
    assert 20 <= len(world.telemetry) <= 24
    source, last = world.telemetry[-1]
    assert source == ROBOT
    assert last.battery_v == pytest.approx(7.4)
    assert last.heading_rad == pytest.approx(0.0, abs=1e-3)
    assert not last.flags & TelemetryFlag.LINK_DOWN
    assert [m.sequence for _, m in world.telemetry] == list(range(len(world.telemetry)))


def test_the_tail_beat_is_kept_up(world):
    world.run(8.0)
    beats = world.nav.tail_beats
    assert all(b.valid_for_s == 2.0 for _, b in beats)
    assert len({b.command_id for _, b in beats}) == 1
    gaps = [(b - a) / FS_PER_S for (a, _), (b, _) in pairwise(beats)]
    assert max(gaps) < 1.2
    assert beats[0][1].amplitude_rad == pytest.approx(math.radians(15), abs=1e-4)


def test_a_commanded_tail_beat_is_applied_answered_and_ends(world):
    world.run(2.0)
    pending = world.base.app.send_command(ROBOT, TailBeatCommand(0, 0.3, 0.2, 1.5, 3.0))
    world.run(1.0)
    assert pending.status is CommandStatus.APPLIED
    world.run(4.0)
    mine = [(t, b) for t, b in world.nav.tail_beats if abs(b.bias_rad - 0.3) < 1e-3]
    assert len({b.command_id for _, b in mine}) == 1
    ends = max(t / FS_PER_S + b.valid_for_s for t, b in mine)
    assert ends == pytest.approx(mine[0][0] / FS_PER_S + 3.0, abs=0.1)


def test_without_confirmation_the_command_is_reported_unreachable(world):
    world.run(2.0)
    world.nav.confirms = False
    pending = world.base.app.send_command(ROBOT, TailBeatCommand(0, 0.3, 0.2, 1.5, 3.0))
    world.run(2.0)
    assert pending.status is CommandStatus.UNREACHABLE


def test_commands_through_a_lossy_air_are_applied_once_each():
    world = World(loss=0.5)
    heard = world.records("proc.radio.received")
    world.run(2.0)
    sent = []
    for n in range(20):
        beat = TailBeatCommand(0, 0.01 * (n + 1), 0.2, 1.0, 30.0)
        sent.append(world.base.app.send_command(ROBOT, beat))
        world.run(3.0)
    world.run(5.0)
    world.trace.flush()
    assert len(heard) > len(sent)  # some came again, because their answers were lost
    assert all(p.status is CommandStatus.APPLIED for p in sent)
    ids = []
    for _, beat in world.nav.tail_beats:
        if beat.command_id not in ids:
            ids.append(beat.command_id)
    assert len(ids) == 1 + len(sent)  # its own, then each command under one number of ours
    biases = [next(b.bias_rad for _, b in world.nav.tail_beats if b.command_id == i) for i in ids]
    assert biases == pytest.approx([0.01 * n for n in range(21)], abs=1e-4)
    numbers = [m.sequence for _, m in world.telemetry]
    assert numbers == sorted(set(numbers))  # never twice
    delivered = world.board.services.network.statistics
    assert delivered.retries > 10


def test_a_noisy_link_loses_no_sample():
    world = World(ber=2e-4)
    world.run(20.0)
    assert world.wires.bits_inverted > 10
    reports = [LINK_MESSAGES.decode(p) for p in world.payloads()]
    sequences = [r.sequence for r in reports if isinstance(r, SensorReport)]
    assert len(sequences) > 150
    assert sequences == list(range(sequences[0], sequences[0] + len(sequences)))


def test_power_cut_keeps_what_was_reported_as_stored():
    world = World()
    stored = []
    world.trace.channel("proc.stored").sink(stored.extend)
    appended = []
    world.trace.channel("proc.appended").sink(appended.extend)
    world.run(5.0)
    for cut in range(6):
        world.run(3.3713 + 0.0007 * cut)
        world.rail.set_volts(0.0)
        world.run(0.5)
        world.rail.set_volts(3.0)
        world.run(2.0)
    world.run(2.0)
    world.trace.flush()
    assert world.board.boot_number == 7
    records = {r.sequence: r.payload for r in world.board.stored_records()}
    last = {}
    for time, (number, payload) in appended:
        last.setdefault(number, []).append((time, payload))
    # Of a number that was given anew after a cut, the one that was reported must be there.
    for time, number in stored:
        candidates = [p for t, p in last[number] if t < time]
        assert records[number] == candidates[-1]
    assert world.board.samples_stored <= len(records)
    assert len(records) > 100
    # The navigation board is told again after each boot.
    assert world.nav.tail_beats[-1][0] > world.scheduler.now - 2 * FS_PER_S


def test_a_second_board_finds_the_log_of_the_first(world):
    world.run(4.0)
    count = len(world.board.stored_records())
    again = World(flash_image=world.board.flash_image)
    again.run(4.0)
    records = again.board.stored_records()
    assert len(records) > count > 20
    assert [r.sequence for r in records] == list(range(len(records)))


def test_heading_control_steers_towards_the_target():
    control = HeadingControl(
        HeadingConfig(target_m=(2.0, 2.0), gain=0.5), TelemetryConfig(telemetry_period_s=0.5)
    )
    world = World(control)
    steps = world.records("proc.control")
    world.run(1.0)
    world.base.app.send_pose(ROBOT, Pose(0.0, 0.0, 0.0, 0))
    world.run(1.0)
    error = math.pi / 4
    world.trace.flush()
    assert steps[0][1] == (0.0, 0.0)  # before any pose: straight
    assert steps[1][1] == pytest.approx((error, -0.5 * error), abs=1e-3)
    assert world.nav.tail_beats[-1][1].bias_rad == pytest.approx(-0.5 * error, abs=1e-3)
    assert world.nav.tail_beats[-1][1].frequency_hz == 1.0
    world.nav.heading_rad = 0.4  # turned since the pose: the navigation board knows
    world.run(5.0)
    world.trace.flush()
    assert steps[-1][1][0] == pytest.approx(error - 0.4, abs=1e-3)
    assert world.telemetry[-1][1].flags & TelemetryFlag.HEADING_CONTROL
    # another target, and then an end to it
    pending = world.base.app.send_command(ROBOT, TargetCommand(0, -1.0, 0.0))
    world.run(1.0)
    assert pending.status is CommandStatus.ACCEPTED
    world.trace.flush()
    assert abs(steps[-1][1][0]) == pytest.approx(math.pi - 0.4, abs=1e-3)
    world.base.app.send_command(ROBOT, TailBeatCommand(0, 0.0, 0.1, 1.0, 5.0))
    world.run(7.0)
    assert not world.telemetry[-1][1].flags & TelemetryFlag.HEADING_CONTROL


def test_arrival_is_reported():
    world = World(HeadingControl(HeadingConfig(target_m=(2.0, 2.0), rest_at_target=True)))
    world.run(1.0)
    world.base.app.send_pose(ROBOT, Pose(1.99, 2.0, 0.0, 0))
    world.run(4.0)
    assert world.telemetry[-1][1].flags & TelemetryFlag.TARGET_REACHED
    assert world.scheduler.now - world.nav.tail_beats[-1][0] > 2 * FS_PER_S


def test_a_silent_navigation_board_is_noticed(world):
    world.run(3.0)
    world.nav.data_ready.set(False)
    world.nav.reporting = None
    world.run(3.0)
    # it still acknowledges, but reports nothing
    assert world.telemetry[-1][1].flags & TelemetryFlag.LINK_DOWN


def test_same_seed_same_trace():
    def once():
        world = World(loss=0.2, ber=1e-4, seed=3)
        world.run(5.0)
        return world.trace.sha256()

    assert once() == once()


def test_a_stuck_program_is_reset_by_the_watchdog(world):
    world.run(2.0)
    cpu = world.board.mote.mcu.cpu

    def hang():
        while True:
            yield 1000

    cpu.spawn("runaway", hang())
    world.run(3.0)
    assert world.board.mote.mcu.last_reset != "power-up"
    assert world.board.boot_number == 2


def test_a_full_flash_is_counted_and_flagged():
    config = FirmwareConfig(
        NetworkConfig(ROBOT),
        log=LogConfig(sector_count=3, sector_bytes=1024, policy=FullPolicy.STOP),
    )
    world = World(config=config, hardware=MoteHardware(flash_geometry=FlashGeometry(3, 1024)))
    world.run(15.0)
    board = world.board
    records = board.stored_records()
    assert [r.sequence for r in records] == list(range(len(records)))
    assert 40 <= len(records) == board.samples_stored
    lost = board.statistics()["samples_lost"]
    assert lost == board.samples_received - board.samples_stored > 50
    assert world.telemetry[-1][1].flags & TelemetryFlag.STORAGE_FULL
    assert lost - 6 <= world.telemetry[-1][1].samples_lost <= lost
    world.rail.set_volts(0.0)
    world.run(0.1)
    world.rail.set_volts(3.0)
    world.run(2.0)
    assert board.statistics()["samples_lost"] > lost
    assert len(board.stored_records()) == len(records)


def test_a_broken_flash_does_not_stop_the_robot(world):
    world.run(3.0)
    world.board.mote.flash.image.status = 0x1C  # everything protected: nothing keeps
    world.run(6.0)
    assert "did not keep" in world.board.statistics()["storage"]["failure"]
    assert world.telemetry[-1][1].flags & TelemetryFlag.STORAGE_FULL
    assert world.scheduler.now - world.nav.tail_beats[-1][0] < 1.1 * FS_PER_S


def test_reports_may_be_thinned_before_they_are_stored():
    world = World(OpenLoop(SWIM, TelemetryConfig(store_period_s=0.5)))
    world.run(12.0)
    reports = [LINK_MESSAGES.decode(p) for p in world.payloads()]
    gaps = [(b.time_us - a.time_us) / 1e6 for a, b in pairwise(reports)]
    assert len(reports) >= 18
    assert gaps == pytest.approx([0.5] * len(gaps), abs=0.06)


def test_a_log_that_does_not_fit_the_flash_is_refused():
    config = FirmwareConfig(NetworkConfig(ROBOT), log=LogConfig(sector_count=3, sector_bytes=1024))
    with pytest.raises(ProcConfigError, match="16 of 65536"):
        World(config=config)


def test_all_of_it_fits_the_ram_of_the_mote(world):
    world.run(1.0)
    assert 3000 < world.board.mote.mcu.ram.free < 10 * 1024


def test_the_network_layer_finds_room_beside_a_robots_log_and_link():
    config = FirmwareConfig(
        NetworkConfig(ROBOT), log=LogConfig(sector_count=10), routing=RoutingConfig()
    )
    world = World(config=config)
    world.run(2.0)
    routing = world.board.services.routing
    mcu = world.board.mote.mcu
    assert routing.ready
    assert 0 < mcu.ram.free < 1024
    mcu.cpu.spawn("record", routing.record(b"reading"))
    mcu.cpu.spawn("share", routing.share(b"item"))
    world.run(4.0)
    assert routing.collection.origin.newest == 0
    assert routing.sharing.versions == {ROBOT: 1}
    assert len(world.payloads()) >= 40  # two sectors were erased meanwhile
    assert world.board.statistics()["samples_lost"] == 0


def test_a_log_beside_the_network_layer_has_fewer_sectors():
    with pytest.raises(ProcConfigError, match="22 sectors"):
        World(config=FirmwareConfig(NetworkConfig(ROBOT), routing=RoutingConfig()))


def test_a_buffer_that_no_mote_has_fails():
    config = FirmwareConfig(NetworkConfig(ROBOT), log=LogConfig(buffer_bytes=20_000))
    world = World(config=config)
    with pytest.raises(FirmwareError, match="RAM is full"):
        world.run(1.0)


class BlockEnd(NavStandIn):
    """Every frame of its ends with the block that the master clocks, and its zero does not fit."""

    def __init__(self, scheduler):
        super().__init__(scheduler)
        patient = LinkConfig(retransmit_us=2_000_000, retransmit_max_us=2_000_000)
        self.link = Link(Role.SLAVE, 1, patient)  # nothing sent again hides what was overlooked

    def select(self, selected):
        if selected and not self._out:
            data = self.link.data_to_send(self.now_us())
            if data:
                first = data.index(0) + 1
                self._out = bytes(max(0, BLOCK_BYTES - first + 1)) + data

    def begin(self):
        byte = self._out[:1]
        self._out = self._out[1:]
        return byte[0] if byte else 0


def test_a_frame_that_ends_with_a_block_is_taken_at_once(monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "NavStandIn", BlockEnd)
    world = World()
    world.run(3)
    received = []
    for _ in range(20):
        sent = world.nav.link.statistics.messages_sent
        while world.nav.link.statistics.messages_sent == sent:
            world.run(0.005)
        world.run(0.02)
        statistics = world.board.statistics()["link"]
        received.append(statistics["messages_received"] - sent)
    assert received == [1] * 20
    assert statistics["crc_errors"] == statistics["framing_errors"] == 0
