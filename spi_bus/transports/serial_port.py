"""Serial ports by pyserial: `serial:///dev/ttyUSB0?baud=115200`, and every URL that pyserial knows.

A device has a descriptor, which is read and written directly: pyserial's own write spins while the
device is full. VMIN is 1, because with pyserial's 0 an empty device and a vanished one read the
same. Forms without a descriptor (`rfc2217://`, `loop://`, any on Windows) go through pyserial's
methods, `PortTransport`.

A pseudo-terminal has no modem lines and refuses to set them; so do some adapters. That is no error
here.
"""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Callable
from typing import Any, Final

from spi_bus.errors import (
    MissingPackageError,
    PortBusyError,
    PortNotFoundError,
    PortPermissionError,
    TransportClosedError,
    TransportError,
    TransportLost,
    TransportUrlError,
)
from spi_bus.transports.base import BUFFER_BYTES, READ_BYTES, OpenContext, Outbox
from spi_bus.transports.descriptor import DescriptorTransport
from spi_bus.transports.urls import Url, boolean, integer, take

__all__ = ["BAUD", "PYSERIAL_SCHEMES", "PortTransport", "SerialTransport", "open_url"]

BAUD: Final = 115_200
"""Where the URL names none: what a TelosB's USB and most adapters are set to."""
PYSERIAL_SCHEMES: Final = ("serial", "rfc2217", "loop", "spy", "hwgrep", "alt")
"""`serial` is ours, for a device by its path; the others are pyserial's own."""
WRITE_TIMEOUT_S: Final[dict[str, float | None]] = {"serial": 0.0, "rfc2217": None}
"""How long pyserial may try to write; its RFC 2217 client refuses to be told. Others: 0.1 s."""
_SLICE_S: Final = 0.001
CHUNK_BYTES: Final = 256


def _one_of(*allowed: str) -> Callable[[str], str]:
    def convert(text: str) -> str:
        if text.upper() not in allowed:
            raise ValueError(f"not one of {', '.join(allowed)}")
        return text.upper()

    return convert


def _stop_bits(text: str) -> float:
    return float(_one_of("1", "1.5", "2")(text))


OPTIONS: Final[dict[str, Callable[[str], Any]]] = {
    "baud": integer(1, 50_000_000),
    "bytesize": integer(5, 8),
    "parity": _one_of("N", "E", "O", "M", "S"),
    "stopbits": _stop_bits,
    "rtscts": boolean,
    "xonxoff": boolean,
    "exclusive": boolean,
}
"""Options of every form; for pyserial's own forms others go on to it, in its URL."""


class SerialTransport(DescriptorTransport):
    """A serial device that pyserial has opened and set up."""

    def __init__(self, port: Any, description: str) -> None:
        import termios

        descriptor = port.fileno()
        settings = termios.tcgetattr(descriptor)
        settings[6][termios.VMIN] = 1
        termios.tcsetattr(descriptor, termios.TCSANOW, settings)
        super().__init__(descriptor, description, peer="the device", close=port.close)


class PortTransport:
    """A pyserial port without a descriptor, by its methods.

    Writes go in pieces of at most `chunk_bytes`; pyserial may block for as long as the line takes
    for one of them.
    """

    openings = 1
    wants_writable = False

    def __init__(self, port: Any, description: str, chunk_bytes: int = CHUNK_BYTES) -> None:
        self._port = port
        self._chunk_bytes = chunk_bytes
        self._description = description
        self._outbox = Outbox(BUFFER_BYTES)
        self._broken: str | None = None
        self._ahead = b""
        self._closed = False

    @property
    def description(self) -> str:
        """What this is, and where."""
        return self._description

    @property
    def room(self) -> int:
        """Bytes that `write` takes now."""
        return 0 if self._broken is not None or self._closed else self._outbox.room

    @property
    def pending(self) -> int:
        """Bytes that pyserial has not taken yet."""
        return len(self._outbox)

    def read(self, limit: int = READ_BYTES) -> bytes:
        """Return what has arrived; see `Transport`."""
        self._check_open()
        data = self._ahead
        if not data and limit:
            try:
                data = self._port.read(max(1, self._port.in_waiting))
            except (OSError, TypeError) as error:  # pyserial: TypeError where it was closed within
                raise self._lost(str(error)) from error
        if not data and self._broken is not None:
            raise self._lost(self._broken)
        self._ahead = data[limit:]
        return bytes(data[:limit])

    def write(self, data: bytes) -> None:
        """Take bytes to send; see `Transport`."""
        self._check_open()
        if self._broken is not None:
            raise self._lost(self._broken)
        self._outbox.add(data)
        self.flush()

    def flush(self) -> None:
        """Hand on what is pending."""
        import serial

        while self._outbox and self._broken is None and not self._closed:
            try:
                count = self._port.write(self._outbox.first(self._chunk_bytes))
            except serial.SerialTimeoutException:
                return
            except OSError as error:
                self._broken = str(error)
                self._outbox.clear()
                return
            if not count:
                return
            self._outbox.drop(count)

    def fileno(self) -> int:
        """Return -1: there is nothing to select on."""
        return -1

    def next_deadline_s(self) -> float | None:
        """Return None: nothing here depends on time."""
        return None

    def wait(self, timeout_s: float) -> None:
        """Look every millisecond whether bytes have come."""
        self._check_open()
        end_s = time.monotonic() + timeout_s
        while not self._ahead and self._broken is None:
            try:
                if self._port.in_waiting:
                    return
            except (OSError, TypeError):
                return  # `read` says what it is
            left_s = end_s - time.monotonic()
            if left_s <= 0 or self._outbox:
                return
            time.sleep(min(_SLICE_S, left_s))

    def close(self) -> None:
        """Close the port."""
        if not self._closed:
            self._closed = True
            self._outbox.clear()
            self._port.close()

    def _check_open(self) -> None:
        if self._closed:
            raise TransportClosedError(f"{self._description} was closed: open it again")

    def _lost(self, reason: str) -> TransportLost:
        return TransportLost(f"{self._description}: the device is gone ({reason})")


