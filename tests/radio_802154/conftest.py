"""A host that drives a CC2420 through SPI octets and pins, as a driver does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.signals import constant
from firmware_model.time import FS_PER_US
from firmware_model.trace import Trace
from radio_802154 import cc2420_registers as r
from radio_802154.cc2420 import Cc2420
from radio_802154.medium import Antenna, Medium, MediumConfig


class Host:
    """SPI accesses take no time here; `World.run_us` lets time pass."""

    def __init__(self, chip: Cc2420) -> None:
        self.chip = chip

    def transfer(self, *octets: int) -> list[int]:
        chip = self.chip
        chip.select(True)
        answer = []
        for octet in octets:
            answer.append(chip.begin())
            chip.end(octet)
        chip.select(False)
        return answer

    def strobe(self, strobe: int) -> int:
        return self.transfer(strobe)[0]

    def status(self) -> int:
        return self.strobe(r.SNOP)

    def write(self, address: int, value: int) -> None:
        self.transfer(address, value >> 8, value & 0xFF)

    def read(self, address: int) -> int:
        _, high, low = self.transfer(address | 0x40, 0, 0)
        return high << 8 | low

    def write_ram(self, address: int, data: bytes) -> None:
        self.transfer(0x80 | address & 0x7F, address >> 7 << 6, *data)

    def read_ram(self, address: int, count: int) -> bytes:
        first = (0x80 | address & 0x7F, address >> 7 << 6 | 0x20)
        return bytes(self.transfer(*first, *([0] * count))[2:])

    def load(self, content: bytes) -> None:
        """Fill the TXFIFO with a frame whose FCS the chip appends."""
        self.transfer(r.TXFIFO, len(content) + 2, *content)

    def take(self, count: int) -> bytes:
        return bytes(self.transfer(r.RXFIFO | 0x40, *([0] * count))[1:])

    def take_frame(self) -> bytes:
        """Read one frame from the RXFIFO: PSDU with its two status octets."""
        return self.take(self.take(1)[0])


class World:
    """A scheduler, a medium, and chips at places."""

    def __init__(self, **config: Any) -> None:
        self.scheduler = Scheduler()
        self.trace = Trace()
        seed = config.pop("seed", 1)
        self.medium = Medium(
            self.scheduler,
            MediumConfig(**config),
            seed=seed,
            channel=self.trace.channel("radio.air"),
        )
        self.frames: list[Any] = []
        self.trace.channel("radio.air").sink(self.frames.extend)

    def chip(
        self,
        name: str,
        x_m: float = 0.0,
        *,
        depth_m: float = 0.0,
        address: int | None = None,
        pan_id: int = 0x22,
        listening: bool = True,
        rail: Rail | None = None,
        autoack: bool = True,
    ) -> Host:
        """Place, power and start a chip; with an address also recognition and ACKs."""
        antenna = Antenna(x_m=constant(x_m), depth_m=constant(depth_m))
        self.medium.place(name, antenna)
        host = Host(Cc2420(self.scheduler, self.medium, name, rail))
        host.chip.vreg_en(1)
        self.run_us(r.VREG_START_US)
        host.strobe(r.SXOSCON)
        self.run_us(r.XOSC_START_US)
        host.write(r.IOCFG0, 127)
        if address is None:
            host.write(r.MDMCTRL0, 0x0AE2 & ~r.MDMCTRL0_ADR_DECODE)
        else:
            host.write(r.MDMCTRL0, 0x0AE2 | (r.MDMCTRL0_AUTOACK if autoack else 0))
            host.write_ram(r.RAM_PANID, pan_id.to_bytes(2, "little"))
            host.write_ram(r.RAM_SHORTADR, address.to_bytes(2, "little"))
        if listening:
            host.strobe(r.SRXON)
            self.run_us(192 + 128)
        return host

    def run_us(self, microseconds: float) -> None:
        self.scheduler.run(self.scheduler.now + round(microseconds * FS_PER_US))

    def air(self) -> list[Any]:
        """Records of all frames so far: (end, (start, channel, source, dBm, octets))."""
        self.trace.flush()
        return self.frames


@pytest.fixture
def world() -> World:
    return World()


@pytest.fixture(scope="session")  # a class: nothing is shared between tests
def make_world() -> Callable[..., World]:
    return World
