"""The operator's side: keys, sticks and scripts to inputs, and inputs to what the fish is told."""

from __future__ import annotations

import itertools
import math
import os
import pty
import struct
import termios
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from navboard.motion import MotionLimits
from tools.errors import UserError
from tools.teleop import joystick, keyboard, script
from tools.teleop.joystick import EventDecoder, JoystickEvent, Mapping, Stick
from tools.teleop.keyboard import KeyDecoder, cbreak, inputs
from tools.teleop.setpoint import NEUTRAL, Bounds, End, Helm, Hold, Nudge, Setpoint, Stop

# --- helm ------------------------------------------------------------------------------------


def test_the_setpoint_follows_within_its_rates_and_arrives_exactly() -> None:
    helm = Helm(Bounds(frequency_hz_s=2.0, bias_rad_s=1.0), amplitude_rad=0.2)
    assert helm.setpoint(0.0) == NEUTRAL
    helm.take(Hold(frequency_hz=1.0, bias_rad=-0.3))
    told = [helm.setpoint(0.1 * n) for n in range(1, 8)]
    assert [s.frequency_hz for s in told] == pytest.approx([0.2, 0.4, 0.6, 0.8, 1, 1, 1])
    assert [s.bias_rad for s in told] == pytest.approx([-0.1, -0.2, -0.3, -0.3, -0.3, -0.3, -0.3])
    assert told[-1] == Setpoint(1.0, 0.2, -0.3)


def test_a_stop_is_at_once_and_the_amplitude_comes_back_with_the_next_start() -> None:
    helm = Helm(amplitude_rad=0.2)
    helm.take(Hold(frequency_hz=1.0, bias_rad=0.3))
    helm.setpoint(0.0)
    assert helm.setpoint(5.0) == Setpoint(1.0, 0.2, 0.3)
    helm.take(Stop())
    assert helm.setpoint(5.0) == NEUTRAL
    helm.take(Nudge(frequency_hz=0.5))
    assert helm.setpoint(9.0) == Setpoint(0.5, 0.2, 0.0)


def test_after_the_end_nothing_counts() -> None:
    helm = Helm()
    helm.take(Hold(frequency_hz=1.0))
    helm.setpoint(0.0)
    helm.take(End("done"))
    helm.take(Hold(frequency_hz=1.0))
    helm.take(End("again"))
    assert helm.ended == End("done")
    assert helm.setpoint(9.0).at_rest


STEPS = st.one_of(
    st.builds(Hold, *(st.none() | st.floats(-10, 10) for _ in range(3))),
    st.builds(Nudge, *(st.floats(-3, 3) for _ in range(3))),
    st.just(Stop()),
)


@given(st.lists(st.tuples(STEPS, st.floats(0, 1)), max_size=20))
def test_whatever_the_operator_does_the_fish_is_told_what_its_boards_let_through(
    steps: list[tuple[object, float]],
) -> None:
    bounds, limits = Bounds(), MotionLimits()
    helm, now_s = Helm(bounds), 0.0
    previous = helm.setpoint(0.0)
    for step, wait_s in steps:
        helm.take(step)  # type: ignore[arg-type]
        now_s += wait_s
        told = helm.setpoint(now_s)
        assert 0 <= told.frequency_hz <= min(bounds.frequency_hz, limits.frequency_hz)
        assert abs(told.bias_rad) <= min(bounds.bias_rad, limits.bias_rad)
        assert abs(told.bias_rad) + told.amplitude_rad <= limits.angle_rad + 1e-9
        rise = told.frequency_hz - previous.frequency_hz
        assert rise <= bounds.frequency_hz_s * wait_s + 1e-9
        previous = told


def test_many_small_steps_come_back_to_exactly_nothing() -> None:
    helm = Helm()
    for _ in range(5):
        helm.take(Nudge(frequency_hz=0.1, bias_rad=math.radians(5)))
    for _ in range(5):
        helm.take(Nudge(frequency_hz=-0.1, bias_rad=-math.radians(5)))
    helm.setpoint(0.0)
    assert helm.setpoint(60.0).at_rest


