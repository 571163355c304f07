"""What a transceiver and the medium agree on: the seam between `cc2420.py` and `medium.py`.

Neither knows the other. A transceiver starts a transmission and answers for its octets; the medium
tells listeners, at four moments of a frame, what reaches them. Between those moments nothing
happens: how much of a frame has arrived at a time follows from the time.

    start ──── SHR ────► sfd ─ length octet ─► length ─ header ─► header ─ rest ─► end
    (energy on the air)  begins                length             header          ends
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Protocol

from radio_802154.timing import OCTET_US

FS_PER_US: Final = 10**9
"""The kernel's unit of time, for a package that stands below the kernel."""

OCTET_FS: Final = OCTET_US * FS_PER_US
"""Time of an octet on the air [fs]."""


@dataclass(slots=True, eq=False)
class Transmission:
    """One PPDU on the air, and who hears it.

    Attributes:
        source: the transmitting port's index.
        sender: answers for the octets.
        frequency_mhz: centre frequency.
        power_dbm: at the antenna connector.
        start_fs: first symbol of the preamble.
        sfd_fs: end of the start-of-frame delimiter.
        end_fs: end of the last octet, or when it was broken off; at first, of the SHR.
        length: PSDU octets (frame length field); -1 until the SFD has gone out.
        aborted: broken off by the sender.
        listeners: ports that are receiving it.
        received_mw: power at each port that was asked for, by index.
        content: the PSDU once it no longer depends on the sender (after its end).

    """

    source: int
    sender: Sender
    frequency_mhz: int
    power_dbm: float
    start_fs: int
    sfd_fs: int
    end_fs: int
    length: int = -1
    aborted: bool = False
    listeners: list[int] = field(default_factory=list)
    received_mw: dict[int, float] = field(default_factory=dict)
    content: bytes | None = None

    def arrived(self, now_fs: int) -> int:
        """Return how many octets, length field included, have arrived completely."""
        return min((min(now_fs, self.end_fs) - self.sfd_fs) // OCTET_FS, 1 + self.length)

    def psdu(self, octets: int) -> bytes:
        """Return the first octets of the PSDU; only what has arrived may be asked for."""
        if self.content is not None:
            return self.content[:octets]
        return self.sender.psdu(octets)


@dataclass(frozen=True, slots=True)
class Reception:
    """How a frame came through.

    Attributes:
        octets: the PSDU as demodulated, bit errors included.
        power_dbm: received power.
        sinr_db: lowest ratio of signal to noise and interference during the frame.

    """

    octets: bytes
    power_dbm: float
    sinr_db: float


class Sender(Protocol):
    """The transmitting side of a transceiver."""

    def sfd_sent(self, transmission: Transmission) -> int | None:
        """The SFD has gone out: return the frame length, or None if there is no frame."""

    def psdu(self, octets: int) -> bytes:
        """Return the first octets of the PSDU that is being sent."""

    def frame_control(self) -> int | None:
        """Return the frame control field about to be sent, or None if it is not yet known."""

    def sent(self, transmission: Transmission) -> None:
        """The last octet has gone out."""


class Receiver(Protocol):
    """The receiving side of a transceiver."""

    def hears(self, transmission: Transmission) -> bool:
        """Whether it has searched for an SFD on this frequency long enough to find this one."""

    def frame_begins(self, transmission: Transmission) -> None:
        """The SFD has been received."""

    def frame_length(self, transmission: Transmission) -> None:
        """The length octet has been received."""

    def frame_header(self, transmission: Transmission) -> bool:
        """The MAC header has been received: return whether the rest is of interest."""

    def frame_ends(self, transmission: Transmission, reception: Reception) -> None:
        """The last octet has been received."""


class Transceiver(Sender, Receiver, Protocol):
    """Both sides, as a radio chip has them."""


class Air(Protocol):
    """What the medium is to a transceiver."""

    def attach(self, name: str, transceiver: Transceiver) -> int:
        """Connect a transceiver to the antenna of that name; return its port's index."""

    def transmit(
        self, port: int, frequency_mhz: int, power_dbm: float, shr_octets: int
    ) -> Transmission:
        """Begin the preamble now."""

    def abort(self, transmission: Transmission) -> None:
        """Break a transmission off now."""

    def energy_dbm(self, port: int, frequency_mhz: int, window_fs: int) -> float:
        """Return the mean in-band power at a port over the window that ends now [dBm]."""
