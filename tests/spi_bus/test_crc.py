"""CRC-16/GENIBUS against its published check value, the division itself, and crcmod-plus."""

import crcmod.predefined
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spi_bus.crc import INVERTED, POLYNOMIAL, RESIDUE, crc16

by_crcmod = crcmod.mkCrcFun(POLYNOMIAL, initCrc=0, rev=False, xorOut=INVERTED)


def bitwise(data: bytes) -> int:
    """CRC as the polynomial division it is: x^16 + x^12 + x^5 + 1, start 0xFFFF, inverted."""
    register = 0xFFFF
    for byte in data:
        for bit in range(7, -1, -1):
            top = register >> 15 ^ byte >> bit & 1
            register = (register << 1 & 0xFFFF) ^ (0x1021 if top else 0)
    return register ^ 0xFFFF


def test_published_check_value():
    assert crc16(b"123456789") == 0xD64E


def test_of_nothing_is_the_inverted_start_value():
    assert crc16(b"") == 0


@pytest.mark.parametrize(
    ("data", "crc"), [(bytes(4), 0x7B3F), (b"\xff" * 4, 0xE2F0), (b"A", 0x46EA)]
)
def test_of_a_few_octets_by_crcmod_and_by_hand(data, crc):
    assert crc16(data) == bitwise(data) == by_crcmod(data) == crc


@given(st.binary(max_size=300))
def test_agrees_with_division_and_with_crcmod_and_leaves_a_constant(data):
    crc = crc16(data)
    assert crc == bitwise(data) == by_crcmod(data)
    assert crc == crcmod.predefined.mkCrcFun("crc-16-genibus")(data)
    assert crc16(data + crc.to_bytes(2, "big")) == RESIDUE


@given(st.binary(min_size=1, max_size=250), st.integers(0), st.integers(1, 0xFFFF))
def test_every_burst_of_up_to_16_bits_is_detected(data, position, burst):
    sealed = data + crc16(data).to_bytes(2, "big")
    bits = 8 * len(sealed)
    shift = position % (bits - burst.bit_length() + 1)
    damaged = int.from_bytes(sealed, "big") ^ burst << shift
    assert crc16(damaged.to_bytes(len(sealed), "big")) != RESIDUE


def test_leading_zeros_are_seen():
    # The reason for the start value: with XMODEM's zero these two would be equal.
    assert crc16(b"\0fish") != crc16(b"fish")


@given(st.binary(max_size=250), st.integers(1, 4))
def test_trailing_zeros_are_seen(data, zeros):
    # The reason for the inversion: without it the remainder of a whole frame is zero and stays so.
    sealed = data + crc16(data).to_bytes(2, "big")
    assert crc16(sealed + bytes(zeros)) != RESIDUE
