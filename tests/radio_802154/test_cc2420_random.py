"""Properties of the CC2420 under arbitrary hosts: nothing lost or invented, nothing breaks it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from radio_802154 import cc2420_registers as r
from radio_802154.cc2420_registers import State

MakeWorld = Callable[..., Any]


@settings(max_examples=60, deadline=None)
@given(
    contents=st.lists(st.binary(min_size=3, max_size=60), min_size=1, max_size=5),
    reads=st.lists(st.tuples(st.integers(0, 40), st.integers(0, 3000)), max_size=12),
    threshold=st.integers(0, 127),
)
def test_whatever_is_sent_is_read_once_and_in_order(
    make_world: MakeWorld,
    contents: list[bytes],
    reads: list[tuple[int, int]],
    threshold: int,
) -> None:
    """The host reads any number of octets at any time, as far as FIFO says there are some."""
    world = make_world()
    a, b = world.chip("a"), world.chip("b", 1.0)
    b.write(r.IOCFG0, threshold)
    got = bytearray()

    def read(count: int) -> None:
        b.chip.select(True)
        b.chip.begin()
        b.chip.end(r.RXFIFO | 0x40)
        for _ in range(count):
            octet = b.chip.begin()  # fetches what has arrived
            if not b.chip.fifo.value:
                break
            b.chip.end(0)
            got.append(octet)
        b.chip.select(False)

    expected = b""
    plan = iter(reads)
    for content in contents:
        a.load(content)
        a.strobe(r.STXON)
        expected += bytes((len(content) + 2,)) + content + bytes((5, r.CRC_OK | 110))
        left = 192 + (6 + len(content) + 2) * 32 + 400
        for count, wait_us in [next(plan, (0, 0)), next(plan, (0, 0))]:
            wait = min(wait_us, left)
            world.run_us(wait)
            left -= wait
            read(count)
        world.run_us(left)
        if len(expected) - len(got) > 64:  # no overflow in this test
            read(128)
    read(128)
    assert bytes(got) == expected
    assert not b.chip.fifop.value


@settings(max_examples=60, deadline=None)
@given(
    accesses=st.lists(
        st.tuples(st.binary(min_size=1, max_size=12), st.integers(0, 2500)), max_size=25
    ),
    seed=st.integers(0, 2**32),
)
def test_no_host_breaks_the_chip(
    make_world: MakeWorld, accesses: list[tuple[bytes, int]], seed: int
) -> None:
    """Arbitrary SPI traffic; afterwards a reset gives a working chip."""
    world = make_world(seed=seed)
    peer, victim = world.chip("peer"), world.chip("victim", 1.0)
    for octets, wait_us in accesses:
        victim.transfer(*octets)
        peer.load(octets)
        peer.strobe(r.STXON)
        world.run_us(wait_us)
    world.run_us(6000)
    victim.chip.resetn(False)
    victim.chip.resetn(True)
    assert victim.chip.state is State.POWER_DOWN
    victim.strobe(r.SXOSCON)
    world.run_us(860)
    victim.write(r.MDMCTRL0, 0x02E2)
    victim.strobe(r.SRXON)
    world.run_us(320)
    peer.load(b"after all")
    peer.strobe(r.STXON)
    world.run_us(3000)
    assert victim.take_frame()[:-2] == b"after all"
