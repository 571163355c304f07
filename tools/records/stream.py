"""The files that grow while a run goes on: spi.vcd and radio.pcap, fed from the trace.

Channels that are looked for (they must be there before the run), and the values of their records:

- `spi`: `("byte", bit_period_fs, mosi, miso)` at the start of the byte's first bit, `("cs", level)`
  and `("ready", level)`;
- `wire.NAME`: 0 or 1, further pins to be drawn beside them;
- `radio`: `(start_fs, channel, source, power_dbm, psdu)` at the end of the frame, as the medium
  records it; the PSDU has its FCS.

A block holds records of one channel in the order in which they were made. A byte is recorded when
it is complete, so a level that changed during it stands before it in the block; frames that collide
may end in another order than they began. Both are put in order of time here, with a window that is
longer than any byte and any frame.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from types import TracebackType
from typing import TYPE_CHECKING, Any, BinaryIO

from radio_802154 import pcap
from tools.errors import RunFolderError
from tools.records.vcd import VcdWriter

if TYPE_CHECKING:
    from firmware_model.trace import Record, Trace
    from tools.records.folder import RunFolder

SPI, RADIO, WIRE = "spi", "radio", "wire."
LINK_WIRES = (("CS", 1), ("READY", 0))
"""Their levels at rest: chip select is active low, data ready is active high."""

WINDOW_FS = 10**13
"""10 ms: longer than the longest frame in the air (133 bytes of 32 µs), and any byte on wires."""


class StreamedFiles:
    """Context manager that attaches to a trace and closes the files with it."""

    def __init__(self, trace: Trace, folder: RunFolder) -> None:
        self._trace = trace
        self._folder = folder
        self._files = contextlib.ExitStack()
        self._spi: list[tuple[int, Any]] = []
        self._frames: list[tuple[int, Any]] = []
        self._end_fs = 0

    def __enter__(self) -> StreamedFiles:
        names = self._trace.names()
        pins = [name for name in names if name.startswith(WIRE)]
        try:
            text = self._files.enter_context(
                self._folder.file("spi.vcd").open("w", encoding="ascii", newline="\n")
            )
            self._pcap: BinaryIO = self._files.enter_context(
                self._folder.file("radio.pcap").open("wb")
            )
        except OSError as error:
            raise self._wrong(error) from error
        wires = [*LINK_WIRES, *((pin.removeprefix(WIRE), 0) for pin in pins)]
        self._vcd = VcdWriter(text, wires)
        self._pins = [self._trace.channel(pin) for pin in pins]
        for channel, pin in zip(self._pins, pins, strict=True):
            channel.sink(self._pin_sink(pin.removeprefix(WIRE)))
        # Only what is there: to make a channel here would change the trace's hash.
        self._attached = [name for name in (SPI, RADIO) if name in names]
        sinks = {SPI: self._spi_block, RADIO: self._radio_block}
        for name in self._attached:
            self._trace.channel(name).sink(sinks[name])
        self._pcap.write(pcap.global_header())
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            with self._files:
                if error is None:
                    self._finish()
        except OSError as fault:
            raise self._wrong(fault) from fault

    def _finish(self) -> None:
        """Write what is still held back."""
        self._trace.flush()
        names = self._trace.names()
        if [name for name in (SPI, RADIO) if name in names] != self._attached:
            raise RuntimeError("a channel was made after the files were attached to it")
        self._write_spi(self._end_fs + WINDOW_FS)
        self._write_radio(self._end_fs + WINDOW_FS)
        self._vcd.close(self._end_fs)

    def _wrong(self, error: OSError) -> RunFolderError:
        return RunFolderError(f"{self._folder.path}: cannot be written: {error.strerror}")

    def _pin_sink(self, wire: str) -> Callable[[list[Record]], None]:
        def sink(block: list[Record]) -> None:
            for time_fs, level in block:
                self._vcd.level(time_fs, wire, 1 if level else 0)
            self._end_fs = max(self._end_fs, block[-1][0])

        return sink

    def _spi_block(self, block: list[Record]) -> None:
        # Pins first: what happened on them up to now must be there before the bytes pass it.
        for channel in self._pins:
            channel.flush()
        self._spi += block
        self._end_fs = max(self._end_fs, block[-1][0])
        self._write_spi(block[-1][0] - WINDOW_FS)

    def _write_spi(self, until_fs: int) -> None:
        vcd = self._vcd
        done, self._spi = _split(self._spi, until_fs)
        # Levels first: the writer holds them until a byte passes them.
        for time_fs, value in done:
            if value[0] != "byte":
                vcd.level(time_fs, value[0].upper(), value[1])
        for time_fs, value in done:
            if value[0] == "byte":
                _, period_fs, mosi, miso = value
                vcd.byte(time_fs, period_fs, mosi, miso)
                self._end_fs = max(self._end_fs, time_fs + 9 * period_fs)

    def _radio_block(self, block: list[Any]) -> None:
        self._frames += [(value[0], (end_fs, *value[1:])) for end_fs, value in block]
        self._end_fs = max(self._end_fs, block[-1][0])
        self._write_radio(block[-1][0] - WINDOW_FS)

    def _write_radio(self, until_fs: int) -> None:
        done, self._frames = _split(self._frames, until_fs)
        self._pcap.writelines(
            pcap.record(pcap.Capture(start_fs, end_fs, channel, power_dbm, psdu))
            for start_fs, (end_fs, channel, _, power_dbm, psdu) in done
        )


def _split(
    records: Iterable[tuple[int, Any]], until_fs: int
) -> tuple[list[tuple[int, Any]], list[tuple[int, Any]]]:
    """Records up to a time, in its order (equal times keep theirs), and the later ones."""
    ordered = sorted(records, key=lambda record: record[0])
    for index, (time_fs, _) in enumerate(ordered):
        if time_fs > until_fs:
            return ordered[:index], ordered[index:]
    return ordered, []
