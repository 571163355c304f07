"""The bridge between emulated air and a mote: what crosses, what does not, and its lossy life."""

from __future__ import annotations

import hypothesis.strategies as st
from hypothesis import settings
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from radio_802154 import mac, messages, tinyos
from radio_802154.mote_bridge import BridgeConfig, Dropped, MoteBridge
from radio_802154.serial_link import MOTE, PacketReceived, SerialConfig, SerialLink
from radio_802154.tinyos import AM_BROADCAST, AmPacket
from radio_802154.tinyos_serial import AmMessage, Decoder, decode_am, encode_am

BASE, ROBOT, REAL = 0, 1, 7

FRAME = bytes.fromhex("6188 26 2200 0700 0000 3f 06 7e7d0102")
"""Data, acknowledgement wanted, DSN 26, PAN 0022, to 7, from 0; active message 06."""
PACKET = bytes.fromhex("7e 44 26 00 0007 0000 04 22 06 7d5e 7d5d 01 02 ed b3 7e")
"""The same on the serial line; CRC by Python's binascii.crc_hqx."""
BROADCAST = bytes.fromhex("4188 27 2200 ffff 0000 3f 06 7e7d0102")
BROADCAST_PACKET = bytes.fromhex("7e 44 26 00 ffff 0000 04 22 06 7d5e 7d5d 01 02 18 7b 7e")
ACK_26 = bytes.fromhex("7e 43 26 3b 1c 7e")
FROM_MOTE = bytes.fromhex("7e 45 00 0000 0007 03 22 21 616263")


def bridge(*addresses: int, first: int = 0x26, **config: int) -> MoteBridge:
    return MoteBridge(BridgeConfig(frozenset(addresses or (BASE,)), **config), first)


def from_mote(message: AmMessage) -> bytes:
    mote = SerialLink(MOTE)
    mote.send_am(message)
    return mote.data_to_send(0)


def test_a_literal_frame_becomes_a_literal_packet() -> None:
    host = bridge()
    assert host.heard(FRAME, 0)  # acknowledged in the place of 7
    assert host.data_to_send(0) == PACKET
    told: list[tuple[int, int | None]] = []
    host.on_acknowledged = lambda waited, trip: told.append((waited, trip))
    assert host.receive(ACK_26, 5_000) == []
    assert told == [(5_000, 5_000)]
    assert host.statistics.taken == host.statistics.acknowledged == 1


def test_a_broadcast_is_carried_and_not_acknowledged() -> None:
    host = bridge()
    assert not host.heard(BROADCAST, 0)
    assert host.data_to_send(0) == BROADCAST_PACKET


def test_a_packet_becomes_a_frame_with_an_acknowledgement_request() -> None:
    host = bridge()
    message = AmMessage(BASE, 0x21, b"abc", REAL)
    assert from_mote(message).startswith(FROM_MOTE)
    (packet,) = host.receive(from_mote(message), 0)
    assert tinyos.encode(packet) == bytes.fromhex("6188 27 2200 0000 0700 3f 21 616263")
    (packet,) = host.receive(from_mote(AmMessage(AM_BROADCAST, 6, b"", REAL)), 0)
    assert tinyos.encode(packet) == bytes.fromhex("4188 28 2200 ffff 0700 3f 06")


def test_all_of_our_messages_fit() -> None:
    assert BridgeConfig(frozenset()).longest_payload == messages.TOSH_DATA_LENGTH
    for row in messages.AM_MESSAGES:
        assert row.layout.size <= messages.TOSH_DATA_LENGTH


def test_between_emulated_nodes_the_answer_is_theirs_and_the_mote_hears_it() -> None:
    host = bridge(BASE, ROBOT)
    frame = tinyos.encode(AmPacket(ROBOT, BASE, 0x10, b"x", 1))
    assert not host.heard(frame, 0)
    assert host.statistics.taken == 1


def test_a_retry_is_acknowledged_again_and_not_carried_again() -> None:
    host = bridge()
    assert host.heard(FRAME, 0)
    assert host.heard(FRAME, 20_000)
    assert (host.statistics.taken, host.statistics.repeated) == (1, 1)
    assert host.heard(FRAME, 1_000_001)  # the number came round
    assert host.statistics.taken == 2


def test_a_full_queue_is_silent_and_the_retry_finds_room() -> None:
    host = bridge(queue_limit=1)
    assert host.heard(FRAME, 0)
    second = tinyos.encode(AmPacket(REAL, BASE, 6, b"second", 0x27))
    assert not host.heard(second, 10)
    assert host.statistics.outward == {Dropped.QUEUE_FULL: 1}
    host.data_to_send(20)
    host.receive(ACK_26, 30)
    assert host.heard(second, 40)


