"""Bit errors of 802.11: against ns-3's test values, exact forms by scipy, and the code's own trellis."""

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import constants, integrate, special, stats

from cosim.channels.adhoc.errors import (
    bit_error_rate,
    frame_log_success,
    log_success,
    packet_success,
)
from cosim.channels.adhoc.phy import DSSS, DSSS_SHORT, ERP, FHSS, OFDM_5GHZ, Phy, airtime, noise_dbm, sections
from cosim.units import US, Time

RATES_KBPS = DSSS.rates_kbps + OFDM_5GHZ.rates_kbps


def ratio(db: float) -> float:
    return 10.0 ** (db / 10.0)


# ---------------------------------------------------------------- ns-3, wifi-error-rate-models-test.cc

NS_3_NOISE_DBM = -100.5522786 + 7.0

# rate, received dBm, success of 1024 + 40 + 14 bytes, tolerance: all as in that file
NS_3_DSSS = [
    (1000, -105, 0, 1e-13),
    (1000, -100, 1.5e-13, 1e-13),
    (1000, -99, 0.0003, 0.0001),
    (1000, -98, 0.202, 0.005),
    (1000, -97, 0.813, 0.005),
    (1000, -96, 0.984, 0.005),
    (1000, -95, 0.999, 0.001),
    (2000, -96, 0, 1e-13),
    (2000, -95, 4.5e-6, 1e-6),
    (2000, -94, 0.036, 0.005),
    (2000, -93, 0.519, 0.005),
    (2000, -92, 0.915, 0.005),
    (2000, -91, 0.993, 0.005),
    (2000, -90, 0.999, 0.001),
    (5500, -94, 0, 1e-13),
    (5500, -93, 6.6e-14, 5e-14),
    (5500, -92, 0.0001, 0.00005),
    (5500, -91, 0.132, 0.005),
    (5500, -90, 0.744, 0.005),
    (5500, -89, 0.974, 0.005),
    (5500, -88, 0.999, 0.001),
    (11000, -91, 0, 1e-14),
    (11000, -90, 4.7e-14, 1e-14),
    (11000, -89, 8.85e-5, 1e-5),
    (11000, -88, 0.128, 0.005),
    (11000, -87, 0.739, 0.005),
    (11000, -86, 0.973, 0.005),
    (11000, -85, 0.999, 0.001),
]

# rate, SNR in dB, success of 2000 bytes, tolerance
NS_3_OFDM = [
    (6000, 2.5, 2.04e-10, 1e-10),
    (6000, 3.0, 0.020, 0.001),
    (6000, 4.0, 0.885, 0.001),
    (6000, 5.0, 0.997, 0.001),
    (9000, 6.0, 0.097, 0.001),
    (9000, 7.0, 0.918, 0.001),
    (9000, 8.0, 0.998, 0.001),
    (12000, 6.0, 0.0174, 0.001),
    (12000, 7.0, 0.881, 0.001),
    (12000, 8.0, 0.997, 0.001),
    (18000, 8.5, 2.85e-6, 1e-6),
    (18000, 9.5, 0.623, 0.001),
    (18000, 10.5, 0.985, 0.001),
    (24000, 12.0, 2.22e-7, 1e-7),
    (24000, 13.0, 0.495, 0.001),
    (24000, 14.0, 0.974, 0.001),
    (36000, 15.5, 0.012, 0.001),
    (36000, 16.5, 0.818, 0.001),
    (36000, 17.5, 0.993, 0.001),
    (48000, 20.0, 1.3e-4, 1e-4),
    (48000, 21.0, 0.649, 0.001),
    (48000, 22.0, 0.983, 0.001),
    (54000, 21.0, 5.44e-8, 1e-8),
    (54000, 22.0, 0.410, 0.001),
    (54000, 23.0, 0.958, 0.001),
    (54000, 24.0, 0.999, 0.001),
]


@pytest.mark.parametrize(("rate_kbps", "dbm", "success", "tolerance"), NS_3_DSSS)
def test_direct_sequence_succeeds_as_in_ns_3_s_test(rate_kbps: int, dbm: float, success: float, tolerance: float):
    sinr = ratio(dbm - NS_3_NOISE_DBM)
    assert packet_success(rate_kbps, sinr, (1024 + 40 + 14) * 8) == pytest.approx(success, rel=0, abs=tolerance)


