"""The medium: noise, collisions and capture, random loss, moving antennas, repeatability."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from firmware_model.time import FS_PER_US, to_seconds
from radio_802154 import cc2420_registers as r
from radio_802154 import propagation, tinyos
from radio_802154.medium import Antenna, MediumConfig, MediumError
from radio_802154.propagation import Propagation
from radio_802154.tinyos import AmPacket

MakeWorld = Callable[..., Any]
PSDU_20 = bytes(range(18))  # and two octets of FCS: the length for which sensitivity is defined


def send(world: Any, host: Any, content: bytes = PSDU_20) -> None:
    host.load(content)
    host.strobe(r.STXON)
    world.run_us(192 + (6 + len(content) + 2) * 32 + 400)


def share_received(world: Any, sender: Any, listener: Any, count: int) -> float:
    good = 0
    for _ in range(count):
        send(world, sender)
        if listener.chip.fifop.value:
            good += bool(listener.take_frame()[-1] & r.CRC_OK)
    return good / count


def test_frames_are_lost_where_the_formula_says(make_world: MakeWorld) -> None:
    """At the sensitivity limit about 1 % of the frames; 2 dB below most of them."""
    world = make_world(propagation=Propagation(reference_loss_db=95.0, far_exponent=2.0))
    a = world.chip("a")
    limit, below = world.chip("limit", 1.0), world.chip("below", 10 ** (2 / 20))
    above = world.chip("above", 10 ** (-2 / 20))
    heard = {"limit": 0, "below": 0, "above": 0}
    for _ in range(400):
        send(world, a)
        for name, host in (("limit", limit), ("below", below), ("above", above)):
            if host.chip.fifop.value:
                heard[name] += bool(host.take_frame()[-1] & r.CRC_OK)
    assert heard["above"] == 400
    assert 385 <= heard["limit"] < 400  # 1 % of 20 octets, and the SFD: 4.4 ± 2.1 lost
    sinr = propagation.to_mw(-97.0 - propagation.effective_noise_dbm())
    expected = 1 - propagation.packet_error_rate(sinr, 8 * 21 + 16)
    assert heard["below"] / 400 == pytest.approx(expected, abs=0.08)
    port = world.medium.port("below")
    assert port.received == heard["below"]
    assert port.received + port.damaged + port.missed == 400


@pytest.mark.parametrize("loss", [0.3, 1.0, 0.0])
def test_random_loss(make_world: MakeWorld, loss: float) -> None:
    world = make_world(loss_probability=loss)
    a, b = world.chip("a"), world.chip("b", 1.0)
    share = share_received(world, a, b, 400)
    assert share == pytest.approx(1 - loss, abs=0.06 if 0 < loss < 1 else 0)
    assert world.medium.port("b").lost == round(400 * (1 - share))


def test_random_loss_of_single_links(make_world: MakeWorld) -> None:
    world = make_world(link_loss={("a", "b"): 1.0})
    a, b, c = world.chip("a"), world.chip("b", 1.0), world.chip("c", 1.0)
    assert share_received(world, a, b, 5) == 0
    assert c.take_frame()[-1] & r.CRC_OK
    assert share_received(world, b, a, 5) == 1


def collide(world: Any, near_m: float, lead_us: float, listener: Any) -> tuple[bytes, bool]:
    """Two frames at once, the first from x = −1 m; what the listener at 0 makes of it."""
    first, second = world.chip("first", -1.0), world.chip("second", near_m)
    first.load(b"\x01" * 40)
    second.load(b"\x02" * 40)
    first.strobe(r.STXON)
    world.run_us(lead_us)
    second.strobe(r.STXON)
    world.run_us(5000)
    if not listener.chip.fifop.value:
        return b"", False
    frame = listener.take_frame()
    return frame[:-2], bool(frame[-1] & r.CRC_OK)


def test_equal_frames_destroy_each_other(world: Any) -> None:
    listener = world.chip("l")
    _, good = collide(world, 1.0, 500, listener)
    assert not good


def test_the_stronger_first_frame_survives(world: Any) -> None:
    """6 dB above the interferer: capture."""
    listener = world.chip("l")
    content, good = collide(world, 2.0, 500, listener)
    assert good
    assert content == b"\x01" * 40


def test_the_stronger_frame_wins_while_the_weaker_is_in_its_preamble(world: Any) -> None:
    listener = world.chip("l")
    content, good = collide(world, 0.25, 100, listener)
    assert good
    assert content == b"\x02" * 40


def test_a_stronger_frame_destroys_a_weaker_one_that_is_being_received(world: Any) -> None:
    listener = world.chip("l")
    content, good = collide(world, 0.25, 500, listener)
    assert not good
    assert content[:8] == b"\x01" * 8  # it was locked on the first


def test_damage_is_where_the_interference_is(world: Any) -> None:
    listener = world.chip("l")
    content, good = collide(world, 0.25, 192 + 352, listener)
    assert not good
    start_of_second_us = 192 + 352 - 160 - 32  # since the first octet of the first frame's PSDU
    clean = start_of_second_us // 32
    assert content[:clean] == b"\x01" * clean
    assert content[clean:] != b"\x01" * (40 - clean)


def test_neighbouring_channels_do_not_meet(world: Any) -> None:
    listener = world.chip("l")
    first, second = world.chip("first", -1.0), world.chip("second", 0.5, listening=False)
    second.write(r.FSCTRL, 0x4165 + 5)
    second.strobe(r.SRXON)
    world.run_us(400)
    first.load(b"\x01" * 40)
    second.load(b"\x02" * 40)
    first.strobe(r.STXON)
    second.strobe(r.STXON)
    world.run_us(5000)
    assert listener.take_frame()[-1] & r.CRC_OK
    assert {record[1][1] for record in world.air()} == {11, 12}


def test_water_between(make_world: MakeWorld) -> None:
    world = make_world()
    a = world.chip("base")
    shallow, deep = world.chip("s", 2.0, depth_m=0.05), world.chip("d", 2.0, depth_m=0.3)
    send(world, a)
    rssi = shallow.take_frame()[-2]
    assert (rssi - 256) - 45 == pytest.approx(-46.2 - 4.4 - 241.5 * 0.05, abs=1)
    assert not deep.chip.fifop.value


def test_antennas_move(make_world: MakeWorld) -> None:
    """Positions are looked at when they are needed, at most every `position_period_s`."""
    world = make_world(position_period_s=0.5)
    a = world.chip("a")
    looks: list[float] = []

    def x_m(time_fs: int) -> float:
        looks.append(to_seconds(time_fs))
        return 1.0 + to_seconds(time_fs)

    world.medium.place("m", Antenna(x_m=x_m))
    gains = []
    ports = [world.medium.port(name) for name in ("a", "m")]
    for _ in range(20):
        gains.append(world.medium.link_gain_db(*ports))
        world.run_us(100_000)
    assert len(looks) == 4
    assert gains[0] == pytest.approx(-40.2, abs=0.1)
    assert gains[-1] == pytest.approx(-propagation.Propagation().air_loss_db(1 + looks[-1]))
    assert a.chip.state


def test_what_a_radio_hears_does_not_depend_on_strangers(make_world: MakeWorld) -> None:
    """Chance is drawn by listener: a third radio elsewhere changes nothing for the others."""

    def history(strangers: int) -> list[int]:
        world = make_world(loss_probability=0.3, seed=7)
        a, b = world.chip("a"), world.chip("b", 1.0)
        for number in range(strangers):
            world.chip(f"s{number}", 3.0 + number)
        return [int(share_received(world, a, b, 1)) for _ in range(60)]

    assert history(0) == history(3)
    assert 20 < sum(history(0)) < 60


def test_same_seed_same_trace(make_world: MakeWorld) -> None:
    def run(seed: int) -> tuple[str, int]:
        world = make_world(loss_probability=0.5, seed=seed)
        a, b = world.chip("a", address=1), world.chip("b", 1.0, address=2)
        for sequence in range(40):
            a.load(tinyos.encode(AmPacket(2, 1, 6, b"x", sequence)))
            a.strobe(r.STXON)
            world.run_us(5000)
            a.strobe(r.SFLUSHRX)
            b.strobe(r.SFLUSHRX)
        return world.trace.sha256(), len(world.air())

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_shadowing_is_constant_reciprocal_and_seeded(make_world: MakeWorld) -> None:
    def gain(seed: int, first: str, second: str) -> float:
        world = make_world(propagation=Propagation(shadowing_sd_db=4.0), seed=seed)
        for name in ("a", "b", "c"):
            world.medium.place(name, Antenna())
        return float(world.medium.link_gain_db(world.medium.port(first), world.medium.port(second)))

    assert gain(1, "a", "b") == gain(1, "b", "a") == gain(1, "a", "b")
    assert len({gain(1, "a", "b"), gain(1, "a", "c"), gain(2, "a", "b")}) == 3


def test_wrong_wiring_is_refused(world: Any) -> None:
    world.chip("a")
    with pytest.raises(MediumError, match="already an antenna"):
        world.medium.place("a", Antenna())
    with pytest.raises(MediumError, match="place it first"):
        world.medium.attach("x", world.medium.port("a").transceiver)
    with pytest.raises(MediumError, match="its transceiver already"):
        world.medium.attach("a", world.medium.port("a").transceiver)
    with pytest.raises(MediumError, match="0 to 1"):
        MediumConfig(loss_probability=1.5)


def test_few_events_a_frame_whatever_the_number_of_listeners(make_world: MakeWorld) -> None:
    """Counted by the scheduler's own sequence numbers."""

    def events(listeners: int) -> int:
        world = make_world()
        a = world.chip("a")
        for number in range(listeners):
            world.chip(f"l{number}", 1.0 + number / 10)
        a.load(bytes(100))
        before = world.scheduler.at(world.scheduler.now + 10**15, lambda: None)[2]
        a.strobe(r.STXON)
        world.run_us(6000)
        after = world.scheduler.at(world.scheduler.now + 10**15, lambda: None)[2]
        return int(after - before - 1)

    assert events(1) == events(20) <= 6
    assert FS_PER_US == 10**9
