"""Radio propagation at 2.4 GHz over and under water: pure functions and one frozen model.

Three questions, kept apart: how much power arrives (path loss), how much noise there is (thermal
floor and receiver), what that does to bits (error rate of the modulation). Every figure is from the
standard, the CC2420 datasheet, or derived below from a physical constant; the rest says "assumed".

A submerged antenna is heard along the path of least loss: straight up through the water, through
the surface, then through the air. Water eats hundreds of decibels a metre, so a straight path under
water is shorter than the way through the air only where both are far too long.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

CARRIER_HZ: Final = 2.45e9
"""Middle of the band: over 2405–2480 MHz free-space loss changes by 0.3 dB only."""

SPEED_OF_LIGHT_M_S: Final = 299_792_458.0
"""Exact (SI)."""

VACUUM_PERMITTIVITY_F_M: Final = 8.8541878128e-12
"""CODATA 2018."""

NOISE_BANDWIDTH_HZ: Final = 2.0e6
"""Receiver bandwidth in the bit-error formula (802.15.4-2006, Annex E)."""

THERMAL_DBM_HZ: Final = -173.98
"""kT at 290 K [dBm/Hz]."""

SENSITIVITY_DBM: Final = -95.0
"""CC2420 typical sensitivity at PER 1 % (SWRS041B, section 6.3)."""

SENSITIVITY_PSDU_OCTETS: Final = 20
"""PSDU length for which sensitivity is defined (802.15.4-2006, clause 6.1.7, Table 5)."""

SENSITIVITY_PER: Final = 0.01
"""Packet error rate for which sensitivity is defined (clause 6.1.7)."""

COCHANNEL_REJECTION_DB: Final = -3.0
"""CC2420: a frame survives (PER 1 %) an equal modulation 3 dB below it (SWRS041B, section 6.3)."""

ADJACENT_REJECTION_DB: Final = ((5.0, 45.0), (-5.0, 30.0), (10.0, 54.0), (-10.0, 53.0))
"""CC2420: interferer at wanted + so many MHz may be so many dB stronger (SWRS041B, section 6.3)."""

FAR_REJECTION_DB: Final = 62.0
"""CC2420: interferers 15 MHz and more away (SWRS041B, section 6.3: 62/62 dB)."""


def to_mw(dbm: float) -> float:
    """Return milliwatts of a level in dBm."""
    return math.pow(10.0, dbm / 10.0)


def to_dbm(milliwatts: float) -> float:
    """Return the level in dBm of a positive power in milliwatts."""
    return 10.0 * math.log10(milliwatts)


# --- Modulation ----------------------------------------------------------------------------------

_TERMS: Final = tuple(((-1) ** k * math.comb(16, k), 1.0 / k - 1.0) for k in range(2, 17))


def bit_error_rate(sinr: float) -> float:
    """Return the bit error rate of the 2.4 GHz O-QPSK PHY at a signal-to-noise ratio (linear).

    BER = 8/15 · 1/16 · Σ_{k=2}^{16} (−1)^k C(16, k) exp(20 SINR (1/k − 1))
    (802.15.4-2006, Annex E, E.4.1.8; SINR over 2 MHz).
    """
    total = math.fsum(c * math.exp(20.0 * sinr * e) for c, e in _TERMS)
    return min(0.5, max(0.0, total * 8.0 / 15.0 / 16.0))


def packet_error_rate(sinr: float, bits: int) -> float:
    """Return the probability that at least one of so many independent bits is wrong."""
    return -math.expm1(bits * math.log1p(-bit_error_rate(sinr)))


@lru_cache(maxsize=32)
def required_sinr(per: float, bits: int) -> float:
    """Return the linear SINR at which so many bits have this packet error rate (bisection)."""
    low, high = 1e-3, 1e2
    for _ in range(80):
        middle = math.sqrt(low * high)
        if packet_error_rate(middle, bits) > per:
            low = middle
        else:
            high = middle
    return high


def sensitivity_sinr() -> float:
    """Return the linear SINR at the sensitivity limit: 1 % PER of a 20-octet PSDU."""
    return required_sinr(SENSITIVITY_PER, 8 * SENSITIVITY_PSDU_OCTETS)


def effective_noise_dbm() -> float:
    """Return the noise that makes the formula meet the datasheet's sensitivity [dBm].

    It is the thermal floor (−111 dBm in 2 MHz) plus a noise figure that also holds what a real
    demodulator loses against the formula: about 15.5 dB in all.
    """
    return SENSITIVITY_DBM - to_dbm(sensitivity_sinr())


def receiver_noise_figure_db() -> float:
    """Return noise figure and implementation loss implied by `effective_noise_dbm` [dB]."""
    return effective_noise_dbm() - (THERMAL_DBM_HZ + 10.0 * math.log10(NOISE_BANDWIDTH_HZ))


def rejection_db(offset_mhz: float) -> float:
    """Return how much stronger than the wanted an interferer may be, by its offset [dB].

    Offsets between the published ones use the next smaller; within 2.5 MHz it is the same channel.
    """
    if abs(offset_mhz) < 2.5:
        return COCHANNEL_REJECTION_DB
    if abs(offset_mhz) >= 15.0:
        return FAR_REJECTION_DB
    rejection = COCHANNEL_REJECTION_DB
    for offset, published in ADJACENT_REJECTION_DB:
        if offset * offset_mhz > 0 and abs(offset) <= abs(offset_mhz) + 2.5:
            rejection = published
    return rejection


@lru_cache(maxsize=256)
def interference_weight(offset_mhz: float) -> float:
    """Return by how much (linear) an interferer counts as noise, by its offset from the wanted.

    Such that 1 % PER is reached at the datasheet's rejection. On the same channel that is more
    than one: an interferer of the same modulation does more harm than noise of the same power.
    """
    return to_mw(-rejection_db(offset_mhz)) / sensitivity_sinr()


@lru_cache(maxsize=256)
def selectivity(offset_mhz: float) -> float:
    """Return the share (linear) of another channel's power that the channel filter lets through.

    The datasheet gives no filter curve; its rejection figures stand in for it (assumed).
    """
    return 1.0 if abs(offset_mhz) < 2.5 else to_mw(-rejection_db(offset_mhz))


# --- Water ---------------------------------------------------------------------------------------

WATER_STATIC_PERMITTIVITY: Final = 78.36
"""Pure water, 25 °C (Kaatze, J. Chem. Eng. Data 34, 371–374, 1989)."""

WATER_INFINITE_PERMITTIVITY: Final = 5.2
"""High-frequency limit of the Debye relaxation, 25 °C (Kaatze 1989)."""

WATER_RELAXATION_S: Final = 8.27e-12
"""Debye relaxation time, 25 °C (Kaatze 1989)."""


def water_permittivity(
    conductivity_s_m: float, frequency_hz: float = CARRIER_HZ
) -> tuple[float, float]:
    """Return real and imaginary part ε′, ε″ of water's relative permittivity (Debye, 25 °C)."""
    omega = 2.0 * math.pi * frequency_hz
    x = omega * WATER_RELAXATION_S
    step = WATER_STATIC_PERMITTIVITY - WATER_INFINITE_PERMITTIVITY
    real = WATER_INFINITE_PERMITTIVITY + step / (1.0 + x * x)
    loss = step * x / (1.0 + x * x) + conductivity_s_m / (omega * VACUUM_PERMITTIVITY_F_M)
    return real, loss


