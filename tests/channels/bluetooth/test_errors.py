"""Bit errors and what they do to packets: against numerical integration, exact sums, published tables, flipped bits."""

import math
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, special, stats

from cosim.channels.bluetooth.bits import errors
from cosim.channels.bluetooth.bits.errors import (
    best_type,
    bit_error_rate,
    es_n0_db_at,
    failed_section,
    fast_bit_error_rate,
    section_errors,
    section_probabilities,
    throughput_kbps,
)
from cosim.channels.bluetooth.packets import ACL, DH1, DH3, DH5, DM1, DM3, DM5, FHS, ID, NULL, POLL
from cosim.randomness import Draws

NAMES = ("DM1", "DH1", "DM3", "DH3", "DM5", "DH5")

# ---------------------------------------------------------------- bit errors


def terms(es_n0_db: float, modulation_index: float) -> tuple[float, float]:
    """The arguments a, b of Marcum's Q in the textbook's form of the bit error rate."""
    g = 10 ** (es_n0_db / 10)
    rho = abs(np.sinc(2 * modulation_index))
    return math.sqrt(g / 2 * (1 - math.sqrt(1 - rho**2))), math.sqrt(g / 2 * (1 + math.sqrt(1 - rho**2)))


def half_bessel(a: float, b: float) -> float:
    return 0.5 * math.exp(-0.5 * (a - b) ** 2) * float(special.ive(0, a * b))


@pytest.mark.parametrize("modulation_index", [0.28, 0.32, 0.35])
@pytest.mark.parametrize("es_n0_db", [-30.0, 0.0, 6.0, 12.0, 16.0, 20.0])
def test_the_bit_error_rate_is_marcum_s_q_less_half_a_bessel_function(es_n0_db: float, modulation_index: float):
    a, b = terms(es_n0_db, modulation_index)
    q, _ = integrate.quad(
        lambda x: x * math.exp(-0.5 * (x - a) ** 2) * special.ive(0, a * x),
        b,
        b + 40,
        epsabs=0,
        epsrel=1e-12,
        limit=200,
    )
    assert q == pytest.approx(float(stats.ncx2.sf(b * b, 2, a * a)), rel=1e-8, abs=0)
    assert bit_error_rate(es_n0_db, modulation_index) == pytest.approx(q - half_bessel(a, b), rel=1e-9, abs=0)


@pytest.mark.parametrize(
    ("es_n0_db", "rate", "digits"),
    [
        (6, 0.0996, 3),
        (8, 0.0434, 3),
        (10, 0.0128, 3),
        (11, 0.00565, 3),
        (12, 0.00207, 3),
        (13, 6.03e-4, 3),
        (14, 1.31e-4, 3),
        (15, 1.96e-5, 3),
        (16, 1.85e-6, 3),
        (18, 2.5e-9, 2),
    ],
)
def test_the_bit_error_rate_has_its_tabulated_values(es_n0_db: float, rate: float, digits: int):
    assert float(f"{float(bit_error_rate(es_n0_db)):.{digits}g}") == rate


def test_a_rate_is_met_where_it_is_said_to_be_met():
    for rate in (0.3, 1e-3, 1e-10):
        assert bit_error_rate(es_n0_db_at(rate)) == pytest.approx(rate, rel=1e-7, abs=0)
    # tabulated as 12.65 dB, to a twentieth
    assert es_n0_db_at(1e-3) == pytest.approx(12.65, abs=0.05)
    assert bit_error_rate(13.55, 0.28) == pytest.approx(1e-3, rel=0.06, abs=0)
    assert bit_error_rate(12.1, 0.35) == pytest.approx(1e-3, rel=0.06, abs=0)


@pytest.mark.parametrize("rate", [0.0, 0.5, 1e-30])
def test_a_rate_that_is_never_met_is_refused(rate: float):
    with pytest.raises(ValueError, match="is not met between -20 and 20 dB"):
        es_n0_db_at(rate)


def test_the_table_for_the_run_holds_the_exact_rates():
    places = np.random.default_rng(1).uniform(-40, 22, 4000)
    table = np.array([fast_bit_error_rate(place) for place in places.tolist()])
    assert np.abs(table / bit_error_rate(places) - 1).max() < 1e-5


def test_every_entry_of_the_table_is_what_the_formula_gives():
    places = np.arange(-321, 178) / 8
    np.testing.assert_allclose(errors._LOG_BER, np.log(bit_error_rate(places)), rtol=1e-13, atol=0)


