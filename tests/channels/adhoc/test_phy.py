"""Times of 802.11's physical layers: against the standard's example, ns-3's and INET's tests, and published tables."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.channels.adhoc.phy import (
    ACK_OCTETS,
    CTS_OCTETS,
    DATA_OVERHEAD_OCTETS,
    DSSS,
    DSSS_SHORT,
    ERP,
    ERP_LONG_SLOT,
    FHSS,
    OFDM_5GHZ,
    PROFILES,
    RTS_OCTETS,
    Phy,
    airtime,
    answer_timeout,
    control_kbps,
    eifs,
    plcp_of,
    sections,
)
from cosim.units import US

# ---------------------------------------------------------------- air times


@pytest.mark.parametrize(("octets", "us"), [(1023, 744), (1024, 745), (1025, 746), (1026, 747)])
def test_payloads_at_11_mbps_last_as_in_the_standard_s_table_18_2(octets: int, us: int):
    assert airtime(DSSS, 11000, octets) - 192 * US == us * US


@pytest.mark.parametrize(
    ("rate_kbps", "payload_us"),
    [
        (11000, (744, 745, 746, 747)),
        (5500, (1488, 1490, 1491, 1493)),
        (2000, (4092, 4096, 4100, 4104)),
        (1000, (8184, 8192, 8200, 8208)),
    ],
)
def test_direct_sequence_frames_last_as_in_ns_3_s_tx_duration_test(rate_kbps: int, payload_us: tuple[int, ...]):
    short_us = 192 if rate_kbps == 1000 else 96
    for octets, us in zip(range(1023, 1027), payload_us, strict=True):
        assert airtime(DSSS, rate_kbps, octets) == (us + 192) * US
        assert airtime(DSSS_SHORT, rate_kbps, octets) == (us + short_us) * US


@pytest.mark.parametrize(("rate_kbps", "us"), [(1000, 192), (2000, 96), (5500, 35), (11000, 18)])
def test_24_octets_have_the_plcp_lengths_of_inet_s_ieee80211_legacy_plcp_test(rate_kbps: int, us: int):
    assert airtime(DSSS, rate_kbps, 24) == (192 + us) * US


@pytest.mark.parametrize(
    ("phy", "rate_kbps", "octets", "us"),
    [
        (DSSS, 1000, 14, 304),  # ns-developers, July 2009
        # Gast, "When is 54 not equal to 54?", O'Reilly Network, 8 August 2003
        (DSSS, 11000, 1536, 1310),
        (DSSS, 11000, 76, 248),
        (DSSS, 11000, 14, 203),
        (OFDM_5GHZ, 54000, 1536, 248),
        (OFDM_5GHZ, 54000, 76, 32),
        (OFDM_5GHZ, 54000, 14, 24),
        (ERP, 54000, 1536, 254),
        (ERP, 54000, 76, 38),
        (ERP, 54000, 14, 30),
    ],
)
def test_frames_last_as_published_values_in_ns_3_s_tx_duration_test(phy: Phy, rate_kbps: int, octets: int, us: int):
    assert airtime(phy, rate_kbps, octets) == us * US


# subcarriers 48, bits on each (BPSK 1, QPSK 2, 16-QAM 4, 64-QAM 6), share of them that is data: 17.3.2.2, table 17-3
SYMBOL_BITS = {
    6000: 48 * 1 // 2,
    9000: 48 * 3 // 4,
    12000: 96 // 2,
    18000: 96 * 3 // 4,
    24000: 192 // 2,
    36000: 192 * 3 // 4,
    48000: 288 * 2 // 3,
    54000: 288 * 3 // 4,
}


@given(rate_kbps=st.sampled_from(sorted(SYMBOL_BITS)), octets=st.integers(1, 2400))
def test_an_ofdm_frame_has_the_symbols_that_it_fills(rate_kbps: int, octets: int):
    left, us = 16 + 8 * octets + 6, 20
    while left > 0:
        left, us = left - SYMBOL_BITS[rate_kbps], us + 4
    assert airtime(OFDM_5GHZ, rate_kbps, octets) == us * US
    assert airtime(ERP, rate_kbps, octets) == airtime(ERP_LONG_SLOT, rate_kbps, octets) == (us + 6) * US


def test_a_bit_more_than_a_symbol_holds_takes_another():
    # 16 + 8 * 40 + 6 = 342 bits; 36 Mb/s: 144 a symbol; 54 Mb/s: 8 * 80 + 22 = 662 = 3 * 216 + 14
    assert airtime(OFDM_5GHZ, 36000, 40) == (20 + 3 * 4) * US
    assert airtime(OFDM_5GHZ, 54000, 78) == (20 + 3 * 4) * US  # 646 of 648 bits
    assert airtime(OFDM_5GHZ, 54000, 79) == (20 + 4 * 4) * US  # 654


def test_exchanges_by_frequency_hopping_last_as_in_bianchi_s_table():
    # JSAC 18(3), 2000, table II: payload 8184 bits, MAC header 272, 1 us of propagation; T_s and T_c of its equation 14
    data, propagation = airtime(FHSS, 1000, (8184 + 272) // 8), 1 * US
    answer = FHSS.sifs + propagation
    ack, rts, cts = (airtime(FHSS, 1000, octets) for octets in (ACK_OCTETS, RTS_OCTETS, CTS_OCTETS))
    assert data + answer + ack + FHSS.difs + propagation == 8982 * US
    assert data + FHSS.difs + propagation == 8713 * US
    assert rts + answer + cts + answer + data + answer + ack + FHSS.difs + propagation == 9568 * US
    assert rts + FHSS.difs + propagation == 417 * US


@pytest.mark.parametrize(
    ("phy", "rate_kbps", "rates"),
    [(DSSS, 6000, "1, 2, 5.5, 11"), (OFDM_5GHZ, 11000, "6, 9, 12, 18, 24, 36, 48, 54"), (FHSS, 2000, "1$")],
)
def test_a_rate_that_a_phy_has_not_is_refused(phy: Phy, rate_kbps: int, rates: str):
    with pytest.raises(ValueError, match=f"{phy.name} has no rate of .* Mb/s, but {rates}"):
        airtime(phy, rate_kbps, 100)


def test_a_data_frame_has_36_octets_more_than_its_packet():
    assert DATA_OVERHEAD_OCTETS == 36  # ns-3, wifi-bianchi.cc


# ---------------------------------------------------------------- spaces and windows


@pytest.mark.parametrize(
    ("phy", "slot", "sifs", "difs", "cca", "cw_min", "cw_max"),
    [
        # INET's Ieee80211*Mode.h, after IEEE 802.11-2012; ERP: 802.11-2007, 19.8.4
        (FHSS, 50, 28, 128, 27, 15, 1023),
        (DSSS, 20, 10, 50, 15, 31, 1023),
        (DSSS_SHORT, 20, 10, 50, 15, 31, 1023),
        (OFDM_5GHZ, 9, 16, 34, 4, 15, 1023),
        (ERP, 9, 10, 28, 4, 15, 1023),
        (ERP_LONG_SLOT, 20, 10, 50, 15, 15, 1023),
    ],
)
def test_times_and_windows_are_the_standard_s(
    phy: Phy, slot: int, sifs: int, difs: int, cca: int, cw_min: int, cw_max: int
):
    assert (phy.slot, phy.sifs, phy.difs, phy.cca) == (slot * US, sifs * US, difs * US, cca * US)
    assert (phy.cw_min, phy.cw_max) == (cw_min, cw_max)
    assert phy.cca < phy.slot
    assert PROFILES[phy.name] is phy


@pytest.mark.parametrize(
    ("phy", "us"),
    [
        (FHSS, 396),  # CWAP Official Study Guide, figure 2.9, as the next
        (DSSS, 364),
        (DSSS_SHORT, 364),  # an ACK at 1 Mb/s has a long preamble, whatever the others have
        (OFDM_5GHZ, 94),  # two other simulators' constant for 802.11a
    ],
)
def test_eifs_leaves_room_for_an_ack(phy: Phy, us: int):
    assert eifs(phy) == us * US


def test_eifs_follows_the_basic_rates():
    ack_at_24 = eifs(OFDM_5GHZ._replace(basic_kbps=(24000,)))
    assert ack_at_24 == (16 + 28 + 34) * US  # 134 bits in two symbols of 96


@pytest.mark.parametrize(
    ("phy", "answer_kbps", "us"),
    [(OFDM_5GHZ, 24000, 45), (DSSS, 1000, 222), (DSSS_SHORT, 2000, 126), (DSSS_SHORT, 1000, 222), (FHSS, 1000, 206)],
)
def test_an_answer_is_awaited_until_its_header_could_be_there(phy: Phy, answer_kbps: int, us: int):
    assert answer_timeout(phy, answer_kbps, 0) == us * US
    assert answer_timeout(phy, answer_kbps, 3 * US) == (us + 6) * US


# ---------------------------------------------------------------- rates of answers


@pytest.mark.parametrize(
    ("phy", "data_kbps", "answer_kbps"),
    [
        (DSSS, 11000, 2000),
        (DSSS, 2000, 2000),
        (DSSS, 1000, 1000),
        (DSSS._replace(basic_kbps=(1000,)), 11000, 1000),
        (DSSS._replace(basic_kbps=(1000, 2000, 5500, 11000)), 11000, 11000),
        (OFDM_5GHZ, 54000, 24000),
        (OFDM_5GHZ, 18000, 12000),
        (OFDM_5GHZ, 9000, 6000),
        (ERP, 6000, 6000),
        # no basic rate is low enough: a mandatory one, 9.6
        (DSSS._replace(basic_kbps=(11000,)), 5500, 5500),
        (OFDM_5GHZ._replace(basic_kbps=(24000,)), 18000, 12000),
    ],
)
def test_answers_have_the_highest_basic_rate_not_above_the_frame_s(phy: Phy, data_kbps: int, answer_kbps: int):
    assert control_kbps(phy, data_kbps) == answer_kbps


def test_broadcasts_have_the_lowest_basic_rate():
    assert [phy.lowest_kbps for phy in PROFILES.values()] == [1000, 1000, 1000, 6000, 6000, 6000]
    assert DSSS._replace(basic_kbps=(11000, 5500)).lowest_kbps == 5500


# ---------------------------------------------------------------- sections


@pytest.mark.parametrize(
    ("phy", "rate_kbps", "begin", "end", "header_kbps", "header_bits"),
    [
        (FHSS, 1000, 96, 128, 1000, 32),
        (DSSS, 11000, 144, 192, 1000, 48),
        (DSSS_SHORT, 11000, 72, 96, 2000, 48),
        (DSSS_SHORT, 1000, 144, 192, 1000, 48),
        (OFDM_5GHZ, 54000, 16, 20, 6000, 24),
        (ERP, 6000, 16, 20, 6000, 24),
    ],
)
def test_headers_come_after_what_synchronises_and_have_their_own_modulation(
    phy: Phy, rate_kbps: int, begin: int, end: int, header_kbps: int, header_bits: int
):
    header, payload = sections(phy, rate_kbps, 500)
    assert header == (begin * US, end * US, header_kbps, header_bits)
    assert (payload.begin, payload.rate_kbps, payload.bits) == (end * US, rate_kbps, 4000)
    assert payload.begin == plcp_of(phy, rate_kbps).time


def test_an_extension_holds_no_bits():
    for phy, extension_us in ((DSSS, 0), (OFDM_5GHZ, 0), (ERP, 6)):
        rate_kbps = phy.rates_kbps[-1]
        assert airtime(phy, rate_kbps, 700) - sections(phy, rate_kbps, 700)[1].end == extension_us * US
