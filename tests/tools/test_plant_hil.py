"""Three processes on ptys: the plant, the navigation board whose chips it is, the processing board.

Nothing here asserts how long anything took: a busy machine is late, and says so.
"""

from __future__ import annotations

import csv
import json
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from spi_bus.frame import Decoder, Frame, FrameType
from spi_bus.plant_messages import PLANT_MESSAGES, SensorSample, ServoPulse
from spi_bus.transports import OpenContext, open_transport
from spi_bus.transports.cable import Cable
from spi_bus.transports.recording import read_log
from tests.tools.processes import program, result, stopped, where
from tools.bench import Bench
from tools.cli import main
from tools.scenario import load

SECONDS = 7.0


def streamed(log: Path, way: str) -> list[object]:
    """Return the stream messages that a recording has in a direction, in order."""
    decoder = Decoder()
    found = []
    for entry in read_log(log):
        if entry.kind == way:
            for body in decoder.receive(entry.data):
                frame = Frame.parse(body)
                if frame.frame_type == FrameType.STREAM:
                    found.append(PLANT_MESSAGES.decode(frame.payload))
    return found


def column(path: Path, name: str) -> list[float]:
    with path.open(encoding="utf-8") as file:
        return [float(row[name]) for row in csv.DictReader(file) if row[name]]


class Pulled:
    """A cable between a board's pty and the plant, out once for half a second."""

    def __init__(self, near: Path, far: str) -> None:
        context = OpenContext()
        self.cable = Cable(
            lambda: open_transport(f"pty:?link={near}", context),
            lambda: open_transport(f"serial://{far}", context),
        )
        self._pull = threading.Event()
        self._done = threading.Event()
        self._carrier = threading.Thread(target=self._carry)
        self._carrier.start()

    def pull(self) -> None:
        self._pull.set()

    def close(self) -> None:
        self._done.set()
        self._carrier.join()
        self.cable.close()

    def _carry(self) -> None:
        while not self._done.is_set():
            self.cable.run(0.02)
            if self._pull.is_set() and self.cable.plugged:
                self._pull.clear()
                self.cable.pull()
                time.sleep(0.5)
                self.cable.plug()


