"""XBee API frames against published octets, then their properties in both modes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from radio_802154.errors import LocalFrameError, RemoteFrameError
from radio_802154.xbee import (
    ApiFrame,
    AtCommand,
    AtCommandQueued,
    AtResponse,
    Decoder,
    ModemStatus,
    OtherFrame,
    RxPacket16,
    RxPacket64,
    TxRequest16,
    TxRequest64,
    TxStatus,
    XBeeError,
    checksum,
    encode,
    unpack,
)

octet = st.integers(0, 255)
data = st.binary(max_size=100)
address = st.integers(0, 0xFFFF)
long_address = st.integers(0, 2**64 - 1)
command = st.binary(min_size=2, max_size=2)
frames: st.SearchStrategy[ApiFrame] = st.one_of(
    st.builds(TxRequest64, octet, long_address, octet, data),
    st.builds(TxRequest16, octet, address, octet, data),
    st.builds(AtCommand, octet, command, data),
    st.builds(AtCommandQueued, octet, command, data),
    st.builds(RxPacket64, long_address, octet, octet, data),
    st.builds(RxPacket16, address, octet, octet, data),
    st.builds(AtResponse, octet, command, octet, data),
    st.builds(TxStatus, octet, octet),
    st.builds(ModemStatus, octet),
    st.builds(OtherFrame, st.integers(0x8B, 0xFF), data),
)
modes = pytest.mark.parametrize("escaped", [False, True], ids=["AP1", "AP2"])


def test_the_manual_s_escaped_frame() -> None:
    octets = bytes.fromhex("7E 00 02 23 7D 31 CB")
    frame = OtherFrame(0x23, b"\x11")
    assert encode(frame, escaped=True) == octets
    assert Decoder(escaped=True).receive(octets) == [frame]
    assert encode(frame, escaped=False) == bytes.fromhex("7E 00 02 23 11 CB")


SENDER = 0x0013A20012345678

# "XBee/XBee-PRO S2C 802.15.4 RF Module User Guide", examples of frames 0x00, 0x01, 0x80, 0x81
PUBLISHED = (
    (
        "7E 00 11 00 52 00 13 A2 00 12 34 56 78 00 54 78 44 61 74 61 9E",
        TxRequest64(0x52, SENDER, 0, b"TxData"),
    ),
    (
        "7E 00 14 00 00 00 00 00 00 00 00 FF FF 00 42 72 6F 61 64 63 61 73 74 6E",
        TxRequest64(0, 0xFFFF, 0, b"Broadcast"),
    ),
    ("7E 00 0B 01 87 12 34 00 54 78 44 61 74 61 EB", TxRequest16(0x87, 0x1234, 0, b"TxData")),
    (
        "7E 00 0E 01 00 FF FF 00 42 72 6F 61 64 63 61 73 74 6D",
        TxRequest16(0, 0xFFFF, 0, b"Broadcast"),
    ),
    (
        "7E 00 11 80 00 13 A2 00 12 34 56 78 5E 01 54 78 44 61 74 61 11",
        RxPacket64(SENDER, 0x5E, 1, b"TxData"),
    ),
    ("7E 00 0B 81 12 34 5E 01 54 78 44 61 74 61 93", RxPacket16(0x1234, 0x5E, 1, b"TxData")),
)


def test_the_manual_s_second_escaped_frame() -> None:
    """Frame 0x10 of the 900HP/XSC manual: an address and a checksum of 0x13, both escaped."""
    octets = bytes.fromhex(
        "7E 00 16 10 01 00 7D 33 A2 00 40 0A 01 27 FF FE 00 00 54 78 44 61 74 61 30 41 7D 33"
    )
    frame = OtherFrame(
        0x10, bytes.fromhex("01 0013A200400A0127 FFFE 00 00 54 78 44 61 74 61 30 41")
    )
    assert encode(frame, escaped=True) == octets
    assert Decoder(escaped=True).receive(octets) == [frame]


@pytest.mark.parametrize(("text", "frame"), PUBLISHED)
def test_published_frames(text: str, frame: ApiFrame) -> None:
    octets = bytes.fromhex(text)
    assert encode(frame, escaped=False) == octets
    assert Decoder(escaped=False).receive(octets) == [frame]


def test_layout_of_received_packets() -> None:
    short = bytes.fromhex("81 1234 28 00 7F80")
    assert unpack(short) == RxPacket16(0x1234, 0x28, 0, b"\x7f\x80")
    extended = bytes.fromhex("80 0013A20040522BAA 30 02 01")
    assert unpack(extended) == RxPacket64(0x0013A20040522BAA, 0x30, 2, b"\x01")


@given(data)
def test_sum_with_checksum_is_ff(content: bytes) -> None:
    assert (sum(content) + checksum(content)) % 256 == 0xFF


@modes
@given(sent=st.lists(frames, max_size=5), draw=st.data())
def test_any_cut_gives_what_was_sent(
    escaped: bool, sent: list[ApiFrame], draw: st.DataObject
) -> None:
    octets = b"".join(encode(frame, escaped=escaped) for frame in sent)
    cuts = draw.draw(st.lists(st.integers(0, len(octets)), max_size=8).map(sorted))
    decoder = Decoder(escaped=escaped)
    heard = []
    for begin, end in zip([0, *cuts], [*cuts, len(octets)], strict=True):
        heard += decoder.receive(octets[begin:end])
    assert heard == sent
    assert decoder.error_count == decoder.buffered == 0


@given(st.lists(st.binary(max_size=400), max_size=4), frames)
def test_mode_2_is_in_step_at_the_next_start(noise: list[bytes], frame: ApiFrame) -> None:
    decoder = Decoder(escaped=True)
    for piece in noise:
        decoder.receive(piece)
        assert decoder.buffered <= 260
    assert decoder.receive(encode(frame, escaped=True)) == [frame]


@given(st.binary(max_size=300), frames)
def test_mode_1_finds_a_frame_behind_a_false_start(noise: bytes, frame: ApiFrame) -> None:
    """A false start costs time, not the frame, unless its checksum happens to be right."""
    decoder = Decoder(escaped=False)
    false = decoder.receive(noise)
    heard = decoder.receive(encode(frame, escaped=False)) + decoder.idle()
    assert decoder.buffered == 0
    if not false and heard[-1:] != [frame]:
        # then a frame with a right checksum began in the noise and reached into this one
        assert heard
        assert 0x7E in noise


@modes
@given(noise=st.lists(st.binary(max_size=300), max_size=4))
def test_any_octets_are_survived(escaped: bool, noise: list[bytes]) -> None:
    decoder = Decoder(escaped=escaped)
    for piece in noise:
        decoder.receive(piece)
    decoder.idle()
    assert decoder.buffered == 0


@modes
@given(frame=frames, draw=st.data())
def test_a_damaged_content_octet_is_noticed(
    escaped: bool, frame: ApiFrame, draw: st.DataObject
) -> None:
    """One octet of type, fields or checksum: their sum is no longer 0xFF."""
    plain = bytearray(encode(frame, escaped=False))
    place = draw.draw(st.integers(3, len(plain) - 1))
    plain[place] ^= draw.draw(st.integers(1, 255))
    octets = bytes(plain)
    if escaped:
        for special in (0x7D, 0x7E, 0x11, 0x13):
            whole = octets[1:].replace(bytes((special,)), bytes((0x7D, special ^ 0x20)))
            octets = octets[:1] + whole
    decoder = Decoder(escaped=escaped)
    assert frame not in decoder.receive(octets)
    assert decoder.error_count


def test_kinds_of_damage() -> None:
    good = bytes.fromhex("7E 00 03 89 01 00 75")
    decoder = Decoder(escaped=True)
    assert len(decoder.receive(b"abc" + good)) == 1  # noise
    assert len(decoder.receive(good[:4] + good)) == 1  # cut
    assert len(decoder.receive(good[:-1] + b"\x74" + good)) == 1  # checksum
    assert len(decoder.receive(b"\x7e\xff\xff\x00" + good)) == 1  # length
    layout = b"\x89\x01"
    short = b"\x7e\x00\x02" + layout + bytes((checksum(layout),))
    assert len(decoder.receive(short + good)) == 1
    assert decoder.errors == dict.fromkeys(XBeeError, 1)


def test_what_does_not_fit_is_refused() -> None:
    for wrong in (
        TxRequest16(1, 0x10000, 0, b""),
        TxRequest16(1, 1, 0, bytes(101)),
        AtCommand(1, b"DLX"),
        OtherFrame(0x81, b""),
        OtherFrame(0xFF, bytes(256)),
    ):
        with pytest.raises(LocalFrameError):
            encode(wrong, escaped=True)
    with pytest.raises(RemoteFrameError):
        unpack(b"")
