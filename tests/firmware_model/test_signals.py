"""Signals tell of changes only, in the order in which listeners came."""

from __future__ import annotations

from firmware_model.signals import Signal, constant
from firmware_model.wires import I2cBus


def test_listeners_hear_changes_only() -> None:
    signal = Signal("pin", False)
    heard: list[bool] = []
    signal.watch(heard.append)
    for level in (False, True, True, False):
        signal.set(level)
    assert heard == [True, False]
    assert signal.value is False


def test_listeners_are_called_in_order_with_the_value_in_place() -> None:
    signal = Signal("rail", 3.0)
    heard: list[tuple[str, float, float]] = []
    signal.watch(lambda v: heard.append(("a", v, signal.value)))
    signal.watch(lambda v: heard.append(("b", v, signal.value)))
    signal.set(1.5)
    assert heard == [("a", 1.5, 1.5), ("b", 1.5, 1.5)]


def test_a_listener_added_during_a_change_hears_the_next_one() -> None:
    signal = Signal("pin", 0)
    heard: list[int] = []
    signal.watch(lambda _v: signal.watch(heard.append) if not heard else None)
    signal.set(1)
    assert heard == []
    signal.set(2)
    assert heard == [2]


def test_a_constant_quantity() -> None:
    assert constant(1.25)(10**18) == 1.25


class Target:
    def __init__(self, address: int) -> None:
        self.address = address
        self.log: list[int | str] = []

    def address_match(self, address: int, read: bool) -> bool:
        return address == self.address

    def write(self, byte: int) -> bool:
        self.log.append(byte)
        return byte < 0x80

    def read(self) -> int:
        return 0x5A

    def stop(self) -> None:
        self.log.append("stop")


def test_an_i2c_bus_finds_the_target_or_reads_ones() -> None:
    one, two = Target(0x18), Target(0x1E)
    bus = I2cBus((one, two))
    assert bus.start(0x1E, read=False)
    assert bus.write(0x02)
    assert not bus.write(0x80)
    assert bus.start(0x1E, read=True)  # repeated start
    assert bus.read() == 0x5A
    bus.stop()
    assert two.log == [0x02, 0x80, "stop"]
    assert one.log == []
    assert not bus.start(0x50, read=False)
    assert bus.read() == 0xFF
    assert not bus.write(1)
    bus.stop()
    assert one.log == []
