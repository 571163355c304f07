"""The gateway in an emulated air of real chips: times, acknowledgements, retries, who hears it."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import pytest

from firmware_model.time import FS_PER_US
from radio_802154 import cc2420_registers as r
from radio_802154 import mac
from radio_802154.fcs import fcs_ok, strip_fcs
from radio_802154.gateway import Gateway, Outcome
from radio_802154.medium import Antenna
from radio_802154.timing import ACK_WAIT_SYMBOLS, SYMBOL_US, ppdu_us

UNICAST = bytes.fromhex("6188 26 2200 0700 0100 3f 06 7e7d0102")
"""To 7, who is not emulated, from 1; an acknowledgement is wanted."""
TO_CHIP = bytes.fromhex("6188 55 2200 0100 0700 3f 21 616263")
"""To 1, from 7."""
ACK_55 = bytes.fromhex("0200 55")
CHANNEL = 11
"""FSCTRL's reset value: 2405 MHz."""


class Air:
    """One chip with address 1 that acknowledges, and the gateway."""

    def __init__(self, make_world: Callable[..., Any], answers: bool = True, **config: Any) -> None:
        self.world = make_world(**config)
        self.heard: list[bytes] = []
        self.answers = answers
        self.outcomes: list[Outcome] = []
        self.world.medium.place("mote", Antenna())
        self.gateway = Gateway(
            self.world.scheduler, self.world.medium, "mote", CHANNEL, self.hear, seed=3
        )
        self.chip = self.world.chip("chip", 1.0, address=1)

    def hear(self, octets: bytes) -> bool:
        self.heard.append(octets)
        return self.answers

    def speak(self, content: bytes) -> None:
        """The chip sends."""
        self.chip.strobe(r.SFLUSHTX)
        self.chip.load(content)
        self.chip.strobe(r.STXON)

    def send(self, content: bytes) -> bool:
        return self.gateway.send(content, self.outcomes.append)

    def frames(self) -> list[tuple[float, float, str, bytes]]:
        """Begin and end in µs, who, and what, FCS checked and taken off."""
        found = []
        for end, (start, channel, source, _dbm, psdu) in self.world.air():
            assert fcs_ok(psdu)
            assert channel == CHANNEL
            found.append((start / FS_PER_US, end / FS_PER_US, source, strip_fcs(psdu)))
        return found


@pytest.fixture
def air(make_world: Callable[..., Any]) -> Air:
    return Air(make_world)


def test_it_answers_twelve_symbols_after_a_frame(air: Air) -> None:
    air.speak(UNICAST)
    air.world.run_us(5_000)
    assert air.heard == [UNICAST]
    (_, end, who, frame), (begin, _, answerer, ack) = air.frames()
    assert (who, frame, answerer) == ("chip", UNICAST, "mote")
    assert ack == bytes.fromhex("0200 26")
    assert begin - end == 192


def test_it_is_silent_where_the_listener_says_no(make_world: Callable[..., Any]) -> None:
    air = Air(make_world, answers=False)
    air.speak(UNICAST)
    air.world.run_us(5_000)
    assert air.heard == [UNICAST]
    assert len(air.frames()) == 1


def test_it_sends_and_hears_the_acknowledgement(air: Air) -> None:
    assert air.send(TO_CHIP)
    air.world.run_us(20_000)
    assert air.outcomes == [Outcome.ACKNOWLEDGED]
    (begin, end, who, frame), (ack_begin, _, answerer, ack) = air.frames()
    assert (who, frame, answerer, ack) == ("mote", TO_CHIP, "chip", ACK_55)
    assert end - begin == ppdu_us(len(TO_CHIP) + 2)
    assert ack_begin - end == 192
    assert air.chip.take_frame()[:-2] == TO_CHIP
    assert air.heard == []  # neither itself nor the acknowledgement


