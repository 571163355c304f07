"""A radio in the emulated air for nodes that are not: it hears all, answers for them, and speaks.

A chip with one address would not do: the gateway stands for any number of nodes. So this is the
radio and its MAC in one, a `Transceiver` of the medium with the standard's times: unslotted CSMA-CA
(802.15.4-2006, 7.5.1.4), acknowledgements twelve symbols after a frame (7.5.6.4.2), up to three
retries (7.5.6.4.3). It is half-duplex, and where two speak at once it hears what any radio would.
It never hears itself. Whether a frame is answered is for whoever listens to say, at its end.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from random import Random
from typing import Final

from firmware_model.scheduler import Event, Scheduler
from firmware_model.time import FS_PER_US
from radio_802154 import mac, timing
from radio_802154.air import OCTET_FS, Air, Reception, Transmission
from radio_802154.fcs import append_fcs, fcs_ok, strip_fcs
from radio_802154.timing import SYMBOL_US

CCA_THRESHOLD_DBM: Final = -77.0
"""Energy above which the channel is busy: the CC2420's after reset (SWRS041B, section 25)."""
POWER_DBM: Final = 0.0
"""The CC2420's highest (SWRS041B, section 28)."""
LOCK_ON_FS: Final = 3 * OCTET_FS
"""SFD and two octets of preamble have to be heard to find a frame (assumed, as for the CC2420)."""

_SYMBOL_FS: Final = SYMBOL_US * FS_PER_US
_TURNAROUND_FS: Final = timing.TURNAROUND_SYMBOLS * _SYMBOL_FS
_BACKOFF_FS: Final = timing.UNIT_BACKOFF_SYMBOLS * _SYMBOL_FS
_ACK_WAIT_FS: Final = timing.ACK_WAIT_SYMBOLS * _SYMBOL_FS
_CCA_FS: Final = timing.CCA_SYMBOLS * _SYMBOL_FS


class Outcome(Enum):
    """What became of a frame."""

    SENT = "sent"
    """It asked for no acknowledgement."""
    ACKNOWLEDGED = "acknowledged"
    NOT_ACKNOWLEDGED = "not acknowledged"
    CHANNEL_BUSY = "channel busy"


class _State(Enum):
    SEARCH = 0
    RECEIVE = 1
    TURNAROUND = 2
    TRANSMIT = 3


Done = Callable[[Outcome], None]


@dataclass(slots=True)
class _Outgoing:
    octets: bytes  # MAC header and payload
    done: Done


