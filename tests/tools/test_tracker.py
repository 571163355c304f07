"""An external tracker: where its lines come from, its clock, its faults, and a run around it.

Time is the test's own wherever a figure depends on it; sockets are real ones on the loopback.
"""

from __future__ import annotations

import csv
import itertools
import json
import random
import select
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from firmware_model.time import from_seconds
from firmware_model.trace import Trace
from spi_bus.errors import TransportError
from spi_bus.transports.base import wait_any
from spi_bus.transports.outage import OutageBegan, OutageEnded, OutageEvent
from tests.tools.processes import PATIENCE_S, program, python, result, where
from tools import scenario
from tools.bench.camera_feed import lines, read_rows
from tools.bench.tracker import LeastDelay, Tracker
from tools.bench.tracker_source import (
    Came,
    Datagram,
    ListenSource,
    Octets,
    Source,
    UdpSource,
    Went,
    open_source,
)
from tools.cli import main
from tools.hil import with_line

EXPECTED = "the tracker is expected at"


def drain(source: Source, wanted: int = 1) -> list[Any]:
    """Return what a source heard, once it has heard so many things."""
    heard: list[Any] = []
    while len(heard) < wanted:
        assert select.select([w.fileno() for w in source.waitables()], [], [], PATIENCE_S)[0]
        heard += source.read()
    return heard


# --- sources ---------------------------------------------------------------------------------


def test_a_listening_port_takes_the_newest_tracker_and_tells_of_outages() -> None:
    now = 10.0
    events: list[OutageEvent] = []
    source = ListenSource("127.0.0.1", 0, lambda: now, events.append)
    assert source.read() == []
    with socket.create_connection(("127.0.0.1", source.port)) as first:
        first.sendall(b"one\n")
        heard = drain(source, 2)
        assert isinstance(heard[0], Came)
        assert heard[1] == Octets(b"one\n")
        with socket.create_connection(("127.0.0.1", source.port)) as second:
            second.sendall(b"two\n")
            heard = drain(source, 3)
            assert heard[0] == Went("another tracker connected")
            assert isinstance(heard[1], Came)
            assert heard[2] == Octets(b"two\n")
            second.sendall(b"last")
        now = 12.5
        heard = drain(source, 2)
        assert heard == [Octets(b"last"), Went("it closed the connection")]
    began = events[-1]
    assert isinstance(began, OutageBegan)
    now = 14.0
    with socket.create_connection(("127.0.0.1", source.port)):
        drain(source)
        ended = events[-1]
        assert isinstance(ended, OutageEnded)
        assert ended.duration_s == 1.5
    source.close()


