"""The TinyOS serial framing against public vectors, then its properties."""

from __future__ import annotations

import binascii

import pytest
from hypothesis import given
from hypothesis import strategies as st

from radio_802154.errors import LocalFrameError, RemoteFrameError
from radio_802154.tinyos_serial import (
    AmMessage,
    Decoder,
    PacketType,
    SerialError,
    SerialPacket,
    crc16,
    decode_am,
    encode,
    encode_am,
)

DATA_ACK = PacketType.DATA_ACK

# frames of proactivity-lab's "Serial protocol" page (dispatch 0xFF and 0x0E, number 0)
PUBLIC = (
    ("7E 44 00 FF 9D DF 7E", SerialPacket(DATA_ACK, 0, 0xFF)),
    (
        "7E 44 00 0E 01 02 03 04 05 06 07 08 09 0A 0B 0C 0D 0E 0F 3B 8B 7E",
        SerialPacket(DATA_ACK, 0, 0x0E, bytes(range(1, 16))),
    ),
    (
        "7E 44 00 0E 7D 5E 7D 5E 7D 5E ED B9 7E",
        SerialPacket(DATA_ACK, 0, 0x0E, b"\x7e\x7e\x7e"),
    ),
    ("7E 44 00 0E 7D 5D 7D 5E 33 62 7E", SerialPacket(DATA_ACK, 0, 0x0E, b"\x7d\x7e")),
)

# docs of real motes: the body, and its CRC octets before escaping
MOTE_BODY = bytes.fromhex("44 26 00 ffff 0000 04 22 06 7e7d0102")
MOTE_FRAME = bytes.fromhex("7e 44 26 00 ffff 0000 04 22 06 7d5e 7d5d 01 02 18 7b 7e")

packets = st.one_of(
    st.builds(SerialPacket, st.just(PacketType.ACK), st.integers(0, 255)),
    st.builds(
        SerialPacket,
        st.just(DATA_ACK),
        st.integers(0, 255),
        st.integers(0, 255),
        st.binary(max_size=262),
    ),
    st.builds(
        SerialPacket,
        st.just(PacketType.DATA),
        st.none(),
        st.integers(0, 255),
        st.binary(max_size=262),
    ),
)


def test_crc_has_its_published_check_value() -> None:
    assert crc16(b"123456789") == 0x31C3


@given(st.binary(max_size=300))
def test_crc_is_that_of_the_standard_library(data: bytes) -> None:
    assert crc16(data) == binascii.crc_hqx(data, 0)


@pytest.mark.parametrize(("text", "packet"), PUBLIC)
def test_published_frames(text: str, packet: SerialPacket) -> None:
    assert encode(packet) == bytes.fromhex(text)
    assert Decoder().receive(bytes.fromhex(text)) == [packet]


def test_the_frame_of_a_real_mote() -> None:
    assert crc16(MOTE_BODY).to_bytes(2, "little") == bytes.fromhex("18 7b")
    message = AmMessage(0xFFFF, 6, bytes.fromhex("7e7d0102"), source=0, group=0x22)
    packet = SerialPacket(DATA_ACK, 0x26, 0, encode_am(message))
    assert encode(packet) == MOTE_FRAME
    (heard,) = Decoder().receive(MOTE_FRAME)
    assert heard == packet
    assert decode_am(heard.body) == message


def test_frames_may_share_a_delimiter() -> None:
    first, second = (bytes.fromhex(text) for text, _ in PUBLIC[:2])
    assert Decoder().receive(first + second[1:]) == [packet for _, packet in PUBLIC[:2]]


@given(st.lists(packets, max_size=6), st.data())
def test_any_cut_gives_what_was_sent(sent: list[SerialPacket], data: st.DataObject) -> None:
    octets = b"".join(map(encode, sent))
    cuts = data.draw(st.lists(st.integers(0, len(octets)), max_size=8).map(sorted))
    decoder = Decoder()
    heard = []
    for begin, end in zip([0, *cuts], [*cuts, len(octets)], strict=True):
        heard += decoder.receive(octets[begin:end])
    assert heard == sent
    assert decoder.error_count == 0
    assert decoder.buffered == 0