def test_nobody_there_is_tried_four_times_with_the_same_number(air: Air) -> None:
    to_nobody = bytes.fromhex("6188 55 2200 0900 0700 3f 21 616263")
    air.send(to_nobody)
    air.world.run_us(60_000)
    assert air.outcomes == [Outcome.NOT_ACKNOWLEDGED]
    frames = air.frames()
    assert [frame for _, _, _, frame in frames] == [to_nobody] * 4
    assert air.gateway.retries == 3
    for first, second in itertools.pairwise(frames):
        assert second[0] - first[1] >= ACK_WAIT_SYMBOLS * SYMBOL_US + 192


def test_a_broadcast_goes_once(air: Air) -> None:
    air.send(bytes.fromhex("4188 55 2200 ffff 0700 3f 21"))
    air.world.run_us(20_000)
    assert air.outcomes == [Outcome.SENT]
    assert len(air.frames()) == 1
    assert len(air.chip.take_frame()) > 2


def test_one_after_the_other_with_a_space_between(air: Air) -> None:
    for number in range(5):
        assert air.send(TO_CHIP[:2] + bytes((number,)) + TO_CHIP[3:])
    air.world.run_us(100_000)
    assert air.outcomes == [Outcome.ACKNOWLEDGED] * 5
    ours = [frame for frame in air.frames() if frame[2] == "mote"]
    assert [frame[2] for _, _, _, frame in ours] == list(range(5))
    acks = [frame for frame in air.frames() if frame[2] == "chip"]
    for ack, following in zip(acks, ours[1:], strict=False):
        assert following[0] - ack[1] >= 12 * SYMBOL_US  # SIFS of a short frame, 7.5.1.3


def test_it_waits_for_a_busy_channel(make_world: Callable[..., Any]) -> None:
    """Whenever it is told to send while a long frame is in the air, it does not cut into it."""
    for delay_us in range(200, 4_000, 300):
        air = Air(make_world)
        air.speak(bytes.fromhex("4188 01 2200 ffff 0100 3f 21") + bytes(110))
        air.world.run_us(delay_us)
        air.send(TO_CHIP)
        air.world.run_us(40_000)
        assert air.outcomes in ([Outcome.ACKNOWLEDGED], [Outcome.CHANNEL_BUSY])
        assert len(air.heard) == 1
        frames = air.frames()
        for (_, end, _, _), (begin, _, _, _) in itertools.pairwise(frames):
            assert begin >= end


def test_a_damaged_frame_is_counted_and_not_heard(make_world: Callable[..., Any]) -> None:
    air = Air(make_world)
    other = air.world.chip("other", 0.9, address=2)
    air.chip.load(UNICAST + bytes(60))
    other.load(UNICAST + bytes(60))
    air.chip.strobe(r.STXON)
    air.world.run_us(600)
    other.strobe(r.STXON)
    air.world.run_us(10_000)
    assert air.heard == []
    assert air.gateway.damaged == 1


def test_the_queue_ends(air: Air) -> None:
    accepted = [air.send(TO_CHIP) for _ in range(40)]
    assert accepted == [True] * 32 + [False] * 8
    air.world.run_us(1_000_000)
    assert len(air.outcomes) == 32


def test_losses_are_made_up_for(make_world: Callable[..., Any]) -> None:
    """With a tenth of all frames lost either way, four attempts are enough nearly always."""
    air = Air(make_world, loss_probability=0.1, seed=4)
    for number in range(100):
        air.send(TO_CHIP[:2] + bytes((number,)) + TO_CHIP[3:])
        air.world.run_us(30_000)
        while air.chip.chip.fifo.value:
            air.chip.take_frame()
    assert air.outcomes.count(Outcome.ACKNOWLEDGED) >= 98
    assert air.gateway.retries > 5


def test_an_acknowledgement_of_somebody_else_is_not_ours(air: Air) -> None:
    to_nobody = bytes.fromhex("6188 55 2200 0900 0700 3f 21 616263")
    air.send(to_nobody)
    while not air.frames():
        air.world.run_us(100)
    air.speak(mac.encode(mac.ack_frame(0x54)))
    air.world.run_us(60_000)
    assert air.outcomes == [Outcome.NOT_ACKNOWLEDGED]
