"""The recording's text literally, and what becomes of damaged ones."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spi_bus.errors import PortNotFoundError, RecordingError, TransportLost
from spi_bus.transports import OpenContext, open_transport
from spi_bus.transports.recording import LogLine, Replayer, read_log

TEXT = """\
fishbed-transport-log 1
# serial /dev/ttyUSB0 at 115200 baud
0.000000 > 00 03 11
0.004127 < 03 11 21 01

1.730201 ! down: the device is gone
12.131544 ! up: after 0.401 s and 3 attempts
12.200000 < ff
"""


def clock_of(times: list[float]):
    return lambda: times[0]


def test_a_recording_reads_as_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "swim.log"
    path.write_text(TEXT)
    assert list(read_log(path)) == [
        LogLine(0, ">", b"\x00\x03\x11"),
        LogLine(4_127, "<", b"\x03\x11\x21\x01"),
        LogLine(1_730_201, "!", text="down: the device is gone"),
        LogLine(12_131_544, "!", text="up: after 0.401 s and 3 attempts"),
        LogLine(12_200_000, "<", b"\xff"),
    ]


@pytest.mark.parametrize("cut", range(len(TEXT) - 15, len(TEXT)))
def test_a_torn_last_line_is_left_out(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "swim.log"
    path.write_text(TEXT[:cut])
    kinds = [line.kind for line in read_log(path)]
    assert kinds == [">", "<", "!", "!"]


@pytest.mark.parametrize(
    ("line", "word"),
    [
        ("0.1 < 00", "line 3"),
        ("1.000000 < 0g", "hexadecimal"),
        ("1.000000 < 000", "hexadecimal"),
        ("1.000000 = 00", "line 3"),
        ("nonsense", "nonsense"),
    ],
)
def test_damage_within_is_said_with_its_line(tmp_path: Path, line: str, word: str) -> None:
    path = tmp_path / "swim.log"
    path.write_text(f"fishbed-transport-log 1\n# x\n{line}\n0.000000 < 00\n")
    with pytest.raises(RecordingError, match=word):
        list(read_log(path))


@given(st.binary(max_size=200))
def test_any_bytes_are_a_recording_or_a_recording_error(tmp_path_factory, data: bytes) -> None:
    path = tmp_path_factory.mktemp("any") / "x"
    path.write_bytes(b"fishbed-transport-log 1\n" + data)
    with suppress(RecordingError):
        assert all(line.kind in "<>!" for line in read_log(path))


def test_a_replay_keeps_the_pace_and_the_cuts(tmp_path: Path) -> None:
    path = tmp_path / "swim.log"
    path.write_text(TEXT)
    now = [50.0]
    waits: list[float] = []

    def sleep(duration_s: float) -> None:
        waits.append(round(duration_s, 6))
        now[0] += duration_s

    player = Replayer(path, clock=clock_of(now), sleep=sleep)
    assert player.read() == b""
    player.wait(0.001)
    assert player.read() == b""
    player.wait(9.0)
    assert waits == [0.001, 0.003127]
    assert player.read(3) == b"\x03\x11\x21"
    assert player.read() == b"\x01"
    assert player.next_deadline_s() == pytest.approx(62.2)
    now[0] = 62.2
    player.write(b"nobody hears this")
    assert player.discarded == 17
    assert player.read() == b"\xff"
    with pytest.raises(TransportLost, match="ended"):
        player.read()


def test_at_once_and_what_was_sent(tmp_path: Path) -> None:
    path = tmp_path / "swim.log"
    path.write_text(TEXT)
    context = OpenContext(clock=lambda: 7.0)
    player = open_transport(f"replay:{path}?pace=at-once", context)
    assert [player.read(), player.read()] == [b"\x03\x11\x21\x01", b"\xff"]
    said = open_transport(f"replay:{path}?play=sent&pace=at-once", context)
    assert said.read() == b"\x00\x03\x11"


def test_a_recording_is_never_overwritten_and_none_is_left_of_what_did_not_open(
    tmp_path: Path,
) -> None:
    path = tmp_path / "swim.log"
    path.write_text(TEXT)
    with pytest.raises(RecordingError, match="not overwritten"):
        open_transport(f"record:{path}:pair:x")
    assert path.read_text() == TEXT
    other = tmp_path / "other.log"
    with pytest.raises(PortNotFoundError):
        open_transport(f"record:{other}:serial://{tmp_path}/nothing")
    assert not other.exists()


def test_recorders_nest_and_write_line_by_line(tmp_path: Path) -> None:
    context = OpenContext()
    inner, outer = tmp_path / "inner.log", tmp_path / "outer.log"
    end = open_transport(f"record:{outer}:record:{inner}:pair:x", context)
    far = open_transport("pair:x", context)
    end.write(b"\x01\x02")
    far.write(b"\x03")
    while not end.read():
        end.wait(1.0)
    for path in (inner, outer):  # without closing: a crash now would lose nothing
        assert [(line.kind, line.data) for line in read_log(path)] == [
            (">", b"\x01\x02"),
            ("<", b"\x03"),
        ]
    end.close()
    far.close()
