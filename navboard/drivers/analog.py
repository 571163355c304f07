"""From ADC counts to SI: one function for each analog instrument.

The reference is the 3.3 V analog supply, 4096 counts. Each function takes the counts of the
channels that its instrument occupies.
"""

from __future__ import annotations

import math

REFERENCE_V = 3.3
VOLTS_PER_COUNT = REFERENCE_V / 4096

_GYRO_ZERO_V = 1.23  # LPY503AL: zero-rate level
_GYRO_X4_RAD_S_V = math.radians(1.0) / 33.3e-3
_GYRO_X1_RAD_S_V = math.radians(1.0) / 8.3e-3
_GYRO_X4_LOW = round((_GYRO_ZERO_V - 29 * 33.3e-3) / VOLTS_PER_COUNT)
_GYRO_X4_HIGH = round((_GYRO_ZERO_V + 29 * 33.3e-3) / VOLTS_PER_COUNT)


def gyro_rad_s(x4_counts: int, x1_counts: int) -> float:
    """Yaw rate from both outputs: ×4 within ±29 °/s for its resolution, ×1 beyond."""
    if _GYRO_X4_LOW < x4_counts < _GYRO_X4_HIGH:
        return ((x4_counts + 0.5) * VOLTS_PER_COUNT - _GYRO_ZERO_V) * _GYRO_X4_RAD_S_V
    return ((x1_counts + 0.5) * VOLTS_PER_COUNT - _GYRO_ZERO_V) * _GYRO_X1_RAD_S_V


def temperature_c(counts: int) -> float:
    """Temperature of a TMP36: 0.5 V at 0 °C, 10 mV/°C."""
    return ((counts + 0.5) * VOLTS_PER_COUNT - 0.5) * 100.0


def battery_v(counts: int) -> float:
    """Pack voltage behind 20 kΩ over 10 kΩ."""
    return (counts + 0.5) * VOLTS_PER_COUNT * 3.0


def servo_current_a(counts: int) -> float:
    """Servo current: 20 mΩ, ×50: 1 A/V."""
    return counts * VOLTS_PER_COUNT


def water_quality_ug_l(counts: int) -> float:
    """Fluorometer: 20 mV offset, 200 µg/L a volt after its divider."""
    return max(0.0, ((counts + 0.5) * VOLTS_PER_COUNT - 0.020) * 200.0)


def tail_angle_rad(counts: int) -> float:
    """Potentiometer across the reference: 270° of travel, the middle at rest (ratiometric)."""
    return ((counts + 0.5) / 4096 - 0.5) * math.radians(270.0)
