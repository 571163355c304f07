"""Lines of a tracker: what is a pose, what is refused and with which words; nothing raises."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tools.bench.tracker_lines import (
    MAX_LINE_BYTES,
    LineFault,
    LineReader,
    Refused,
    TrackerPose,
    read_pose,
)

GOOD = b'{"time_s": 12.5, "x_m": 0.51, "y_m": -0.2, "heading_rad": 1.57}'


def test_a_line_is_a_pose() -> None:
    assert read_pose(GOOD, 1) == TrackerPose(12.5, 0.51, -0.2, 1.57)
    more = b'{"heading_rad":0,"y_m":1,"x_m":2,"time_s":3,"id":7,"quality":0.5,"tags":[1,{"a":2}]}\r'
    assert read_pose(more, 1) == TrackerPose(3.0, 2.0, 1.0, 0.0, 7, 0.5)


@pytest.mark.parametrize(
    ("line", "fault", "says"),
    [
        (b'{"time_s":1,"x_m":NaN,"y_m":0,"heading_rad":0}', "not_finite", "send no line while"),
        (b'{"time_s":1,"x_m":-Infinity,"y_m":0,"heading_rad":0}', "not_finite", "infinity"),
        (b'{"time_s":1,"x_m":1e999,"y_m":0,"heading_rad":0}', "keys", "out of range"),
        (b'{"time_s":1,"x_m":0,"y_m":0,"heading_rad":93.1}', "range", "are these degrees?"),
        (b'{"time_s":1,"x_m":512,"y_m":0,"heading_rad":0}', "range", "millimetres or pixels"),
        (b'{"time_s":1,"x_m":0,"y_m":-33,"heading_rad":0}', "range", "y_m = -33"),
        (b'{"time_s":1,"x_m":0,"y_m":0,"heading_rad":0,"quality":90}', "range", "quality = 90"),
        (b'{"time_s":1,"x":0,"y_m":0,"heading_rad":0}', "keys", "x_m is missing; there is 'x'"),
        (b'{"time_s":1,"x_m":0,"y_m":0,"heading_deg":90}', "keys", "there is 'heading_deg'"),
        (b'{"time_s":1,"x_m":0,"y_m":0}', "keys", "heading_rad is missing: each line has"),
        (b'{"time_s":"1","x_m":0,"y_m":0,"heading_rad":0}', "keys", "got `str` - at `$.time_s`"),
        (b'{"time_s":1,"x_m":null,"y_m":0,"heading_rad":0}', "keys", "got `null`"),
        (b'{"time_s":true,"x_m":0,"y_m":0,"heading_rad":0}', "keys", "got `bool`"),
        (b"[1, 0, 0, 0]", "syntax", "got `array`"),
        (b"3", "syntax", "got `int`"),
        (b"1.5,0.1,0.2,0.3", "syntax", "write one a line, such as"),
        (b"hello", "syntax", "'hello' is no JSON object"),
        (b'{"time_s":1,"x_m":0,"y_m":0,"heading_rad":0', "syntax", "truncated"),
        (GOOD + GOOD, "syntax", "is no JSON"),
        (b'{"time_s":1,"x":1} x', "keys", "x_m is missing"),
        (b'{"a":' * 600, "syntax", "is no JSON"),
        (GOOD.decode().encode("utf-16"), "encoding", "UTF-8 without a mark"),
        (b"\xef\xbb\xbf" + GOOD, "encoding", "UTF-8 without a mark"),
        (GOOD[:-1] + b',"id":"fish \xe4"}', "encoding", "UTF-8"),
    ],
)  # fmt: skip
def test_what_is_no_pose_is_refused_with_place_and_remedy(
    line: bytes, fault: str, says: str
) -> None:
    refused = read_pose(line, 17)
    assert isinstance(refused, Refused)
    assert refused.fault == fault
    assert says in refused.reason
    assert str(refused).startswith("line 17: ")
    assert "\n" not in str(refused)
    assert len(str(refused)) < 400


def test_lines_are_cut_anywhere_and_a_bad_one_costs_nothing_else() -> None:
    stream = GOOD + b"\n\n  \nnonsense\n" + GOOD + b"\r\n" + GOOD
    whole = LineReader()
    expected = whole.receive(stream)
    assert [type(item).__name__ for item in expected] == ["TrackerPose", "Refused", "TrackerPose"]
    bad = expected[1]
    assert isinstance(bad, Refused)
    assert bad.line == 4
    for size in range(1, 40):
        reader = LineReader()
        found = []
        for start in range(0, len(stream), size):
            found += reader.receive(stream[start : start + size])
        assert found == expected
    [cut] = whole.end()
    assert isinstance(cut, Refused)
    assert cut.fault is LineFault.CUT
    assert whole.end() == []


def test_the_last_line_of_a_datagram_needs_no_line_feed() -> None:
    reader = LineReader()
    assert reader.receive(GOOD + b"\n" + GOOD) == [read_pose(GOOD, 1)]
    assert reader.end(whole=True) == [read_pose(GOOD, 2)]
    assert reader.lines == 2


@pytest.mark.parametrize("piece", [1, 100, MAX_LINE_BYTES, 100_000])
def test_a_line_without_end_is_told_once_and_does_not_fill_the_memory(piece: int) -> None:
    stream = GOOD + b"\n" + b"x" * 50_000 + b"\n" + GOOD + b"\n"
    reader = LineReader()
    found = []
    for start in range(0, len(stream), piece):
        found += reader.receive(stream[start : start + piece])
        assert len(reader._buffer) <= MAX_LINE_BYTES
    assert [type(item).__name__ for item in found] == ["TrackerPose", "Refused", "TrackerPose"]
    assert isinstance(found[1], Refused)
    assert (found[1].line, found[1].fault) == (2, LineFault.LONG)


def test_the_longest_line_is_read() -> None:
    line = GOOD[:-1] + b',"id":"' + b"a" * (MAX_LINE_BYTES - len(GOOD) - 8) + b'"}'
    assert len(line) == MAX_LINE_BYTES
    assert isinstance(LineReader().receive(line + b"\n")[0], TrackerPose)
    assert isinstance(LineReader().receive(line + b" \n")[0], Refused)


@given(st.lists(st.binary(max_size=300), max_size=8))
def test_any_octets_are_poses_or_refused_and_never_raise(pieces: list[bytes]) -> None:
    reader = LineReader()
    for piece in pieces:
        for item in reader.receive(piece):
            assert isinstance(item, TrackerPose | Refused)
    reader.end()


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3)
    ),
    max_leaves=6,
)
KEYS = st.sampled_from(["time_s", "x_m", "y_m", "heading_rad", "id", "quality", "other"])


@given(st.dictionaries(KEYS, JSON, max_size=7))
def test_what_python_writes_is_a_pose_exactly_when_it_is_one(value: dict[str, object]) -> None:
    found = read_pose(json.dumps(value).encode(), 1)

    def number(name: str, most: float) -> bool:
        got = value.get(name)
        return (
            isinstance(got, int | float) and not isinstance(got, bool) and math.isfinite(got)
            and abs(got) <= most
        )  # fmt: skip

    fits = (
        number("time_s", math.inf)
        and number("x_m", 32.767)
        and number("y_m", 32.767)
        and number("heading_rad", 2 * math.pi + 1e-6)
        and ("quality" not in value or (number("quality", 1.0) and float(value["quality"]) >= 0))  # type: ignore[arg-type]
        and type(value.get("id", "")) in (str, int)
    )
    if fits and any(isinstance(v, int) and abs(v) > 1e300 for v in value.values()):
        return  # integers beyond a float
    assert isinstance(found, TrackerPose) == fits, found
