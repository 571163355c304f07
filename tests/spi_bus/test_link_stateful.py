"""Two links over a channel that loses, corrupts, cuts, repeats, delays and reorders, with resets.

The model knows what each incarnation of each side queued. At any time: what an incarnation receives
is a gapless, ordered run of what one incarnation of the other side sent; nothing that its sender
knows to be acknowledged arrives again; what is acknowledged has arrived. Once the faults stop,
everything queued arrives within three of the longest retransmission times. What arrives of a stream
is what the incarnation that is connected has streamed, and no stream keeps messages from arriving.

Each side has a clock of its own, which began at another time and runs up to 2 % fast or slow, as
an MCU's RC oscillator does.

Old chunks may come back at any later time, over any number of sessions, within the stated limits:
fewer than 16 boots and 128 messages later.
"""

import pytest
from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from spi_bus.errors import LinkFull
from spi_bus.link import (
    Link,
    LinkConfig,
    LinkUp,
    MessageAcknowledged,
    MessageReceived,
    PeerReset,
    Role,
    StreamReceived,
)
from spi_bus.messages import Ping, Pong

LATENCY_US = 1_000
CONFIG = LinkConfig(
    window=3, queue_limit=6, ack_delay_us=5_000, retransmit_us=20_000, retransmit_max_us=160_000
)
WORST_DRIFT_PPM = 20_000
RECOVERY_US = 3 * CONFIG.retransmit_max_us * (1_000_000 + WORST_DRIFT_PPM) // 1_000_000
MAX_BOOTS = 15


class Side:
    """A link, its reboots, and what the model knows of it."""

    new_link = staticmethod(Link)

    def __init__(self, role: Role) -> None:
        self.role = role
        self.drift_ppm = 0
        self.origin_us = 0
        self.epoch = 0
        self.number = 0  # of the last message, unique over all incarnations
        self.streamed: dict[int, set[int]] = {}  # by epoch
        self.acknowledged: set[int] = set()
        self.delivered: set[int] = set()  # of our messages, at any incarnation of the other side
        self.boot()

    def clock(self, now: int) -> int:
        """What our clock shows."""
        return self.origin_us + now + now * self.drift_ppm // 1_000_000

    def boot(self) -> None:
        self.epoch += 1
        self.link = self.new_link(self.role, self.epoch, CONFIG)
        self.first = self.number + 1  # first message of this incarnation
        self.token_offset = self.number
        self.last_received = 0
        self.sessions: list[int] = []
        self.streamed[self.epoch] = set()

    def stream(self, token: int) -> None:
        """Hand over a message of the stream; its tokens are not those of messages."""
        kind = Ping if self.role is Role.MASTER else Pong
        assert self.link.send_newest(kind(token)) == self.link.connected
        self.streamed[self.epoch].add(token)

    def send(self) -> None:
        try:
            token = self.link.send((Ping if self.role is Role.MASTER else Pong)(self.number + 1))
        except LinkFull:
            assert self.link.queued == CONFIG.queue_limit
            return
        self.number += 1
        assert token + self.token_offset == self.number


