"""HS-5646WP electronics: pulse widths to angles, dead band, range, lost pulses."""

from __future__ import annotations

import math

import pytest

from firmware_model.scheduler import Scheduler
from firmware_model.signals import Signal
from firmware_model.time import FS_PER_MS, FS_PER_S, FS_PER_US
from navboard.chips.hs5646wp import Hs5646wp


class Bench:
    def __init__(self):
        self.scheduler = Scheduler()
        self.wire = Signal("servo", False)
        self.targets = []
        self.servo = Hs5646wp(
            self.scheduler, self.wire, lambda t, angle: self.targets.append((t, angle))
        )

    def pulse(self, width_us):
        start = self.scheduler.now + 20 * FS_PER_MS
        self.scheduler.at(start, lambda: self.wire.set(True))
        self.scheduler.at(start + round(width_us * FS_PER_US), lambda: self.wire.set(False))
        self.scheduler.run(start + 3 * FS_PER_MS)

    @property
    def degrees(self):
        return math.degrees(self.targets[-1][1])


@pytest.mark.parametrize(
    ("width_us", "degrees"),
    [(900, -60), (1200, -30), (1500, 0), (1800, 30), (2100, 60), (2150, 60)],
)
def test_width_is_an_angle(width_us, degrees):
    b = Bench()
    b.pulse(width_us)
    assert b.degrees == pytest.approx(degrees, abs=1e-9)
    assert b.targets[0][0] == (20 * FS_PER_MS + width_us * FS_PER_US)  # known when it ends


@pytest.mark.parametrize(
    ("change_us", "moves"), [(3.9, False), (4.0, True), (-3.9, False), (-4.1, True)]
)
def test_dead_band_is_4_us(change_us, moves):
    b = Bench()
    b.pulse(1500)
    b.pulse(1500 + change_us)
    assert (len(b.targets) == 2) == moves


def test_small_changes_add_up_to_one_move():
    b = Bench()
    for i in range(9):
        b.pulse(1500 + i)
    assert [round(math.degrees(a), 6) for _t, a in b.targets] == [0.0, 0.4, 0.8]


@pytest.mark.parametrize("width_us", [100, 799, 2201, 2800])
def test_pulses_out_of_range_are_ignored(width_us):
    b = Bench()
    b.pulse(width_us)
    assert b.targets == []
    assert b.servo.ignored == 1


def test_servo_lets_go_when_pulses_stop():
    b = Bench()
    for _ in range(5):
        b.pulse(1600)
    last = b.scheduler.now
    b.scheduler.run(last + FS_PER_S)
    assert [angle for _t, angle in b.targets] == [pytest.approx(math.radians(10)), None]
    assert b.targets[-1][0] - last < 110 * FS_PER_MS
    b.pulse(1600)
    assert b.degrees == pytest.approx(10)
