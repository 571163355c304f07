"""Timer_A and Timer_B against the user's guide's formulas."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_model.time import FS_PER_S

ACLK = 32_768
TICK_FS = FS_PER_S // ACLK


def run_ticks(bench: Any, ticks: float) -> None:
    """Run to the middle of an ACLK period, some ticks from now."""
    now = bench.scheduler.now
    whole = now // TICK_FS + round(ticks)
    bench.scheduler.run(whole * TICK_FS + TICK_FS // 2)


def times(bench: Any, line: str, clear: Any = None) -> list[float]:
    """Note the ACLK tick of each interrupt."""
    seen: list[float] = []

    def note() -> None:
        seen.append(bench.scheduler.now * ACLK / FS_PER_S)
        if clear:
            clear()

    bench.handle(line, note)
    bench.mcu.interrupts.gie = True
    bench.mcu.cpu.sleep_state = "lpm3"
    return seen


def align(bench: Any) -> None:
    bench.scheduler.run((bench.scheduler.now // TICK_FS + 1) * TICK_FS)


@pytest.mark.parametrize("name", ["A", "B"])
@pytest.mark.parametrize("top", [1, 9, 327, 1_000])
def test_up_mode_repeats_every_ccr0_plus_one(bench: Any, name: str, top: int) -> None:
    seen = times(bench, f"TIMER{name}0")
    align(bench)
    bench.write(**{f"T{name}CCR0": top, f"T{name}CCTL0": 0x10, f"T{name}CTL": 0x0114})
    run_ticks(bench, 6 * (top + 1))
    gaps = [b - a for a, b in itertools.pairwise(seen)]
    assert len(seen) >= 5
    assert gaps == pytest.approx([top + 1] * len(gaps), abs=0.05)


@given(
    st.integers(1, 400), st.integers(0, 3), st.lists(st.integers(1, 500), min_size=1, max_size=5)
)
@settings(deadline=None, max_examples=50)
def test_the_counter_in_up_mode(make_bench: Any, top: int, divider: int, waits: list[int]) -> None:
    bench = make_bench().start()
    align(bench)
    start = bench.scheduler.now // TICK_FS
    bench.write(TACCR0=top, TACTL=0x0114 | divider << 6)
    for wait in waits:
        run_ticks(bench, wait)
        ticks = (bench.scheduler.now // TICK_FS - start) >> divider
        assert bench.read("TAR") == ticks % (top + 1)
        assert bool(bench.read("TACTL") & 1) == (ticks > top)
        assert bool(bench.read("TACCTL0") & 1) == (ticks >= top)


@given(st.integers(1, 200), st.lists(st.integers(1, 500), min_size=1, max_size=5))
@settings(deadline=None, max_examples=30)
def test_the_counter_in_up_down_mode(make_bench: Any, top: int, waits: list[int]) -> None:
    bench = make_bench().start()
    align(bench)
    start = bench.scheduler.now // TICK_FS
    bench.write(TBCCR0=top, TBCTL=0x0134)
    for wait in waits:
        run_ticks(bench, wait)
        ticks = bench.scheduler.now // TICK_FS - start
        phase = ticks % (2 * top)
        assert bench.read("TBR") == (phase if phase <= top else 2 * top - phase)
        assert bool(bench.read("TBCTL") & 1) == (ticks >= 2 * top)


def test_up_down_compares_twice_a_period(bench: Any) -> None:
    seen = times(bench, "TIMERA1", lambda: bench.mcu.reg["TAIV"].read())
    align(bench)
    start = bench.scheduler.now * ACLK / FS_PER_S
    bench.write(TACCR0=100, TACCR1=30, TACCTL1=0x10, TACTL=0x0134)
    run_ticks(bench, 450)
    phases = [tick - start for tick in seen]
    assert phases == pytest.approx([30, 170, 230, 370, 430], abs=1.2)


def test_continuous_mode_with_a_compare_that_firmware_moves_on(bench: Any) -> None:
    def move() -> None:
        bench.mcu.reg["TBCCR0"].write(bench.mcu.reg["TBCCR0"].read() + 328 & 0xFFFF)

    seen = times(bench, "TIMERB0", move)
    align(bench)
    bench.write(TBCCR0=328, TBCCTL0=0x10, TBCTL=0x0124)
    run_ticks(bench, 100_000)
    gaps = [b - a for a, b in itertools.pairwise(seen)]
    assert len(seen) == 100_000 // 328
    assert gaps == pytest.approx([328] * len(gaps), abs=0.05)


@pytest.mark.parametrize(("cntl", "length"), [(0, 65_536), (1, 4_096), (2, 1_024), (3, 256)])
def test_timer_b_lengths_and_overflow_vector(bench: Any, cntl: int, length: int) -> None:
    vectors: list[int] = []
    seen = times(bench, "TIMERB1", lambda: vectors.append(bench.mcu.reg["TBIV"].read()))
    align(bench)
    bench.write(TBCTL=0x0126 | cntl << 11)
    run_ticks(bench, 3 * length + 5)
    assert vectors == [14, 14, 14]
    assert seen[1] - seen[0] == pytest.approx(length, abs=0.05)


def test_no_event_stands_for_what_nobody_waits_for(bench: Any) -> None:
    bench.run_us(1_000)
    assert bench.scheduler.next_time() is None
    bench.write(TACCR0=10, TACTL=0x0114, TACCR1=5, TBCTL=0x0124, TBCCR3=77)
    assert bench.scheduler.next_time() is None
    run_ticks(bench, 200)
    assert bench.read("TACCTL0") & bench.read("TACCTL1") & bench.read("TBCCTL3") & 1


def test_taiv_gives_the_highest_and_clears_it(bench: Any) -> None:
    bench.write(TACCR0=10, TACCR1=5, TACCR2=6, TACCTL1=0x10, TACCTL2=0x10, TACTL=0x0116)
    run_ticks(bench, 30)
    assert [bench.read("TAIV") for _ in range(4)] == [2, 4, 10, 0]
    assert not bench.read("TACCTL1") & 1


def test_ccr0_flag_is_cleared_by_its_interrupt(bench: Any) -> None:
    seen = times(bench, "TIMERA0")
    bench.write(TACCR0=100, TACCTL0=0x10, TACTL=0x0114)
    run_ticks(bench, 110)
    assert len(seen) == 1
    assert not bench.read("TACCTL0") & 1


def test_lowering_ccr0_below_the_counter_rolls_to_zero(bench: Any) -> None:
    align(bench)
    bench.write(TACCR0=1_000, TACTL=0x0114)
    run_ticks(bench, 500)
    bench.write(TACCR0=100)
    assert bench.read("TAR") == 0


def test_stop_holds_the_counter_and_clear_zeroes_it(bench: Any) -> None:
    align(bench)
    bench.write(TACTL=0x0124)
    run_ticks(bench, 50)
    bench.write(TACTL=0x0100)
    assert bench.read("TAR") == 50
    run_ticks(bench, 50)
    assert bench.read("TAR") == 50
    bench.write(TACTL=0x0120)
    run_ticks(bench, 7)
    assert bench.read("TAR") == 57
    bench.write(TACTL=0x0124)
    assert bench.read("TAR") == 0


def test_writing_the_counter(bench: Any) -> None:
    align(bench)
    bench.write(TBCTL=0x0124, TBR=65_000)
    run_ticks(bench, 600)
    assert bench.read("TBR") == 65_600 - 65_536
    assert bench.read("TBCTL") & 1


@pytest.mark.parametrize("duty", [1, 25, 99])
def test_reset_set_output_has_the_duty_of_the_examples(bench: Any, duty: int) -> None:
    """TACCR0 = 99, OUTMOD 7: high for TACCR1 of 100 ticks, on the pin that PxSEL gives it."""
    edges: list[tuple[int, bool]] = []
    pin = bench.mcu.pin_signal(1, 2)
    pin.watch(lambda level: edges.append((bench.scheduler.now, level)))
    bench.write(P1DIR=0x04, P1SEL=0x04)
    align(bench)
    bench.write(TACCR0=99, TACCR1=duty, TACCTL1=0x00E0, TACTL=0x0114)
    run_ticks(bench, 1_050)
    rises = [t for t, level in edges if level]
    falls = [t for t, level in edges if not level]
    assert len(rises) == 10
    assert [b - a for a, b in itertools.pairwise(rises)] == pytest.approx(
        [100 * TICK_FS] * 9, abs=2 * ACLK
    )
    high = [next(f for f in falls if f > r) - r for r in rises[:9]]
    assert high == pytest.approx([duty * TICK_FS] * 9, abs=2 * ACLK)


@pytest.mark.parametrize(
    ("mode", "levels"),
    [
        (1, {"compare": True}),
        (2, {"compare": "toggle", "zero": False}),
        (3, {"compare": True, "zero": False}),
        (4, {"compare": "toggle"}),
        (5, {"compare": False}),
        (6, {"compare": "toggle", "zero": True}),
        (7, {"compare": False, "zero": True}),
    ],
)
def test_output_modes(bench: Any, mode: int, levels: dict[str, bool | str]) -> None:
    align(bench)
    start = bench.scheduler.now // TICK_FS
    bench.write(TBCCR0=9, TBCCR1=4, TBCCTL1=0x0004)  # mode 0: OUT drives
    output = bench.mcu.timer_b.outputs[1]
    assert output.value
    bench.write(TBCCTL1=mode << 5 | 0x0004, TBCTL=0x0114)
    expected = True
    for _ in range(35):
        run_ticks(bench, 1)
        phase = (bench.scheduler.now // TICK_FS - start) % 10
        for moment, at in (("compare", 4), ("zero", 0)):
            if phase == at and moment in levels:
                action = levels[moment]
                expected = not expected if action == "toggle" else bool(action)
        assert output.value is expected


def test_smclk_captured_by_aclk_measures_the_dco(bench: Any) -> None:
    """TACCR2, CCI2B = ACLK: the difference of two captures is f(SMCLK) / f(ACLK)."""
    captures: list[int] = []

    def take() -> None:
        if bench.mcu.reg["TAIV"].read() == 4:
            captures.append(bench.mcu.reg["TACCR2"].read())

    bench.handle("TIMERA1", take)
    bench.mcu.interrupts.gie = True
    bench.mcu.cpu.sleep_state = "lpm0"
    bench.write(BCSCTL1=0x87, DCOCTL=0xA0)  # about 4 MHz: the handler must keep up
    bench.write(TACTL=0x0224, TACCTL2=0x5910)  # rising, CCIxB, capture, interrupt
    bench.run_us(10_000)
    assert len(captures) == pytest.approx(327, abs=1)
    total = sum((b - a) & 0xFFFF for a, b in itertools.pairwise(captures))
    measured = total / (len(captures) - 1) * ACLK
    assert measured == pytest.approx(bench.mcu.clocks.smclk.frequency_hz, rel=1e-4)
    assert not bench.read("TACCTL2") & 0x0002  # no overflow


def test_polled_capture_of_a_clock_is_lazy_and_overflows(bench: Any) -> None:
    bench.write(TACTL=0x0224, TACCTL2=0x5900)
    assert bench.scheduler.next_time() is None
    run_ticks(bench, 1)
    bench.write(TACCTL2=0x5900)
    run_ticks(bench, 1)
    assert bench.read("TACCTL2") & 0x0003 == 0x0001
    run_ticks(bench, 1)
    assert bench.read("TACCTL2") & 0x0003 == 0x0003


@pytest.mark.parametrize(("cm", "expected"), [(1, [10, 30]), (2, [20]), (3, [10, 20, 30])])
def test_capture_of_a_pin_by_edges(bench: Any, cm: int, expected: list[int]) -> None:
    captures: list[int] = []

    def take() -> None:
        if bench.mcu.reg["TBIV"].read() == 2:
            captures.append(bench.mcu.reg["TBCCR1"].read())

    bench.handle("TIMERB1", take)
    bench.mcu.interrupts.gie = True
    align(bench)
    bench.write(TBCTL=0x0124, TBCCTL1=cm << 14 | 0x0110)
    pin = bench.mcu.ports[4].pins[1].input
    start = bench.scheduler.now
    for n in (10, 20, 30):
        bench.scheduler.at(
            start + n * TICK_FS + TICK_FS // 2, lambda n=n: pin.set(not pin.value), 0
        )
    run_ticks(bench, 50)
    assert captures == expected
    assert bool(bench.read("TBCCTL1") & 0x0008) is pin.value


def test_capture_by_software(bench: Any) -> None:
    align(bench)
    bench.write(TACTL=0x0124, TACCTL0=0xE100)  # both edges, GND, capture
    run_ticks(bench, 12)
    bench.write(TACCTL0=0xF100)  # VCC: a rising edge
    assert bench.read("TACCR0") == 12
    assert bench.read("TACCTL0") & 1
    run_ticks(bench, 3)
    bench.write(TACCTL0=0xE101)  # back to GND with the flag still set
    assert bench.read("TACCR0") == 15
    assert bench.read("TACCTL0") & 0x0002


def test_a_timer_follows_a_retuned_clock(bench: Any) -> None:
    seen: list[int] = []
    bench.handle("TIMERA0", lambda: seen.append(bench.scheduler.now))
    bench.mcu.interrupts.gie = True
    bench.mcu.cpu.sleep_state = "lpm0"
    bench.write(TACCR0=50_000, TACCTL0=0x10, TACTL=0x0214)
    start = bench.scheduler.now
    slow = bench.mcu.clocks.dco_hz
    bench.run_us(20_000)
    bench.write(BCSCTL1=0x87, DCOCTL=0xA0)
    fast = bench.mcu.clocks.dco_hz
    bench.run_us(30_000)
    expected = 20_000 + (50_000 - slow * 0.020) / fast * 1e6
    assert len(seen) >= 1
    assert (seen[0] - start) / 1e9 == pytest.approx(expected, abs=10)


def test_a_puc_leaves_the_timer_counting_and_a_por_stops_it(bench: Any) -> None:
    align(bench)
    bench.write(TBCTL=0x0124)
    bench.mcu.request_reset("test")
    run_ticks(bench, 100)
    assert bench.boots == 2
    assert bench.read("TBR") == 100
    bench.mcu.press_reset()
    run_ticks(bench, 100)
    assert bench.read("TBR") == 0
    assert bench.read("TBCTL") == 0
