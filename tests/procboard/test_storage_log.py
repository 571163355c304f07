"""The storage log: what is reported as stored is there after any power cut, whole and in order."""

import copy
import random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from procboard import log_format as fmt
from procboard.chips.m25p80 import FlashGeometry, FlashImage
from procboard.errors import FlashFailureError, LogFullError, RecordTooLongError
from procboard.log_image import recover_records
from procboard.storage import FullPolicy, LogConfig, RecordLog

SMALL = FlashGeometry(sector_count=4, sector_bytes=512, page_bytes=128)


def config(policy=FullPolicy.OVERWRITE_OLDEST, geometry=SMALL, **more):
    return LogConfig(
        geometry.sector_count,
        geometry.sector_bytes,
        geometry.page_bytes,
        policy=policy,
        buffer_bytes=300,
        **more,
    )


def payload(number, size=20):
    return random.Random(number).randbytes(size)


class Ledger:
    """What was appended, and what the log has reported as stored; also in which sector."""

    def __init__(self):
        self.appended = {}
        self.stored = -1
        self.sector_of = {}

    def open(self, bench, log_config, ledger_check=True):
        log = RecordLog(bench.driver, log_config)
        bench.run(log.mount())
        log.on_stored = lambda sequence: self.note(log, sequence)
        return log

    def note(self, log, sequence):
        for number in range(self.stored + 1, sequence + 1):
            self.sector_of[number] = log._head
        self.stored = sequence

    def check(self, records, sector_count=4, lowest=None):
        """Every record that was reported and not given up is there, in order, none corrupted."""
        numbers = [r.sequence for r in records]
        assert numbers == list(range(numbers[0], numbers[-1] + 1)) if numbers else True
        for record in records:
            assert record.payload == self.appended[record.sequence]
        if self.stored < 0:
            return
        if lowest is None:
            head = self.sector_of[self.stored]
            kept = [n for n, s in self.sector_of.items() if s >= head + 3 - sector_count]
            lowest = min(kept)
        if self.stored >= lowest:
            assert numbers, f"nothing left of {lowest}..{self.stored}"
            assert numbers[0] <= lowest
            assert numbers[-1] >= self.stored


def fill(bench, log, ledger, numbers, size=20, batch=3):
    for number in numbers:
        ledger.appended[number] = payload(number, size)
        assert bench.run(log.append(ledger.appended[number])) == number
        if number % batch == batch - 1:
            bench.run(log.flush())
            bench.run(log.prepare())
    bench.run(log.flush())


def read_all(bench, log):
    cursor = log.cursor()
    records = []
    while page := bench.run(cursor.read()):
        records.extend(page)
    return records


def test_check_value_of_the_crc():
    assert fmt.crc16(b"123456789") == 0x29B1  # CRC RevEng catalogue, CRC-16/IBM-3740


def test_what_is_appended_is_read_back_after_mounting(make_flash_bench):
    bench = make_flash_bench(SMALL)
    ledger = Ledger()
    log = ledger.open(bench, config())
    fill(bench, log, ledger, range(12))
    assert ledger.stored == 11
    again = RecordLog(bench.driver, config())
    bench.run(again.mount())
    records = read_all(bench, again)
    assert [r.sequence for r in records] == list(range(12))
    assert records == read_all(bench, log) == recover_records(bench.chip.image.memory, config())
    assert again.next_sequence == 12


def test_a_record_counts_as_stored_only_once_it_is(make_flash_bench):
    bench = make_flash_bench(SMALL)
    log = RecordLog(bench.driver, config())
    bench.run(log.mount())
    seen = []
    log.on_stored = seen.append
    for n in range(3):
        bench.run(log.append(payload(n)))
    assert (seen, log.buffered, log.stored_sequence) == ([], 3, -1)
    assert recover_records(bench.chip.image.memory, config()) == []
    bench.run(log.flush())
    assert (seen, log.buffered, log.stored_sequence) == ([2], 0, 2)  # three records, one block
    assert log.statistics.blocks == 1


def test_blocks_share_a_page(make_flash_bench):
    bench = make_flash_bench(SMALL)
    ledger = Ledger()
    log = ledger.open(bench, config())
    fill(bench, log, ledger, range(3), batch=1)
    assert log.statistics.blocks == 3
    assert log._page == 1  # 3 × (2 + 8 + 20) bytes of 128


