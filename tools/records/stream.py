"""The files that grow while a run goes on: spi.vcd and radio.pcap, fed from the trace.

There is one capture of the air, and a waveform of each robot whose wires are recorded. Channels
that are looked for (they must be there before the run; those of one of several robots begin with
its name), and the values of their records:

- `spi.bytes`: `(bit_period_fs, mosi, miso)` at the first bit of a run of bytes without a gap,
  `spi.cs` and `spi.ready`: 0 or 1;
- `wire.NAME`: 0 or 1, further pins to be drawn beside them;
- `radio`: `(start_fs, channel, source, power_dbm, psdu)` at the end of the frame, as the medium
  records it; the PSDU has its FCS.

A block holds records of one channel in the order in which they were made. Levels are flushed before
the bytes that they stand beside are written. Frames that collide may end in another order than they
began: they are put in order of time here, with a window that is longer than any frame.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any, BinaryIO, TextIO

from radio_802154 import pcap
from tools.errors import RunFolderError
from tools.records.vcd import VcdWriter

if TYPE_CHECKING:
    from firmware_model.trace import Record, Trace
    from tools.records.folder import RunFolder

SPI, RADIO, WIRE = "spi.bytes", "radio", "wire."
LINK_WIRES = {"spi.cs": ("CS", 1), "spi.ready": ("READY", 0)}
"""Wires beside the bytes, with their level at rest: chip select low, data ready high active."""

WINDOW_FS = 10**13
"""10 ms: longer than the longest frame in the air (133 bytes of 32 µs)."""


ALONE = {"": "spi.vcd"}
"""Files of waveforms of a run with one robot, by what its channels begin with."""


class StreamedFiles:
    """Context manager that attaches to a trace and closes the files with it.

    `waveforms`: names of files in the folder, by what the channels of the robot begin with.
    """

    def __init__(
        self, trace: Trace, folder: RunFolder, waveforms: Mapping[str, str] = ALONE
    ) -> None:
        self._trace = trace
        self._folder = folder
        self._names = waveforms
        self._files = contextlib.ExitStack()
        self._frames: list[tuple[int, Any]] = []
        self._end_fs = 0

    def __enter__(self) -> StreamedFiles:
        names = self._trace.names()
        try:
            self._waveforms = [
                _Waveform(
                    self._trace,
                    self._files.enter_context(
                        self._folder.file(file).open("w", encoding="ascii", newline="\n")
                    ),
                    before,
                )
                for before, file in self._names.items()
            ]
            self._pcap: BinaryIO = self._files.enter_context(
                self._folder.file("radio.pcap").open("wb")
            )
        except OSError as error:
            raise self._wrong(error) from error
        # Only what is there: to make a channel here would change the trace's hash.
        self._air = RADIO in names
        if self._air:
            self._trace.channel(RADIO).sink(self._radio_block)
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
        if self._air != (RADIO in self._trace.names()) or any(
            waveform.came_late() for waveform in self._waveforms
        ):
            raise RuntimeError("a channel was made after the files were attached to it")
        self._write_radio(self._end_fs + WINDOW_FS)
        for waveform in self._waveforms:
            waveform.close(self._end_fs)

    def _wrong(self, error: OSError) -> RunFolderError:
        return RunFolderError(f"{self._folder.path}: cannot be written: {error.strerror}")

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


class _Waveform:
    """The wires between the boards of one robot, as they go into a file."""

    def __init__(self, trace: Trace, file: TextIO, before: str) -> None:
        self._trace = trace
        self._bytes = f"{before}{SPI}"
        names = trace.names()
        wires = {f"{before}{name}": wire for name, wire in LINK_WIRES.items()}
        wires = {name: wire for name, wire in wires.items() if name in names}
        further = f"{before}{WIRE}"
        wires |= {
            name: (name.removeprefix(further), 0) for name in names if name.startswith(further)
        }
        self._vcd = VcdWriter(file, wires.values())
        self._end_fs = 0
        self._levels = [trace.channel(name) for name in wires]
        for channel, (wire, _) in zip(self._levels, wires.values(), strict=True):
            channel.sink(self._level_sink(wire))
        self._attached = self._bytes in names
        if self._attached:
            trace.channel(self._bytes).sink(self._spi_block)

    def came_late(self) -> bool:
        """Whether the channel of the bytes was made after this."""
        return self._attached != (self._bytes in self._trace.names())

    def close(self, end_fs: int) -> None:
        """Write what is held; the recording ends at a time, or later where it has more."""
        self._vcd.close(max(end_fs, self._end_fs))

    def _level_sink(self, wire: str) -> Callable[[list[Record]], None]:
        def sink(block: list[Record]) -> None:
            for time_fs, level in block:
                self._vcd.level(time_fs, wire, 1 if level else 0)
            self._end_fs = max(self._end_fs, block[-1][0])

        return sink

    def _spi_block(self, block: list[Any]) -> None:
        # Levels first: the writer holds them until a byte passes them.
        for channel in self._levels:
            channel.flush()
        byte = self._vcd.byte
        for start_fs, (period_fs, mosi, miso) in block:
            for time_fs, to_slave, to_master in zip(
                range(start_fs, start_fs + 8 * period_fs * len(mosi), 8 * period_fs),
                mosi,
                miso,
                strict=True,
            ):
                byte(time_fs, period_fs, to_slave, to_master)
            self._end_fs = max(self._end_fs, start_fs + (8 * len(mosi) + 1) * period_fs)


def _split(
    records: Iterable[tuple[int, Any]], until_fs: int
) -> tuple[list[tuple[int, Any]], list[tuple[int, Any]]]:
    """Records up to a time, in its order (equal times keep theirs), and the later ones."""
    ordered = sorted(records, key=lambda record: record[0])
    for index, (time_fs, _) in enumerate(ordered):
        if time_fs > until_fs:
            return ordered[:index], ordered[index:]
    return ordered, []
