"""Trickle against RFC 6206: its examples, its rules one by one, its traffic in a crowd."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import log2
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from procboard.errors import ProcConfigError
from procboard.routing.machine import BROADCAST, Outgoing
from procboard.routing.trickle import Trickle, TrickleConfig
from tests.procboard.routing.air import Air, Node, chance, clique


@dataclass
class Fixed:
    """Chance that always gives the same share of the limit, in 256ths."""

    share: int = 0

    def below(self, limit: int) -> int:
        return limit * self.share // 256


def test_imax_of_the_rfc() -> None:
    # Section 4.1: Imin 100 ms and 16 doublings are "6,553.6 seconds or approximately 109 minutes".
    assert TrickleConfig(100, 16, 1).maximum_ms == 6_553_600


@pytest.mark.parametrize(
    ("imin", "doublings", "k"), [(1, 0, 1), (100, -1, 1), (100, 17, 1), (100, 1, 0)]
)
def test_values_that_no_timer_can_have(imin: int, doublings: int, k: int) -> None:
    with pytest.raises(ProcConfigError):
        TrickleConfig(imin, doublings, k)


def fire(trickle: Trickle) -> tuple[int, bool]:
    deadline = trickle.next_deadline()
    assert deadline is not None
    return deadline, trickle.handle_timer(deadline)


def test_the_rules_one_by_one() -> None:
    trickle = Trickle(TrickleConfig(100, 2, 2), Fixed(128))
    assert trickle.next_deadline() is None
    trickle.start(1000)
    assert fire(trickle) == (1075, True)  # rules 2 and 4: t in [I/2, I), c = 0 < k
    assert fire(trickle) == (1100, False)  # rule 5: the end; I doubles
    assert trickle.interval_ms == 200
    trickle.consistent()
    assert fire(trickle) == (1250, True)  # c = 1 < 2
    assert fire(trickle) == (1300, False)
    trickle.consistent()
    trickle.consistent()
    assert fire(trickle) == (1600, False)  # rule 4: c = k, nothing is sent
    assert fire(trickle) == (1700, False)
    assert trickle.interval_ms == 400  # Imax: I stays
    assert trickle.heard == 0
    trickle.inconsistent(1750)  # rule 6
    assert trickle.interval_ms == 100
    assert trickle.next_deadline() == 1825
    trickle.inconsistent(1790)  # I is Imin: nothing happens
    assert trickle.next_deadline() == 1825


def test_without_redundancy_nothing_is_suppressed() -> None:
    trickle = Trickle(TrickleConfig(100, 0, None), Fixed())
    trickle.start(0)
    for _ in range(50):
        trickle.consistent()
    assert fire(trickle) == (50, True)


@given(
    st.integers(2, 500), st.integers(0, 8), st.lists(st.integers(0, 5_000), max_size=40),
    st.integers(0, 2**20),
)  # fmt: skip
def test_late_calls_never_send_twice_and_t_lies_in_the_second_half(
    imin: int, doublings: int, lateness: list[int], seed: int
) -> None:
    trickle = Trickle(TrickleConfig(imin, doublings, None), chance(seed))
    now, began, sent = 0, 0, 0
    trickle.start(0)
    for late in lateness:
        deadline = trickle.next_deadline()
        assert deadline is not None
        interval, before = trickle.interval_ms, now
        now = max(deadline + late, now)
        if trickle.handle_timer(now):
            sent += 1
            assert began + interval // 2 <= deadline < began + interval
        following = trickle.next_deadline()
        assert following is not None
        assert following >= before
        if trickle.interval_ms != interval or following > began + interval:
            began = now
            assert imin <= trickle.interval_ms <= imin << doublings
    assert sent <= len(lateness)


@dataclass
class Talker(Node):
    trickle: Trickle = field(default_factory=lambda: Trickle(CROWD, chance(0)))
    sends: list[int] = field(default_factory=list)

    def begin(self, now_ms: int) -> None:
        self.trickle.start(now_ms)

    def receive(self, source: int, message: Outgoing, now_ms: int, **stamps: Any) -> None:
        self.trickle.consistent()

    def take(self, now_ms: int) -> Outgoing | None:
        if self.queue:
            return self.queue.popleft()
        return None

    def next_deadline(self) -> int | None:
        return self.trickle.next_deadline()

    def handle_timer(self, now_ms: int) -> None:
        if self.trickle.handle_timer(now_ms):
            self.queue.append(Outgoing(BROADCAST, 1, b""))


CROWD = TrickleConfig(10_000, 0, 1)
"""One long interval, so that what is on its way (4 ms) hardly counts."""


def messages_per_interval(count: int, loss: float, k: int = 1, seed: int = 1) -> float:
    config = TrickleConfig(CROWD.minimum_ms, 0, k)
    nodes = [
        Talker(n, start_ms=n * 997.0, trickle=Trickle(config, chance(seed, n)))
        for n in range(count)
    ]
    air = Air(nodes, clique(count, loss), seed)
    air.run(20)
    before = sum(air.frames.values())
    air.run(320)
    return (sum(air.frames.values()) - before) / 30


@pytest.mark.parametrize("k", [1, 2])
def test_a_crowd_without_loss_says_k_to_3k_an_interval(k: int) -> None:
    # Levis et al. (NSDI 2004): k messages an interval where all are in step, and with the
    # listen-only half no growth with n where they are not.
    for count in (4, 64):
        assert k * 0.9 <= messages_per_interval(count, 0.0, k) <= 3 * k


def test_with_loss_a_crowd_grows_with_its_logarithm() -> None:
    # RFC 6206, section 1; of n boards k log n to base 1/loss have not heard k others.
    few, many = messages_per_interval(8, 0.4), messages_per_interval(64, 0.4)
    assert many - few < 2 * log2(8)
    assert many < 3 + 2 * log2(64)
