"""The air between radios: who hears what, how strongly, and what is left of it.

A frame costs a handful of events whatever the number of listeners: start, SFD, length octet, MAC
header, end. At each of them the medium walks over the ports concerned. Powers are looked up when
somebody needs them; positions are sampled at most once in `position_period_s`, and the loss of a
pair of ports is computed again only when one of them has moved. Energy for CCA and RSSI is
integrated backwards over its window when a chip looks.

Chance is one generator a listener, seeded by the run's seed and the listener's name, so what one
radio hears does not depend on how many others there are elsewhere, or on their order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from random import Random
from typing import Final

from firmware_model.scheduler import Event, Scheduler
from firmware_model.signals import Quantity, constant
from firmware_model.time import FS_PER_US, from_seconds
from firmware_model.trace import Channel
from radio_802154 import propagation
from radio_802154.air import OCTET_FS, Reception, Transceiver, Transmission
from radio_802154.errors import RadioError
from radio_802154.filtering import header_octets
from radio_802154.propagation import Propagation, packet_error_rate, to_dbm, to_mw
from radio_802154.timing import FIRST_CHANNEL, LAST_CHANNEL, channel_frequency_mhz

SYNC_BITS: Final = 16
"""Bits that must come through for a receiver to lock: last preamble octet and SFD (assumed)."""

CERTAIN: Final = 1e-9
"""Error probabilities below this are taken as zero, above its complement as one: no draw."""

HISTORY_FS: Final = 6_000 * FS_PER_US
"""How long an ended transmission is kept: longest PPDU (4256 µs) and the energy window."""

_FS_PER_BIT: Final = 4 * FS_PER_US  # 250 kbit/s

CHANNELS: Final = {
    channel_frequency_mhz(channel): channel for channel in range(FIRST_CHANNEL, LAST_CHANNEL + 1)
}
"""Channel number by centre frequency in MHz."""


class MediumError(RadioError, ValueError):
    """The medium was put together in a way that cannot be."""


@dataclass(frozen=True, slots=True)
class Antenna:
    """Where an antenna is: quantities over time, metres.

    `depth_m` is below the surface; zero and less is in the air. `height_m` is that of an antenna
    in the air above the surface, for the distance between a base station and a swimming robot.
    """

    x_m: Quantity = field(default_factory=lambda: constant(0.0))
    y_m: Quantity = field(default_factory=lambda: constant(0.0))
    depth_m: Quantity = field(default_factory=lambda: constant(0.0))
    height_m: float = 0.0
    gain_db: float = 0.0


@dataclass(frozen=True, slots=True)
class MediumConfig:
    """What the air does to frames.

    Attributes:
        propagation: path loss.
        loss_probability: of a frame being missed altogether, on every link, on top of noise and
            collisions (people, waves over the antenna, other users of the band).
        link_loss: the same for single links, (source, listener) by name; overrides the former.
        position_period_s: how old a position may be. A robot at 0.1 m/s moves 1 cm in 0.1 s:
            0.1 dB at 1 m.

    """

    propagation: Propagation = field(default_factory=Propagation)
    loss_probability: float = 0.0
    link_loss: Mapping[tuple[str, str], float] = field(default_factory=dict)
    position_period_s: float = 0.1

    def __post_init__(self) -> None:
        for loss in (self.loss_probability, *self.link_loss.values()):
            if not 0.0 <= loss <= 1.0:
                raise MediumError(f"loss probability {loss}: allowed are 0 to 1")


class Port:
    """One antenna and the transceiver behind it, with counts of what became of frames."""

    __slots__ = (
        "antenna",
        "damaged",
        "index",
        "lost",
        "missed",
        "moved",
        "name",
        "place",
        "random",
        "received",
        "sampled_fs",
        "sent",
        "transceiver",
    )  # fmt: skip

    def __init__(self, index: int, name: str, antenna: Antenna, seed: int) -> None:
        self.index = index
        self.name = name
        self.antenna = antenna
        self.transceiver: Transceiver | None = None
        self.random = Random(f"{seed}/{name}")
        self.sampled_fs = -1
        self.moved = 0  # counts positions, so that cached losses know their age
        self.place = (0.0, 0.0, 0.0)
        self.sent = 0  # frames sent to the end
        self.received = 0  # frames heard to the end, undamaged
        self.damaged = 0  # frames heard to the end with bit errors
        self.lost = 0  # frames missed by `loss_probability`
        self.missed = 0  # frames too weak or too disturbed for their SFD to be found


class Medium:
    """Connects transceivers; implements `air.Air`."""

    def __init__(
        self,
        scheduler: Scheduler,
        config: MediumConfig | None = None,
        *,
        seed: int = 0,
        channel: Channel | None = None,
    ) -> None:
        self._scheduler = scheduler
        self.config = config or MediumConfig()
        self._seed = seed
        self._channel = channel
        self.ports: list[Port] = []
        self._by_name: dict[str, Port] = {}
        self._on_air: list[Transmission] = []
        self._sfd_events: dict[int, Event] = {}
        self._gains: dict[tuple[int, int], tuple[int, int, float]] = {}
        self._shadows: dict[tuple[str, str], float] = {}
        self._noise_mw = to_mw(propagation.effective_noise_dbm())
        self._period_fs = from_seconds(self.config.position_period_s)
        self.on_begin: Callable[[Transmission], None] | None = None
        """Called at every SFD with the transmission and who found it (`listeners`), for tallies."""

    # --- Wiring ----------------------------------------------------------------------------------

    def place(self, name: str, antenna: Antenna) -> Port:
        """Put an antenna of a new name into the world."""
        if name in self._by_name:
            raise MediumError(f"there is already an antenna called {name!r}")
        port = Port(len(self.ports), name, antenna, self._seed)
        self.ports.append(port)
        self._by_name[name] = port
        return port

    def attach(self, name: str, transceiver: Transceiver) -> int:
        """Connect a transceiver to the antenna of that name; return its port's index."""
        port = self._by_name.get(name)
        if port is None:
            raise MediumError(f"there is no antenna called {name!r}: place it first")
        if port.transceiver is not None:
            raise MediumError(f"antenna {name!r} has its transceiver already")
        port.transceiver = transceiver
        return port.index

    def port(self, name: str) -> Port:
        """Return the port of that name."""
        return self._by_name[name]

    # --- Power -----------------------------------------------------------------------------------

    def _sample(self, port: Port) -> None:
        now = self._scheduler.now
        if port.sampled_fs < 0 or now - port.sampled_fs >= self._period_fs:
            port.sampled_fs = now
            antenna = port.antenna
            place = (antenna.x_m(now), antenna.y_m(now), antenna.depth_m(now))
            if place != port.place or port.moved == 0:
                port.place = place
                port.moved += 1

    def link_gain_db(self, source: Port, listener: Port) -> float:
        """Return the gain from connector to connector (negative) at the last sampled positions."""
        self._sample(source)
        self._sample(listener)
        a, b = (source, listener) if source.index < listener.index else (listener, source)
        key = (a.index, b.index)
        cached = self._gains.get(key)
        if cached is not None and cached[0] == a.moved and cached[1] == b.moved:
            return cached[2]
        model = self.config.propagation
        distance = math.hypot(
            a.place[0] - b.place[0],
            a.place[1] - b.place[1],
            a.antenna.height_m - b.antenna.height_m,
        )
        loss = model.air_loss_db(distance)
        loss += model.submersion_loss_db(a.place[2]) + model.submersion_loss_db(b.place[2])
        gain = a.antenna.gain_db + b.antenna.gain_db - loss - self._shadow(a, b)
        self._gains[key] = (a.moved, b.moved, gain)
        return gain

    def _shadow(self, a: Port, b: Port) -> float:
        sigma = self.config.propagation.shadowing_sd_db
        if sigma == 0.0:
            return 0.0
        names = (a.name, b.name) if a.name < b.name else (b.name, a.name)
        if names not in self._shadows:
            self._shadows[names] = Random(f"{self._seed}/{names[0]}/{names[1]}").gauss(0.0, sigma)
        return self._shadows[names]

    def _power_mw(self, transmission: Transmission, index: int) -> float:
        power = transmission.received_mw.get(index)
        if power is None:
            gain = self.link_gain_db(self.ports[transmission.source], self.ports[index])
            power = transmission.received_mw[index] = to_mw(transmission.power_dbm + gain)
        return power

    def energy_dbm(self, port: int, frequency_mhz: int, window_fs: int) -> float:
        """Return the mean in-band power at a port over the window that ends now [dBm]."""
        now = self._scheduler.now
        begin = now - window_fs
        total = self._noise_mw
        for other in self._on_air:
            overlap = min(now, other.end_fs) - max(begin, other.start_fs)
            if overlap > 0 and other.source != port:
                in_band = propagation.selectivity(other.frequency_mhz - frequency_mhz)
                total += self._power_mw(other, port) * in_band * (overlap / window_fs)
        return to_dbm(total)

    def _disturbance_mw(self, wanted: Transmission, index: int, at_fs: int) -> float:
        """Return noise and weighted interference at a port at one moment."""
        total = self._noise_mw
        for other in self._on_air:
            if other is not wanted and other.start_fs <= at_fs < other.end_fs:
                weight = propagation.interference_weight(other.frequency_mhz - wanted.frequency_mhz)
                total += self._power_mw(other, index) * weight
        return total

    # --- A frame's life --------------------------------------------------------------------------

    def transmit(
        self, port: int, frequency_mhz: int, power_dbm: float, shr_octets: int
    ) -> Transmission:
        """Begin the preamble now; `shr_octets` later the SFD is out."""
        now = self._scheduler.now
        sender = self.ports[port].transceiver
        if sender is None:
            raise MediumError(f"nothing is attached to antenna {self.ports[port].name!r}")
        if self._on_air and self._on_air[0].end_fs < now - HISTORY_FS:
            self._on_air = [t for t in self._on_air if t.end_fs >= now - HISTORY_FS]
        sfd = now + shr_octets * OCTET_FS
        transmission = Transmission(port, sender, frequency_mhz, power_dbm, now, sfd, sfd)
        self._on_air.append(transmission)
        event = self._scheduler.at(sfd, lambda: self._sfd(transmission))
        self._sfd_events[id(transmission)] = event
        return transmission

    def abort(self, transmission: Transmission) -> None:
        """Break a transmission off now: no more energy; listeners demodulate noise to its end."""
        now = self._scheduler.now
        if transmission.aborted or (transmission.length >= 0 and now >= transmission.end_fs):
            return
        transmission.aborted = True
        transmission.end_fs = now
        if transmission.length < 0:
            self._scheduler.cancel(self._sfd_events.pop(id(transmission), None))
        else:
            sent = max(0, (now - transmission.sfd_fs) // OCTET_FS - 1)
            silence = bytes(transmission.length - sent)
            transmission.content = transmission.sender.psdu(sent) + silence

    def _sfd(self, transmission: Transmission) -> None:
        del self._sfd_events[id(transmission)]
        length = transmission.sender.sfd_sent(transmission)
        if length is None:
            self.abort(transmission)
            return
        sfd = transmission.sfd_fs
        transmission.length = length
        transmission.end_fs = end = sfd + (1 + length) * OCTET_FS
        # Synchronisation is judged for every port before any hears of it.
        for port in self.ports:
            listener = port.transceiver
            if (
                listener is not None
                and port.index != transmission.source
                and listener.hears(transmission)
                and self._synchronises(transmission, port)
            ):
                transmission.listeners.append(port.index)
        if self.on_begin is not None:
            self.on_begin(transmission)
        at = self._scheduler.at
        if transmission.listeners:
            for index in transmission.listeners:
                self._transceiver(index).frame_begins(transmission)
            at(sfd + OCTET_FS, lambda: self._length(transmission))
            control = transmission.sender.frame_control()
            # a header not yet written by the sender's host: looked at when the longest has passed
            header = 1 + (23 if control is None else header_octets(control))
            if header <= 1 + length:
                at(sfd + header * OCTET_FS, lambda: self._header(transmission))
        at(end, lambda: self._end(transmission))

    def _transceiver(self, index: int) -> Transceiver:
        transceiver = self.ports[index].transceiver
        assert transceiver is not None  # a listener has one
        return transceiver

    def _synchronises(self, transmission: Transmission, port: Port) -> bool:
        power = self._power_mw(transmission, port.index)
        noise = self._disturbance_mw(transmission, port.index, transmission.sfd_fs - 1)
        failure = packet_error_rate(power / noise, SYNC_BITS) if power < 10.0 * noise else 0.0
        if failure > CERTAIN and (failure > 1.0 - CERTAIN or port.random.random() < failure):
            port.missed += 1
            return False
        config = self.config
        loss = config.loss_probability
        if config.link_loss:
            loss = config.link_loss.get((self.ports[transmission.source].name, port.name), loss)
        if loss > 0.0 and port.random.random() < loss:
            port.lost += 1
            return False
        return True

    def _length(self, transmission: Transmission) -> None:
        for index in transmission.listeners:
            self._transceiver(index).frame_length(transmission)

    def _header(self, transmission: Transmission) -> None:
        transmission.listeners = [
            index
            for index in transmission.listeners
            if self._transceiver(index).frame_header(transmission)
        ]

    def _end(self, transmission: Transmission) -> None:
        if not transmission.aborted:
            transmission.content = transmission.sender.psdu(transmission.length)
            source = self.ports[transmission.source]
            source.sent += 1
            if self._channel is not None:
                self._channel.record(
                    transmission.end_fs,
                    (
                        transmission.start_fs,
                        CHANNELS.get(transmission.frequency_mhz, 0),
                        source.name,
                        transmission.power_dbm,
                        transmission.content,
                    ),
                )
        for index in transmission.listeners:
            self._transceiver(index).frame_ends(transmission, self._receive(transmission, index))
        if not transmission.aborted:
            transmission.sender.sent(transmission)

    # --- What is left of it ----------------------------------------------------------------------

    def _receive(self, transmission: Transmission, index: int) -> Reception:
        port = self.ports[index]
        power = self._power_mw(transmission, index)
        begin = transmission.sfd_fs
        end = begin + (1 + transmission.length) * OCTET_FS
        pieces = self._pieces(transmission, index, begin, end)
        log_success = 0.0
        worst = math.inf
        rates = []
        for first, last, noise in pieces:
            sinr = power / noise if first < transmission.end_fs else 0.0
            worst = min(worst, sinr)
            rate = propagation.bit_error_rate(sinr) if sinr < 10.0 else 0.0
            rates.append((last, rate))
            if rate:
                log_success += (last - first) / _FS_PER_BIT * math.log1p(-rate)
        octets = transmission.psdu(transmission.length)
        failure = -math.expm1(log_success)
        if failure > CERTAIN and port.random.random() < failure:
            octets = _damage(octets, begin + OCTET_FS, rates, port.random)
            port.damaged += 1
        elif transmission.aborted:
            port.damaged += 1
        else:
            port.received += 1
        sinr_db = to_dbm(worst) if worst > 0.0 else -math.inf
        return Reception(octets, to_dbm(power), sinr_db)

    def _pieces(
        self, wanted: Transmission, index: int, begin: int, end: int
    ) -> list[tuple[int, int, float]]:
        """Cut a frame where interference begins or ends: (from, to, noise in mW)."""
        others = [
            other
            for other in self._on_air
            if other is not wanted and other.start_fs < end and other.end_fs > begin
        ]
        if not others and not wanted.aborted:
            return [(begin, end, self._noise_mw)]
        cuts = {begin, end}
        for other in (wanted, *others):
            cuts.update(cut for cut in (other.start_fs, other.end_fs) if begin < cut < end)
        edges = sorted(cuts)
        return [
            (first, last, self._disturbance_mw(wanted, index, first))
            for first, last in pairwise(edges)
        ]


def _damage(octets: bytes, begin: int, rates: list[tuple[int, float]], random: Random) -> bytes:
    """Flip bits where the error rate is, at least one."""
    if not octets:
        return octets
    damaged = bytearray(octets)
    touched = False
    candidates = []
    piece = 0
    for position in range(len(damaged)):
        at = begin + position * OCTET_FS
        while piece < len(rates) - 1 and at >= rates[piece][0]:
            piece += 1
        rate = rates[piece][1]
        if rate > 0.0:
            candidates.append(position)
            if random.random() < 1.0 - (1.0 - rate) ** 8:
                damaged[position] ^= random.randrange(1, 256)
                touched = True
    if not touched:
        # the error that was drawn fell into the length octet or between the draws: put it anywhere
        position = random.choice(candidates) if candidates else len(damaged) - 1
        damaged[position] ^= 1 << random.randrange(8)
    return bytes(damaged)
