"""A board alone for hours: what it keeps does not grow, and what it says of the other is right.

The other board is a test's, on a clock that only moves when somebody waits: nothing here depends on
the machine.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from firmware_model.time import FS_PER_S
from spi_bus.link import Role
from tests.tools.far_side import Clock, FarSide
from tools import hil
from tools.bench import Bench
from tools.bench.live import Live
from tools.bench.real import RealBoard


@dataclass(slots=True)
class Alone:
    """An emulated board, and the far side of its line."""

    bench: Bench
    real: RealBoard
    far: FarSide

    def run(self, until_s: float) -> None:
        self.bench.scheduler.run(round(until_s * FS_PER_S))


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Alone]:
    def make(board: str, period_s: float = 0.1, *sets: str, keep: bool = False,
             answers: bool = True) -> Alone:  # fmt: skip
        clock = Clock()
        far = FarSide(
            Role.MASTER if board == "nav" else Role.SLAVE, clock, period_s, answers=answers
        )
        monkeypatch.setattr("tools.bench.outages.open_transport", lambda url, context: far)
        lines = {"proc": "pty:"} if board == "nav" else {"nav": "pty:"}
        config = hil.with_line(None, sets, duration_s=1e6, **lines)
        live = Live(config, clock, keep=keep)
        assert live.real is not None
        return Alone(Bench(config, live.scheduler, live, keep=keep), live.real, far)

    return make


def held(world: Alone) -> int:
    """Bytes of all that Python's garbage collector sees, and of what that holds."""
    world.bench.trace.flush()
    gc.collect()
    tracked = gc.get_objects()
    sizes = {id(each): sys.getsizeof(each, 0) for each in tracked}
    for each in tracked:
        for part in gc.get_referents(each):
            if id(part) not in sizes:
                sizes[id(part)] = sys.getsizeof(part, 0)
    return sum(sizes.values())


def grown(world: Alone, from_s: float, to_s: float) -> int:
    """Bytes that are held more at one time than at another."""
    world.run(from_s)
    before = held(world)
    world.run(to_s)
    return held(world) - before


@pytest.fixture
def little_room(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is bounded anyway is full after seconds."""
    monkeypatch.setattr("tools.bench.board_clock._MOST_POINTS", 20)
    monkeypatch.setattr("tools.bench.told._FIRST", 20)


BOUND = 30_000
"""Bytes in ten seconds; what a run that keeps its samples exceeds several times."""


@pytest.mark.usefixtures("little_room")
@pytest.mark.parametrize("board", ["nav", "proc"])
def test_a_board_alone_keeps_nothing(board: str, alone: Callable[..., Alone]) -> None:
    world = alone(board)
    assert grown(world, 5.0, 15.0) < BOUND
    assert world.far.count > 10


@pytest.mark.usefixtures("little_room")
def test_a_run_that_keeps_its_samples_is_seen_to_grow(alone: Callable[..., Alone]) -> None:
    assert grown(alone("nav", keep=True), 5.0, 15.0) > 8 * BOUND
