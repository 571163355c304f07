"""What has been executed: a line a piece in the corpus's `executions.csv`, summed by target."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tools.errors import UserError

NAME: Final = "executions.csv"
HEAD: Final = "target,executions,seconds,cover,memory_mb"


@dataclass(frozen=True, slots=True)
class Done:
    """What one or several pieces did: their sums, and the most of coverage and memory."""

    executions: int = 0
    seconds: int = 0
    """Without the start; libFuzzer counts whole seconds."""
    cover: int = 0
    memory_mb: int = 0
    pieces: int = 0

    @property
    def per_s(self) -> float:
        """Executions a second."""
        return self.executions / max(1, self.seconds)

    def plus(self, other: Done) -> Done:
        """Both together."""
        return Done(
            self.executions + other.executions,
            self.seconds + other.seconds,
            max(self.cover, other.cover),
            max(self.memory_mb, other.memory_mb),
            self.pieces + other.pieces,
        )


def append(corpus: Path, target: str, done: Done) -> None:
    """Write one piece down."""
    path = corpus / NAME
    new = not path.exists()
    with path.open("a", encoding="utf-8") as file:
        if new:
            file.write(HEAD + "\n")
        figures = (done.executions, done.seconds, done.cover, done.memory_mb)
        file.write(",".join((target, *map(str, figures))) + "\n")


def total(corpus: Path, target: str) -> Done:
    """What has been done of a target.

    Raises:
        UserError: the file is no such log.

    """
    path = corpus / NAME
    done = Done()
    if not path.exists():
        return done
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        name, *figures = line.split(",")
        if name != target:
            continue
        try:
            executions, seconds, cover, memory_mb = map(int, figures)
        except ValueError:
            raise UserError(f"{path}:{number} is not {HEAD}: {line!r}") from None
        done = done.plus(Done(executions, seconds, cover, memory_mb, 1))
    return done
