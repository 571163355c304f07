"""The link's rules one by one, with literal conversations where bytes matter."""

import dataclasses
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spi_bus.errors import FieldError, LinkFull, UnknownMessageError
from spi_bus.frame import Decoder, ErrorKind, Flag, Frame, FrameType
from spi_bus.link import (
    Link,
    LinkConfig,
    LinkError,
    LinkUp,
    MessageAcknowledged,
    MessageReceived,
    PeerReset,
    Role,
)
from spi_bus.messages import CommandApplied, Ping, Pong, TailBeat

CONFIG = LinkConfig()


def frames_in(wire: bytes) -> list[Frame]:
    return [Frame.parse(body) for body in Decoder().receive(wire)]


def messages_in(events) -> list[object]:
    return [event.message for event in events if isinstance(event, MessageReceived)]


def talk(a: Link, b: Link, now_us: int = 0) -> list:
    """Carry bytes to and fro until both are silent; what both saw."""
    events = []
    rounds = 0
    while a.wants_to_send or b.wants_to_send:
        rounds += 1
        assert rounds < 100, "they never fall silent"
        events += b.receive(a.data_to_send(now_us), now_us)
        events += a.receive(b.data_to_send(now_us), now_us)
    return events


def connected(config: LinkConfig = CONFIG) -> tuple[Link, Link]:
    master, slave = Link(Role.MASTER, 1, config), Link(Role.SLAVE, 2, config)
    talk(master, slave)
    assert master.connected
    assert slave.connected
    return master, slave


def test_a_known_conversation_byte_for_byte():
    master, slave = Link(Role.MASTER, 0x0101), Link(Role.SLAVE, 0x0202)
    master.send(TailBeat(1, 0.0, 0.25, 0.9, 5.0))
    # HELLO of epoch 0x0101, challenge 0, nobody known, reply wanted.
    wire = master.data_to_send(0)
    assert wire.hex(" ") == "03 11 10 01 04 44 01 01 01 01 01 03 c1 c9 00"
    assert slave.receive(wire, 0) == []
    wire = slave.data_to_send(0)
    assert wire.hex(" ") == "03 11 21 01 04 54 02 02 03 01 01 03 10 5f 00"
    assert master.receive(wire, 0) == [LinkUp(0x0202)]
    hello, data = frames_in(master.data_to_send(0))
    assert hello == Frame(FrameType.HELLO, 0x12, 0, 0, 0, 4, bytes.fromhex("010101020200"))
    assert data == Frame(
        FrameType.DATA, 0x12, 0, 0, 0, 4, bytes.fromhex("01 0100 0000 8813 8403 f401")
    )
    assert slave.receive(hello.encode() + data.encode(), 0) == [
        LinkUp(0x0101),
        MessageReceived(TailBeat(1, 0.0, 0.25, 0.9, 5.0)),
    ]
    slave.send(CommandApplied(1, 1_000))
    (reply,) = frames_in(slave.data_to_send(0))
    assert reply == Frame(
        FrameType.DATA, 0x21, 0, 1, Flag.FROM_SLAVE, 4, bytes.fromhex("83 0100 e80300000000")
    )
    assert master.receive(reply.encode(), 0) == [
        MessageAcknowledged(1),
        MessageReceived(CommandApplied(1, 1_000)),
    ]


def test_nothing_to_send_is_nothing_and_filler_costs_nothing():
    master, slave = connected()
    assert not master.wants_to_send
    assert master.data_to_send(1) == b""
    assert master.next_deadline_us() is None
    before = dataclasses.replace(slave.statistics)
    assert slave.receive(b"\0" * 64, 1) == []
    assert slave.statistics == before


def test_acknowledgement_waits_for_company_then_goes_alone():
    master, slave = connected()
    master.send(Ping(1))
    slave.receive(master.data_to_send(100), 100)
    assert not slave.wants_to_send
    assert slave.next_deadline_us() == 100 + CONFIG.ack_delay_us
    slave.handle_timer(100 + CONFIG.ack_delay_us)
    wire = slave.data_to_send(10_100)
    assert [frame.frame_type for frame in frames_in(wire)] == [FrameType.ACK]
    assert len(wire) == 9
    assert master.receive(wire, 10_100) == [MessageAcknowledged(1)]
    assert master.next_deadline_us() is None


