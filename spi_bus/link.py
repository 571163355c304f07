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

`Link` puts frames together and takes them apart; what is in them is decided by its four parts,
`link_sender`, `link_receiver`, `link_stream` and `link_greeting`.
"""

from typing import Final

from spi_bus.errors import PayloadError
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
from spi_bus.link_greeting import HELLO_BYTES, Greeting, Hello
from spi_bus.link_receiver import Receiver
from spi_bus.link_sender import Sender
from spi_bus.link_stream import Stream
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

_TYPE_HELLO: Final = VERSION << 4 | FrameType.HELLO
_TYPE_DATA: Final = VERSION << 4 | FrameType.DATA
_TYPE_ACK: Final = VERSION << 4 | FrameType.ACK
_TYPE_STREAM: Final = VERSION << 4 | FrameType.STREAM
_FROM_SLAVE: Final = int(Flag.FROM_SLAVE)  # plain ints: IntFlag arithmetic costs a microsecond
_GAP: Final = int(Flag.GAP)
_REPLY: Final = int(Flag.REPLY)


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
        self._sender = Sender(config, self.statistics)
        self._receiver = Receiver(config, self.statistics)
        self._stream = Stream(self.statistics)
        self._greeting = Greeting(epoch, config)
        self._session_out = 0
        self._session_in = 0

    # What the application sees.

    @property
    def connected(self) -> bool:
        """Whether a peer has proved to be there since this link began."""
        return self._greeting.peer_epoch != 0

    @property
    def peer_epoch(self) -> int:
        """The peer's epoch, 0 before the first contact."""
        return self._greeting.peer_epoch

    @property
    def queued(self) -> int:
        """Messages not acknowledged yet, sent or not."""
        return len(self._sender)

    @property
    def error_counts(self) -> dict[ErrorKind, int]:
        """Pieces of the received stream thrown away, by kind."""
        return dict(self._errors)

    @property
    def receive_window(self) -> int:
        """Messages that the application takes at present."""
        return self._receiver.window

    @receive_window.setter
    def receive_window(self, messages: int) -> None:
        if not 0 <= messages <= MAX_WINDOW:
            raise ValueError(f"receive_window = {messages} is outside 0 to {MAX_WINDOW}")
        receiver = self._receiver
        if messages > receiver.window and receiver.window == 0:
            receiver.due = self.connected  # the peer waits for this
        receiver.window = messages

    def send(self, message: object) -> int:
        """Queue a message; the token comes back in its `MessageAcknowledged`.

        Raises:
            LinkFull: nothing was queued.
            FieldError: a value does not fit.
            UnknownMessageError: this side sends no such message.

        """
        self._sender.check_room()
        return self._sender.push(self._table.encode(message, self.role), self._now_us)

    def send_newest(self, message: object) -> bool:
        """Hand over the newest message of this side's stream; return whether there is a peer.

        It goes with the next frame, once. One that still waited is dropped for it; without a peer
        nothing is kept.

        Raises:
            FieldError: a value does not fit.
            UnknownMessageError: this side sends no such message.

        """
        payload = self._table.encode(message, self.role)
        if self.connected:
            self._stream.put(payload)
        return self.connected

    # What the transport sees.

    @property
    def wants_to_send(self) -> bool:
        """Whether `data_to_send` has something now: the state of a data-ready line."""
        return (
            bool(self._outgoing or self._stream.newest)
            or self._greeting.due
            or self._receiver.due
            or (self._greeting.peer_epoch != 0 and self._sender.sendable)
        )

    def next_deadline_us(self) -> int | None:
        """Return when `handle_timer` wants to be called; None while nothing is waited for."""
        deadline = self._sender.timer.deadline_us
        for other in (self._greeting.timer.deadline_us, self._receiver.deadline_us):
            if other is not None and (deadline is None or other < deadline):
                deadline = other
        return deadline

    def handle_timer(self, now_us: int) -> None:
        """Do what is due: acknowledge, retransmit, greet. Early or late calls do no harm."""
        self._now_us = now_us
        self._receiver.expire(now_us)
        if self._sender.expire(now_us) and self._sender.silent_peer:
            self._greeting.due = True
        self._greeting.expire(now_us)

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
        if acknowledge and self._receiver.unacknowledged:
            self._receiver.due = True
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
        self._stream.drop()
        self._greeting.resume()
        if self.connected:
            self._receiver.resume()
            self._sender.resume(now_us)

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
        if not self._greeting.peer_epoch or body[SESSION] != self._session_in:
            self.statistics.stale += 1
            return
        tokens = self._sender.acknowledge(
            body[ACKNOWLEDGE], flags_window & 0x0F, now_us, gap=bool(flags_window & _GAP)
        )
        events += map(MessageAcknowledged, tokens)
        if version_type == _TYPE_DATA and self._receiver.take(body[SEQUENCE]):
            self._deliver(body[HEADER_BYTES:], events)
            self._receiver.taken(now_us)
        elif version_type == _TYPE_STREAM:
            self._deliver_stream(body[HEADER_BYTES:], events)

    def _deliver(self, payload: bytes, events: list[Event]) -> None:
        try:
            message = self._table.decode(payload, self._peer_role)
        except PayloadError as error:
            # Acknowledged all the same: sent again it would be no better, and block the rest.
            self.statistics.lost += 1
            self._malformed(ErrorKind.PAYLOAD, str(error), events)
        else:
            self.statistics.messages_received += 1
            events.append(MessageReceived(message))

    def _deliver_stream(self, payload: bytes, events: list[Event]) -> None:
        try:
            message = self._table.decode(payload, self._peer_role)
        except PayloadError as error:
            self._malformed(ErrorKind.PAYLOAD, str(error), events)
        else:
            self.statistics.stream_received += 1
            events.append(StreamReceived(message))

    def _receive_hello(self, body: bytes, now_us: int, events: list[Event]) -> None:
        if len(body) != HEADER_BYTES + HELLO_BYTES:
            self._malformed(ErrorKind.MALFORMED, f"a HELLO of {len(body)} bytes", events)
            return
        hello = Hello.decode(body[HEADER_BYTES:])
        if not hello.epoch:
            self._malformed(ErrorKind.MALFORMED, "a HELLO without an epoch", events)
            return
        previous = self._greeting.peer_epoch
        if self._greeting.heard(hello, reply=bool(body[FLAGS_WINDOW] & _REPLY)):
            self._connect(hello.epoch, previous, body[FLAGS_WINDOW] & 0x0F, now_us, events)

    def _connect(
        self, epoch: int, previous: int, window: int, now_us: int, events: list[Event]
    ) -> None:
        self._session_out = (self.epoch & 15) << 4 | epoch & 15
        self._session_in = (epoch & 15) << 4 | self.epoch & 15
        if previous:
            self.statistics.peer_resets += 1
            events.append(PeerReset(epoch, previous, self._sender.high))
        else:
            events.append(LinkUp(epoch))
        self._stream.drop()
        self._sender.restart(window, now_us)
        self._receiver.restart()

    # Sending.

    def _next_frame(self, now_us: int) -> bytes:
        if self._greeting.due:
            return self._hello_frame(now_us)
        sender = self._sender
        sendable = self._greeting.peer_epoch != 0 and sender.sendable
        newest = self._stream.take(sendable=sendable)
        if newest:
            return self._frame(_TYPE_STREAM, newest, sender.high)
        if sendable:
            index, payload = sender.take(now_us)
            return self._frame(_TYPE_DATA, payload, index)
        if self._receiver.due:
            return self._frame(_TYPE_ACK, b"", sender.high)
        return b""

    def _frame(self, version_type: int, payload: bytes, index: int) -> bytes:
        receiver = self._receiver
        flags = self._own_flag | receiver.window
        if receiver.tell():
            flags |= _GAP
        self.statistics.frames_sent += 1
        header = bytes(
            (
                version_type,
                self._session_out,
                (self._sender.base + index) & 0xFF,
                receiver.expected,
                flags,
            )
        )
        return seal(header + payload)

    def _hello_frame(self, now_us: int) -> bytes:
        self.statistics.frames_sent += 1
        hello, reply = self._greeting.say(now_us, doubt=self._sender.silent_peer)
        flags = self._own_flag | self._receiver.window | (_REPLY if reply else 0)
        session = (self.epoch & 15) << 4 | hello.peer_epoch & 15
        return seal(bytes((_TYPE_HELLO, session, 0, 0, flags)) + hello.encode())
