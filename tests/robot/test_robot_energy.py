"""The pack gives what the consumers' own accounts say, short bursts of radio included.

A linear regulator passes current on, so the pack's energy is that of a rail times the ratio of
their voltages. The accounts are exact (`firmware_model.power`); the voltages are the data sheets'.
"""

from __future__ import annotations

import pytest

from tools import scenario
from tools.bench import Bench

RAIL_V = {"navigation board": 3.3, "processing board": 3.0}


def run(*sets: str) -> Bench:
    bench = Bench.from_scenario(
        scenario.load(
            sets=("procboard.application=telemetry", "plant.servo.ideal=true", *sets),
            duration_s=6.0,
        )
    )
    bench.run(lambda seconds: None, lambda: False)
    return bench


def charge_c(bench: Bench) -> float:
    """What the consumers drew, by their accounts."""
    rows = [row for row in bench.robot.power.table() if row.board in RAIL_V]
    return sum(row.joules / RAIL_V[row.board] for row in rows)


def test_the_packs_energy_is_the_consumers_charge_at_its_voltage() -> None:
    bench = run()
    power, charge = bench.robot.power, charge_c(bench)
    volts = [volts for _, volts in power.history]
    assert min(volts) * charge <= power.joules <= max(volts) * charge


def test_more_telemetry_costs_what_the_accounts_say() -> None:
    often, seldom = (run(f"procboard.telemetry_period_s={period}") for period in (0.1, 3.0))
    volts = often.robot.power.history[-1][1]
    told = volts * (charge_c(often) - charge_c(seldom))
    assert told != 0.0
    assert often.robot.power.joules - seldom.robot.power.joules == pytest.approx(told, rel=0.02)


def test_a_cut_supply_draws_nothing_and_what_was_drawn_before_is_counted() -> None:
    bench = run("faults.supply_cuts=[{at_s = 2.05, duration_s = 0.93}]")
    power, charge = bench.robot.power, charge_c(bench)
    volts = [volts for _, volts in power.history if volts]
    assert min(volts) * charge <= power.joules <= max(volts) * charge