def test_datagrams_are_whole_lines() -> None:
    source = UdpSource("127.0.0.1", 0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(b"a\nb", ("127.0.0.1", source.port))
        sender.sendto(b"c\n", ("127.0.0.1", source.port))
    assert drain(source, 2) == [Datagram(b"a\nb"), Datagram(b"c\n")]
    source.close()


def test_a_port_of_ours_is_on_the_loopback_unless_a_host_is_named() -> None:
    for url in ("listen://:0", "udp://:0"):
        source = open_source(url, lambda: 0.0, lambda event: None)
        assert "127.0.0.1" in source.description
        source.close()


@pytest.mark.parametrize(
    ("url", "says"),
    [
        ("listen:5005", "listen://:PORT"),
        ("listen://localhost", "listen://:PORT"),
        ("listen://:99999", "listen://:PORT"),
        ("udp://:5005?rate=3", "rate"),
        ("tcp://127.0.0.1:1", "no connection"),
        ("listen://192.0.2.1:5005", "an address of this"),
        ("tcp:localhost", "write tcp://HOST:PORT"),
        ("gopher://x", "no transport is called 'gopher'; there are listen, udp, tcp, pair, pty"),
        ("lisen://:5005", "did you mean listen?"),
        ("192.0.2.1:5005", "write for example listen://:5005, udp://:5005 or tcp://HOST:5005"),
    ],
)
def test_places_that_cannot_be_say_so(url: str, says: str) -> None:
    with pytest.raises(TransportError) as caught:
        open_source(url, lambda: 0.0, lambda event: None)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


# --- the tracker -----------------------------------------------------------------------------


class Bench:
    """A tracker at a port, with a clock that stands until it is told."""

    def __init__(self, *sets: str) -> None:
        self.now_s = 0.0
        self.now = 0
        self.told: list[str] = []
        config = scenario.load("swim-forward", ["hil.camera='listen://:0'", *sets])
        self.tracker = Tracker(config, lambda: self.now_s, self.told.append)
        trace = Trace()
        self.records: list[Any] = []
        channel = trace.channel("camera")
        self.trace = trace
        channel.sink(self.records.extend)
        self.tracker.start(self, channel)  # type: ignore[arg-type]
        port = int(self.tracker.where.rpartition(":")[2])
        self.peer = socket.create_connection(("127.0.0.1", port))

    def emulated_s(self, host_s: float) -> float:
        return host_s - 100.0

    def at(self, run_s: float, data: bytes) -> None:
        """Let octets arrive at a time of the run."""
        self.now_s, self.now = run_s + 100.0, from_seconds(run_s)
        self.peer.sendall(data)
        self.settle()

    def settle(self) -> None:
        came = False
        while not came:
            wait_any(self.tracker.waitables(), PATIENCE_S, lambda: 0.0)
            before = self.tracker._reader.lines
            came = self.tracker.poll() or self.tracker._reader.lines > before
        self.tracker.on_incoming()

    def close(self) -> None:
        self.peer.close()
        self.tracker.close()


@contextmanager
def bench(*sets: str) -> Iterator[Bench]:
    made = Bench(*sets)
    try:
        yield made
    finally:
        made.close()


def line(time_s: float, x_m: float = 0.1, **more: object) -> bytes:
    pose = {"time_s": time_s, "x_m": x_m, "y_m": 0.2, "heading_rad": 0.3, **more}
    return json.dumps(pose).encode() + b"\n"


def test_stamps_of_a_drifting_clock_become_times_of_the_run() -> None:
    """300 ppm and delays of 5 ms to 90 ms, of which one in eight is the least."""
    rng = random.Random(4)
    delay_s, drift, began_s = 0.0, 300e-6, 5000.0
    exposed = []
    with bench() as made:
        last_s = 0.0
        for number in range(600):
            exposure_s = 1.0 + number / 20
            delay_s = 0.005 if rng.random() < 0.125 else 0.005 + rng.expovariate(1 / 0.03) % 0.085
            last_s = max(last_s, exposure_s + delay_s)  # TCP keeps the order
            made.at(last_s, line(began_s + exposure_s * (1 + drift), x_m=exposure_s / 20))
            exposed.append(exposure_s)
        series = made.tracker.channels()["x_m"]
        told = made.tracker.summary()
    errors = [at - (true_s + 0.005) for at, true_s in zip(series.time_s, exposed, strict=True)]
    assert max(map(abs, errors)) < 0.002  # the least delay is in the offset, and told to be
    assert series.value[100] == pytest.approx(exposed[100] / 20)
    assert told["clock"]["drift_ppm"] == pytest.approx(300, abs=30)
    assert told["poses"] == 600
    assert told["rate_hz"] == pytest.approx(20, rel=0.01)
    assert told["latency"]["maximum_s"] < 0.09
    assert told["latency"]["is"] == "beyond the least"
    assert told["gaps"]["count"] == 0


def test_a_clock_that_is_this_machines_gives_the_latency_itself() -> None:
    with bench("hil.camera_clock='monotonic'") as made:
        for number in range(50):
            exposure_s = 1.0 + number / 10
            made.at(exposure_s + 0.04, line(100.0 + exposure_s))
        series = made.tracker.channels()["x_m"]
        told = made.tracker.summary()
    assert series.time_s[0] == pytest.approx(1.0, abs=1e-9)
    assert told["latency"]["median_s"] == pytest.approx(0.04, rel=0.03)
    assert told["latency"]["is"] == "from exposure"


def test_gaps_repetitions_and_disorder_are_counted_and_the_newest_stays_the_newest() -> None:
    with bench() as made:
        for number in (0, 1, 2, 4, 3, 5, 5, 20, 21):
            made.at(1.0 + number / 10 + 0.01, line(50.0 + number / 10, x_m=number / 100))
            if number == 3:
                assert made.tracker.newest is not None
                assert made.tracker.newest.pose.x_m == 0.04
        series = made.tracker.channels()["x_m"]
        told = made.tracker.summary()
    assert told["repeated"] == 1
    assert told["out_of_order"] == 1
    assert told["gaps"]["count"] == 1
    assert told["gaps"]["longest_s"] == pytest.approx(1.5)
    assert told["poses"] == 8
    assert list(series.value) == sorted(series.value)
    assert told["longest_silence_s"] == pytest.approx(1.5)


@pytest.mark.parametrize("restart_s", [0.0, 900.0])
def test_a_clock_that_is_set_begins_anew(restart_s: float) -> None:
    """A tracker that was started again, its clock at zero or far ahead."""
    with bench() as made:
        for number in range(40):
            made.at(1.0 + number / 10 + 0.02, line(500.0 + number / 10))
        for number in range(40):
            made.at(6.0 + number / 10 + 0.02, line(restart_s + number / 10))
        series = made.tracker.channels()["x_m"]
        told = made.tracker.summary()
    assert told["clock_resets"] == 1
    assert told["poses"] == 80
    expected = [1.02 + n / 10 for n in range(40)] + [6.02 + n / 10 for n in range(40)]
    assert list(series.time_s) == pytest.approx(expected, abs=1e-3)


def test_what_had_waited_before_the_run_is_no_sample_of_it() -> None:
    with bench() as made:
        made.at(0.0, b"".join(line(10.0 + n / 10) for n in range(30)))  # of the last three seconds
        for number in range(30, 60):
            made.at(number / 10 - 2.9 + 0.01, line(10.0 + number / 10))
        series = made.tracker.channels()["x_m"]
        told = made.tracker.summary()
    assert told["clock_resets"] == 0
    assert series.time_s[0] >= 0
    assert len(series.time_s) == 31
    assert told["latency"]["maximum_s"] < 0.1


def test_the_robot_gets_each_pose_once_and_none_that_is_stale() -> None:
    with bench() as made:
        tracker = made.tracker
        assert tracker.fresh(None) is None
        made.at(1.0, line(70.0))
        first = tracker.fresh(None)
        assert first is not None
        assert tracker.fresh(first) is None
        made.at(1.1, line(70.1))
        second = tracker.fresh(first)
        assert second is not None
        made.at(1.2, line(70.2))
        made.now = from_seconds(2.5)
        assert tracker.fresh(second) is None  # 1.3 s old
        told = tracker.summary()["sent_to_robot"]
    assert told["count"] == 2
    assert told["withheld"] == 3


def test_poses_of_others_of_poor_quality_and_outside_are_told() -> None:
    with bench("hil.camera_id='7'", "hil.camera_least_quality=0.5") as made:
        made.at(1.0, line(10.0, id=7) + line(10.1, id="8") + line(10.2, id=8))
        made.at(1.3, line(10.3, id=7, quality=0.4) + line(10.4, id="7", x_m=30.0))
        told = made.tracker.summary()
        said = made.told
    assert told["poses"] == 2
    assert told["of_others"] == {"8": 2}
    assert told["poor"] == 1
    assert told["outside_tank"] == 1
    assert any("--camera-id" in text for text in said)
    assert any("outside the tank" in text for text in said)


def test_the_first_bad_lines_are_told_and_all_are_counted() -> None:
    with bench() as made:
        made.at(1.0, b"rubbish\n" * 20 + line(10.0))
        told = made.tracker.summary()
        said, events = made.told, made.tracker.events()
    assert told["refused"] == {"syntax": 20}
    assert told["poses"] == 1
    assert [text for text in said if "rubbish" in text] == said[:5]
    assert "line 3: " in said[2]
    assert "counted only" in said[5]
    assert len(said) == 6
    assert len(events) == 5


def test_least_delay_forgets_after_a_minute_and_never_exceeds_what_it_saw() -> None:
    least = LeastDelay()
    assert least.offset_s is None
    assert least.note(0.0, 5.0) == 5.0
    assert least.note(1.0, 6.5) == 5.0
    assert least.note(2.0, 6.8) == pytest.approx(4.8)
    assert least.note(60.0, 65.9) == pytest.approx(4.8)
    assert least.note(63.0, 68.9) == pytest.approx(5.9)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "said nothing"),
        (b"hello\n", "none of 1 lines"),
        (line(1.0, id="x"), "--camera-id chooses"),
    ],
)
def test_no_pose_at_all_has_a_reason(data: bytes, says: str) -> None:
    with bench("hil.camera_id='7'") as made:
        while not made.tracker._connected:
            made.tracker.poll()
        if data:
            made.at(1.0, data)
        assert says in made.tracker.diagnosis()


