"""Path loss, water, noise and error rates against published figures and closed forms."""

from __future__ import annotations

import decimal
import math
from decimal import Decimal

import pytest

from radio_802154 import propagation as p


@pytest.mark.parametrize(
    ("distance_m", "loss_db"),
    [(1.0, 40.2), (2.0, 46.2), (8.0, 58.3), (16.0, 68.2), (80.0, 91.3)],
)
def test_path_loss_of_the_standard(distance_m: float, loss_db: float) -> None:
    """802.15.4-2006, Annex E: 40.2 + 20 log d up to 8 m, 58.5 + 33 log(d/8) beyond."""
    assert p.Propagation().air_loss_db(distance_m) == pytest.approx(loss_db, abs=0.25)


def test_free_space_at_one_metre() -> None:
    """Friis: (4πd/λ)² is 40.2 dB at 2.45 GHz."""
    wavelength = p.SPEED_OF_LIGHT_M_S / p.CARRIER_HZ
    assert p.Propagation().reference_loss_db == pytest.approx(
        20 * math.log10(4 * math.pi / wavelength), abs=0.05
    )


def test_water_at_2_45_ghz() -> None:
    """Permittivity about 77 − j 9 at 25 °C, by Debye with Kaatze's parameters."""
    real, loss = p.water_permittivity(0.0)
    assert real == pytest.approx(77.2, abs=0.3)
    assert loss == pytest.approx(9.2, abs=0.3)


def test_water_attenuation_is_the_low_loss_limit_of_the_closed_form() -> None:
    """α ≈ π f ε″ / (c √ε′) for ε″ ≪ ε′, within a percent here."""
    real, loss = p.water_permittivity(0.05)
    approximate = math.pi * p.CARRIER_HZ * loss / (p.SPEED_OF_LIGHT_M_S * math.sqrt(real))
    assert p.water_attenuation_db_m(0.05) == pytest.approx(approximate * 8.686, rel=0.01)


def test_sea_water_is_worse_than_tap_water() -> None:
    assert p.water_attenuation_db_m(5.0) > 3 * p.water_attenuation_db_m(0.05)


def test_submersion() -> None:
    model = p.Propagation()
    assert model.submersion_loss_db(0.0) == 0.0
    assert model.submersion_loss_db(-1.0) == 0.0
    surface = model.submersion_loss_db(1e-9)
    assert surface == pytest.approx(4.4, abs=0.1)  # |Γ| of n = 8.8 at normal incidence
    per_metre = (model.submersion_loss_db(0.1) - surface) / 0.1
    assert per_metre == pytest.approx(p.water_attenuation_db_m(0.05), rel=1e-6)


@pytest.mark.parametrize("sinr_db", [-6.0, -3.0, 0.0, 0.4, 3.0, 6.0])
def test_bit_error_rate_against_forty_digits(sinr_db: float) -> None:
    """The alternating sum loses digits in doubles: the same formula with forty."""
    sinr = p.to_mw(sinr_db)
    with decimal.localcontext(decimal.Context(prec=40)):
        total = sum(
            (
                (-1) ** k * math.comb(16, k) * (20 * Decimal(sinr) * (1 - k) / k).exp()
                for k in range(2, 17)
            ),
            start=Decimal(0),
        )
        exact = float(total * 8 / 15 / 16)
    assert p.bit_error_rate(sinr) == pytest.approx(exact, rel=1e-9)


def test_bit_error_rate_has_its_leading_term() -> None:
    """Where the signal is strong: 8/15 · 1/16 · C(16, 2) exp(−10 SINR) = 4 exp(−10 SINR)."""
    assert p.bit_error_rate(3.0) == pytest.approx(4 * math.exp(-30.0), rel=1e-3)


def test_bit_error_rate_without_signal_is_a_half() -> None:
    """At SINR 0 the alternating sum is 15: C(16,0) − C(16,1) + … = 0."""
    assert p.bit_error_rate(0.0) == pytest.approx(0.5)


def test_sensitivity_of_the_datasheet() -> None:
    """−95 dBm at 1 % PER of a 20-octet PSDU, which is how the noise is chosen."""
    sinr = p.to_mw(p.SENSITIVITY_DBM - p.effective_noise_dbm())
    assert p.packet_error_rate(sinr, 8 * 20) == pytest.approx(0.01, rel=1e-6)
    assert 10.0 < p.receiver_noise_figure_db() < 20.0


@pytest.mark.parametrize(
    ("offset_mhz", "rejection_db"),
    [(0, -3), (1, -3), (5, 45), (-5, 30), (10, 54), (-10, 53), (15, 62), (-25, 62)],
)
def test_interference_reaches_the_datasheets_rejection(
    offset_mhz: float, rejection_db: float
) -> None:
    signal = 1.0
    interferer = p.to_mw(rejection_db)
    sinr = signal / (interferer * p.interference_weight(offset_mhz))
    assert p.packet_error_rate(sinr, 160) == pytest.approx(0.01, rel=1e-6)
