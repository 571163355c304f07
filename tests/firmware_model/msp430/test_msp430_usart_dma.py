"""USART and DMA: exact byte times, double buffering, and a driver as board firmware writes it."""

from __future__ import annotations

import itertools
from collections.abc import Generator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_model.cpu import Flag
from firmware_model.errors import FirmwareError
from firmware_model.msp430 import dma
from firmware_model.msp430.sfr import URXIFG0, URXIFG1, UTXIFG1
from firmware_model.scheduler import Action, Event, Scheduler
from firmware_model.time import FS_PER_S, FS_PER_US

BYTES = dma.DMASRCBYTE | dma.DMADSTBYTE


class Bus:
    """An SPI slave that answers each byte with the complement of the byte before."""

    def __init__(self, bench: Any) -> None:
        self.bench = bench
        self.begins: list[tuple[int, int, int]] = []
        self.ends: list[int] = []
        self.answer = 0x5A

    def begin(self, mosi: int, bit_period_fs: int) -> None:
        self.begins.append((self.bench.scheduler.now, mosi, bit_period_fs))

    def end(self) -> int:
        self.ends.append(self.bench.scheduler.now)
        answer, self.answer = self.answer, self.begins[-1][1] ^ 0xFF
        return answer

    @property
    def sent(self) -> bytes:
        return bytes(mosi for _, mosi, _ in self.begins)


def spi(bench: Any, number: int = 1, divider: int = 16) -> Bus:
    """Set a USART up as an SPI master on SMCLK at about 4 MHz."""
    bus = Bus(bench)
    (bench.mcu.usart0, bench.mcu.usart1)[number].connect_spi(bus)
    u = f"U{number}"
    bench.write(BCSCTL1=0x87, DCOCTL=0xA0)
    bench.write(**{f"{u}CTL": 0x17, f"{u}TCTL": 0xA2, f"{u}BR0": divider, f"{u}BR1": 0})
    bench.write(**{f"ME{number + 1}": 0x40 if number == 0 else 0x10, f"{u}CTL": 0x16})
    bench.mcu.cpu.sleep_state = "lpm1"
    return bus


class DmaSpi:
    """A driver as a board writes it: one block out and in, the CPU asleep meanwhile."""

    SETUP_CYCLES = 60

    def __init__(self, mcu: Any, room: int = 256) -> None:
        self.reg, self.ram = mcu.reg, mcu.ram
        self.rx, self.tx = self.ram.allocate(room), self.ram.allocate(room)
        self.done = Flag("spi dma")
        mcu.cpu.on_interrupt("DACDMA", self.on_dma)

    def on_dma(self) -> int:
        self.reg["DMA0CTL"].clear_bits(dma.DMAIFG)
        self.done.set()
        return 20

    def exchange(self, data: bytes) -> Generator[int | Flag, None, bytes]:
        reg = self.reg
        self.ram.store(self.tx, data)
        reg["IFG2"].clear_bits(URXIFG1 | UTXIFG1)
        reg["DMACTL0"].write(dma.URXIFG1_TRIGGER | dma.UTXIFG1_TRIGGER << 4)
        reg["DMA0SA"].write(reg["U1RXBUF"].address)
        reg["DMA0DA"].write(self.rx)
        reg["DMA0SZ"].write(len(data))
        reg["DMA0CTL"].write(dma.DMAEN | dma.DMAIE | BYTES | dma.DMADSTINCR_3)
        reg["DMA1SA"].write(self.tx)
        reg["DMA1DA"].write(reg["U1TXBUF"].address)
        reg["DMA1SZ"].write(len(data))
        reg["DMA1CTL"].write(dma.DMAEN | BYTES | dma.DMASRCINCR_3)
        reg["IFG2"].set_bits(UTXIFG1)  # the edge that starts the block
        yield self.SETUP_CYCLES
        yield self.done
        return self.ram.load(self.rx, len(data))


def complemented(data: bytes, first: int = 0x5A) -> bytes:
    return bytes([first, *(b ^ 0xFF for b in data[:-1])]) if data else b""