@pytest.mark.parametrize(("rate_kbps", "db", "success", "tolerance"), NS_3_OFDM)
def test_ofdm_succeeds_as_in_ns_3_s_test(rate_kbps: int, db: float, success: float, tolerance: float):
    assert packet_success(rate_kbps, ratio(db), 2000 * 8) == pytest.approx(success, rel=0, abs=tolerance)


def test_a_chunk_of_2_ms_succeeds_as_in_ns_3_s_test_to_six_digits():
    # its MCS 0, BPSK 1/2, brings 6.5 Mb/s
    assert packet_success(6000, ratio(4.0), 13000) == pytest.approx(0.905685, rel=0, abs=1e-6)


@pytest.mark.parametrize(("db", "success"), [(-5, 0.020), (-4, 0.525), (-3, 0.936), (-2, 0.996)])
def test_a_kilobyte_at_1_mbps_succeeds_as_computed_elsewhere(db: float, success: float):
    # the reference collection of this project, section 8.3: computed there from the formula, to three digits
    assert packet_success(1000, ratio(db), 8 * 1024) == pytest.approx(success, rel=0, abs=6e-4)


# ---------------------------------------------------------------- direct sequence, exactly


@pytest.mark.parametrize("g", [4.0, 8.0, 16.0, 30.0, 100.0])
def test_dqpsk_tends_to_the_exact_form(g: float):
    # Proakis, Digital Communications, 4th ed., equation 5.2-70: Gray-coded DQPSK, g = Eb/N0
    a, b = (math.sqrt(2 * g * (1 + sign * math.sqrt(0.5))) for sign in (-1, 1))
    exact = stats.ncx2.sf(b * b, 2, a * a) - 0.5 * special.ive(0, a * b) * math.exp(-0.5 * (a - b) ** 2)
    # the model is the leading term of an expansion in 1 / g
    assert exact < bit_error_rate(2000, g / 11) < exact * (1 + 1 / g)


def group_error(b: float) -> float:
    """How probably one of 16 biorthogonal signals is taken for another, by adaptive integration."""

    def wrong(y: float) -> float:
        return float((1.0 - (1.0 - 2.0 * stats.norm.sf(y)) ** 7) * stats.norm.pdf(y - b))

    inside, _ = integrate.quad(wrong, 0.0, b + 10.0, points=[0.5 * b], epsabs=0, epsrel=1e-10, limit=200)
    return inside + float(stats.norm.sf(b))


@pytest.mark.parametrize("sinr", [0.001, 0.03, 0.2, 0.51, 1.3])
@pytest.mark.parametrize(("rate_kbps", "gain"), [(5500, 16.0), (11000, 8.0)])
def test_cck_is_the_integral(rate_kbps: int, gain: float, sinr: float):
    right = packet_success(rate_kbps, sinr, 4)
    assert 1.0 - right == pytest.approx(group_error(math.sqrt(gain * sinr)), rel=1e-6, abs=1e-14)


@pytest.mark.parametrize("rate_kbps", [5500, 11000])
def test_cck_meets_its_union_bound_where_errors_are_rare(rate_kbps: int):
    gain = {5500: 16.0, 11000: 8.0}[rate_kbps]
    missing = []
    for b in (2.0, 4.0, 6.0, 8.0, 10.0, 12.0):
        bound = float(14.0 * stats.norm.sf(b / math.sqrt(2)) + stats.norm.sf(b))
        missing.append(1.0 + math.expm1(4.0 * log_success(rate_kbps, b * b / gain, 1.0)) / bound)
    assert missing == sorted(missing, reverse=True)
    assert 0.0 < missing[-1] < 1e-5


# ---------------------------------------------------------------- the convolutional code

# which outputs of the two generators are sent, 17.3.5.6; the farthest path that ns-3's sum counts
PUNCTURED = {"1/2": (((1,), (1,)), 26), "2/3": (((1, 1), (1, 0)), 15), "3/4": (((1, 1, 0), (1, 0, 1)), 14)}


