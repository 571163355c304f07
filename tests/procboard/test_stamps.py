"""Times of SFDs: what the firmware gives out against what the pin did."""

from __future__ import annotations

from typing import Any

import pytest

from firmware_model.time import FS_PER_US
from procboard.drivers.sfd_capture import belongs
from procboard.network import Received
from radio_802154.medium import Medium
from radio_802154.tinyos import AM_BROADCAST
from tests.procboard.routing.emulated import Mote, Shoal

AM = 0x77
NEAR = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]


class Ends:
    """Boards that note what came, with the true counts at the rises of their SFD pins."""

    def __init__(self, shoal: Shoal) -> None:
        self.shoal = shoal
        self.got: dict[int, list[Received]] = {m.address: [] for m in shoal.motes}
        self.rises: dict[int, list[int]] = {m.address: [] for m in shoal.motes}
        shoal.run(1.0)
        for mote in shoal.motes:
            self._watch(mote)

    def _watch(self, mote: Mote) -> None:
        services, rises = mote.app.services, self.rises[mote.address]
        mote.mote.radio.sfd.watch(lambda up: rises.append(services.alarms.now()) if up else None)
        got = self.got[mote.address]

        def take(packet: Received) -> Any:
            got.append(packet)
            yield 10

        services.network.on(AM, take)

    def send(self, address: int, size: int = 8, **more: Any) -> None:
        """Broadcast a message whose octets 2 to 5 are the count at its SFD."""
        stamp = lambda ticks: (2, ticks.to_bytes(4, "big"))  # noqa: E731
        network = self.shoal.motes[address].app.services.network
        assert network.send(AM_BROADCAST, AM, b"\xee" * size, stamp=stamp, **more)


def told(packet: Received) -> int:
    return int.from_bytes(packet.payload[2:6], "big")


def test_both_ends_know_the_count_at_the_sfd():
    shoal = Shoal(NEAR[:2], drifts=(40.0, -60.0))
    ends = Ends(shoal)
    for n in range(30):
        ends.send(0, 6 + 3 * n)
        shoal.run(0.2 + 0.013 * n)
    got = ends.got[1]
    assert len(got) == 30
    for packet in got:
        assert packet.payload[:2] == b"\xee\xee"
        assert set(packet.payload[6:]) <= {0xEE}
        assert told(packet) in ends.rises[0]
        assert packet.sfd_ticks in ends.rises[1]
    # 100 ppm over 12 s are 39 ticks.
    first, last = got[0], got[-1]
    span = told(last) - told(first)
    assert span - (last.sfd_ticks - first.sfd_ticks) == pytest.approx(span * 100e-6, abs=1.01)
    assert shoal.motes[0].app.services.network.statistics.late_stamps == 0


def test_a_stamp_that_would_come_too_late_is_not_sent():
    """Interrupts are off for 0.4 ms from the SFD; the stamp takes 0.15 and is due after 0.45."""
    shoal = Shoal(NEAR[:2])
    ends = Ends(shoal)
    mote = shoal.motes[0].mote
    interrupts = mote.mcu.interrupts

    def later(level: bool) -> None:
        if level and not ends.got[1]:
            interrupts.gie = False

            def on() -> None:
                interrupts.gie = True
                mote.mcu.interrupts.notify()

            shoal.scheduler.after(400 * FS_PER_US, on)

    ends.send(0)
    shoal.run(0.5)
    (first,) = ends.got[1]
    ends.got[1].clear()
    mote.radio.sfd.watch(later)
    ends.send(0)
    shoal.run(0.5)
    assert shoal.motes[0].app.services.network.statistics.late_stamps == 1
    assert ends.got[1] == []  # nobody hears a wrong time
    assert first.sfd_ticks is not None
    ends.got[1].append(first)
    ends.send(0)
    shoal.run(0.5)
    assert len(ends.got[1]) == 2  # and the next one goes as ever
    assert told(ends.got[1][1]) in ends.rises[0]


def test_no_stamp_rather_than_a_wrong_one():
    """Two boards talk to a third whose CPU is held now and then, so that frames pile up."""
    shoal = Shoal(NEAR)
    ends = Ends(shoal)
    hold = shoal.motes[2].mote.mcu.cpu

    def busy() -> Any:
        while True:
            yield 30_000  # 7 ms
            yield from shoal.motes[2].app.services.alarms.sleep_us(9_000)

    hold.spawn("busy", busy())
    for n in range(60):
        ends.send(n % 2, 6 + n % 5)
        if n % 3 == 0:
            ends.send(1 - n % 2, 20)
        shoal.run(0.011)
    shoal.run(0.3)
    got = ends.got[2]
    sure = [packet for packet in got if packet.sfd_ticks is not None]
    assert len(got) >= 60
    assert len(got) > len(sure) >= 20
    offsets = {packet.source: set() for packet in sure}
    for packet in sure:
        offsets[packet.source].add(packet.sfd_ticks - told(packet))
    for found in offsets.values():  # crystals without drift: one number and its rounding
        assert max(found) - min(found) <= 1


def test_a_busy_channel_holds_no_bus(monkeypatch):
    """What was prepared for an SFD that does not come is undone."""
    shoal = Shoal(NEAR[:2])
    ends = Ends(shoal)
    with monkeypatch.context() as patched:
        patched.setattr(Medium, "energy_dbm", lambda *_: -30.0)
        ends.send(0)
        shoal.run(0.2)
    assert ends.rises[0] == []
    control = shoal.motes[0].mote.mcu.reg["TBCCTL1"]
    assert not control.read() & 0x0010  # CCIE: the next SFD is another frame's
    ends.send(0)
    shoal.run(0.2)
    assert len(ends.got[1]) == 1
    assert not control.read() & 0x0010


@pytest.mark.parametrize(("late", "ours"), [(-2, False), (-1, True), (4, True), (5, False)])
def test_a_frame_and_its_sfd_are_as_far_apart_as_its_length(late, ours):
    ticks = 44  # 1 + 41 octets of 32 µs are 44.04 ticks: 45 have passed when they have
    assert belongs(1000, 1000 + ticks + 1 + late, 41) is ours
