"""Which request is next: dsPIC priorities and natural order, MSP430 vectors, GIE and NMI."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.errors import WiringError
from firmware_model.interrupts import DspicInterrupts, DspicSource, Msp430Interrupts

SOURCES = (
    DspicSource("INT0", 0),
    DspicSource("T1", 3),
    DspicSource("SPI1", 8),
    DspicSource("U2RX", 24),
    DspicSource("INT4", 39),
)


def dspic() -> DspicInterrupts:
    return DspicInterrupts(SOURCES)


@pytest.mark.parametrize("source", SOURCES)
def test_flag_enable_and_priority_stand_where_the_data_sheet_says(source: DspicSource) -> None:
    controller = dspic()
    line = controller.line(source.name)
    bank, bit = divmod(source.number, 16)
    line.request()
    assert controller.bank[f"IFS{bank}"].value == 1 << bit
    assert controller.next(0) is None  # not enabled
    controller.bank[f"IEC{bank}"].set_bits(1 << bit)
    assert controller.next(0) is line
    field = 4 * (source.number % 4)
    controller.bank[f"IPC{source.number // 4}"].clear_bits(7 << field)
    assert controller.next(0) is None  # priority 0 disables
    controller.bank[f"IPC{source.number // 4}"].set_bits(6 << field)
    assert controller.next(5) is line
    assert controller.next(6) is None


@given(
    st.permutations(SOURCES),
    st.lists(st.integers(0, 7), min_size=5, max_size=5),
    st.integers(0, 7),
)
def test_highest_priority_then_lowest_vector(
    order: list[DspicSource], priorities: list[int], level: int
) -> None:
    controller = dspic()
    for bank in range(3):
        controller.bank[f"IEC{bank}"].write(0xFFFF)
    for source, priority in zip(SOURCES, priorities, strict=True):
        register = controller.bank[f"IPC{source.number // 4}"]
        field = 4 * (source.number % 4)
        register.write(register.value & ~(7 << field) | priority << field)
    for source in order:
        controller.line(source.name).request()
    able = [
        (-priority, source.number, source.name)
        for source, priority in zip(SOURCES, priorities, strict=True)
        if priority > level
    ]
    taken = controller.next(level)
    assert (taken.name if taken else None) == (min(able)[2] if able else None)


def test_firmware_sets_and_clears_flags_by_ifs() -> None:
    controller, calls = dspic(), []
    controller.notify = lambda: calls.append(1)
    controller.bank["IEC0"].write(1 << 8)
    controller.bank["IFS0"].set_bits(1 << 8)  # a request by software
    assert controller.line("SPI1").pending
    assert calls == [1]
    controller.bank["IFS0"].clear_bits(1 << 8)
    assert not controller.line("SPI1").pending
    assert controller.next(0) is None


def test_enabling_a_pending_request_notifies() -> None:
    controller, calls = dspic(), []
    controller.line("T1").request()
    controller.notify = lambda: calls.append(1)
    controller.bank["IEC0"].write(1 << 3)
    assert calls == [1]


def test_dspic_reset_forgets_everything() -> None:
    controller = dspic()
    controller.bank["IEC0"].write(0xFFFF)
    controller.bank["IPC0"].write(0x7777)
    controller.line("T1").request()
    controller.reset()
    assert controller.next(0) is None
    assert controller.bank["IFS0"].value == 0
    assert controller.bank["IPC0"].value == 0x4444
    controller.bank["IEC0"].write(1 << 3)
    assert controller.next(0) is None
    controller.line("T1").request()
    assert controller.next(3) is controller.line("T1")


def test_dspic_wiring_mistakes() -> None:
    with pytest.raises(WiringError, match="share a vector"):
        DspicInterrupts([DspicSource("A", 1), DspicSource("B", 1)])
    with pytest.raises(WiringError, match="no interrupt source X"):
        dspic().line("X")
    assert dspic().names() == ("INT0", "T1", "SPI1", "U2RX", "INT4")


def msp430() -> Msp430Interrupts:
    controller = Msp430Interrupts()
    for name, number in (("PORT2", 1), ("USART1RX", 3), ("TIMERB0", 13), ("NMI", 14)):
        controller.line(name, number)
    return controller


def test_msp430_takes_the_highest_vector_with_gie_outside_handlers() -> None:
    controller = msp430()
    for name in ("PORT2", "TIMERB0", "USART1RX"):
        controller._lines[name].request()
    assert controller.next(0) is None
    controller.gie = True
    for name in ("TIMERB0", "USART1RX", "PORT2"):
        line = controller.next(0)
        assert line is not None
        assert line.name == name
        assert controller.next(1) is None  # no nesting
        line.clear()
    assert controller.next(0) is None


def test_nmi_needs_no_gie_and_interrupts_handlers() -> None:
    controller = msp430()
    controller._lines["PORT2"].request()
    controller._lines["NMI"].request()
    nmi = controller.next(0)
    assert nmi is not None
    assert nmi.name == "NMI"
    assert controller.next(1) is nmi
    assert controller.next(2) is None  # not itself


def test_msp430_notifies_when_gie_is_set_over_a_pending_request() -> None:
    controller, calls = msp430(), []
    controller.notify = lambda: calls.append(1)
    controller._lines["PORT2"].request()
    assert calls == []
    controller.gie = True
    assert calls == [1]
    controller._lines["NMI"].request()
    assert calls == [1, 1]


def test_accept_lets_a_single_source_clear_its_flag() -> None:
    controller = Msp430Interrupts()
    line = controller.line("WDT", 10)
    line.on_accept = line.clear
    controller.gie = True
    line.request()
    controller.accept(line)
    assert not line.pending
    assert controller.next(0) is None


def test_msp430_reset_clears_gie_and_requests() -> None:
    controller = msp430()
    controller.gie = True
    controller._lines["PORT2"].request()
    controller.reset()
    assert not controller.gie
    controller.gie = True
    assert controller.next(0) is None


def test_msp430_wiring_mistakes() -> None:
    controller = msp430()
    with pytest.raises(WiringError, match="taken"):
        controller.line("PORT2", 5)
    with pytest.raises(WiringError, match="taken"):
        controller.line("OTHER", 13)
    assert controller.names() == ("NMI", "TIMERB0", "USART1RX", "PORT2")
