"""Failure detectors one by one: what they say when, with time from the test."""

import math
from itertools import accumulate

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy.stats import norm

from cosim.units import MS, S, Time
from protocols.detection.accrual import IntervalHistory, PhiAccrual, PhiSettings, akka_phi, normal_phi
from protocols.detection.chen import NfdE, NfdESettings, NfdS, NfdSSettings
from protocols.detection.detectors import (
    Detector,
    DetectorSettings,
    FixedTimeout,
    FixedTimeoutSettings,
    make_detector,
)

PERIOD = S
KINDS = ("fixed", "nfd_s", "nfd_e", "phi_akka", "phi_normal")


def settings_of(kind: str, **values: object) -> DetectorSettings:
    adapter: TypeAdapter[DetectorSettings] = TypeAdapter(DetectorSettings)
    return adapter.validate_python({"kind": kind, **values})


def detector_of(kind: str, **values: object) -> Detector:
    return make_detector(settings_of(kind, **values), PERIOD, start=0)


def phi_of(intervals_ms: list[int], **values: object) -> PhiAccrual:
    """Return Akka's detector of its own tests, after heartbeats with these times between them, the first at 0."""
    settings = {"acceptable_pause_s": 0.0, "first_estimate_s": 1.0} | values
    detector = PhiAccrual(PhiSettings.model_validate(settings), PERIOD)
    for number, time in enumerate(accumulate(intervals_ms, initial=0)):
        detector.heartbeat(number, time * MS)
    return detector


# ---------------------------------------------------------------- the choice


@pytest.mark.parametrize(
    ("kind", "made"),
    [
        ("fixed", FixedTimeout),
        ("nfd_s", NfdS),
        ("nfd_e", NfdE),
        ("phi_akka", PhiAccrual),
        ("phi_normal", PhiAccrual),
    ],
)
def test_the_kind_chooses_the_detector(kind: str, made: type):
    assert type(detector_of(kind)) is made


def test_the_two_phis_differ_in_their_tail_only():
    akka, normal = (make_detector(settings_of(kind), PERIOD, 0) for kind in ("phi_akka", "phi_normal"))
    assert isinstance(akka, PhiAccrual)
    assert isinstance(normal, PhiAccrual)
    for detector in (akka, normal):
        for number in range(5):
            detector.heartbeat(number, number * S)
    assert akka.phi(4 * S + 4 * S) == pytest.approx(normal.phi(4 * S + 4 * S), abs=1e-3)
    assert akka.phi(4 * S + 8 * S) > 1.2 * normal.phi(4 * S + 8 * S)


def test_a_key_of_another_kind_is_an_error():
    with pytest.raises(ValidationError, match="threshold"):
        settings_of("fixed", threshold=8.0)


# ---------------------------------------------------------------- all kinds


@pytest.mark.slow
@given(
    kind=st.sampled_from(KINDS),
    steps=st.lists(st.tuples(st.integers(0, 5 * S), st.integers(-2, 3)), max_size=30),
    threshold=st.floats(0.05, 250.0),
)
def test_suspicion_begins_exactly_when_it_was_announced(kind: str, steps: list[tuple[Time, int]], threshold: float):
    detector = detector_of(kind, **({"threshold": threshold} if kind.startswith("phi") else {}))
    now, number = 0, 0
    for gap, ahead in steps:
        now += gap
        number += ahead
        detector.heartbeat(number, now)
    due = detector.suspects_at()
    if due is None:
        assert kind.startswith("phi")
        assert not detector.suspects(now + 10**6 * S)
        return
    assert detector.suspects(due)
    assert detector.suspects(due + 100 * S)
    assert not detector.suspects(due - 1)


@pytest.mark.parametrize("kind", KINDS)
def test_copies_and_overtaken_heartbeats_change_nothing(kind: str):
    detector, other = detector_of(kind), detector_of(kind)
    for number in (3, 4, 7):
        detector.heartbeat(number, number * S)
        other.heartbeat(number, number * S)
    other.heartbeat(7, 7 * S + 300 * MS)
    other.heartbeat(5, 7 * S + 400 * MS)
    assert detector.suspects_at() == other.suspects_at()
    for detector_ in (detector, other):
        detector_.heartbeat(8, 8 * S + 10 * MS)
    assert detector.suspects_at() == other.suspects_at()


