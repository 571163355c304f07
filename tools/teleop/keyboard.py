"""A keyboard as a helm: octets of a terminal to keys, keys to inputs, and the terminal's settings.

Arrow keys come as escape sequences (ECMA-48: CSI or SS3, then a letter), cut anywhere; an escape
that nothing follows within `ESCAPE_S` is the key itself. The terminal is put into cbreak mode, in
which Ctrl-C still is Ctrl-C, and given back as it was whatever happens.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Iterator
from typing import Final

from tools.errors import UserError
from tools.teleop.setpoint import LEFT, End, Hold, Input, Nudge, Stop

ESCAPE_S: Final = 0.05
"""Within a sequence octets follow each other at once."""
FREQUENCY_STEP_HZ: Final = 0.1
BIAS_STEP_RAD: Final = math.radians(5.0)
AMPLITUDE_STEP_RAD: Final = math.radians(2.5)

_FASTER, _SLOWER = Nudge(frequency_hz=FREQUENCY_STEP_HZ), Nudge(frequency_hz=-FREQUENCY_STEP_HZ)
_LEFT, _RIGHT = Nudge(bias_rad=LEFT * BIAS_STEP_RAD), Nudge(bias_rad=-LEFT * BIAS_STEP_RAD)
_WIDER = Nudge(amplitude_rad=AMPLITUDE_STEP_RAD)
_NARROWER = Nudge(amplitude_rad=-AMPLITUDE_STEP_RAD)
KEYS: Final[dict[str, Input]] = {
    "up": _FASTER,
    "w": _FASTER,
    "down": _SLOWER,
    "s": _SLOWER,
    "left": _LEFT,
    "a": _LEFT,
    "right": _RIGHT,
    "d": _RIGHT,
    "+": _WIDER,
    "=": _WIDER,
    "-": _NARROWER,
    "c": Hold(bias_rad=0.0),
    " ": Stop(),
    "q": End("q was pressed"),
    "\x04": End("Ctrl-D was pressed"),
}
"""What each key does; others do nothing."""
HELP: Final = (
    "arrows or WASD: faster, slower, left, right; + −: amplitude; c: straight; space: stop; q: end"
)

_ARROWS: Final = {0x41: "up", 0x42: "down", 0x43: "right", 0x44: "left"}
_ESCAPE: Final = 0x1B


class KeyDecoder:
    """Makes keys of octets: letters as they are (lower case), arrows by name."""

    __slots__ = ("_pending",)

    def __init__(self) -> None:
        self._pending = bytearray()  # of an escape sequence

    @property
    def waiting(self) -> bool:
        """Whether an escape sequence has begun: `idle` after `ESCAPE_S` ends it."""
        return bool(self._pending)

    def receive(self, data: bytes) -> list[str]:
        """Return the keys that end in these octets."""
        keys = []
        pending = self._pending
        for octet in data:
            if octet == _ESCAPE:
                pending[:] = bytes((octet,))
            elif not pending:
                keys.append(chr(octet).lower())
            elif len(pending) == 1 and octet in b"[O":
                pending.append(octet)
            elif len(pending) == 1:
                pending.clear()  # Alt with a key: neither
            elif 0x40 <= octet <= 0x7E:  # the final octet of a sequence
                if octet in _ARROWS:
                    keys.append(_ARROWS[octet])
                pending.clear()
            else:
                pending.append(octet)
                if len(pending) > 16:
                    pending.clear()
        return keys

    def idle(self) -> list[str]:
        """Say that nothing followed."""
        lone = len(self._pending) == 1
        self._pending.clear()
        return ["escape"] if lone else []


def inputs(keys: list[str]) -> list[Input]:
    """Return what keys do, in order."""
    return [KEYS[key] for key in keys if key in KEYS]


@contextlib.contextmanager
def cbreak(descriptor: int) -> Iterator[None]:
    """Take keys one by one and without echo; the terminal is as before at the end.

    Raises:
        UserError: it is no terminal.

    """
    if not os.isatty(descriptor):
        raise UserError(
            "--input keyboard: standard input is no terminal; use --input script:FILE, or run it "
            "in one"
        )
    import termios
    import tty

    before = termios.tcgetattr(descriptor)
    try:
        tty.setcbreak(descriptor)
        yield
    finally:
        with contextlib.suppress(termios.error):  # one that hung up has nothing to restore
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