@given(st.lists(st.binary(max_size=700), max_size=5), packets)
def test_after_any_noise_one_delimiter_is_enough(noise: list[bytes], packet: SerialPacket) -> None:
    decoder = Decoder()
    for piece in noise:
        decoder.receive(piece)
        assert decoder.buffered <= 2 * 269 + 1
    assert decoder.receive(b"\x7e" + encode(packet))[-1:] == [packet]
    # and without it, the frame that the noise runs into is the only one that is lost
    assert decoder.receive(b"\x01\x02" + encode(packet) + encode(packet))[-1:] == [packet]


@given(packets, st.data())
def test_damage_of_up_to_two_bits_is_never_taken_for_a_packet(
    packet: SerialPacket, data: st.DataObject
) -> None:
    octets = bytearray(encode(packet))
    bit = st.integers(8, 8 * (len(octets) - 1) - 1)
    for place in {data.draw(bit), data.draw(bit)}:
        octets[place // 8] ^= 1 << place % 8
    decoder = Decoder()
    heard = decoder.receive(bytes(octets))
    # a bit that turns an escaped octet into a plain one can leave the content as it was
    assert all(found == packet for found in heard)


@given(st.binary(max_size=300))
def test_random_octets_are_a_packet_only_with_their_crc(noise: bytes) -> None:
    for packet in Decoder().receive(b"\x7e" + noise + b"\x7e"):
        assert encode(packet).count(b"\x7e") == 2
        content = encode(packet)[1:-1].replace(b"\x7d\x5e", b"\x7e").replace(b"\x7d\x5d", b"\x7d")
        assert binascii.crc_hqx(content[:-2], 0) == int.from_bytes(content[-2:], "little")


def test_crc_lets_one_damaged_frame_in_65536_pass() -> None:
    frame = encode(SerialPacket(PacketType.DATA, None, 0, b"\x01\x02\x03"))[1:-1]
    passed = 0
    for crc in range(1 << 16):
        escaped = crc.to_bytes(2, "little").replace(b"\x7d", b"\x7d\x5d")
        escaped = escaped.replace(b"\x7e", b"\x7d\x5e")
        passed += len(Decoder().receive(b"\x7e" + frame[:-2] + escaped + b"\x7e"))
    assert passed == 1


def test_kinds_of_damage() -> None:
    decoder = Decoder()
    assert decoder.receive(b"\x7e\x45\x7e") == []
    assert decoder.receive(b"\x45\x00\x01\x02\x7d\x7e") == []
    assert decoder.receive(b"\x45\x00\x01\x02\x7e") == []
    bad_type = b"\x46\x00"
    assert decoder.receive(bad_type + crc16(bad_type).to_bytes(2, "little") + b"\x7e") == []
    assert decoder.receive(bytes(600)) == []
    assert decoder.receive(b"\x01" * 600 + b"\x7e") == []
    assert {kind: n for kind, n in decoder.errors.items() if n} == dict.fromkeys(SerialError, 1)


@pytest.mark.parametrize(
    "packet",
    [
        SerialPacket(PacketType.ACK),
        SerialPacket(PacketType.ACK, 1, 0),
        SerialPacket(PacketType.ACK, 1, None, b"x"),
        SerialPacket(PacketType.DATA, 1, 0),
        SerialPacket(DATA_ACK, 256, 0),
        SerialPacket(DATA_ACK, 1, 0, bytes(263)),
    ],
)
def test_what_is_no_packet_is_refused(packet: SerialPacket) -> None:
    with pytest.raises(LocalFrameError):
        encode(packet)


def test_active_messages_that_contradict_themselves() -> None:
    with pytest.raises(LocalFrameError):
        encode_am(AmMessage(0x10000, 1))
    with pytest.raises(LocalFrameError):
        encode_am(AmMessage(1, 1, bytes(256)))
    body = encode_am(AmMessage(1, 1, b"abc"))
    for wrong in (body[:6], body[:-1], body + b"x"):
        with pytest.raises(RemoteFrameError):
            decode_am(wrong)