def test_what_is_not_carried_is_counted_and_not_acknowledged() -> None:
    host = bridge(longest_payload=4)
    cases = {
        Dropped.NOT_AM: bytes.fromhex("6188 01 2200 0700 0000 41 06"),
        Dropped.OTHER_PAN: tinyos.encode(AmPacket(REAL, BASE, 6, b"", pan_id=0x23)),
        Dropped.NOT_OURS: tinyos.encode(AmPacket(REAL, 9, 6, b"")),
        Dropped.TOO_LONG: tinyos.encode(AmPacket(REAL, BASE, 6, bytes(5))),
    }
    for frame in cases.values():
        assert not host.heard(frame, 0)
    assert not host.heard(b"\xff", 0)
    assert not host.heard(mac.encode(mac.ack_frame(3)), 0)  # not counted: nobody's message
    assert host.statistics.outward == {**dict.fromkeys(cases, 1), Dropped.NOT_AM: 2}
    assert host.statistics.heard == 5
    assert not host.wants_to_send


def test_what_does_not_come_in_is_counted() -> None:
    host = bridge()
    cases = {
        Dropped.OTHER_GROUP: AmMessage(BASE, 6, b"", REAL, 0x23),
        Dropped.OWN_SOURCE: AmMessage(BASE, 6, b"", BASE),
        Dropped.ELSEWHERE: AmMessage(9, 6, b"", REAL),
        Dropped.DISPATCH: AmMessage(BASE, 6, bytes(tinyos.MAX_PAYLOAD_OCTETS + 1), REAL),
    }
    for message in cases.values():
        assert host.receive(from_mote(message), 0) == []
    mote = SerialLink(MOTE)
    mote.send(b"printf", dispatch=100)
    assert host.receive(mote.data_to_send(0), 0) == []
    assert host.statistics.inward == {**dict.fromkeys(cases, 1), Dropped.DISPATCH: 2}
    assert host.statistics.packets == 5


def test_a_mote_that_is_silent_is_given_up_and_said_so() -> None:
    host = MoteBridge(
        BridgeConfig(frozenset((BASE,)), serial=SerialConfig(acknowledged=True, attempts=3))
    )
    host.heard(FRAME, 0)
    now_us = 0
    while (due_us := host.next_deadline_us()) is not None or host.wants_to_send:
        host.data_to_send(now_us)
        now_us = max(now_us, due_us or 0)
        host.handle_timer(now_us)
        assert now_us < 10_000_000
    assert host.statistics.outward == {Dropped.GIVEN_UP: 1}
    assert host.link.statistics.retransmissions == 2


def test_the_round_trip_of_what_was_sent_again_is_nobodys_guess() -> None:
    host = bridge()
    told: list[tuple[int, int | None]] = []
    host.on_acknowledged = lambda waited, trip: told.append((waited, trip))
    host.heard(FRAME, 0)
    host.data_to_send(1_000)
    host.handle_timer(201_000)
    host.data_to_send(201_000)
    host.receive(ACK_26, 204_000)
    assert told == [(204_000, None)]
    host.heard(BROADCAST, 300_000)
    host.data_to_send(300_000)
    host.receive(bytes.fromhex("7e 43 27 1a 0c 7e"), 303_000)
    assert told[1] == (303_000 - 300_000, 3_000)