def test_three_processes_swim_and_a_pulled_cable_costs_samples_only(tmp_path: Path) -> None:
    folder, near, far = tmp_path / "run", tmp_path / "near", tmp_path / "far"
    sent_log, taken_log = tmp_path / "plant.log", tmp_path / "board.log"
    board_args = ("--on", "pty:", "--plant", f"record:{taken_log}:pty:?link={far}", "--json")
    with program("board", "nav", *board_args) as nav:
        board_pty = where(nav)
        where(nav, "the plant is expected at")
        with program("board", "proc", "--on", f"serial://{board_pty}", "--json") as proc:
            pulled = Pulled(near, str(far))
            try:
                args = ("--duration", str(SECONDS), "--out", str(folder), "--json")
                url = f"record:{sent_log}:serial://{near}"
                with program("hil", "--plant-for", url, *args) as rig:
                    while pulled.cable.carried < 8_000 and rig.poll() is None:
                        time.sleep(0.05)  # bytes: a second of samples at least
                    pulled.pull()
                    run = result(rig)
            finally:
                pulled.close()
            stopped(proc)
        board = stopped(nav)

    told, plant = run["hil"], board["plant"]
    assert told["connected"]
    assert told["diagnosis"] == plant["diagnosis"] == ""
    # The cable was out once; the link's session went on, and only samples were lost.
    assert told["outages"]["outages"] == told["outages"]["resumptions"] == 1
    assert told["outages"]["down_s"] > 0.2
    assert told["board_resets"] == 0
    assert plant["samples"]["stalls"] >= 1
    assert plant["samples"]["repeated"] == told["pulses"]["repeated"] == 0
    assert told["registers_written"] >= 4
    assert told["round_trip"]["count"] > 50
    assert 0 < told["round_trip"]["median_s"] <= told["round_trip"]["maximum_s"]
    assert told["clock"]["reports"] > 50
    assert told["lateness"]["count"] > 200

    # What came is what went, count for count; what did not come lies in the outage.
    sent = [m for m in streamed(sent_log, ">") if isinstance(m, SensorSample)]
    taken = [m for m in streamed(taken_log, "<") if isinstance(m, SensorSample)]
    by_number = {sample.number: sample for sample in sent}
    assert len(taken) > 100
    assert all(by_number[sample.number] == sample for sample in taken)
    assert len({(sample.an3, sample.an4) for sample in taken}) > 20, "a gyro that moves"
    numbers = [sample.number for sample in taken]
    assert numbers == sorted(set(numbers))
    lost = [number for number in by_number if numbers[0] < number < numbers[-1]]
    lost = [number for number in lost if number not in set(numbers)]
    assert not lost or lost[-1] - lost[0] <= 0.01 * (told["lateness"]["maximum_s"] + 2.0) * 1e4
    pulses = [m for m in streamed(taken_log, ">") if isinstance(m, ServoPulse)]
    heard = [m for m in streamed(sent_log, "<") if isinstance(m, ServoPulse)]
    assert heard
    assert set(heard) <= set(pulses)
    assert told["pulses"]["received"] == len(heard)

    # And the fish swam, here, as it does in the plain emulation: held up by the outage, or driven
    # by faster sweeps where a late machine let pulses come in bursts. What an undisturbed run does
    # to a hundredth is in test_plant_rig.
    plain = Bench.from_scenario(load("swim-forward", duration_s=SECONDS))
    plain.run(lambda seconds: None, lambda: False)
    expected_m = float(plain.run_data(compare=False).truth["x_m"][-1])
    x_m = column(folder / "truth.csv", "x_m")
    assert 0.1 * expected_m < x_m[-1] < 3.0 * expected_m
    assert abs(column(folder / "truth.csv", "y_m")[-1]) < 0.02
    angles = column(folder / "channels.csv", "tail_command_rad")
    assert max(angles) > 0.2  # of 15°
    assert min(angles) < -0.2
    assert len(column(folder / "channels.csv", "gyro_z_rad_s")) > 100
    report = (folder / "report.html").read_text(encoding="utf-8")
    assert "around it a plant" in report
    assert main(["replay", str(folder)]) == 2


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (["hil", "--plant-for", "serial:///dev/no-such-port"], "no port /dev/no-such-port"),
        (["hil", "--plant-for", "pty:", "--nav", "pty:"], "not allowed with"),
        (["hil", "--plant-for", "pty:", "--set", "hil.nav='pty:'"], "without any other line"),
        (["hil", "--plant-for", "pty:", "--rate", "5000"], "--rate"),
        (["hil", "--plant-for", "pty:", "--rate", "0"], "above 0"),
        (
            ["hil", "--plant-for", "serial:///dev/x?baud=9600"],
            "give --rate 12 or a line of 115200 baud",
        ),
        (["hil", "wang2014", "--plant-for", "pty:"], "plant.servo.ideal"),
        (["hil", "--plant-for", "warp:"], "no transport is called"),
        (["run", "--set", "hil.plant_for='pty:'", "--speed", "5"], "5 times as fast"),
        (["run", "--set", "hil.plant='pty:'"], "hil.plant"),
        (["board", "proc", "--on", "pty:", "--plant", "pty:"], "board nav"),
        (
            ["board", "nav", "--on", "pty:", "--plant", "serial:///dev/x?baud=300"],
            "do not fit a line of 300 bit/s",
        ),
    ],
)
def test_mistakes_are_one_line(
    args: list[str], says: str, complaint: Callable[[list[str]], str]
) -> None:
    assert says in complaint(args)


def test_a_line_on_which_no_board_answers_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    args = ["hil", "--plant-for", "pty:", "--duration", "0.5", "--out", str(out), "--quiet"]
    assert main(args) == 2
    err = capsys.readouterr().err.splitlines()
    assert len(err) == 2
    assert "nothing comes: is the other side running" in err[1]
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["hil"]["diagnosis"]
    assert summary["metrics"]["path_length_m"] is not None
