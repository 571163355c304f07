"""The M25P80 against its datasheet (Micron, 09005aef84566560 Rev. I)."""

import random

import pytest

from firmware_model.time import FS_PER_US
from procboard.chips.m25p80 import FlashGeometry, FlashImage, FlashTiming

WREN, WRDI, RDSR, DP, RES, RDID, BE = (bytes((c,)) for c in (6, 4, 5, 0xB9, 0xAB, 0x9F, 0xC7))


@pytest.fixture
def bench(make_flash_bench):
    return make_flash_bench(FlashGeometry())


def program(bench, address, data, wait=True):
    bench.talk(WREN)
    bench.talk((0x02000000 | address).to_bytes(4, "big") + data)
    if wait:
        bench.wait_s(0.001)


def read(bench, address, count):
    return bench.talk((0x03000000 | address).to_bytes(4, "big"), count)


def status(bench):
    return bench.talk(RDSR, 1)[0]


def test_identification_and_signature(bench):
    assert bench.talk(RDID, 4) == b"\x20\x20\x14\x10"
    assert bench.talk(RES + b"\0\0\0", 2) == b"\x13\x13"


def test_a_new_chip_is_erased_and_reads_on_around_the_end(bench):
    assert read(bench, 0xFFFFE, 4) == b"\xff" * 4
    program(bench, 0xFFFFF, b"\x12")
    program(bench, 0, b"\x34")
    assert read(bench, 0xFFFFF, 2) == b"\x12\x34"


def test_fast_read_has_one_dummy_byte(bench):
    program(bench, 0x1234, b"abc")
    assert bench.talk(b"\x0b\x00\x12\x34\x99", 3) == b"abc"


def test_programming_needs_wren_and_clears_it(bench):
    bench.talk(b"\x02\0\0\0\x00")
    bench.wait_s(0.01)
    assert read(bench, 0, 1) == b"\xff"
    bench.talk(WREN)
    assert status(bench) == 0x02
    bench.talk(b"\x02\0\0\0\x00")
    assert status(bench) == 0x03  # WIP and WEL
    bench.wait_s(0.001)
    assert status(bench) == 0
    assert read(bench, 0, 1) == b"\0"
    bench.talk(WREN)
    bench.talk(WRDI)
    assert status(bench) == 0


def test_programming_only_clears_bits(bench):
    program(bench, 7, b"\xf0")
    program(bench, 7, b"\x3c")
    assert read(bench, 7, 1) == b"\x30"


def test_a_page_wraps_and_keeps_its_last_256_bytes(bench):
    program(bench, 0x1FE, b"wxyz")
    assert read(bench, 0x1FE, 2) == b"wx"
    assert read(bench, 0x100, 2) == b"yz"
    assert read(bench, 0x200, 2) == b"\xff\xff"
    data = bytes(range(256)) + b"\x00\x00"
    program(bench, 0x400, data)
    assert read(bench, 0x400, 256) == b"\x00\x00" + bytes(range(2, 256))


@pytest.mark.parametrize(("count", "span_us"), [(256, 640), (128, 320), (8, 20)])
def test_page_program_time_is_in_proportion(bench, count, span_us):
    program(bench, 0, bytes(count), wait=False)
    start = bench.scheduler.now
    bench.scheduler.run(start + (span_us - 1) * FS_PER_US)
    assert bench.chip.busy
    bench.scheduler.run(start + span_us * FS_PER_US)
    assert not bench.chip.busy


def test_while_busy_only_the_status_answers(bench):
    program(bench, 0, bytes(256), wait=False)
    assert read(bench, 0, 2) == b"\xff\xff"
    assert bench.talk(RDID, 3) == b"\xff\xff\xff"
    assert bench.talk(RDSR, 3) == b"\x03\x03\x03"
    bench.wait_s(0.001)
    assert read(bench, 0, 2) == b"\0\0"


def test_sector_erase_takes_its_time_and_leaves_the_neighbours(bench):
    for address in (0xFFFF, 0x10000, 0x1FFFF, 0x20000):
        program(bench, address, b"\0")
    bench.talk(WREN)
    bench.talk(b"\xd8\x01\x80\x00")
    bench.wait_s(0.599)
    assert bench.chip.busy
    bench.wait_s(0.002)
    assert not bench.chip.busy
    assert [read(bench, a, 1)[0] for a in (0xFFFF, 0x10000, 0x1FFFF, 0x20000)] == [0, 255, 255, 0]
    assert bench.chip.image.erase_counts == [0, 1] + [0] * 14


def test_bulk_erase_only_without_protection(bench):
    program(bench, 5, b"\0")
    bench.talk(WREN)
    bench.talk(b"\x01\x04")  # BP0: the top sector
    bench.wait_s(0.01)
    bench.talk(WREN)
    bench.talk(BE)
    assert not bench.chip.busy
    bench.talk(WREN)
    bench.talk(b"\x01\x00")
    bench.wait_s(0.01)
    bench.talk(WREN)
    bench.talk(BE)
    bench.wait_s(7.999)
    assert bench.chip.busy
    bench.wait_s(0.002)
    assert read(bench, 5, 1) == b"\xff"