@cache
def wrong_bits(share: str) -> list[int]:
    """Count the wrong bits of all paths by distance, for each place in the period at which they may leave, together."""
    sent, farthest = PUNCTURED[share]
    size = farthest + 1
    total = np.zeros(size, dtype=object)
    for leaving in range(len(sent[0])):
        paths, bits = np.zeros((64, size), dtype=object), np.zeros((64, size), dtype=object)
        paths[0, 0] = 1
        step = leaving
        while step == leaving or paths.any():
            next_paths, next_bits = np.zeros_like(paths), np.zeros_like(bits)
            for state in np.flatnonzero(paths.any(axis=1)):
                for bit in (1,) if step == leaving else (0, 1):
                    register = bit << 6 | int(state)
                    outputs = ((register & generator).bit_count() & 1 for generator in (0o133, 0o171))
                    away = sum(one * row[step % len(row)] for one, row in zip(outputs, sent, strict=True))
                    next_paths[register >> 1, away:] += paths[state, : size - away]
                    next_bits[register >> 1, away:] += bits[state, : size - away] + bit * paths[state, : size - away]
            total += next_bits[0]
            next_paths[0] = next_bits[0] = 0
            paths, bits = next_paths, next_bits
            step += 1
    return total.tolist()


MODES = {
    6000: ("1/2", 2),
    9000: ("3/4", 2),
    12000: ("1/2", 4),
    18000: ("3/4", 4),
    24000: ("1/2", 16),
    36000: ("3/4", 16),
    48000: ("2/3", 64),
    54000: ("3/4", 64),
}


def uncoded(points: int, sinr: float) -> float:
    """The textbook's bit error rate of Gray-coded square constellations, nearest neighbours only."""
    if points == 2:
        return float(stats.norm.sf(math.sqrt(2 * sinr)))
    side = math.sqrt(points)
    return 4 / math.log2(points) * (1 - 1 / side) * float(stats.norm.sf(math.sqrt(3 * sinr / (points - 1))))


@pytest.mark.slow
@pytest.mark.parametrize("rate_kbps", MODES)
def test_coded_bits_fail_as_the_trellis_says(rate_kbps: int):
    share, points = MODES[rate_kbps]
    for target in (1e-4, 1e-3, 1e-2):
        sinr = 0.01
        while uncoded(points, sinr) > target:
            sinr *= 1.02
        p = uncoded(points, sinr)
        d = math.sqrt(4 * p * (1 - p))
        period = len(PUNCTURED[share][0][0])
        bound = min(0.5, sum(count * d**j for j, count in enumerate(wrong_bits(share))) / (2 * period))
        # of the punctured codes' farther paths ns-3 counts up to 2 in 1000 more
        assert bit_error_rate(rate_kbps, sinr) == pytest.approx(bound, rel=1e-9 if share == "1/2" else 2e-3)


# ---------------------------------------------------------------- all rates


@pytest.mark.parametrize("rate_kbps", RATES_KBPS)
def test_errors_grow_rarer_with_the_sinr_from_a_coin_s_to_none(rate_kbps: int):
    rates = [bit_error_rate(rate_kbps, ratio(0.1 * tenth)) for tenth in range(-400, 350)]
    assert all(low >= high for low, high in pairwise(rates))
    assert max(rates) <= bit_error_rate(rate_kbps, 0.0) == 0.5
    assert rates[0] > 0.45
    assert rates[-1] < 1e-15
    assert packet_success(rate_kbps, math.inf, 1e6) == 1.0


@given(
    rate_kbps=st.sampled_from(RATES_KBPS),
    sinr=st.floats(0.0, 300.0),
    parts=st.lists(st.integers(0, 5000), min_size=1, max_size=6),
)
def test_chunks_multiply_to_the_whole(rate_kbps: int, sinr: float, parts: list[int]):
    product = math.prod(packet_success(rate_kbps, sinr, bits) for bits in parts)
    assert product == pytest.approx(packet_success(rate_kbps, sinr, sum(parts)), rel=1e-9, abs=1e-300)


def test_a_rate_without_a_model_is_refused():
    for sinr in (0.0, 1.0):
        with pytest.raises(ValueError, match="no model of bit errors at 22000 kb/s"):
            log_success(22000, sinr, 8)


# ---------------------------------------------------------------- noise