# ---------------------------------------------------------------- fixed time-out, NFD-S, NFD-E


def test_the_fixed_timeout_runs_from_the_start_and_from_each_heartbeat():
    detector = FixedTimeout(FixedTimeoutSettings(timeout_s=2.5), start=7 * S)
    assert detector.suspects_at() == 9_500 * MS
    detector.heartbeat(0, 9 * S)
    assert detector.suspects_at() == 11_500 * MS


@pytest.mark.slow
@given(
    start=st.integers(-30, 60),
    shift=st.integers(1, 35),
    arrivals=st.lists(st.tuples(st.integers(0, 12), st.integers(0, 40)), max_size=10),
)
def test_nfd_s_trusts_from_a_freshness_point_on_if_a_heartbeat_not_older_has_arrived(
    start: int, shift: int, arrivals: list[tuple[int, Time]]
):
    """The paper's definition, instant by instant; times are nanoseconds, eta is ten of them, m_0 is sent at 5."""
    eta, epoch = 10, 5
    detector = NfdS(NfdSSettings(shift_s=shift * 1e-9), eta, start, epoch)
    sent = sorted((epoch + i * eta + delay, i) for i, delay in arrivals)
    for now in range(start, start + 150):
        for time, number in sent:
            if time == now:
                detector.heartbeat(number, now)
        passed = [i for i in range(40) if epoch + i * eta >= start and epoch + i * eta + shift <= now]
        arrived = [number for time, number in sent if start <= time <= now]
        fresh = not passed or any(number >= passed[-1] for number in arrived)
        assert detector.suspects(now) == (not fresh)


def test_nfd_e_expects_the_next_heartbeat_at_the_mean_offset_of_the_last_arrivals():
    detector = NfdE(NfdESettings(margin_s=0.5, window=3), PERIOD, start=2 * S)
    assert detector.suspects_at() == 3_500 * MS  # as if one had come at the start
    delays_ms = {10: 900, 11: 30, 13: 60, 14: 0}
    due = []
    for number, delay_ms in delays_ms.items():
        detector.heartbeat(number, number * S + delay_ms * MS)
        due.append(detector.suspects_at())
    # the clocks' difference and the mean delay are in the offsets: 900; 930 / 2; 990 / 3; 90 / 3, for 900 has left
    assert due == [11_900 * MS + 500 * MS, 12_465 * MS + 500 * MS, 14_330 * MS + 500 * MS, 15_030 * MS + 500 * MS]


def test_nfd_e_rounds_to_the_first_instant_after_the_freshness_point():
    detector = NfdE(NfdESettings(margin_s=0.5), PERIOD, start=0)
    detector.heartbeat(0, 0)
    detector.heartbeat(1, S + 1)
    assert detector.suspects_at() == 2 * S + 500 * MS + 1


# ---------------------------------------------------------------- phi: the two tails

AKKA_CDF = [
    *((0, 0, 10, 0.5), (6, 0, 10, 0.7257), (15, 0, 10, 0.9332), (20, 0, 10, 0.97725)),
    *((25, 0, 10, 0.99379), (35, 0, 10, 0.99977), (40, 0, 10, 0.99997), (22, 20, 3, 0.7475)),
]
"""x, mean, standard deviation and cdf in AccrualFailureDetectorSpec.scala."""


@pytest.mark.parametrize("model", [akka_phi, normal_phi])
@pytest.mark.parametrize(("x", "mean", "deviation", "cdf"), AKKA_CDF)
def test_phi_is_the_tail_of_the_normal_distribution(model, x: float, mean: float, deviation: float, cdf: float):
    tolerance = 1e-4 if x > 30 else 1e-3
    assert 1.0 - 10.0 ** -model((x - mean) / deviation) == pytest.approx(cdf, abs=tolerance)


