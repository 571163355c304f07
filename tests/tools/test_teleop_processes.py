"""Teleoperation between two processes on ptys: the fish turns as told, and no terminal is left raw.

Nothing here asserts how long anything took.
"""

from __future__ import annotations

import csv
import json
import os
import pty
import re
import select
import signal
import subprocess
import termios
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from firmware_model.scheduler import Scheduler
from firmware_model.signals import constant
from firmware_model.time import from_seconds
from radio_802154 import messages, xbee
from radio_802154.medium import Antenna, Medium
from radio_802154.messages import CommandReply, CommandStatus, TailBeatCommand
from radio_802154.xbee import RxPacket16, TxRequest16
from radio_802154.xbee_module import XBeeModule
from spi_bus.transports.pty import PtyTransport
from tests.tools.processes import PATIENCE_S, program, python, where
from tools.cli import main
from tools.commands.teleop import address, url
from tools.errors import UserError

SCRIPT = """
0.0  frequency_hz=1.2 amplitude_deg=15 bias_deg=-25
3.5  bias_deg=25
7.0  end
"""


def test_an_operator_in_another_process_turns_the_emulated_fish_left_then_right(
    tmp_path: Path,
) -> None:
    """The module's supply is away for half a second meanwhile."""
    port, folder, script = tmp_path / "xbee", tmp_path / "run", tmp_path / "script.txt"
    script.write_text(SCRIPT, encoding="utf-8")
    sets = (f"hil.xbee='pty:?link={port}'", "hil.xbee_restarts_s=[3.5]")
    args = [word for text in sets for word in ("--set", text)]
    with program("run", *args, "--duration", "300", "--out", str(folder)) as fish:
        where(fish, "the XBee module's serial port is")
        steer = ("teleop", "--on", f"serial://{port}", "--input", f"script:{script}", "--json")
        with program(*steer) as operator:
            out, err = operator.communicate(timeout=PATIENCE_S)
        assert operator.returncode == 0, err
        told = json.loads(out)
        fish.send_signal(signal.SIGINT)
        fish.communicate(timeout=PATIENCE_S)
    assert told["failure"] == ""
    assert told["commands"] > 30
    air = told["on_the_air"]
    assert set(air) <= {"success", "unanswered"}
    assert air["success"] + air.get("unanswered", 0) == told["commands"]
    assert air.get("unanswered", 0) <= 3  # what was under way when the supply went
    assert told["restarts"] == 1
    assert told["replies"]["applied"] >= air["success"] - 3
    assert told["stop_confirmed"]
    assert told["rssi_dbm"] < -20
    assert told["damaged_frames"] == 0
    with (folder / "channels.csv").open(encoding="utf-8") as file:
        beats = [
            (float(row["time_s"]), float(row["tail_bias_rad"]))
            for row in csv.DictReader(file)
            if row["tail_bias_rad"]
        ]
    truth = np.genfromtxt(folder / "truth.csv", delimiter=",", names=True)
    heading = np.unwrap(truth["heading_rad"])

    def turned(side: float) -> float:
        """Heading at the end less at the beginning of the time with a bias to a side."""
        times = [at for at, bias in beats if bias * side > 0.4]
        assert times
        begin, end = np.interp([times[0], times[-1]], truth["time_s"], heading)
        return float(end - begin)

    assert turned(-1.0) > 0.05  # a negative bias turns it to the left: counter-clockwise
    assert turned(1.0) < -0.05
    assert beats[-1][1] == 0.0
    assert main(["replay", str(folder)]) == 2


class Fish:
    """A module on a pty and a fish that answers, in real time, served by a thread."""

    def __init__(self, link: Path) -> None:
        self.transport = PtyTransport(str(link))
        self.scheduler = Scheduler()
        medium = Medium(self.scheduler)
        for name, x_m in (("base", 0.0), ("fish", 1.0)):
            medium.place(name, Antenna(x_m=constant(x_m)))
        plain = {"AP": 2, "MM": 2, "CH": 26, "ID": 0x22}
        self.module = XBeeModule(self.scheduler, medium, "base", {**plain, "MY": 0},
                                 self.transport.write)  # fmt: skip
        self.fish = XBeeModule(self.scheduler, medium, "fish", {**plain, "MY": 1, "BD": 7},
                               self._hears, seed=3)  # fmt: skip
        self._decoder = xbee.Decoder(escaped=True)
        self.commands: list[TailBeatCommand] = []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        began_s = time.monotonic()
        while not self._over.is_set():
            self.transport.wait(0.005)
            self.scheduler.run(from_seconds(time.monotonic() - began_s))
            self.module.receive(self.transport.read())

    def _hears(self, octets: bytes) -> None:
        for frame in self._decoder.receive(octets):
            assert isinstance(frame, RxPacket16)
            command = messages.decode(frame.data[1], frame.data[2:], messages.BASE)
            assert isinstance(command, TailBeatCommand)
            self.commands.append(command)
            reply = CommandReply(command.command_id, CommandStatus.APPLIED)
            am_type, payload = messages.encode(reply)
            answer = TxRequest16(0, frame.source, 0, bytes((0x3F, am_type)) + payload)
            self.fish.receive(xbee.encode(answer, escaped=True))

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        self.transport.close()

    def stopped(self) -> bool:
        last = self.commands[-1]
        return (last.frequency_hz, last.amplitude_rad, last.bias_rad) == (0.0, 0.0, 0.0)


