"""How far a sweep is, on stderr: a bar on a terminal, now and then a line elsewhere."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator

LINE_EVERY_S = 10.0
"""Between lines in a log: often enough to see that it lives, seldom enough to read the rest."""

Step = Callable[[], None]
"""Called when one more point is done."""


@contextlib.contextmanager
def shown(total: int, done: int, *, wanted: bool) -> Iterator[Step]:
    """Show the progress of `total` points, of which `done` are there already."""
    if not wanted or done == total:
        yield lambda: None
    elif sys.stderr.isatty():
        with _bar(total, done) as step:
            yield step
    else:
        yield _lines(total, done)


@contextlib.contextmanager
def _bar(total: int, done: int) -> Iterator[Step]:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("sweeping"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("points {task.fields[rate]} after"),
        TimeElapsedColumn(),
        TextColumn("remaining"),
        TimeRemainingColumn(),
    )
    begin, computed = time.monotonic(), 0
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("sweep", total=total, completed=done, rate="")

        def step() -> None:
            nonlocal computed
            computed += 1
            progress.update(task, advance=1, rate=_rate(computed, time.monotonic() - begin))

        yield step


def _lines(total: int, done: int) -> Step:
    begin = said = time.monotonic()
    computed = 0

    def step() -> None:
        nonlocal computed, said
        computed += 1
        now = time.monotonic()
        if now - said < LINE_EVERY_S:
            return
        said = now
        left = total - done - computed
        remaining_s = left * (now - begin) / computed
        print(
            f"fishbed: {done + computed} of {total} points, {_rate(computed, now - begin)}, "
            f"{remaining_s:.0f} s remaining",
            file=sys.stderr,
            flush=True,
        )

    return step


def _rate(computed: int, elapsed_s: float) -> str:
    """Points by time, in the unit that gives a readable number."""
    per_s = computed / max(elapsed_s, 1e-9)
    return f"{per_s:.1f}/s" if per_s >= 1 else f"{60 * per_s:.1f}/min"
