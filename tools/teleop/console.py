"""The loop around a pilot: serial line, operator's input, clock, terminal and signals.

One wait for everything. Whatever ends the loop (the operator, his terminal or joystick going away,
SIGTERM, Ctrl-C, a fault in this program), the fish is told to stop first and the terminal is given
back.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import TYPE_CHECKING, Protocol

from spi_bus.errors import TransportLost
from spi_bus.transports.base import Transport, Waitable, wait_any
from tools.teleop.joystick import EventDecoder, Stick
from tools.teleop.keyboard import ESCAPE_S, KeyDecoder, inputs
from tools.teleop.pilot import Course, Pilot
from tools.teleop.setpoint import End, Input

if TYPE_CHECKING:
    from rich.live import Live

IDLE_S = 0.1
"""Longest wait: the status line is drawn as often."""
PLAIN_S = 5.0
"""Between status lines where there is no terminal."""
READ_OCTETS = 4096


class Operator(Protocol):
    """Where inputs come from."""

    def descriptor(self) -> int:
        """Return what to wait on, or −1."""

    def next_deadline_s(self) -> float | None:
        """When `read` has something by the clock."""

    def read(self, now_s: float) -> list[Input]:
        """Return what the operator did."""


class KeyboardOperator:
    """Keys of a terminal; its end is the operator's."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._keys = KeyDecoder()
        self._escaped_s = 0.0

    def descriptor(self) -> int:
        """Return the terminal."""
        return self._descriptor

    def next_deadline_s(self) -> float | None:
        """When a lone escape is over."""
        return self._escaped_s + ESCAPE_S if self._keys.waiting else None

    def read(self, now_s: float) -> list[Input]:
        """Return what keys did."""
        keys = (
            self._keys.idle() if self._keys.waiting and now_s >= self._escaped_s + ESCAPE_S else []
        )
        data = _read(self._descriptor)
        if data == b"":
            return [End("the keyboard is gone")]
        if data:
            keys += self._keys.receive(data)
            self._escaped_s = now_s
        return inputs(keys)


class JoystickOperator:
    """A joystick's events; unplugging it is the operator's end."""

    def __init__(self, descriptor: int, stick: Stick) -> None:
        self._descriptor = descriptor
        self._events = EventDecoder()
        self._stick = stick

    def descriptor(self) -> int:
        """Return the device."""
        return self._descriptor

    def next_deadline_s(self) -> float | None:
        """Return None: nothing here depends on time."""
        return None

    def read(self, now_s: float) -> list[Input]:
        """Return what stick and buttons did."""
        del now_s
        data = _read(self._descriptor)
        if data == b"":
            return [End("the joystick is gone")]
        return self._stick.inputs(self._events.receive(data)) if data else []


class ScriptOperator:
    """Timed commands, from the moment that the module is ready."""

    def __init__(self, steps: list[tuple[float, Input]], pilot: Pilot) -> None:
        self._steps = steps
        self._pilot = pilot
        self._began_s: float | None = None

    def descriptor(self) -> int:
        """Return −1: nothing to wait on."""
        return -1

    def next_deadline_s(self) -> float | None:
        """When the next step is due."""
        if self._began_s is None or not self._steps:
            return None
        return self._began_s + self._steps[0][0]

    def read(self, now_s: float) -> list[Input]:
        """Return the steps that are due."""
        if self._began_s is None:
            if self._pilot.course is not Course.DRIVING:
                return []
            self._began_s = now_s
        due = []
        while self._steps and now_s >= self._began_s + self._steps[0][0]:
            due.append(self._steps.pop(0)[1])
        return due


def _read(descriptor: int) -> bytes | None:
    """Return what is there, b"" at the end, None where there is nothing now."""
    import select

    if not select.select([descriptor], [], [], 0)[0]:
        return None
    try:
        return os.read(descriptor, READ_OCTETS)
    except BlockingIOError:
        return None
    except OSError:  # a terminal or device that went away
        return b""


class _Watched:
    """An operator's descriptor among what is waited for."""

    wants_writable = False

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def fileno(self) -> int:
        return self._descriptor

    def next_deadline_s(self) -> float | None:
        return None

    def wait(self, timeout_s: float) -> None:
        raise NotImplementedError("waited for together with the line")