def test_records_are_read_by_number_while_others_are_written_and_overwritten(make_flash_bench):
    bench = make_flash_bench(SMALL)
    ledger = Ledger()
    log = ledger.open(bench, config())
    for start in range(0, 90, 5):
        fill(bench, log, ledger, range(start, start + 5))
        there = {r.sequence: r.payload for r in read_all(bench, log)}
        assert {n: bench.run(log.read(n)) for n in there} == there
        assert bench.run(log.oldest()) == min(there)
        assert bench.run(log.read(min(there) - 1)) is None
    assert min(there) > 0


def test_a_record_is_found_with_few_readings(make_flash_bench):
    bench = make_flash_bench(FlashGeometry(sector_count=4, sector_bytes=16_384, page_bytes=128))
    shape = config(geometry=bench.chip.geometry)
    log = RecordLog(bench.driver, shape)
    bench.run(log.mount())
    for n in range(600):
        bench.run(log.append(payload(n)))
    bench.run(log.flush())
    readings = []
    read = bench.driver.read
    bench.driver.read = lambda *asked: readings.append(asked) or read(*asked)
    assert bench.run(log.read(345)) == payload(345)
    assert len(readings) <= 9  # 150 pages of four: eight halvings and the page


@pytest.mark.parametrize("torn", range(1, 8))
def test_torn_pages_hide_no_others(make_flash_bench, torn):
    bench = make_flash_bench(FlashGeometry(sector_count=3, sector_bytes=2048, page_bytes=128))
    log = RecordLog(bench.driver, config(geometry=bench.chip.geometry))
    bench.run(log.mount())
    for n in range(60):
        bench.run(log.append(payload(n)))
    bench.run(log.flush())
    for page in range(torn, torn + 3):
        bench.chip.image.memory[page * 128] = fmt.ERASED  # as if the marker had never come
    there = {r.sequence: r.payload for r in read_all(bench, log)}
    assert 40 < len(there) < 60
    assert {n: p for n in range(60) if (p := bench.run(log.read(n))) is not None} == there
    assert bench.run(log.oldest()) == min(there)


def test_a_record_has_to_fit_a_page(make_flash_bench):
    bench = make_flash_bench(SMALL)
    log = RecordLog(bench.driver, config())
    bench.run(log.mount())
    bench.run(log.append(bytes(118)))
    with pytest.raises(RecordTooLongError, match="at most 118"):
        bench.run(log.append(bytes(119)))
    bench.run(log.flush())
    assert read_all(bench, log)[0].payload == bytes(118)


def test_overwriting_keeps_the_newest_and_spreads_wear(make_flash_bench):
    bench = make_flash_bench(SMALL)
    ledger = Ledger()
    log = ledger.open(bench, config())
    fill(bench, log, ledger, range(300))
    records = read_all(bench, log)
    ledger.check(records)
    assert records[-1].sequence == 299
    assert len(records) >= 2 * 9  # two full sectors of three pages of three records
    counts = bench.chip.image.erase_counts
    assert max(counts) - min(counts) <= 1
    assert sum(counts) == log.statistics.sectors_erased


def test_stop_keeps_the_oldest_and_says_so(make_flash_bench):
    bench = make_flash_bench(SMALL)
    ledger = Ledger()
    log = ledger.open(bench, config(FullPolicy.STOP))
    with pytest.raises(LogFullError):
        fill(bench, log, ledger, range(300))
    capacity = 4 * 3 * 4  # sectors × pages × records of 28 bytes (+ 2 a block) in 128 bytes
    assert capacity * 0.7 < log.next_sequence <= capacity
    assert [r.sequence for r in read_all(bench, log)] == list(range(log.next_sequence))
    assert ledger.stored == log.next_sequence - 1
    assert log.statistics.rejected == 1
    again = ledger.open(bench, config(FullPolicy.STOP))
    with pytest.raises(LogFullError):
        bench.run(again.append(payload(1)))
    assert [r.sequence for r in read_all(bench, again)] == list(range(log.next_sequence))


def test_a_full_log_takes_records_again_after_clear(make_flash_bench):
    bench = make_flash_bench(SMALL)
    ledger = Ledger()
    log = ledger.open(bench, config(FullPolicy.STOP))
    with pytest.raises(LogFullError):
        fill(bench, log, ledger, range(300))
    bench.run(log.clear())
    assert read_all(bench, log) == []
    first = log.next_sequence
    fill(bench, log, ledger, range(first, first + 5))
    assert [r.sequence for r in read_all(bench, log)] == list(range(first, first + 5))
    again = ledger.open(bench, config(FullPolicy.STOP))
    assert [r.sequence for r in read_all(bench, again)] == list(range(first, first + 5))


