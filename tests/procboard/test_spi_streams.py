"""Streamed SPI blocks do what a byte at a time does: bytes, times, registers, flags, memory."""

import random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from firmware_model.msp430 import usart as usart_module
from firmware_model.msp430.mcu import Msp430F1611
from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_MS, FS_PER_NS
from procboard.chips.m25p80 import M25P80, FlashGeometry, FlashImage

RX, TX = 0x1200, 0x1400


class Recorder:
    """A port that answers with a running sum, and notes each byte with its times."""

    def __init__(self, scheduler, blocks):
        self.scheduler = scheduler
        self.blocks = blocks
        self.bytes = []
        self.sum = 7

    def begin(self, mosi, bit_period_fs):
        self.mosi = mosi
        self.started = self.scheduler.now

    def end(self):
        self.bytes.append(self.mosi)
        self.sum = (self.sum * 5 + self.mosi) & 0xFF
        return self.sum

    def takes_blocks(self):
        return self.blocks

    def exchange_block(self, mosi):
        answer = bytearray()
        for byte in mosi:
            self.mosi = byte
            answer.append(self.end())
        return bytes(answer)


class Rig:
    """USART1 as SPI master and the DMA pair, driven from outside as firmware would."""

    def __init__(self, mode, monkeypatch=None):
        self.scheduler = Scheduler()
        rail = Rail(self.scheduler, "3V", 3.0)
        self.mcu = mcu = Msp430F1611(self.scheduler, rail, lambda mcu: None)
        self.scheduler.run(10 * FS_PER_MS)
        reg = self.reg = mcu.reg
        reg["WDTCTL"].write(0x5A80)
        mcu.cpu.sleep_state = "lpm0"
        self.port = Recorder(self.scheduler, mode == "block")
        mcu.usart1.connect_spi(self.port)
        if mode == "byte":
            mcu.usart1._open_stream = lambda *_: False
        reg["U1CTL"].write(0x17)
        reg["U1TCTL"].write(0xA2)
        reg["U1BR0"].write(2)
        reg["ME2"].write(0x10)
        reg["U1CTL"].write(0x16)
        reg["DMACTL0"].write(0x00A9)

    def start(self, data):
        reg = self.reg
        self.mcu.memory[TX : TX + len(data)] = data
        self.mcu.memory[RX : RX + 300] = bytes(300)
        for name, value in (
            ("DMA0SA", 0x7E), ("DMA0DA", RX), ("DMA0SZ", len(data)), ("DMA0CTL", 0x0CD0),
            ("DMA1SA", TX + 1), ("DMA1DA", 0x7F), ("DMA1SZ", len(data) - 1), ("DMA1CTL", 0x03D0),
        ):  # fmt: skip
            reg[name].write(value)
        reg["U1TXBUF"].write(data[0])

    def state(self):
        """All that firmware can see without changing it, and what has been on the wire."""
        reg = self.reg
        names = ("DMA0CTL", "DMA1CTL", "DMA0SZ", "DMA1SZ", "IFG2", "U1TCTL", "U1RCTL")
        seen = {name: reg[name].read() for name in names}
        seen["rx"] = bytes(self.mcu.memory[RX : RX + 300])
        seen["wire"] = list(self.port.bytes)
        return seen


def finish_time(rig):
    while not rig.reg["DMA0CTL"].value & 0x0008:
        due = rig.scheduler.next_time()
        rig.scheduler.run(due)
    return rig.scheduler.now


@pytest.mark.parametrize("count", [2, 3, 48, 260])
@pytest.mark.parametrize("mode", ["stream", "block"])
def test_a_whole_block_is_the_same(mode, count):
    data = random.Random(count).randbytes(count)
    plain, streamed = Rig("byte"), Rig(mode)
    plain.start(data)
    streamed.start(data)
    assert finish_time(plain) == finish_time(streamed)
    assert plain.state() == streamed.state()
    assert plain.reg["U1RXBUF"].read() == streamed.reg["U1RXBUF"].read()
    assert plain.mcu.usart1.bytes_shifted == streamed.mcu.usart1.bytes_shifted == count
    assert plain.port.bytes == list(data)


