"""Digi's own Python library talks to the emulated XBee as to one of theirs.

digi-xbee opens the port, finds out which product and protocol this is, reads and sets registers,
sends, hears what became of it, and receives. It knows nothing of this project; a second module on
the emulated air answers.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_model.scheduler import Scheduler
from firmware_model.signals import constant
from firmware_model.time import from_seconds
from radio_802154 import xbee
from radio_802154.medium import Antenna, Medium
from radio_802154.xbee_module import XBeeModule
from spi_bus.transports.pty import PtyTransport

devices = pytest.importorskip("digi.xbee.devices", reason="digi-xbee is not installed")
pytestmark = pytest.mark.oracle

REGISTERS = {"MM": 2, "CH": 26, "ID": 0x22}
PEER = 1


class Pair:
    """The module on a pty and its peer, which gives everything back, in real time."""

    def __init__(self, link: Path, api: int) -> None:
        self.port = PtyTransport(str(link))
        self._scheduler = Scheduler()
        medium = Medium(self._scheduler)
        for name, x_m in (("module", 0.0), ("peer", 1.0)):
            medium.place(name, Antenna(x_m=constant(x_m)))
        self.module = XBeeModule(
            self._scheduler, medium, "module", {**REGISTERS, "AP": api, "MY": 0}, self.port.write
        )
        self._peer = XBeeModule(
            self._scheduler, medium, "peer", {**REGISTERS, "AP": 1, "MY": PEER}, self._echo, seed=3
        )
        self._decoder = xbee.Decoder(escaped=False)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        began_s = time.monotonic()
        while not self._over.is_set():
            self.port.wait(0.005)
            self._scheduler.run(from_seconds(time.monotonic() - began_s))
            self.module.receive(self.port.read())

    def _echo(self, octets: bytes) -> None:
        for frame in self._decoder.receive(octets):
            if isinstance(frame, xbee.RxPacket16):
                back = xbee.TxRequest16(0, frame.source, 0, frame.data[::-1])
                self._peer.receive(xbee.encode(back, escaped=False))

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        self.port.close()


@pytest.fixture(params=[1, 2])
def pair(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Pair]:
    made = Pair(tmp_path / "xbee", request.param)
    yield made
    made.close()


def test_digis_library_finds_sets_sends_and_receives(pair: Pair) -> None:
    from digi.xbee.exception import ATCommandException, TransmitException
    from digi.xbee.models.address import XBee16BitAddress
    from digi.xbee.models.mode import OperatingMode
    from digi.xbee.models.protocol import XBeeProtocol

    device = devices.Raw802Device(str(pair.port.link), 9600)
    device.open()
    try:
        assert device.get_protocol() is XBeeProtocol.RAW_802_15_4
        api = pair.module.registers["AP"]
        mode = {1: OperatingMode.API_MODE, 2: OperatingMode.ESCAPED_API_MODE}[api]
        assert device.operating_mode is mode
        assert device.get_hardware_version().description == "XB24-Axx-xx"  # Series 1
        assert bytes(device.get_firmware_version()) == b"\x10\xef"
        assert device.get_64bit_addr().address == (0x13A200 << 32 | 0x4000_0000).to_bytes(8, "big")
        assert device.get_16bit_addr().address == b"\0\0"
        assert bytes(device.get_parameter("ID")) == b"\0\x22"
        device.set_parameter("RN", bytearray(b"\x03"))
        assert pair.module.registers["RN"] == 3
        device.set_node_id("predator")
        assert pair.module.registers.get("NI") == b"predator"
        with pytest.raises(ATCommandException, match="parameter"):
            device.set_parameter("CH", bytearray(b"\x30"))
        with pytest.raises(ATCommandException, match="command"):
            device.get_parameter("ZZ")
        with pytest.raises(TransmitException):
            device.send_data_16(XBee16BitAddress(b"\0\x09"), b"nobody has this address")
        special = bytes((0x7E, 0x7D, 0x11, 0x13)) * 3  # what API mode 2 escapes
        status = device.send_data_16(XBee16BitAddress(bytes((0, PEER))), special + b"!")
        assert status.transmit_status.code == 0
        message = device.read_data(20.0)
        assert bytes(message.data) == b"!" + special[::-1]
        assert not message.is_broadcast
    finally:
        device.close()
