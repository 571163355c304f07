"""gpsdecode reads the receiver's NMEA into the positions that the truth says, within its noise."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytestmark = [
    pytest.mark.oracle,
    pytest.mark.skipif(shutil.which("gpsdecode") is None, reason="gpsdecode is not installed"),
]

RESOLUTION_M = 0.19
"""ddmm.mmmm: a ten-thousandth of a minute of latitude, and at most that of longitude."""


def metres_per_degree(latitude_deg: float) -> tuple[float, float]:
    """Length of a degree of latitude and of longitude on WGS 84, as a published series.

    National Geospatial-Intelligence Agency, "Length of a Degree of Latitude and Longitude".
    """
    phi = math.radians(latitude_deg)
    return (
        111_132.92 - 559.82 * math.cos(2 * phi) + 1.175 * math.cos(4 * phi),
        111_412.84 * math.cos(phi) - 93.5 * math.cos(3 * phi) + 0.118 * math.cos(5 * phi),
    )


def seconds(report: dict[str, Any]) -> float:
    """Seconds since the run's begin, which is noon; the date is left aside.

    An NMEA date has two digits of year, and gpsd moves old ones by 1024 weeks: what it makes of
    ours depends on the year that this machine has.
    """
    hours, minutes, rest = report["time"][11:].rstrip("Z").split(":")
    return (int(hours) - 12) * 3600 + int(minutes) * 60 + float(rest)


def positions(nmea: bytes, place: Path) -> list[dict[str, Any]]:
    """The reports of gpsdecode that have a position."""
    place.write_bytes(nmea)
    with place.open("rb") as file:
        done = subprocess.run(["gpsdecode", "-j"], stdin=file, capture_output=True, check=True)
    reports = [json.loads(line) for line in done.stdout.decode().splitlines()]
    return [
        report for report in reports if report.get("class") == "TPV" and report.get("mode", 0) >= 2
    ]


@pytest.mark.parametrize(
    ("north_rad", "latitude_deg", "longitude_deg"),
    [(0.0, 42.7249, -84.4793), (2.0, -33.8688, 151.2093)],
    ids=["East Lansing", "Sydney, tank turned"],
)
def test_positions_are_those_of_the_truth(
    swim: Any, tmp_path: Path, north_rad: float, latitude_deg: float, longitude_deg: float
) -> None:
    noise_m = 0.02  # below the resolution: what remains is the receiver's arithmetic
    run = swim(
        "swim-forward",
        "navboard.gps.fitted=true",
        f"navboard.gps.noise_m={noise_m}",
        f"navboard.gps.latitude_deg={latitude_deg}",
        f"navboard.gps.longitude_deg={longitude_deg}",
        f"tank.north_rad={north_rad}",
        "tank.size_m=[200.0, 200.0]",
        "tank.corner_m=[-100.0, -100.0]",
        "initial.x_m=60.0",
        "initial.y_m=-35.0",
        "plant.water.current_x_m_s=0.4",
        "plant.water.current_y_m_s=-0.3",
        duration_s=8.0,
    )
    nmea = b"".join(run.values("nav.nmea"))
    found = positions(nmea, tmp_path / "fish.nmea")
    assert len(found) >= 6
    truth = run.data.truth
    per_degree = metres_per_degree(latitude_deg)
    places = []
    for report in found:
        at_s = seconds(report)
        x, y = (float(np.interp(at_s, truth["time_s"], truth[name])) for name in ("x_m", "y_m"))
        north = (report["lat"] - latitude_deg) * per_degree[0]
        east = (report["lon"] - longitude_deg) * per_degree[1]
        # North is `north_rad` counter-clockwise of the tank's x, east a right angle clockwise.
        seen_x = north * math.cos(north_rad) + east * math.sin(north_rad)
        seen_y = north * math.sin(north_rad) - east * math.cos(north_rad)
        assert math.hypot(seen_x - x, seen_y - y) < 5 * noise_m + RESOLUTION_M / math.sqrt(2), at_s
        places.append((x, y))
    # The robot went so far that a fix of another second would not do.
    assert math.dist(places[0], places[-1]) > 1.0
    assert [seconds(report) for report in found] == list(range(2, 2 + len(found)))


def test_noise_is_the_instruments(swim: Any, tmp_path: Path) -> None:
    """With the noise that the scenario names, fixes lie off the truth, and not farther than it."""
    run = swim("swim-forward", "navboard.gps.fitted=true", duration_s=8.0)
    found = positions(b"".join(run.values("nav.nmea")), tmp_path / "fish.nmea")
    gps = run.config.navboard.gps
    per_degree = metres_per_degree(gps.latitude_deg)
    # The robot has hardly left the origin.
    errors = [(report["lat"] - gps.latitude_deg) * per_degree[0] for report in found]
    assert 0.1 < max(map(abs, errors)) < 5 * gps.noise_m


def test_the_log_holds_what_gpsdecode_reads(swim: Any, tmp_path: Path) -> None:
    """From the receiver through UART, driver and link into the mote's log: the same position."""
    from spi_bus.messages import LINK_MESSAGES, GpsReport

    run = swim("swim-forward", "navboard.gps.fitted=true", duration_s=8.0)
    found = positions(b"".join(run.values("nav.nmea")), tmp_path / "fish.nmea")
    by_second = {seconds(report): report for report in found}
    logged = {
        message.fix_time_s - 12 * 3600: message
        for message in map(LINK_MESSAGES.decode, run.values("proc.samples"))
        if isinstance(message, GpsReport) and message.latitude_deg is not None
    }
    both = by_second.keys() & logged.keys()
    assert len(both) >= 5
    for at_s in sorted(both):
        assert logged[at_s].latitude_deg == pytest.approx(by_second[at_s]["lat"], abs=2e-7)
        assert logged[at_s].longitude_deg == pytest.approx(by_second[at_s]["lon"], abs=2e-7)
