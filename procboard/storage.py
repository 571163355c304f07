"""The storage controller's log: records on the flash that survive power loss at any moment.

Sectors form a ring. A sector's sequence number counts on for ever, so sector s of the history lies
in physical sector s mod N, wear is spread evenly, and the newest number tells where the log ends.
Its life: erased → SECTOR record (spare) → OPEN record (head) → filled with blocks of records →
given up → erased again. Each step is made certain on the flash before the next one begins, and an
OPEN record names the oldest sector that still counts, so a sector is erased only after the flash
itself says that nothing in it is wanted.

When is a record stored? When its block was programmed, read back, marked as committed, and the
marker was read back. Then, and not before, `on_stored` hears of it. Mounting after any power cut
finds every such record, in order; a record that was not reported may be found or not, but whole.

A sector erase blocks the chip for 0.6 s. It is done ahead, right after the sector before it was
opened, when the buffer has just been emptied; records that come meanwhile wait in RAM.

Full flash: `FullPolicy.STOP` keeps all N sectors and refuses new records with `LogFullError`;
`FullPolicy.OVERWRITE_OLDEST` gives up the oldest sector whenever a new one is opened, so at least
the last N - 2 full sectors stay.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from firmware_model.cpu import Flag
from procboard import log_format as fmt
from procboard.coroutines import Firmware, Lock
from procboard.errors import FlashFailureError, LogFullError, RecordTooLongError
from procboard.log_config import Flash, FullPolicy, LogConfig, LogStatistics

__all__ = ["FullPolicy", "LogConfig", "LogCursor", "LogStatistics", "RecordLog"]

CRC_CYCLES_PER_BYTE: Final = 26
"""CRC-16 without a table on an MSP430, as TinyOS's crcByte: about 13 instructions a byte."""
COPY_CYCLES_PER_BYTE: Final = 5
"""mov.b @Rn+, x(Rm): 5 cycles (SLAU049F, table 3-16)."""
BOOKKEEPING_CYCLES: Final = 200
"""Deciding where a block goes: about 60 instructions (estimate)."""

_PROGRAM_ATTEMPTS: Final = 8
_NO_SECTOR: Final = -1


def _ignore(_sequence: int) -> None:
    """Stand in where nobody listens."""


