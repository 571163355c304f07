"""Two emulated airs and a serial line between them, on one clock: a lossy life, always the same.

On the one air a base station and the gateway of a `RealMote`; on the other the emulated BaseStation
and a robot's radio. The line between them loses octets, damages them and is away for a while. What
`hil --mote` and `board base` do in real time is done here by a plain scheduler.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator
from random import Random
from typing import Any

import pytest

from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_MS, FS_PER_S
from firmware_model.trace import Trace
from procboard.applications.commands import listen, send_message
from procboard.applications.services import Hooks
from procboard.board import BaseStation
from procboard.firmware import FirmwareConfig, MoteFirmware
from procboard.network import NetworkConfig
from procboard.serial_base import SerialBaseStation
from procboard.telosb import TelosB
from radio_802154 import mac, messages
from radio_802154.medium import Antenna, Medium, MediumConfig
from radio_802154.messages import CommandReply, CommandStatus, Pose, TailBeatCommand, Telemetry
from tools import scenario
from tools.bench.mote import RealMote

BASE, ROBOT = 0, 1
COMMANDS = 25


class Radio:
    """The robot as its radio has it: it answers commands and tells how it is."""

    def __init__(self) -> None:
        self.obeyed: Counter[int] = Counter()
        self.poses: list[float] = []
        self.sent = 0

    def start(self, services: Any) -> None:
        self.services = services
        listen(services, TailBeatCommand, self.obey, messages.BASE)
        listen(services, Pose, self.see, messages.BASE)

    def obey(self, source: int, command: TailBeatCommand) -> Generator[int, None, None]:
        self.obeyed[command.command_id] += 1
        send_message(self.services, source, CommandReply(command.command_id, CommandStatus.APPLIED))
        yield 50

    def see(self, _source: int, pose: Pose) -> Generator[int, None, None]:
        self.poses.append(pose.x_m)
        yield 50

    def tell(self) -> None:
        message = Telemetry(0.0, self.sent, *[None] * 6, 0, 0, 0, 0)
        self.sent += send_message(self.services, BASE, message)


class Line:
    """A transport to `RealMote` that leads to a converter; losses by chance, and an absence."""

    description = "line"
    wants_writable = False
    pending = 0

    def __init__(self, seed: int, loss: float) -> None:
        self.random = Random(seed)
        self.loss = loss
        self.openings = 1
        self.usb: Any = None
        self.away = False
        self.came = bytearray()

    @property
    def room(self) -> int:
        return 0 if self.away else 4096

    def write(self, data: bytes) -> None:
        assert not self.away
        kept = bytes(octet for octet in data if self.random.random() > self.loss)
        self.usb.send(kept[: self.usb.room])

    def read(self, limit: int = 65_536) -> bytes:
        data = b"" if self.away else bytes(self.came[:limit])
        del self.came[: len(data)]
        return data

    def from_mote(self, octet: int) -> None:
        if not self.away and self.random.random() > self.loss:
            damaged = self.random.random() < self.loss
            self.came.append(octet ^ 0x10 if damaged else octet)

    def flush(self) -> None:
        pass

    def close(self) -> None:
        pass


class World:
    def __init__(self, seed: int, loss: float, monkeypatch: pytest.MonkeyPatch) -> None:
        self.scheduler = Scheduler()
        self.line = Line(seed, loss)
        monkeypatch.setattr("tools.bench.outages.open_transport", lambda url, context: self.line)
        sets = ["hil.mote='x:'", "hil.radio_nodes='base'"]
        self.mote = RealMote(scenario.load("swim-forward", sets, seed=seed), lambda: 0.0)
        self.traces = (Trace(), Trace())
        self.frames: tuple[list[Any], list[Any]] = ([], [])
        media = []
        for trace, kept in zip(self.traces, self.frames, strict=True):
            config = MediumConfig(loss_probability=loss)
            channel = trace.channel("radio")
            media.append(Medium(self.scheduler, config, seed=seed, channel=channel))
            channel.sink(kept.extend)
            media[-1].place("base", Antenna())
        here, there = media
        rail = Rail(self.scheduler, "base", 3.0)
        self.base = BaseStation(self.scheduler, self.traces[0], rail, here, NetworkConfig(BASE))
        self.mote.attach(self.scheduler, here)  # a plain scheduler will do
        self.port = SerialBaseStation(
            self.scheduler, self.traces[1], rail, there, NetworkConfig(BASE), self.line.from_mote
        )
        self.line.usb = self.port.usb
        there.place("robot", Antenna(x_m=lambda _t: 1.0))
        self.robot = Radio()
        config = FirmwareConfig(NetworkConfig(ROBOT), with_robot=False)
        firmware = MoteFirmware(config, self.robot, Hooks())
        TelosB(self.scheduler, rail, there, firmware, "robot", seed)
        self.telemetry: list[Telemetry] = []
        self.base.app.on_telemetry = lambda source, message: self.telemetry.append(message)
        self.look()
        self.run(0.2)

    def look(self) -> None:
        if self.mote.poll():
            self.mote.on_incoming()
        self.scheduler.after(FS_PER_MS, self.look)

    def run(self, seconds: float) -> None:
        self.scheduler.run(self.scheduler.now + round(seconds * 1000) * FS_PER_MS)

    def payloads(self, air: int, source: str, am_type: int) -> list[bytes]:
        """What somebody sent on one of the airs, in order, each frame."""
        self.traces[air].flush()
        found = []
        for _end, (_start, _channel, who, _dbm, psdu) in self.frames[air]:
            frame = mac.decode(psdu[:-2])
            if who == source and frame.payload[:2] == bytes((0x3F, am_type)):
                found.append(frame.payload[2:])
        return found


def first_of_each(payloads: list[bytes]) -> list[bytes]:
    return list(dict.fromkeys(payloads))


@pytest.mark.parametrize(("seed", "loss"), [(1, 0.0), (2, 0.002), (3, 0.004)])
def test_what_is_commanded_is_done_and_nothing_taken_is_lost(
    seed: int, loss: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = World(seed, loss, monkeypatch)
    pending = []
    for number in range(COMMANDS):
        beat = TailBeatCommand(0, 0.01 * number, 0.2, 1.0, 0.0)
        pending.append(world.base.app.send_command(ROBOT, beat))
        world.robot.tell()
        if number == 8:
            world.line.away = True
        if number == 14:
            world.line.away = False
            world.line.openings += 1
        world.run(0.2)
    world.run(8.0)
    # every command was carried out, and its answer came back
    assert [p.status for p in pending] == [CommandStatus.APPLIED] * COMMANDS
    assert set(world.robot.obeyed) == set(range(1, COMMANDS + 1))

    told = world.mote.summary()
    out, back = told["out"], told["in"]
    bridge = world.port.app.counts
    assert told["outages"]["resumptions"] == 1
    assert out["dropped"] == {}
    assert out["waiting"] == back["waiting"] == 0
    assert out["taken"] == out["acknowledged"]
    assert out["heard"] == out["taken"] + out["repeated"]
    # what the mote's radio was given is what was taken, each once but after long silence
    assert out["taken"] <= bridge.from_host <= out["taken"] + out["sent_again"]
    assert bridge.from_host == bridge.on_air + bridge.unanswered
    here = world.payloads(0, "base", 0x10)
    there = world.payloads(1, "base", 0x10)
    assert set(there) == set(here)
    assert first_of_each(there) == first_of_each(here)  # in order
    # upwards: best effort on the line, each once, in order, none made up
    assert back["packets"] == back["admitted"] == back["delivered"] + sum(back["dropped"].values())
    came = first_of_each(world.payloads(0, "mote", 0x21))
    assert came == [p for p in first_of_each(world.payloads(1, "robot", 0x21)) if p in came]
    numbers = [message.sequence for message in world.telemetry]
    assert numbers == sorted(set(numbers))
    # nothing that came in went out again, and nothing of ours came back
    assert world.payloads(1, "base", 0x20) == world.payloads(1, "base", 0x21) == []
    assert world.payloads(0, "mote", 0x10) == []
    if loss == 0.0:
        # but for the absence, telemetry is complete, and every packet was sent once
        assert len(numbers) == COMMANDS - 6
        assert out["sent_again"] <= 1
        assert told["in"]["damaged"] == {}
        assert bridge.from_host == out["taken"]


def test_a_long_absence_uses_no_attempts_up_and_its_end_is_enough(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One pose was on its way when the line went, one came after: each said once, and nobody asks
    for them again."""
    world = World(1, 0.0, monkeypatch)
    world.line.loss = 1.0
    world.base.app.send_pose(ROBOT, Pose(1.0, 0.0, 0.0, 0))
    world.run(0.05)
    assert world.mote.bridge.link.queued == 1
    world.line.loss, world.line.away = 0.0, True
    world.base.app.send_pose(ROBOT, Pose(2.0, 0.0, 0.0, 0))
    world.run(8.0)  # 25 attempts would be 5 s
    assert world.robot.poses == []
    world.line.away = False
    world.line.openings += 1
    world.run(0.5)
    assert world.robot.poses == [1.0, 2.0]
    out = world.mote.summary()["out"]
    assert (out["taken"], out["acknowledged"], out["dropped"]) == (2, 2, {})
    assert out["sent_again"] == 1


def test_the_clock_is_that_of_the_air(monkeypatch: pytest.MonkeyPatch) -> None:
    """Times in the summary follow from the line's rate: nothing is faster than its octets."""
    world = World(1, 0.0, monkeypatch)
    world.base.app.send_command(ROBOT, TailBeatCommand(0, 0.1, 0.2, 1.0, 0.0))
    world.run(1.0)
    told = world.mote.summary()
    octets = 2 + 3 + 7 + 10 + 2  # flags; type, number, dispatch; header; payload; CRC
    least_s = (octets + 6) * 10 / 115_200
    assert told["round_trip"]["count"] == 1
    # escapes add a few; firmware and the look at the line each millisecond add the rest
    assert least_s < told["round_trip"]["maximum_s"] < least_s + 0.004
    assert told["acknowledged"]["maximum_s"] >= told["round_trip"]["maximum_s"]
    # CommandReply: 12 symbols, 6 + 16 octets in the air, back-off up to 7 periods, ACK
    assert 1e-3 < told["to_air"]["maximum_s"] < 8e-3
    assert world.scheduler.now > FS_PER_S