def test_half_a_window_is_acknowledged_at_once():
    master, slave = connected()
    for token in range(2):
        master.send(Ping(token))
    slave.receive(master.data_to_send(0), 0)
    assert slave.wants_to_send


def test_window_limits_what_is_in_flight():
    master, slave = connected(LinkConfig(window=3, queue_limit=8))
    for token in range(8):
        master.send(Ping(token))
    first = master.data_to_send(0)
    assert len(frames_in(first)) == 3
    assert master.data_to_send(0) == b""
    assert messages_in(slave.receive(first, 0)) == [Ping(0), Ping(1), Ping(2)]
    master.receive(slave.data_to_send(0), 0)
    assert len(frames_in(master.data_to_send(0))) == 3


def test_a_full_queue_says_so_and_takes_nothing():
    master, slave = connected(LinkConfig(queue_limit=2))
    master.send(Ping(0))
    master.send(Ping(1))
    with pytest.raises(LinkFull):
        master.send(Ping(2))
    assert messages_in(talk(master, slave)) == [Ping(0), Ping(1)]
    assert master.queued == 0
    master.send(Ping(3))


def test_what_cannot_be_sent_raises_and_queues_nothing():
    master, _ = connected()
    with pytest.raises(UnknownMessageError, match="sent by the slave"):
        master.send(Pong(1))
    with pytest.raises(FieldError):
        master.send(Ping(-1))
    assert master.queued == 0


def test_retransmission_backs_off_and_comes_back():
    master, slave = connected()
    master.send(Ping(5))
    master.data_to_send(0)  # lost
    now, waits = 0, []
    for _ in range(6):
        deadline = master.next_deadline_us()
        waits.append(deadline - now)
        now = deadline
        master.handle_timer(now - 1)
        assert not master.wants_to_send
        master.handle_timer(now)
        assert master.wants_to_send
        lost = master.data_to_send(now)
    assert waits == [60_000, 120_000, 240_000, 480_000, 960_000, 1_000_000]
    assert master.statistics.retransmissions == 6
    # The last ones ask besides whether the peer is still the same.
    assert [f.frame_type for f in frames_in(lost)] == [FrameType.HELLO, FrameType.DATA]
    assert messages_in(slave.receive(lost, now)) == [Ping(5)]
    assert master.receive(slave.data_to_send(now), now) == []
    slave.handle_timer(now + CONFIG.ack_delay_us)
    assert master.receive(slave.data_to_send(now), now) == [MessageAcknowledged(1)]
    assert master.next_deadline_us() is None
    master.send(Ping(6))
    master.data_to_send(now)
    assert master.next_deadline_us() == now + CONFIG.retransmit_us


def test_a_repeated_message_is_acknowledged_again_and_delivered_once():
    master, slave = connected()
    master.send(Ping(1))
    wire = master.data_to_send(0)
    assert messages_in(slave.receive(wire + wire, 0)) == [Ping(1)]
    assert slave.statistics.duplicates == 1
    assert slave.wants_to_send
    assert messages_in(slave.receive(wire, 0)) == []


def test_a_gap_is_reported_once_and_filled_without_a_time_out():
    master, slave = connected()
    for token in range(3):
        master.send(Ping(token))
    lost, second, third = (master.data_to_send(0, limit=12) for _ in range(3))
    assert all(len(frames_in(wire)) == 1 for wire in (lost, second, third))
    assert messages_in(slave.receive(second, 0)) == []
    answer = slave.data_to_send(0)
    assert frames_in(answer)[0].flags == Flag.FROM_SLAVE | Flag.GAP
    assert messages_in(slave.receive(third, 0)) == []
    assert frames_in(slave.data_to_send(0))[0].flags == Flag.FROM_SLAVE
    assert slave.statistics.gaps == 2
    master.receive(answer, 0)
    again = master.data_to_send(0)
    master.receive(answer, 0)
    assert not master.wants_to_send, "once for a gap"
    assert messages_in(slave.receive(again, 0)) == [Ping(0), Ping(1), Ping(2)]
    assert master.statistics.retransmissions == 3


