"""The handshake of a link: who the peer is, proved by repeating what only a listener can know.

Every boot has an epoch. A HELLO says the sender's epoch and challenge, and those that it knows of
its peer. Who repeats our own current ones has heard us just now: only then is a newcomer believed,
so that a HELLO of an earlier boot, held back somewhere, cannot tear a live session down. Until then
the newcomer is a candidate, and the session that there is goes on.
"""

import struct
from dataclasses import dataclass
from typing import Final

from spi_bus.link_types import LinkConfig, Timer

__all__ = ["HELLO_BYTES", "Greeting", "Hello"]

_HELLO: Final = struct.Struct("<HBHB")
HELLO_BYTES: Final = _HELLO.size


@dataclass(frozen=True, slots=True)
class Hello:
    """What a HELLO carries; `peer_epoch` 0: none known."""

    epoch: int
    challenge: int
    peer_epoch: int
    peer_challenge: int

    def encode(self) -> bytes:
        """Return the payload."""
        return _HELLO.pack(self.epoch, self.challenge, self.peer_epoch, self.peer_challenge)

    @classmethod
    def decode(cls, payload: bytes) -> "Hello":
        """Return what `HELLO_BYTES` of payload say."""
        return cls(*_HELLO.unpack(payload))


class Greeting:
    """What is known of the peer, and whether a HELLO is to be sent.

    Args:
        epoch: our own.
        config: the times.

    """

    __slots__ = (
        "_candidate_challenge", "_candidate_epoch", "_challenge", "_epoch", "_peer_challenge",
        "_to", "ask", "due", "peer_epoch", "timer",
    )  # fmt: skip

    def __init__(self, epoch: int, config: LinkConfig) -> None:
        self._epoch = epoch
        self.peer_epoch = 0  # 0: not connected
        self._peer_challenge = 0
        self._candidate_epoch = 0
        self._candidate_challenge = 0
        self._challenge = 0
        self.due = True
        self._to: tuple[int, int] | None = None
        self.ask = False  # the next HELLO wants a reply, once: two that always asked never ended
        self.timer = Timer(config.retransmit_us, config.retransmit_max_us)

    def heard(self, hello: Hello, *, reply: bool) -> bool:
        """Take a HELLO; return whether it begins a session, which the caller does by `connect`.

        Args:
            hello: with an epoch that is not 0.
            reply: the sender wants one.

        """
        epoch, challenge = hello.epoch, hello.challenge
        alive = hello.peer_epoch == self._epoch and hello.peer_challenge == self._challenge
        begins = False
        if epoch == self.peer_epoch:
            self._peer_challenge = challenge
            if alive and self._candidate_epoch:
                self._candidate_epoch = 0  # the other was a ghost
                self.timer.stop()
        elif alive:
            begins = True
            self._connect(epoch, challenge)
        else:
            if self._candidate_epoch != epoch:
                self._candidate_epoch = epoch
                if self.peer_epoch:
                    # Echoes of the session that we are in must not pass for answers to this.
                    self._challenge = (self._challenge + 1) & 0xFF
                self.timer.stop()
            self._candidate_challenge = challenge
            self._answer(epoch, challenge)
        if reply:
            self._answer(epoch, challenge)
        return begins

    def _answer(self, epoch: int, challenge: int) -> None:
        # To whoever asked, not to the candidate: with a ghost on both sides the two live ones
        # would talk past each other for ever.
        self.due = True
        self._to = (epoch, challenge)

    def _connect(self, epoch: int, challenge: int) -> None:
        self.peer_epoch = epoch
        self._peer_challenge = challenge
        self._challenge = (self._challenge + 1) & 0xFF  # a proof of life serves once
        self._candidate_epoch = 0
        self.timer.stop()
        self.due = False
        self._to = None

    def say(self, now_us: int, *, doubt: bool) -> tuple[Hello, bool]:
        """Return the HELLO to send now, and whether it wants a reply.

        Args:
            now_us: the time.
            doubt: the peer has been silent: ask whether it is who it was.

        """
        self.due = False
        waiting = bool(self._candidate_epoch) or not self.peer_epoch
        reply = waiting or self.ask or doubt
        self.ask = False
        if waiting and self.timer.deadline_us is None:
            self.timer.start(now_us)
        peer = self._to
        if peer is None:
            peer = (
                (self._candidate_epoch, self._candidate_challenge)
                if self._candidate_epoch
                else (self.peer_epoch, self._peer_challenge)
            )
        self._to = None
        return Hello(self._epoch, self._challenge, *peer), reply

    def expire(self, now_us: int) -> None:
        """Greet again if the time is out."""
        timer = self.timer
        if timer.deadline_us is not None and now_us >= timer.deadline_us:
            timer.back_off(now_us)
            self.due = True

    def resume(self) -> None:
        """The line was opened again: greet at once, and ask a peer that we had."""
        self.due = True
        self.timer.stop()
        if self.peer_epoch:
            self.ask = True