@settings(deadline=None, max_examples=30)
@given(st.lists(st.binary(min_size=1, max_size=64), min_size=1, max_size=4), st.integers(2, 300))
def test_dma_blocks_arrive_whole_and_without_gaps(
    make_bench: Any, blocks: list[bytes], divider: int
) -> None:
    bench = make_bench().start()
    bus = spi(bench, divider=divider & 0xFF)
    bench.write(U1BR1=divider >> 8)
    driver = DmaSpi(bench.mcu)
    bench.mcu.interrupts.gie = True
    got: list[bytes] = []

    def body() -> Generator[int | Flag, None, None]:
        for block in blocks:
            bus.answer = 0x5A
            got.append((yield from driver.exchange(block)))

    bench.task(body())
    bench.run_us(100_000)
    assert got == [complemented(block) for block in blocks]
    assert bus.sent == b"".join(blocks)
    smclk = bench.mcu.clocks.smclk
    byte_fs = 8 * divider * FS_PER_S / float(smclk.frequency_hz)
    starts = [t for t, _, _ in bus.begins[: len(blocks[0])]]
    gaps = [b - a for a, b in itertools.pairwise(starts)]
    assert gaps[1:] == pytest.approx([byte_fs] * len(gaps[1:]), abs=1)
    # The first byte starts with the instruction, up to one SMCLK period before its first tick.
    assert all(byte_fs <= gap + 1 <= byte_fs * 9 / 8 + 2 for gap in gaps[:1])
    assert bus.begins[0][2] == smclk.span(divider)


class CountingScheduler(Scheduler):
    """Counts what is scheduled."""

    __slots__ = ("scheduled",)

    def __init__(self) -> None:
        super().__init__()
        self.scheduled = 0

    def at(self, time_fs: int, action: Action, priority: int = 1) -> Event:
        self.scheduled += 1
        return super().at(time_fs, action, priority)


def test_one_event_a_byte(make_bench: Any) -> None:
    bench = make_bench(scheduler=CountingScheduler()).start()
    spi(bench)
    driver = DmaSpi(bench.mcu)
    bench.mcu.interrupts.gie = True
    counts: list[int] = []
    for size in (50, 250):
        before = bench.scheduler.scheduled
        bench.task(driver.exchange(bytes(size)))
        bench.run_us(20_000)
        counts.append(bench.scheduler.scheduled - before)
    assert bench.mcu.usart1.bytes_shifted == 300
    assert counts[1] - counts[0] == 200
    assert counts[0] - 50 < 10  # waking, setting up, the interrupt at the end


def test_the_block_leaves_the_channels_as_the_guide_says(bench: Any) -> None:
    bus = spi(bench)
    driver = DmaSpi(bench.mcu)
    bench.task(driver.exchange(b"abc"))  # interrupts stay off: the flags can be looked at
    bench.run_us(1_000)
    assert bus.sent == b"abc"
    for channel in "01":
        control = bench.read(f"DMA{channel}CTL")
        assert control & dma.DMAIFG
        assert not control & dma.DMAEN
        assert bench.read(f"DMA{channel}SZ") == 3  # reloaded
    assert not bench.read("IFG2") & URXIFG1
    assert bench.read("IFG2") & UTXIFG1
    assert bench.read("U1TCTL") & 0x01


def test_dma_size_counts_down(bench: Any) -> None:
    spi(bench)
    driver = DmaSpi(bench.mcu)
    bench.task(driver.exchange(bytes(100)))
    bench.run_us(500)
    left = bench.read("DMA0SZ")
    assert left == 100 - bench.mcu.usart1.bytes_shifted
    assert 0 < left < 100
    bench.write(DMA0CTL=0)  # stopping keeps the rest
    assert bench.read("DMA0SZ") == left
    bench.run_us(1_000)
    assert bench.read("DMA0SZ") == left


