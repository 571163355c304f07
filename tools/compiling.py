"""One line on stderr when machine code is made: a cold start takes long, and should say why.

Numba announces every function that it compiles, and none that it finds in its cache; so a warm
start says nothing. The plant itself prints nothing and knows no terminal.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

NOTICE = (
    "fishbed: compiling the plant's equations for this machine, which takes up to a minute; later "
    "runs find the code"
)
WORTH_SAYING_S = 2.0
"""A shorter wait needs no word at its end."""


def say(text: str) -> None:
    """Print a line where progress is shown."""
    print(text, file=sys.stderr, flush=True)


@contextlib.contextmanager
def noticed(begin: Callable[[], None]) -> Iterator[Callable[[], float]]:
    """Call `begin` before the first function is compiled within; yields the seconds spent so far.

    Functions that others call are compiled within theirs: only the outermost count.
    """
    from numba.core import event

    class Listener(event.Listener):
        depth = 0
        since = spent_s = 0.0
        told = False

        def on_start(self, event: Any) -> None:
            if not self.told:
                self.told = True
                begin()
            if self.depth == 0:
                self.since = time.perf_counter()
            self.depth += 1

        def on_end(self, event: Any) -> None:
            self.depth -= 1
            if self.depth == 0:
                self.spent_s += time.perf_counter() - self.since

    with event.install_listener("numba:compile", Listener()) as listener:
        yield lambda: float(listener.spent_s)


@contextlib.contextmanager
def compiling_shown(wanted: bool) -> Iterator[None]:
    """Say when compiling begins, and at the end how long it took."""
    if not wanted:
        yield
        return
    with noticed(lambda: say(NOTICE)) as spent_s:
        try:
            yield
        finally:
            if spent_s() >= WORTH_SAYING_S:
                say(f"fishbed: compiling took {spent_s():.0f} s of this run")
