"""When frames begin and end: SFD on P4.1, captured by Timer B, as TinyOS does on this mote.

SFD rises behind the start-of-frame delimiter, of a frame that goes and of one that comes, and
TBCCR1 takes the count at each rise (CC2420 section 13.5; SLAU049F, section 12.2.4.1). Which frame
that was is not in the count. One that was sent: the driver waits for its SFD. One that came: the
capture is read when FIFOP rises, at the frame's end, and it is this frame's if the time between is
that of its length; if not, FIFOP was served too late or came with another frame, and there is no
stamp.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Final, TypeAlias

from firmware_model.msp430.mcu import Msp430F1611
from procboard.alarms import Alarms, ticks_of_us
from radio_802154.timing import OCTET_US

_CAPTURE_RISES: Final = 0x4000 | 0x0800 | 0x0100
"""TBCCTL1: CM_1, CCIS_0 (CCI1A is P4.1), SCS, CAP (SLAU049F, section 12.3)."""
_CCIE: Final = 0x0010
_CCIFG: Final = 0x0001
_SFD_BIT: Final = 0x02

LATE_TICKS: Final = 4
"""FIFOP is served within so many ticks (122 µs): handlers of up to 400 cycles may come first. The
next SFD cannot have come by then: that of an acknowledgement takes 352 µs."""

OnRise: TypeAlias = Callable[[int], Generator[int, None, None]]
"""Called in the interrupt with the count at the SFD; yields its cycles."""


class SfdCapture:
    """Counts of SFDs, in the ticks of `Alarms.now`. `start` at every boot."""

    def __init__(self, mcu: Msp430F1611, alarms: Alarms) -> None:
        self._alarms = alarms
        self._select = mcu.reg["P4SEL"]
        self._control = mcu.reg["TBCCTL1"]
        self._captured = mcu.reg["TBCCR1"]
        self._on_rise: OnRise | None = None

    def start(self) -> None:
        """Begin to capture."""
        self._select.set_bits(_SFD_BIT)
        self._alarms.on_capture = self._rose
        self._control.write(_CAPTURE_RISES)

    def last(self) -> int:
        """Return the count at the last SFD, which was less than 2 s ago."""
        now = self._alarms.now()
        return now - (now - self._captured.read() & 0xFFFF)

    def await_rise(self, on_rise: OnRise) -> None:
        """Have the next SFD interrupt and call `on_rise`, once."""
        self._on_rise = on_rise
        self._control.write(_CAPTURE_RISES | _CCIE)

    def forget(self) -> None:
        """Wait for no SFD any more."""
        self._on_rise = None
        self._control.write(_CAPTURE_RISES)

    def _rose(self) -> Generator[int, None, None]:
        on_rise = self._on_rise
        self.forget()
        if on_rise is not None:
            yield from on_rise(self.last())


def belongs(sfd_ticks: int, end_ticks: int, mpdu_octets: int) -> bool:
    """Whether an SFD was that of a frame of so many octets, FCS included, that ended then."""
    late = end_ticks - sfd_ticks - ticks_of_us((1 + mpdu_octets) * OCTET_US)
    return -1 <= late <= LATE_TICKS
