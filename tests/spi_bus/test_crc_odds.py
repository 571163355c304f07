"""What the CRC lets through: nothing of what it promises to see, and 1 in 65 536 of the rest.

A CRC is linear: whether damage is seen depends on the pattern of changed bits and not on the frame.
So the promises can be tried out in full, for every position in the longest frame; the odds of
random damage are measured on many frames at once, with the CRC computed by column.

The promises are about frames. On the wire frames are stuffed, and a changed code byte moves zeros:
one wrong bit there can do to the frame what no burst of 16 bits does. An example stands at the end.
"""

import math

import numpy as np
import pytest

from spi_bus import cobs
from spi_bus.crc import POLYNOMIAL, RESIDUE, crc16
from spi_bus.frame import HEADER_BYTES, MAX_FRAME_BYTES, Decoder, ErrorKind

BITS = 8 * MAX_FRAME_BYTES
ODDS = 1 / 65_536


def step(register: np.ndarray) -> np.ndarray:
    """The remainders one bit further on: times x, modulo the polynomial."""
    wide = register.astype(np.uint32) << 1
    return np.where(wide & 0x10000, wide ^ POLYNOMIAL, wide).astype(np.uint32)


def syndromes() -> np.ndarray:
    """What one changed bit does to the CRC, for each distance from the frame's end."""
    found = np.empty(BITS, dtype=np.uint32)
    register = np.array([1], dtype=np.uint32)
    for position in range(BITS):
        found[position] = register[0]
        register = step(register)
    return found


def columns(frames: np.ndarray) -> np.ndarray:
    """CRC-16/GENIBUS of every row: a table's worth of division for each column."""
    table = np.arange(256, dtype=np.uint32) << 8
    for _ in range(8):
        table = step(table)
    crc = np.full(len(frames), 0xFFFF, dtype=np.uint16)
    small = table.astype(np.uint16)
    for column in frames.T:
        crc = (crc << 8) ^ small[(crc >> 8) ^ column]
    return crc ^ np.uint16(0xFFFF)


def test_the_columns_are_the_crc():
    rows = np.random.default_rng(1).integers(0, 256, (500, 33), dtype=np.uint8)
    assert columns(rows).tolist() == [crc16(row.tobytes()) for row in rows]


def test_the_syndromes_are_those_of_the_crc():
    intact = bytes(MAX_FRAME_BYTES)
    base = crc16(intact)
    for position, syndrome in list(enumerate(syndromes()))[::37]:
        damaged = (1 << position).to_bytes(MAX_FRAME_BYTES, "big")
        # The CRC of a whole frame differs by the syndrome times x^16, as its end is not the CRC's.
        shifted = np.array([syndrome], dtype=np.uint32)
        for _ in range(16):
            shifted = step(shifted)
        assert crc16(damaged) ^ base == shifted[0]


def test_every_burst_of_up_to_16_bits_at_every_place_is_seen():
    register = np.arange(1, 1 << 16, dtype=np.uint32)  # every pattern within 16 bits
    table = step(np.arange(1 << 16, dtype=np.uint32))
    for _ in range(BITS - 15):
        assert register.all()
        register = table[register]


def test_any_one_two_or_three_wrong_bits_in_the_longest_frame_are_seen():
    single = syndromes()
    assert single.all()
    assert len(np.unique(single)) == BITS, "two bits that cancel"
    known = np.zeros(1 << 16, dtype=bool)
    known[single] = True
    for position, syndrome in enumerate(single):
        others = single[position + 1 :] ^ syndrome
        assert not known[others].any(), "three bits that cancel"


@pytest.mark.parametrize("length", [HEADER_BYTES + 2, 12, 24])
def test_of_random_damage_one_in_65536_passes(length):
    """Frames whose bytes were replaced at random (not by the same) pass with the CRC's odds."""
    rng = np.random.default_rng(length)
    passed = total = 0
    for _ in range(8):
        frames = rng.integers(0, 256, (1 << 19, length), dtype=np.uint8)
        crc = columns(frames[:, :-2])
        frames[:, -2], frames[:, -1] = crc >> 8, crc & 0xFF
        assert (columns(frames[:100]) == RESIDUE).all()
        noise = rng.integers(0, 256, frames.shape, dtype=np.uint8)
        noise *= (
            rng.random(frames.shape, dtype=np.float32) < 0.5
        )  # half of the bytes, longer bursts
        hurt = noise.any(axis=1)
        passed += int((columns(frames[hurt] ^ noise[hurt]) == RESIDUE).sum())
        total += int(hurt.sum())
    expected = total * ODDS
    assert total > 4_000_000
    assert abs(passed - expected) < 4 * math.sqrt(expected), f"{passed} of {total} passed"


def test_noise_that_is_well_stuffed_passes_the_decoder_with_the_same_odds():
    """The decoder itself: everything but the CRC is right. The version is one more sieve."""
    count, rounds = 1 << 19, 8  # in all so many that one bit of the CRC less would be seen
    rng = np.random.default_rng(5)
    decoder = Decoder()
    taken = 0
    for _ in range(rounds):
        bodies = rng.integers(1, 256, (count, 12), dtype=np.uint8)  # no zeros: stuffing is a byte
        bodies[:, 0] = 0x12
        stuffed = np.empty((count, 14), dtype=np.uint8)
        stuffed[:, 0], stuffed[:, 1:13], stuffed[:, 13] = 13, bodies, 0
        taken += len(decoder.receive(stuffed.tobytes()))
    assert decoder.errors[ErrorKind.CRC] + taken == count * rounds
    # Contents with a zero in their CRC cannot be met, the others the more often: the same odds.
    expected = count * rounds * ODDS
    assert abs(taken - expected) < 4 * math.sqrt(expected)
    assert cobs.encode(bodies[0].tobytes()) == stuffed[0, :13].tobytes()


def test_one_wrong_bit_in_a_code_byte_can_pass():
    """Of 20.9 million flips of code bits in random frames 6 passed; this is one of them."""
    wire = bytes.fromhex(
        "03 12 fe 01 01 03 df 4c 01 01 01 01 01 03 12 57 02 e0 02 01 08 75 21 ff eb a0 af 20 00"
    )
    damaged = wire[:3] + bytes((wire[3] ^ 0x10,)) + wire[4:]
    (sent,), (received,) = Decoder().receive(wire), Decoder().receive(damaged)
    changed = int.from_bytes(sent, "big") ^ int.from_bytes(received, "big")
    assert changed.bit_count() > 3
    assert changed.bit_length() - (changed & -changed).bit_length() + 1 > 100, "bits apart"
