"""Garmin GPS 18x LVC: NMEA 0183 at 4800 baud, a pulse a second, and a position that is late.

At every UTC second with a fix the measurement pulse rises, and the position of that instant is
sent after it, RMC first (Garmin 190-00879-08, section 4.2 and table 2): two sentences take 0.3 s
at 4800 baud, the whole default set 0.97 s. Without a fix RMC says V and fields are empty.

The position error is correlated in time, as satellites' errors are: a first-order process of
`noise_m` RMS an axis and 60 s. Speed and course come from the movement over the last second with
0.1 knot RMS. Both are assumed, and so are the 0.15 s before the first character.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TypeAlias

from firmware_model.scheduler import Event, Priority, Scheduler
from firmware_model.signals import Quantity, Signal
from firmware_model.time import FS_PER_MS, FS_PER_S
from firmware_model.wires import UartListener
from navboard.errors import ConfigurationError

SentenceListener: TypeAlias = Callable[[int, bytes], None]
"""Told of every burst: the time of its fix in femtoseconds, and its characters."""
Fix: TypeAlias = tuple[float, float, float, float]
"""Latitude and longitude in degrees, speed in m/s, course in degrees from true north."""

SENTENCE_ORDER = ("RMC", "GGA", "GSA", "GSV", "GLL", "VTG")  # table 2: the order on the wire
BAUD = 4800
BITS_PER_CHARACTER = 10
LATENCY_FS = 150 * FS_PER_MS
PULSE_WIDTH_FS = 200 * FS_PER_MS  # PGRMC field 13: 20 to 980 ms
PULSE_ERROR_NS = 1_000  # 1 µs once the fix is 4 s old (section 1.6.4.4) …
EARLY_PULSE_ERROR_NS = 100_000  # … and before that, assumed
ERROR_TIME_S = 60.0
SPEED_NOISE_M_S = 0.05
METRES_PER_S_PER_KNOT = 1852.0 / 3600.0
SUPPLY_A = 0.090  # at 5 V (section 1.6.2)
GEOID_M = -34.0  # near East Lansing
ALTITUDE_M = 260.0
_WIRE = int(Priority.WIRE)

# WGS 84 ellipsoid.
_A_M = 6_378_137.0
_E2 = 6.69437999014e-3

# A fixed sky: satellite number, elevation, azimuth (degrees), C/N0 (dB).
_SKY = (
    (2, 71, 14, 47),
    (5, 33, 298, 42),
    (6, 24, 75, 40),
    (12, 55, 230, 46),
    (17, 12, 48, 36),
    (25, 40, 160, 44),
    (29, 18, 195, 38),
    (31, 8, 320, 33),
)


@dataclass(frozen=True, slots=True)
class Gps18xConfig:
    """Where the tank is, and how the receiver is set up."""

    latitude_deg: float = 42.7249
    longitude_deg: float = -84.4793
    north_rad: float = 0.0
    """Direction of true north in the tank, from +x, counter-clockwise."""
    noise_m: float = 1.5
    sentences: tuple[str, ...] = ("RMC", "GGA")
    first_fix_s: float = 1.0
    """Hot start: about one second (190-00879-08, section 1.6.3); cold 45 s."""
    utc: datetime = datetime(2014, 5, 1, 12, 0, 0, tzinfo=UTC)
    """UTC at the start of emulated time."""

    def __post_init__(self) -> None:
        unknown = [s for s in self.sentences if s not in SENTENCE_ORDER]
        if unknown:
            raise ConfigurationError(f"the GPS 18x has no sentence {unknown[0]}")


def metres_per_degree(latitude_deg: float) -> tuple[float, float]:
    """Return metres per degree of latitude and of longitude on the WGS 84 ellipsoid."""
    latitude = math.radians(latitude_deg)
    w2 = 1.0 - _E2 * math.sin(latitude) ** 2
    meridian = _A_M * (1.0 - _E2) / w2**1.5
    normal = _A_M / math.sqrt(w2)
    degree = math.pi / 180.0
    return meridian * degree, normal * math.cos(latitude) * degree


class Gps18x:
    """The receiver. `pps` is its pulse; characters go to `listener`.

    Args:
        scheduler: time.
        x_m, y_m: antenna position in the tank.
        rng: the chip's own generator.
        config: reference position and settings.

    """

    def __init__(
        self,
        scheduler: Scheduler,
        x_m: Quantity,
        y_m: Quantity,
        rng: random.Random,
        config: Gps18xConfig | None = None,
    ) -> None:
        self.config = config = config or Gps18xConfig()
        self.pps: Signal[bool] = Signal("PPS", False)
        self.listener: UartListener | None = None
        self.sentence_listeners: tuple[SentenceListener, ...] = ()
        self._scheduler = scheduler
        self._x = x_m
        self._y = y_m
        self._rng = rng
        self._cos, self._sin = math.cos(config.north_rad), math.sin(config.north_rad)
        self._scale = metres_per_degree(config.latitude_deg)
        self._error = (rng.gauss(0.0, config.noise_m), rng.gauss(0.0, config.noise_m))
        self._last: tuple[float, float] | None = None
        self._on_fs: int | None = None
        self._events: list[Event] = []
        self._burst = b""
        self._index = 0
        self._burst_fs = 0
        self._character: Event | None = None

    def power(self, on: bool) -> None:
        """Start searching, or stop at once."""
        if not on:
            for event in self._events:
                self._scheduler.cancel(event)
            self._scheduler.cancel(self._character)
            self._events.clear()
            self._character = None
            self._on_fs = self._last = None
            self.pps.set(False)
        elif self._on_fs is None:
            self._on_fs = self._scheduler.now
            self._schedule_second(self._scheduler.now // FS_PER_S + 1)

    # --- every second ----------------------------------------------------------------

    def _schedule_second(self, second: int) -> None:
        self._events = [
            self._scheduler.at(second * FS_PER_S, lambda: self._second(second), _WIRE),
        ]

    def _second(self, second: int) -> None:
        assert self._on_fs is not None
        now = self._scheduler.now
        self._schedule_second(second + 1)
        fixed_s = (now - self._on_fs) / FS_PER_S - self.config.first_fix_s
        fix = self._fix(now) if fixed_s >= 0.0 else None
        if fix is not None:
            limit = PULSE_ERROR_NS if fixed_s >= 4.0 else EARLY_PULSE_ERROR_NS
            rise = now + self._rng.randrange(limit) * 1_000_000
            self._events += [
                self._scheduler.at(rise, lambda: self.pps.set(True), _WIRE),
                self._scheduler.at(rise + PULSE_WIDTH_FS, lambda: self.pps.set(False), _WIRE),
            ]
        utc = self.config.utc + timedelta(seconds=second)
        self._send("".join(self._sentences(utc, fix)).encode("ascii"))

    def _fix(self, now: int) -> Fix:
        """Look at the antenna and add the errors of this second."""
        gauss = self._rng.gauss
        keep = math.exp(-1.0 / ERROR_TIME_S)
        drive = self.config.noise_m * math.sqrt(1.0 - keep * keep)
        east_error, north_error = self._error
        self._error = (
            keep * east_error + gauss(0.0, drive),
            keep * north_error + gauss(0.0, drive),
        )
        x, y = self._x(now), self._y(now)
        north = x * self._cos + y * self._sin
        east = x * self._sin - y * self._cos
        before, self._last = self._last, (east, north)
        east_m_s, north_m_s = gauss(0.0, SPEED_NOISE_M_S), gauss(0.0, SPEED_NOISE_M_S)
        if before is not None:
            east_m_s += east - before[0]
            north_m_s += north - before[1]
        latitude = self.config.latitude_deg + (north + self._error[1]) / self._scale[0]
        longitude = self.config.longitude_deg + (east + self._error[0]) / self._scale[1]
        if not -180.0 <= longitude < 180.0:  # across the date line
            longitude = (longitude + 180.0) % 360.0 - 180.0
        latitude = max(-90.0, min(90.0, latitude))
        course = math.degrees(math.atan2(east_m_s, north_m_s)) % 360.0
        return latitude, longitude, math.hypot(east_m_s, north_m_s), course

    # --- sentences -------------------------------------------------------------------

    def _sentences(self, utc: datetime, fix: Fix | None) -> list[str]:
        build = {
            "RMC": self._rmc,
            "GGA": self._gga,
            "GSA": self._gsa,
            "GSV": self._gsv,
            "GLL": self._gll,
            "VTG": self._vtg,
        }
        wanted = self.config.sentences
        return [framed(body) for s in SENTENCE_ORDER if s in wanted for body in build[s](utc, fix)]

    def _rmc(self, utc: datetime, fix: Fix | None) -> list[str]:
        time, date = f"{utc:%H%M%S}", f"{utc:%d%m%y}"
        if fix is None:
            return [f"GPRMC,{time},V,,,,,,,{date},,"]
        speed = fix[2] / METRES_PER_S_PER_KNOT
        return [f"GPRMC,{time},A,{_position(fix)},{speed:05.1f},{_course(fix)},{date},000.0,E"]

    def _gga(self, utc: datetime, fix: Fix | None) -> list[str]:
        time = f"{utc:%H%M%S}"
        if fix is None:
            return [f"GPGGA,{time},,,,,0,00,,,M,,M,,"]
        return [
            (
                f"GPGGA,{time},{_position(fix)},1,{len(_SKY):02d},1.1,"
                f"{ALTITUDE_M:.1f},M,{GEOID_M:.1f},M,,"
            )
        ]

    def _gsa(self, utc: datetime, fix: Fix | None) -> list[str]:
        used = [f"{s[0]:02d}" for s in _SKY] if fix else []
        slots = ",".join(used + [""] * (12 - len(used)))
        return [f"GPGSA,A,{3 if fix else 1},{slots},{'1.9,1.1,1.6' if fix else ',,'}"]

    def _gsv(self, utc: datetime, fix: Fix | None) -> list[str]:
        pages = [_SKY[i : i + 4] for i in range(0, len(_SKY), 4)]
        return [
            f"GPGSV,{len(pages)},{number},{len(_SKY):02d},"
            + ",".join(f"{sat:02d},{up:02d},{az:03d},{cn0:02d}" for sat, up, az, cn0 in page)
            for number, page in enumerate(pages, 1)
        ]

    def _gll(self, utc: datetime, fix: Fix | None) -> list[str]:
        time = f"{utc:%H%M%S}"
        return [f"GPGLL,{_position(fix)},{time},A" if fix else f"GPGLL,,,,,{time},V"]

    def _vtg(self, utc: datetime, fix: Fix | None) -> list[str]:
        if fix is None:
            return ["GPVTG,,T,,M,,N,,K"]
        knots, kmh = fix[2] / METRES_PER_S_PER_KNOT, fix[2] * 3.6
        course = _course(fix)
        return [f"GPVTG,{course},T,{course},M,{knots:05.1f},N,{kmh:06.1f},K"]

    # --- the wire --------------------------------------------------------------------

    def _send(self, data: bytes) -> None:
        if self._character is not None:
            return  # more than a second's worth of sentences: a burst every other second
        for listener in self.sentence_listeners:
            listener(self._scheduler.now, data)
        self._burst = data
        self._index = 0
        self._burst_fs = self._scheduler.now + LATENCY_FS
        if data:
            self._next_character()

    def _next_character(self) -> None:
        """Schedule the middle of the stop bit of the next character: 9.5 bits after its start."""
        half_bits = (2 * BITS_PER_CHARACTER) * self._index + 2 * BITS_PER_CHARACTER - 1
        due = self._burst_fs + half_bits * FS_PER_S // (2 * BAUD)
        self._character = self._scheduler.at(due, self._deliver, _WIRE)

    def _deliver(self) -> None:
        index = self._index
        character = self._burst[index]
        self._index = index + 1
        self._character = None
        if index + 1 < len(self._burst):
            self._next_character()
        if self.listener is not None:
            self.listener(character)


def framed(body: str) -> str:
    """Return `$body*hh` CR LF; the checksum is the XOR of all between $ and * (NMEA 0183)."""
    checksum = 0
    for character in body.encode("ascii"):
        checksum ^= character
    return f"${body}*{checksum:02X}\r\n"


def _position(fix: Fix) -> str:
    return f"{_degrees(fix[0], 2, 'NS')},{_degrees(fix[1], 3, 'EW')}"


def _degrees(value: float, width: int, letters: str) -> str:
    """Return ddmm.mmmm and the hemisphere; carries are right because all is one integer."""
    units = round(abs(value) * 600_000)  # 1e-4 minutes
    degrees, minutes = divmod(units, 600_000)
    letter = letters[value < 0]
    return f"{degrees:0{width}d}{minutes // 10_000:02d}.{minutes % 10_000:04d},{letter}"


def _course(fix: Fix) -> str:
    tenths = round(fix[3] * 10) % 3600
    return f"{tenths // 10:03d}.{tenths % 10}"
