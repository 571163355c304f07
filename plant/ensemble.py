"""Many robots at once: parameter sets, beats or starts side by side, on all cores.

A member of an ensemble is one call of ``simulate`` (or ``periodic_orbit``), so it gives the bytes
that it gives alone, whatever the others do and however many workers there are. Threads serve as
workers: the compiled march needs no interpreter, so nothing is copied between processes and nothing
is compiled twice. Each worker takes the next member that nobody has; results stand in the order of
the members. The calling thread only waits, tells the progress, and can be interrupted: workers then
stop after the member they have.

Memory holds what is asked for, the wanted columns of the saved rows, and one whole run a worker.
A member that diverges takes no other with it and is named in ``failures``.
"""

import itertools
import os
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from plant.arrays import FloatArray
from plant.errors import DivergedError, InvalidParameterError, PlantError
from plant.integrate import simulate, steps_of
from plant.layout import Column
from plant.orbit import PeriodicOrbit, periodic_orbit
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start

Progress = Callable[[float], None]
"""Told the share that is done, 0 to 1, in the calling thread."""

VELOCITIES = (Column.X, Column.Y, Column.PSI, Column.U, Column.V, Column.R)
"""Columns that an ensemble keeps unless told otherwise: position and velocities."""

_T = TypeVar("_T")
_M = TypeVar("_M")

_LOOK_S = 0.1  # between two looks of the calling thread: what an eye takes for steady


def cores() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def for_each(
    function: Callable[[int], _T],
    count: int,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
) -> list[_T]:
    """[function(0), …, function(count − 1)], computed by ``workers`` threads (default: all cores).

    The first exception of a member stops the others and is raised, as is an interruption.
    """
    wanted = cores() if workers is None else workers
    if wanted < 1:
        raise InvalidParameterError("ensemble.workers", f"must be at least 1, got {workers}")
    tell = progress or (lambda share: None)
    results: list[_T | None] = [None] * count
    next_member = itertools.count()  # next() on it is one step of the interpreter
    stop = threading.Event()
    done = [0] * wanted

    def work(worker: int) -> None:
        while not stop.is_set():
            member = next(next_member)
            if member >= count:
                break
            results[member] = function(member)
            done[worker] += 1

    if wanted == 1:
        for member in range(count):
            results[member] = function(member)
            tell((member + 1) / count)
        return results  # type: ignore[return-value]  # every place is filled
    with ThreadPoolExecutor(min(wanted, max(count, 1)), "ensemble") as pool:
        pending = {pool.submit(work, worker) for worker in range(min(wanted, count))}
        try:
            while pending:
                finished, pending = wait(pending, _LOOK_S, FIRST_EXCEPTION)
                for future in finished:
                    future.result()
                tell(sum(done) / count)
        finally:
            stop.set()
    return results  # type: ignore[return-value]  # every place is filled


def _member(given: _M | Sequence[_M], index: int) -> _M:
    """A member's own of a sequence, or what all share."""
    return given[index] if isinstance(given, Sequence) else given


def _members(**given: object) -> int:
    """Number of members; sequences of different lengths are refused."""
    lengths = {name: len(each) for name, each in given.items() if isinstance(each, Sequence)}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{length} {name}" for name, length in lengths.items())
        raise InvalidParameterError("ensemble", f"sequences must be equally long, got {told}")
    return next(iter(lengths.values()), 1)


@dataclass(frozen=True, slots=True)
class Ensemble:
    """What the members of an ensemble left.

    ``time_s`` (rows,); ``values`` (members, rows, columns), columns as in ``columns``. A member in
    ``failures`` has its start's row throughout, and the error that ended it.
    """

    time_s: FloatArray
    values: FloatArray
    columns: tuple[Column, ...]
    failures: Mapping[int, DivergedError]

    @property
    def completed(self) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
        """Mask (members,) of the members that came through."""
        mask = np.ones(self.values.shape[0], dtype=np.bool_)
        mask[list(self.failures)] = False
        return mask

    def column(self, column: Column) -> FloatArray:
        """One column of all members as a view (members, rows)."""
        return self.values[:, :, self.columns.index(column)]

    def check(self) -> None:
        """Raise the ``DivergedError`` of the first member that did not come through."""
        for member in sorted(self.failures):
            raise self.failures[member]


def simulate_ensemble(
    parameters: PlantParameters | Sequence[PlantParameters],
    programmes: TailProgramme | Sequence[TailProgramme],
    duration_s: float,
    step_s: float = 1e-3,
    *,
    starts: Start | Sequence[Start] | None = None,
    save_every: int = 1,
    columns: Iterable[Column] = VELOCITIES,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Ensemble:
    """Simulate many members; what is no sequence is shared by all.

    ``save_every`` as in ``simulate``; 0 saves the last grid point alone. A diverging member is
    reported, not raised. Raises ``InvalidParameterError`` for nonsense.
    """
    count = _members(parameters=parameters, programmes=programmes, starts=starts)
    wanted = tuple(columns)
    picks = np.array([int(column) for column in wanted], dtype=np.int64)
    if save_every < 0:
        raise InvalidParameterError(
            "simulate_ensemble.save_every", f"must be at least 0, got {save_every}"
        )
    steps = steps_of("simulate_ensemble", duration_s, step_s, save_every)
    every = save_every if save_every > 0 else max(steps, 1)
    kept = slice(None) if save_every > 0 else slice(-1, None)
    times = np.arange(steps // every + 1, dtype=np.float64)[kept] * (every * step_s)
    values = np.empty((count, times.size, picks.size))
    failures: dict[int, DivergedError] = {}

    def one(member: int) -> None:
        start = _member(starts, member)
        p, programme = _member(parameters, member), _member(programmes, member)
        try:
            run = simulate(p, programme, duration_s, step_s, start, every)
        except DivergedError as error:
            failures[member] = error
            run = simulate(p, programme, 0.0, step_s, start)
            values[member] = run.rows[0, picks]
            return
        values[member] = run.rows[kept, picks]

    for_each(one, count, workers=workers, progress=progress)
    return Ensemble(times, values, wanted, dict(sorted(failures.items())))


@dataclass(frozen=True, slots=True)
class OrbitEnsemble(Generic[_T]):
    """What was taken from the orbit of each member; None where ``failures`` has its error."""

    values: tuple[_T | None, ...]
    failures: Mapping[int, PlantError]

    def all(self) -> tuple[_T, ...]:
        """Every member's value; raises the first failure where there is one."""
        for member in sorted(self.failures):
            raise self.failures[member]
        return self.values  # type: ignore[return-value]  # without a failure none is missing


def orbit_ensemble(
    parameters: PlantParameters | Sequence[PlantParameters],
    beats: TailBeat | Sequence[TailBeat],
    take: Callable[[PeriodicOrbit], _T],
    step_s: float = 1e-3,
    *,
    tolerance: float = 1e-8,
    workers: int | None = None,
    progress: Progress | None = None,
) -> OrbitEnsemble[_T]:
    """Steady motion of many members; ``take`` says what to keep of each orbit.

    A member without steady motion (``NoOrbitError``), diverging, or refused, is reported in
    ``failures``.
    """
    count = _members(parameters=parameters, beats=beats)
    failures: dict[int, PlantError] = {}

    def one(member: int) -> _T | None:
        p, beat = _member(parameters, member), _member(beats, member)
        try:
            return take(periodic_orbit(p, beat, step_s, tolerance=tolerance))
        except PlantError as error:
            failures[member] = error
            return None

    found = for_each(one, count, workers=workers, progress=progress)
    return OrbitEnsemble(tuple(found), dict(sorted(failures.items())))
