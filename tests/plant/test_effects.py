"""The table of effects: what each row changes, what it refuses, and that neutral changes no bit."""

import math
import struct
from dataclasses import replace

import numpy as np
import pytest

from plant.effects import EFFECTS, with_effects
from plant.errors import InvalidParameterError
from plant.integrate import simulate
from plant.layout import Column
from plant.packing import pack
from plant.parameters import PlantParameters, Walls
from plant.robots import fishbed_robot, flexible_tail, wang2014
from plant.tail_input import TailBeat, TailProgramme

ODD = replace(
    fishbed_robot(),
    walls=Walls(0.3, 10.0, x_min_m=-1.0, x_max_m=1.1),
    hydrodynamics=replace(
        wang2014().hydrodynamics,
        drag_per_bias_squared=0.1412,
        lift_per_bias=0.1,
        yaw_drag_per_bias_n_m_s2=4.4e-4,
        linear_drag_n_s_m=0.01,
        body_motion_in_tail=0.7,
    ),
    servo=replace(fishbed_robot().servo, command_lag_s=0.03, slowness_s_rad=0.7),
    linkage=replace(fishbed_robot().linkage, gain_error=0.1, offset_rad=0.3, play_rad=0.01),
)
"""A plant in which hardly anything is neutral."""


def bits(plant: PlantParameters) -> bytes:
    """Everything that compiled code reads, and what it does not."""
    packed = pack(plant)
    return struct.pack(f"<{len(packed)}d", *packed) + repr(plant).encode()


def test_the_rows_are_the_physical_causes_and_their_parameters() -> None:
    assert {name: [item.name for item in row.parameters] for name, row in EFFECTS.items()} == {
        "water_current": ["cx_m_s", "cy_m_s"],
        "tail_offset": ["delta_rad"],
        "tail_gain": ["g"],
        "tail_fade": ["k_per_s"],
        "servo_lag": ["tau_s"],
        "servo_delay": ["delay_s"],
        "servo_rate_limit": ["excess_s_rad"],
        "servo_deadband": ["delta_rad"],
        "servo_backlash": ["play_rad"],
        "drag_scale": ["k"],
        "yaw_drag_scale": ["k"],
        "lift_scale": ["k"],
        "drag_vs_bias": ["cd_per_rad2", "kd_per_rad"],
        "linear_drag": ["b_n_s_m"],
        "added_mass_surge": ["k"],
        "added_mass_sway": ["k"],
        "added_inertia_yaw": ["k"],
        "payload": ["dm_kg"],
        "tail_flexibility": ["compliance_rad_n_m"],
        "fin_damage": ["k"],
        "tail_body_coupling": ["k"],
        "wall_effect": ["k"],
    }
    for name, row in EFFECTS.items():
        assert row.name == name
        assert row.description
        for item in row.parameters:
            assert item.neutral == 0.0
            assert item.least <= 0.0 < item.most


@pytest.mark.parametrize("name", EFFECTS)
def test_neutral_values_leave_every_bit(name: str) -> None:
    neutral = {item.name: item.neutral for item in EFFECTS[name].parameters}
    for plant in (wang2014(), fishbed_robot(), ODD):
        assert bits(EFFECTS[name].apply(plant, neutral)) == bits(plant)
        assert bits(EFFECTS[name].apply(plant, {})) == bits(plant)


