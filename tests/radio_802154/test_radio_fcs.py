"""The FCS against the CRC catalogue, the standard's own example and captured frames."""

import pytest

from radio_802154.errors import FcsError, RemoteFrameError
from radio_802154.fcs import append_fcs, fcs, fcs_ok, strip_fcs


def test_check_value_of_the_crc_catalogue() -> None:
    assert fcs(b"123456789") == 0x2189


def test_example_of_the_standard() -> None:
    """Clause 7.2.1.9: an ACK 0100 0000 0000 0000 0101 0110 has FCS 0010 0111 1001 1110."""

    def octets(bits: str) -> bytes:  # leftmost bit is sent first, which is bit 0 of its octet
        return bytes(int(group[::-1], 2) for group in bits.split(","))

    content = octets("01000000,00000000,01010110")
    assert append_fcs(content) == content + octets("00100111,10011110")


@pytest.mark.parametrize(
    ("captured", "expected"),
    [  # frames with FCS from the regression tests of scapy, layers/dot15d4.uts
        ("008089aa990000ffcf0000002284fecaefbeedfecefaffffff0058a4", 0xA458),
        ("23cc89ffff8877665544332211aa99ffeeddccbbaa998808aa99dec014adde5c21", 0x215C),
    ],
)
def test_captured_frames(captured: str, expected: int) -> None:
    mpdu = bytes.fromhex(captured)
    assert fcs_ok(mpdu)
    assert fcs(strip_fcs(mpdu)) == expected


def test_every_single_bit_error_is_found() -> None:
    mpdu = append_fcs(bytes(range(40)))
    for bit in range(8 * len(mpdu)):
        damaged = bytearray(mpdu)
        damaged[bit // 8] ^= 1 << bit % 8
        assert not fcs_ok(bytes(damaged))


def test_errors_say_whose_fault() -> None:
    with pytest.raises(FcsError, match="received FCS 0x0000"):
        strip_fcs(b"\x02\x00\x6a\x00\x00")
    with pytest.raises(RemoteFrameError, match="shorter"):
        strip_fcs(b"\xe4\x79")
    assert not fcs_ok(b"\x00\x00")
