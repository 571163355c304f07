"""The link: messages exactly once and in order over a byte stream that loses, repeats and corrupts.

Sans-IO: bytes and the time (integer microseconds) come in, events and bytes go out; no clock, no
port. `docs/link.md` has the protocol in words and its guarantees. In short:

- Go-back-N with a small window and cumulative acknowledgements. The receiver takes messages only in
  order and keeps none back, so that an MCU needs memory for its own few unacknowledged messages and
  nothing else. A receiver that sees a gap says so once, which saves the time-out.
- Acknowledgements ride on data; alone they go after a short delay, or at once where it helps.
- The receive window is advertised in every frame. A closed window is probed with one message, at
  the retransmission timer's pace: a lost window update cannot stop the link.
- Every boot has an epoch. Both sides prove in a handshake (HELLO) that they are alive by repeating
  the other's epoch and challenge, so that a stale HELLO cannot tear a live session down. Frames
  carry both epochs' low bits; those of another session are dropped.
- Nothing queued is ever given up: it waits for the peer, whichever incarnation.
- A stream (`send_newest`) goes beside this: a fixed-rate sample that was lost is worthless by the
  time it could be sent again, so it is not; while one waits, a newer one takes its place.
"""

import struct
from collections import deque
from typing import Final

from spi_bus.errors import LinkFull, PayloadError
from spi_bus.frame import (
    ACKNOWLEDGE,
    FLAGS_WINDOW,
    HEADER_BYTES,
    MAX_WINDOW,
    SEQUENCE,
    SESSION,
    VERSION,
    VERSION_TYPE,
    Decoder,
    ErrorKind,
    Flag,
    FrameType,
    seal,
)
from spi_bus.layout import MessageTable
from spi_bus.link_types import (
    Event,
    LinkConfig,
    LinkError,
    LinkUp,
    MessageAcknowledged,
    MessageReceived,
    PeerReset,
    Role,
    Statistics,
    StreamReceived,
    Timer,
)
from spi_bus.messages import LINK_MESSAGES

__all__ = [
    "Event",
    "Link",
    "LinkConfig",
    "LinkError",
    "LinkUp",
    "MessageAcknowledged",
    "MessageReceived",
    "PeerReset",
    "Role",
    "Statistics",
    "StreamReceived",
]


_HELLO: Final = struct.Struct("<HBHB")  # epoch, challenge, and the peer's; epoch 0: none known
_HELLO_BYTES: Final = HEADER_BYTES + _HELLO.size
_TYPE_HELLO: Final = VERSION << 4 | FrameType.HELLO
_TYPE_DATA: Final = VERSION << 4 | FrameType.DATA
_TYPE_ACK: Final = VERSION << 4 | FrameType.ACK
_TYPE_STREAM: Final = VERSION << 4 | FrameType.STREAM
_FROM_SLAVE: Final = int(Flag.FROM_SLAVE)  # plain ints: IntFlag arithmetic costs a microsecond
_GAP: Final = int(Flag.GAP)
_REPLY: Final = int(Flag.REPLY)
_PROBE_AFTER_TIMEOUTS: Final = 4
"""Time-outs in a row after which the peer is asked for a HELLO as well: is it who it was?"""