def test_a_closed_window_holds_the_peer_and_an_open_one_lets_it_go():
    master, slave = connected()
    slave.receive_window = 0
    master.send(Ping(0))
    assert messages_in(talk(master, slave)) == []
    assert slave.statistics.refused == 1
    assert not master.wants_to_send
    master.send(Ping(1))
    assert not master.wants_to_send
    slave.receive_window = 4
    assert messages_in(talk(master, slave)) == [Ping(0), Ping(1)]


def test_a_lost_window_update_is_found_by_probing():
    master, slave = connected()
    slave.receive_window = 0
    for token in range(3):
        master.send(Ping(token))
    talk(master, slave)
    slave.receive_window = 4
    slave.data_to_send(0)  # lost
    master.handle_timer(master.next_deadline_us())
    probe = master.data_to_send(70_000)
    assert len(frames_in(probe)) == 1
    events = slave.receive(probe, 70_000)
    slave.handle_timer(80_000)
    events += talk(master, slave, 80_000)
    assert messages_in(events) == [Ping(0), Ping(1), Ping(2)]


def test_messages_wait_for_a_window_that_was_closed_at_the_handshake():
    master, slave = Link(Role.MASTER, 1), Link(Role.SLAVE, 2)
    slave.receive_window = 0
    talk(master, slave)
    master.send(Ping(1))
    assert not master.wants_to_send
    slave.receive_window = 2
    slave.data_to_send(0)  # lost
    master.handle_timer(master.next_deadline_us())
    assert messages_in(talk(master, slave)) == [Ping(1)]


@pytest.mark.parametrize("limit", [1, 2, 5, 16, 64])
def test_a_limit_cuts_the_stream_and_loses_nothing(limit):
    master, slave = connected()
    for token in range(4):
        master.send(Ping(token))
    stream = b""
    while piece := master.data_to_send(0, limit):
        assert len(piece) <= limit
        stream += piece
    assert messages_in(slave.receive(stream, 0)) == [Ping(n) for n in range(4)]


def test_a_peer_that_restarts_gets_what_was_not_acknowledged_and_nothing_else():
    master, slave = connected()
    master.send(Ping(0))
    assert MessageAcknowledged(1) in _settle(master, slave)
    for token in range(1, 7):
        master.send(Ping(token))
    assert len(frames_in(master.data_to_send(0))) == 4  # delivered or not, nobody knows
    reborn = Link(Role.SLAVE, 3)
    events = _settle(master, reborn)
    assert PeerReset(3, 2, 4) in events
    assert messages_in(events) == [Ping(n) for n in range(1, 7)]
    assert master.statistics.peer_resets == 1
    assert master.queued == 0


def _settle(a: Link, b: Link) -> list:
    events = []
    for now in range(0, 3_000_000, 5_000):
        for link in (a, b):
            if (deadline := link.next_deadline_us()) is not None and deadline <= now:
                link.handle_timer(now)
        events += talk(a, b, now)
    return events


def test_frames_of_an_earlier_incarnation_are_not_delivered():
    master, slave = connected()
    slave.send(Pong(1))
    stale = slave.data_to_send(0)
    reborn = Link(Role.SLAVE, 3)
    _settle(master, reborn)
    assert master.receive(stale, 0) == []
    assert master.statistics.stale == 1
    # Nor what was meant for an earlier incarnation of the receiver.
    master.send(Ping(1))
    meant_for_reborn = master.data_to_send(0)
    third = Link(Role.SLAVE, 4)
    assert messages_in(third.receive(meant_for_reborn, 0)) == []
    _settle(master, third)
    assert messages_in(third.receive(meant_for_reborn, 0)) == []


