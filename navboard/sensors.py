"""The table of sensors: what is measured, by which part, where it is wired, who reads it.

`fishbed list sensors`, the board's wiring and the contract tests read this table. An analog sensor
is one row, one chip that turns a quantity into volts and one driver function that turns counts
back: the board wires it, scans it and puts it into the samples by the row alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from navboard.chips import analog as chips
from navboard.chips.lpy503al import SUPPLY_A as LPY503AL_SUPPLY_A
from navboard.chips.lpy503al import Lpy503al
from navboard.chips.lsm303dlh import SUPPLY_A as LSM303DLH_SUPPLY_A
from navboard.chips.noise import chip_random
from navboard.drivers import analog as drivers

if TYPE_CHECKING:
    from firmware_model.signals import Quantity
    from navboard.config import NavConfig, NavInputs

ANALOG_SUPPLY_V = 3.3


class Sensor(NamedTuple):
    """A row: one measured quantity."""

    name: str
    """Channel of samples and of channels.csv."""
    part: str
    unit: str
    pins: str
    description: str
    supply_a: float = 0.0


@dataclass(frozen=True, slots=True)
class AnalogSensor:
    """How a row of the table is wired to the converter."""

    name: str
    channels: tuple[int, ...]
    """ANx, in the order of what `outputs` returns and `convert` takes."""
    outputs: Callable[[NavInputs, NavConfig, int], tuple[Quantity, ...] | None]
    """Builds the chip: voltages at the pins; None where it is not fitted."""
    convert: Callable[..., float] = field(repr=False)
    """Driver: counts of the channels to SI."""
    slow: bool = False
    """Whether it changes so slowly that every fifth tick is enough."""


def _gyro(inputs: NavInputs, config: NavConfig, seed: int) -> tuple[Quantity, ...]:
    chip = Lpy503al(
        inputs.gyro_z_rad_s,
        chip_random(seed, config.name, "lpy503al"),
        ANALOG_SUPPLY_V,
        config.gyro_bias_rad_s,
        config.gyro_noise_scale,
    )
    return chip.x4, chip.x1


def _temperature(inputs: NavInputs, config: NavConfig, seed: int) -> tuple[Quantity, ...]:
    return (chips.Tmp36(inputs.temperature_c, chip_random(seed, config.name, "tmp36")).volts,)


def _battery(inputs: NavInputs, config: NavConfig, seed: int) -> tuple[Quantity, ...]:
    return (
        chips.BatteryDivider(inputs.battery_v, chip_random(seed, config.name, "divider")).volts,
    )


def _current(inputs: NavInputs, config: NavConfig, seed: int) -> tuple[Quantity, ...]:
    rng = chip_random(seed, config.name, "ina213")
    return (chips.ShuntAmplifier(inputs.servo_current_a, rng).volts,)


def _water(inputs: NavInputs, config: NavConfig, seed: int) -> tuple[Quantity, ...] | None:
    if not config.water_probe_fitted:
        return None
    rng = chip_random(seed, config.name, "cyclops7")
    probe = chips.WaterProbe(inputs.water_quality_ug_l, rng, config.water_probe_noise_scale)
    return (probe.volts,)


def _tail(inputs: NavInputs, config: NavConfig, seed: int) -> tuple[Quantity, ...] | None:
    if not config.tail_potentiometer_fitted:
        return None
    rng = chip_random(seed, config.name, "potentiometer")
    wiper = chips.TailPotentiometer(
        inputs.tail_angle_rad, rng, ANALOG_SUPPLY_V, config.tail_potentiometer_noise_rad
    )
    return (wiper.volts,)


# AN0 and AN1 are the programmer's pins, AN2 is SS1.
ANALOG_SENSORS = (
    AnalogSensor("gyro_z_rad_s", (3, 4), _gyro, drivers.gyro_rad_s),
    AnalogSensor("temperature_c", (5,), _temperature, drivers.temperature_c, slow=True),
    AnalogSensor("battery_v", (6,), _battery, drivers.battery_v, slow=True),
    AnalogSensor("servo_current_a", (7,), _current, drivers.servo_current_a),
    AnalogSensor("water_quality_ug_l", (8,), _water, drivers.water_quality_ug_l, slow=True),
    AnalogSensor("tail_angle_rad", (9,), _tail, drivers.tail_angle_rad),
)

SENSORS = (
    Sensor(
        "gyro_z_rad_s",
        "ST LPY503AL",
        "rad/s",
        "AN3 (×4), AN4 (×1)",
        "yaw rate, ±30 °/s and ±120 °/s outputs, 50 Hz [rad/s]",
        LPY503AL_SUPPLY_A,
    ),
    Sensor(
        "accel_x_m_s2",
        "ST LSM303DLH",
        "m/s²",
        "I²C 0x18",
        "specific force forward, 25 Hz [m/s²]",
        LSM303DLH_SUPPLY_A,
    ),
    Sensor("accel_y_m_s2", "ST LSM303DLH", "m/s²", "I²C 0x18", "specific force left, 25 Hz [m/s²]"),
    Sensor("accel_z_m_s2", "ST LSM303DLH", "m/s²", "I²C 0x18", "specific force up, 25 Hz [m/s²]"),
    Sensor("compass_rad", "ST LSM303DLH", "rad", "I²C 0x1E", "magnetic heading, 15 Hz [rad]"),
    Sensor("gps_x_m", "Garmin GPS 18x LVC", "m", "UART2, INT1", "GPS position along x, 1 Hz [m]"),
    Sensor("gps_y_m", "Garmin GPS 18x LVC", "m", "UART2, INT1", "GPS position along y, 1 Hz [m]"),
    Sensor(
        "temperature_c",
        "Analog Devices TMP36",
        "°C",
        "AN5",
        "water temperature, 10 Hz [°C]",
        chips.TMP36_SUPPLY_A,
    ),
    Sensor("battery_v", "divider 20 kΩ / 10 kΩ", "V", "AN6", "pack voltage, 10 Hz [V]"),
    Sensor(
        "servo_current_a",
        "20 mΩ shunt, TI INA213",
        "A",
        "AN7",
        "supply current of the servo, 50 Hz [A]",
        chips.SHUNT_SUPPLY_A,
    ),
    Sensor(
        "water_quality_ug_l",
        "Turner Designs Cyclops-7",
        "µg/L",
        "AN8",
        "fluorescence of oil or algae, 10 Hz, optional [µg/L]",
        chips.PROBE_SUPPLY_A,
    ),
    Sensor(
        "tail_angle_rad",
        "shaft potentiometer, 270°",
        "rad",
        "AN9",
        "true tail angle, 50 Hz, optional [rad]",
    ),
)
"""Every measured channel, in the order of `fishbed list sensors`."""