class Link:
    """One side of the link.

    Args:
        role: master or slave; it decides which messages may be sent and which are understood.
        epoch: number of this boot, 1 to 65535, different from the last boots': a reset counter.
        config: sizes and times.
        table: the messages.

    A link that is made anew after a reset knows nothing of its predecessor: messages queued there
    and not acknowledged are gone unless the application queues them again, and one of them whose
    acknowledgement was lost may have been delivered.

    `receive_window` is how many more messages the application takes at present; lower it while
    messages wait to be processed, 0 holds the peer off.

    """

    def __init__(
        self,
        role: Role,
        epoch: int,
        config: LinkConfig | None = None,
        table: MessageTable = LINK_MESSAGES,
    ) -> None:
        if not 1 <= epoch <= 0xFFFF:
            raise ValueError(f"epoch = {epoch} is outside 1 to 65535")
        config = config or LinkConfig()
        self.role = role
        self.epoch = epoch
        self.config = config
        self.statistics = Statistics()
        self._table = table
        self._peer_role = role.other
        self._own_flag = _FROM_SLAVE if role is Role.SLAVE else 0
        self._decoder = Decoder()
        self._errors = dict(self._decoder.errors)
        self._now_us = 0
        self._outgoing = b""  # the rest of a frame that a limit cut

        self._queue: deque[tuple[int, bytes]] = deque()  # token, payload
        self._token = 0
        self._base = 0  # sequence of the queue's first message
        self._next = 0  # index in the queue of what is sent next
        self._high = 0  # how many of the queue have been sent in this session
        self._peer_window = 1
        self._probe = False
        self._went_back = False
        self._timeouts = 0
        self._data_timer = Timer(config.retransmit_us, config.retransmit_max_us)

        self._newest = b""  # payload of the stream's newest message, until the line takes it
        self._stream_last = False  # the next turn is a message's, where one waits

        self._expected = 0
        self._receive_window = config.window
        self._unacknowledged = 0  # messages received since our last frame
        self._ack_due = False
        self._gap_due = False
        self._gap_told = False
        self._ack_deadline_us: int | None = None

        self._peer_epoch = 0  # 0: not connected
        self._peer_challenge = 0
        self._candidate_epoch = 0
        self._candidate_challenge = 0
        self._challenge = 0
        self._session_out = 0
        self._session_in = 0
        self._hello_due = True
        self._hello_to: tuple[int, int] | None = None
        self._ask = False  # the next HELLO wants a reply, once: two that always asked never ended
        self._hello_timer = Timer(config.retransmit_us, config.retransmit_max_us)

    # What the application sees.

    @property
    def connected(self) -> bool:
        """Whether a peer has proved to be there since this link began."""
        return self._peer_epoch != 0

    @property
    def peer_epoch(self) -> int:
        """The peer's epoch, 0 before the first contact."""
        return self._peer_epoch

    @property
    def queued(self) -> int:
        """Messages not acknowledged yet, sent or not."""
        return len(self._queue)

    @property
    def error_counts(self) -> dict[ErrorKind, int]:
        """Pieces of the received stream thrown away, by kind."""
        return dict(self._errors)

    @property
    def receive_window(self) -> int:
        """Messages that the application takes at present."""
        return self._receive_window

    @receive_window.setter
    def receive_window(self, messages: int) -> None:
        if not 0 <= messages <= MAX_WINDOW:
            raise ValueError(f"receive_window = {messages} is outside 0 to {MAX_WINDOW}")
        if messages > self._receive_window and self._receive_window == 0:
            self._ack_due = self.connected  # the peer waits for this
        self._receive_window = messages

    def send(self, message: object) -> int:
        """Queue a message; the token comes back in its `MessageAcknowledged`.

        Raises:
            LinkFull: nothing was queued.
            FieldError: a value does not fit.
            UnknownMessageError: this side sends no such message.

        """
        if len(self._queue) >= self.config.queue_limit:
            raise LinkFull(f"{len(self._queue)} messages wait for the {self._peer_role}")
        payload = self._table.encode(message, self.role)
        self._token += 1
        self._queue.append((self._token, payload))
        self.statistics.messages_sent += 1
        if self._peer_window == 0 and self._data_timer.deadline_us is None:
            self._data_timer.start(self._now_us)
        return self._token

    def send_newest(self, message: object) -> bool:
        """Hand over the newest message of this side's stream; return whether there is a peer.

        It goes with the next frame, once. One that still waited is dropped for it; without a peer
        nothing is kept.

        Raises:
            FieldError: a value does not fit.
            UnknownMessageError: this side sends no such message.

        """
        payload = self._table.encode(message, self.role)
        if not self._peer_epoch:
            return False
        self._drop_newest()
        self._newest = payload
        return True

    # What the transport sees.

    @property
    def wants_to_send(self) -> bool:
        """Whether `data_to_send` has something now: the state of a data-ready line."""
        return (
            bool(self._outgoing or self._newest)
            or self._hello_due
            or self._ack_due
            or self._sendable()
        )

    def next_deadline_us(self) -> int | None:
        """Return when `handle_timer` wants to be called; None while nothing is waited for."""
        deadline = self._data_timer.deadline_us
        for other in (self._hello_timer.deadline_us, self._ack_deadline_us):
            if other is not None and (deadline is None or other < deadline):
                deadline = other
        return deadline

    def handle_timer(self, now_us: int) -> None:
        """Do what is due: acknowledge, retransmit, greet. Early or late calls do no harm."""
        self._now_us = now_us
        if self._ack_deadline_us is not None and now_us >= self._ack_deadline_us:
            self._ack_deadline_us = None
            self._ack_due = True
        timer = self._data_timer
        if timer.deadline_us is not None and now_us >= timer.deadline_us:
            timer.back_off(now_us)
            self._next = 0
            self._probe = True
            self._went_back = False
            self._timeouts += 1
            if self._timeouts >= _PROBE_AFTER_TIMEOUTS:
                self._hello_due = True
        timer = self._hello_timer
        if timer.deadline_us is not None and now_us >= timer.deadline_us:
            timer.back_off(now_us)
            self._hello_due = True

    def data_to_send(
        self, now_us: int, limit: int | None = None, *, acknowledge: bool = False
    ) -> bytes:
        """Return the bytes to put on the wire now, at most `limit`; b"" when there are none.

        Frames come whole with their closing zero, but a limit may cut one; the rest comes first
        next time. Zeros may be added between calls as filler only where no frame is cut.

        `acknowledge`: say now what was received, where that would still have waited for company.
        A master that clocks filler anyway for the slave's sake gives it a ride for nothing.
        """
        self._now_us = now_us
        if acknowledge and self._unacknowledged:
            self._ack_due = True
        data = self._outgoing
        while limit is None or len(data) < limit:
            frame = self._next_frame(now_us)
            if not frame:
                break
            data += frame
        if limit is None or len(data) <= limit:
            self._outgoing = b""
            return data
        limit = max(limit, 0)
        self._outgoing = data[limit:]
        return data[:limit]

    def resume(self, now_us: int) -> None:
        """The transport was opened, or opened again: bytes on their way are gone.

        A zero goes first, so that the peer's decoder is in step whatever it has heard before.
        Halves of frames are forgotten on both ways, what is not acknowledged is sent again at once
        and not when a timer that has backed off says so, and a peer that was connected is asked
        whether it is who it was. Calling this without need costs three short frames.
        """
        self._now_us = now_us
        self._decoder.reset()
        self._outgoing = b"\0"
        self._drop_newest()
        self._hello_due = True
        self._hello_timer.stop()
        if not self._peer_epoch:
            return
        self._ask = True
        self._ack_due = True
        self._gap_told = self._gap_due = False
        self._next = 0
        self._went_back = True
        self._data_timer.stop()
        if self._high or (not self._peer_window and self._queue):
            self._data_timer.start(now_us)

    def receive(self, data: bytes, now_us: int) -> list[Event]:
        """Return what received bytes mean: any bytes, split anywhere; none of them raises."""
        self._now_us = now_us
        decoder = self._decoder
        errors_before = decoder.error_count
        bodies = decoder.receive(data)
        events: list[Event] = []
        if decoder.error_count != errors_before:
            self._report_errors(events)
        for body in bodies:
            self._receive_body(body, now_us, events)
        return events

    # Receiving.

    def _report_errors(self, events: list[Event]) -> None:
        for kind, total in self._decoder.errors.items():
            count = total - self._errors[kind]
            if count <= 0:
                continue
            self._errors[kind] = total
            detail = ""
            if kind is ErrorKind.CRC:
                self.statistics.crc_errors += count
            else:
                self.statistics.framing_errors += count
                if kind is ErrorKind.VERSION:
                    detail = f"peer speaks version {self._decoder.foreign_version}, we {VERSION}"
            events.append(LinkError(kind, count, detail))

    def _malformed(self, kind: ErrorKind, detail: str, events: list[Event]) -> None:
        self._errors[kind] += 1
        self.statistics.framing_errors += 1
        events.append(LinkError(kind, 1, detail))

    def _receive_body(self, body: bytes, now_us: int, events: list[Event]) -> None:
        self.statistics.frames_received += 1
        flags_window = body[FLAGS_WINDOW]
        if flags_window & _FROM_SLAVE == self._own_flag:
            self._malformed(ErrorKind.ECHO, f"a frame from a {self.role} came back", events)
            return
        version_type = body[VERSION_TYPE]
        if version_type == _TYPE_HELLO:
            self._receive_hello(body, now_us, events)
            return
        if version_type not in (_TYPE_DATA, _TYPE_ACK, _TYPE_STREAM):
            self._malformed(ErrorKind.MALFORMED, f"frame type {version_type & 15}", events)
            return
        if not self._peer_epoch or body[SESSION] != self._session_in:
            self.statistics.stale += 1
            return
        self._receive_acknowledge(body[ACKNOWLEDGE], flags_window, now_us, events)
        if version_type == _TYPE_DATA:
            self._receive_data(body, now_us, events)
        elif version_type == _TYPE_STREAM:
            self._receive_stream(body, events)

    def _receive_acknowledge(
        self, acknowledge: int, flags_window: int, now_us: int, events: list[Event]
    ) -> None:
        count = (acknowledge - self._base) & 0xFF
        if count > self._high:
            return  # older than what we know already
        window = flags_window & 0x0F
        reopened = window and not self._peer_window
        self._peer_window = window
        timer = self._data_timer
        queue = self._queue
        if count:
            events += [MessageAcknowledged(queue.popleft()[0]) for _ in range(count)]
            self.statistics.messages_acknowledged += count
            self._base = acknowledge
            self._high -= count
            self._next = max(self._next - count, 0)
            self._went_back = False
            self._timeouts = 0
            timer.stop()
            if self._high:
                timer.start(now_us)
        if (flags_window & _GAP or reopened) and self._high and not self._went_back:
            self._next = 0  # what was in flight behind the gap or the closed window is gone
            self._went_back = True
            timer.start(now_us)
        if not window and queue and timer.deadline_us is None:
            timer.start(now_us)  # the update that opens the window again may be lost: probe

    def _receive_data(self, body: bytes, now_us: int, events: list[Event]) -> None:
        statistics = self.statistics
        ahead = (body[SEQUENCE] - self._expected) & 0xFF
        if ahead:
            self._ack_due = True
            if ahead >= 0x80:
                statistics.duplicates += 1
            else:
                statistics.gaps += 1
                if not self._gap_told:
                    self._gap_told = self._gap_due = True
            return
        if not self._receive_window:
            statistics.refused += 1
            self._ack_due = True
            return
        self._expected = (self._expected + 1) & 0xFF
        self._gap_told = self._gap_due = False
        try:
            message = self._table.decode(body[HEADER_BYTES:], self._peer_role)
        except PayloadError as error:
            # Acknowledged all the same: sent again it would be no better, and block the rest.
            statistics.lost += 1
            self._malformed(ErrorKind.PAYLOAD, str(error), events)
        else:
            statistics.messages_received += 1
            events.append(MessageReceived(message))
        self._unacknowledged += 1
        if 2 * self._unacknowledged >= self.config.window or not self.config.ack_delay_us:
            self._ack_due = True
        elif self._ack_deadline_us is None:
            self._ack_deadline_us = now_us + self.config.ack_delay_us

    def _receive_stream(self, body: bytes, events: list[Event]) -> None:
        try:
            message = self._table.decode(body[HEADER_BYTES:], self._peer_role)
        except PayloadError as error:
            self._malformed(ErrorKind.PAYLOAD, str(error), events)
            return
        self.statistics.stream_received += 1
        events.append(StreamReceived(message))

    # The handshake.

    def _receive_hello(self, body: bytes, now_us: int, events: list[Event]) -> None:
        if len(body) != _HELLO_BYTES:
            self._malformed(ErrorKind.MALFORMED, f"a HELLO of {len(body)} bytes", events)
            return
        epoch, challenge, our_epoch, our_challenge = _HELLO.unpack_from(body, HEADER_BYTES)
        if not epoch:
            self._malformed(ErrorKind.MALFORMED, "a HELLO without an epoch", events)
            return
        alive = our_epoch == self.epoch and our_challenge == self._challenge
        if epoch == self._peer_epoch:
            self._peer_challenge = challenge
            if alive and self._candidate_epoch:
                self._candidate_epoch = 0  # the other was a ghost
                self._hello_timer.stop()
        elif alive:
            self._connect(epoch, challenge, body[FLAGS_WINDOW] & 0x0F, now_us, events)
        else:
            if self._candidate_epoch != epoch:
                self._candidate_epoch = epoch
                if self._peer_epoch:
                    # Echoes of the session that we are in must not pass for answers to this.
                    self._challenge = (self._challenge + 1) & 0xFF
                self._hello_timer.stop()
            self._candidate_challenge = challenge
            self._answer(epoch, challenge)
        if body[FLAGS_WINDOW] & _REPLY:
            self._answer(epoch, challenge)

    def _answer(self, epoch: int, challenge: int) -> None:
        # To whoever asked, not to the candidate: with a ghost on both sides the two live ones
        # would talk past each other for ever.
        self._hello_due = True
        self._hello_to = (epoch, challenge)

    def _connect(
        self, epoch: int, challenge: int, window: int, now_us: int, events: list[Event]
    ) -> None:
        previous = self._peer_epoch
        self._peer_epoch = epoch
        self._peer_challenge = challenge
        self._challenge = (self._challenge + 1) & 0xFF  # a proof of life serves once
        self._candidate_epoch = 0
        self._hello_timer.stop()
        self._hello_due = False
        self._hello_to = None
        self._session_out = (self.epoch & 15) << 4 | epoch & 15
        self._session_in = (epoch & 15) << 4 | self.epoch & 15
        if previous:
            self.statistics.peer_resets += 1
            events.append(PeerReset(epoch, previous, self._high))
        else:
            events.append(LinkUp(epoch))
        self._drop_newest()
        self._base = self._next = self._high = 0
        self._peer_window = window
        self._probe = self._went_back = False
        self._timeouts = 0
        self._data_timer.stop()
        if not window and self._queue:
            self._data_timer.start(now_us)
        self._expected = 0
        self._unacknowledged = 0
        self._ack_due = self._gap_due = self._gap_told = False
        self._ack_deadline_us = None

    # Sending.

    def _sendable(self) -> bool:
        if not self._peer_epoch or self._next >= len(self._queue):
            return False
        window = min(self.config.window, self._peer_window)
        return self._next < window or (self._probe and not self._next)

    def _drop_newest(self) -> None:
        if self._newest:
            self._newest = b""
            self.statistics.replaced += 1

    def _next_frame(self, now_us: int) -> bytes:
        if self._hello_due:
            return self._hello_frame(now_us)
        if self._newest and not (self._stream_last and self._sendable()):
            payload, self._newest = self._newest, b""
            self._stream_last = True
            self.statistics.streamed += 1
            return self._frame(_TYPE_STREAM, payload, self._high)
        self._stream_last = False
        if self._sendable():
            index = self._next
            self._next = index + 1
            self._probe = False
            if index < self._high:
                self.statistics.retransmissions += 1
            else:
                self._high = index + 1
            if self._data_timer.deadline_us is None:
                self._data_timer.start(now_us)
            return self._frame(_TYPE_DATA, self._queue[index][1], index)
        if self._ack_due:
            return self._frame(_TYPE_ACK, b"", self._high)
        return b""

    def _frame(self, version_type: int, payload: bytes, index: int) -> bytes:
        flags = self._own_flag | self._receive_window
        if self._gap_due:
            flags |= _GAP
            self._gap_due = False
        self._ack_due = False
        self._ack_deadline_us = None
        self._unacknowledged = 0
        self.statistics.frames_sent += 1
        header = bytes(
            (
                version_type,
                self._session_out,
                (self._base + index) & 0xFF,
                self._expected,
                flags,
            )
        )
        return seal(header + payload)

    def _hello_frame(self, now_us: int) -> bytes:
        self._hello_due = False
        self.statistics.frames_sent += 1
        waiting = self._candidate_epoch or not self._peer_epoch
        flags = self._own_flag | self._receive_window
        if waiting or self._ask or self._timeouts >= _PROBE_AFTER_TIMEOUTS:
            flags |= _REPLY
        self._ask = False
        if waiting and self._hello_timer.deadline_us is None:
            self._hello_timer.start(now_us)
        peer = self._hello_to
        if peer is None:
            peer = (
                (self._candidate_epoch, self._candidate_challenge)
                if self._candidate_epoch
                else (self._peer_epoch, self._peer_challenge)
            )
        self._hello_to = None
        header = bytes((_TYPE_HELLO, (self.epoch & 15) << 4 | peer[0] & 15, 0, 0, flags))
        return seal(header + _HELLO.pack(self.epoch, self._challenge, *peer))