def test_a_stale_hello_does_not_disturb_a_live_session():
    master = Link(Role.MASTER, 1)
    ghost = Link(Role.SLAVE, 2)
    hello = ghost.data_to_send(0)
    ghost.receive(master.data_to_send(0), 0)
    echo = ghost.data_to_send(0)
    assert master.receive(echo, 0) == [LinkUp(2)]
    slave = Link(Role.SLAVE, 3)
    talk(master, slave)
    assert master.peer_epoch == 3
    master.send(Ping(1))
    data = master.data_to_send(0)
    # Both greetings of the incarnation before arrive late, the proof of life among them.
    assert master.receive(hello, 0) == []
    assert master.receive(echo, 0) == []
    assert messages_in(slave.receive(data, 0)) == [Ping(1)]
    slave.handle_timer(CONFIG.ack_delay_us)
    talk(master, slave, CONFIG.ack_delay_us)
    assert master.peer_epoch == 3
    assert master.queued == 0
    assert master.statistics.peer_resets == 1
    assert not [link for link in (master, slave) if link.wants_to_send]


def test_ghosts_on_both_sides_do_not_part_the_living():
    hello_of_old_slave = Link(Role.SLAVE, 7).data_to_send(0)
    hello_of_old_master = Link(Role.MASTER, 8).data_to_send(0)
    master, slave = connected()
    for _ in range(3):
        master.receive(hello_of_old_slave, 0)
        slave.receive(hello_of_old_master, 0)
        events = talk(master, slave)
        assert not [event for event in events if isinstance(event, PeerReset)]
        # The question whether the ghosts live is answered at the latest one time-out later.
        for link in (master, slave):
            if (deadline := link.next_deadline_us()) is not None:
                link.handle_timer(deadline)
        talk(master, slave)
        assert master.next_deadline_us() is None
        assert slave.next_deadline_us() is None


def test_an_acknowledgement_of_what_was_never_sent_is_ignored():
    master, slave = connected(LinkConfig(window=1))
    for token in range(3):
        master.send(Ping(token))
    sent = master.data_to_send(0)
    for acknowledge in (2, 3, 4, 255):
        frame = Frame(FrameType.ACK, 0x21, 0, acknowledge, Flag.FROM_SLAVE, 4)
        assert master.receive(frame.encode(), 0) == []
    assert messages_in(slave.receive(sent, 0) + talk(master, slave)) == [
        Ping(0),
        Ping(1),
        Ping(2),
    ]


def test_its_own_echo_is_no_peer():
    master = Link(Role.MASTER, 1)
    events = master.receive(master.data_to_send(0), 0)
    assert [event.kind for event in events] == [ErrorKind.ECHO]
    assert not master.connected


def test_an_unknown_message_is_reported_acknowledged_and_passed_over():
    master, slave = connected()
    master.send(Ping(1))
    (frame,) = frames_in(master.data_to_send(0))
    newer = dataclasses.replace(frame, payload=b"\x7f\x01")
    (event,) = slave.receive(newer.encode(), 0)
    assert event == LinkError(ErrorKind.PAYLOAD, 1, "message number 127 is not one of the master's")
    assert slave.statistics.lost == 1
    slave.handle_timer(CONFIG.ack_delay_us)
    assert master.receive(slave.data_to_send(0), 0) == [MessageAcknowledged(1)]


def test_errors_come_out_as_events_and_counters():
    _, slave = connected()
    damaged = bytearray(Frame(FrameType.ACK, 0x12, 0, 0, 0, 4).encode())
    damaged[2] ^= 1
    foreign = Frame(FrameType.ACK, 0, 0, 0, 0, 0, version=3).encode()
    odd = Frame(9, 0x12, 0, 0, 0, 4).encode()
    empty = Frame(FrameType.HELLO, 0, 0, 0, 0, 4, bytes(6)).encode()
    short = Frame(FrameType.HELLO, 0, 0, 0, 0, 4, b"\1").encode()
    stream = bytes(damaged) * 2 + foreign + odd + empty + short
    events = slave.receive(stream, 0)
    assert events == [
        LinkError(ErrorKind.CRC, 2),
        LinkError(ErrorKind.VERSION, 1, "peer speaks version 3, we 1"),
        LinkError(ErrorKind.MALFORMED, 1, "frame type 9"),
        LinkError(ErrorKind.MALFORMED, 1, "a HELLO without an epoch"),
        LinkError(ErrorKind.MALFORMED, 1, "a HELLO of 6 bytes"),
    ]
    assert slave.statistics.crc_errors == 2
    assert slave.statistics.framing_errors == 4
    assert slave.error_counts[ErrorKind.MALFORMED] == 3
    assert slave.receive(b"\0", 0) == []


