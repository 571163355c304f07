"""Times and sizes of the 2.4 GHz O-QPSK physical layer and of the MAC, each with its clause.

Clauses are those of IEEE Std 802.15.4-2006. Durations are integers, in symbols or microseconds,
so that whoever owns a clock converts them exactly; this module owns none.
"""

from __future__ import annotations

from typing import Final

# --- Physical layer ------------------------------------------------------------------------------

SYMBOL_US: Final = 16
"""Duration of a symbol [µs]: 62.5 ksymbol/s (clause 6.5.3.2)."""

SYMBOLS_PER_OCTET: Final = 2
"""Four bits a symbol (clause 6.5.2.2; phySymbolsPerOctet, Table 23)."""

OCTET_US: Final = SYMBOL_US * SYMBOLS_PER_OCTET
"""Duration of an octet on the air [µs]: 250 kbit/s."""

PREAMBLE_OCTETS: Final = 4
"""Preamble: 32 zero bits (clause 6.3.1, Table 19)."""

SHR_OCTETS: Final = PREAMBLE_OCTETS + 1
"""Synchronisation header: preamble and SFD (clauses 6.3, 6.3.2)."""

SHR_SYMBOLS: Final = SHR_OCTETS * SYMBOLS_PER_OCTET
"""phySHRDuration [symbols] (Table 23)."""

PHR_OCTETS: Final = 1
"""PHY header: seven bits of frame length (clause 6.3.3)."""

MAX_PSDU_OCTETS: Final = 127
"""aMaxPHYPacketSize [octets] (clause 6.4.1, Table 22)."""

TURNAROUND_SYMBOLS: Final = 12
"""aTurnaroundTime: RX to TX and back [symbols] (clause 6.4.1, Table 22)."""

CCA_SYMBOLS: Final = 8
"""CCA detection time, and length of an energy measurement [symbols] (clauses 6.9.9, 6.9.7)."""

# --- Medium access -------------------------------------------------------------------------------

UNIT_BACKOFF_SYMBOLS: Final = 20
"""aUnitBackoffPeriod [symbols] (clause 7.4.1, Table 85)."""

ACK_MPDU_OCTETS: Final = 5
"""An acknowledgement: frame control, sequence number, FCS (clause 7.2.2.3)."""

ACK_TURNAROUND_SYMBOLS: Final = TURNAROUND_SYMBOLS
"""From the last symbol of a frame to the first of its acknowledgement (clause 7.5.6.4.2)."""

ACK_WAIT_SYMBOLS: Final = (
    UNIT_BACKOFF_SYMBOLS + TURNAROUND_SYMBOLS + SHR_SYMBOLS + 6 * SYMBOLS_PER_OCTET
)
"""macAckWaitDuration = 54 symbols at 2.4 GHz (clause 7.4.2, Table 86)."""

MIN_BE: Final = 3
"""macMinBE, default (clause 7.4.2, Table 86)."""

MAX_BE: Final = 5
"""macMaxBE, default (Table 86)."""

MAX_CSMA_BACKOFFS: Final = 4
"""macMaxCSMABackoffs, default (Table 86)."""

MAX_FRAME_RETRIES: Final = 3
"""macMaxFrameRetries, default (Table 86)."""

MAX_SIFS_FRAME_OCTETS: Final = 18
"""aMaxSIFSFrameSize: the longest MPDU that a short interframe space may follow (Table 85)."""

MIN_SIFS_SYMBOLS: Final = 12
"""macMinSIFSPeriod at 2.4 GHz [symbols] (Table 86; clause 7.5.1.3)."""

MIN_LIFS_SYMBOLS: Final = 40
"""macMinLIFSPeriod at 2.4 GHz [symbols] (Table 86; clause 7.5.1.3)."""

# --- Channels ------------------------------------------------------------------------------------

FIRST_CHANNEL: Final = 11
"""First channel of the 2.4 GHz band, channel page 0 (clause 6.1.2.1)."""

LAST_CHANNEL: Final = 26
"""Last channel of the 2.4 GHz band (clause 6.1.2.1)."""


def channel_frequency_mhz(channel: int) -> int:
    """Centre frequency of a channel [MHz]: 2405 + 5 (k − 11) (clause 6.1.2.1).

    Raises:
        ValueError: the channel is not one of the 2.4 GHz band.

    """
    if not FIRST_CHANNEL <= channel <= LAST_CHANNEL:
        raise ValueError(f"channel {channel}: 2.4 GHz has {FIRST_CHANNEL} to {LAST_CHANNEL}")
    return 2405 + 5 * (channel - FIRST_CHANNEL)


def ppdu_us(psdu_octets: int) -> int:
    """Time on the air of a PPDU whose PSDU (MPDU with FCS) has so many octets [µs]."""
    return (SHR_OCTETS + PHR_OCTETS + psdu_octets) * OCTET_US


def interframe_space_symbols(mpdu_octets: int) -> int:
    """The space that must follow a frame of so many octets [symbols] (clause 7.5.1.3)."""
    return MIN_SIFS_SYMBOLS if mpdu_octets <= MAX_SIFS_FRAME_OCTETS else MIN_LIFS_SYMBOLS