# --- keyboard --------------------------------------------------------------------------------


def test_keys_of_a_terminal_cut_anywhere() -> None:
    stream = b"w\x1b[A\x1bOC\x1b[1;5D\x1b[3~ Q\x1b[B"
    expected = ["w", "up", "right", "left", " ", "q", "down"]
    for size in range(1, len(stream) + 1):
        decoder = KeyDecoder()
        found = []
        for start in range(0, len(stream), size):
            found += decoder.receive(stream[start : start + size])
        assert found == expected


def test_an_escape_alone_is_a_key_and_alt_with_a_letter_none() -> None:
    decoder = KeyDecoder()
    assert decoder.receive(b"\x1b") == []
    assert decoder.waiting
    assert decoder.idle() == ["escape"]
    assert decoder.receive(b"\x1bx") == []
    assert not decoder.waiting
    assert decoder.receive(b"\x1b[") == []
    assert decoder.idle() == []


@given(st.binary(max_size=60))
def test_any_octets_are_keys(data: bytes) -> None:
    decoder = KeyDecoder()
    inputs(decoder.receive(data))
    decoder.idle()
    assert decoder.receive(b"a") == ["a"]


def test_left_is_left() -> None:
    helm = Helm()
    for what in inputs(["left", "a"]):
        helm.take(what)
    helm.setpoint(0.0)
    assert helm.setpoint(9.0).bias_rad == pytest.approx(math.radians(-10.0))


def test_the_terminal_is_as_before_even_after_a_fault() -> None:
    ours, theirs = pty.openpty()
    try:
        before = termios.tcgetattr(theirs)
        with cbreak(theirs):
            during = termios.tcgetattr(theirs)
            assert not during[3] & (termios.ECHO | termios.ICANON)
            assert during[3] & termios.ISIG  # Ctrl-C is Ctrl-C
        assert termios.tcgetattr(theirs) == before
        with pytest.raises(RuntimeError), cbreak(theirs):
            raise RuntimeError
        assert termios.tcgetattr(theirs) == before
    finally:
        os.close(ours)
        os.close(theirs)


def test_no_terminal_is_said(tmp_path: Path) -> None:
    with (
        (tmp_path / "file").open("w") as file,
        pytest.raises(UserError, match="no terminal"),
        cbreak(file.fileno()),
    ):
        pass


def test_the_help_names_what_the_keys_are() -> None:
    for key in ("arrows", "WASD", "+ −", "c:", "space", "q:"):
        assert key in keyboard.HELP
    assert set("wasdc q+-") <= set(keyboard.KEYS)


# --- joystick --------------------------------------------------------------------------------


def event(kind: int, number: int, value: int) -> bytes:
    """As the kernel writes it: struct js_event of <linux/joystick.h>."""
    return struct.pack("=IhBB", 123_456, value, kind, number)


def test_events_are_eight_octets_cut_anywhere() -> None:
    literal = bytes.fromhex("40e20100 0180 02 01".replace(" ", ""))
    if struct.pack("=H", 1) == b"\1\0":  # this vector is of a little-endian machine
        assert EventDecoder().receive(literal) == [JoystickEvent(True, 1, -1.0, False)]
    stream = event(0x82, 0, 100) + event(1, 7, 1) + event(2, 1, -32768) + event(9, 0, 0)
    for size in range(1, 33):
        decoder = EventDecoder()
        found = []
        for start in range(0, len(stream), size):
            found += decoder.receive(stream[start : start + size])
        assert [(e.is_axis, e.number, e.initial) for e in found] == [
            (True, 0, True), (False, 7, False), (True, 1, False)
        ]  # fmt: skip
        assert found[2].value == -1.0
        assert decoder.unknown == 1


