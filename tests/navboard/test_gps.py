"""GPS 18x LVC: sentences against NMEA and gpsd, timing on the wire, PPS, driver and local plane."""

from __future__ import annotations

import itertools
import json
import math
import random
import shutil
import subprocess
from datetime import UTC, datetime, timedelta

import pytest

from firmware_model.scheduler import Scheduler
from firmware_model.signals import constant
from firmware_model.time import FS_PER_MS, FS_PER_S, FS_PER_US
from navboard.chips.gps18x import SENTENCE_ORDER, Gps18x, Gps18xConfig, framed, metres_per_degree
from navboard.drivers.gps18x import FixBuilder, fields
from navboard.errors import ConfigurationError, SentenceError
from navboard.sensor_controller import local_position


class Receiver:
    """A receiver that is switched on at time 0 and what came out of it."""

    def __init__(self, x=lambda t: 0.0, y=lambda t: 0.0, seed=1, **config):
        self.scheduler = Scheduler()
        self.config = Gps18xConfig(**{"noise_m": 0.0, **config})
        self.chip = Gps18x(self.scheduler, x, y, random.Random(seed), self.config)
        self.characters = []
        self.pulses = []
        self.chip.listener = lambda c: self.characters.append((self.scheduler.now, c))
        self.chip.pps.watch(lambda level: self.pulses.append((self.scheduler.now, level)))
        self.chip.power(True)

    def run(self, seconds):
        self.scheduler.run(round(seconds * FS_PER_S))
        return self

    @property
    def text(self):
        return bytes(c for _t, c in self.characters)

    @property
    def sentences(self):
        return self.text.splitlines(keepends=True)


def test_checksum_of_a_published_sentence():
    """The GGA example that NMEA 0183 texts have printed since the eighties."""
    body = "GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"
    assert framed(body) == f"${body}*47\r\n"
    assert fields(framed(body).encode())[2] == "4807.038"


def test_second_published_sentence():
    body = "GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W"
    assert framed(body) == f"${body}*6A\r\n"


def test_sentences_come_in_the_receiver_s_order_with_valid_checksums():
    r = Receiver(sentences=("VTG", "GGA", "RMC", "GSV", "GLL", "GSA")).run(4.9)
    names = [fields(s)[0][2:] for s in r.sentences]
    assert [n for n, _group in itertools.groupby(names)] == 2 * list(SENTENCE_ORDER)
    assert all(len(s) <= 82 for s in r.sentences)


def test_default_set_is_on_the_wire_within_its_second():
    r = Receiver(sentences=("RMC", "GGA", "GSA", "GSV")).run(2.999)
    last = [t for t, _c in r.characters if t < 3 * FS_PER_S][-1]
    assert 0.5 < last / FS_PER_S % 1 < 0.97


