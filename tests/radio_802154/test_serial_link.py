"""Host and mote on one line: stop-and-wait, duplicates, room, and a line that loses."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radio_802154.errors import LocalFrameError
from radio_802154.serial_link import (
    HOST,
    MOTE,
    Event,
    OctetsDiscarded,
    PacketAcknowledged,
    PacketGivenUp,
    PacketReceived,
    SerialConfig,
    SerialLink,
)
from radio_802154.tinyos_serial import AmMessage, PacketType, SerialPacket, encode

FRAME = bytes.fromhex("7e 44 26 00 ffff 0000 04 22 06 7d5e 7d5d 01 02 18 7b 7e")
ACK_26 = bytes.fromhex("7e 43 26 3b 1c 7e")
"""CRC by Python's binascii.crc_hqx."""


def bodies(events: list[Event]) -> list[bytes]:
    return [event.packet.body for event in events if isinstance(event, PacketReceived)]


def test_a_literal_exchange() -> None:
    host, mote = SerialLink(HOST, first_sequence=0x26), SerialLink(MOTE)
    token = host.send_am(AmMessage(0xFFFF, 6, bytes.fromhex("7e7d0102")))
    assert host.wants_to_send
    assert host.data_to_send(0) == FRAME
    assert not host.wants_to_send
    assert bodies(mote.receive(FRAME, 100)) == [bytes.fromhex("ffff0000042206 7e7d0102")]
    assert mote.data_to_send(100) == ACK_26
    assert host.receive(ACK_26, 200) == [PacketAcknowledged(token)]
    assert host.next_deadline_us() is None


def test_host_waits_for_each_acknowledgement_and_mote_for_none() -> None:
    host, mote = SerialLink(HOST), SerialLink(MOTE)
    for end in (host, mote):
        end.send(b"one")
        end.send(b"two")
    assert host.data_to_send(0) == encode(SerialPacket(PacketType.DATA_ACK, 0, 0, b"one"))
    assert host.data_to_send(1) == b""
    said = mote.data_to_send(0)
    assert said.count(b"\x7e") == 4
    assert bodies(host.receive(said, 2)) == [b"one", b"two"]
    assert host.data_to_send(3) == b""  # 0x45 is not acknowledged


def test_lost_acknowledgement_means_again_and_not_twice() -> None:
    host, mote = SerialLink(HOST), SerialLink(MOTE)
    host.send(b"x")
    first = host.data_to_send(0)
    assert bodies(mote.receive(first, 0)) == [b"x"]
    mote.data_to_send(0)  # lost
    assert host.handle_timer(199_999) == []
    assert host.data_to_send(199_999) == b""
    assert host.handle_timer(200_000) == []
    again = host.data_to_send(200_000)
    assert again == first
    assert mote.receive(again, 200_000) == []
    assert host.receive(mote.data_to_send(200_001), 200_002) == [PacketAcknowledged(1)]
    assert mote.statistics.duplicates == host.statistics.retransmissions == 1


def test_same_command_of_a_tool_started_again_is_another_command() -> None:
    mote = SerialLink(MOTE)
    assert len(mote.receive(FRAME, 0)) == 1
    assert len(mote.receive(FRAME, 999_999)) == 0
    assert len(mote.receive(FRAME, 1_999_998)) == 0  # within a second of the last
    assert len(mote.receive(FRAME, 2_999_998)) == 1


def test_no_room_no_acknowledgement() -> None:
    mote = SerialLink(MOTE)
    mote.room = 1
    other = encode(SerialPacket(PacketType.DATA_ACK, 1, 0, b"y"))
    assert len(mote.receive(FRAME + other, 0)) == 1
    assert mote.data_to_send(0) == ACK_26
    assert mote.statistics.refused == 1
    mote.room = 1
    assert len(mote.receive(other, 1)) == 1


def test_given_up_after_all_attempts_then_the_next_one() -> None:
    host = SerialLink(SerialConfig(acknowledged=True, attempts=2))
    host.send(b"a")
    host.send(b"b")
    host.data_to_send(0)
    assert host.handle_timer(200_000) == []
    assert b"a" in host.data_to_send(200_000)
    assert host.handle_timer(400_000) == [PacketGivenUp(1)]
    assert b"b" in host.data_to_send(400_000)
    late = encode(SerialPacket(PacketType.ACK, 0))
    assert host.receive(late, 400_001) == []  # of the one given up
    assert host.statistics.stray_acks == 1
    assert host.queued == 1


def test_damage_is_reported() -> None:
    assert SerialLink(HOST).receive(b"\x7eabcdef\x7e", 0) == [OctetsDiscarded(1)]


def test_output_is_cut_where_the_line_is_full() -> None:
    host = SerialLink(HOST)
    host.send(bytes(100))
    parts = []
    while host.wants_to_send:
        parts.append(host.data_to_send(0, 7))
    assert max(map(len, parts)) == 7
    assert len(SerialLink(MOTE).receive(b"".join(parts), 0)) == 1


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(LocalFrameError):
        SerialLink(HOST).send(bytes(300))
    full = SerialLink(SerialConfig(acknowledged=True, queue_limit=1))
    full.send(b"")
    with pytest.raises(LocalFrameError, match="try again"):
        full.send(b"")
    for wrong in ({"retransmit_us": 0}, {"attempts": 0}, {"duplicate_us": 1}):
        with pytest.raises(ValueError, match=r"retransmit|attempts"):
            SerialConfig(acknowledged=True, **wrong)


@settings(max_examples=60)
@given(st.integers(0, 2**32), st.floats(0.0, 0.4), st.integers(1, 20))
def test_every_packet_once_and_in_order_over_a_bad_line(seed: int, rate: float, count: int) -> None:
    """Lost and damaged pieces both ways; once the faults stop, all arrives within the time-outs."""
    random = Random(seed)
    host, mote = SerialLink(HOST), SerialLink(MOTE)
    sent = [bytes((index,)) + random.randbytes(index) for index in range(count)]
    for body in sent:
        host.send(body)
    heard: list[bytes] = []
    given_up = 0
    now = 0
    mote.room = 0
    while host.queued and now < 30_000_000:
        now += 10_000
        given_up += len(host.handle_timer(now))
        mote.room = random.randrange(3)
        faults = rate if now < 2_000_000 else 0.0
        heard += bodies(mote.receive(_line(host.data_to_send(now), faults, random), now))
        host.receive(_line(mote.data_to_send(now), faults, random), now)
    assert not host.queued
    assert given_up == 0
    assert heard == sent


def _line(data: bytes, rate: float, random: Random) -> bytes:
    if not data or random.random() < rate:
        return b""
    if random.random() < rate:
        damaged = bytearray(data)
        damaged[random.randrange(len(data))] ^= 1 << random.randrange(8)
        return bytes(damaged)
    return data
