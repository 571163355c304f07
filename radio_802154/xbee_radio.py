"""The radio half of an emulated XBee: unslotted CSMA-CA, acknowledgements and retries on the air.

The module's MAC and transceiver in one, at the seam that the CC2420 has, too (`air.py`), without
registers and FIFOs, of which nobody outside sees anything: what frames there are on the air, and
when, is all there is to know. Clauses are those of IEEE Std 802.15.4-2006.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from random import Random
from typing import Final

from firmware_model.scheduler import Event, Scheduler
from firmware_model.time import FS_PER_US
from radio_802154 import mac, timing
from radio_802154.air import OCTET_FS, Air, Reception, Transmission
from radio_802154.errors import RadioError
from radio_802154.fcs import append_fcs, fcs_ok
from radio_802154.filtering import AddressFilter, accepts, header_octets
from radio_802154.xbee import TxResult

SYMBOL_FS: Final = timing.SYMBOL_US * FS_PER_US
BACKOFF_FS: Final = timing.UNIT_BACKOFF_SYMBOLS * SYMBOL_FS
TURNAROUND_FS: Final = timing.TURNAROUND_SYMBOLS * SYMBOL_FS
CCA_FS: Final = timing.CCA_SYMBOLS * SYMBOL_FS
ACK_WAIT_FS: Final = timing.ACK_WAIT_SYMBOLS * SYMBOL_FS
LOCK_ON_FS: Final = 3 * OCTET_FS
"""How long before the SFD's end a receiver must be searching (assumed, as for the CC2420)."""
QUEUE_LIMIT: Final = 5
"""Packets that wait for the air (assumed: the manual gives 202 octets of buffer)."""


class _State(Enum):
    OFF = auto()
    SEARCH = auto()
    RECEIVE = auto()
    TRANSMIT = auto()


@dataclass(frozen=True, slots=True)
class RadioSettings:
    """What the registers say of the air."""

    frequency_mhz: int
    power_dbm: float
    address: AddressFilter
    cca_dbm: float
    min_be: int


@dataclass(slots=True)
class _Packet:
    content: bytes
    sequence: int
    wants_ack: bool
    done: Callable[[TxResult], None]
    attempts: int = 0
    backoffs: int = 0
    exponent: int = 0