class Life(RuleBasedStateMachine):
    """Emulated nodes that retry, a line that loses, repeats and holds back, a mote without room."""

    def __init__(self) -> None:
        super().__init__()
        self.now_us = 0
        self.host = bridge(BASE, ROBOT, first=0, queue_limit=4)
        self.mote = SerialLink(MOTE)
        self.mote.room = 2
        self.number = 0
        self.answered: list[bytes] = []
        """Payloads that the bridge has acknowledged in the place of a real node, each once."""
        self.out: list[bytes] = []
        """Payloads that the mote's radio was given."""
        self.to_mote: list[bytes] = []
        self.to_host: list[bytes] = []
        self.spy = Decoder()
        self.arrived_us: dict[bytes, int] = {}
        self.came: list[AmPacket] = []

    def deliver(self, data: bytes) -> None:
        arriving = [packet.body for packet in self.spy.receive(data) if packet.body]
        for event in self.mote.receive(data, self.now_us):
            if not isinstance(event, PacketReceived):
                continue  # damage
            message = decode_am(event.packet.body)
            assert message.source in (BASE, ROBOT)  # nothing that came from the mote goes back
            if message.payload in self.out:  # the mote remembers a packet for a second
                last_us = self.arrived_us[event.packet.body]
                assert self.now_us - last_us >= self.mote.config.duplicate_us
            else:
                self.out.append(message.payload)
        for body in arriving:
            self.arrived_us[body] = self.now_us

    @rule(source=st.sampled_from([BASE, ROBOT]), tries=st.integers(1, 4), to=st.sampled_from(
        [REAL, AM_BROADCAST, BASE, ROBOT]))  # fmt: skip
    def an_emulated_node_speaks(self, source: int, tries: int, to: int) -> None:
        self.number += 1
        payload = self.number.to_bytes(4, "big")
        frame = tinyos.encode(AmPacket(to, source, 6, payload, self.number & 0xFF))
        for _ in range(1 if to == AM_BROADCAST else tries):  # its acknowledgement may be lost
            answered = self.host.heard(frame, self.now_us)
            assert not (answered and to in (BASE, ROBOT, AM_BROADCAST))
            if answered and payload not in self.answered:
                self.answered.append(payload)

    @rule(share=st.integers(0, 2))
    def the_host_writes(self, share: int) -> None:
        if self.host.wants_to_send:
            data = self.host.data_to_send(self.now_us)
            self.to_mote += [data] * share  # lost, once, twice

    @precondition(lambda self: self.to_mote)
    @rule(cut=st.sampled_from([None, None, 1, 7, -1]))
    def octets_reach_the_mote(self, cut: int | None) -> None:
        self.deliver(self.to_mote.pop(0)[:cut])

    @rule(share=st.integers(0, 2))
    def the_mote_writes(self, share: int) -> None:
        if self.mote.wants_to_send:
            data = self.mote.data_to_send(self.now_us)
            self.to_host += [data] * share

    @precondition(lambda self: self.to_host)
    @rule()
    def octets_reach_the_host(self) -> None:
        self.came += self.host.receive(self.to_host.pop(0), self.now_us)

    @rule(source=st.sampled_from([REAL, BASE, 9]), to=st.sampled_from(
        [BASE, ROBOT, AM_BROADCAST, 9]))  # fmt: skip
    def the_mote_hears(self, source: int, to: int) -> None:
        self.number += 1
        payload = self.number.to_bytes(4, "big")
        self.mote.send(encode_am(AmMessage(to, 0x21, payload, source)))

    @rule()
    def the_mote_s_radio_sends(self) -> None:
        self.mote.room = 2

    @rule(duration_us=st.sampled_from([1_000, 50_000, 200_000]))
    def time_passes(self, duration_us: int) -> None:
        self.now_us += duration_us
        self.host.handle_timer(self.now_us)

    @invariant()
    def all_is_accounted_for(self) -> None:
        counts = self.host.statistics
        queued = self.host.link.queued
        gone = counts.acknowledged + counts.outward[Dropped.GIVEN_UP]
        assert counts.taken == gone + queued
        refused = counts.outward.total() - counts.outward[Dropped.GIVEN_UP]
        assert counts.heard == counts.taken + counts.repeated + refused
        assert counts.packets == counts.admitted + counts.inward.total()
        assert counts.admitted == len(self.came)

    @invariant()
    def nothing_goes_twice_or_out_of_order(self) -> None:
        assert self.out == sorted(self.out)

    @invariant()
    def nothing_comes_in_that_is_our_own_or_for_somebody_else(self) -> None:
        for packet in self.came:
            assert packet.source not in (BASE, ROBOT)
            assert packet.destination in (BASE, ROBOT, AM_BROADCAST)
        numbers = [packet.sequence for packet in self.came]
        assert numbers == [(n + 1) & 0xFF for n in range(len(numbers))]

    def teardown(self) -> None:
        """The line is good from now on: all that was acknowledged arrives."""
        self.to_mote.clear()
        self.to_host.clear()
        for _ in range(60):
            self.mote.room = 2
            self.now_us += 100_000
            self.host.handle_timer(self.now_us)
            if self.host.wants_to_send:
                self.deliver(self.host.data_to_send(self.now_us))
            if self.mote.wants_to_send:
                self.came += self.host.receive(self.mote.data_to_send(self.now_us), self.now_us)
        assert self.host.link.queued == 0
        given_up = self.host.statistics.outward[Dropped.GIVEN_UP]
        assert len(set(self.answered) - set(self.out)) <= given_up
        assert self.host.statistics.acknowledged <= len(self.out)


Life.TestCase.settings = settings(max_examples=60, stateful_step_count=60)
TestLife = Life.TestCase