@lru_cache(maxsize=32)
def water_attenuation_db_m(conductivity_s_m: float, frequency_hz: float = CARRIER_HZ) -> float:
    """Return the attenuation of a plane wave in water [dB/m].

    α = (ω/c) √(ε′/2 · (√(1 + (ε″/ε′)²) − 1)), times 20 log10 e.
    """
    real, loss = water_permittivity(conductivity_s_m, frequency_hz)
    root = math.sqrt(real / 2.0 * (math.sqrt(1.0 + (loss / real) ** 2) - 1.0))
    alpha = 2.0 * math.pi * frequency_hz / SPEED_OF_LIGHT_M_S * root
    return alpha * 20.0 * math.log10(math.e)


@lru_cache(maxsize=32)
def surface_loss_db(conductivity_s_m: float) -> float:
    """Return the power lost to reflection at the surface, at normal incidence [dB].

    1 − |Γ|² with Γ = (n − 1)/(n + 1), n = √(ε′ − jε″).
    """
    real, loss = water_permittivity(conductivity_s_m)
    n = complex(real, -loss) ** 0.5
    return -10.0 * math.log10(1.0 - abs((n - 1.0) / (n + 1.0)) ** 2)


# --- Path ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Propagation:
    """Path loss between two antennas.

    In air it is the log-distance model of the standard's coexistence study (802.15.4-2006, Annex
    E): 40.2 dB at 1 m, exponent 2 up to 8 m, 3.3 beyond (58.5 dB at 8 m).

    Attributes:
        reference_loss_db: loss at 1 m [dB].
        near_exponent: exponent up to `breakpoint_m`.
        breakpoint_m: where the exponent changes [m].
        far_exponent: exponent beyond.
        minimum_distance_m: closer antennas count as so far apart (the far field begins there;
            assumed: about one wavelength).
        conductivity_s_m: of the water [S/m]; tap water, assumed.
        shadowing_sd_db: standard deviation of a constant per link, log-normal; 0 leaves it out.

    """

    reference_loss_db: float = 40.2
    near_exponent: float = 2.0
    breakpoint_m: float = 8.0
    far_exponent: float = 3.3
    minimum_distance_m: float = 0.12
    conductivity_s_m: float = 0.05
    shadowing_sd_db: float = 0.0

    def air_loss_db(self, distance_m: float) -> float:
        """Return the loss over a distance in air [dB]."""
        d = max(distance_m, self.minimum_distance_m)
        near = min(d, self.breakpoint_m)
        loss = self.reference_loss_db + 10.0 * self.near_exponent * math.log10(near)
        if d > self.breakpoint_m:
            loss += 10.0 * self.far_exponent * math.log10(d / self.breakpoint_m)
        return loss

    def submersion_loss_db(self, depth_m: float) -> float:
        """Return the loss of an antenna so far below the surface [dB]; none at or above it."""
        if depth_m <= 0.0:
            return 0.0
        through = water_attenuation_db_m(self.conductivity_s_m) * depth_m
        return through + surface_loss_db(self.conductivity_s_m)