def test_characters_are_ten_bits_of_4800_baud_apart():
    r = Receiver().run(2)
    gaps = {b[0] - a[0] for a, b in itertools.pairwise(r.characters[:60])}
    assert all(abs(gap - FS_PER_S // 480) <= 1 for gap in gaps)


def test_position_is_that_of_the_pulse_and_late():
    """A robot that jumps after the pulse is reported where it was at the pulse."""
    r = Receiver(y=lambda t: 0.0 if t <= 3 * FS_PER_S else 500.0).run(3.9)
    builder = FixBuilder()
    fixes = [fix for s in r.sentences if (fix := builder.sentence(s)) is not None]
    assert fixes[-1].utc_s == 12 * 3600 + 3
    assert fixes[-1].longitude_deg == pytest.approx(r.config.longitude_deg, abs=1e-5)
    rmc_end = next(t for t, c in r.characters if t > 3 * FS_PER_S and c == 10)
    assert (rmc_end - 3 * FS_PER_S) / FS_PER_S > 0.25


def test_no_fix_before_the_first_one():
    r = Receiver(first_fix_s=3.0).run(2.9)
    rmc = fields(r.sentences[0])
    assert rmc[2] == "V"
    assert r.pulses == []
    builder = FixBuilder()
    assert builder.sentence(r.sentences[0]) is None
    assert builder.sentence(r.sentences[1]).latitude_deg is None


def test_pulse_is_a_microsecond_good_after_four_seconds_of_fix():
    r = Receiver().run(20)
    rises = [t for t, level in r.pulses if level]
    falls = [t for t, level in r.pulses if not level]
    late = [t % FS_PER_S for t in rises]
    assert all(x < FS_PER_US for x in late[6:])
    assert max(late[:4]) > FS_PER_US
    assert all(b - a == 200 * FS_PER_MS for a, b in zip(rises, falls, strict=False))


def test_power_loss_stops_everything_at_once():
    r = Receiver().run(2.3)
    count = len(r.characters)
    r.chip.power(False)
    assert not r.chip.pps.value
    r.run(5)
    assert len(r.characters) == count
    r.chip.power(True)
    r.run(8)
    assert len(r.characters) > count


def test_unknown_sentence_is_refused():
    with pytest.raises(ConfigurationError, match="XYZ"):
        Gps18xConfig(sentences=("XYZ",))


# --- the driver --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "sentence",
    [
        b"",
        b"$GPRMC,1,2",
        b"$GPGGA,1*00\r\n",
        b"GPGGA*56\r\n",
        b"$GP\xffGA*zz\r\n",
    ],
)
def test_damaged_sentences_are_refused(sentence):
    with pytest.raises(SentenceError):
        fields(sentence)


def test_any_flipped_bit_is_refused_or_changes_nothing():
    good = framed("GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W").encode()
    rng = random.Random(3)
    for _ in range(300):
        at, bit = rng.randrange(1, len(good) - 5), 1 << rng.randrange(7)
        bad = bytearray(good)
        bad[at] ^= bit
        with pytest.raises(SentenceError):
            fields(bytes(bad))


@pytest.mark.parametrize(
    ("latitude", "longitude"),
    [(42.7249, -84.4793), (-33.9, 18.4), (0.00001, -0.00001), (59.99999, 179.99999)],
)
def test_position_survives_the_sentence_to_its_last_digit(latitude, longitude):
    r = Receiver(latitude_deg=latitude, longitude_deg=longitude).run(2.9)
    builder = FixBuilder()
    fix = next(f for s in r.sentences if (f := builder.sentence(s)) and f.latitude_deg is not None)
    assert fix.latitude_deg == pytest.approx(latitude, abs=0.51e-4 / 60)
    assert fix.longitude_deg == pytest.approx(longitude, abs=0.51e-4 / 60)
    assert fix.satellites == 8


def test_speed_and_course_of_a_robot_that_goes_west():
    """Along +y with north along +x is west: course 270°."""
    r = Receiver(y=lambda t: 2.0 * t / FS_PER_S).run(9.9)
    builder = FixBuilder()
    fix = [f for s in r.sentences if (f := builder.sentence(s))][-1]
    assert fix.speed_m_s == pytest.approx(2.0, abs=0.25)
    assert math.degrees(fix.course_rad) == pytest.approx(-90.0, abs=6.0)


def test_degree_lengths_of_wgs_84():
    """Tables of the WGS 84 ellipsoid: 110.574 and 111.320 km at the equator, 111.132 at 45°."""
    assert metres_per_degree(0.0) == pytest.approx((110_574.3, 111_319.5), abs=0.1)
    assert metres_per_degree(45.0) == pytest.approx((111_131.7, 78_846.8), abs=0.1)


@pytest.mark.parametrize("north", [0.0, 0.8, -2.0])
def test_local_position_undoes_what_the_receiver_does(north):
    r = Receiver(x=constant(30.0), y=constant(-40.0), north_rad=north).run(2.9)
    builder = FixBuilder()
    fix = next(f for s in r.sentences if (f := builder.sentence(s)) and f.latitude_deg is not None)
    x, y = local_position(r.config, fix.latitude_deg, fix.longitude_deg)
    assert (x, y) == pytest.approx((30.0, -40.0), abs=0.2)  # 1e-4 minutes are 0.185 m


@pytest.mark.parametrize("longitude", [180.0, -180.0])
@pytest.mark.parametrize("north", [0.0, math.pi])
def test_the_date_line_is_crossed(longitude, north):
    r = Receiver(y=constant(-40.0), longitude_deg=longitude, north_rad=north).run(2.9)
    builder = FixBuilder()
    fix = next(f for s in r.sentences if (f := builder.sentence(s)) and f.latitude_deg is not None)
    assert -180.0 <= fix.longitude_deg <= 180.0
    assert fix.longitude_deg == pytest.approx(-179.9995 if north == 0.0 else 179.9995, abs=2e-4)
    x, y = local_position(r.config, fix.latitude_deg, fix.longitude_deg)
    assert (x, y) == pytest.approx((0.0, -40.0), abs=0.2)


def test_position_error_has_the_rms_that_was_asked_for():
    errors = []
    for seed in range(150):
        r = Receiver(seed=seed, noise_m=1.5).run(1.0)
        errors.append(r.chip._error[0])
    assert math.sqrt(sum(e * e for e in errors) / len(errors)) == pytest.approx(1.5, rel=0.15)


@pytest.mark.oracle
@pytest.mark.skipif(shutil.which("gpsdecode") is None, reason="gpsdecode (gpsd-clients) is absent")
def test_gpsdecode_reads_the_stream():
    r = Receiver(
        x=lambda t: 0.5 * t / FS_PER_S,
        sentences=("RMC", "GGA", "GSA", "GSV"),
        utc=datetime(2014, 10, 3, 23, 59, 55, tzinfo=UTC),
    ).run(10)
    done = subprocess.run(
        ["gpsdecode", "-j"], input=r.text, capture_output=True, timeout=60, check=True
    )
    reports = [json.loads(line) for line in done.stdout.splitlines() if line.startswith(b"{")]
    fixes = [x for x in reports if x["class"] == "TPV" and x.get("mode", 0) >= 2]
    assert len(fixes) >= 7
    for fix in fixes:
        assert fix["lat"] == pytest.approx(42.7249, abs=1e-4)
        assert fix["lon"] == pytest.approx(-84.4793, abs=1e-5)
    # gpsd takes a date before its own build for one of an earlier GPS week era (1024 weeks).
    times = [datetime.fromisoformat(fix["time"]) for fix in fixes]
    start = datetime(2014, 10, 3, 23, 59, 56, tzinfo=UTC)
    eras = {(t - start) // timedelta(weeks=1024) for t in times}
    assert len(eras) == 1
    seconds = [(t - start).total_seconds() % (1024 * 7 * 86400) for t in times]
    assert seconds == sorted(set(seconds))  # one fix a second, over midnight
    assert seconds[-1] == 8
    sky = [x for x in reports if x["class"] == "SKY" and x.get("satellites")]
    assert len(sky[-1]["satellites"]) == 8
