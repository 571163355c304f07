"""Published values, and refusal of nonsense with the field's name."""

import math
import subprocess
import sys
from dataclasses import replace

import pytest

from plant.errors import InvalidParameterError, PlantError
from plant.packing import pack
from plant.parameters import Body, Hydrodynamics, PlantParameters, Servo, Tail, Water
from plant.robots import COEFFICIENT_SETS, fishbed_robot, wang2014
from plant.spheroid import spheroid_added_mass


def test_lamb_factors_reproduce_table_3_1() -> None:
    added = spheroid_added_mass(0.07, 0.033)
    assert added.surge_kg == pytest.approx(0.0621, abs=5e-5)
    assert added.sway_kg == pytest.approx(0.2299, abs=5e-5)
    assert added.yaw_kg_m2 == pytest.approx(1.0413e-4, abs=5e-9)


def test_a_nearly_round_spheroid_has_the_added_mass_of_a_sphere() -> None:
    # a sphere's is half the displaced mass
    added = spheroid_added_mass(0.05, 0.05 * (1 - 1e-4))
    half = 0.5 * 4 / 3 * math.pi * 1000 * 0.05**3
    assert added.surge_kg == pytest.approx(half, rel=1e-3)
    assert added.sway_kg == pytest.approx(half, rel=1e-3)
    assert abs(added.yaw_kg_m2) < 1e-6


def test_defaults_are_table_3_1() -> None:
    body = wang2014().body
    assert body.yaw_inertia_kg_m2 == pytest.approx(5.0797e-4, rel=1e-4)
    packed = pack(wang2014())
    assert packed.m1 == pytest.approx(0.3731)
    assert packed.m2 == pytest.approx(0.5409)
    assert packed.tail_mass == pytest.approx(0.25 * math.pi * 1000 * 0.025**2)
    assert packed.tail_third == pytest.approx(packed.tail_mass * 0.08**3 / 3)
    assert packed.servo_ideal == 1.0
    assert pack(fishbed_robot()).servo_ideal == 0.0
    assert all(isinstance(value, float) for value in packed)


def test_the_adapted_set_is_the_fit_of_table_3_2() -> None:
    # (3.32), (3.33) meet the table within the scatter of a two-parameter line through three points
    adapted = COEFFICIENT_SETS["chapter-3-adapted"]
    for bias_deg, name in ((20, "chapter-3"), (30, "chapter-3-30deg"), (40, "chapter-3-40deg")):
        bias, row = math.radians(bias_deg), COEFFICIENT_SETS[name]
        drag = adapted.drag + adapted.drag_per_bias_squared * bias**2
        yaw = adapted.yaw_drag_n_m_s2 + adapted.yaw_drag_per_bias_n_m_s2 * bias
        assert drag == pytest.approx(row.drag, rel=0.11)
        assert yaw == pytest.approx(row.yaw_drag_n_m_s2, rel=0.02)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Body(mass_kg=-0.1), "body.mass_kg"),
        (lambda: Body(mass_kg=math.nan), "body.mass_kg"),
        (lambda: Body(mass_kg="heavy"), "body.mass_kg"),  # type: ignore[arg-type]
        (lambda: Body(mass_kg=True), "body.mass_kg"),
        (lambda: Body(added_mass_sway_kg=-1.0), "body.added_mass_sway_kg"),
        (lambda: Tail(depth_m=0.0), "tail.depth_m"),
        (lambda: Tail(length_m=math.inf), "tail.length_m"),
        (lambda: Hydrodynamics(drag=-0.1), "hydrodynamics.drag"),
        (lambda: Hydrodynamics(body_motion_in_tail=1.5), "hydrodynamics.body_motion_in_tail"),
        (lambda: Water(density_kg_m3=0.0), "water.density_kg_m3"),
        (lambda: Servo(motor_lag_s=0.0), "servo.motor_lag_s"),
        (lambda: Servo(high_voltage_v=5.0), "servo.high_voltage_v"),
        (lambda: Servo(ideal=1), "servo.ideal"),  # type: ignore[arg-type]
        (lambda: Servo(running_current_a=3.0), "servo.stall_current_a"),
        (lambda: PlantParameters(body=None), "body"),  # type: ignore[arg-type]
        (lambda: replace(Tail(), depth_m=-1.0), "tail.depth_m"),
        (lambda: spheroid_added_mass(0.03, 0.07), "spheroid.semi_axis_m"),
    ],
)
def test_nonsense_is_refused_by_name(make, field: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InvalidParameterError) as caught:
        make()
    assert caught.value.field == field
    assert str(caught.value).startswith(f"{field}: must")
    assert isinstance(caught.value, PlantError)
    assert isinstance(caught.value, ValueError)


def test_the_servo_meets_its_published_points() -> None:
    servo = Servo()
    assert math.radians(60) / servo.speed_limit_rad_s(6.0) == pytest.approx(0.20)
    assert math.radians(60) / servo.speed_limit_rad_s(7.4) == pytest.approx(0.18)
    assert servo.stall_torque_n_m(7.4) == pytest.approx(1.265, abs=1e-3)
    assert servo.speed_limit_rad_s(3.0) == 0.0


def test_parameters_do_not_need_numba() -> None:
    code = (
        "import sys, plant.parameters, plant.battery, plant.fields, plant.camera, plant.tank;"
        "sys.exit('numba' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
