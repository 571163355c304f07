"""A plant in the loop in a time that tests move: both ends in one process, on wires in memory."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import msgspec

from firmware_model.time import FS_PER_MS, FS_PER_S, from_seconds
from spi_bus.link import Role
from tools import scenario
from tools.bench import Bench
from tools.bench.pace import LineScheduler
from tools.bench.plant_line import PlantLine
from tools.bench.plant_port import PlantPort
from tools.bench.plant_rig import PlantRig


class Time:
    """A clock that moves when somebody waits."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


class Wire:
    """One end of a line in memory, with a delay, that may lose or change what it carries."""

    openings = 1
    pending = 0
    wants_writable = False
    room = 4096

    def __init__(self, time: Time, delay_s: float, description: str) -> None:
        self.time = time
        self.delay_s = delay_s
        self.description = description
        self.coming: deque[tuple[float, bytes]] = deque()
        self.far: Wire | None = None
        self.damage: Callable[[bytes], bytes] = lambda data: data

    def read(self, limit: int = 65_536) -> bytes:
        found = b""
        while self.coming and self.coming[0][0] <= self.time.now_s:
            found += self.coming.popleft()[1]
        return found

    def write(self, data: bytes) -> None:
        assert self.far is not None
        data = self.damage(data)
        if data:
            self.far.coming.append((self.time.now_s + self.delay_s, data))

    def flush(self) -> None: ...

    def fileno(self) -> int:
        return -1

    def next_deadline_s(self) -> float | None:
        return self.coming[0][0] if self.coming else None

    def wait(self, timeout_s: float) -> None:
        self.time.now_s += max(timeout_s, 1e-6)

    def close(self) -> None: ...


def wires(time: Time, delay_s: float = 0.0) -> tuple[Wire, Wire]:
    here, there = Wire(time, delay_s, "wire to the board"), Wire(time, delay_s, "wire to the plant")
    here.far, there.far = there, here
    return here, there


def configured(name: str = "swim-forward", *sets: str, rate_hz: float = 100.0, **more):
    config = scenario.load(name, sets, **more)
    hil = msgspec.structs.replace(config.hil, plant_rate_hz=rate_hz)
    return msgspec.structs.replace(config, hil=hil)


def make_rig(config, wire: Wire, time: Time, *, epoch: int = 1) -> PlantRig:
    line = PlantLine(wire, Role.MASTER, epoch, time)
    return PlantRig(config, line, LineScheduler(line, clock=time), clock=time)


class Board:
    """Both emulated boards, whose chips are at the far end of the wire."""

    def __init__(self, config, wire: Wire, time: Time, *, epoch: int = 2) -> None:
        hil = msgspec.structs.replace(config.hil, plant="pty:")
        config = msgspec.structs.replace(config, hil=hil)
        line = PlantLine(wire, Role.SLAVE, epoch, time)
        self.port = PlantPort(config, line)
        self.scheduler = LineScheduler(line, clock=time)
        self.bench = Bench(config, self.scheduler, port=self.port)


class World:
    """A rig and a board that take turns, of a millisecond each where nothing else is said."""

    def __init__(self, config, *, delay_s: float = 0.0005, turn_fs: int = FS_PER_MS) -> None:
        self.turn_fs = turn_fs
        self.time = Time()
        self.here, self.there = wires(self.time, delay_s)
        self.rig = make_rig(config, self.here, self.time)
        self.board = Board(config, self.there, self.time)

    def run(self, until_s: float) -> None:
        end_fs = from_seconds(until_s)
        at_fs = self.rig.scheduler.now
        while at_fs < end_fs:
            at_fs += self.turn_fs
            self.rig.scheduler.run(at_fs)
            self.board.scheduler.run(at_fs)

    @property
    def now_s(self) -> float:
        return self.rig.scheduler.now / FS_PER_S
