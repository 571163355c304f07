"""Points on the cores of this machine, each worker a process with a pipe of its own.

A pool that shares one queue cannot tell whose point was lost when a process is killed, and breaks
as a whole. Here each worker holds one point at a time, and its pipe ends when it does: that point
goes to a fresh process, and the others never notice. The pipe also works the other way: a worker
whose parent is gone sees the end of it within 50 simulated milliseconds, and ends too.

Where there is one, a fork server imports the robot once for all workers. Ctrl-C is the parent's
affair: its signal is blocked in every child.
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import multiprocessing.connection
import os
import signal
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

from tools.errors import MissingProgramError

if TYPE_CHECKING:
    from multiprocessing.process import BaseProcess

    from tools.sweep.compute import Record

MOST_DEATHS = 3
"""Of processes over one point, after which the point is given up."""
METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
READY = b""
"""What a worker says when it has imported everything."""


@dataclass(slots=True)
class _Worker:
    process: BaseProcess
    pipe: Connection
    ready: bool = False
    point: int | None = None


def cores() -> int:
    """How many processes this one may keep busy."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # Linux alone has it
        return os.cpu_count() or 1


def compute_here(
    points: Sequence[int], task: Callable[[int], bytes], jobs: int
) -> Generator[tuple[int, Record]]:
    """Compute points in `jobs` processes; yields each with its record as it is done.

    `task` encodes the scenario of a point. Closing the iterator ends the processes. Raises
    `MissingProgramError` where processes die before they can do anything.
    """
    waiting = deque(points)
    deaths: Counter[int] = Counter()
    stillborn = 0
    workers: list[_Worker] = []
    try:
        while waiting or any(worker.point is not None for worker in workers):
            busy = sum(worker.point is not None for worker in workers)
            while len(workers) < min(jobs, busy + len(waiting)):
                workers.append(_start())
            ended = multiprocessing.connection.wait([worker.pipe for worker in workers])
            for worker in [worker for worker in workers if worker.pipe in ended]:
                try:
                    said = worker.pipe.recv_bytes()
                except (EOFError, OSError):  # OSError: killed in the middle of a message
                    workers.remove(worker)
                    how = _buried(worker)
                    if not worker.ready:
                        stillborn += 1
                        if stillborn == MOST_DEATHS:
                            raise MissingProgramError(
                                f"worker processes end before they begin ({how}): "
                                "is there memory for them? try --jobs 1"
                            ) from None
                    if worker.point is not None:
                        deaths[worker.point] += 1
                        if deaths[worker.point] < MOST_DEATHS:
                            waiting.appendleft(worker.point)
                        else:
                            yield worker.point, _given_up(how)
                    continue
                worker.ready = True
                if worker.point is not None:
                    point, worker.point = worker.point, None
                    _assign(worker, waiting, task)
                    yield point, json.loads(said)
                else:
                    _assign(worker, waiting, task)
    finally:
        for worker in workers:
            worker.pipe.close()
            worker.process.terminate()
        for worker in workers:
            worker.process.join()


def _assign(worker: _Worker, waiting: deque[int], task: Callable[[int], bytes]) -> None:
    """Hand the next point to a worker that is free."""
    if waiting:
        point = waiting.popleft()
        try:
            worker.pipe.send_bytes(task(point))
        except OSError:  # it died while idle: the next look at its pipe says so
            waiting.appendleft(point)
        else:
            worker.point = point


def _start() -> _Worker:
    context: Any = multiprocessing.get_context(METHOD)
    if METHOD == "forkserver":
        context.set_forkserver_preload(["tools.bench", "tools.sweep.compute"])
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs,), daemon=True)
    with _without_interrupt():
        process.start()
    theirs.close()
    return _Worker(process, ours)


@contextlib.contextmanager
def _without_interrupt() -> Iterator[None]:
    """Block Ctrl-C for the moment in which a child inherits what is blocked; nothing is lost."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(pipe: Connection) -> None:
    """What a worker does: points, until its pipe ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    import tools.bench  # noqa: F401  # before it says that it is ready
    from tools.sweep.compute import compute

    with contextlib.suppress(EOFError, OSError):
        pipe.send_bytes(READY)
        while True:
            record = compute(pipe.recv_bytes(), pipe.poll)
            if record is None:
                return
            pipe.send_bytes(json.dumps(record).encode())


def _buried(worker: _Worker) -> str:
    """Wait for a process that has ended; returns how it did."""
    worker.pipe.close()
    worker.process.join()
    code = worker.process.exitcode
    if code is not None and code < 0:
        with contextlib.suppress(ValueError):
            return f"killed by {signal.Signals(-code).name}"
    return f"exit {code}"


def _given_up(how: str) -> Record:
    return {
        "error": f"given up: its process died {MOST_DEATHS} times ({how})",
        "given_up": True,
    }