def test_beyond_the_table_a_bit_is_guessed_or_never_wrong():
    assert (
        fast_bit_error_rate(-math.inf)
        == fast_bit_error_rate(-1e9)
        == fast_bit_error_rate(-40.0)
        == pytest.approx(0.5, rel=1e-4, abs=0)
    )
    assert fast_bit_error_rate(math.nextafter(22.0, 0.0)) == pytest.approx(float(bit_error_rate(22.0)), rel=1e-5, abs=0)
    assert fast_bit_error_rate(22.0) == fast_bit_error_rate(1e9) == 0.0
    assert 1 - (1 - float(bit_error_rate(22.0))) ** DH5.payload_bits(339) < 2.0**-40


# ---------------------------------------------------------------- sections


@pytest.fixture
def fifty_digits():
    with localcontext(prec=50):
        yield


def lost(limit: int, bits: int, wrong: Decimal) -> Decimal:
    """The probability that more than *limit* of *bits* are wrong, summed with 50 digits."""
    return sum(
        (math.comb(bits, k) * wrong**k * (1 - wrong) ** (bits - k) for k in range(limit + 1, bits + 1)), Decimal(0)
    )


def any_of(count: int, each: Decimal) -> Decimal:
    return 1 - (1 - each) ** count


def exact_sections(wrong: Decimal, bits: int, coded: bool) -> list[float]:
    copies = 3 * wrong**2 * (1 - wrong) + wrong**3
    payload = any_of(math.ceil(bits / 10), lost(1, 15, wrong)) if coded else any_of(bits, wrong)
    return [float(lost(7, 72, wrong)), float(any_of(18, copies)), float(payload)]


CASES = [(DM1, 17), (DM1, 0), (DH1, 27), (DM3, 121), (DH3, 60), (DM5, 224), (DH5, 339), (FHS, 0), (POLL, 0), (NULL, 0)]
BITS = [160, 24, 240, 1000, 512, 1824, 2744, 160, 0, 0]


def test_the_bits_of_a_payload_are_those_before_coding():
    assert [kind.payload_bits(length) for kind, length in CASES] == BITS
    assert ID.payload_bits(0) == 0
    with pytest.raises(ValueError, match="18 bytes do not fit into DM1"):
        DM1.payload_bits(18)


@pytest.mark.usefixtures("fifty_digits")
@pytest.mark.parametrize("es_n0_db", [-5.0, 4.0, 8.0, 11.0, 14.0, 17.0, 20.0])
def test_sections_break_as_exact_sums_say(es_n0_db: float):
    wrong = Decimal(float(bit_error_rate(es_n0_db)))
    for (kind, length), bits in zip(CASES, BITS, strict=True):
        expected = exact_sections(wrong, bits, kind.coded)
        assert [float(p) for p in section_errors(kind, length, es_n0_db)] == pytest.approx(expected, rel=1e-9, abs=0)
        kept = [p if p >= 2.0**-40 else 0.0 for p in expected]
        got = section_probabilities(es_n0_db, bits, kind.coded)
        assert got == pytest.approx(kept, rel=1e-4, abs=0)
        assert [p == 0.0 for p in got] == [p == 0.0 for p in kept]


@pytest.mark.usefixtures("fifty_digits")
def test_an_id_packet_is_68_bits_of_access_code():
    wrong = Decimal(float(bit_error_rate(7.0)))
    access, header, payload = section_errors(ID, 0, 7.0)
    assert float(access) == pytest.approx(float(lost(7, 68, wrong)), rel=1e-9, abs=0)
    assert header == payload == 0.0


def test_what_happens_less_often_than_once_in_2_to_the_40_never_happens():
    # one bit of an uncoded payload: its probability is the bit error rate
    assert section_probabilities(es_n0_db_at(2.0**-40 * 1.0001), 1, False)[2] == pytest.approx(
        2.0**-40, rel=2e-4, abs=0
    )
    assert section_probabilities(es_n0_db_at(2.0**-40 * 0.9999), 1, False)[2] == 0.0


def test_a_strong_signal_breaks_nothing():
    assert section_probabilities(22.0, 2744, False) == (0.0, 0.0, 0.0)
    assert section_probabilities(60.0, 1824, True) == (0.0, 0.0, 0.0)


def test_sections_of_many_links_are_computed_at_once():
    places = np.array([[8.0, 10.0], [12.0, 14.0]])
    together = section_errors(DM3, 100, places)
    for section in range(3):
        assert together[section].shape == (2, 2)
        assert together[section][1, 0] == section_errors(DM3, 100, 12.0)[section]


# ---------------------------------------------------------------- what a run draws


