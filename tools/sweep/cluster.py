"""Points on the workers of a Dask cluster that somebody else has started.

The cluster's scheduler hands a point of a worker that died to another one; that is why nothing here
counts workers, and why a point is only given up when the scheduler itself does so. Points are sent
a few ahead of what the cluster has threads for. A worker with other sources than ours would give
other results: it says so instead of computing, and the sweep ends there. Where the scheduler is
lost, or no worker is left for long, the sweep ends too, and goes on later from its journal.

Dask is optional and imported here only.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import re
import time
import uuid
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from tools.errors import MissingProgramError, UserError

if TYPE_CHECKING:
    from tools.sweep.compute import Record

ANSWER_S = 10.0
"""To wait for a scheduler's first answer, and for its first worker."""
PATIENCE_S = 60.0
"""To wait while a cluster that had workers has none: a nanny restarts one in a few seconds."""
LOOK_S = 1.0
"""Between looks at who is there."""
AHEAD = 4
"""Points that are sent for each thread of the cluster: it need not wait for us between two."""
MOST_AHEAD = 1000

ADDRESS = re.compile(r"((tcp|tls)://)?([^\s:/]+|\[[0-9A-Fa-f:.]+\]):\d{1,5}")
"""What Dask takes; it looks at an address too late to fail tidily."""
REMEDY = "install Dask into this environment: pip install distributed"


class ClusterError(UserError, ConnectionError):
    """A cluster does not answer, is lost, or cannot compute what it is given."""


def compute_on(
    address: str, points: Sequence[int], task: Callable[[int], bytes]
) -> Generator[tuple[int, Record]]:
    """Compute points on the cluster at `address`; yields each with its record as it is done.

    Raises `MissingProgramError` where Dask is not installed, and `ClusterError`.
    """
    if not ADDRESS.fullmatch(address):
        raise ClusterError(f"--scheduler {address}: no address such as tcp://127.0.0.1:8786")
    try:
        import distributed
    except ImportError as error:
        raise MissingProgramError(f"--scheduler needs {error.name}: {REMEDY}") from error
    from tools.sweep.compute import code_digest, compute_remotely

    for logger in logging.root.manager.loggerDict:  # what they log of a lost connection we say
        if logger.startswith("distributed"):
            logging.getLogger(logger).setLevel(logging.CRITICAL)
    with _client(distributed, address) as client:
        name, code = uuid.uuid4().hex, code_digest()
        waiting = deque(points)
        futures: dict[int, Any] = {}
        done: queue.SimpleQueue[tuple[int, Any]] = queue.SimpleQueue()
        watch = _Watch(client, address)
        try:
            while waiting or futures:
                ahead = watch.ahead()
                while waiting and len(futures) < ahead:
                    point = waiting.popleft()
                    future = client.submit(
                        compute_remotely, task(point), code, key=f"fishbed-{name}-{point}"
                    )
                    futures[point] = future
                    future.add_done_callback(lambda ended, point=point: done.put((point, ended)))
                try:
                    point, future = done.get(timeout=LOOK_S)
                except queue.Empty:
                    continue
                record = _record(distributed, future, address)
                del futures[point]
                future.release()
                yield point, record
        finally:
            with contextlib.suppress(Exception):  # it may be the connection that has failed
                client.cancel(list(futures.values()), force=True)


@contextlib.contextmanager
def _client(distributed: Any, address: str) -> Iterator[Any]:
    """Connect to a scheduler that answers in time and has a worker."""
    try:
        client = distributed.Client(
            address, timeout=ANSWER_S, set_as_default=False, name="fishbed-sweep"
        )
    except (OSError, TimeoutError) as error:
        raise ClusterError(
            f"--scheduler {address}: no Dask scheduler answers within {ANSWER_S:g} s; "
            "start one with: dask scheduler"
        ) from error
    try:
        try:
            client.wait_for_workers(1, timeout=ANSWER_S)
        except TimeoutError as error:
            raise ClusterError(
                f"--scheduler {address}: the scheduler has no workers; "
                f"start some with: dask worker {address}"
            ) from error
        yield client
    finally:
        with contextlib.suppress(Exception):  # what is left of a connection that has failed
            client.close(timeout=2)


class _Watch:
    """Looks whether a cluster is still there, not more often than every `LOOK_S`."""

    def __init__(self, client: Any, address: str) -> None:
        self.client = client
        self.address = address
        self.looked_at = -LOOK_S
        self.worked_at = time.monotonic()
        self.threads = 0

    def ahead(self) -> int:
        """How many points to have under way; raises `ClusterError` where nobody is to do them."""
        now = time.monotonic()
        if now - self.looked_at >= LOOK_S:
            self._look()
            self.looked_at = now
        if self.threads:
            self.worked_at = now
        elif now - self.worked_at > PATIENCE_S:
            raise ClusterError(
                f"--scheduler {self.address}: no worker is left, for {PATIENCE_S:g} s now; "
                f"start some with: dask worker {self.address}"
            )
        return min(AHEAD * max(self.threads, 1), MOST_AHEAD)

    def _look(self) -> None:
        if self.client.status in ("closed", "closing"):
            raise _lost(self.address)
        try:
            self.threads = sum(self.client.nthreads().values())
        except OSError as error:
            raise _lost(self.address) from error


def _record(distributed: Any, future: Any, address: str) -> Record:
    """What a future that has ended holds."""
    if future.status in ("cancelled", "lost"):
        raise _lost(address)
    error = future.exception()
    if isinstance(error, distributed.scheduler.KilledWorker):
        return {"error": "given up: one worker after another died over it", "given_up": True}
    if error is not None:
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise ClusterError(
            f"--scheduler {address}: a worker cannot compute: {what}; "
            "its Python must have the same fishbed and Dask as this one"
        )
    record: Record = future.result()
    if "other_code" in record:
        raise ClusterError(
            f"--scheduler {address}: a worker has other sources of fishbed "
            f"({record['other_code']}) than this machine: install the same on both"
        )
    return record


def _lost(address: str) -> ClusterError:
    return ClusterError(f"--scheduler {address}: the connection to the scheduler is lost")
