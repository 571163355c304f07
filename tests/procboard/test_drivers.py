"""Drivers on the real bus: what conversations look like on the wires, and what can go wrong."""

import pytest

from firmware_model.cpu import Flag
from firmware_model.msp430.mcu import Msp430F1611
from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_MS, FS_PER_US
from procboard.alarms import Alarms
from procboard.clock import calibrate_dco
from procboard.drivers.cc2420 import Cc2420Driver
from procboard.drivers.m25p80 import M25P80Driver
from procboard.drivers.spi import DmaPair, SpiMaster
from procboard.drivers.spi_bus0 import SpiBus0, SpiChip
from procboard.errors import FlashFailureError, RadioFailureError
from procboard.telosb import TelosB
from radio_802154.cc2420_registers import State
from radio_802154.medium import Antenna, Medium


class Probe:
    """Notes what goes over bus 0: (chip, MOSI bytes) a conversation."""

    def __init__(self, mote):
        self.conversations = []
        self._open = None
        for name, bit in (("radio", 2), ("flash", 4)):
            mote.mcu.ports[4].pins[bit].output.watch(self._selector(name))
        bus = mote.spi0
        self._begin, self._block = bus.begin, bus.exchange_block
        self.begun = []

    def _selector(self, name):
        def changed(level):
            if not level:
                self._open = bytearray()
            elif self._open is not None:
                self.conversations.append((name, bytes(self._open)))
                self._open = None

        return changed

    # SpiBlockPort: in the place of the bus, and in front of it
    def begin(self, mosi, bit_period_fs):
        self._open.append(mosi)
        self._begin(mosi, bit_period_fs)

    def exchange_block(self, mosi):
        self._open += mosi
        return self._block(mosi)


class Rig:
    def __init__(self, task):
        self.scheduler = Scheduler()
        medium = Medium(self.scheduler)
        medium.place("mote", Antenna())
        self.rail = Rail(self.scheduler, "3V", 3.0)
        self.task = task
        self.result = None
        self.error = None
        self.mote = TelosB(self.scheduler, self.rail, medium, self.main, "mote", 1)
        self.probe = probe = Probe(self.mote)
        bus = self.mote.spi0

        class Port:
            begin = staticmethod(probe.begin)
            end = staticmethod(bus.end)
            takes_blocks = staticmethod(bus.takes_blocks)
            exchange_block = staticmethod(probe.exchange_block)

        self.mote.mcu.usart0.connect_spi(Port())

    def main(self, mcu: Msp430F1611):
        reg = mcu.reg
        reg["WDTCTL"].write(0x5A80)
        reg["P4OUT"].write(0x94)
        reg["P4DIR"].write(0xF4)
        mcu.interrupts.gie = True
        mcu.cpu.spawn("test", self.boot(mcu))

    def boot(self, mcu):
        yield from calibrate_dco(mcu)
        self.alarms = Alarms(mcu)
        self.alarms.start()
        dma = DmaPair(mcu)
        dma.start()
        master = SpiMaster(mcu, 0, 2, dma)
        master.start()
        bus = SpiBus0(master)
        output = mcu.reg["P4OUT"]
        self.flash = M25P80Driver(SpiChip(bus, output, 0x10), self.alarms.sleep_us)
        self.radio = Cc2420Driver(mcu, SpiChip(bus, output, 0x04), self.alarms.sleep_us)
        try:
            self.result = yield from self.task(self)
        except (FlashFailureError, RadioFailureError) as error:
            self.error = error

    def run(self, seconds):
        self.scheduler.run(self.scheduler.now + round(seconds * 1000) * FS_PER_MS)
        return self


def test_flash_conversations_are_the_datasheets():
    def task(rig):
        yield from rig.flash.start()
        rig.probe.conversations.clear()
        yield from rig.flash.program(0x012345, b"abcdefghijkl")
        yield from rig.flash.erase_sector(0x050000)
        return (yield from rig.flash.read(0x012345, 12))

    rig = Rig(task).run(1.0)
    assert rig.result == b"abcdefghijkl"
    assert [c for c in rig.probe.conversations if c[1][0] != 0x05] == [
        ("flash", b"\x06"),
        ("flash", b"\x02\x01\x23\x45abcdefghijkl"),
        ("flash", b"\x06"),
        ("flash", b"\xd8\x05\x00\x00"),
        ("flash", b"\x03\x01\x23\x45" + bytes(12)),
    ]
    polls = [c for c in rig.probe.conversations if c[1][0] == 0x05]
    assert 2 <= len(polls) <= 6  # waits are slept, not polled