def test_single_bytes_by_hand(bench: Any) -> None:
    bus = spi(bench, number=0, divider=2)
    assert bench.read("IFG1") & 0x80
    bench.write(U0TXBUF=0x3C)
    assert bench.read("IFG1") & 0x80  # the shift register took it at once
    bench.write(U0TXBUF=0x3D)
    assert not bench.read("IFG1") & 0x80
    assert not bench.read("U0TCTL") & 0x01
    bench.run_us(5)
    assert bench.read("IFG1") & 0x40
    assert bench.read("U0RXBUF") == 0x5A
    assert not bench.read("IFG1") & 0x40
    bench.run_us(5)
    assert bench.read("U0RXBUF") == 0xC3
    assert bus.sent == b"\x3c\x3d"
    assert bench.read("U0TCTL") & 0x01
    assert not bench.read("U0RCTL")


def test_an_unread_byte_is_overrun(bench: Any) -> None:
    spi(bench, number=0, divider=2)
    for byte in (1, 2):
        bench.write(U0TXBUF=byte)
        bench.run_us(10)
    assert bench.read("U0RCTL") & 0x21 == 0x21
    assert bench.read("U0RXBUF") == 0xFE
    assert bench.read("U0RCTL") & 0x21 == 0


def test_receive_interrupt_for_every_byte(bench: Any) -> None:
    spi(bench, number=0, divider=16)
    got: list[int] = []
    bench.handle("USART0RX", lambda: got.append(bench.mcu.reg["U0RXBUF"].read()))
    bench.mcu.interrupts.gie = True
    bench.write(IE1=0x40)
    for byte in (1, 2, 3):
        bench.write(U0TXBUF=byte)
        bench.run_us(60)
    assert got == [0x5A, 0xFE, 0xFD]


def test_nothing_moves_in_reset_or_without_its_module_enable(bench: Any) -> None:
    bus = spi(bench)
    bench.write(ME2=0)
    bench.write(U1TXBUF=1)
    bench.run_us(100)
    assert bus.begins == []
    bench.write(ME2=0x10, U1CTL=0x17)
    bench.write(U1TXBUF=1)
    bench.run_us(100)
    assert bus.begins == []


def test_reset_of_the_usart_stops_the_byte_under_way(bench: Any) -> None:
    bus = spi(bench)
    bench.write(U1TXBUF=1)
    bench.write(U1CTL=0x17)
    bench.run_us(100)
    assert bus.ends == []
    assert bench.mcu.clocks.smclk.users == 0


def test_lpm3_freezes_a_byte_on_smclk(bench: Any) -> None:
    bus = spi(bench)

    def body() -> Generator[int | Flag, None, None]:
        bench.mcu.cpu.sleep_state = "lpm3"
        bench.mcu.reg["U1TXBUF"].write(0x11)
        yield 1

    bench.task(body())
    bench.run_us(10_000)
    assert len(bus.begins) == 1
    assert bus.ends == []
    bench.mcu.cpu.sleep_state = "lpm0"
    bench.mcu.cpu.spawn("wake", (c for c in (1,)))
    bench.run_us(100)
    assert len(bus.ends) == 1


def test_loopback(bench: Any) -> None:
    bus = spi(bench)
    bench.write(U1CTL=0x17)
    bench.write(U1CTL=0x1E)  # LISTEN
    bench.write(U1TXBUF=0xA7)
    bench.run_us(100)
    assert bench.read("U1RXBUF") == 0xA7
    assert bus.begins == []


@pytest.mark.parametrize(("values", "message"), [
    ({"U1CTL": 0x14}, "slave"),
    ({"U1CTL": 0x36}, "I²C"),
    ({"U1TCTL": 0x82, "U1CTL": 0x16}, "UCLKI"),
])  # fmt: skip
def test_what_is_not_modelled_says_so(bench: Any, values: dict[str, int], message: str) -> None:
    spi(bench)
    bench.write(U1CTL=0x17)
    with pytest.raises(FirmwareError, match=message):
        bench.write(**values)


# --- UART ---------------------------------------------------------------------------


