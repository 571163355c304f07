"""Targets that are more than decoders: machines with a clock and another side, told anything.

Made anew for each input, because a machine that remembers would make findings depend on the order.
"""

from __future__ import annotations

from typing import Final

from firmware_model.scheduler import Scheduler
from firmware_model.signals import constant
from firmware_model.time import FS_PER_S
from radio_802154 import tinyos, tinyos_serial, xbee
from radio_802154.medium import Antenna, Medium, MediumConfig
from radio_802154.mote_bridge import BridgeConfig, MoteBridge
from radio_802154.xbee_module import XBeeModule
from tools.fuzz.forms import Run

_BRIDGE: Final = BridgeConfig(frozenset((1,)))
_SECONDS: Final = 3
"""Simulated, of an XBee module: a boot, a time-out, an answer."""


def fuzz_bridge(data: bytes) -> None:
    """A mote's bridge: octets of its line and as frames of the air; its queues have bounds."""
    bridge = MoteBridge(_BRIDGE)
    now_us = 0
    half = len(data) // 2
    frame = tinyos.encode(tinyos.AmPacket(0, 1, 0x20, data[:28]))
    assert bridge.heard(frame, now_us)
    said = bridge.data_to_send(now_us)
    assert tinyos_serial.Decoder().receive(said)
    for octets in (data[:half], data[half:]):
        bridge.heard(octets[:116], now_us)
        for packet in bridge.receive(octets, now_us):
            assert packet.source not in _BRIDGE.addresses
            assert len(tinyos.encode(packet)) <= 125
        now_us += 250_000
        bridge.handle_timer(now_us)
        bridge.data_to_send(now_us)
    assert bridge.link.queued <= _BRIDGE.queue_limit
    statistics = bridge.statistics
    assert statistics.taken <= statistics.heard
    assert statistics.admitted <= statistics.packets


def xbee_module(mode: int) -> Run:
    """An XBee module in an API mode (0: transparent): whatever it is told, it says whole frames."""

    def run(data: bytes) -> None:
        scheduler = Scheduler()
        medium = Medium(scheduler, MediumConfig())
        medium.place("a", Antenna(x_m=constant(0.0)))
        said = bytearray()
        module = XBeeModule(scheduler, medium, "a", {"AP": mode}, said.extend)
        module.receive(data)
        scheduler.run(scheduler.now + _SECONDS * FS_PER_S)
        assert module.packets_sent <= len(data)
        if module.registers["AP"] == mode and mode:
            decoder = xbee.Decoder(escaped=mode == 2)
            decoder.receive(bytes(said))
            assert not decoder.error_count
            assert not decoder.buffered

    return run