@pytest.mark.parametrize(
    ("words", "probabilities", "section"),
    [
        ((0, 0, 0, 0), (0.0, 0.0, 0.0), errors.NONE),
        ((0, 0, 0, 0), (1e-9, 1.0, 1.0), errors.ACCESS_CODE),
        ((4, 0, 0, 0), (2.0**-30, 1.0, 1.0), errors.HEADER),
        ((3, 0, 0, 0), (2.0**-30, 1.0, 1.0), errors.ACCESS_CODE),
        ((2**32 - 1, 2**31, 2**31, 0), (0.5, 0.5, 0.5), errors.NONE),
        ((2**32 - 1, 2**31, 2**31 - 1, 2**32 - 1), (0.5, 0.5, 0.5), errors.PAYLOAD),
        ((9, 9, 0, 2**11 - 1), (0.0, 0.0, 2.0**-53), errors.PAYLOAD),
        ((9, 9, 0, 2**11), (0.0, 0.0, 2.0**-53), errors.NONE),
        ((2**32 - 1, 2**32 - 1, 2**32 - 1, 2**32 - 1), (1.0, 1.0, 1.0), errors.ACCESS_CODE),
        ((2**32 - 1, 2**32 - 1, 2**32 - 1, 2**32 - 1), (0.0, 0.0, 1.0), errors.PAYLOAD),
    ],
)
def test_the_first_section_that_breaks_counts(words, probabilities, section):
    assert failed_section(*words, *probabilities) == section


WORD = st.integers(0, 2**32 - 1)
CHANCE = st.one_of(st.floats(0, 1), st.integers(0, 2**32).map(lambda n: n / 2**32))


@given(st.tuples(WORD, WORD, WORD, WORD), st.tuples(CHANCE, CHANCE, CHANCE))
def test_sections_are_drawn_from_32_32_and_53_bits(words, chances):
    draws = (Fraction(words[0], 2**32), Fraction(words[1], 2**32), Fraction((words[2] << 32 | words[3]) >> 11, 2**53))
    broken = [section for section in (1, 2, 3) if draws[section - 1] < Fraction(chances[section - 1])]
    assert failed_section(*words, *chances) == (broken[0] if broken else errors.NONE)


GENERATOR = 0b110101
"""Of the (15, 10) code: D^5 + D^4 + D^2 + 1 (Core v1.2, Vol 2 Part B, section 7.5)."""


def syndrome(block: int) -> int:
    for bit in range(14, 4, -1):
        if block >> bit & 1:
            block ^= GENERATOR << (bit - 5)
    return block


CORRECTION = np.zeros(32, np.int64)
CORRECTION[[syndrome(1 << bit) for bit in range(15)]] = [1 << bit for bit in range(15)]
SYNDROMES = np.array([syndrome(block) for block in range(2**15)])


