"""Run studies on all cores, each in one of a few processes, and keep the order of the table.

A worker process takes one study after another over its own pipe, so that importing and loading
compiled code is paid once a process. Processes are spawned, not forked: a fork would copy threads
of a progress display. Workers ignore Ctrl-C, which a terminal sends to the whole group; the parent
gets it and ends them. A study that raises is reported with its traceback and the others go on; a
worker that dies (out of memory, say) costs its study, not the run. Pictures are drawn where the
study ran: they take about as long as the studies themselves.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from tools.compiling import noticed
from tools.studies.study import Result
from tools.studies.table import Row

Report = Callable[[int, float], None]
"""Told which row (its index) has got how far: 0 as it begins, 1 as it ends."""
_COMPILING = "compiling"  # what a worker says when it begins to

_COMPUTING = 0.9  # share of a study before its pictures, for the progress display
_LEAST_STEP = 0.01  # of a study: less than a hundredth is not worth a message


@dataclass(frozen=True, slots=True)
class Outcome:
    """A study that has run: its result, or the traceback of why there is none.

    ``pictures``: a drawing of each panel of each figure, in order, where drawings were asked for.
    """

    row: Row
    result: Result | None
    failure: str = ""
    pictures: tuple[str, ...] = ()


@dataclass(slots=True)
class _Worker:
    process: BaseProcess
    pipe: Connection
    index: int | None = None


def cores() -> int:
    """How many processes may run at a time."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on Linux
        return os.cpu_count() or 1


def run_studies(
    rows: Sequence[Row],
    report: Report = lambda index, share: None,
    *,
    pictures: bool = False,
    workers: int | None = None,
    compiling: Callable[[], None] = lambda: None,
) -> tuple[Outcome, ...]:
    """Run every row and return the outcomes in the order given, drawn where ``pictures``.

    One study, or one worker, runs in this process. An interruption ends the workers and goes on.
    ``compiling`` is called once, before the first worker compiles anything.
    """
    count = min(cores() if workers is None else workers, len(rows))
    if count <= 1:
        with noticed(compiling):
            return tuple(_here(index, row, report, pictures) for index, row in enumerate(rows))
    told = False
    found: dict[int, Outcome] = {}
    queue = iter(range(len(rows)))
    crew = _start(count, pictures)
    try:
        for worker in crew:
            _give(worker, queue, rows, report)
        while len(found) < len(rows):
            busy = {worker.pipe: worker for worker in crew if worker.index is not None}
            for pipe in wait(list(busy)):
                worker = busy[pipe]  # type: ignore[index]  # `wait` returns what it was given
                index = worker.index
                assert index is not None
                try:
                    said = worker.pipe.recv()
                except EOFError:
                    worker.process.join()
                    code = worker.process.exitcode
                    found[index] = Outcome(rows[index], None, f"its process ended with {code}")
                    crew[crew.index(worker)] = worker = _start(1, pictures)[0]
                else:
                    if said == _COMPILING:
                        if not told:
                            told = True
                            compiling()
                        continue
                    if isinstance(said, float):
                        report(index, said)
                        continue
                    found[index] = said
                report(index, 1.0)
                _give(worker, queue, rows, report)
    finally:
        for worker in crew:
            worker.process.terminate()
        for worker in crew:
            worker.process.join()
            worker.pipe.close()
    return tuple(found[index] for index in range(len(rows)))


def _here(index: int, row: Row, report: Report, pictures: bool) -> Outcome:
    report(index, 0.0)
    made = _outcome(row, lambda share: report(index, share), pictures)
    report(index, 1.0)
    return made


def _give(worker: _Worker, queue: Iterator[int], rows: Sequence[Row], report: Report) -> None:
    worker.index = next(queue, None)
    if worker.index is not None:
        worker.pipe.send(rows[worker.index])
        report(worker.index, 0.0)


def _start(count: int, pictures: bool) -> list[_Worker]:
    """Spawn workers that do not hear Ctrl-C (a disposition to ignore outlives `exec`)."""
    context = multiprocessing.get_context("spawn")
    crew = []
    with _deaf():
        for _ in range(count):
            ours, theirs = context.Pipe()
            process = context.Process(target=_work, args=(theirs, pictures), daemon=True)
            process.start()
            theirs.close()
            crew.append(_Worker(process, ours))
    return crew


@contextlib.contextmanager
def _deaf() -> Iterator[None]:
    try:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    except ValueError:  # not in the main thread: there, nobody can press Ctrl-C
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _work(pipe: Connection, pictures: bool) -> None:
    """Life of a worker: a row comes, numbers below 1 go back, then the outcome."""
    one_at_a_time = threading.Lock()  # a study's threads compile, too

    def send(said: object) -> None:
        with one_at_a_time:
            pipe.send(said)

    # the parent may be gone
    with contextlib.suppress(EOFError, BrokenPipeError), noticed(lambda: send(_COMPILING)):
        while True:
            row = pipe.recv()
            told = 0.0

            def tell(share: float) -> None:
                nonlocal told
                if share >= told + _LEAST_STEP:
                    told = share
                    send(float(share))

            send(_outcome(row, tell, pictures))


def _outcome(row: Row, progress: Callable[[float], None], pictures: bool) -> Outcome:
    try:
        result = row.load().compute(lambda share: progress(_COMPUTING * share))
        drawn: tuple[str, ...] = ()
        if pictures:
            from tools.studies.drawing import draw_all

            drawn = draw_all(row.name, result)
    except Exception:  # a fault in one study: kept whole for its reporter, and the others go on
        return Outcome(row, None, traceback.format_exc())
    return Outcome(row, result, pictures=drawn)