# --- a run -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder to be played: five minutes of poses that no swimming robot would have."""
    folder = tmp_path_factory.mktemp("recorded")
    rows = ["time_s,x_m,y_m,heading_rad"]
    rows += [f"{n / 30:.6f},{n / 1000:.4f},{0.1 + n / 2000:.4f},0.7" for n in range(9000)]
    (folder / "channels.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder


def test_a_tracker_in_another_process(recorded: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    sets = ("--set", "base_station.send_pose=true", "--set", "base_station.pose_period_s=0.2")
    feed = ("-m", "tools.bench.camera_feed", str(recorded), "--on", "listen://:0")
    with python(*feed) as tracker:
        assert tracker.stderr is not None
        url = f"tcp://{tracker.stderr.readline().split()[-1]}"
        run = ("hil", "--camera", url, "--duration", "4", "--out", str(folder), "--json")
        with program(*run, *sets) as hil:
            told = result(hil)
    camera = told["hil"]["camera"]
    assert camera["diagnosis"] == ""
    assert camera["poses"] > 20
    assert camera["refused"] == {}
    assert camera["rate_hz"] == pytest.approx(30, rel=0.01)
    assert camera["clock"]["reports"] == camera["poses"]
    assert camera["sent_to_robot"]["count"] > 2
    assert told["hil"]["lateness"]["count"] > 1000
    assert told["metrics"]["path_length_m"] > 0  # the emulated fish has its own truth
    with (folder / "channels.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["x_m"]]
    assert len(rows) > 20
    assert {row["heading_rad"] for row in rows} == {"0.7"}
    for before, row in itertools.pairwise(rows):  # 30 poses a second, 1 mm each
        assert float(row["time_s"]) - float(before["time_s"]) == pytest.approx(1 / 30, abs=1e-3)
        assert float(row["x_m"]) - float(before["x_m"]) == pytest.approx(0.001)
    assert "The real board" not in (folder / "report.html").read_text(encoding="utf-8")
    assert main(["replay", str(folder)]) == 2


def test_a_tracker_that_goes_away_and_returns_with_another_clock(tmp_path: Path) -> None:
    """It comes for a second, goes for a third of one, and its clock begins at zero every time."""
    run = ("hil", "--camera", "listen://:0", "--duration", "6", "--out", str(tmp_path / "run"))
    over = threading.Event()

    def track(port: int) -> None:
        while not over.is_set():
            with suppress(OSError), socket.create_connection(("127.0.0.1", port)) as line_to:
                for number in range(30):
                    line_to.sendall(line(number / 30))
                    over.wait(1 / 30)
                line_to.sendall(line(5.0)[:20])
            over.wait(0.33)

    with program(*run, "--json") as hil:
        tracker = threading.Thread(
            target=track, args=(int(where(hil, EXPECTED).rpartition(":")[2]),)
        )
        tracker.start()
        try:
            told = result(hil)
        finally:
            over.set()
            tracker.join()
    camera = told["hil"]["camera"]
    assert camera["outages"]["outages"] >= 2
    assert camera["outages"]["connections"] >= 2
    assert camera["outages"]["down_s"] > 0
    assert camera["refused"] == {"cut": camera["outages"]["outages"]}
    assert camera["clock_resets"] >= 1
    assert camera["poses"] > 30
    summary = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))
    assert summary["hil"]["camera"]["poses"] == camera["poses"]


def test_nobody_came(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = ["hil", "--camera", "udp://:0", "--duration", "1", "--quiet"]
    assert main([*args, "--out", str(tmp_path / "run")]) == 2
    assert "nobody came to udp port 127.0.0.1:" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (["hil", "--camera", "listen:5005"], "--camera: listen:5005"),
        (["hil", "--camera", "tcp://127.0.0.1:1"], "no connection"),
        (["hil", "--camera-id", "7"], "no line to a real board"),
        (["run", "--set", "hil.camera='udp://:0'", "--speed", "5"], "5 times as fast"),
        (["run", "--set", "hil.camera_clock='gps'"], "camera_clock"),
    ],
)
def test_mistakes_are_one_line(
    args: list[str], says: str, complaint: Callable[[list[str]], str]
) -> None:
    assert says in complaint(args)


def test_it_goes_with_a_real_board_and_takes_the_cameras_place() -> None:
    config = with_line("swim-forward", [], nav="pty:", camera="udp://:0")
    assert config.hil.nav
    assert config.hil.camera
    assert config.hil.live


def test_a_folder_is_played_as_its_tracker_saw_it(recorded: Path) -> None:
    rows = read_rows(recorded, rate_hz=10)
    assert len(rows) == 3000
    told = list(lines(rows, began_s=7.0, drift_ppm=1e6, name="fish"))
    assert told[10][0] == pytest.approx(1.0)
    assert json.loads(told[10][1]) == {
        "time_s": 9.0, "x_m": 0.03, "y_m": 0.115, "heading_rad": 0.7, "id": "fish"
    }  # fmt: skip
