"""Numbers of starts: each program's start is another boot, also when nothing was kept of the last.

The link tells boots apart by their numbers (docs/link.md). A real board keeps a counter over its
resets; a program that is started again has no memory, its process number may come again (in a
container it always does), and two that both began at 1 would each take the newcomer for the peer
that it knew: the link would stall. So what is in the memories of an emulated board that others
talk to, and the number of an end of a plant's line, are drawn.
"""

from __future__ import annotations

import secrets
from typing import Final

MOST: Final = 0xFE00
"""Below the largest number that both counters hold, so that boots within a run still count up."""


def start_number() -> int:
    """Return a number from 1 to `MOST`; two starts in a row have the same once in 65 024."""
    return secrets.randbelow(MOST) + 1
