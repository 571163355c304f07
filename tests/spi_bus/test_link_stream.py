"""The stream of a link: once, newest only, and never in the way of messages.

Frames stand here literally. The hostile channel of `test_link_stateful` has a stream as well.
"""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spi_bus.errors import FieldError, UnknownMessageError
from spi_bus.frame import Decoder, ErrorKind, Flag, Frame, FrameType
from spi_bus.link import Link, LinkError, MessageReceived, Role, StreamReceived
from spi_bus.messages import Ping, Pong
from spi_bus.plant_messages import PLANT_MESSAGES, SensorSample, ServoPulse

SAMPLE = SensorSample(7, 10_000, 1, *[None] * 3, 1526, *[None] * 12, *range(14))
PULSE = ServoPulse(3, 12_000, 0.0015, 7, 1_500)


def pair(table=None) -> tuple[Link, Link]:
    """Master (epoch 1) and slave (epoch 2), connected, with nothing on the wire."""
    more = {} if table is None else {"table": table}
    master, slave = Link(Role.MASTER, 1, **more), Link(Role.SLAVE, 2, **more)
    events = []
    for _ in range(4):
        events += slave.receive(master.data_to_send(0), 0)
        events += master.receive(slave.data_to_send(0), 0)
    assert sorted(event.peer_epoch for event in events) == [1, 2]
    return master, slave


def kinds(wire: bytes) -> list[int]:
    return [Frame.parse(body).frame_type for body in Decoder().receive(wire)]


def test_a_stream_frame_stands_literally_on_the_wire():
    master, slave = pair()
    assert master.send_newest(Ping(42))
    wire = master.data_to_send(0)
    (body,) = Decoder().receive(wire)
    assert body == bytes.fromhex("14 12 00 00 04 03 2a 00")  # version 1, type 4, session 1/2
    assert slave.receive(wire, 0) == [StreamReceived(Ping(42))]
    assert not slave.wants_to_send, "a stream is not acknowledged"
    assert slave.next_deadline_us() is None
    assert master.next_deadline_us() is None, "and not sent again"
    assert master.queued == 0


def test_a_newer_one_takes_the_place_of_one_that_waits():
    master, slave = pair()
    for token in (1, 2, 3):
        assert master.send_newest(Ping(token))
    assert slave.receive(master.data_to_send(0), 0) == [StreamReceived(Ping(3))]
    assert master.data_to_send(0) == b""
    assert master.statistics.streamed == 1
    assert master.statistics.replaced == 2
    assert slave.statistics.stream_received == 1


def test_it_carries_acknowledgements():
    master, slave = pair()
    slave.send(Pong(5))
    assert master.receive(slave.data_to_send(0), 0) == [MessageReceived(Pong(5))]
    assert master.data_to_send(0) == b"", "waits for company"
    master.send_newest(Ping(1))
    slave.receive(master.data_to_send(0), 0)
    assert slave.queued == 0


def test_messages_and_stream_take_turns():
    """Whoever streams without end does not keep messages from going."""
    master, slave = pair()
    for token in range(3):
        master.send(Ping(token))
    told = []
    for token in range(100, 106):
        master.send_newest(Ping(token))
        wire = master.data_to_send(0, 12)  # a frame of three bytes of payload
        told += kinds(wire)
        slave.receive(wire, 0)
    assert told == [FrameType.STREAM, FrameType.DATA] * 3


def test_without_a_peer_nothing_is_kept_and_a_reset_drops_what_waited():
    lonely = Link(Role.MASTER, 1)
    assert not lonely.send_newest(Ping(1))
    assert kinds(lonely.data_to_send(0)) == [FrameType.HELLO]
    master, _ = pair()
    assert master.send_newest(Ping(1))
    master.resume(0)
    assert FrameType.STREAM not in kinds(master.data_to_send(0))
    assert master.statistics.replaced == 1


def test_what_waited_for_an_earlier_incarnation_does_not_go_to_the_next():
    master, _ = pair()
    successor = Link(Role.SLAVE, 3)
    master.send_newest(Ping(1))
    told = []
    for _ in range(3):
        master.receive(successor.data_to_send(0), 0)
        wire = master.data_to_send(0, 15)  # its HELLO, which goes first, and nothing behind it
        told += kinds(wire)
        successor.receive(wire, 0)
    assert master.peer_epoch == 3
    assert FrameType.STREAM not in told
    assert master.statistics.replaced == 1


def test_one_of_another_session_is_stale():
    master, slave = pair()
    master.send_newest(Ping(1))
    wire = master.data_to_send(0)
    successor = Link(Role.SLAVE, 3)
    assert successor.receive(wire, 0) == []
    assert successor.statistics.stale == 1
    assert slave.receive(wire, 0) == [StreamReceived(Ping(1))]


def test_what_no_table_knows_is_told_and_not_delivered():
    _, slave = pair()
    foreign = Frame(FrameType.STREAM, 0x12, 0, 0, 0, 4, b"\x22\x00").encode()
    (error,) = slave.receive(foreign, 0)
    assert isinstance(error, LinkError)
    assert error.kind is ErrorKind.PAYLOAD
    assert slave.statistics.lost == 0, "nobody acknowledged it"
    echo = Frame(FrameType.STREAM, 0x12, 0, 0, Flag.FROM_SLAVE, 4, b"\x85\x00\x00").encode()
    assert slave.receive(echo, 0)[0].kind is ErrorKind.ECHO


def test_what_this_side_does_not_send_is_refused():
    master, slave = pair(PLANT_MESSAGES)
    with pytest.raises(UnknownMessageError):
        slave.send_newest(SAMPLE)
    with pytest.raises(FieldError, match="width_s"):
        slave.send_newest(ServoPulse(1, 0, 1.0, 0, 0))
    assert master.send_newest(SAMPLE)
    assert slave.send_newest(PULSE)
    assert slave.receive(master.data_to_send(0), 0) == [StreamReceived(SAMPLE)]
    assert master.receive(slave.data_to_send(0), 0) == [StreamReceived(PULSE)]


@given(
    noise=st.lists(st.binary(max_size=80), max_size=6),
    cuts=st.lists(st.integers(1, 40), min_size=1, max_size=8),
)
def test_any_bytes_between_samples_raise_nothing_and_the_next_one_arrives(noise, cuts):
    """Noise costs the frame that it hits and at most the one it runs into."""
    master, slave = pair(PLANT_MESSAGES)
    stream = b""
    for piece in noise:
        master.send_newest(SAMPLE)
        stream += piece + master.data_to_send(0)
    master.send_newest(SAMPLE)
    stream += b"\0" + master.data_to_send(0)
    events = []
    while stream:
        for cut in cuts:
            events += slave.receive(stream[:cut], 0)
            stream = stream[cut:]
    received = [event.message for event in events if isinstance(event, StreamReceived)]
    assert received
    assert all(message == SAMPLE for message in received)
    assert len(received) <= len(noise) + 1