def flipped_packets(draw, packets: int, wrong: float, bits: int, coded: bool) -> np.ndarray:
    """Send *packets* of zeros, which stand for any, flip bits, decode; return how many fail where: NONE, 1, 2, 3."""
    access = (draw.random((packets, 72)) < wrong).sum(axis=1) > 72 - 65
    votes = (draw.random((packets, 18, 3)) < wrong).sum(axis=2)
    header = (votes >= 2).any(axis=1)
    if coded:
        flips = draw.random((packets, -(-bits // 10), 15)) < wrong
        blocks = (flips << np.arange(15)).sum(axis=2)
        payload = (blocks ^ CORRECTION[SYNDROMES[blocks]] != 0).any(axis=1)
    else:
        payload = (draw.random((packets, bits)) < wrong).any(axis=1)
    first = np.where(access, 1, np.where(header, 2, np.where(payload, 3, 0)))
    return np.bincount(first, minlength=4)


def p_value(counts: np.ndarray, sections: tuple[float, float, float]) -> float:
    """The probability of counts as far from what independent *sections* predict, by a chi-square test."""
    access, header, payload = sections
    shares = np.array([0, access, (1 - access) * header, (1 - access) * (1 - header) * payload])
    shares[0] = 1 - shares.sum()
    return float(stats.chisquare(counts[shares > 0], counts.sum() * shares[shares > 0]).pvalue)


MIXED = [(DM1, 7.5), (DM1, 9.0), (DH1, 8.0), (DH1, 11.0), (FHS, 8.5), (DM3, 9.5), (DH3, 9.0)]
"""Types at levels, dB, at which all sections break now and then."""


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "es_n0_db"), MIXED)
def test_flipped_bits_break_as_many_packets_as_the_closed_forms_say(kind, es_n0_db: float):
    bits = kind.payload_bits(kind.capacity)
    draw = np.random.default_rng([5, kind.capacity, int(10 * es_n0_db)])
    wrong = float(bit_error_rate(es_n0_db))
    counts = sum(flipped_packets(draw, 4000, wrong, bits, kind.coded) for _ in range(5))
    assert p_value(counts, section_probabilities(es_n0_db, bits, kind.coded)) > 1e-3
    assert p_value(counts, section_probabilities(es_n0_db + 0.3, bits, kind.coded)) < 1e-6  # the test has teeth


@pytest.mark.parametrize(("kind", "es_n0_db"), MIXED)
def test_a_run_draws_failures_as_often_as_they_are_probable(kind, es_n0_db: float):
    sections = section_probabilities(es_n0_db, kind.payload_bits(kind.capacity), kind.coded)
    draws = Draws(2, "errors", kind.name, int(10 * es_n0_db))
    counts = np.bincount([failed_section(*draws.words(slot), *sections) for slot in range(4000)], minlength=4)
    assert p_value(counts, sections) > 1e-3


# ---------------------------------------------------------------- throughput

TABLE = """
 8  8.3    0     0     0     0     0
10  83.4   7.7   80.8  0     27.5  0
11  103.0  44.2  280.4 .1    265.5 0
12  108.0  105.0 370.2 26.3  440.4 2.4
13  108.7  149.5 385.7 237.6 474.5 138.2
14  108.8  167.5 387.1 481.5 477.7 505.0
15  108.8  172.0 387.2 568.6 477.9 685.3
16  108.8  172.7 387.2 584.0 477.9 719.5
18  108.8  172.8 387.2 585.6 477.9 723.2
"""
"""Es/N0 in dB and kb/s of NAMES (reference of the project, the formulas of Valenti, Robert, Reed, WCNC 2002)."""
BY_RATE = """
1e-4 108.8 168.7 387.2 504.2 477.8 549.6
1e-3 108.6 135.9 383.1 131.1 468.8 46.4
1e-2 92.2  15.3  145.6 0     80.5  0
"""


def rows(table: str) -> list[list[float]]:
    return [[float(word) for word in line.split()] for line in table.split("\n") if line]


@pytest.mark.parametrize(
    ("es_n0_db", "expected"),
    [(place, rates) for place, *rates in rows(TABLE)] + [(es_n0_db_at(ber), rates) for ber, *rates in rows(BY_RATE)],
)
def test_throughput_is_as_tabulated(es_n0_db: float, expected: list[float]):
    got = [float(throughput_kbps(ACL[name], es_n0_db)) for name in NAMES]
    assert got == pytest.approx(expected, abs=0.06)  # printed to 0.1 kb/s


def test_without_errors_the_rates_are_the_specification_s_asymmetric_ones():
    got = [float(throughput_kbps(ACL[name], 40.0)) for name in NAMES]
    assert got == pytest.approx([108.8, 172.8, 387.2, 585.6, 477.8, 723.2], abs=0.1)


@pytest.mark.parametrize(
    ("es_n0_db", "name"), [(9, "DM1"), (11, "DM3"), (12, "DM5"), (13, "DM5"), (14, "DH5"), (20, "DH5")]
)
def test_the_fastest_full_packets_are_the_tabulated_ones(es_n0_db: float, name: str):
    assert max(NAMES, key=lambda each: float(throughput_kbps(ACL[each], es_n0_db))) == name


# ---------------------------------------------------------------- the choice of a type


def goodput(kind, length: int, es_n0_db: float) -> float:
    access, header, payload = section_errors(kind, length, es_n0_db)
    return float(((1 - access) * (1 - header)) ** 2 * (1 - payload)) * 8 * length / (kind.slots + 1)


@given(st.sets(st.sampled_from(NAMES), min_size=1), st.integers(1, 339), st.floats(7, 15))
def test_the_best_type_carries_most(names, length, es_n0_db):
    types = tuple(ACL[name] for name in names)
    fitting = [kind for kind in types if kind.capacity >= length]
    if not fitting:
        with pytest.raises(ValueError, match=f"holds {length} bytes"):
            best_type(types, length, es_n0_db)
        return
    most = max(goodput(kind, length, es_n0_db) for kind in fitting)
    assert goodput(best_type(types, length, es_n0_db), length, es_n0_db) >= most * (1 - 1e-3) - 1e-6


def test_where_types_are_equally_good_the_smallest_is_best():
    types = (DH5, DM5, DH3, DM3, DH1, DM1)
    assert best_type(types, 17, 40.0) is DM1
    assert best_type(types, 0, 40.0) is DM1
    assert best_type((DH1, DM1), 10, -30.0) is DM1
    assert best_type((DH3, DM3), 121, 40.0) is DM3


def test_a_weak_link_prefers_coded_packets_of_more_slots():
    assert best_type((DH1, DM3), 27, 40.0) is DH1
    assert best_type((DH1, DM3), 27, 9.5) is DM3
    assert best_type((DM5, DH3), 150, 40.0) is DH3
    assert best_type((DM5, DH3), 150, 12.0) is DM5


def test_types_without_user_data_are_never_best():
    assert best_type((POLL, NULL, FHS, DH5), 0, 20.0) is DH5
