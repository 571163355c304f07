"""Energy accounts against the integral by hand."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_MS, FS_PER_S

CURRENTS = {"idle": 1e-3, "busy": 20e-3}


def test_each_state_has_its_seconds_and_joules() -> None:
    scheduler = Scheduler()
    rail = Rail(scheduler, "vcc", 3.0)
    chip = rail.consumer("chip", CURRENTS)
    scheduler.run(FS_PER_S)
    chip.enter("idle")
    scheduler.run(3 * FS_PER_S)
    chip.enter("busy")
    scheduler.run(3 * FS_PER_S + 500 * FS_PER_MS)
    table = chip.table()
    assert list(table) == ["off", "idle", "busy"]
    assert table["off"] == (1.0, 0.0)
    assert table["idle"] == pytest.approx((2.0, 2.0 * 1e-3 * 3.0))
    assert table["busy"] == pytest.approx((0.5, 0.5 * 20e-3 * 3.0))
    assert chip.joules == pytest.approx(0.036)
    assert rail.joules == chip.joules


def test_a_change_of_voltage_books_the_past_at_the_old_one() -> None:
    scheduler = Scheduler()
    rail = Rail(scheduler, "vcc", 3.0)
    chip = rail.consumer("chip", CURRENTS)
    chip.enter("busy")
    scheduler.run(FS_PER_S)
    rail.set_volts(2.0)
    scheduler.run(2 * FS_PER_S)
    assert chip.joules == pytest.approx(20e-3 * (3.0 + 2.0))


def test_draw_gives_a_state_a_current_of_its_own() -> None:
    scheduler = Scheduler()
    rail = Rail(scheduler, "vcc", 3.0)
    radio = rail.consumer("radio", CURRENTS)
    radio.draw("tx", 17.4e-3)
    scheduler.run(FS_PER_S)
    radio.draw("tx", 8.5e-3)
    scheduler.run(2 * FS_PER_S)
    assert radio.table()["tx"] == pytest.approx((2.0, 3.0 * (17.4e-3 + 8.5e-3)))


def test_the_rail_knows_its_present_current() -> None:
    rail = Rail(Scheduler(), "vcc", 3.0)
    one, two = rail.consumer("one", CURRENTS), rail.consumer("two", CURRENTS)
    one.enter("busy")
    two.enter("idle")
    assert rail.amps == pytest.approx(21e-3)
    one.enter("off")
    assert rail.amps == pytest.approx(1e-3)


def test_a_state_can_change_its_current_while_it_lasts_and_while_it_does_not() -> None:
    scheduler = Scheduler()
    rail = Rail(scheduler, "vcc", 3.0)
    cpu = rail.consumer("cpu", CURRENTS)
    cpu.enter("busy")
    scheduler.run(FS_PER_S)
    cpu.set_current("busy", 10e-3)
    assert rail.amps == 10e-3
    scheduler.run(2 * FS_PER_S)
    cpu.enter("idle")
    cpu.set_current("busy", 1.0)
    assert rail.amps == 1e-3
    assert cpu.table()["busy"] == pytest.approx((2.0, 3.0 * 30e-3))


def test_an_unknown_state_is_an_error() -> None:
    chip = Rail(Scheduler(), "vcc", 3.0).consumer("chip", CURRENTS)
    with pytest.raises(KeyError):
        chip.enter("asleep")


@given(
    st.lists(
        st.tuples(
            st.integers(0, 10**13),
            st.sampled_from(["off", "idle", "busy", "volts", "look"]),
            st.sampled_from([1.8, 3.0, 3.6]),
        ),
        max_size=30,
    )
)
def test_the_account_is_the_integral(steps: list[tuple[int, str, float]]) -> None:
    scheduler = Scheduler()
    rail = Rail(scheduler, "vcc", 3.0)
    chip = rail.consumer("chip", CURRENTS)
    amps, volts, joules, seconds = 0.0, 3.0, 0.0, 0.0
    for delay, what, level in steps:
        scheduler.run(scheduler.now + delay)
        joules += amps * volts * delay / FS_PER_S
        seconds += delay / FS_PER_S
        if what == "volts":
            rail.set_volts(level)
            volts = level
        elif what == "look":
            assert chip.joules == pytest.approx(joules)
        else:
            chip.enter(what)
            amps = {"off": 0.0, **CURRENTS}[what]
    assert chip.joules == pytest.approx(joules)
    assert sum(row[0] for row in chip.table().values()) == pytest.approx(seconds)


def test_charge_is_current_over_time_whatever_the_voltage_and_books_nothing() -> None:
    scheduler = Scheduler()
    rail = Rail(scheduler, "3 V", 3.0)
    radio = rail.consumer("radio", {"rx": 18.8e-3, "tx": 17.4e-3})
    radio.enter("rx")
    scheduler.run(2 * FS_PER_S)
    assert rail.coulombs == pytest.approx(2 * 18.8e-3)
    radio.enter("tx")
    scheduler.run(3 * FS_PER_S)
    rail.set_volts(1.5)
    radio.set_current("tx", 11.0e-3)
    scheduler.run(5 * FS_PER_S)
    charge = 2 * 18.8e-3 + 17.4e-3 + 2 * 11.0e-3
    assert rail.coulombs == pytest.approx(charge)
    assert rail.joules == pytest.approx(3.0 * (charge - 22.0e-3) + 1.5 * 22.0e-3)