def open_url(url: Url, context: OpenContext) -> SerialTransport | PortTransport:
    """Open a serial port.

    Raises:
        TransportUrlError: no path, a wrong option or value.
        PortNotFoundError, PortPermissionError, PortBusyError: as the system says.
        MissingPackageError: pyserial is not installed.

    """
    del context
    try:
        import serial
    except ImportError as error:
        raise MissingPackageError(
            f"{url.text}: serial ports need pyserial: pip install pyserial"
        ) from error
    passed_on: dict[str, str] = {}
    ours = url.scheme == "serial"
    options = take(url, OPTIONS, leftover=None if ours else passed_on)
    baud = options.pop("baud", BAUD)
    options.setdefault("exclusive", True if ours and os.name == "posix" else None)
    if ours:
        name = url.rest.removeprefix("//")
        if not name:
            raise TransportUrlError(f"{url.text}: which port? As serial:///dev/ttyUSB0?baud=115200")
    else:
        query = "&".join(f"{key}={value}" for key, value in passed_on.items())
        name = f"{url.scheme}:{url.rest}" + (f"?{query}" if query else "")
    try:
        port = serial.serial_for_url(
            name,
            baudrate=baud,
            timeout=0,
            write_timeout=WRITE_TIMEOUT_S.get(url.scheme, 0.1),
            **options,
        )
    except (OSError, ValueError, TypeError, OverflowError, NotImplementedError) as error:
        raise _open_error(url, name, baud, error) from error
    has_descriptor = os.name == "posix" and type(port) is serial.Serial
    description = f"serial {name} at {baud} baud" if ours else name
    if has_descriptor:
        return SerialTransport(port, description)
    # A full loop:// takes the first bytes of a piece and says that it took none.
    return PortTransport(port, description, 1 if url.scheme == "loop" else CHUNK_BYTES)


def _open_error(url: Url, name: str, baud: int, error: Exception) -> TransportError:
    code = getattr(error, "errno", None)
    reason = os.strerror(code) if code else str(error)
    if "baud" in str(error).lower():
        return TransportUrlError(f"{url.text}: the port cannot do {baud} baud: name another rate")
    if isinstance(error, (ValueError, NotImplementedError)) or "in the form" in str(error):
        return TransportUrlError(f"{url.text}: {error}: see docs/transports.md for the forms")
    if code == errno.EACCES:
        return PortPermissionError(
            f"{url.text}: you may not open {name}: join the group that owns it "
            "(sudo usermod -aG dialout $USER, then log in again)"
        )
    if code in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK):
        return PortBusyError(f"{url.text}: {name} is in use: close the program that holds it")
    if code in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return PortNotFoundError(f"{url.text}: no port {name}: {_ports_there_are()}")
    ask = "is the server running there" if url.scheme == "rfc2217" else "is that a serial port"
    return PortNotFoundError(
        f"{url.text}: cannot be opened ({reason}): {ask}, and is it the right one?"
    )


def _ports_there_are() -> str:
    from serial.tools.list_ports import comports

    names = sorted(port.device for port in comports())
    if names:
        return f"this machine has {', '.join(names[:8])}"
    return "this machine has none; is the cable in?"
