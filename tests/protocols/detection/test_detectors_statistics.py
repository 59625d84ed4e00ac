"""Failure detectors over many heartbeats: against Chen's closed form, and what must hold whatever is lost."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import t as student

from cosim.randomness import Streams
from cosim.units import S, Time, from_seconds
from protocols.detection.accrual import PhiSettings
from protocols.detection.chen import NfdESettings, NfdSSettings
from protocols.detection.detectors import DetectorSettings, FixedTimeoutSettings, make_detector
from protocols.detection.quality import Quality, Transition, quality, watch

ETA = S
LOSS = 0.01
MEAN_DELAY_S = 0.02
Arrivals = list[tuple[int, Time]]


def exact_nfd_s(delta: float) -> tuple[float, float, float]:
    """Return E(T_MR) and E(T_M) in periods and P_A of NFD-S: Chen's theorem for LOSS and exponential delays.

    p_j(x) is the probability that m_{i+j} has not come x after the freshness point of m_i.
    """

    def p(j: int, x: float) -> float:
        return LOSS + (1.0 - LOSS) * math.exp(-max(delta + x - j, 0.0) / MEAN_DELAY_S)

    def u(x: float) -> float:
        return math.prod(p(j, x) for j in range(math.ceil(delta) + 1))

    kinks = sorted({j - delta for j in range(math.ceil(delta) + 1) if 0.0 < j - delta < 1.0})
    ends = [0.0, *kinks, 1.0]
    # an exponential tail of 0.02 begins at each end: quad is told where to look
    pieces = [(a, min(a + 0.5 * (b - a), a + 0.3), b) for a, b in pairwise(ends)]
    distrust = sum(quad(u, a, m)[0] + quad(u, m, b)[0] for a, m, b in pieces)
    mistake = (1.0 - LOSS) * -math.expm1(-(delta + 1.0) / MEAN_DELAY_S) * u(0.0)
    return 1.0 / mistake, distrust / mistake, 1.0 - distrust


def heartbeats(seed: int, count: int, lost: np.ndarray | None = None, eta: Time = ETA) -> Arrivals:
    """Return number and arrival of *count* heartbeats, some *lost* (each with LOSS by default), in order of arrival."""
    draws = Streams(seed)("heartbeats")
    delays = (draws.exponential(MEAN_DELAY_S * eta, count)).astype(np.int64)
    gone = draws.random(count) < LOSS
    numbers = np.flatnonzero(~(gone if lost is None else lost))
    times = numbers * eta + delays[numbers]
    order = np.argsort(times, kind="stable")
    return list(zip(numbers[order].tolist(), times[order].tolist(), strict=True))


def bursts(seed: int, count: int, mean_length: float) -> np.ndarray:
    """Return which heartbeats a two-state channel loses: LOSS of them on the mean, in runs of *mean_length*."""
    draws = Streams(seed)("bursts")
    lost = np.zeros(count, dtype=bool)
    at = 0.0
    while at < count:
        at += draws.geometric(LOSS / (1.0 - LOSS) / mean_length)
        length = draws.geometric(1.0 / mean_length)
        lost[int(at) : int(at + length)] = True
        at += length
    return lost


def transitions_of(settings: DetectorSettings, arrivals: Arrivals, end: Time, eta: Time = ETA) -> list[Transition]:
    return watch(make_detector(settings, eta, start=0), arrivals, end)


def assert_mean(batches: Sequence[float], expected: float, share: float = 0.999) -> None:
    """Assert that *expected* is in the interval that holds the true mean of the *batches* with probability *share*."""
    mean, error = float(np.mean(batches)), float(np.std(batches, ddof=1)) / math.sqrt(len(batches))
    assert abs(mean - expected) <= float(student.ppf(0.5 + share / 2, len(batches) - 1)) * error
    assert error <= 0.08 * expected, "the interval is so wide that it says nothing"


# ---------------------------------------------------------------- the closed form

CHEN = [
    *((0.05, 11.068, 0.12520, 0.98869), (0.10, 60.592, 0.56593, 0.99066), (0.50, 101.01, 0.53010, 0.99475)),
    *((0.90, 101.01, 0.13010, 0.99871), (1.05, 1106.8, 0.12520, 0.99989), (1.50, 10101, 0.53010, 0.99995)),
    (2.05, 110680, 0.12520, 0.999999),
]
"""delta, E(T_MR), E(T_M), P_A for eta = 1, p_L = 0.01, delays exponential with mean 0.02."""


@pytest.mark.parametrize(("delta", "recurrence", "duration", "accuracy"), CHEN)
def test_the_closed_form_has_the_tables_values(delta: float, recurrence: float, duration: float, accuracy: float):
    found = exact_nfd_s(delta)
    assert found[0] == pytest.approx(recurrence, rel=1e-4)
    assert found[1] == pytest.approx(duration, rel=1e-4)
    assert found[2] == pytest.approx(accuracy, abs=6e-6)


BATCHES = 25


def batch_qualities(settings: DetectorSettings, length: int, seed: int) -> list[Quality]:
    """Return the qualities of consecutive batches of so many periods of one long run, without its beginning."""
    begin = 2_000
    end = begin + BATCHES * length
    found = transitions_of(settings, heartbeats(seed, end + 10), end * ETA)
    return [quality(found, k * ETA, (k + length) * ETA) for k in range(begin, end, length)]


def equal_settings(kind: str, delta: float) -> DetectorSettings:
    """Return settings of NFD-S, or of NFD-E with alpha = delta - E(D) and a long window, which comes to the same."""
    if kind == "nfd_s":
        return NfdSSettings(shift_s=delta)
    return NfdESettings(margin_s=delta - MEAN_DELAY_S, window=2_000)


@pytest.mark.slow
@pytest.mark.parametrize(("delta", "length"), [(0.05, 1_000), (0.10, 4_000), (0.50, 6_000), (0.90, 6_000)])
@pytest.mark.parametrize("kind", ["nfd_s", "nfd_e"])
def test_chens_detectors_have_the_quality_of_the_closed_form(kind: str, delta: float, length: int):
    batches = batch_qualities(equal_settings(kind, delta), length, seed=5)
    recurrence, duration, accuracy = exact_nfd_s(delta)
    assert_mean([batch.mistake_rate_per_s for batch in batches], 1.0 / recurrence)
    assert_mean([batch.mean_recurrence_s for batch in batches if batch.mean_recurrence_s], recurrence)
    assert_mean([batch.mean_mistake_s for batch in batches if batch.mean_mistake_s], duration)
    assert_mean([1.0 - batch.accuracy for batch in batches], 1.0 - accuracy)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["nfd_s", "nfd_e"])
def test_a_period_more_of_patience_divides_the_mistakes_by_a_hundred(kind: str):
    """The next stair of the table; the mistakes are too few, and their lengths too different, to average these."""
    batches = batch_qualities(equal_settings(kind, 1.05), 20_000, seed=5)
    recurrence, _, _ = exact_nfd_s(1.05)
    assert recurrence == pytest.approx(exact_nfd_s(0.05)[0] / LOSS, rel=1e-3)
    assert_mean([batch.mistake_rate_per_s for batch in batches], 1.0 / recurrence)
    assert_mean([batch.mean_recurrence_s for batch in batches if batch.mean_recurrence_s], recurrence)


@pytest.mark.slow
def test_losses_in_bursts_make_more_mistakes_than_as_many_alone():
    settings, count = NfdSSettings(shift_s=1.5), 100_000
    together = bursts(3, count, 5.0)
    assert 0.7 * LOSS < together.mean() < 1.3 * LOSS
    alone = Streams(3)("alone").random(count) < together.mean()
    found = [
        quality(transitions_of(settings, heartbeats(3, count, lost), count * ETA), 0, count * ETA).mistakes
        for lost in (alone, together)
    ]
    # by the closed form one in 10 000 periods; in bursts, four in five of the 200 runs are longer than one
    assert found[0] < 30
    assert found[1] > 100


# ---------------------------------------------------------------- detection time


def detection_s(settings: DetectorSettings, crash: Time, seed: int, lossless: bool = False) -> float:
    """Return T_D for a peer that sends its heartbeats until *crash*."""
    count = crash // ETA + 1
    arrivals = heartbeats(seed, count, np.zeros(count, dtype=bool) if lossless else None)
    end = crash + 100 * S
    found = quality(transitions_of(settings, arrivals, end), 0, end, crash).detection_s
    assert found is not None
    return found


@given(crash=st.integers(3 * S, 80 * S), delta=st.floats(0.03, 3.0), seed=st.integers(0, 2**32))
def test_nfd_s_detects_a_crash_within_eta_and_delta(crash: Time, delta: float, seed: int):
    assert detection_s(NfdSSettings(shift_s=delta), crash, seed) <= 1.0 + delta + 1e-9


def test_the_bound_of_nfd_s_is_tight_and_the_mean_is_half_a_period_below():
    """A crash just after a heartbeat takes the whole bound; without losses the phase is all there is to chance."""
    settings = NfdSSettings(shift_s=1.25)
    crashes = [30 * S + k * S // 40 for k in range(40)]
    found = [detection_s(settings, crash, seed=k, lossless=True) for k, crash in enumerate(crashes)]
    assert found[0] == pytest.approx(2.25)
    assert np.mean(found) == pytest.approx(1.25 + 0.5 + 0.5 / 40)


@pytest.mark.slow
@given(crash=st.integers(40 * S, 80 * S), seed=st.integers(0, 2**32))
def test_nfd_e_detects_a_crash_about_the_mean_delay_later(crash: Time, seed: int):
    """T_D <= eta + alpha + E(D) (paper, theorem 4), with E(D) as the window has it: here its largest delay."""
    count = crash // ETA + 1
    delays = [time - number * ETA for number, time in heartbeats(seed, count)]
    bound = 1.0 + 1.2 + max(delays) / S
    assert detection_s(NfdESettings(margin_s=1.2), crash, seed) <= bound


# ---------------------------------------------------------------- what must hold whatever is lost


def scaled(settings: DetectorSettings, factor: float) -> DetectorSettings:
    """Return *settings* with all times longer by *factor*."""
    values = settings.model_dump()
    times = {name: factor * value for name, value in values.items() if name.endswith("_s") and value is not None}
    return type(settings).model_validate(values | times)


CHOICES: list[DetectorSettings] = [
    FixedTimeoutSettings(timeout_s=1.04),
    NfdSSettings(shift_s=0.04),
    NfdESettings(margin_s=0.03),
    PhiSettings(kind="phi_akka", threshold=1.0, min_deviation_s=0.01, acceptable_pause_s=0.0),
    PhiSettings(kind="phi_normal", threshold=2.0, min_deviation_s=0.01, acceptable_pause_s=0.0),
]


@pytest.mark.parametrize("settings", CHOICES, ids=lambda settings: settings.kind)
def test_slower_time_scales_durations_and_no_probability(settings: DetectorSettings):
    count, factor = 1_000, 8
    arrivals = heartbeats(11, count)
    crash, end = (count - 1) * ETA + ETA // 3, (count + 20) * ETA
    plain = quality(transitions_of(settings, arrivals, end), 0, end, crash)
    slow = [(number, factor * time) for number, time in arrivals]
    found = transitions_of(scaled(settings, factor), slow, factor * end, factor * ETA)
    long = quality(found, 0, factor * end, factor * crash)
    assert plain.mistakes == long.mistakes > 10
    assert plain.accuracy == pytest.approx(long.accuracy, rel=1e-7)
    for one, other in (
        (plain.detection_s, long.detection_s),
        (plain.mean_recurrence_s, long.mean_recurrence_s),
        (plain.mean_mistake_s, long.mean_mistake_s),
        (1.0 / plain.mistake_rate_per_s, 1.0 / long.mistake_rate_per_s),
    ):
        assert other == pytest.approx(factor * one, rel=1e-7)


@pytest.mark.slow
@given(
    seed=st.integers(0, 2**32),
    steps=st.lists(st.floats(0.01, 1.0), min_size=2, max_size=4),
    kind=st.sampled_from(["fixed", "phi_akka", "phi_normal"]),
)
def test_who_waits_longer_errs_less_and_detects_no_earlier(seed: int, steps: list[float], kind: str):
    """On the same heartbeats; the histories of phi differ, for what is suspected does not enter them."""
    count = 300
    lost = Streams(seed)("losses").random(count) < 0.2
    arrivals = heartbeats(seed, count, lost)
    crash, end = count * ETA - 1, 10 * count * ETA
    found = []
    for limit in np.cumsum(steps):
        settings: DetectorSettings = (
            FixedTimeoutSettings(timeout_s=1.0 + limit)
            if kind == "fixed"
            else PhiSettings.model_validate(
                {"kind": kind, "threshold": 2.0 + 4.0 * limit, "min_deviation_s": 0.02, "acceptable_pause_s": 0.0}
            )
        )
        found.append(quality(transitions_of(settings, arrivals, end), 0, end, crash))
    rates = [one.mistakes for one in found]
    assert rates == sorted(rates, reverse=True)
    times = [one.detection_s for one in found]
    assert times == sorted(times)


# ---------------------------------------------------------------- the metrics themselves


@pytest.mark.slow
@given(
    kind=st.sampled_from(range(5)),
    arrivals=st.lists(st.tuples(st.integers(0, 12), st.integers(0, 120)), max_size=12),
    end=st.integers(0, 150),
)
@example(kind=0, arrivals=[(0, 5)], end=20)
@example(kind=1, arrivals=[(1, 0), (0, 32), (2, 32)], end=150)
def test_watching_finds_what_asking_each_instant_finds(kind: int, arrivals: Arrivals, end: Time):
    """Times are nanoseconds, eta is ten of them; an arrival at an instant comes before the question at it."""
    settings = [
        FixedTimeoutSettings(timeout_s=15e-9),
        NfdSSettings(shift_s=12e-9),
        NfdESettings(margin_s=7e-9, window=3),
        PhiSettings(threshold=1.5, min_deviation_s=1e-9, acceptable_pause_s=0.0),
        PhiSettings(kind="phi_normal", threshold=1.5, min_deviation_s=1e-9, acceptable_pause_s=0.0),
    ][kind]
    arrivals = sorted(arrivals, key=lambda arrival: arrival[1])
    asked, state = make_detector(settings, 10, start=0), False
    expected = []
    for now in range(end):
        for number, time in arrivals:
            if time == now:
                asked.heartbeat(number, now)
        if asked.suspects(now) != state:
            state = not state
            expected.append(Transition(now, state))
    assert transitions_of(settings, arrivals, end, 10) == expected


HISTORY = [Transition(from_seconds(time), k % 2 == 0) for k, time in enumerate((2, 5, 10, 11, 30, 36, 50))]


def test_quality_is_counted_before_the_crash_and_detection_after_it():
    found = quality(HISTORY, 0, 100 * S, 40 * S)
    assert found.detection_s == 10.0
    assert (found.observed_s, found.mistakes, found.mistaken_s) == (40.0, 3, 10.0)
    assert found.mean_mistake_s == pytest.approx(10 / 3)
    assert found.mean_recurrence_s == 14.0
    assert found.mistake_rate_per_s == 3 / 40
    assert found.accuracy == 0.75


def test_a_window_counts_the_mistakes_that_begin_in_it_and_all_time_of_suspicion():
    found = quality(HISTORY, 3 * S, 33 * S)
    assert found.detection_s is None
    assert (found.observed_s, found.mistakes, found.mistaken_s) == (30.0, 2, 2.0 + 1.0 + 3.0)
    assert found.mean_mistake_s == 1.0  # that of 30 s is not over
    assert found.mean_recurrence_s == 20.0


def test_suspicion_before_the_crash_that_stays_detects_at_once():
    found = quality(HISTORY[:1], 0, 100 * S, 40 * S)
    assert found.detection_s == 0.0
    assert (found.mistakes, found.mistaken_s) == (1, 38.0)
    assert found.mean_mistake_s is None
    assert found.mean_recurrence_s is None


@pytest.mark.parametrize("seen", [0, 6])
def test_a_crash_that_nobody_notices_takes_for_ever(seen: int):
    assert quality(HISTORY[:seen], 0, 100 * S, 40 * S).detection_s == math.inf
    assert quality(HISTORY, 0, 50 * S, 40 * S).detection_s == math.inf


@pytest.mark.parametrize("history", [HISTORY[1:], HISTORY[:1] + HISTORY[4:], HISTORY[:2] + HISTORY[:1]])
def test_a_history_that_cannot_be_is_an_error(history: list[Transition]):
    with pytest.raises(ValueError, match=r"trusts at first|cannot be followed"):
        quality(history, 0, 100 * S)
