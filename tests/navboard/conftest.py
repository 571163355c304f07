"""A navigation board with a test's own SPI master at the other end of the wires."""

from __future__ import annotations

import math

import pytest

from firmware_model.power import Rail
from firmware_model.scheduler import Priority, Scheduler
from firmware_model.time import FS_PER_S, FS_PER_US
from firmware_model.trace import Trace
from navboard.board import NavBoard
from navboard.config import NavConfig, NavInputs
from spi_bus.link import Link, LinkError, MessageReceived, Role

BYTE_FS = 30_518_000_000  # 8 bits at 262 kHz
POLL_FS = 20 * 10**12
CHUNK = 24


class Master:
    """Clocks 24 bytes whenever either side has something, every 20 ms."""

    def __init__(self, scheduler, target, data_ready, epoch=1):
        self.scheduler = scheduler
        self.target = target
        self.data_ready = data_ready
        self.link = Link(Role.MASTER, epoch)
        self.messages = []
        self.errors = []
        self.bytes = 0
        self._left = 0
        self._out = b""
        self._in = bytearray()
        self.scheduler.after(POLL_FS, self._poll)

    def _now_us(self):
        return self.scheduler.now // FS_PER_US

    def _poll(self):
        self.link.handle_timer(self._now_us())
        if self.link.wants_to_send or self.data_ready.value:
            self._out = self.link.data_to_send(self._now_us(), CHUNK).ljust(CHUNK, b"\0")
            self._left = CHUNK
            self.target.select(True)
            self._begin()
        else:
            self.scheduler.after(POLL_FS, self._poll)

    def _begin(self):
        self._miso = self.target.begin()
        self.scheduler.after(BYTE_FS, self._end, Priority.WIRE)

    def _end(self):
        self.bytes += 1
        self._in.append(self._miso)
        self.target.end(self._out[CHUNK - self._left])
        self._left -= 1
        if self._left:
            self._begin()
            return
        self.target.select(False)
        for event in self.link.receive(bytes(self._in), self._now_us()):
            if isinstance(event, MessageReceived):
                self.messages.append(event.message)
            elif isinstance(event, LinkError):
                self.errors.append(event)
        self._in.clear()
        self.scheduler.after(20 * BYTE_FS if self.data_ready.value else POLL_FS, self._poll)

    def of(self, kind):
        return [m for m in self.messages if isinstance(m, kind)]


class Robot:
    """Board, master, rail, and the targets that the servo was given."""

    def __init__(self, inputs=None, config=None, seed=1, eeprom=None, master=True):
        self.scheduler = Scheduler()
        self.trace = Trace()
        self.rail = Rail(self.scheduler, "3V3", 3.3)
        self.targets = []
        self.samples = []
        self.board = NavBoard(
            self.scheduler,
            self.trace,
            self.rail,
            inputs or NavInputs(),
            lambda t, angle: self.targets.append((t / FS_PER_S, angle)),
            config or NavConfig(),
            seed,
            eeprom=eeprom,
        )
        self.board.on_sample = lambda t, values: self.samples.append((t / FS_PER_S, values))
        self.master = (
            Master(self.scheduler, self.board.spi, self.board.data_ready) if master else None
        )

    def run(self, seconds):
        self.scheduler.run(round(seconds * FS_PER_S))


@pytest.fixture
def robot():
    return Robot


def turning(rate_rad_s):
    """Inputs of a fish that turns at a constant rate from heading 0."""
    return NavInputs(
        gyro_z_rad_s=lambda t: rate_rad_s,
        heading_rad=lambda t: rate_rad_s * t / FS_PER_S,
        x_m=lambda t: 0.1 * math.sin(rate_rad_s * t / FS_PER_S),
        y_m=lambda t: 0.1 - 0.1 * math.cos(rate_rad_s * t / FS_PER_S),
    )