@pytest.fixture
def fish(tmp_path: Path) -> Iterator[Fish]:
    made = Fish(tmp_path / "xbee")
    yield made
    made.close()


class Terminal:
    """A terminal with a person in front of it: types, and reads the screen."""

    def __init__(self) -> None:
        self.ours, self.theirs = pty.openpty()
        self.before = termios.tcgetattr(self.theirs)
        self.screen = ""

    def read_until(self, pattern: str) -> re.Match[str]:
        end_s = time.monotonic() + PATIENCE_S
        while True:
            plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", self.screen)
            match = re.search(pattern, plain)
            if match:
                return match
            assert time.monotonic() < end_s, plain[-2000:]
            if select.select([self.ours], [], [], 0.2)[0]:
                self.screen += os.read(self.ours, 65_536).decode("utf-8", "replace")

    def type(self, keys: bytes) -> None:
        os.write(self.ours, keys)

    def drain(self) -> None:
        while select.select([self.ours], [], [], 0.1)[0]:
            self.screen += os.read(self.ours, 65_536).decode("utf-8", "replace")

    def hang_up(self) -> None:
        os.close(self.ours)
        self.ours = -1

    def close(self) -> None:
        if self.ours >= 0:
            os.close(self.ours)
        os.close(self.theirs)


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    made = Terminal()
    yield made
    made.close()


def until(condition: object, process: subprocess.Popen[str], terminal: Terminal) -> None:
    assert callable(condition)
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s
        assert process.poll() is None, terminal.screen
        terminal.drain()


def test_keys_of_a_terminal_drive_the_fish_and_ctrl_c_stops_it_and_restores_the_terminal(
    fish: Fish, terminal: Terminal
) -> None:
    args = ("-m", "tools", "teleop", "--on", f"serial://{fish.transport.link}")
    # start_new_session and TIOCSCTTY by hand: Ctrl-C of a terminal goes to whom it belongs
    code = "import os, fcntl, termios, sys; os.setsid(); fcntl.ioctl(0, termios.TIOCSCTTY, 0); \
        os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"
    side = {"stdin": terminal.theirs, "stderr": terminal.theirs}
    with python("-c", code, *args, **side) as process:
        terminal.read_until(r"arrows or WASD")
        terminal.read_until(r"driving")
        during = termios.tcgetattr(terminal.theirs)
        assert not during[3] & (termios.ECHO | termios.ICANON)
        terminal.type(b"\x1b[A\x1b[Aww" + b"\x1b[D")
        until(lambda: fish.commands and fish.commands[-1].frequency_hz > 0.39, process, terminal)
        terminal.read_until(r"driving 0\.4 Hz  left 5\.0°  ±15\.0°  −4\d dBm  ok \d+ failed 0")
        assert fish.commands[-1].bias_rad == pytest.approx(-np.radians(5), abs=1e-3)
        terminal.type(b"\x03")
        out, _ = process.communicate(timeout=PATIENCE_S)
        terminal.drain()
    assert process.returncode == 130
    assert "has confirmed that it stopped" in out
    assert fish.stopped()
    assert termios.tcgetattr(terminal.theirs) == terminal.before
    assert terminal.screen.count("\x1b[?25h") >= 1  # the cursor is back, too


def test_a_fault_in_the_program_stops_the_fish_and_restores_the_terminal(
    fish: Fish, terminal: Terminal
) -> None:
    code = f"""
import sys, tools.teleop.status as status
right = status.status
def breaks(pilot, now_s):
    if pilot.told.frequency_hz > 0.1:
        raise RuntimeError("drawing failed")
    return right(pilot, now_s)
status.status = breaks
from tools.cli import main
sys.exit(main(["teleop", "--on", "serial://{fish.transport.link}"]))
"""
    side = {"stdin": terminal.theirs, "stderr": terminal.theirs}
    with python("-c", code, **side) as process:
        terminal.read_until(r"driving")
        terminal.type(b"www")
        process.communicate(timeout=PATIENCE_S)
        terminal.drain()
    assert process.returncode == 1
    assert "drawing failed" in terminal.screen
    assert any(command.frequency_hz > 0.1 for command in fish.commands)
    assert fish.stopped()
    assert termios.tcgetattr(terminal.theirs) == terminal.before


@pytest.mark.parametrize("how", ["ctrl-d", "hang-up"])
def test_an_operators_end_of_input_stops_the_fish(fish: Fish, how: str) -> None:
    terminal = Terminal()
    args = ("teleop", "--on", f"serial://{fish.transport.link}", "--json")
    try:
        with program(*args, stdin=terminal.theirs) as process:
            until(lambda: fish.commands, process, terminal)
            terminal.type(b"www")
            until(lambda: fish.commands[-1].frequency_hz > 0.1, process, terminal)
            if how == "ctrl-d":
                terminal.type(b"\x04")
            else:  # the window is closed
                terminal.hang_up()
            out, err = process.communicate(timeout=PATIENCE_S)
    finally:
        terminal.close()
    assert process.returncode == 0, err
    told = {"ctrl-d": "Ctrl-D was pressed", "hang-up": "the keyboard is gone"}
    assert json.loads(out)["ended"] == told[how]
    assert fish.stopped()