class RecordLog:
    """The log. `mount` first; then any task may append, one storage task flushes and prepares."""

    def __init__(
        self,
        flash: Flash,
        config: LogConfig | None = None,
        on_stored: Callable[[int], None] = _ignore,
    ) -> None:
        self.config = config or LogConfig()
        self.on_stored = on_stored
        """Called with n when every record up to and including number n is stored."""
        self.statistics = LogStatistics()
        self.next_sequence = 0
        self.stored_sequence = -1
        """Number of the last stored record; -1 where there is none."""
        self.pending = Flag("log: records are waiting")
        """Set when the first record comes into an empty buffer."""
        self.page_full = Flag("log: a page's worth is waiting")
        self._flash = flash
        self._lock = Lock("log: flash free")
        self._pages = self.config.sector_bytes // self.config.page_bytes
        self._buffer: list[tuple[int, bytes]] = []
        self._buffered_bytes = 0
        self._erase_counts: list[int | None] = [None] * self.config.sector_count
        self._head = _NO_SECTOR  # sector sequence that takes records
        self._spare = False  # sector head + 1 is erased and has its SECTOR record
        self._oldest_sector = 0
        self._oldest_record = 0
        self._control_offset = 0
        self._page = self._pages  # where the next block goes
        self._offset = 0

    # --- mounting ---------------------------------------------------------------------

    def mount(self) -> Firmware[None]:
        """Find the log on the flash: reads only, whatever the flash holds."""
        self.statistics = LogStatistics()
        self._buffer.clear()
        self._buffered_bytes = 0
        found: list[int] = []
        for index in range(self.config.sector_count):
            head = yield from self._read(index, 0, 0, fmt.SECTOR_BLOCK_BYTES)
            sector = fmt.decode_sector(fmt.read_page(head))
            if sector is not None and sector.sequence % self.config.sector_count == index:
                self._erase_counts[index] = sector.erase_count
                found.append(sector.sequence)
        found.sort()
        self._head = _NO_SECTOR
        self._spare = False
        self._page = self._pages
        self.next_sequence = self._oldest_record = self._oldest_sector = 0
        clean = _NO_SECTOR  # newest sector that is erased but for its SECTOR record
        for sequence in reversed(found):
            page = yield from self._read_page(sequence, 0)
            opened = fmt.decode_open(page)
            if opened is not None:
                yield from self._mount_head(opened, page)
                break
            if page.free_offset == fmt.SECTOR_BLOCK_BYTES:
                clean = sequence
        else:
            if clean != _NO_SECTOR:  # erased, never opened: the log starts there
                self._head = clean - 1
                self._oldest_sector = clean
        self._spare = clean != _NO_SECTOR and clean == self._head + 1
        self.stored_sequence = self.next_sequence - 1

    def _mount_head(self, opened: fmt.OpenRecord, control: fmt.PageContents) -> Firmware[None]:
        """Find where the head sector's records end."""
        self._head = opened.sequence
        self._oldest_sector = opened.oldest_sector
        self._oldest_record = opened.oldest_record
        self._control_offset = control.free_offset
        self.next_sequence = opened.next_record
        last, contents = 0, control
        # Pages are filled in order and a page that is wholly erased is always used next, so the
        # first one marks the end. A torn page can look erased at its beginning.
        page = 1
        while page < self._pages:
            beginning = yield from self._read(self._head, page, 0, fmt.BLOCK_HEADER_BYTES)
            if fmt.is_erased(beginning):
                whole = yield from self._read(self._head, page, 0, self.config.page_bytes)
                if fmt.is_erased(whole):
                    break
            page += 1
        self._page, self._offset = page, 0
        last = page - 1
        while last >= 1:
            contents = yield from self._read_page(self._head, last)
            if last == page - 1:
                self.statistics.torn_pages += contents.torn
                if contents.free_offset + self._least_block() <= self.config.page_bytes:
                    self._page, self._offset = last, contents.free_offset
            if contents.records:
                self.next_sequence = contents.records[-1].sequence + 1
                break
            last -= 1

    # --- appending --------------------------------------------------------------------

    def append(self, payload: bytes) -> Firmware[int]:
        """Buffer a record and return its number; waits where the buffer is full.

        Raises:
            RecordTooLongError: it does not fit a page.
            LogFullError: the flash is full and the policy is to stop.

        """
        if len(payload) > self.config.max_payload_bytes:
            raise RecordTooLongError(
                f"record of {len(payload)} bytes: at most {self.config.max_payload_bytes} fit"
            )
        size = len(payload) + fmt.RECORD_HEADER_BYTES
        yield COPY_CYCLES_PER_BYTE * size + CRC_CYCLES_PER_BYTE * size
        while self._buffered_bytes + size > self.config.buffer_bytes and self._buffer:
            yield from self.flush()
        if self.config.policy is FullPolicy.STOP and self._free_pages() <= len(self._buffer):
            # Each waiting record might need a page of its own: know exactly.
            yield from self.flush()
            room = self.config.page_bytes - self._offset - fmt.BLOCK_HEADER_BYTES
            fits_page = self._page < self._pages and size <= room
            if not fits_page and not self._free_pages():
                self.statistics.rejected += 1
                raise LogFullError("the flash is full, and its policy is to keep the oldest")
        sequence = self.next_sequence
        self.next_sequence = sequence + 1
        if not self._buffer:
            self.pending.set()
        self._buffer.append((sequence, fmt.encode_record(sequence, payload)))
        self._buffered_bytes += size
        self.statistics.appended += 1
        if self.page_waits:
            self.page_full.set()
        return sequence

    @property
    def page_waits(self) -> bool:
        """Whether another record like the last would no longer fit the page being filled."""
        if not self._buffer:
            return False
        begun = self._offset if self._page < self._pages else 0
        room = self.config.page_bytes - begun - fmt.BLOCK_HEADER_BYTES
        return self._buffered_bytes + len(self._buffer[-1][1]) > room

    @property
    def buffered(self) -> int:
        """Records that wait in RAM."""
        return len(self._buffer)

    def flush(self) -> Firmware[None]:
        """Store every record that was appended before the call.

        Raises:
            LogFullError: no room was left; the records that did not fit are dropped and counted.
            FlashFailureError: the flash does not keep what is programmed.

        """
        last = self.next_sequence - 1
        yield from self._lock.acquire()
        try:
            while self._buffer and self._buffer[0][0] <= last:
                yield from self._commit()
        except LogFullError:
            self.statistics.rejected += len(self._buffer)
            self.next_sequence = self._buffer[0][0]
            self._buffer.clear()
            self._buffered_bytes = 0
            raise
        finally:
            self._lock.release()

    def prepare(self) -> Firmware[None]:
        """Erase the next sector ahead, where there is one to erase and none is ready."""
        yield from self._lock.acquire()
        try:
            if not self._spare and self._head != _NO_SECTOR and self._next_is_free():
                yield from self._make_spare()
        finally:
            self._lock.release()

    @property
    def wants_preparing(self) -> bool:
        """Whether `prepare` has something to do."""
        return not self._spare and self._head != _NO_SECTOR and self._next_is_free()

    def clear(self) -> Firmware[None]:
        """Give up every stored record, after a download: one commit, no erase."""
        yield from self._lock.acquire()
        try:
            if self._head == _NO_SECTOR or self.stored_sequence < self._oldest_record:
                return
            oldest = self.stored_sequence + 1
            self._oldest_record = oldest
            if self._control_offset + fmt.OPEN_BLOCK_BYTES > self.config.page_bytes:
                self._oldest_sector = self._head + 1
                yield from self._advance()
            else:
                self._oldest_sector = self._head
                yield from self._write_open()
        finally:
            self._lock.release()

    # --- writing ----------------------------------------------------------------------

    def _commit(self) -> Firmware[None]:
        """Write one block: as many waiting records as the page takes."""
        config = self.config
        yield BOOKKEEPING_CYCLES
        for _attempt in range(_PROGRAM_ATTEMPTS):
            if self._page >= self._pages:
                yield from self._advance()
            room = config.page_bytes - self._offset - fmt.BLOCK_HEADER_BYTES
            count = 0
            body = b""
            for _sequence, encoded in self._buffer:
                if len(encoded) > room:
                    break
                room -= len(encoded)
                body += encoded
                count += 1
            if not count:
                self._page, self._offset = self._page + 1, 0
                continue
            good = yield from self._write_block(self._head, self._page, self._offset, body)
            if good:
                self._offset += fmt.BLOCK_HEADER_BYTES + len(body)
                if self._offset + self._least_block() > config.page_bytes:
                    self._page, self._offset = self._page + 1, 0
                last = self._buffer[count - 1][0]
                del self._buffer[:count]
                self._buffered_bytes -= len(body)
                self.stored_sequence = last
                self.statistics.stored += count
                self.statistics.blocks += 1
                self.on_stored(last)
                return
            self.statistics.program_failures += 1
            self._page, self._offset = self._page + 1, 0
        raise FlashFailureError(f"{_PROGRAM_ATTEMPTS} pages in a row did not keep their contents")

    def _write_block(self, sector: int, page: int, offset: int, body: bytes) -> Firmware[bool]:
        """Program, read back, mark, read back; return whether all of it holds."""
        address = self._address(sector, page) + offset
        data = bytes((len(body),)) + body
        yield from self._flash.program(address + 1, data)
        written = yield from self._flash.read(address + 1, len(data))
        yield COPY_CYCLES_PER_BYTE * len(data)
        if written != data:
            return False
        yield from self._flash.program(address, bytes((fmt.COMMITTED,)))
        marker = yield from self._flash.read(address, 1)
        return marker[0] == fmt.COMMITTED

    def _write_open(self) -> Firmware[None]:
        """Commit an OPEN record in the head's control page."""
        record = fmt.OpenRecord(
            self._head, self._oldest_sector, self._oldest_record, self.stored_sequence + 1
        )
        body = fmt.encode_open(record)
        good = yield from self._write_block(self._head, 0, self._control_offset, body)
        if not good:
            raise FlashFailureError(f"control page of sector {self._head} does not keep its bits")
        self._control_offset += fmt.OPEN_BLOCK_BYTES

    def _next_is_free(self) -> bool:
        """Whether the physical sector after the head holds nothing that still counts."""
        return self._head + 1 - self.config.sector_count < self._oldest_sector

    def _free_pages(self) -> int:
        """Pages that can still be filled without giving anything up, beyond the current one."""
        current = max(0, self._pages - self._page - (self._offset > 0))
        if self._head == _NO_SECTOR:
            return self.config.sector_count * (self._pages - 1)
        live = self._head - self._oldest_sector + 1
        return current + (self.config.sector_count - live) * (self._pages - 1)

    def _advance(self) -> Firmware[None]:
        """Open the next sector of the ring."""
        if not self._spare:
            if self._head != _NO_SECTOR and not self._next_is_free():
                if self.config.policy is FullPolicy.STOP:
                    raise LogFullError("the flash is full, and its policy is to keep the oldest")
                # Only after a change of policy: say on the flash that the oldest is given up.
                self._oldest_sector = self._head + 2 - self.config.sector_count
                yield from self._write_open()
            yield from self._make_spare()
        self._head += 1
        self._spare = False
        if self.config.policy is FullPolicy.OVERWRITE_OLDEST:
            oldest = self._head + 2 - self.config.sector_count
            self._oldest_sector = max(self._oldest_sector, oldest)
        self._control_offset = fmt.SECTOR_BLOCK_BYTES
        yield from self._write_open()
        self._page, self._offset = 1, 0

    def _make_spare(self) -> Firmware[None]:
        """Erase the sector after the head and give it its number."""
        sequence = self._head + 1
        index = sequence % self.config.sector_count
        known = [count for count in self._erase_counts if count is not None]
        erased_before = self._erase_counts[index]
        if erased_before is None:
            erased_before = max(known, default=0)
        yield from self._flash.erase_sector(self._address(sequence, 0))
        self.statistics.sectors_erased += 1
        self._erase_counts[index] = erased_before + 1
        body = fmt.encode_sector(fmt.SectorRecord(sequence, erased_before + 1))
        if not (yield from self._write_block(sequence, 0, 0, body)):
            raise FlashFailureError(f"sector {index} does not keep its bits")
        self._spare = True

    # --- reading ----------------------------------------------------------------------

    def cursor(self) -> LogCursor:
        """Return an iterator from the oldest record, for a download."""
        return LogCursor(self)

    def read(self, number: int) -> Firmware[bytes | None]:
        """Return a stored record's payload; None where the flash does not have it any more.

        Pages have rising numbers, so the page is found by halving what is left.
        """
        if not self._oldest_record <= number <= self.stored_sequence:
            return None
        best, end = self._page_range()
        low = best
        while end - low > 1:
            middle = probe = (low + end) // 2
            first = None
            while first is None and probe > low:  # pages that were torn hold nothing
                first = yield from self._first_in_page(probe)
                probe -= first is None
            if first is not None and first > number:
                end = probe
            else:
                low = middle
                best = best if first is None else probe
        page = yield from self._read_page(*self._place(best))
        return next((r.payload for r in page.records if r.sequence == number), None)

    def oldest(self) -> Firmware[int]:
        """Return the number of the oldest record on the flash; the next one's where none is."""
        low, end = self._page_range()
        for page in range(low, end):
            first = yield from self._first_in_page(page)
            if first is not None:
                return max(first, self._oldest_record)
        return self.stored_sequence + 1

    def _page_range(self) -> tuple[int, int]:
        """First page that counts and the one after the last, pages for records counted through."""
        if self._head == _NO_SECTOR:
            return 0, 0
        oldest, head, end, _ = self.extent
        return oldest * (self._pages - 1), head * (self._pages - 1) + end - 1

    def _place(self, page: int) -> tuple[int, int]:
        """Sector and page of a page counted through."""
        sector, before = divmod(page, self._pages - 1)
        return sector, before + 1

    def _first_in_page(self, page: int) -> Firmware[int | None]:
        """Number of a page's first record; None where its first block was not committed."""
        count = fmt.BLOCK_HEADER_BYTES + fmt.RECORD_HEADER_BYTES
        head = yield from self._read(*self._place(page), 0, count)
        return fmt.first_sequence(head)

    def _least_block(self) -> int:
        return fmt.BLOCK_HEADER_BYTES + fmt.RECORD_HEADER_BYTES

    def _address(self, sector: int, page: int) -> int:
        config = self.config
        return sector % config.sector_count * config.sector_bytes + page * config.page_bytes

    def _read(self, sector: int, page: int, offset: int, count: int) -> Firmware[bytes]:
        return (yield from self._flash.read(self._address(sector, page) + offset, count))

    def _read_page(self, sector: int, page: int) -> Firmware[fmt.PageContents]:
        data = yield from self._read(sector, page, 0, self.config.page_bytes)
        yield CRC_CYCLES_PER_BYTE * len(data)
        return fmt.read_page(data)

    @property
    def extent(self) -> tuple[int, int, int, int]:
        """Oldest sector, head sector, first page of the head not to read, oldest record."""
        end = self._page + (self._offset > 0)
        return self._oldest_sector, self._head, end, self._oldest_record


class LogCursor:
    """Reads stored records page by page, in order, while new ones may be appended."""

    def __init__(self, log: RecordLog) -> None:
        self._log = log
        self._sector, _head, _end, self._next_record = log.extent
        self._page = 1

    def read(self) -> Firmware[tuple[fmt.Record, ...]]:
        """Return the next page's records that were not read before; empty at the end."""
        log = self._log
        while True:
            oldest, head, end, oldest_record = log.extent
            if self._sector < oldest:  # overwritten while reading
                self._sector, self._page = oldest, 1
            if self._sector > head or (self._sector == head and self._page >= end):
                return ()
            if self._page * log.config.page_bytes >= log.config.sector_bytes:
                self._sector, self._page = self._sector + 1, 1
                continue
            page = yield from log._read_page(self._sector, self._page)
            log.statistics.corrupt_records += page.corrupt
            first = max(self._next_record, oldest_record)
            records = tuple(
                r
                for r in page.records
                if r.kind == fmt.Kind.DATA and first <= r.sequence <= log.stored_sequence
            )
            if self._sector < head or self._page + 1 < end:
                self._page += 1
            elif not records:
                return ()  # the page that is being filled has nothing new
            if records:
                self._next_record = records[-1].sequence + 1
                return records
