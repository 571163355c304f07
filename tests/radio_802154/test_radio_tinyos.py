"""TinyOS active messages: the layout octet by octet, and what is no active message."""

import pytest

from radio_802154 import mac, tinyos
from radio_802154.errors import LocalFrameError, RemoteFrameError
from radio_802154.tinyos import AmPacket

# 61 88 | DSN 26 | PAN 0022 | dest 0001 | src 0002 | 3F | AM 06 | 00 04     (TEP 125, I-Frame)
COUNTER = bytes.fromhex("61 88 1a 22 00 01 00 02 00 3f 06 00 04")


def test_layout_octet_by_octet() -> None:
    packet = AmPacket(destination=1, source=2, am_type=6, payload=b"\x00\x04", sequence=0x1A)
    assert tinyos.encode(packet) == COUNTER
    assert tinyos.decode(COUNTER) == packet


def test_frame_control_values_of_tinyos() -> None:
    wanted = mac.decode(tinyos.encode(AmPacket(1, 2, 6, b"")))
    assert wanted.frame_control == 0x8861
    unwanted = mac.decode(tinyos.encode(AmPacket(1, 2, 6, b"", ack_request=False)))
    assert unwanted.frame_control == 0x8841


def test_broadcast_asks_for_no_acknowledgement() -> None:
    octets = tinyos.encode(AmPacket(tinyos.AM_BROADCAST, 2, 6, b""))
    assert octets[:2] == b"\x41\x88"
    assert not tinyos.decode(octets).ack_request


def test_longest_payload() -> None:
    longest = AmPacket(1, 2, 6, bytes(tinyos.MAX_PAYLOAD_OCTETS))
    assert len(tinyos.encode(longest)) == 125
    with pytest.raises(LocalFrameError, match="114"):
        tinyos.encode(AmPacket(1, 2, 6, bytes(tinyos.MAX_PAYLOAD_OCTETS + 1)))
    with pytest.raises(LocalFrameError, match="AM type"):
        tinyos.encode(AmPacket(1, 2, 256, b""))


@pytest.mark.parametrize(
    ("octets", "words"),
    [
        ("02 00 6a", "ACK frame"),
        ("61 88 1a 22 00 01 00 02 00 41 06", "dispatch octet 0x41"),
        ("61 88 1a 22 00 01 00 02 00 3f", "ends before"),
        ("21 88 1a 22 00 01 00 22 00 02 00 3f 06", "within one PAN"),
        ("61 8c 1a 22 00 88 77 66 55 44 33 22 11 02 00 3f 06", "short addresses"),
    ],
)
def test_frames_that_carry_no_active_message(octets: str, words: str) -> None:
    with pytest.raises(RemoteFrameError, match=words):
        tinyos.decode(bytes.fromhex(octets))