def test_the_dead_zone_has_no_edge() -> None:
    assert joystick.beyond_dead_zone(0.1, 0.1) == 0.0
    assert joystick.beyond_dead_zone(-0.1001, 0.1) == pytest.approx(-0.0001 / 0.9)
    assert joystick.beyond_dead_zone(1.0, 0.1) == 1.0
    assert joystick.beyond_dead_zone(-1.0, 0.1) == -1.0
    values = [joystick.beyond_dead_zone(n / 100, 0.2) for n in range(-100, 101)]
    assert all(a <= b for a, b in itertools.pairwise(values))


def test_a_stick_by_its_mapping() -> None:
    bounds = Bounds()
    stick = Stick(Mapping(), bounds)
    assert stick.inputs(EventDecoder().receive(event(0x82, 1, -32767))) == []  # a lever left on
    full_left = stick.inputs([JoystickEvent(True, 0, -1.0, False)])
    assert full_left == [Hold(bias_rad=-bounds.bias_rad)]
    assert stick.inputs([JoystickEvent(True, 1, -1.0, False)]) == [Hold(frequency_hz=2.0)]
    assert stick.inputs([JoystickEvent(True, 1, 0.7, False)]) == [Hold(frequency_hz=0.0)]
    assert stick.inputs([JoystickEvent(False, 0, 1.0, False)]) == [Stop()]
    assert stick.inputs([JoystickEvent(False, 0, 0.0, False)]) == []
    assert isinstance(stick.inputs([JoystickEvent(False, 7, 1.0, False)])[0], End)


def test_with_a_hold_button_the_fish_swims_only_while_it_is_held(tmp_path: Path) -> None:
    file = tmp_path / "pad.toml"
    file.write_text("[buttons]\nhold = 5\n[axes.amplitude]\nnumber = 3\n", encoding="utf-8")
    stick = Stick(joystick.read_mapping(file), Bounds())
    assert stick.inputs([JoystickEvent(True, 1, -1.0, False)]) == []
    assert stick.inputs([JoystickEvent(False, 5, 1.0, False)]) == [Hold(frequency_hz=2.0)]
    assert stick.inputs([JoystickEvent(True, 3, 1.0, False)]) == [
        Hold(amplitude_rad=Bounds().amplitude_rad)
    ]
    assert stick.inputs([JoystickEvent(False, 5, 0.0, False)]) == [Stop()]
    assert stick.inputs([JoystickEvent(True, 1, -0.9, False)]) == []


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("dead_zone = 2", "dead_zone"),
        ("[axes.yaw]\nnumber=1", "yaw"),
        ("[axes.bias]\nnumber='x'", "number"),
        ("not toml", "pad.toml"),
    ],
)
def test_a_wrong_mapping_is_one_line(text: str, says: str, tmp_path: Path) -> None:
    file = tmp_path / "pad.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(UserError, match=says):
        joystick.read_mapping(file)


def test_no_joystick_says_what_to_look_at() -> None:
    with pytest.raises(UserError, match="js\\*"):
        joystick.open_device("/dev/input/js-none")


# --- script ----------------------------------------------------------------------------------


def test_a_script_is_timed_inputs() -> None:
    steps = script.parse(
        "# demo\n0 frequency_hz=1.5 amplitude_deg=10\n\n2.5 bias_deg=-90 # left\n3 stop\n"
    )
    assert steps == [
        (0.0, Hold(frequency_hz=1.5, amplitude_rad=math.radians(10))),
        (2.5, Hold(bias_rad=-math.pi / 2)),
        (3.0, Stop()),
        (3.0, End("the script is at its end")),
    ]
    assert script.parse("1 end\n2 stop")[-1][0] == 1.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "nothing in it"),
        ("1 stop\n0.5 stop", "line 2.*before the line above"),
        ("x stop", "line 1: 'x' is no number"),
        ("1 speed=3", "'speed=3' is none of"),
        ("1 bias_deg=nan", "'nan' is no number"),
        ("1", "nothing to do"),
        ("-1 stop", "before the line above"),
    ],
)
def test_a_wrong_script_is_one_line_with_its_place(text: str, says: str) -> None:
    with pytest.raises(UserError, match=says) as caught:
        script.parse(text, "demo.txt")
    assert "demo.txt" in str(caught.value)
