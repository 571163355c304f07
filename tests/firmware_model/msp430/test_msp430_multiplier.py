"""Hardware multiplier against Python's integers (SLAU049, table 7-2)."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from firmware_model.msp430.multiplier import Multiplier

words = st.integers(0, 0xFFFF)


def signed(value: int, bits: int) -> int:
    return value - (1 << bits) if value >> (bits - 1) else value


def result(unit: Multiplier) -> int:
    return unit.bank["RESHI"].read() << 16 | unit.bank["RESLO"].read()


def unit() -> Multiplier:
    return Multiplier([None] * 16, 11)


@given(words, words)
def test_mpy(a: int, b: int) -> None:
    m = unit()
    m.bank["MPY"].write(a)
    m.bank["OP2"].write(b)
    assert result(m) == a * b
    assert m.bank["SUMEXT"].read() == 0


@given(words, words)
def test_mpys(a: int, b: int) -> None:
    m = unit()
    m.bank["MPYS"].write(a)
    m.bank["OP2"].write(b)
    product = signed(a, 16) * signed(b, 16)
    assert signed(result(m), 32) == product
    assert m.bank["SUMEXT"].read() == (0xFFFF if product < 0 else 0)


@given(st.lists(st.tuples(words, words), min_size=1, max_size=8), st.integers(0, 2**32 - 1))
@example([(0xFFFF, 0xFFFF), (1, 1)], 0xFFFF_FFFF)
def test_mac(pairs: list[tuple[int, int]], start: int) -> None:
    m = unit()
    m.bank["RESLO"].write(start & 0xFFFF)
    m.bank["RESHI"].write(start >> 16)
    total = start
    for a, b in pairs:
        m.bank["MAC"].write(a)
        m.bank["OP2"].write(b)
        total = (total & 0xFFFF_FFFF) + a * b
        assert result(m) == total & 0xFFFF_FFFF
        assert m.bank["SUMEXT"].read() == total >> 32  # the carry


@given(st.lists(st.tuples(words, words), min_size=1, max_size=8))
def test_macs(pairs: list[tuple[int, int]]) -> None:
    m = unit()
    total = 0
    m.bank["MACS"].write(0)
    for a, b in pairs:
        m.bank["MACS"].write(a)
        m.bank["OP2"].write(b)
        total = signed((total + signed(a, 16) * signed(b, 16)) & 0xFFFF_FFFF, 32)
        assert signed(result(m), 32) == total
        assert m.bank["SUMEXT"].read() == (0xFFFF if total < 0 else 0)


@given(words, words, words)
def test_op1_stays_for_the_next_op2_and_reads_back_everywhere(a: int, b: int, c: int) -> None:
    m = unit()
    m.bank["MPY"].write(a)
    m.bank["OP2"].write(b)
    m.bank["OP2"].write(c)
    assert result(m) == a * c
    assert [m.bank[name].read() for name in ("MPY", "MPYS", "MAC", "MACS")] == [a] * 4


def test_ready_triggers_dma(bench: Any) -> None:
    bench.write(DMACTL0=11, DMA0SA=0x013A, DMA0DA=0x1200, DMA0SZ=2, DMA0CTL=0x0C10)
    for b in (3, 5):
        bench.write(MPY=7, OP2=b)
    assert [bench.mcu.reg.read16(a) for a in (0x1200, 0x1202)] == [21, 35]


def test_sumext_is_read_only() -> None:
    m = unit()
    m.bank["SUMEXT"].write(5)
    assert m.bank["SUMEXT"].read() == 0


@pytest.mark.parametrize("word", [0x8000, 0x7FFF])
def test_extremes(word: int) -> None:
    m = unit()
    m.bank["MPYS"].write(word)
    m.bank["OP2"].write(0x8000)
    assert signed(result(m), 32) == signed(word, 16) * -0x8000