@pytest.mark.parametrize(
    ("time", "phi"), [(0, 0.0), (500, 0.1), (1000, 0.3), (1200, 1.6), (1400, 4.7), (1600, 10.8), (1700, 15.3)]
)
def test_akkas_phi_has_akkas_values(time: int, phi: float):
    assert akka_phi((time - 1000) / 100) == pytest.approx(phi, abs=0.1)


def test_akkas_phi_bears_outliers():
    assert akka_phi(10.0) == pytest.approx(38.0, abs=1.0)
    assert akka_phi(-25.0) == 0.0
    assert akka_phi(1e6) > 1e15


@given(st.floats(-3.0, 8.0))
def test_akkas_phi_is_the_formula_of_akka(y: float):
    e = math.exp(-y * (1.5976 + 0.070566 * y * y))
    written = -math.log10(e / (1.0 + e)) if y > 0 else -math.log10(1.0 - 1.0 / (1.0 + e))
    assert akka_phi(y) == pytest.approx(written, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(("time", "phi"), [(1400, 4.50), (1600, 9.01), (1700, 11.89), (2000, 23.1)])
def test_the_exact_phi_has_the_exact_values(time: int, phi: float):
    assert normal_phi((time - 1000) / 100) == pytest.approx(phi, abs=0.02)


@given(st.floats(-37.0, 36.0))
def test_the_exact_phi_is_scipys_tail(y: float):
    assert normal_phi(y) == pytest.approx(-norm.logsf(y) / math.log(10.0), rel=1e-11, abs=1e-300)


@given(st.floats(-40.0, 45.0), st.floats(0.001, 10.0))
def test_phi_rises_with_time(y: float, more: float):
    assert akka_phi(y) <= akka_phi(y + more)
    assert normal_phi(y) <= normal_phi(y + more)


@pytest.mark.parametrize("model", [akka_phi, normal_phi])
def test_phi_falls_with_the_deviation(model):
    late = [model(100 / deviation) for deviation in (50, 100, 200, 500)]
    assert late == sorted(late, reverse=True)
    assert late[0] > late[-1] + 0.5


# ---------------------------------------------------------------- phi: history


def test_statistics_are_those_of_all_intervals():
    history = IntervalHistory(100)
    for interval in (100, 200, 125, 340, 130):
        history.append(interval)
    assert history.mean() == 179.0
    assert history.variance() == 7584.0


def test_a_full_window_forgets_its_oldest_interval():
    history, found = IntervalHistory(3), []
    for interval in (100, 110, 90, 140, 80):
        history.append(interval)
        found.append((history.mean(), history.variance()))
    expected = [(100.0, 200 / 3), (340 / 3, 3800 / 9), (310 / 3, 6200 / 9)]
    assert found[2:] == [pytest.approx(values, rel=1e-14) for values in expected]


def test_what_has_left_the_window_leaves_no_rounding_error():
    history = IntervalHistory(2)
    for interval in (10**15, 3, 5):
        history.append(interval)
    assert (history.mean(), history.variance()) == (4.0, 1.0)


def test_phi_depends_on_the_window_only():
    fast = phi_of([100] * 4, window=3)
    both = phi_of([100, 100, 100, 100, 600, 500, 500, 500, 500], window=3, threshold=300.0)
    slow = phi_of([500] * 4, window=3, threshold=300.0)
    assert fast.phi(400 * MS + 100 * MS) == pytest.approx(math.log10(2.0))
    assert both.phi(3000 * MS + 500 * MS) == pytest.approx(math.log10(2.0))
    assert both.phi(3000 * MS + 700 * MS) == slow.phi(2000 * MS + 700 * MS)


def test_one_heartbeat_is_enough():
    detector = phi_of([])
    assert detector.phi(1 * S) == pytest.approx(0.3, abs=0.2)
    assert detector.phi(2 * S) == pytest.approx(4.5, abs=0.3)
    assert detector.phi(3 * S) > 15.0


def test_without_a_heartbeat_phi_is_zero():
    detector = PhiAccrual(PhiSettings(), PERIOD)
    assert detector.phi(10**6 * S) == 0.0
    assert detector.suspects_at() is None


def test_the_first_estimate_is_by_default_the_period():
    given_, period = PhiAccrual(PhiSettings(first_estimate_s=2.0), 1), PhiAccrual(PhiSettings(), 2 * S)
    for detector in (given_, period):
        detector.heartbeat(0, 0)
    assert given_.suspects_at() == period.suspects_at()
    # after 1.5 s and 2.5 s, with a pause of 3 s; phi 8 is reached at mean + 5.226 deviations, see the next test
    assert (given_.suspects_at() - 5 * S) / (S / 2) == pytest.approx(2.613 / 0.5, abs=2e-3)


@pytest.mark.parametrize(("share", "means"), [(0.05, 1.262), (0.1, 1.523), (0.2, 2.046), (0.5, 3.613)])
def test_the_time_to_phi_8_is_so_many_means(share: float, means: float):
    detector = phi_of([1000] * 20, min_deviation_s=share, window=10)
    assert (detector.suspects_at() - 20 * S) / S == pytest.approx(means, abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["phi_akka", "phi_normal"])
@given(intervals=st.lists(st.integers(1, 10**5), max_size=20), threshold=st.floats(0.31, 290.0), pause=st.floats(0, 9))
def test_suspicion_begins_in_the_nanosecond_in_which_phi_reaches_the_threshold(
    kind: str, intervals: list[int], threshold: float, pause: float
):
    detector = phi_of(intervals, kind=kind, threshold=threshold, acceptable_pause_s=pause)
    due = detector.suspects_at()
    assert detector.phi(due - 1) < threshold <= detector.phi(due)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["phi_akka", "phi_normal"])
