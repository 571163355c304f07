"""A board that is started again and does not say so: nothing is delivered, and that is told."""

from types import SimpleNamespace
from typing import Any, cast

from spi_bus.link_types import Statistics
from tools.bench.real import LEAST_REPEATED, RealBoard


def told(**counts: int) -> str:
    links = [SimpleNamespace(statistics=Statistics(**counts), connected=True)]
    board = SimpleNamespace(connected=True, where="serial near", _links=lambda: links)
    board._repeats = lambda: RealBoard._repeats(cast(Any, board))
    return RealBoard.diagnosis(cast(Any, board))


def test_nothing_but_repetitions_is_a_board_that_did_not_count_its_start() -> None:
    assert "12 messages came and all count as repetitions" in told(duplicates=12)


def test_repetitions_beside_news_are_the_link_at_work() -> None:
    assert told(duplicates=12, messages_received=1) == ""
    assert told(duplicates=LEAST_REPEATED - 1) == ""