def test_each_row_changes_what_it_says() -> None:
    def changed(name: str, **values: float) -> PlantParameters:
        return EFFECTS[name].apply(ODD, values)

    body, hydro, servo, linkage = ODD.body, ODD.hydrodynamics, ODD.servo, ODD.linkage
    water = changed("water_current", cx_m_s=0.02, cy_m_s=-0.03).water
    assert (water.current_x_m_s, water.current_y_m_s) == (0.02, -0.03)
    drag = changed("drag_scale", k=0.2).hydrodynamics
    assert drag.drag == pytest.approx(1.2 * hydro.drag)
    assert drag.drag_per_bias_squared == pytest.approx(1.2 * hydro.drag_per_bias_squared)
    yaw = changed("yaw_drag_scale", k=-0.2).hydrodynamics
    assert yaw.yaw_drag_n_m_s2 == pytest.approx(0.8 * hydro.yaw_drag_n_m_s2)
    assert yaw.yaw_drag_per_bias_n_m_s2 == pytest.approx(0.8 * hydro.yaw_drag_per_bias_n_m_s2)
    lift = changed("lift_scale", k=0.5).hydrodynamics
    assert (lift.lift, lift.lift_per_bias) == pytest.approx((6.75, 0.15))
    bent = changed("drag_vs_bias", cd_per_rad2=0.2, kd_per_rad=1e-4).hydrodynamics
    assert bent.drag_per_bias_squared == pytest.approx(0.3412)
    assert bent.yaw_drag_per_bias_n_m_s2 == pytest.approx(5.4e-4)
    assert changed("linear_drag", b_n_s_m=0.02).hydrodynamics.linear_drag_n_s_m == 0.03
    for name, field in (
        ("added_mass_surge", "added_mass_surge_kg"),
        ("added_mass_sway", "added_mass_sway_kg"),
        ("added_inertia_yaw", "added_inertia_yaw_kg_m2"),
    ):
        expected = 1.3 * getattr(body, field)
        assert getattr(changed(name, k=0.3).body, field) == pytest.approx(expected)
    heavy = changed("payload", dm_kg=0.0311).body
    assert heavy.mass_kg == pytest.approx(1.1 * body.mass_kg)
    assert heavy.yaw_inertia_kg_m2 == pytest.approx(1.1 * body.yaw_inertia_kg_m2)
    assert changed("fin_damage", k=0.2).tail.depth_m == pytest.approx(0.02)
    soft = changed("tail_flexibility", compliance_rad_n_m=200.0)
    assert (soft.tail.segments, soft.tail.damping_s) == (5, 0.079)
    assert soft.tail.joint_stiffness_n_m == pytest.approx(5e-3)
    softer = EFFECTS["tail_flexibility"].apply(soft, {"compliance_rad_n_m": 50.0})
    assert softer.tail.joint_stiffness_n_m == pytest.approx(4e-3)
    coupled = changed("tail_body_coupling", k=-0.3).hydrodynamics
    assert coupled.body_motion_in_tail == pytest.approx(0.4)
    assert changed("wall_effect", k=0.4).walls.drag_rise == pytest.approx(0.7)
    assert changed("tail_offset", delta_rad=0.05).linkage.offset_rad == pytest.approx(0.35)
    gain = changed("tail_gain", g=-0.2).linkage.gain_error
    assert 1 + gain == pytest.approx((1 + linkage.gain_error) * 0.8)
    assert changed("tail_fade", k_per_s=0.01).linkage.fade_per_s == 0.01
    assert changed("servo_backlash", play_rad=0.02).linkage.play_rad == pytest.approx(0.03)
    lag = changed("servo_lag", tau_s=0.1).servo.command_lag_s
    assert lag == pytest.approx(servo.command_lag_s + 0.1)
    assert changed("servo_delay", delay_s=0.04).servo.command_delay_s == 0.04
    assert changed("servo_deadband", delta_rad=0.01).servo.extra_dead_band_rad == 0.01
    slow = EFFECTS["servo_rate_limit"].apply(fishbed_robot(), {"excess_s_rad": 0.5}).servo
    assert slow.speed_limit_rad_s(7.4) == 2.0
    assert slow.speed_limit_rad_s(3.0) == 0.0


def test_a_hardly_flexible_tail_swims_as_the_rigid_one() -> None:
    beat = TailProgramme.steady(TailBeat.degrees(20, 15, 0.9))
    rigid = simulate(wang2014(), beat, 5.0, 5e-3)
    differences = []
    for compliance in (1.0, 0.5):
        plant = with_effects(wang2014(), {"tail_flexibility": {"compliance_rad_n_m": compliance}})
        run = simulate(plant, beat, 5.0, 5e-3)
        differences.append(run.rows[-1, : Column.R + 1] - rigid.rows[-1, : Column.R + 1])
    assert np.max(np.abs(differences[0])) < 1e-3
    np.testing.assert_allclose(differences[0], 2 * differences[1], rtol=0.05, atol=2e-6)


def test_a_beam_has_no_joints_to_soften() -> None:
    beam = replace(wang2014(), tail=flexible_tail(1, 3))
    with pytest.raises(InvalidParameterError, match=r"effects\.tail_flexibility"):
        with_effects(beam, {"tail_flexibility": {"compliance_rad_n_m": 10.0}})


def test_effects_are_applied_in_the_tables_order_whatever_the_order_given() -> None:
    values = {"tail_gain": {"g": 0.1}, "payload": {"dm_kg": 0.02}, "drag_scale": {"k": 0.1}}
    forwards = with_effects(wang2014(), values)
    assert forwards == with_effects(wang2014(), dict(reversed(values.items())))
    assert forwards.body.mass_kg == pytest.approx(0.331)
    assert forwards.linkage.gain_error == 0.1


@pytest.mark.parametrize(
    ("name", "values", "field"),
    [
        ("payload", {"dm_kg": -0.4}, "effects.payload"),
        ("payload", {"dm_kg": math.nan}, "effects.payload.dm_kg"),
        ("drag_scale", {"k": -1.1}, "effects.drag_scale.k"),
        ("drag_vs_bias", {"cd_per_rad2": -0.5}, "effects.drag_vs_bias"),
        ("drag_vs_bias", {"kd_per_rad": -0.01}, "effects.drag_vs_bias"),
        ("tail_body_coupling", {"k": 0.1}, "effects.tail_body_coupling"),
        ("tail_body_coupling", {"k": -1.5}, "effects.tail_body_coupling.k"),
        (
            "tail_flexibility",
            {"compliance_rad_n_m": -1.0},
            "effects.tail_flexibility.compliance_rad_n_m",
        ),
        ("fin_damage", {"k": 1.0}, "effects.fin_damage.k"),
        ("servo_lag", {"tau_s": -0.1}, "effects.servo_lag.tau_s"),
        ("tail_gain", {"k": 0.1}, "effects.tail_gain.k"),
        ("rust", {"k": 0.1}, "effects.rust"),
    ],
)
def test_the_impossible_is_refused_with_its_path(
    name: str, values: dict[str, float], field: str
) -> None:
    with pytest.raises(InvalidParameterError) as caught:
        with_effects(wang2014(), {name: values})
    assert caught.value.field == field
    assert len(caught.value.reason) > 10