def uart(bench: Any, divider: int, modulation: int, control: int = 0x10) -> list[tuple[int, int]]:
    heard: list[tuple[int, int]] = []
    bench.mcu.usart1.connect_uart(lambda c: heard.append((bench.scheduler.now, c)))
    bench.write(U1CTL=control | 1, U1TCTL=0x10, U1MCTL=modulation)
    bench.write(U1BR0=divider & 0xFF, U1BR1=divider >> 8, ME2=0x30, U1CTL=control)
    return heard


def test_modulated_bits_at_2400_baud(bench: Any) -> None:
    """SLAU049, section 13.2.6: UBR = 13, m = 6Bh; bit i ends after Σ (UBR + m) ticks."""
    heard = uart(bench, 13, 0x6B)
    tick = FS_PER_S // 32_768
    bench.scheduler.run((bench.scheduler.now // tick + 1) * tick)
    start = bench.scheduler.now + tick
    bench.write(U1TXBUF=0x41)
    bench.run_us(10_000)
    bits = [13 + (0x6B >> i % 8 & 1) for i in range(10)]
    assert sum(bits) / 32_768 == pytest.approx(10 / 2_400, rel=0.01)
    assert heard == [(pytest.approx(start + (sum(bits[:9]) + bits[9] // 2) * tick, abs=40), 0x41)]


def test_characters_follow_each_other_without_a_gap(bench: Any) -> None:
    heard = uart(bench, 3, 0x4A)  # 9600 baud from 32 768 Hz
    text = b"fish"
    queue = list(text[1:])

    def refill() -> None:
        if queue:
            bench.mcu.reg["U1TXBUF"].write(queue.pop(0))

    bench.handle("USART1TX", refill)
    bench.mcu.interrupts.gie = True
    bench.write(IE2=0x20, U1TXBUF=text[0])
    bench.run_us(10_000)
    assert bytes(c for _, c in heard) == text
    gaps = [b[0] - a[0] for a, b in itertools.pairwise(heard)]
    frame = sum(3 + (0x4A >> i % 8 & 1) for i in range(10))
    assert gaps == pytest.approx([frame * FS_PER_S / 32_768] * 3, abs=2)
    assert gaps[0] / FS_PER_S == pytest.approx(10 / 9_600, rel=0.01)


@pytest.mark.parametrize(("control", "bits"), [(0x00, 9), (0x10, 10), (0x90, 11), (0xB0, 12)])
def test_frame_length_by_format(bench: Any, control: int, bits: int) -> None:
    heard = uart(bench, 16, 0, control)
    bench.write(U1TXBUF=0x55)
    bench.write(U1TXBUF=0x2A)
    bench.run_us(30_000)
    (first, one), (second, two) = heard
    assert (one, two) == (0x55, 0x2A)
    assert second - first == pytest.approx(bits * 16 * FS_PER_S / 32_768, abs=2)


def test_reception_with_overrun_and_dma(bench: Any) -> None:
    uart(bench, 3, 0x4A)
    bench.mcu.usart1.uart_receive(0x31)
    assert bench.read("IFG2") & URXIFG1
    bench.mcu.usart1.uart_receive(0x32)
    assert bench.read("U1RCTL") & 0x20
    assert bench.read("U1RXBUF") == 0x32
    buffer = bench.mcu.ram.allocate(4)
    bench.write(DMACTL0=dma.URXIFG1_TRIGGER, DMA0SA=0x7E, DMA0DA=buffer, DMA0SZ=4)
    bench.write(DMA0CTL=dma.DMAEN | BYTES | dma.DMADSTINCR_3)
    for byte in b"GPS!":
        bench.mcu.usart1.uart_receive(byte)
    assert bench.mcu.ram.load(buffer, 4) == b"GPS!"
    assert not bench.read("IFG2") & URXIFG1


def test_a_damaged_character_sets_its_error_bits(bench: Any) -> None:
    uart(bench, 3, 0)
    bench.mcu.usart1.uart_error(framing=True)
    assert bench.read("U1RCTL") & 0x81 == 0x81
    assert not bench.read("IFG2") & URXIFG1
    bench.write(U1RCTL=0)
    bench.mcu.usart1.uart_error(parity=True)
    assert bench.read("U1RCTL") & 0x41 == 0x41


def test_uart_dma_transmission(bench: Any) -> None:
    heard = uart(bench, 3, 0x4A)
    bench.mcu.ram.store(0x1200, b"hello")
    bench.write(DMACTL0=dma.UTXIFG1_TRIGGER, DMA0SA=0x1200, DMA0DA=0x7F, DMA0SZ=5)
    bench.write(IFG2=bench.read("IFG2") & ~UTXIFG1)
    bench.write(DMA0CTL=dma.DMAEN | BYTES | dma.DMASRCINCR_3)
    bench.write(IFG2=bench.read("IFG2") | UTXIFG1)
    bench.run_us(10_000)
    assert bytes(c for _, c in heard) == b"hello"


# --- DMA by itself --------------------------------------------------------------------


@settings(deadline=None, max_examples=40)
@given(
    st.binary(min_size=1, max_size=40),
    st.sampled_from([dma.DMADT_BLOCK, dma.DMADT_BURST]),
    st.sampled_from(["up", "down", "fixed"]),
)
def test_block_transfers_between_ram_buffers(
    make_bench: Any, data: bytes, mode: int, direction: str
) -> None:
    bench = make_bench().start()
    bench.mcu.ram.store(0x1200, data)
    bench.mcu.ram.store(0x1400, bytes(64))
    size = len(data)
    increment = {"up": 0x0C00, "down": 0x0800, "fixed": 0x0000}[direction]
    target = 0x1400 if direction != "down" else 0x1400 + size - 1
    bench.write(DMA2SA=0x1200, DMA2DA=target, DMA2SZ=size)
    bench.write(DMA2CTL=mode | BYTES | 0x0300 | increment | dma.DMAEN)
    started = bench.scheduler.now
    bench.write(DMA2CTL=bench.read("DMA2CTL") | dma.DMAREQ)
    assert not bench.read("DMA2CTL") & (dma.DMAIFG | dma.DMAREQ)
    mclk = bench.mcu.clocks.mclk
    cycles = 2 * size + (2 * (size // 4) if mode == dma.DMADT_BURST else 0)
    bench.scheduler.run(started + mclk.span(cycles) - 1)
    assert not bench.read("DMA2CTL") & dma.DMAIFG
    bench.scheduler.run(started + mclk.span(cycles))
    assert bench.read("DMA2CTL") & (dma.DMAIFG | dma.DMAEN) == dma.DMAIFG
    expected = {"up": data, "down": data[::-1], "fixed": data[-1:]}[direction]
    assert bench.mcu.ram.load(0x1400, len(expected)) == expected


def test_words_and_bytes_mix(bench: Any) -> None:
    bench.mcu.ram.store(0x1200, b"\x11\x22\x33\x44")
    bench.write(DMA0SA=0x1200, DMA0DA=0x1300, DMA0SZ=2)
    bench.write(DMA0CTL=dma.DMADT_BLOCK | 0x0F00 | dma.DMADSTBYTE | dma.DMAEN | dma.DMAREQ)
    assert bench.mcu.ram.load(0x1300, 2) == b"\x11\x33"  # the low bytes of two words
    bench.run_us(100)
    bench.write(DMA0CTL=dma.DMADT_BLOCK | 0x0F00 | dma.DMASRCBYTE | dma.DMAEN | dma.DMAREQ)
    assert bench.mcu.ram.load(0x1300, 4) == b"\x11\x00\x22\x00"


def test_repeated_single_transfers_take_timer_values(bench: Any) -> None:
    """DMADT = 4 with TBCCR2: each compare stores TAR, and the block starts over at its end."""
    bench.write(TACTL=0x0124)
    bench.write(DMACTL0=dma.TBCCR2_TRIGGER, DMA0SA=0x0170, DMA0DA=0x1200, DMA0SZ=3)
    bench.write(DMA0CTL=dma.DMADT_REPEATED | 0x0C00 | dma.DMAEN)
    bench.write(TBCCR0=9, TBCCR2=4, TBCTL=0x0114)
    bench.run_us(36 * 1e6 / 32_768)
    first = [bench.mcu.reg.read16(0x1200 + 2 * n) for n in range(3)]
    # Four compares in 36 ticks: the fourth stands where the first stood.
    assert [b - a for a, b in itertools.pairwise(first)] == [-20, 10]
    assert bench.read("DMA0CTL") & (dma.DMAEN | dma.DMAIFG) == dma.DMAEN | dma.DMAIFG
    assert bench.read("DMA0SZ") == 2  # one of the second block is done
    assert not bench.read("TBCCTL2") & 1  # the DMA cleared the flag that triggered it


def test_channels_chain(bench: Any) -> None:
    bench.mcu.ram.store(0x1200, b"ab")
    bench.write(DMACTL0=dma.CHAIN_TRIGGER << 4)
    bench.write(DMA0SA=0x1200, DMA0DA=0x1300, DMA0SZ=1, DMA1SA=0x1201, DMA1DA=0x1301, DMA1SZ=1)
    bench.write(DMA1CTL=BYTES | dma.DMAEN)
    bench.write(DMA0CTL=BYTES | dma.DMAEN | dma.DMAREQ)
    assert bench.mcu.ram.load(0x1300, 2) == b"ab"


def test_the_external_trigger_is_port_2_pin_6(bench: Any) -> None:
    bench.mcu.ram.store(0x1200, b"xyz")
    bench.write(DMACTL0=dma.EXTERNAL_TRIGGER, DMA0SA=0x1200, DMA0DA=0x1300, DMA0SZ=3)
    bench.write(DMA0CTL=BYTES | 0x0F00 | dma.DMAEN)
    pin = bench.mcu.ports[2].pins[6].input
    for level in (True, False, True):
        pin.set(level)
    assert bench.read("DMA0SZ") == 1
    assert bench.mcu.ram.load(0x1300, 2) == b"xy"


def test_an_enabled_interrupt_takes_the_flag_from_the_dma(bench: Any) -> None:
    """SLAU049, table 8-2: with URXIE set, URXIFG triggers no transfer."""
    spi(bench, number=0)
    bench.write(DMACTL0=dma.URXIFG0_TRIGGER, DMA0SA=0x76, DMA0DA=0x1200, DMA0SZ=1)
    bench.write(DMA0CTL=BYTES | dma.DMAEN, IE1=0x40)
    bench.write(U0TXBUF=1)
    bench.run_us(100)
    assert bench.read("IFG1") & URXIFG0
    assert bench.read("DMA0CTL") & dma.DMAEN


@pytest.mark.parametrize("look_us", [None, 0, 100, 310])
def test_a_busy_cpu_pays_for_the_bus(bench: Any, look_us: int | None) -> None:
    """Each transfer holds the CPU for two MCLK cycles (SLAU049, section 8.2.3)."""
    spi(bench)
    driver = DmaSpi(bench.mcu)
    bench.mcu.interrupts.gie = True
    before = bench.mcu.cpu.busy_cycles

    def burn() -> Generator[int | Flag, None, None]:
        yield 10_000

    bench.task(driver.exchange(bytes(10)))
    bench.task(burn())
    if look_us is not None:  # whoever looks at the channel changes nothing
        at = bench.scheduler.now + (100 + look_us) * FS_PER_US
        bench.scheduler.at(at, lambda: bench.read("DMA0SZ"))
    bench.run_us(10_000)
    switches = 40 * 3  # two tasks start, one comes back
    exact = 10_000 + DmaSpi.SETUP_CYCLES + switches + (6 + 20 + 5) + 2 * 20
    assert bench.mcu.cpu.busy_cycles - before == exact


def test_byte_time_figures(bench: Any) -> None:
    """At SMCLK / 16 of 4 MiHz a byte takes 30.5 µs: the figure that the link is designed on."""
    bus = spi(bench)
    bench.write(U1TXBUF=0)
    bench.run_us(100)
    expected = 8 * 16 / bench.mcu.clocks.dco_hz * 1e6
    assert (bus.ends[0] - bus.begins[0][0]) / FS_PER_US == pytest.approx(expected, abs=0.3)
