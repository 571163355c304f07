"""Every row of the table: what the contract calls it, neutral at zero, within its bounds."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from plant.parameters import Walls
from plant.robots import wang2014
from tests.diagnosis.fish.fish_runs import NAMES, NOISE, blank
from tools.diagnosis.causes import CAUSES
from tools.diagnosis.fish.model import FishModel
from tools.diagnosis.model import Cause, Filter, Run

CONTRACT = """
water_current cx_m_s cy_m_s
tail_offset delta_rad
tail_gain g
tail_fade k_per_s
servo_lag tau_s
servo_delay delay_s
servo_rate_limit excess_s_rad
servo_deadband delta_rad
servo_backlash play_rad
drag_scale k
yaw_drag_scale k
lift_scale k
drag_vs_bias cd_per_rad2 kd_per_rad
linear_drag b_n_s_m
added_mass_surge k
added_mass_sway k
added_inertia_yaw k
payload dm_kg
tail_flexibility compliance_rad_n_m
fin_damage k
tail_body_coupling k
wall_effect k
gyro_bias b_rad_s
gyro_scale k
compass_offset delta_rad
compass_hard_iron a phi_rad
compass_soft_iron a phi_rad
camera_scale k
camera_rotation delta_rad
camera_delay delay_s
clock_drift k
stale_samples hold_s
dropped_commands p
"""
"""Names and parameters as data, scripts and users know them."""


@cache
def model() -> FishModel:
    walls = Walls(x_min_m=-0.3, y_min_m=-0.3, x_max_m=0.3, y_max_m=0.3)
    return FishModel(replace(wang2014(), walls=walls), NAMES)


@cache
def run() -> Run:
    drawn = model().draw(blank(21, 10.0), {}, NOISE, np.random.default_rng(21))
    # a camera that stalls now and then, so that every cause has something to do
    for channel in range(3):
        here = np.flatnonzero(drawn.channel == channel)
        drawn.value[here[40:46]] = drawn.value[here[40]]
    return drawn


@cache
def fixed() -> Filter:
    return model().filter(run(), {}, NOISE)


def test_the_names_are_the_contracts() -> None:
    wanted = {line.split()[0]: line.split()[1:] for line in CONTRACT.split("\n") if line}
    found = {
        name: [p.name.partition(".")[2] for p in row.cause.reported]
        for name, row in CAUSES.items()
        if name != "unknown_force"
    }
    assert found == wanted
    assert [*CAUSES][-1] == "unknown_force"
    assert [cause.name for cause in model().causes] == [*wanted]


@pytest.mark.parametrize("cause", model().causes, ids=lambda cause: cause.name)
def test_the_neutral_value_is_the_believed_model_to_the_bit(cause: Cause) -> None:
    neutral = cause.values(*(0.0 for _ in cause.parameters))
    base = model().innovations(run(), {}, fixed())
    assert model().innovations(run(), neutral, fixed()).tobytes() == base.tobytes()
    assert model().setup(neutral) == model().setup({})


@pytest.mark.parametrize("cause", model().causes, ids=lambda cause: cause.name)
def test_a_size_that_matters_changes_the_innovations(cause: Cause) -> None:
    values = cause.values(
        *(min(5.0 * p.scale, 0.5 * p.most) if p.most > 0.0 else p.least for p in cause.parameters)
    )
    base = model().innovations(run(), {}, fixed())
    changed = model().innovations(run(), values, fixed())
    assert np.all(np.isfinite(changed))
    moved = float(np.sum((changed - base) ** 2 / fixed().variance))
    assert moved > 1e-3


@pytest.mark.parametrize("cause", model().causes, ids=lambda cause: cause.name)
def test_bounds_hold_the_neutral_value_and_what_is_within_them_computes(cause: Cause) -> None:
    for parameter in cause.parameters:
        assert parameter.least <= 0.0 <= parameter.most
        assert 0.0 < parameter.scale < max(-parameter.least, parameter.most)
        for bound in (parameter.least, parameter.most):
            found = model().innovations(run(), {parameter.name: bound}, fixed())
            assert np.all(np.isfinite(found))


@pytest.mark.parametrize("cause", model().causes, ids=lambda cause: cause.name)
def test_the_statement_is_a_sentence_with_its_numbers(cause: Cause) -> None:
    numbers = cause.report([p.scale for p in cause.parameters])
    shorts = [p.name.partition(".")[2] for p in cause.reported]
    text = cause.statement.format(**dict(zip(shorts, numbers, strict=True)))
    assert text[0].isupper()
    assert text.endswith(".")
    assert set(re.findall(r"{(\w+)", cause.statement)) == set(shorts)


def test_a_phase_is_that_of_its_parts() -> None:
    cause = CAUSES["compass_hard_iron"].cause
    a, phi = cause.report([0.3, -0.4])
    assert a == pytest.approx(0.5)
    for psi in (0.1, 2.0, -3.0):
        assert a * np.sin(psi - phi) == pytest.approx(0.3 * np.sin(psi) + 0.4 * np.cos(psi))


def test_tolerances_are_neutral_at_zero_and_have_priors() -> None:
    base = model().innovations(run(), {}, fixed())
    for parameter in model().tolerances:
        assert 0.0 < parameter.prior_sd < np.inf
        assert (
            model().innovations(run(), {parameter.name: 0.0}, fixed()).tobytes() == base.tobytes()
        )
        moved = model().innovations(run(), {parameter.name: parameter.prior_sd}, fixed())
        assert moved.tobytes() != base.tobytes()


def test_every_term_of_the_library_acts_on_its_own_axis() -> None:
    base = model().innovations(run(), {}, fixed())
    for parameter in model().library:
        moved = model().innovations(run(), {parameter.name: parameter.scale}, fixed())
        assert np.all(np.isfinite(moved))
        assert moved.tobytes() != base.tobytes(), parameter.name


def test_what_cannot_be_is_far_off_and_no_crash() -> None:
    """A camera a kilometre off, in water that turns: no robot starts at rest at 50 m/s."""
    far = replace(run(), value=np.where(run().channel == 1, 1e3, run().value))
    lost = model().innovations(far, {"unknown_force.current_x:y": 0.2}, fixed())
    assert np.all(np.abs(lost) >= 100.0 * np.sqrt(fixed().variance))