@pytest.mark.parametrize("bandwidth_hz", [20e6, 22e6])
def test_noise_is_thermal_and_the_receiver_s(bandwidth_hz: float):
    thermal_w = constants.Boltzmann * 290.0 * bandwidth_hz
    assert noise_dbm(bandwidth_hz) == pytest.approx(10 * math.log10(thermal_w * 1e3) + 7.0, abs=1e-9)
    assert noise_dbm(bandwidth_hz, 10.0) - noise_dbm(bandwidth_hz) == pytest.approx(3.0)


def test_noise_of_direct_sequence_is_ns_3_s():
    # it takes 1.3803e-23 for Boltzmann's constant
    assert noise_dbm(DSSS.bandwidth_hz) == pytest.approx(NS_3_NOISE_DBM, abs=2e-3)


# ---------------------------------------------------------------- frames


@pytest.mark.parametrize(
    ("phy", "rate_kbps", "header"),
    [
        (DSSS, 11000, (1000, 48)),
        (DSSS_SHORT, 11000, (2000, 48)),
        (DSSS_SHORT, 1000, (1000, 48)),
        (OFDM_5GHZ, 54000, (6000, 24)),
        (ERP, 9000, (6000, 24)),
    ],
)
@pytest.mark.parametrize("sinr", [0.3, 1.5, 40.0])
def test_a_frame_is_its_header_and_its_payload(phy: Phy, rate_kbps: int, header: tuple[int, int], sinr: float):
    whole = frame_log_success(phy, rate_kbps, 321, [(0, sinr)])
    parts = log_success(header[0], sinr, header[1]) + log_success(rate_kbps, sinr, 8 * 321)
    assert whole == pytest.approx(parts, rel=1e-12)


def test_interference_counts_while_it_lasts():
    # 5.5 Mb/s, 550 octets: 800 us from 192 us on, 5.5 bits each us
    clean, hit = 3.0, 0.6
    levels = [(0, clean), (200 * US, hit), (300 * US, clean), (900 * US, hit)]
    expected = log_success(1000, clean, 48)
    expected += log_success(5500, clean, 5.5 * 608) + log_success(5500, hit, 5.5 * 192)
    assert frame_log_success(DSSS, 5500, 550, levels) == pytest.approx(expected, rel=1e-12)


def test_interference_in_a_header_counts_at_the_header_s_rate():
    levels = [(-5 * US, 3.0), (150 * US, 0.05), (174 * US, 3.0)]
    expected = log_success(1000, 0.05, 24) + log_success(1000, 3.0, 24) + log_success(11000, 3.0, 800)
    assert frame_log_success(DSSS, 11000, 100, levels) == pytest.approx(expected, rel=1e-12)


def test_before_the_header_and_after_the_payload_interference_does_no_harm():
    header, payload = sections(ERP, 24000, 400)
    assert airtime(ERP, 24000, 400) > payload.end
    kept = [(0, 0.0), (header.begin, 50.0), (payload.end, 0.0)]
    assert frame_log_success(ERP, 24000, 400, kept) == frame_log_success(ERP, 24000, 400, [(0, 50.0)])
    for start, end in ((header.begin - 1, header.begin + 1), (payload.end - 1, payload.end + 1)):
        harmed = frame_log_success(ERP, 24000, 400, [(0, 50.0), (start, 0.0), (end, 50.0)])
        assert harmed < frame_log_success(ERP, 24000, 400, [(0, 50.0)])


@given(
    phy=st.sampled_from([DSSS, DSSS_SHORT, OFDM_5GHZ, ERP]),
    octets=st.integers(1, 1500),
    cuts=st.lists(st.integers(1, 10_000_000), max_size=5, unique=True),
    sinr=st.floats(0.01, 30.0),
)
def test_where_a_level_is_cut_does_not_matter(phy: Phy, octets: int, cuts: list[Time], sinr: float):
    rate_kbps = phy.rates_kbps[-2]
    levels = [(0, sinr)] + [(cut, sinr) for cut in sorted(cuts)]
    whole = frame_log_success(phy, rate_kbps, octets, [(0, sinr)])
    assert frame_log_success(phy, rate_kbps, octets, levels) == pytest.approx(whole, rel=1e-9, abs=1e-300)


def test_frequency_hopping_has_no_model():
    with pytest.raises(ValueError, match="no model of bit errors for fhss"):
        frame_log_success(FHSS, 1000, 100, [(0, 10.0)])
