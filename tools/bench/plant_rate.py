"""Whether a line carries a rate of samples, said before anything is opened.

The time that a sample takes on the line is known from its bytes and the URL's baud or bit rate. A
line that is full to the brim makes every sample later than the one before, so a part of it stays
free for what is sent again.
"""

from __future__ import annotations

from math import floor
from typing import Final

from spi_bus.plant_messages import (
    NMEA_CHARACTERS,
    PLANT_MESSAGES,
    SENSOR_SAMPLE,
    SERVO_PULSE,
)
from spi_bus.transports.capacity import FRAME_OVERHEAD, LineSpeed, line_speed
from tools.errors import ScenarioError

SHARE: Final = 0.9
"""Of a line's time that a rate may take (assumed)."""
NMEA_PER_S: Final = 32
"""Messages of characters a second: 480 characters at 4800 baud, and each burst's rest."""
PULSES_PER_S: Final = 50
STALE_PERIODS: Final = 10
LEAST_STALE_S: Final = 0.05
BAUDS: Final = (9_600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 921_600, 1_000_000)


def stale_after_s(rate_hz: float) -> float:
    """Return how long a board may go on with its last sample: ten periods, 50 ms at least."""
    return max(STALE_PERIODS / rate_hz, LEAST_STALE_S)


def most_rate_hz(speed: LineSpeed, *, gps: bool) -> float:
    """Return the largest rate of samples that a line carries."""
    payload = {row.layout: row.size for row in PLANT_MESSAGES.rows}
    free_s = SHARE
    if gps:
        free_s -= NMEA_PER_S * speed.seconds(payload[NMEA_CHARACTERS])
    if speed.shared:
        free_s -= PULSES_PER_S * speed.seconds(payload[SERVO_PULSE])
    return max(0.0, free_s / speed.seconds(payload[SENSOR_SAMPLE]))


def check_line(url: str, rate_hz: float, *, gps: bool) -> None:
    """Refuse a rate that the line of a URL does not carry.

    Raises:
        ScenarioError: in one line, with what would do.
        TransportUrlError: the URL is none.

    """
    speed = line_speed(url)
    if speed is None:
        return
    most_hz = most_rate_hz(speed, gps=gps)
    if rate_hz <= most_hz:
        return
    octets = next(row.size for row in PLANT_MESSAGES.rows if row.layout is SENSOR_SAMPLE)
    remedy = f"give --rate {floor(most_hz)}" if most_hz >= 10 else ""
    if speed.bits_per_byte:
        enough = [
            baud
            for baud in BAUDS
            if most_rate_hz(LineSpeed(baud, speed.bits_per_byte), gps=gps) >= rate_hz
        ]
        if enough:
            remedy += f"{' or ' if remedy else 'use '}a line of {enough[0]} baud"
    raise ScenarioError(
        f"hil.plant_rate_hz: {rate_hz:g} samples of {octets + FRAME_OVERHEAD} bytes a second do "
        f"not fit a line of {speed.bits_per_s:g} bit/s: {remedy or 'use a faster line'}"
    )
