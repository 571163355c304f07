"""The USB converter of a TelosB: octets of a host to a UART and back, in the line's own time.

A character takes ten bits at the rate that the host has set, whoever sends it. A receiver samples
the middle of each bit, so two rates that differ by more than half a bit in nine and a half do not
understand each other: then the other side sees framing errors, as with a wrong baud rate on a real
desk.

Left out: the FT232BM's latency timer, which holds a short answer back by up to 16 ms on a real
mote (FTDI AN232B-04), and its modem lines, with which a host can reset the mote.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final

from firmware_model.msp430.usart import Usart
from firmware_model.scheduler import Event, Scheduler
from firmware_model.time import FS_PER_S

BITS: Final = 10
"""Start, eight of data, stop."""
BUFFER_OCTETS: Final = 128
"""Of the converter, from the host (FT232BM data sheet: dual-port transmit buffer)."""
TOLERANCE: Final = 0.5 / (BITS - 0.5)
"""Relative difference of rates beyond which the stop bit is sampled in another bit."""


class Ft232:
    """Between a USART in UART mode and a host.

    Args:
        scheduler: the run's.
        usart: wired here: its transmitter to us, ours to its receiver.
        baud: the rate that the host has set.
        to_host: called with each octet at the middle of its stop bit.

    """

    def __init__(
        self, scheduler: Scheduler, usart: Usart, baud: int, to_host: Callable[[int], None]
    ) -> None:
        self.garbled = 0
        """Characters of other bit times than ours, either way."""
        self.to_mote_octets = 0
        self.to_host_octets = 0
        self._scheduler = scheduler
        self._usart = usart
        self._bit_fs = FS_PER_S // baud
        self._to_host = to_host
        self._queue: deque[int] = deque()
        self._event: Event | None = None
        self._free_fs = 0  # end of the last character's stop bit
        usart.connect_uart(self._from_mote)

    @property
    def room(self) -> int:
        """Octets that `send` takes."""
        return BUFFER_OCTETS - len(self._queue)

    def send(self, octets: bytes) -> None:
        """Take octets of the host, as many as `room` says; they leave one after the other."""
        self._queue.extend(octets)
        if self._event is None and self._queue:
            self._begin()

    def _begin(self) -> None:
        start_fs = max(self._scheduler.now, self._free_fs)
        self._free_fs = start_fs + BITS * self._bit_fs
        middle_fs = start_fs + (2 * BITS - 1) * self._bit_fs // 2
        self._event = self._scheduler.at(middle_fs, self._stop_bit)

    def _stop_bit(self) -> None:
        octet = self._queue.popleft()
        self._event = None
        if self._queue:
            self._begin()
        self.to_mote_octets += 1
        if self._understood():
            self._usart.uart_receive(octet)
        else:
            self.garbled += 1
            self._usart.uart_error(framing=True)

    def _from_mote(self, octet: int) -> None:
        if self._understood():
            self.to_host_octets += 1
            self._to_host(octet)
        else:
            self.garbled += 1

    def _understood(self) -> bool:
        return abs(self._usart.bit_period_fs / self._bit_fs - 1.0) < TOLERANCE