@settings(
    max_examples=80,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    mode=st.sampled_from(["stream", "block"]),
    count=st.integers(2, 40),
    looks=st.lists(st.integers(0, 1_000_000), max_size=4),
    touch=st.sampled_from(["look", "stop", "restart", "transmit", "reset", "retune", "puc"]),
)
def test_touching_it_in_the_middle_is_the_same(mode, count, looks, touch):
    data = random.Random(count).randbytes(count)
    rigs = Rig("byte"), Rig(mode)
    for rig in rigs:
        rig.start(data)
    start = rigs[0].scheduler.now
    # the length of the block at the reset frequency of the DCO: 16 ticks of 750 kHz a byte
    length = count * 16 * 1_333 * FS_PER_NS
    for number, share in enumerate(sorted(looks)):
        for rig in rigs:
            rig.scheduler.run(start + length * share // 1_000_000)
        assert rigs[0].state() == rigs[1].state()
        if number == len(looks) - 1:
            for rig in rigs:
                poke(rig, touch, data)
            assert rigs[0].state() == rigs[1].state()
    for rig in rigs:
        rig.scheduler.run(start + 2 * length + FS_PER_MS)
    assert rigs[0].state() == rigs[1].state()
    assert rigs[0].reg["U1RXBUF"].read() == rigs[1].reg["U1RXBUF"].read()
    assert rigs[0].mcu.usart1.bytes_shifted == rigs[1].mcu.usart1.bytes_shifted


def poke(rig, touch, data):
    reg = rig.reg
    if touch == "stop":
        reg["DMA0CTL"].clear_bits(0x0010)
        reg["DMA1CTL"].clear_bits(0x0010)
    elif touch == "restart":
        reg["DMA0CTL"].clear_bits(0x0010)
        reg["DMA1CTL"].clear_bits(0x0010)
        reg["U1CTL"].write(0x17)
        reg["U1CTL"].write(0x16)
        rig.start(data)
    elif touch == "transmit":
        reg["U1TXBUF"].write(0x5A)
    elif touch == "reset":
        reg["U1CTL"].write(0x17)
    elif touch == "retune":
        reg["DCOCTL"].write(0x20)
    elif touch == "puc":
        rig.mcu.request_reset("test")


def test_a_stream_costs_one_event_a_byte_and_a_block_one_in_all():
    for mode, most in (("stream", 40), ("block", 4)):
        rig = Rig(mode)
        rig.start(bytes(40))
        before = rig.scheduler._sequence
        finish_time(rig)
        assert rig.scheduler._sequence - before <= most


def test_the_flash_answers_blocks_as_it_answers_bytes():
    """Random conversations, by bytes and by blocks cut anywhere."""
    rng = random.Random(4)
    geometry = FlashGeometry(4, 1024, 256)
    chips = []
    for _ in range(2):
        scheduler = Scheduler()
        image = FlashImage(bytearray(random.Random(5).randbytes(geometry.size_bytes)))
        rail = Rail(scheduler, "3V", 3.0)
        chips.append((scheduler, M25P80(scheduler, rail, random.Random(1), image, geometry)))
        scheduler.run(20 * FS_PER_MS)
    for _ in range(400):
        code = rng.choice([2, 2, 2, 3, 3, 3, 5, 6, 0x0B, 0x9F, 0xAB, 0xD8])
        address = rng.randrange(geometry.size_bytes).to_bytes(3, "big")
        message = bytes((code,)) + address + rng.randbytes(rng.choice([0, 1, 9, 255, 256, 300]))
        if code in (5, 6):
            message = message[: rng.choice([1, 1, 2])]
        elif code == 0xD8:
            message = message[:4]
        (_, plain), (_, blocks) = chips
        plain.select(True)
        blocks.select(True)
        answer = bytearray()
        for byte in message:
            answer.append(plain.begin())
            plain.end(byte)
        cut = rng.randrange(len(message) + 1)
        assert blocks.exchange(message[:cut]) + blocks.exchange(message[cut:]) == bytes(answer)
        plain.select(False)
        blocks.select(False)
        pause_fs = rng.choice([1, 1000]) * FS_PER_MS * (code != 6)
        for scheduler, _ in chips:
            scheduler.run(scheduler.now + pause_fs)
        assert plain.image.memory == blocks.image.memory
    assert plain.programs > 10


def test_the_constant_of_held_cycles_matches_the_dma():
    from firmware_model.msp430.dma import CYCLES_PER_TRANSFER

    assert usart_module.STREAM_CYCLES == 2 * CYCLES_PER_TRANSFER
