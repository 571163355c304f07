"""Alarms, clock calibration and boot counter on the emulated MCU."""

import random

import pytest

from firmware_model.cpu import Flag
from firmware_model.msp430.mcu import Msp430F1611
from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_MS, FS_PER_S, FS_PER_US
from procboard.alarms import TICKS_PER_S, Alarms, ticks_of_us
from procboard.boot_count import count_boot, keep_count
from procboard.clock import calibrate_dco


class Machine:
    """An MCU whose firmware is a list of tasks made by functions of it."""

    def __init__(self, *tasks, **mcu_options):
        self.scheduler = Scheduler()
        self.rail = Rail(self.scheduler, "3V", 3.0)
        self.tasks = tasks
        self.mcu = Msp430F1611(self.scheduler, self.rail, self.main, **mcu_options)

    def main(self, mcu):
        mcu.reg["WDTCTL"].write(0x5A80)
        mcu.interrupts.gie = True
        for number, task in enumerate(self.tasks):
            mcu.cpu.spawn(f"task {number}", task(self))

    def run(self, seconds):
        self.scheduler.run(self.scheduler.now + round(seconds * 1000) * FS_PER_MS)


@pytest.mark.parametrize("us", [0, 1, 30, 31, 61, 320, 1000, 999_999, 1_000_000, 86_400_000_000])
def test_ticks_last_at_least_so_long_and_not_a_tick_longer(us):
    ticks = ticks_of_us(us)
    assert ticks * 1_000_000 >= us * TICKS_PER_S > (ticks - 1) * 1_000_000


def test_alarms_come_at_their_ticks_in_order_however_far():
    # within one count of the timer, over its end, several counts ahead, at once, and in the past
    deadlines = [40_000, 100, 65_535, 65_536, 70_000, 200_001, 131_072, 3, -5, 100]
    heard = []

    def task(machine):
        yield from calibrate_dco(machine.mcu)
        alarms = Alarms(machine.mcu)
        alarms.start()
        start = machine.scheduler.now
        flags = [Flag(str(d)) for d in deadlines]
        for deadline, flag in zip(deadlines, flags, strict=True):
            alarms.at(deadline, flag)

        def waiter(deadline, flag):
            yield flag
            heard.append((alarms.now(), deadline, machine.scheduler.now - start))

        for deadline, flag in zip(deadlines, flags, strict=True):
            machine.mcu.cpu.spawn("waiter", waiter(deadline, flag))
        yield 1

    machine = Machine(task)
    machine.run(8.0)
    # The first two were due before anybody waited: their waiters found the flags set.
    assert [d for _, d, _ in heard] == [3, -5, *sorted(deadlines)[2:]]
    for ticks, deadline, elapsed_fs in heard[2:]:
        assert ticks - deadline in (0, 1, 2)
        late_fs = elapsed_fs - deadline * FS_PER_S // TICKS_PER_S
        # up to a tick early because the counter is cleared between two
        assert -31 * FS_PER_US <= late_fs <= 90 * FS_PER_US


def test_time_goes_on_over_overflows_and_never_back():
    seen = []

    def task(machine):
        yield from calibrate_dco(machine.mcu)
        alarms = Alarms(machine.mcu)
        alarms.start()
        start = machine.scheduler.now
        rng = random.Random(1)
        while True:
            yield from alarms.sleep_us(rng.randrange(1, 90_000))
            seen.append((alarms.now_us(), (machine.scheduler.now - start) // FS_PER_US))

    Machine(task).run(21.0)
    assert len(seen) > 300
    assert all(abs(told - true) < 62 for told, true in seen)
    assert [t for t, _ in seen] == sorted(t for t, _ in seen)


def test_a_cancelled_alarm_sets_nothing():
    flags = [Flag("a"), Flag("b")]

    def task(machine):
        alarms = Alarms(machine.mcu)
        alarms.start()
        first = alarms.after_us(1000, flags[0])
        alarms.after_us(2000, flags[1])
        alarms.cancel(first)
        alarms.cancel(None)
        yield 1

    Machine(task).run(0.5)
    assert [f.is_set for f in flags] == [False, True]


@pytest.mark.parametrize("factor", [0.85, 0.97, 1.0, 1.015, 1.16])
def test_the_dco_is_brought_to_4_mihz(factor):
    def task(machine):
        yield from calibrate_dco(machine.mcu)

    machine = Machine(task, dco_factor=factor)
    machine.run(0.5)
    frequency = float(machine.mcu.clocks.smclk.frequency_hz)
    assert 4 * 2**20 * 0.99 < frequency < 4 * 2**20 * 1.002
    assert machine.mcu.clocks.mclk.frequency_hz == machine.mcu.clocks.smclk.frequency_hz


def test_every_boot_has_a_number_of_its_own():
    numbers = []

    def task(machine):
        yield from calibrate_dco(machine.mcu)
        numbers.append((yield from count_boot(machine.mcu)))

    machine = Machine(task)
    for _ in range(300):
        machine.run(0.05)
        machine.mcu.press_reset()
    assert numbers == list(range(1, 301))
    # two segments of 64 words take turns
    assert set(machine.mcu.flash.erase_counts) == {0x1000, 0x1080}
    assert sum(machine.mcu.flash.erase_counts.values()) == (300 - 128 - 1) // 64 + 1


def test_a_power_cut_while_counting_never_repeats_a_number():
    numbers = []

    def task(machine):
        yield from calibrate_dco(machine.mcu)
        numbers.append((yield from count_boot(machine.mcu)))

    machine = Machine(task)
    rng = random.Random(2)
    for _ in range(200):
        machine.rail.set_volts(3.0)
        # 2 ms of brown-out delay, 3 ms of calibration, then some of the work: an erase is 12 ms
        machine.scheduler.run(machine.scheduler.now + 4 * FS_PER_MS + rng.randrange(15 * FS_PER_MS))
        machine.rail.set_volts(0.0)
        machine.run(0.01)
    assert len(numbers) > 100
    assert len(set(numbers)) == len(numbers)


def test_a_board_that_had_boots_before_counts_on():
    numbers = []

    def task(machine):
        yield from calibrate_dco(machine.mcu)
        numbers.append((yield from count_boot(machine.mcu)))

    machine = Machine(task)
    keep_count(machine.mcu, 40_000)
    for _ in range(2):
        machine.run(0.1)
        machine.mcu.press_reset()
    assert numbers == [40_001, 40_002]
    with pytest.raises(ValueError, match="boots = 0"):
        keep_count(machine.mcu, 0)


def test_the_count_begins_again_after_65520():
    numbers = []

    def task(machine):
        yield from calibrate_dco(machine.mcu)
        numbers.append((yield from count_boot(machine.mcu)))

    machine = Machine(task)
    machine.mcu.memory[0x1080:0x1082] = (0xFFEF).to_bytes(2, "little")
    for _ in range(3):
        machine.run(0.1)
        machine.mcu.press_reset()
    assert numbers == [0xFFF0, 1, 2]
