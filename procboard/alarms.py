"""Software alarms on one compare channel of Timer B, counted by the 32 768 Hz watch crystal.

Timer B runs on ACLK without end, so the CPU may sleep in LPM3; its overflow every 2 s extends the
count. Alarms wait in a heap, and TBCCR0 stands at the first of them. An alarm sets a flag, so
whatever a task waits for can have a time limit: it waits for one flag that either side sets.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from heapq import heappop, heappush
from typing import Any, Final

from firmware_model.cpu import Flag
from firmware_model.msp430.mcu import Msp430F1611
from procboard.coroutines import Firmware

TICKS_PER_S: Final = 32_768

# TBCTL, TBCCTLx (SLAU049F, section 12.3).
_TBSSEL_ACLK: Final = 0x0100
_MC_CONTINUOUS: Final = 0x0020
_TBCLR: Final = 0x0004
_TBIE: Final = 0x0002
_TBIFG: Final = 0x0001
_CCIE: Final = 0x0010
_CCIFG: Final = 0x0001
_TBIV_CAPTURE: Final = 2
_TBIV_OVERFLOW: Final = 14
_OVERFLOW_LATENCY: Final = 0x1000
"""Ticks (125 ms) within which the overflow's handler has run for sure: no handler is so long."""
_WRAP: Final = 0x10000

COMPARE_CYCLES: Final = 60
"""Handler of TBCCR0: pop the heap, set a flag, compare anew; about 20 instructions of 3 cycles
(SLAU049F, tables 3-14 to 3-16)."""
OVERFLOW_CYCLES: Final = 30
"""Handler of the overflow: read TBIV, add to a 32-bit count."""
ARM_CYCLES: Final = 70
"""Inserting an alarm: as TinyOS's VirtualizeAlarmC, about 25 instructions."""


def ticks_of_us(duration_us: int) -> int:
    """Return the least number of ticks that last at least so long."""
    return -(-duration_us * 512 // 15_625)


Alarm = list[Any]
"""A handle: [deadline in ticks, number, flag or None]."""


class Alarms:
    """All alarms of a board. `start` at every boot."""

    def __init__(self, mcu: Msp430F1611) -> None:
        reg = mcu.reg
        self._counter = reg["TBR"]
        self._control = reg["TBCTL"]
        self._compare = reg["TBCCR0"]
        self._compare_control = reg["TBCCTL0"]
        self._vector = reg["TBIV"]
        self._cpu = mcu.cpu
        self.on_capture: Callable[[], Generator[int, None, None]] | None = None
        """Handler of the timer's channel 1, which shares an interrupt with the overflow."""
        self._high = 0
        self._heap: list[Alarm] = []
        self._number = 0
        self._armed = -1  # deadline that TBCCR0 stands for
        self._enabled = False  # CCIE

    def start(self) -> None:
        """Start counting from zero."""
        self._cpu.on_interrupt("TIMERB0", self._due)
        self._cpu.on_interrupt("TIMERB1", self._overflow)
        self._control.write(_TBSSEL_ACLK | _MC_CONTINUOUS | _TBCLR | _TBIE)

    def now(self) -> int:
        """Ticks since `start`."""
        low = self._counter.read()
        high = self._high
        if low < _OVERFLOW_LATENCY and self._control.read() & _TBIFG:
            high += _WRAP  # the overflow has happened and its handler has not run yet
        return high + low

    def now_us(self) -> int:
        """Microseconds since `start`, in steps of a tick."""
        return self.now() * 15_625 // 512

    def at(self, deadline: int, flag: Flag) -> Alarm:
        """Set `flag` at a count of ticks; at once where that is past."""
        self._number += 1
        alarm: Alarm = [deadline, self._number, flag]
        heap = self._heap
        heappush(heap, alarm)
        if heap[0] is alarm:
            self._arm(self.now())
        return alarm

    def after_us(self, duration_us: int, flag: Flag) -> Alarm:
        """Set `flag` when at least so many microseconds have passed."""
        now = self.now()
        self._number += 1
        alarm: Alarm = [now + 1 + ticks_of_us(duration_us), self._number, flag]
        heap = self._heap
        heappush(heap, alarm)
        if heap[0] is alarm:
            self._arm(now)
        return alarm

    def cancel(self, alarm: Alarm | None) -> None:
        """Make sure that an alarm sets its flag no more; harmless after it has."""
        if alarm is not None:
            alarm[2] = None

    def sleep_us(self, duration_us: int) -> Firmware[None]:
        """Let at least so many microseconds pass."""
        flag = Flag("alarm")
        self.after_us(duration_us, flag)
        yield ARM_CYCLES
        yield flag

    def sleep_until(self, deadline: int) -> Firmware[None]:
        """Wait for a count of ticks."""
        flag = Flag("alarm")
        self.at(deadline, flag)
        yield ARM_CYCLES
        yield flag

    def _enable(self, control: int) -> None:
        self._enabled = bool(control)
        self._compare_control.write(control)

    def _arm(self, now: int) -> None:
        """Let TBCCR0 stand at the first alarm that is not cancelled."""
        heap = self._heap
        while heap and heap[0][2] is None:
            heappop(heap)
        if not heap:
            self._armed = -1
            if self._enabled:
                self._enable(0)
            return
        deadline = heap[0][0]
        if deadline == self._armed:
            return
        ahead = deadline - now
        if ahead <= 0:
            self._armed = deadline
            self._enable(_CCIE | _CCIFG)
        elif ahead < _WRAP:
            self._armed = deadline
            self._compare.write(deadline & 0xFFFF)
            if not self._enabled:
                self._enable(_CCIE)
        else:  # too far for the compare register: the overflow looks again
            self._armed = -1
            self._enable(0)

    def _due(self) -> int:
        heap = self._heap
        now = self.now()
        cycles = COMPARE_CYCLES
        while heap and heap[0][0] <= now:
            flag = heappop(heap)[2]
            if flag is not None:
                flag.set()
                cycles += COMPARE_CYCLES
        self._armed = -1
        self._arm(now)
        return cycles

    def _overflow(self) -> int | Generator[int, None, None]:
        vector = self._vector.read()
        if vector == _TBIV_OVERFLOW:
            self._high += _WRAP
            self._arm(self.now())
        elif vector == _TBIV_CAPTURE and self.on_capture is not None:
            return self.on_capture()
        return OVERFLOW_CYCLES