def test_a_program_that_is_ended_stops_the_fish(fish: Fish, tmp_path: Path) -> None:
    script = tmp_path / "script.txt"
    script.write_text("0 frequency_hz=1\n1000 end\n", encoding="utf-8")
    args = ("teleop", "--on", f"serial://{fish.transport.link}", "--input", f"script:{script}")
    with program(*args, "--json") as process:
        end_s = time.monotonic() + PATIENCE_S
        while not (fish.commands and fish.commands[-1].frequency_hz > 0.5):
            assert time.monotonic() < end_s
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        out, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "SIGTERM" in json.loads(out)["ended"]
    assert json.loads(out)["stop_confirmed"]
    assert fish.stopped()


def test_a_joystick_by_its_device_and_its_unplugging(fish: Fish, tmp_path: Path) -> None:
    """A named pipe in the place of /dev/input/js0: the same octets, and an end when it is gone."""
    device = tmp_path / "js0"
    os.mkfifo(device)
    keeper = os.open(device, os.O_RDWR)
    args = ("teleop", "--on", f"serial://{fish.transport.link}", "--input", f"joystick:{device}")
    try:
        with program(*args, "--json") as process:
            end_s = time.monotonic() + PATIENCE_S
            while not fish.commands:
                assert time.monotonic() < end_s
                time.sleep(0.05)
            os.write(keeper, bytes.fromhex("000000000180020100000000ff3f0200"))
            while not (fish.commands[-1].frequency_hz > 1.9 and fish.commands[-1].bias_rad > 0.2):
                assert time.monotonic() < end_s
                time.sleep(0.05)
            os.close(keeper)
            keeper = -1
            out, _ = process.communicate(timeout=PATIENCE_S)
    finally:
        if keeper >= 0:
            os.close(keeper)
    assert process.returncode == 0
    assert json.loads(out)["ended"] == "the joystick is gone"
    assert fish.stopped()


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (["--on", "emulated"], "fishbed board xbee"),
        (["--on", "serial:///dev/no-such-port"], "no port /dev/no-such-port"),
        (["--on", "pty:", "--address", "fish"], "--address fish: write 16 bits"),
        (["--on", "pty:", "--channel", "9"], "--channel 9"),
        (["--on", "pty:", "--pan", "x"], "--pan x"),
        (["--on", "pty:", "--rate", "500"], "--rate 500"),
        (["--on", "pty:", "--max-bias", "80"], "--max-bias 80"),
        (["--on", "pty:", "--input", "mouse"], "--input mouse"),
        (["--on", "pty:", "--input", "joystick:/dev/input/js-none"], "js*"),
        (["--on", "pty:", "--input", "script:/none.txt"], "/none.txt"),
        (["--on", "pty:", "--mapping", "x.toml"], "--mapping"),
        ([], "--on"),
    ],
)
def test_mistakes_are_one_line(
    args: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script = tmp_path / "s.txt"
    script.write_text("0 stop\n", encoding="utf-8")
    if "--input" not in args:
        args = [*args, "--input", f"script:{script}"]
        args = args if "--mapping" not in args else [*args]
    assert main(["teleop", *args]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert says in err
    assert err.count("\n") == 1


def test_addresses_and_ports_as_people_write_them() -> None:
    assert address("1") == address("0x0001") == 1
    assert address("0013A200400A0127") == address("0x0013A200400A0127") == 0x13A200400A0127
    assert address("0013A200 400A0127") == 0x13A200400A0127
    for wrong in ("-1", "", "1FFFFFFFFFFFFFFFF", "fish"):
        with pytest.raises(UserError):
            address(wrong)
    assert url("serial:///dev/ttyUSB0") == "serial:///dev/ttyUSB0?baud=9600"
    assert url("serial:///dev/ttyUSB0?rtscts=1").endswith("rtscts=1&baud=9600")
    assert url("serial:///dev/ttyUSB0?baud=57600") == "serial:///dev/ttyUSB0?baud=57600"
    assert url("pty:") == "pty:"


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (["board", "xbee", "--on", "pty:", "--set", "hil.xbee_registers.QQ=1"], "QQ"),
        (
            ["board", "xbee", "--on", "pty:", "--set", "hil.xbee_registers.AP=9"],
            "hil.xbee_registers.AP",
        ),
        (["board", "xbee", "--on", "pty:", "--set", "base_station.send_pose=true"], "hil.xbee"),
        (["board", "xbee", "--on", "serial:///dev/none"], "--on: serial:///dev/none"),
    ],
)
def test_a_module_that_cannot_be_is_one_line(
    args: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(args) == 2
    err = capsys.readouterr().err
    assert says in err
    assert err.count("\n") == 1
