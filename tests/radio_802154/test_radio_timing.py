"""PHY and MAC times against the figures that the standard and the datasheet spell out."""

import pytest

from radio_802154 import timing


def test_published_figures() -> None:
    assert timing.OCTET_US == 32  # 250 kbit/s
    assert timing.ACK_WAIT_SYMBOLS == 54  # Table 86 at 2.4 GHz
    assert timing.ACK_TURNAROUND_SYMBOLS * timing.SYMBOL_US == 192  # SWRS041B section 20
    assert timing.ppdu_us(timing.MAX_PSDU_OCTETS) == 4256  # 133 octets
    assert timing.ppdu_us(timing.ACK_MPDU_OCTETS) == 352  # 11 octets, 22 symbols


def test_an_acknowledgement_fits_its_wait() -> None:
    """The wait covers turnaround, one backoff period and the ACK up to its FCS."""
    ack_us = timing.ppdu_us(timing.ACK_MPDU_OCTETS)
    turnaround_us = timing.ACK_TURNAROUND_SYMBOLS * timing.SYMBOL_US
    assert turnaround_us + ack_us <= timing.ACK_WAIT_SYMBOLS * timing.SYMBOL_US


@pytest.mark.parametrize(("channel", "frequency_mhz"), [(11, 2405), (20, 2450), (26, 2480)])
def test_channel_frequencies(channel: int, frequency_mhz: int) -> None:
    assert timing.channel_frequency_mhz(channel) == frequency_mhz


@pytest.mark.parametrize("channel", [10, 27])
def test_channels_that_do_not_exist(channel: int) -> None:
    with pytest.raises(ValueError, match="11 to 26"):
        timing.channel_frequency_mhz(channel)


@pytest.mark.parametrize(("octets", "symbols"), [(5, 12), (18, 12), (19, 40), (127, 40)])
def test_interframe_space(octets: int, symbols: int) -> None:
    assert timing.interframe_space_symbols(octets) == symbols
