"""Charge and energy balance of the pack."""

import pytest

from plant.battery import Battery, BatteryParameters
from plant.errors import InvalidParameterError


def test_a_full_pack_gives_about_its_nominal_energy() -> None:
    battery = Battery()
    while battery.terminal_v(0.5) > 0.0:
        battery.draw(0.5, 10.0)
    assert battery.energy_j / 3600.0 == pytest.approx(13.32, rel=0.05)
    assert battery.charge_drawn_c == pytest.approx(1.8 * 3600.0, rel=0.02)


def test_voltages_at_the_points_of_the_curve() -> None:
    for charge, volts in ((1.0, 8.40), (0.5, 7.68), (0.0, 6.54), (0.85, 8.13)):
        battery = Battery(BatteryParameters(initial_charge=charge))
        assert battery.open_circuit_v() == pytest.approx(volts)
        assert battery.state_of_charge == pytest.approx(charge)


def test_load_takes_its_share_and_cut_off_protects() -> None:
    battery = Battery()
    assert battery.open_circuit_v() - battery.terminal_v(2.0) == pytest.approx(0.24)
    assert battery.terminal_v(21.0) == 0.0
    low = Battery(BatteryParameters(initial_charge=0.01))
    assert low.terminal_v(0.0) > 6.0
    assert low.terminal_v(8.0) == 0.0
    assert Battery(BatteryParameters(initial_charge=0.0)).terminal_v(0.0) == 0.0


def test_charging_stops_at_full() -> None:
    battery = Battery(BatteryParameters(initial_charge=0.9))
    battery.draw(-1.0, 3600.0)
    assert battery.state_of_charge == 1.0


@pytest.mark.parametrize(
    "bad",
    [
        {"cells": 0},
        {"capacity_ah": 0.0},
        {"initial_charge": 1.2},
        {"internal_resistance_ohm": -0.1},
        {"open_circuit_v": ((0.0, 3.0), (0.9, 4.0))},
        {"open_circuit_v": ((0.0, 3.0), (0.5, 2.9), (1.0, 4.0))},
    ],
)
def test_nonsense_is_refused(bad: dict[str, object]) -> None:
    with pytest.raises(InvalidParameterError, match="battery"):
        BatteryParameters(**bad)  # type: ignore[arg-type]