class Console:
    """Runs a pilot to its end.

    Args:
        show: whether to draw the status line on stderr; else it is printed now and then.
        say: hears each event's text.

    """

    def __init__(
        self,
        pilot: Pilot,
        operator: Operator,
        transport: Transport,
        *,
        duration_s: float | None = None,
        say: Callable[[str], None] = lambda text: None,
        draw: Callable[[Pilot, float], None] = lambda pilot, now_s: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.pilot = pilot
        self.interrupted = False
        self._operator = operator
        self._transport = transport
        self._end_s = None if duration_s is None else clock() + duration_s
        self._say = say
        self._draw = draw
        self._clock = clock
        self._openings = transport.openings
        self._told = 0
        self._unsent = b""

    def run(self) -> None:
        """Run until the fish has been told to stop."""
        with self._signals():
            try:
                while self.pilot.course is not Course.OVER and not self.pilot.failure:
                    self._turn()
            except BaseException:
                self._stop_for(End("this program failed"))
                raise
        self._speak()

    def _turn(self) -> None:
        pilot, now_s = self.pilot, self._clock()
        for done in self._operator.read(now_s) if pilot.helm.ended is None else ():
            pilot.helm.take(done)
        if self._end_s is not None and now_s >= self._end_s:
            pilot.helm.take(End("the time is up"))
        self._exchange(now_s)
        pilot.tick(now_s)
        self._exchange(self._clock())
        self._speak()
        self._draw(pilot, now_s)
        self._wait()

    def _stop_for(self, why: End) -> None:
        """Tell the fish to stop, whatever else is broken; the loop's fault is raised afterwards."""
        self.pilot.helm.take(why)
        with contextlib.suppress(Exception):
            while self.pilot.course is not Course.OVER and not self.pilot.failure:
                now_s = self._clock()
                self._exchange(now_s)
                self.pilot.tick(now_s)
                self._exchange(now_s)
                self._transport.wait(0.05)

    def _exchange(self, now_s: float) -> None:
        """Move octets both ways."""
        pilot, transport = self.pilot, self._transport
        try:
            data = transport.read()
        except TransportLost as error:  # a line that cannot be opened again
            pilot.failure = str(error)
            return
        if transport.openings != self._openings:
            self._openings = transport.openings
            self._unsent = b""
            pilot.reopened(now_s)
        if data:
            pilot.hear(data, now_s)
        self._unsent += pilot.module.data_to_send()
        count = min(len(self._unsent), transport.room)
        if count:
            transport.write(self._unsent[:count])
            self._unsent = self._unsent[count:]
        transport.flush()

    def _wait(self) -> None:
        now_s = self._clock()
        dues = [now_s + IDLE_S, self.pilot.next_deadline_s]
        if self.pilot.helm.ended is None:
            dues.append(self._operator.next_deadline_s())
        timeout_s = max(0.0, min(due for due in dues if due is not None) - now_s)
        parts: list[Waitable] = [self._transport]
        if self.pilot.helm.ended is None and self._operator.descriptor() >= 0:
            parts.append(_Watched(self._operator.descriptor()))
        wait_any(parts, timeout_s, self._clock)

    def _speak(self) -> None:
        for _, text in self.pilot.events[self._told :]:
            self._say(text)
        self._told = len(self.pilot.events)

    @contextlib.contextmanager
    def _signals(self) -> Iterator[None]:
        """Turn Ctrl-C, SIGTERM and a lost terminal into the operator's end; a second one kills."""

        def note(number: int, frame: FrameType | None) -> None:
            if self.interrupted:
                raise KeyboardInterrupt
            self.interrupted = True
            self.pilot.helm.take(End(f"{signal.Signals(number).name}: stopping the fish"))

        numbers = [signal.SIGINT, signal.SIGTERM]
        if hasattr(signal, "SIGHUP"):
            numbers.append(signal.SIGHUP)
        before = {}
        try:
            for number in numbers:
                before[number] = signal.signal(number, note)
        except ValueError:  # not in the main thread
            yield
            return
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


@contextlib.contextmanager
def screen(quiet: bool) -> Iterator[tuple[Callable[[str], None], Callable[[Pilot, float], None]]]:
    """Give what says a line and what draws the status: live where there is a terminal."""
    from tools.teleop.status import status

    if quiet:
        yield (lambda text: None), (lambda pilot, now_s: None)
        return
    from rich.console import Console as RichConsole

    console = RichConsole(stderr=True, highlight=False, soft_wrap=True)
    if not sys.stderr.isatty():
        shown_s = float("-inf")

        def print_now_and_then(pilot: Pilot, now_s: float) -> None:
            nonlocal shown_s
            if now_s - shown_s >= PLAIN_S:
                shown_s = now_s
                print(status(pilot, now_s).plain, file=sys.stderr, flush=True)

        yield (lambda text: print(text, file=sys.stderr, flush=True)), print_now_and_then
        return
    from rich.live import Live

    live: Live
    with Live(console=console, auto_refresh=False, transient=True) as live:
        drawn_s = float("-inf")

        def draw(pilot: Pilot, now_s: float) -> None:
            nonlocal drawn_s
            if now_s - drawn_s >= IDLE_S:
                drawn_s = now_s
                live.update(status(pilot, now_s), refresh=True)

        yield (lambda text: console.print(text, style="dim")), draw