@pytest.mark.parametrize(
    ("level", "first_protected"), [(1, 15), (2, 14), (3, 12), (4, 8), (5, 0), (6, 0), (7, 0)]
)
def test_protected_area_sizes(bench, level, first_protected):
    bench.talk(WREN)
    bench.talk(bytes((1, level << 2)))
    bench.wait_s(0.01)
    for sector in range(16):
        program(bench, sector << 16, b"\0")
        assert read(bench, sector << 16, 1)[0] == (255 if sector >= first_protected else 0)


def test_status_register_survives_without_power(bench):
    bench.talk(WREN)
    bench.talk(b"\x01\xff")
    bench.wait_s(0.01)
    assert status(bench) == 0x9C  # b6, b5 read zero; WIP and WEL are not written
    bench.rail.set_volts(0.0)
    bench.rail.set_volts(3.0)
    bench.wait_s(0.02)
    assert status(bench) == 0x9C


@pytest.mark.parametrize("tail", [b"\xd8\0\0", b"\xd8\0\0\0\0", b"\x02\0\0\0", b"\xc7\0"])
def test_a_modifying_instruction_of_the_wrong_length_does_nothing(bench, tail):
    bench.talk(WREN)
    bench.talk(tail)
    assert not bench.chip.busy


def test_deep_power_down_hears_only_release(bench):
    bench.talk(DP)
    bench.wait_s(0.001)
    assert bench.talk(RDID, 3) == b"\xff\xff\xff"
    assert bench.rail.amps == pytest.approx(1e-6)
    bench.talk(RES)
    assert bench.talk(RDID, 3) == b"\xff\xff\xff"  # tRES
    bench.wait_s(0.001)
    assert bench.talk(RDID, 3) == b"\x20\x20\x14"


def test_hold_freezes_the_conversation(bench):
    chip = bench.chip
    chip.select(True)
    chip.begin()
    chip.end(0x9F)
    chip.hold(True)
    for _ in range(3):
        assert chip.begin() == 0xFF
        chip.end(0)
    chip.hold(False)
    assert chip.begin() == 0x20


def test_nothing_is_written_in_the_first_10_ms(bench):
    bench.rail.set_volts(0.0)
    bench.rail.set_volts(3.0)
    bench.wait_s(0.009)
    bench.talk(WREN)
    assert status(bench) == 0
    bench.wait_s(0.002)
    bench.talk(WREN)
    assert status(bench) == 2


def test_currents_by_state(bench):
    assert bench.rail.amps == pytest.approx(50e-6)
    bench.chip.select(True)
    assert bench.rail.amps == pytest.approx(4e-3)
    bench.chip.select(False)
    program(bench, 0, bytes(256), wait=False)
    assert bench.rail.amps == pytest.approx(15e-3)
    bench.wait_s(0.001)
    assert bench.rail.amps == pytest.approx(50e-6)


def test_a_cut_program_clears_a_share_of_its_bits(make_flash_bench):
    bench = make_flash_bench(FlashGeometry())
    program(bench, 0, b"\x0f" * 200, wait=False)
    bench.wait_s(0.64e-3 * 200 / 256 / 2)
    bench.rail.set_volts(0.0)
    page = bench.chip.image.memory[:256]
    cleared = sum((~b & 0xFF).bit_count() for b in page)
    assert 300 < cleared < 500  # of 800
    assert all(b & 0x0F == 0x0F for b in page[:200])  # ones stay ones
    assert page[200:] == b"\xff" * 56
    assert bench.chip.image.memory[256:512] == b"\xff" * 256


@pytest.mark.parametrize(
    ("share", "low", "high"), [(0.15, 0.1, 0.4), (0.3, 0, 0.02), (0.65, 0.4, 0.6)]
)
def test_a_cut_erase_leaves_a_mess(make_flash_bench, share, low, high):
    geometry = FlashGeometry(4, 4096, 256)
    image = FlashImage(bytearray(b"\x55" * geometry.size_bytes))
    bench = make_flash_bench(geometry, image)
    bench.talk(WREN)
    bench.talk(b"\xd8\x00\x10\x00")
    bench.wait_s(0.6 * share)
    bench.rail.set_volts(0.0)
    ones = sum(b.bit_count() for b in image.memory[4096:8192]) / (8 * 4096)
    assert low <= ones <= high
    assert image.memory[:4096] == b"\x55" * 4096
    assert image.memory[8192:] == b"\x55" * 8192


def test_an_image_of_another_size_is_refused(make_flash_bench):
    with pytest.raises(ValueError, match="this chip has 1048576"):
        make_flash_bench(FlashGeometry(), FlashImage(bytearray(10)))


def test_typical_times_are_the_datasheets():
    timing = FlashTiming()
    assert (timing.page_program_s, timing.sector_erase_s, timing.bulk_erase_s) == (0.64e-3, 0.6, 8)


def test_random_bits_have_the_asked_density(bench):
    chip = bench.chip
    chip._rng = random.Random(1)
    for probability in (0.0, 0.1, 0.5, 0.9, 1.0):
        ones = chip._bits(4096, probability).bit_count() / (8 * 4096)
        assert ones == pytest.approx(probability, abs=0.02)