def test_a_page_is_clocked_at_2_mhz_and_the_cpu_sleeps_meanwhile():
    def task(rig):
        yield from rig.flash.start()
        cpu = rig.mote.mcu.cpu
        start, busy = rig.scheduler.now, cpu.busy_cycles
        yield from rig.flash.read(0, 256)
        return rig.scheduler.now - start, cpu.busy_cycles - busy

    duration_fs, busy = Rig(task).run(0.5).result
    byte_fs = 8 * FS_PER_MS // 2097
    assert 260 * byte_fs <= duration_fs <= 260 * byte_fs * 1.08
    assert busy < 600


def test_another_chip_is_noticed():
    def task(rig):
        yield from rig.flash.start()

    rig = Rig(task)
    rig.mote.flash.select = lambda _selected: None  # it does not listen: the bus floats
    rig.run(0.5)
    assert "ffffff" in str(rig.error)


def test_a_chip_that_still_erases_is_waited_for():
    """After a reset of the CPU alone: until the cycle is over it tells its status only."""

    def task(rig):
        yield from rig.flash.start()
        yield from rig.flash._device.exchange(b"\x06")
        yield from rig.flash._device.exchange(b"\xd8\x00\x00\x00")
        yield from rig.flash.start()
        return rig.mote.flash.busy

    rig = Rig(task).run(2.0)
    assert rig.result is False


def test_a_stuck_flash_is_given_up():
    def task(rig):
        yield from rig.flash.start()
        rig.mote.flash._status = lambda: 0x03
        yield from rig.flash.program(0, b"x")

    rig = Rig(task).run(1.0)
    assert "busy" in str(rig.error)


def test_deep_power_down_and_back():
    def task(rig):
        yield from rig.flash.start()
        yield from rig.flash.power_down()
        yield from rig.alarms.sleep_us(1000)
        asleep = rig.rail.amps
        gone = yield from rig.flash.read(0, 2)
        yield from rig.flash.wake()
        yield from rig.flash.program(0, b"\x12")
        back = yield from rig.flash.read(0, 2)
        return asleep, gone, back

    rig = Rig(task).run(0.5)
    _asleep, gone, back = rig.result
    assert (gone, back) == (b"\xff\xff", b"\x12\xff")


def test_the_radio_is_brought_up_as_its_datasheet_wants():
    def task(rig):
        yield from rig.radio.start(15, 0x22, 0x1234, 27)
        return (
            (yield from rig.radio.read_register(0x11)),
            (yield from rig.radio.read_register(0x15)),
            (yield from rig.radio.read_register(0x18)),
        )

    rig = Rig(task).run(0.1)
    mdmctrl0, txctrl, fsctrl = rig.result
    assert mdmctrl0 == 0x0AF2  # reset value and AUTOACK
    assert txctrl & 0x1F == 27
    assert rig.mote.radio.frequency_mhz == 2425
    assert fsctrl & 0x3FF == 2425 - 2048
    assert rig.mote.radio.state is State.RX_SFD_SEARCH
    ram = next(c for _, c in rig.probe.conversations if c[0] & 0x80)
    assert ram == b"\xe8\x80\x22\x00\x34\x12"  # RAM 0x168: PANID, SHORTADR, low byte first


def test_a_radio_without_an_oscillator_is_reported():
    def task(rig):
        rig.mote.radio.vreg_en = None
        yield from rig.radio.start(15, 0x22, 1, 27)

    rig = Rig(task)
    rig.mote.radio.select = lambda _selected: None
    rig.run(0.1)
    assert "oscillator" in str(rig.error)


def test_radio_and_flash_take_turns():
    order = []

    def task(rig):
        yield from rig.radio.start(15, 0x22, 1, 31)
        yield from rig.flash.start()
        rig.probe.conversations.clear()
        done = Flag("done")

        def reader(name, work):
            yield from work
            order.append(name)
            if len(order) == 6:
                done.set()

        for n in range(3):
            cpu = rig.mote.mcu.cpu
            cpu.spawn("page", reader("flash", rig.flash.read(n * 256, 256)))
            cpu.spawn("load", reader("radio", rig.radio.load(bytes((n,)) * 40)))
        yield done

    rig = Rig(task).run(0.5)
    assert sorted(order) == ["flash"] * 3 + ["radio"] * 3
    assert rig.mote.spi0.contentions == 0
    loads = [c for name, c in rig.probe.conversations if name == "radio"]
    assert loads == [b"\x3e\x2a" + bytes((n,)) * 40 for n in range(3)]


@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 200])
def test_polled_or_by_dma_the_bytes_are_the_same(count):
    def task(rig):
        yield from rig.flash.start()
        rig.mote.flash_image.memory[:256] = bytes(range(256))
        return (yield from rig.flash.read(3, count))

    assert Rig(task).run(0.2).result == bytes(range(3, 3 + count))


def test_waking_up_takes_its_time():
    """tPUW: 10 ms pass before the first instruction that writes."""

    def task(rig):
        start = rig.scheduler.now
        yield from rig.flash.start()
        return rig.scheduler.now - start

    assert Rig(task).run(0.2).result >= 10_000 * FS_PER_US