class Gateway:
    """Transceiver and MAC of the nodes that are not emulated, at one antenna.

    Args:
        scheduler: the run's time.
        air: the medium, in which an antenna called `name` has been placed.
        name: the antenna's.
        channel: 11 to 26.
        heard: called at the end of each frame with a right FCS, acknowledgements apart, with its
            MAC header and payload; returns whether to acknowledge it.
        seed: of its back-offs.

    """

    def __init__(
        self,
        scheduler: Scheduler,
        air: Air,
        name: str,
        channel: int,
        heard: Callable[[bytes], bool],
        seed: int = 0,
        queue_limit: int = 32,
    ) -> None:
        self.queue_limit = queue_limit
        self.damaged = 0
        """Frames heard with a wrong FCS."""
        self.retries = 0
        self._scheduler = scheduler
        self._air = air
        self._heard = heard
        self._frequency_mhz = timing.channel_frequency_mhz(channel)
        self._random = Random(f"{seed}/{name}/gateway")
        self._state = _State.SEARCH
        self._search_from_fs = scheduler.now
        self._incoming: Transmission | None = None
        self._psdu = b""
        self._is_ack = False
        self._queue: deque[_Outgoing] = deque()
        self._attempts = 0
        self._backoffs = 0
        self._quiet_until_fs = 0
        self._waiting: Event | None = None  # for an acknowledgement
        self._port = air.attach(name, self)

    # --- sending --------------------------------------------------------------------------------

    @property
    def room(self) -> int:
        """Frames that `send` still takes."""
        return self.queue_limit - len(self._queue)

    def send(self, octets: bytes, done: Done) -> bool:
        """Queue a frame without its FCS; False, and nothing queued, where the queue is full."""
        if not self.room:
            return False
        self._queue.append(_Outgoing(octets, done))
        if len(self._queue) == 1:
            self._attempts = 0
            self._contend()
        return True

    def _contend(self) -> None:
        """Begin CSMA-CA for the frame at the head of the queue."""
        self._backoffs = 0
        self._back_off(timing.MIN_BE)

    def _back_off(self, exponent: int) -> None:
        delay_fs = self._random.randrange(1 << exponent) * _BACKOFF_FS
        start_fs = max(self._scheduler.now, self._quiet_until_fs)
        self._scheduler.at(start_fs + delay_fs, lambda: self._assess(exponent))

    def _assess(self, exponent: int) -> None:
        """Look whether the channel is clear (CCA mode 3: neither energy nor a frame)."""
        if self._state is _State.SEARCH and (
            self._air.energy_dbm(self._port, self._frequency_mhz, _CCA_FS) < CCA_THRESHOLD_DBM
        ):
            self._turn(append_fcs(self._queue[0].octets), is_ack=False)
            return
        self._backoffs += 1
        if self._backoffs > timing.MAX_CSMA_BACKOFFS:
            self._finish(Outcome.CHANNEL_BUSY)
        else:
            self._back_off(min(exponent + 1, timing.MAX_BE))

    def _turn(self, psdu: bytes, *, is_ack: bool) -> None:
        self._state = _State.TURNAROUND
        self._psdu, self._is_ack = psdu, is_ack
        self._scheduler.after(_TURNAROUND_FS, self._transmit)

    def _transmit(self) -> None:
        self._state = _State.TRANSMIT
        self._air.transmit(self._port, self._frequency_mhz, POWER_DBM, timing.SHR_OCTETS)

    def _acknowledgement_missing(self) -> None:
        self._waiting = None
        self._attempts += 1
        if self._attempts > timing.MAX_FRAME_RETRIES:
            self._finish(Outcome.NOT_ACKNOWLEDGED)
        else:
            self.retries += 1
            self._contend()

    def _finish(self, outcome: Outcome) -> None:
        frame = self._queue.popleft()
        space = timing.interframe_space_symbols(len(frame.octets) + 2) * _SYMBOL_FS
        self._quiet_until_fs = self._scheduler.now + space
        self._attempts = 0
        if self._queue:
            self._contend()
        frame.done(outcome)

    # --- `air.Sender` ---------------------------------------------------------------------------

    def sfd_sent(self, transmission: Transmission) -> int | None:
        """The SFD has gone out: return the frame length."""
        del transmission
        return len(self._psdu)

    def psdu(self, octets: int) -> bytes:
        """Return the first octets of the PSDU that is being sent."""
        return self._psdu[:octets]

    def frame_control(self) -> int | None:
        """Return the frame control field about to be sent."""
        return int.from_bytes(self._psdu[:2], "little")

    def sent(self, transmission: Transmission) -> None:
        """The last octet has gone out."""
        del transmission
        self._search()
        if self._is_ack:
            return
        if mac.FrameControl.parse(int.from_bytes(self._psdu[:2], "little")).ack_request:
            self._waiting = self._scheduler.after(_ACK_WAIT_FS, self._acknowledgement_missing)
        else:
            self._finish(Outcome.SENT)

    def _search(self) -> None:
        self._state = _State.SEARCH
        self._search_from_fs = self._scheduler.now

    # --- `air.Receiver` -------------------------------------------------------------------------

    def hears(self, transmission: Transmission) -> bool:
        """Whether it has been searching long enough, on this frequency."""
        return (
            self._state is _State.SEARCH
            and self._search_from_fs <= transmission.sfd_fs - LOCK_ON_FS
            and transmission.frequency_mhz == self._frequency_mhz
        )

    def frame_begins(self, transmission: Transmission) -> None:
        """The SFD has been received."""
        self._state = _State.RECEIVE
        self._incoming = transmission

    def frame_length(self, transmission: Transmission) -> None:
        """The length octet has been received."""

    def frame_header(self, transmission: Transmission) -> bool:
        """The MAC header has been received: every frame is of interest."""
        return self._incoming is transmission

    def frame_ends(self, transmission: Transmission, reception: Reception) -> None:
        """The last octet has been received: answer it where the listener says so."""
        if self._incoming is not transmission:
            return
        self._incoming = None
        self._search()
        octets = reception.octets
        if not fcs_ok(octets):
            self.damaged += 1
            return
        content = strip_fcs(octets)
        if content[0] & 0b111 == mac.FrameType.ACK:
            # of a frame of ours, if its number is and we wait for one (7.5.6.4.3)
            if self._waiting is not None and content[2:] == self._queue[0].octets[2:3]:
                self._scheduler.cancel(self._waiting)
                self._waiting = None
                self._finish(Outcome.ACKNOWLEDGED)
        elif self._heard(content):
            self._turn(append_fcs(mac.encode(mac.ack_frame(content[2]))), is_ack=True)
