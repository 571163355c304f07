"""What follows from items: octets by hand, weighted means, and that their order does not matter."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from procboard.survey.items import ITEMS, SURVEY_ITEMS, Done, Gone, Present, Sample, Skip
from procboard.survey.knowledge import Grid, Knowledge
from procboard.survey.sweeps import Pose
from radio_802154.routing_messages import MAX_ITEM_OCTETS
from spi_bus.errors import FieldError

GRID = Grid(5, 6, 0.25, 1.0, 2.0)
CELLS = st.tuples(st.integers(0, 4), st.integers(0, 5))
ROBOTS = st.integers(1, 3)


def sample(cell, value=1.0, deviation=0.5, time_ms=0):
    return Sample(*cell, value, deviation, 10, 0.0, 0.0, time_ms)


ANY = st.one_of(
    st.builds(sample, CELLS, st.floats(-100, 100), st.floats(0.1, 3.0)),
    st.builds(Skip, st.integers(0, 4), st.integers(0, 5), st.booleans()),
    st.builds(Gone, ROBOTS, st.integers(0, 9)),
    st.builds(Present, st.floats(-3, 3), st.floats(-3, 3), st.booleans()),
    st.builds(Done, st.integers(0, 30), st.integers(0, 2**32 - 1)),
)


def known(*items):
    """Knowledge of (origin, number, item)."""
    made = Knowledge(GRID)
    for origin, number, item in items:
        made.receive(origin, number, ITEMS.encode(item))
    return made


def everything(knowledge):
    return (
        {cell: knowledge.reading(cell) for cell in knowledge.samples},
        knowledge.skips,
        knowledge.given_up(),
        knowledge.latest,
        [knowledge.lives(robot) for robot in (1, 2, 3)],
        knowledge.poses(frozenset(sorted(knowledge.samples)[::2])),
        [knowledge.done(robot) for robot in (1, 2, 3)],
        knowledge.digest(),
    )


def test_octets_of_a_sample_by_hand():
    octets = ITEMS.encode(Sample(3, 17, -12.3456, 0.25, 9, 0.012, -0.02, 0x01020304))
    expected = "01 03 11 fffe1dc0 000009c4 09 0c ec 01020304"
    assert octets == bytes.fromhex(expected)
    assert max(row.size for row in SURVEY_ITEMS) == len(octets) <= MAX_ITEM_OCTETS


def test_a_deviation_of_zero_is_no_deviation():
    with pytest.raises(FieldError):
        ITEMS.encode(sample((0, 0), deviation=0.0))


@given(st.dictionaries(st.tuples(ROBOTS, st.integers(1, 9)), ANY, max_size=20), st.randoms())
def test_order_and_repetition_do_not_matter(items, chance):
    listed = [(*name, item) for name, item in items.items()]
    shuffled = listed + chance.choices(listed, k=10) if listed else []
    chance.shuffle(shuffled)
    assert everything(known(*listed)) == everything(known(*shuffled))


def test_repeats_are_weighted_by_their_precision():
    one = known((1, 1, sample((2, 2), 10.0, 1.0)), (2, 1, sample((2, 2), 20.0, 2.0)))
    reading = one.reading((2, 2))
    assert reading is not None
    assert reading == pytest.approx((12.0, math.sqrt(0.8)))
    # an equal value of another robot is another reading
    two = known((1, 1, sample((2, 2), 10.0, 1.0)), (2, 1, sample((2, 2), 10.0, 1.0)))
    assert two.reading((2, 2)) == pytest.approx((10.0, math.sqrt(0.5)))
    assert two.reading((0, 0)) is None


def test_a_robot_is_gone_up_to_the_item_that_was_named():
    there = Present(0.0, 0.0, joined=True)
    knowledge = known((1, 4, there), (2, 1, Gone(1, 4)))
    assert not knowledge.lives(1)
    assert knowledge.lives(2)
    assert known((1, 5, there), (2, 1, Gone(1, 4))).lives(1)
    assert not known((1, 4, there), (1, 5, Gone(1, 0))).lives(1)
    assert known((1, 5, Gone(1, 0)), (1, 6, there)).lives(1)
    assert not known().lives(1)


def test_where_robots_are_for_the_plan():
    items = (
        (1, 1, Present(0.5, 0.5, joined=True)),
        (1, 2, sample((0, 0))),
        (1, 3, sample((0, 3))),
        (1, 4, Present(9.0, 9.0, joined=False)),
        (2, 1, sample((4, 4))),
        (3, 1, Skip(0, 0, final=False)),
    )
    knowledge = known(*items)
    assert knowledge.poses({(0, 0), (0, 3)}) == {
        1: Pose(1.75, 2.0, 0.0),
        2: Pose(2.0, 3.0),  # of the first stay, for want of one that counts
    }
    assert knowledge.poses({(0, 0)})[1] == Pose(1.0, 2.0, math.atan2(1.5, 0.5))
    assert knowledge.poses(set())[1] == Pose(0.5, 0.5)


def test_two_robots_or_a_final_word_give_a_cell_up_and_a_sample_makes_good():
    one = (1, 1, Skip(1, 1, final=False))
    assert known(one).given_up() == []
    assert known(one, (1, 2, Skip(1, 1, final=False))).given_up() == []
    assert known(one, (2, 1, Skip(1, 1, final=False))).given_up() == [(1, 1)]
    assert known((1, 1, Skip(1, 1, final=True))).given_up() == [(1, 1)]
    assert known((1, 1, Skip(1, 1, final=True)), (2, 1, sample((1, 1)))).given_up() == []


def test_what_makes_no_sense_is_counted_and_its_sender_lives():
    knowledge = Knowledge(GRID)
    for number, octets in enumerate((b"", b"\x09", ITEMS.encode(sample((5, 0)))), 1):
        assert knowledge.receive(7, number, octets) is None
    assert knowledge.bad_items == 3
    assert knowledge.samples == {}
    assert knowledge.lives(7)


def test_the_digest_tells_samples_apart():
    rng = random.Random(0)
    digests = set()
    for _ in range(200):
        knowledge = known((rng.randrange(9), rng.randrange(99), sample((rng.randrange(5), 2))))
        digests.add((knowledge.digest(), *(knowledge.samples.items().__iter__().__next__()[1])))
    assert len({digest for digest, *_ in digests}) > 150
