"""Every row of the sensor table, unasked: wired, sampled, reported, with a part and a unit."""

from __future__ import annotations

import pytest

from navboard.chips.gps18x import Gps18xConfig
from navboard.config import NavConfig
from navboard.sensor_controller import SAMPLE_CHANNELS
from navboard.sensors import ANALOG_SENSORS, SENSORS


@pytest.mark.parametrize("sensor", SENSORS, ids=lambda s: s.name)
def test_every_sensor_is_a_channel_that_gets_values(robot, sensor):
    assert sensor.name in SAMPLE_CHANNELS
    assert sensor.part
    assert sensor.unit
    assert sensor.pins or "divider" in sensor.part
    assert sensor.description
    r = robot(config=NavConfig(gps=Gps18xConfig(), tail_potentiometer_fitted=True))
    r.run(3.0)
    index = SAMPLE_CHANNELS.index(sensor.name)
    assert any(values[index] is not None for _t, values in r.samples)


def test_names_and_pins_are_unique():
    names = [sensor.name for sensor in SENSORS]
    channels = [c for sensor in ANALOG_SENSORS for c in sensor.channels]
    assert len(set(names)) == len(names)
    assert len(set(channels)) == len(channels)
    assert not {0, 1, 2} & set(channels)  # programmer and SS1


def test_every_analog_sensor_has_its_row():
    assert {s.name for s in ANALOG_SENSORS} <= {s.name for s in SENSORS}


def test_channel_names_carry_their_unit():
    suffix = {"rad/s": "_rad_s", "m/s²": "_m_s2", "rad": "_rad", "m": "_m", "°C": "_c"}
    suffix |= {"V": "_v", "A": "_a", "µg/L": "_ug_l"}
    for sensor in SENSORS:
        assert sensor.name.endswith(suffix[sensor.unit])


def test_options_leave_their_channels_empty(robot):
    r = robot(config=NavConfig(water_probe_fitted=False))
    r.run(1.0)
    for name in ("water_quality_ug_l", "tail_angle_rad", "gps_x_m"):
        index = SAMPLE_CHANNELS.index(name)
        assert all(values[index] is None for _t, values in r.samples)
