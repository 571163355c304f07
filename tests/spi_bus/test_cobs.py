"""COBS against the examples of Cheshire & Baker's paper and of Wikipedia's article."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from spi_bus import cobs
from spi_bus.errors import CobsError

UP_TO_FE = bytes(range(0x01, 0xFF))  # 254 bytes without a zero

# https://en.wikipedia.org/wiki/Consistent_Overhead_Byte_Stuffing#Encoding_examples, 1 to 11.
PUBLISHED = [
    (b"\x00", b"\x01\x01"),
    (b"\x00\x00", b"\x01\x01\x01"),
    (b"\x00\x11\x00", b"\x01\x02\x11\x01"),
    (b"\x11\x22\x00\x33", b"\x03\x11\x22\x02\x33"),
    (b"\x11\x22\x33\x44", b"\x05\x11\x22\x33\x44"),
    (b"\x11\x00\x00\x00", b"\x02\x11\x01\x01\x01"),
    (UP_TO_FE, b"\xff" + UP_TO_FE),
    (b"\x00" + UP_TO_FE, b"\x01\xff" + UP_TO_FE),
    (UP_TO_FE + b"\xff", b"\xff" + UP_TO_FE + b"\x02\xff"),
    (UP_TO_FE[1:] + b"\xff\x00", b"\xff" + UP_TO_FE[1:] + b"\xff\x01\x01"),
    (UP_TO_FE[2:] + b"\xff\x00\x01", b"\xfe" + UP_TO_FE[2:] + b"\xff\x02\x01"),
    # The IP packet of the paper's figure 3.
    (
        bytes.fromhex("4500002c4c79000040064f37"),
        bytes.fromhex("02450104" + "2c4c79" + "01" + "05" + "40064f37"),
    ),
]


@pytest.mark.parametrize(("plain", "stuffed"), PUBLISHED)
def test_published_examples(plain, stuffed):
    assert cobs.encode(plain) == stuffed
    assert cobs.decode(stuffed) == plain


def reference(data: bytes) -> bytes:
    """StuffData of the paper, byte by byte, without the block after a full one at the end."""
    out = bytearray([0])
    code_at = 0
    for position, byte in enumerate(data):
        if byte:
            out.append(byte)
        if not byte or len(out) - code_at == 0xFF:
            out[code_at] = len(out) - code_at
            if byte and position == len(data) - 1:
                return bytes(out)
            code_at = len(out)
            out.append(0)
    out[code_at] = len(out) - code_at
    return bytes(out)


runs = st.lists(st.sampled_from([0, 1, 3, 253, 254, 255, 508, 509]), max_size=4)
data_of_any_shape = st.one_of(
    st.binary(max_size=600),
    st.lists(st.sampled_from([0, 0, 7]), max_size=300).map(bytes),
    st.lists(st.tuples(st.integers(0, 40), st.integers(0, 60)), max_size=9).map(
        lambda runs: b"".join(bytes(zeros) + b"\1" * ones for zeros, ones in runs)
    ),
    runs.map(lambda lengths: b"\0".join(b"\x55" * length for length in lengths)),
)


@given(data_of_any_shape)
@example(b"\x55" * 254 + b"\0")
@example(b"\x55" * 508)
def test_agrees_with_the_papers_algorithm_and_comes_back(data):
    stuffed = cobs.encode(data)
    assert stuffed == reference(data)
    assert 0 not in stuffed
    assert len(stuffed) <= len(data) + max(1, -(-len(data) // 254))
    assert cobs.decode(stuffed) == data


@pytest.mark.parametrize(
    "stuffed", [b"", b"\0", b"\x02", b"\x03\x11", b"\x02\x11\x05\x22", b"\x03\x11\0", b"\xff\x01"]
)
def test_what_no_encoder_produces_is_refused(stuffed):
    with pytest.raises(CobsError):
        cobs.decode(stuffed)


def opened(stuffed: bytes) -> bytes | None:
    """UnStuffData of the paper, byte by byte; None for what is no block."""
    out = bytearray()
    at = 0
    while at < len(stuffed):
        code = stuffed[at]
        run = stuffed[at + 1 : at + code]
        if not code or 0 in run or len(run) != code - 1:
            return None
        out += run
        at += code
        if code < 0xFF and at < len(stuffed):
            out.append(0)
    return bytes(out) if stuffed else None


@given(data_of_any_shape | st.lists(st.integers(1, 9), max_size=300).map(bytes))
@example(b"\1" * 255)
@example(b"\1" * 400)
@example(b"\1" * 200 + b"\x03" + b"\1" * 54)
@example(b"\xff" + b"\1" * 254 + b"\1")
def test_any_octets_are_opened_or_refused_as_the_papers_algorithm_does(stuffed):
    expected = opened(stuffed)
    if expected is None:
        with pytest.raises(CobsError):
            cobs.decode(stuffed)
    else:
        assert cobs.decode(stuffed) == expected


@given(st.binary(max_size=300))
def test_decoding_anything_gives_bytes_or_a_cobs_error(data):
    try:
        decoded = cobs.decode(data)
    except CobsError:
        return
    assert len(decoded) < len(data)
