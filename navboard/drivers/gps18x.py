"""GPS 18x LVC: characters from UART2 to sentences, RMC and GGA to a fix.

The receive interrupt comes after three characters; what is left of a sentence is fetched by the
control tick, which comes sooner than the FIFO of four can overflow. Sentences are checked
(checksum, fields) by a task, never in the handler.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from firmware_model.cpu import Flag
from firmware_model.dspic30f.mcu import DsPic30F6014A
from navboard import costs
from navboard.errors import SentenceError

BAUD = 4800
U2RX_BIT = 1 << 8  # U2RXIE, U2RXIF: IEC1, IFS1
_URXDA = 1 << 0
_OERR = 1 << 1
_LF = 0x0A
_LONGEST = 82  # NMEA 0183: characters of a sentence, CR LF included
_M_S_PER_KNOT = 1852.0 / 3600.0


@dataclass(frozen=True, slots=True)
class Fix:
    """One second of GPS; None where the receiver has no fix."""

    utc_s: float | None
    """Seconds of the day."""
    latitude_deg: float | None
    longitude_deg: float | None
    speed_m_s: float | None
    course_rad: float | None
    """Clockwise from true north, [−π, π)."""
    satellites: int


class GpsReceiver:
    """The driver: `receive` is called by the UART's handler and by the control tick."""

    __slots__ = (
        "_buffer",
        "_data",
        "_flags",
        "_status",
        "lost_characters",
        "sentence_ready",
        "sentences",
    )

    def __init__(self, mcu: DsPic30F6014A) -> None:
        reg = mcu.reg
        self._status = reg["U2STA"]
        self._data = reg["U2RXREG"]
        self._flags = reg["IFS1"]
        self._buffer = bytearray()
        self.sentences: deque[bytes] = deque(maxlen=8)
        self.sentence_ready = Flag("sentence")
        self.lost_characters = 0
        reg["U2BRG"].write(round(float(mcu.clock.frequency_hz) / (16 * BAUD)) - 1)
        reg["U2MODE"].write(1 << 15)
        self._status.write(1 << 10 | 2 << 6)  # UTXEN, interrupt at three characters
        reg["IEC1"].set_bits(U2RX_BIT)

    def handler(self) -> int:
        """U2RX interrupt: empty the FIFO; returns its cycles."""
        self._flags.clear_bits(U2RX_BIT)
        return costs.UART_ISR + self.receive()

    def receive(self) -> int:
        """Take what the FIFO holds; returns the cycles that it took."""
        cycles = 0
        status, data, buffer = self._status, self._data, self._buffer
        while status.value & _URXDA:
            character = data.read()
            cycles += costs.UART_CHARACTER
            buffer.append(character)
            if character == _LF or len(buffer) > _LONGEST:
                self.sentences.append(bytes(buffer))
                buffer.clear()
                self.sentence_ready.set()
        if status.value & _OERR:
            self.lost_characters += 1
            buffer.clear()
            status.clear_bits(_OERR)
        return cycles


def fields(sentence: bytes) -> list[str]:
    """Return the comma-separated fields between $ and *, the first being the sentence's name.

    Raises:
        SentenceError: no frame, a wrong checksum, or not ASCII.

    """
    text = sentence.rstrip(b"\r\n")
    if not text.startswith(b"$") or text[-3:-2] != b"*":
        raise SentenceError(f"no NMEA sentence: {sentence[:16]!r}")
    checksum = 0
    for byte in text[1:-3]:
        checksum ^= byte
    try:
        said = int(text[-2:], 16)
        body = text[1:-3].decode("ascii")
    except ValueError:
        raise SentenceError(f"garbled NMEA sentence: {sentence[:16]!r}") from None
    if checksum != said:
        raise SentenceError(f"NMEA checksum {said:02X}, computed {checksum:02X}")
    return body.split(",")


class FixBuilder:
    """Joins an RMC and the GGA of the same second into a `Fix`."""

    __slots__ = ("_rmc",)

    def __init__(self) -> None:
        self._rmc: list[str] | None = None

    def sentence(self, sentence: bytes) -> Fix | None:
        """Take a sentence; return the fix that it completes.

        Raises:
            SentenceError: the sentence or one of its fields is damaged.

        """
        parts = fields(sentence)
        if parts[0] == "GPRMC":
            self._rmc = parts
            return None
        if parts[0] != "GPGGA" or self._rmc is None:
            return None
        rmc, self._rmc = self._rmc, None
        if len(rmc) < 10 or len(parts) < 8 or rmc[1] != parts[1]:
            return None
        try:
            return _fix(rmc, parts)
        except (ValueError, IndexError):
            raise SentenceError("an NMEA field is not a number") from None


def _fix(rmc: list[str], gga: list[str]) -> Fix:
    satellites = int(gga[7] or 0)
    utc = _seconds_of_day(rmc[1]) if rmc[1] else None
    if rmc[2] != "A" or gga[6] in ("", "0"):
        return Fix(utc, None, None, None, None, satellites)
    course = math.radians(float(rmc[8])) if rmc[8] else 0.0
    return Fix(
        utc,
        _degrees(rmc[3], rmc[4]),
        _degrees(rmc[5], rmc[6]),
        float(rmc[7]) * _M_S_PER_KNOT,
        (course + math.pi) % (2 * math.pi) - math.pi,
        satellites,
    )


def _seconds_of_day(hhmmss: str) -> float:
    return int(hhmmss[:2]) * 3600 + int(hhmmss[2:4]) * 60 + float(hhmmss[4:])


def _degrees(text: str, hemisphere: str) -> float:
    whole = text.index(".") - 2
    degrees = int(text[:whole]) + float(text[whole:]) / 60.0
    return -degrees if hemisphere in "SW" else degrees
