"""What was noticed about the user's data: said once, in one line, with place and remedy."""

from __future__ import annotations

from dataclasses import dataclass

from tools.errors import UserError


class DataError(UserError, ValueError):
    """Measured data that cannot be used; `str()` is one line with the remedy."""


@dataclass(frozen=True, slots=True)
class Notice:
    """Something odd that was handled: ``kind`` a word for programs, ``text`` a line for people."""

    kind: str
    text: str
