"""Forms that most decoders fit: with one of them a new target is a row of the table.

A form makes a target, a function of octets that returns or fails an assertion, from the decoder's
own functions. `stream` is for what cuts a stream, `parser` for what reads one whole piece.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from operator import attrgetter
from typing import Any, Protocol, TypeVar

Run = Callable[[bytes], None]
"""A target: any exception but those that its form allows is a finding."""

T = TypeVar("T")


class StreamDecoder(Protocol[T]):
    """A decoder of a stream: octets in, what they complete out."""

    def receive(self, data: bytes, /) -> list[T]:
        """Return what these octets complete."""


def stream(
    make: Callable[[], StreamDecoder[T]],
    longest: int,
    *,
    write: Callable[[T], bytes] | None = None,
    in_step: tuple[bytes, T] | None = None,
    kept: Callable[[Any], int] = attrgetter("buffered"),
) -> Run:
    """A stream decoder: cuts change nothing, memory is bounded, what came out goes in again.

    Args:
        make: a new decoder.
        longest: octets that it may keep.
        write: the encoder: what was decoded comes out again, alone.
        in_step: octets that put it in step after anything, and what they hold.
        kept: octets that a decoder keeps of what has not ended.

    """

    def run(data: bytes) -> None:
        whole, cut = make(), make()
        found = whole.receive(data)
        place = data[0] if data else 0
        first = cut.receive(data[:place])
        assert kept(cut) <= longest
        assert first + cut.receive(data[place:]) == found
        assert kept(whole) == kept(cut) <= longest
        if write is not None:
            for item in found:
                assert make().receive(write(item)) == [item]
        if in_step is not None:
            octets, item = in_step
            assert whole.receive(octets)[-1:] == [item]

    return run


def parser(
    read: Callable[[bytes], T],
    refuses: type[Exception] | tuple[type[Exception], ...],
    write: Callable[[T], bytes] | None = None,
) -> Run:
    """A reader of one piece: it returns or refuses; what it read is written and read as the same.

    Args:
        read: the decoder.
        refuses: what it raises, and nothing else.
        write: the encoder.

    """

    def run(data: bytes) -> None:
        try:
            found = read(data)
        except refuses:
            return
        if write is not None:
            assert read(write(found)) == found

    return run


def later(make: Callable[[], Run]) -> Run:
    """A target that is made when it is first run, for what takes long to import."""
    made = cache(make)

    def run(data: bytes) -> None:
        made()(data)

    return run


def all_of(*targets: Run) -> Run:
    """Several targets on the same octets."""

    def run(data: bytes) -> None:
        for target in targets:
            target(data)

    return run


def one_of(*targets: Run) -> Run:
    """The target that the first octet chooses, on the rest: each execution costs one of them."""

    def run(data: bytes) -> None:
        targets[data[0] % len(targets) if data else 0](data[1:])

    return run
