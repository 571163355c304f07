"""Watchdog: armed after reset, password, intervals, and resets that come as events."""

from __future__ import annotations

from typing import Any

import pytest

from firmware_model.cpu import Coroutine
from firmware_model.time import FS_PER_S

PASSWORD = 0x5A00


def test_it_bites_a_firmware_that_forgets_it(make_bench: Any) -> None:
    bench = make_bench()
    bench.hold_watchdog = False
    bench.start(lambda mcu: setattr(mcu.cpu, "sleep_state", "lpm0"))
    bench.run_us(200_000)
    # SMCLK / 32768 at the reset frequency of 750 kHz: 43.7 ms a life.
    assert bench.boots == 1 + int(0.2 // (32_768 / bench.mcu.clocks.dco_hz))
    assert bench.mcu.last_reset == "watchdog"
    assert bench.read("IFG1") & 0x01


def test_a_wrong_password_is_a_reset(bench: Any) -> None:
    order: list[str] = []

    def body() -> Coroutine:
        bench.mcu.reg["WDTCTL"].write(0x0080)
        order.append("still running")
        yield 1
        order.append("never")

    bench.task(body())
    bench.run_us(1_000)
    assert order == ["still running"]
    assert bench.boots == 2
    assert bench.mcu.last_reset == "watchdog password"
    assert bench.read("IFG1") & 0x01  # WDTIFG outlives the PUC


def test_the_register_reads_69(bench: Any) -> None:
    bench.write(WDTCTL=PASSWORD | 0x80 | 0x08 | 0x04)
    assert bench.read("WDTCTL") == 0x6984  # WDTCNTCL reads 0


@pytest.mark.parametrize(("select", "ticks"), [(0, 32_768), (1, 8_192), (2, 512), (3, 64)])
def test_interval_mode(bench: Any, select: int, ticks: int) -> None:
    seen: list[int] = []
    bench.handle("WDT", lambda: seen.append(bench.scheduler.now))
    bench.mcu.interrupts.gie = True
    bench.write(IE1=0x01, WDTCTL=PASSWORD | 0x10 | 0x08 | 0x04 | select)
    bench.run_us(3.5 * ticks / 32_768 * 1e6)
    assert len(seen) == 3
    assert seen[2] - seen[1] == pytest.approx(ticks * FS_PER_S / 32_768, rel=1e-3)
    assert bench.boots == 1
    assert not bench.read("IFG1") & 1


def test_clearing_it_in_time_keeps_it_quiet(bench: Any) -> None:
    bench.write(WDTCTL=PASSWORD | 0x08 | 0x04 | 2)  # ACLK / 512: 15.6 ms

    for _ in range(20):
        bench.run_us(10_000)
        bench.write(WDTCTL=PASSWORD | 0x08 | 0x04 | 2)
    assert bench.boots == 1
    bench.run_us(15_500)
    assert bench.boots == 1
    bench.run_us(300)
    assert bench.boots == 2


def test_hold_stops_and_keeps_the_count(bench: Any) -> None:
    bench.write(WDTCTL=PASSWORD | 0x08 | 0x04 | 2)
    bench.run_us(10_000)
    bench.write(WDTCTL=PASSWORD | 0x80 | 0x04 | 2)
    bench.run_us(100_000)
    assert bench.boots == 1
    bench.write(WDTCTL=PASSWORD | 0x04 | 2)
    bench.run_us(5_000)
    assert bench.boots == 1
    bench.run_us(1_000)
    assert bench.boots == 2


def test_lpm3_stops_a_watchdog_on_smclk(make_bench: Any) -> None:
    bench = make_bench()
    bench.hold_watchdog = False
    bench.start(lambda mcu: setattr(mcu.cpu, "sleep_state", "lpm3"))
    bench.run_us(1_000_000)
    assert bench.boots == 1