@given(st.lists(st.binary(max_size=80), max_size=20), st.booleans())
def test_no_bytes_raise_and_none_make_a_message(chunks, is_connected):
    slave = connected()[1] if is_connected else Link(Role.SLAVE, 2)
    for now, chunk in enumerate(chunks):
        assert messages_in(slave.receive(chunk, now)) == []
        slave.handle_timer(now)
        slave.data_to_send(now)


@given(
    st.lists(
        st.builds(
            Frame,
            frame_type=st.sampled_from([*FrameType, 9]),
            session=st.sampled_from([0x12, 0x21, 0x10, 0]),
            sequence=st.sampled_from([0, 1, 2, 127, 128, 255]),
            acknowledge=st.sampled_from([0, 1, 2, 127, 128, 255]),
            flags=st.integers(0, 15).map(lambda nibble: nibble << 4),
            window=st.integers(0, 15),
            payload=st.one_of(
                st.binary(max_size=12),
                st.sampled_from([b"\x03\x01\0", bytes.fromhex("010000020000")]),
                st.builds(
                    lambda e, c, p, d: e.to_bytes(2, "little") + bytes((c, p, 0, d)),
                    st.integers(0, 4), st.integers(0, 2), st.integers(0, 4), st.integers(0, 2),
                ),
            ),
        ),
        max_size=30,
    )
)  # fmt: skip
def test_no_sequence_of_intact_frames_raises(hostile):
    _, slave = connected()
    slave.send(Pong(1))
    for now, frame in enumerate(hostile):
        slave.receive(frame.encode(), 20_000 * now)
        slave.handle_timer(20_000 * now)
        slave.data_to_send(20_000 * now)
        assert slave.queued <= 1


@pytest.mark.parametrize(
    "wrong",
    [
        {"window": 0},
        {"window": 16},
        {"queue_limit": 0},
        {"ack_delay_us": -1},
        {"retransmit_us": 10_000},
        {"retransmit_max_us": 1},
    ],
)
def test_a_configuration_that_cannot_work_is_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        LinkConfig(**wrong)


def test_epoch_and_receive_window_are_checked():
    with pytest.raises(ValueError, match="epoch"):
        Link(Role.MASTER, 0)
    with pytest.raises(ValueError, match="receive_window"):
        Link(Role.MASTER, 1).receive_window = 16


def test_a_transport_opened_again_starts_with_a_zero_and_what_was_not_acknowledged():
    master, slave = connected()
    assert master.data_to_send(0) == b""
    master.send(TailBeat(1, 0.0, 0.25, 0.9, 5.0))
    master.send(Ping(7))
    cut = master.data_to_send(0, 6)  # the cable goes within the first frame
    assert messages_in(slave.receive(cut, 0)) == []
    master.handle_timer(100_000)
    master.handle_timer(300_000)  # backed off: alone it would wait longer
    master.resume(310_000)
    wire = master.data_to_send(310_000)
    assert wire[0] == 0
    hello, beat, ping = frames_in(wire)
    assert (hello.frame_type, hello.flags) == (FrameType.HELLO, Flag.REPLY)
    assert (beat.frame_type, beat.sequence, beat.acknowledge) == (FrameType.DATA, 0, 0)
    assert (ping.frame_type, ping.sequence) == (FrameType.DATA, 1)
    events = slave.receive(wire, 310_000)
    assert messages_in(events) == [TailBeat(1, 0.0, 0.25, 0.9, 5.0), Ping(7)]
    assert [event.kind for event in events if isinstance(event, LinkError)] == [ErrorKind.SHORT]
    talk(slave, master, 310_000)
    assert master.queued == 0
    assert not master.wants_to_send