def test_a_full_log_goes_on_when_the_policy_is_changed(make_flash_bench):
    bench = make_flash_bench(SMALL)
    ledger = Ledger()
    with pytest.raises(LogFullError):
        fill(bench, ledger.open(bench, config(FullPolicy.STOP)), ledger, range(300))
    log = ledger.open(bench, config())
    fill(bench, log, ledger, range(log.next_sequence, log.next_sequence + 30))
    ledger.check(read_all(bench, log))
    ledger.check(recover_records(bench.chip.image.memory, config()))


def test_a_cursor_follows_the_log_and_jumps_over_what_is_overwritten(make_flash_bench):
    bench = make_flash_bench(SMALL)
    ledger = Ledger()
    log = ledger.open(bench, config())
    fill(bench, log, ledger, range(4))
    cursor = log.cursor()
    seen = [r.sequence for r in bench.run(cursor.read())]
    fill(bench, log, ledger, range(4, 200))
    while page := bench.run(cursor.read()):
        seen += [r.sequence for r in page]
    assert seen[-1] == 199
    assert seen == sorted(set(seen))
    assert bench.run(cursor.read()) == ()
    fill(bench, log, ledger, range(200, 201))
    assert [r.sequence for r in bench.run(cursor.read())] == [200]


def test_the_next_sector_is_erased_ahead(make_flash_bench):
    bench = make_flash_bench(SMALL)
    ledger = Ledger()
    log = ledger.open(bench, config())
    fill(bench, log, ledger, range(3))
    assert not log.wants_preparing  # `fill` prepares after its flush
    erased = log.statistics.sectors_erased
    longest = 0
    for number in range(3, 14):
        ledger.appended[number] = payload(number)
        start = bench.scheduler.now
        bench.run(log.append(ledger.appended[number]))
        bench.run(log.flush())
        longest = max(longest, bench.scheduler.now - start)
    assert log._head == 1
    assert log.statistics.sectors_erased == erased
    assert longest < 20e12  # 20 ms, though a sector was opened
    assert log.wants_preparing


def test_a_page_that_does_not_keep_its_bits_is_left_out(make_flash_bench):
    image = FlashImage.blank(SMALL)
    bench = make_flash_bench(SMALL, image)
    ledger = Ledger()
    log = ledger.open(bench, config())
    fill(bench, log, ledger, range(1))
    image.memory[log._page * 128 + log._offset + 9] = 0  # a cell that will not be as asked
    fill(bench, log, ledger, range(1, 4))
    assert log.statistics.program_failures == 1
    assert [r.sequence for r in read_all(bench, log)] == [0, 1, 2, 3]
    assert [r.sequence for r in recover_records(image.memory, config())] == [0, 1, 2, 3]


def test_a_dead_flash_is_reported(make_flash_bench):
    bench = make_flash_bench(SMALL)
    log = RecordLog(bench.driver, config())
    bench.run(log.mount())
    bench.run(log.append(b"x"))
    bench.chip.image.status = 0x1C  # all protected
    with pytest.raises(FlashFailureError):
        bench.run(log.flush())


def test_a_worn_cell_costs_its_record_only(make_flash_bench):
    bench = make_flash_bench(SMALL)
    ledger = Ledger()
    log = ledger.open(bench, config())
    fill(bench, log, ledger, range(9))
    bench.chip.image.memory[128 + 2 + 28 + 15] ^= 0x10  # payload of record 1
    again = ledger.open(bench, config())
    assert [r.sequence for r in read_all(bench, again)] == [0, 2, 3, 4, 5, 6, 7, 8]
    assert again.statistics.corrupt_records == 1


def cut_here(bench, seed):
    """Return the flash contents that a power cut at this moment leaves; the bench goes on."""
    scheduler, rail, chip = copy.deepcopy((bench.scheduler, bench.rail, bench.chip))
    assert chip._scheduler is scheduler
    chip._rng = random.Random(seed)
    rail.set_volts(0.0)
    return chip.image.memory


@pytest.mark.parametrize("policy", list(FullPolicy))
def test_power_cut_at_every_step(make_flash_bench, policy):
    """Exhaustive: after every byte, edge and part of a cycle, from the blank chip to the full."""
    bench = make_flash_bench(SMALL, wait_steps=6)
    ledger = Ledger()
    log = ledger.open(bench, config(policy))
    images = {}  # contents after a cut → what had been reported by then

    def look():
        for seed in range(2 if bench.chip.busy else 1):
            image = bytes(cut_here(bench, 1000 * bench.steps + seed))
            images[image] = (ledger.stored, dict(ledger.sector_of))

    bench.on_step = look
    count = 60 if policy is FullPolicy.OVERWRITE_OLDEST else 300
    try:
        fill(bench, log, ledger, range(count))
    except LogFullError:
        assert policy is FullPolicy.STOP
    bench.on_step = lambda: None
    assert bench.steps > 3000
    assert len(images) > 500
    for image, (stored, sector_of) in images.items():
        ledger.stored, ledger.sector_of = stored, sector_of
        records = recover_records(image, config(policy))
        ledger.check(records, lowest=0 if policy is FullPolicy.STOP else None)


