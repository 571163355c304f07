"""The small analog instruments: thermometer, dividers, shunt amplifier, fluorometer, potentiometer.

Each is a transfer function, an error drawn once (its tolerance) and noise at every look. They
return voltages at a pin of the converter.
"""

from __future__ import annotations

import random

from firmware_model.signals import Quantity

# Analog Devices TMP36 (data sheet rev. H, table 1): 500 mV offset, 10 mV/°C, ±1 °C at 25 °C.
TMP36_OFFSET_V = 0.5
TMP36_SLOPE_V_C = 0.010
TMP36_ERROR_SIGMA_C = 0.5  # the ±1 °C limit taken as two sigma
TMP36_NOISE_C = 0.05  # assumed, with the 0.1 µF at the pin
TMP36_SUPPLY_A = 50e-6

BATTERY_DIVIDER = 1.0 / 3.0  # 20 kΩ over 10 kΩ: 8.4 V become 2.8 V
DIVIDER_ERROR_SIGMA = 0.003  # 1 % resistors, ratio error
BATTERY_NOISE_V = 0.003  # assumed, at the pin

# 20 mΩ in the servo's ground, INA213 (×50; TI SBOS437): 1 V/A.
SHUNT_OHM = 0.020
SHUNT_GAIN = 50.0
SHUNT_ERROR_SIGMA = 0.005  # assumed: 1 % shunt and gain error as two sigma
SHUNT_NOISE_V = 0.002  # assumed
SHUNT_SUPPLY_A = 65e-6

# Turner Designs Cyclops-7, chlorophyll or crude oil at gain ×1: 5 V at 500 µg/L (unconfirmed for
# oil), divided by 2 for the converter; 0.1 µg/L of noise and 0.02 V of offset are assumed.
PROBE_FULL_SCALE_UG_L = 500.0
PROBE_FULL_SCALE_V = 2.5
PROBE_OFFSET_V = 0.02
PROBE_NOISE_UG_L = 0.1
PROBE_GAIN_SIGMA = 0.01
PROBE_SUPPLY_A = 60e-3

# Rotary potentiometer on the tail shaft across the 3.3 V supply: 270° of travel, middle at rest.
POTENTIOMETER_TRAVEL_RAD = 4.71238898038469
POTENTIOMETER_NOISE_RAD = 0.003


class Tmp36:
    """Temperature in °C to volts."""

    __slots__ = ("_error", "_gauss", "_quantity")

    def __init__(self, temperature_c: Quantity, rng: random.Random) -> None:
        self._quantity = temperature_c
        self._error = rng.gauss(0.0, TMP36_ERROR_SIGMA_C)
        self._gauss = rng.gauss

    def volts(self, time_fs: int) -> float:
        """Output voltage, V."""
        celsius = self._quantity(time_fs) + self._error + self._gauss(0.0, TMP36_NOISE_C)
        return TMP36_OFFSET_V + TMP36_SLOPE_V_C * celsius


class BatteryDivider:
    """Pack voltage in V to volts at the pin."""

    __slots__ = ("_gauss", "_quantity", "_ratio")

    def __init__(self, battery_v: Quantity, rng: random.Random) -> None:
        self._quantity = battery_v
        self._ratio = BATTERY_DIVIDER * (1.0 + rng.gauss(0.0, DIVIDER_ERROR_SIGMA))
        self._gauss = rng.gauss

    def volts(self, time_fs: int) -> float:
        """Voltage of the tap, V."""
        return self._ratio * self._quantity(time_fs) + self._gauss(0.0, BATTERY_NOISE_V)


class ShuntAmplifier:
    """Servo supply current in A to volts."""

    __slots__ = ("_gauss", "_quantity", "_volts_per_amp")

    def __init__(self, current_a: Quantity, rng: random.Random) -> None:
        self._quantity = current_a
        self._volts_per_amp = SHUNT_OHM * SHUNT_GAIN * (1.0 + rng.gauss(0.0, SHUNT_ERROR_SIGMA))
        self._gauss = rng.gauss

    def volts(self, time_fs: int) -> float:
        """Output voltage, V."""
        return self._volts_per_amp * self._quantity(time_fs) + self._gauss(0.0, SHUNT_NOISE_V)


class WaterProbe:
    """Fluorescence of oil or chlorophyll in µg/L to volts."""

    __slots__ = ("_gauss", "_noise_v", "_quantity", "_slope")

    def __init__(
        self, concentration_ug_l: Quantity, rng: random.Random, noise_scale: float = 1.0
    ) -> None:
        slope = PROBE_FULL_SCALE_V / PROBE_FULL_SCALE_UG_L
        self._quantity = concentration_ug_l
        self._slope = slope * (1.0 + rng.gauss(0.0, PROBE_GAIN_SIGMA))
        self._noise_v = PROBE_NOISE_UG_L * slope * noise_scale
        self._gauss = rng.gauss

    def volts(self, time_fs: int) -> float:
        """Output voltage after its divider, V."""
        signal = PROBE_OFFSET_V + self._slope * self._quantity(time_fs)
        return signal + self._gauss(0.0, self._noise_v)


class TailPotentiometer:
    """Tail angle in rad to the wiper's volts."""

    __slots__ = ("_gauss", "_noise_rad", "_quantity", "_supply_v")

    def __init__(
        self,
        tail_angle_rad: Quantity,
        rng: random.Random,
        supply_v: float = 3.3,
        noise_rad: float = POTENTIOMETER_NOISE_RAD,
    ) -> None:
        self._quantity = tail_angle_rad
        self._supply_v = supply_v
        self._noise_rad = noise_rad
        self._gauss = rng.gauss

    def volts(self, time_fs: int) -> float:
        """Wiper voltage, V."""
        angle = self._quantity(time_fs) + self._gauss(0.0, self._noise_rad)
        return self._supply_v * (0.5 + angle / POTENTIOMETER_TRAVEL_RAD)