class XBeeRadio:
    """Implements `air.Transceiver`.

    Args:
        scheduler, air: the run's; an antenna called `name` has been placed.
        on_frame: hears of each data frame for this module, with its power in dBm.

    """

    def __init__(
        self,
        scheduler: Scheduler,
        air: Air,
        name: str,
        settings: RadioSettings,
        on_frame: Callable[[mac.Frame, float], None],
        seed: int = 0,
    ) -> None:
        self.settings = settings
        self.overruns = 0
        """Packets that found the queue full."""
        self._scheduler = scheduler
        self._air = air
        self._on_frame = on_frame
        self._random = Random(f"{seed}/xbee/{name}")
        self._state = _State.SEARCH
        self._search_from = scheduler.now
        self._queue: deque[_Packet] = deque()
        self._timer: Event | None = None  # back-off, CCA or acknowledgement wait
        self._ack_timer: Event | None = None
        self._awaits: int | None = None
        self._psdu = b""
        self._transmission: Transmission | None = None
        self._incoming: Transmission | None = None
        self._recognised = False
        self._port = air.attach(name, self)

    def switch(self, on: bool) -> None:
        """Take the supply away or give it back; what waits to be sent is forgotten."""
        for timer in (self._timer, self._ack_timer):
            self._scheduler.cancel(timer)
        self._timer = self._ack_timer = self._awaits = self._incoming = None
        self._queue.clear()
        if self._transmission is not None:
            self._air.abort(self._transmission)
            self._transmission = None
        self._state = _State.SEARCH if on else _State.OFF
        self._search_from = self._scheduler.now + TURNAROUND_FS

    # --- sending -----------------------------------------------------------------------------

    def send(self, frame: mac.Frame, done: Callable[[TxResult], None]) -> bool:
        """Queue a frame; False, and nothing queued, where the queue is full or the supply away."""
        if self._state is _State.OFF or len(self._queue) >= QUEUE_LIMIT:
            self.overruns += 1
            return False
        self._queue.append(_Packet(mac.encode(frame), frame.sequence, frame.ack_request, done))
        if len(self._queue) == 1:
            self._begin()
        return True

    def _begin(self) -> None:
        packet = self._queue[0]
        packet.backoffs, packet.exponent = 0, self.settings.min_be
        self._back_off(packet)

    def _back_off(self, packet: _Packet) -> None:
        """7.5.1.4, Figure 69: a random number of back-off periods, then a look at the channel."""
        periods = self._random.randrange(1 << packet.exponent)
        delay_fs = periods * BACKOFF_FS + CCA_FS
        start = max(self._scheduler.now, self._search_from)
        self._timer = self._scheduler.at(start + delay_fs, self._assess)

    def _assess(self) -> None:
        packet, settings = self._queue[0], self.settings
        level = self._air.energy_dbm(self._port, settings.frequency_mhz, CCA_FS)
        if self._free() and level < settings.cca_dbm:
            self._timer = self._scheduler.after(TURNAROUND_FS, self._transmit)
            return
        self._busy(packet)

    def _busy(self, packet: _Packet) -> None:
        packet.backoffs += 1
        packet.exponent = min(packet.exponent + 1, timing.MAX_BE)
        if packet.backoffs > timing.MAX_CSMA_BACKOFFS:
            self._finish(TxResult.CCA_FAILURE)
        else:
            self._back_off(packet)

    def _free(self) -> bool:
        return self._state is _State.SEARCH and self._ack_timer is None

    def _transmit(self) -> None:
        packet = self._queue[0]
        if not self._free():  # a frame began meanwhile
            self._busy(packet)
            return
        packet.attempts += 1
        self._start(packet.content)

    def _start(self, content: bytes) -> None:
        self._psdu = append_fcs(content)
        self._state = _State.TRANSMIT
        settings = self.settings
        self._transmission = self._air.transmit(
            self._port, settings.frequency_mhz, settings.power_dbm, timing.SHR_OCTETS
        )

    def _no_ack(self) -> None:
        if self._state is _State.RECEIVE:  # it may be the one: wait for its end
            incoming = self._incoming
            assert incoming is not None
            self._timer = self._scheduler.at(max(self._scheduler.now, incoming.end_fs) + 1,
                                             self._no_ack)  # fmt: skip
            return
        self._awaits = None
        if self._queue[0].attempts > timing.MAX_FRAME_RETRIES:
            self._finish(TxResult.NO_ACK)
        else:
            self._begin()

    def _finish(self, result: TxResult) -> None:
        packet = self._queue.popleft()
        self._timer = None
        if self._queue:
            self._begin()
        packet.done(result)

    # --- air.Sender --------------------------------------------------------------------------

    def sfd_sent(self, transmission: Transmission) -> int | None:
        """Return the frame's length."""
        return len(self._psdu) if transmission is self._transmission else None

    def psdu(self, octets: int) -> bytes:
        """Return the first octets of what is being sent."""
        return self._psdu[:octets]

    def frame_control(self) -> int | None:
        """Return the frame control field of what is being sent."""
        return self._psdu[0] | self._psdu[1] << 8

    def sent(self, transmission: Transmission) -> None:
        """The last octet has gone out: listen again."""
        if transmission is not self._transmission:
            return
        was_ack = self._psdu[0] & 0b111 == mac.FrameType.ACK
        self._transmission = None
        self._state = _State.SEARCH
        self._search_from = self._scheduler.now + TURNAROUND_FS
        if was_ack:
            return
        packet = self._queue[0]
        if packet.wants_ack:
            self._awaits = packet.sequence
            self._timer = self._scheduler.after(ACK_WAIT_FS, self._no_ack)
        else:
            self._finish(TxResult.SUCCESS)

    # --- air.Receiver ------------------------------------------------------------------------

    def hears(self, transmission: Transmission) -> bool:
        """Whether it has been listening long enough, on the right channel."""
        return (
            self._state is _State.SEARCH
            and self._search_from <= transmission.sfd_fs - LOCK_ON_FS
            and transmission.frequency_mhz == self.settings.frequency_mhz
        )

    def frame_begins(self, transmission: Transmission) -> None:
        """The SFD has been received."""
        self._incoming = transmission
        self._recognised = False
        self._state = _State.RECEIVE

    def frame_length(self, transmission: Transmission) -> None:
        """The length octet has been received."""

    def frame_header(self, transmission: Transmission) -> bool:
        """Address recognition."""
        if self._incoming is not transmission:
            return False
        start = transmission.psdu(2)
        octets = header_octets(start[0] | start[1] << 8)
        header = transmission.psdu(min(octets, transmission.arrived(self._scheduler.now) - 1))
        self._recognised = accepts(self.settings.address, header)
        if not self._recognised:
            self._listen_after(transmission)
        return self._recognised

    def frame_ends(self, transmission: Transmission, reception: Reception) -> None:
        """The last octet has been received: acknowledge, and hand it on."""
        if self._incoming is not transmission:
            return
        self._listen_after(transmission)
        if not self._recognised or not fcs_ok(reception.octets):
            return
        try:
            frame = mac.decode(reception.octets[:-2])
        except RadioError:
            return
        if frame.frame_type is mac.FrameType.ACK:
            if frame.sequence == self._awaits:
                self._awaits = None
                self._scheduler.cancel(self._timer)
                self._finish(TxResult.SUCCESS)
            return
        if frame.frame_type is not mac.FrameType.DATA:
            return
        destination = frame.destination
        if frame.ack_request and destination is not None and not destination.is_broadcast:
            content = mac.encode(mac.ack_frame(frame.sequence))
            self._ack_timer = self._scheduler.after(
                TURNAROUND_FS, lambda: self._acknowledge(content)
            )
        self._on_frame(frame, reception.power_dbm)

    def _acknowledge(self, content: bytes) -> None:
        self._ack_timer = None
        if self._state is _State.TRANSMIT:
            return
        self._incoming = None  # what began meanwhile is lost to us
        self._start(content)

    def _listen_after(self, transmission: Transmission) -> None:
        self._incoming = None
        self._state = _State.SEARCH
        end = transmission.sfd_fs + (1 + transmission.length) * OCTET_FS
        self._search_from = max(self._scheduler.now, end)