def test_a_half_received_frame_is_forgotten_when_the_transport_is_opened_again():
    master, slave = connected()
    slave.send(Pong(3))
    wire = slave.data_to_send(0)
    master.receive(wire[:5], 0)
    master.resume(0)
    assert messages_in(master.receive(wire, 0)) == [Pong(3)]
    assert sum(master.error_counts.values()) == 0


def test_a_peer_that_was_exchanged_while_the_line_was_away_is_noticed_at_once():
    master, _slave = connected()
    master.send(Ping(1))
    master.data_to_send(0)
    fresh = Link(Role.SLAVE, 9, CONFIG)
    fresh.data_to_send(0)  # its greeting went nowhere
    master.resume(1_000)
    events = talk(master, fresh, 1_000)
    assert [event for event in events if isinstance(event, PeerReset)] == [PeerReset(9, 2, 1)]
    assert Ping(1) in messages_in(events)


def test_resuming_without_need_does_no_harm():
    master, slave = connected()
    for now_us in range(0, 5_000, 1_000):
        master.resume(now_us)
        slave.resume(now_us)
        master.send(Ping(now_us))
        assert messages_in(talk(master, slave, now_us)) == [Ping(now_us)]
    assert master.statistics.peer_resets == slave.statistics.peer_resets == 0
    assert slave.statistics.duplicates == 0


def test_what_was_in_flight_goes_again_without_waiting_for_a_timer():
    master, slave = connected()
    for token in range(3):
        master.send(Ping(token))
    assert len(frames_in(master.data_to_send(0))) == 3  # and the cable goes with all of them
    master.resume(1_000)
    again = [frame for frame in frames_in(master.data_to_send(1_000)) if frame.payload[:1] == b"\3"]
    assert [frame.sequence for frame in again] == [0, 1, 2]
    assert master.statistics.retransmissions == 3
    for frame in again:
        slave.receive(frame.encode(), 1_000)
    talk(slave, master, 1_000)
    assert master.queued == 0


pieces = st.one_of(
    st.integers(0, 11).map(lambda number: ("sent", number)),
    st.tuples(st.just("hurt"), st.integers(0, 11), st.integers(0, 400), st.integers(1, 255)),
    st.tuples(st.just("cut"), st.integers(0, 11), st.integers(0, 40)),
    st.tuples(st.just("noise"), st.binary(max_size=30)),
)


@given(st.lists(pieces, max_size=12), st.lists(st.integers(0, 600), max_size=12))
def test_any_bytes_split_anywhere_mean_the_same_and_never_what_was_not_sent(pieces, cuts):
    _, whole = connected(LinkConfig(window=12))
    master, split = connected(LinkConfig(window=12))
    for number in range(12):
        master.send(Ping(1000 + number))
    sent = [frame.encode() for frame in frames_in(master.data_to_send(0))]
    stream = bytearray()
    for piece in pieces:
        match piece:
            case ("sent", number):
                stream += sent[number]
            case ("hurt", number, place, flip):
                damaged = bytearray(sent[number])
                damaged[place % len(damaged)] ^= flip
                stream += damaged
            case ("cut", number, length):
                stream += sent[number][:length]
            case ("noise", noise):
                stream += noise
    told = whole.receive(bytes(stream), 0)
    edges = sorted({0, len(stream), *(cut % (len(stream) + 1) for cut in cuts)})
    again = [event for a, b in pairwise(edges) for event in split.receive(bytes(stream[a:b]), 0)]
    got = messages_in(told)
    assert got == [Ping(1000 + number) for number in range(len(got))], "once, in order, as sent"
    assert messages_in(again) == got
    assert split.statistics == whole.statistics
    assert split.error_counts == whole.error_counts
    assert split.data_to_send(0) == whole.data_to_send(0)