def test_after_every_cut_the_log_takes_new_records(make_flash_bench):
    """As above, and then the log is mounted by the driver, written and mounted again."""
    bench = make_flash_bench(SMALL, wait_steps=4)
    ledger = Ledger()
    log = ledger.open(bench, config())
    images = {}

    def look():
        if bench.chip.busy:
            images[bytes(cut_here(bench, bench.steps))] = (ledger.stored, dict(ledger.sector_of))

    bench.on_step = look
    fill(bench, log, ledger, range(45), batch=2)
    appended = ledger.appended
    for image, (stored, sector_of) in images.items():
        after = make_flash_bench(SMALL, FlashImage(bytearray(image)), wait_steps=1)
        ledger.stored, ledger.sector_of, ledger.appended = stored, dict(sector_of), dict(appended)
        log = ledger.open(after, config())
        ledger.check(read_all(after, log))
        first = log.next_sequence
        assert first > stored
        fill(after, log, ledger, range(first, first + 4), batch=2)
        assert ledger.stored == first + 3
        ledger.check(recover_records(after.chip.image.memory, config()))


@settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    policy=st.sampled_from(list(FullPolicy)),
    lives=st.lists(
        st.tuples(
            st.integers(1, 4000),  # step at which the supply is cut
            st.lists(
                st.one_of(
                    st.integers(0, 118),  # append so many bytes
                    st.sampled_from(["flush", "prepare", "clear"]),
                ),
                max_size=40,
            ),
        ),
        min_size=1,
        max_size=6,
    ),
    seed=st.integers(0, 1 << 20),
)
def test_many_lives_and_deaths(make_flash_bench, power_lost, policy, lives, seed):
    """Any work, cut anywhere, any number of times over: the promise holds each time."""
    image = FlashImage.blank(SMALL)
    promised = {}  # reported as stored and not given up
    limbo = {}  # appended, not reported: may be there or not
    given_up = 0  # numbers below may be gone
    for cut_at, work in lives:
        bench = make_flash_bench(SMALL, image, seed=seed)
        log = RecordLog(bench.driver, config(policy))
        bench.run(log.mount())
        records = read_all(bench, log)
        assert log.statistics.corrupt_records == 0
        found = {r.sequence: r.payload for r in records}
        numbers = list(found)
        assert not numbers or numbers == list(range(numbers[0], numbers[-1] + 1))
        for number in range(log.next_sequence + 1):  # one by one as in a row
            assert bench.run(log.read(number)) == found.get(number)
        assert bench.run(log.oldest()) == min(found, default=log.next_sequence)
        wanted = {n: p for n, p in promised.items() if n >= given_up}
        if policy is FullPolicy.STOP:
            assert wanted.items() <= found.items()
        elif wanted:
            # Of what was promised only whole old sectors may be gone: two full ones remain.
            assert max(wanted) in found
            assert len(found.keys() & wanted.keys()) == len([n for n in wanted if n >= numbers[0]])
        known = {**promised, **limbo}
        assert all(known[n] == p for n, p in found.items())
        promised, limbo = dict(found), {}
        assert log.next_sequence == max(numbers, default=log.next_sequence - 1) + 1

        def stored(last, limbo=limbo, promised=promised):
            for number in sorted(limbo):
                if number <= last:
                    promised[number] = limbo.pop(number)

        log.on_stored = stored
        bench.cut_at = cut_at
        clearing = False
        try:
            for item in work:
                if item == "clear":
                    clearing = True
                    bench.run(log.clear())
                    given_up, clearing = log._oldest_record, False
                elif isinstance(item, str):
                    bench.run(getattr(log, item)())
                else:
                    number, data = log.next_sequence, random.Random(item).randbytes(item)
                    limbo[number] = data
                    try:
                        assert bench.run(log.append(data)) == number
                    except LogFullError:
                        del limbo[number]
                        assert policy is FullPolicy.STOP
        except power_lost:
            if clearing:
                given_up = log.stored_sequence + 1
        else:
            bench.rail.set_volts(0.0)
