"""Registers as data: masks, side effects, and byte access to words."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.errors import RegisterError, WiringError
from firmware_model.registers import AddressSpace, Register, RegisterBank, RegisterSpec

words = st.integers(0, 0xFFFF)


@given(words, words, words)
def test_a_write_changes_writable_bits_only(reset: int, writable: int, value: int) -> None:
    register = Register(RegisterSpec("R", 0, 16, reset, writable))
    register.write(value)
    assert register.read() & writable == value & writable
    assert register.read() & ~writable == reset & ~writable


@given(st.integers(0, 1 << 20))
def test_a_byte_register_stays_a_byte(value: int) -> None:
    register = Register(RegisterSpec("R", 0, 8))
    register.write(value)
    assert register.read() == value & 0xFF


def test_set_and_clear_bits_are_read_modify_write() -> None:
    register = Register(RegisterSpec("R", 0, 16, reset=0x00F0))
    register.set_bits(0x0101)
    assert register.value == 0x01F1
    register.clear_bits(0x00F1)
    assert register.value == 0x0100


def test_a_write_side_effect_gets_the_merged_value_and_decides() -> None:
    seen: list[int] = []
    bank = RegisterBank(
        (RegisterSpec("R", 0x10, 16, reset=0x8000, writable=0x00FF),), on_write={"R": seen.append}
    )
    bank["R"].write(0x1234)
    assert seen == [0x8034]
    assert bank["R"].value == 0x8000  # the side effect did not store it


def test_a_read_side_effect_replaces_the_value() -> None:
    bank = RegisterBank((RegisterSpec("R", 0),), on_read={"R": lambda: 0xBEEF})
    assert bank["R"].read() == 0xBEEF
    assert bank["R"].value == 0


def test_reset_has_no_side_effects() -> None:
    seen: list[int] = []
    bank = RegisterBank((RegisterSpec("R", 0, reset=7),), on_write={"R": seen.append})
    bank["R"].value = 1
    bank.reset()
    assert bank["R"].value == 7
    assert seen == []


def test_unknown_names_and_addresses_are_errors() -> None:
    bank = RegisterBank((RegisterSpec("R", 0x10),))
    with pytest.raises(RegisterError, match="no register Q"):
        bank["Q"]
    space = AddressSpace([bank])
    with pytest.raises(LookupError, match="no register Q"):
        space["Q"]
    with pytest.raises(RegisterError, match="0x0020"):
        space.read16(0x20)
    assert "R" in space
    assert "Q" not in space


def test_wiring_mistakes_are_told() -> None:
    with pytest.raises(WiringError, match="do not exist"):
        RegisterBank((RegisterSpec("R", 0),), on_read={"S": int})
    one, two = RegisterBank((RegisterSpec("A", 0),)), RegisterBank((RegisterSpec("B", 0),))
    with pytest.raises(WiringError, match="share an address"):
        AddressSpace([one, two])
    again = RegisterBank((RegisterSpec("A", 2),))
    with pytest.raises(WiringError, match="two registers are called A"):
        AddressSpace([one, again])
    with pytest.raises(WiringError, match="8 or 16"):
        Register(RegisterSpec("R", 0, 12))


@given(words, st.integers(0, 255))
def test_byte_access_to_a_word_register(word: int, byte: int) -> None:
    space = AddressSpace([RegisterBank((RegisterSpec("W", 0x100),))])
    space.write16(0x100, word)
    assert space.read8(0x100) == word & 0xFF
    assert space.read8(0x101) == word >> 8
    space.write8(0x101, byte)
    assert space.read16(0x100) == byte << 8 | word & 0xFF
    space.write8(0x100, word >> 8)
    assert space.read16(0x101) == byte << 8 | word >> 8  # bit 0 of a word address is ignored


@given(words)
def test_word_access_to_byte_registers(word: int) -> None:
    specs = (RegisterSpec("L", 0x20, 8), RegisterSpec("H", 0x21, 8))
    space = AddressSpace([RegisterBank(specs)])
    space.write16(0x20, word)
    assert (space["L"].value, space["H"].value) == (word & 0xFF, word >> 8)
    assert space.read16(0x20) == word
