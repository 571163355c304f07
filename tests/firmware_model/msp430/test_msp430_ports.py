"""Ports: directions, peripheral functions, and edge interrupts of P1 and P2."""

from __future__ import annotations

from typing import Any

import pytest

from firmware_model.signals import Signal


def test_an_output_drives_its_pin_and_an_input_rests(bench: Any) -> None:
    pin = bench.mcu.ports[4].pins[2]
    pin.pull(True)  # a chip select with its resistor
    heard: list[bool] = []
    pin.output.watch(heard.append)
    bench.write(P4OUT=0x04)
    bench.write(P4DIR=0x04)
    assert heard == []
    bench.write(P4OUT=0x00)
    bench.write(P4OUT=0x04)
    bench.write(P4OUT=0x00)
    bench.write(P4DIR=0x00)
    assert heard == [False, True, False, True]


def test_pxin_shows_inputs_and_driven_outputs(bench: Any) -> None:
    bench.mcu.ports[3].pins[0].input.set(True)
    bench.mcu.ports[3].pins[7].input.set(True)
    bench.write(P3DIR=0x81, P3OUT=0x01)
    assert bench.read("P3IN") == 0x01
    bench.write(P3DIR=0x00)
    assert bench.read("P3IN") == 0x81
    bench.write(P3IN=0xFF)
    assert bench.read("P3IN") == 0x81


def test_a_pin_follows_a_signal_of_the_board(bench: Any) -> None:
    fifop = Signal("fifop", True)
    bench.mcu.ports[1].pins[0].follow(fifop)
    assert bench.read("P1IN") == 0x01
    fifop.set(False)
    assert bench.read("P1IN") == 0x00


@pytest.mark.parametrize("port", [1, 2])
@pytest.mark.parametrize(("falling", "levels", "count"), [(0, (1, 0, 1), 2), (1, (1, 0, 1), 1)])
def test_edge_interrupts(
    bench: Any, port: int, falling: int, levels: tuple[int, ...], count: int
) -> None:
    seen: list[int] = []

    def take() -> None:
        seen.append(bench.mcu.reg[f"P{port}IFG"].read())
        bench.mcu.reg[f"P{port}IFG"].write(0)

    bench.handle(f"PORT{port}", take)
    bench.mcu.interrupts.gie = True
    bench.write(**{f"P{port}IES": 0x08 * falling})
    bench.write(**{f"P{port}IFG": 0})
    bench.write(**{f"P{port}IE": 0x08})
    pin = bench.mcu.ports[port].pins[3].input
    for level in levels:
        pin.set(bool(level))
        bench.run_us(1_000)
    assert seen == [0x08] * count


def test_a_disabled_pin_only_sets_its_flag(bench: Any) -> None:
    bench.mcu.interrupts.gie = True
    bench.mcu.ports[2].pins[5].input.set(True)
    bench.run_us(100)
    assert bench.read("P2IFG") == 0x20
    assert bench.mcu.cpu.interrupts_taken == 0


def test_firmware_can_set_flags_itself(bench: Any) -> None:
    calls: list[int] = []
    bench.handle("PORT2", lambda: (calls.append(1), bench.mcu.reg["P2IFG"].write(0)))
    bench.mcu.interrupts.gie = True
    bench.write(P2IE=0x01, P2IFG=0x01)
    bench.run_us(100)
    assert calls == [1]


def test_changing_the_edge_may_set_the_flag(bench: Any) -> None:
    bench.write(P1IES=0x01)  # PxIN = 0, now waits for a fall
    assert bench.read("P1IFG") == 0x01
    bench.write(P1IFG=0)
    bench.mcu.ports[1].pins[0].input.set(True)
    bench.write(P1IES=0x00)  # PxIN = 1, now waits for a rise
    assert bench.read("P1IFG") == 0x01


def test_an_output_can_interrupt_too(bench: Any) -> None:
    bench.write(P1DIR=0x02, P1OUT=0x02)
    assert bench.read("P1IFG") == 0x02


def test_a_puc_keeps_outputs_and_edges(bench: Any) -> None:
    bench.write(P2OUT=0x0F, P2DIR=0xFF, P2SEL=0x01, P2IES=0x30, P2IE=0x30)
    bench.mcu.request_reset("test")
    bench.run_us(100)
    assert [bench.read(f"P2{n}") for n in ("OUT", "DIR", "SEL", "IES", "IE")] == [
        0x0F, 0, 0, 0x30, 0
    ]  # fmt: skip
    assert not any(pin.output.value for pin in bench.mcu.ports[2].pins)