class LossyLink(RuleBasedStateMachine):
    """Rules are what the world does; `check` is what must hold whatever it does."""

    new_side = Side

    @initialize(
        drifts=st.tuples(*2 * [st.sampled_from([0, -WORST_DRIFT_PPM, 100, WORST_DRIFT_PPM])]),
        origin_us=st.sampled_from([0, 123_456_789]),
    )
    def start(self, drifts: tuple[int, int], origin_us: int) -> None:
        self.now = 0
        self.token = 0
        self.sides = (self.new_side(Role.MASTER), self.new_side(Role.SLAVE))
        for side, drift in zip(self.sides, drifts, strict=True):
            side.drift_ppm = drift
        self.sides[1].origin_us = origin_us
        self.flying: tuple[list[bytes], list[bytes]] = ([], [])  # towards master, towards slave
        self.old: tuple[list[bytes], list[bytes]] = ([], [])

    def _poll(self, index: int, limit: int | None = None) -> None:
        side = self.sides[index]
        now = side.clock(self.now)
        deadline = side.link.next_deadline_us()
        if deadline is not None and deadline <= now:
            side.link.handle_timer(now)
        wants = side.link.wants_to_send
        data = side.link.data_to_send(now, limit)
        assert bool(data) == wants
        if data:
            self.flying[1 - index].append(data)

    def _arrive(self, index: int, data: bytes) -> None:
        side, other = self.sides[index], self.sides[1 - index]
        for event in side.link.receive(data, side.clock(self.now)):
            match event:
                case MessageReceived(message):
                    number = message.token
                    assert type(message) is (Pong if side.role is Role.MASTER else Ping)
                    assert number <= other.number, "never sent"
                    assert number not in other.acknowledged, "acknowledged and delivered again"
                    assert number > side.last_received, "twice, or out of order"
                    if side.last_received >= other.first:
                        assert number == side.last_received + 1, "a gap"
                    side.last_received = number
                    other.delivered.add(number)
                case StreamReceived(message):
                    assert type(message) is (Pong if side.role is Role.MASTER else Ping)
                    assert message.token in other.streamed[side.link.peer_epoch]
                case MessageAcknowledged(token):
                    number = token + side.token_offset
                    assert number in side.delivered, "acknowledged and never delivered"
                    assert number not in side.acknowledged, "acknowledged twice"
                    side.acknowledged.add(number)
                case LinkUp(epoch):
                    assert not side.sessions
                    side.sessions.append(epoch)
                case PeerReset(epoch, previous, _):
                    assert side.sessions[-1] == previous < epoch, "back to an earlier incarnation"
                    side.sessions.append(epoch)

    @rule(index=st.integers(0, 1), count=st.integers(1, 4))
    def send(self, index: int, count: int) -> None:
        for _ in range(count):
            self.sides[index].send()

    @rule(index=st.integers(0, 1), count=st.integers(1, 3))
    def stream(self, index: int, count: int) -> None:
        for _ in range(count):
            self.token = (self.token + 1) % 0x10000
            self.sides[index].stream(self.token)

    @rule(delay_us=st.sampled_from([0, 100, 3_000, 6_000, 25_000, 90_000, 200_000]))
    def wait(self, delay_us: int) -> None:
        self.now += delay_us
        for index in (0, 1):
            self._poll(index)

    @rule(index=st.integers(0, 1), limit=st.sampled_from([1, 7, 16, 30]))
    def clock_a_few_bytes(self, index: int, limit: int) -> None:
        self._poll(index, limit)

    @precondition(lambda self: any(self.flying))
    @rule(index=st.integers(0, 1), count=st.integers(1, 6))
    def deliver(self, index: int, count: int) -> None:
        for _ in range(count):
            if self.flying[index]:
                data = self.flying[index].pop(0)
                self.old[index].append(data)
                self._arrive(index, data)

    @rule()
    def exchange(self) -> None:
        for _ in range(4):
            for index in (0, 1):
                self._poll(index)
                self.deliver(index, 9)

    @precondition(lambda self: any(self.flying))
    @rule(index=st.integers(0, 1), which=st.integers(0, 5))
    def lose(self, index: int, which: int) -> None:
        if which < len(self.flying[index]):
            self.old[index].append(self.flying[index].pop(which))

    @precondition(lambda self: any(self.flying))
    @rule(index=st.integers(0, 1), position=st.integers(0, 400), flip=st.integers(1, 255))
    def corrupt(self, index: int, position: int, flip: int) -> None:
        if self.flying[index]:
            data = bytearray(self.flying[index][0])
            data[position % len(data)] ^= flip
            self.flying[index][0] = bytes(data)

    @precondition(lambda self: any(self.flying))
    @rule(index=st.integers(0, 1), position=st.integers(0, 400))
    def cut(self, index: int, position: int) -> None:
        if self.flying[index]:
            data = self.flying[index].pop(0)
            if rest := data[position % len(data) :]:
                self.flying[index].insert(0, rest)

    @precondition(lambda self: any(self.old))
    @rule(index=st.integers(0, 1), which=st.integers(0, 30))
    def repeat_an_old_one(self, index: int, which: int) -> None:
        if self.old[index]:
            self.flying[index].insert(0, self.old[index][which % len(self.old[index])])

    @precondition(lambda self: any(len(chunks) > 1 for chunks in self.flying))
    @rule(index=st.integers(0, 1))
    def reorder(self, index: int) -> None:
        self.flying[index].reverse()

    @rule(index=st.integers(0, 1), noise=st.binary(min_size=1, max_size=20))
    def noise(self, index: int, noise: bytes) -> None:
        self._arrive(index, noise)

    @precondition(lambda self: min(side.epoch for side in self.sides) < MAX_BOOTS)
    @rule(index=st.integers(0, 1))
    def reset(self, index: int) -> None:
        if self.sides[index].epoch < MAX_BOOTS:
            self.sides[index].boot()

    @rule(index=st.integers(0, 1), keep=st.integers(0, 40), both=st.booleans())
    def open_again(self, index: int, keep: int, both: bool) -> None:
        """The transport went away within a chunk and came back; the other side may not notice."""
        for way in (0, 1):
            if self.flying[way]:
                self.old[way].extend(self.flying[way])
                self.flying[way][:] = [rest] if (rest := self.flying[way][0][:keep]) else []
        for side in (self.sides[index], self.sides[1 - index])[: 1 + both]:
            side.link.resume(side.clock(self.now))

    @rule(index=st.integers(0, 1), window=st.integers(0, 3))
    def hold_off(self, index: int, window: int) -> None:
        self.sides[index].link.receive_window = window

    @rule()
    def faults_stop(self) -> None:
        """Everything queued arrives in time, and then there is silence."""
        for side in self.sides:
            side.link.receive_window = CONFIG.window
        end = self.now + RECOVERY_US
        links = [side.link for side in self.sides]
        while any(
            link.queued or link.wants_to_send or link.next_deadline_us() is not None
            for link in links
        ):
            assert self.now <= end, "not recovered in time"
            for index in (0, 1):
                self._poll(index)
                self.deliver(index, 1000)
            self.now += LATENCY_US
        for side in self.sides:
            assert side.link.peer_epoch == self.sides[side is self.sides[0]].epoch
            assert side.acknowledged >= set(range(side.first, side.number + 1))

    @invariant()
    def nothing_is_lost(self) -> None:
        for side in self.sides:
            assert side.link.statistics.lost == 0
            acknowledged = len([n for n in side.acknowledged if n >= side.first])
            assert side.link.queued == side.number - side.first + 1 - acknowledged

    def teardown(self) -> None:
        if hasattr(self, "sides"):
            self.faults_stop()


@pytest.mark.parametrize("steps", [30, 120])
def test_exactly_once_in_order_over_a_hostile_channel(steps):
    run_state_machine_as_test(
        LossyLink,
        settings=settings(
            max_examples=6_000 // steps,
            stateful_step_count=steps,
            deadline=None,
            derandomize=True,
            phases=(Phase.generate, Phase.shrink),
        ),
    )