@given(intervals=st.lists(st.integers(1, 20), max_size=10), elapsed=st.integers(1, 60))
def test_suspicion_begins_at_the_instant_whose_phi_is_the_threshold(kind: str, intervals: list[int], elapsed: Time):
    """Where the last bit of the inversion decides; times are nanoseconds."""
    values = {"kind": kind, "min_deviation_s": 3e-9, "acceptable_pause_s": 0.0, "first_estimate_s": 1e-8}
    asked = PhiAccrual(PhiSettings.model_validate(values | {"threshold": 300.0}), 1)
    times = list(enumerate(accumulate(intervals, initial=0)))
    for number, time in times:
        asked.heartbeat(number, time)
    last = times[-1][1]
    threshold = asked.phi(last + elapsed)
    assume(0.31 < threshold < 300.0)
    detector = PhiAccrual(PhiSettings.model_validate(values | {"threshold": threshold}), 1)
    for number, time in times:
        assume(not detector.suspects(time))
        detector.heartbeat(number, time)
    assert detector.suspects_at() == last + elapsed


@pytest.mark.parametrize("kind", ["phi_akka", "phi_normal"])
def test_a_low_threshold_can_mean_suspicion_at_once_but_not_before_the_arrival(kind: str):
    detector = phi_of([1, 5000] * 3, kind=kind, threshold=0.05)
    assert detector.suspects_at() == 3 * 5001 * MS
    assert detector.phi(3 * 5001 * MS) > 0.05


@pytest.mark.parametrize("kind", ["phi_akka", "phi_normal"])
def test_a_peer_recovers_and_its_silence_does_not_count(kind: str):
    detector = phi_of([1000] * 1000, kind=kind, acceptable_pause_s=3.0)
    last = 1000 * S
    assert not detector.suspects(last + 3 * S)
    back = last + 300 * S
    assert detector.suspects(back)
    detector.heartbeat(1001, back)
    assert not detector.suspects(back)
    assert detector.suspects(back + 7 * S)
    assert (
        detector.suspects_at() - back == phi_of([1000] * 1000, kind=kind, acceptable_pause_s=3.0).suspects_at() - last
    )


def test_a_clock_set_back_makes_no_interval():
    detector, other = phi_of([1000] * 5), phi_of([1000] * 5)
    detector.heartbeat(6, 2 * S)
    assert detector.suspects_at() - 2 * S == other.suspects_at() - 5 * S
