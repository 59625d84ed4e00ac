"""When advertisers are heard: against the oracle, exact and drawn latencies; the windows; back-off."""

from collections import Counter
from dataclasses import replace
from fractions import Fraction
from math import gcd, sqrt
from random import Random
from typing import NamedTuple

import numpy as np
import pytest

from cosim.channels.ble.advertising import Advertiser
from cosim.channels.ble.scanning import BACKOFF, Backoff, HeardPdu, Run, ScanWindows, next_heard
from cosim.channels.clock import NativeClock
from cosim.errors import LocalProtocolError
from cosim.randomness import Draws
from tests.oracles import discovery, discovery_density, le_discovery
from tests.oracles.medium import Clock
from tests.tiers import soak_count

US, MS, S = 1_000, 1_000_000, 1_000_000_000
PACKET = 376 * US
SIGMAS = 4
ALL = (37, 38, 39)


# ---------------------------------------------------------------- the oracle


class Drawn(NamedTuple):
    """A case and the stream of its delays."""

    case: le_discovery.Case
    delays: Draws | None


def clock_in(random: Random) -> Clock:
    ppm = random.choice((0, 0, -500, 500, random.randint(-500, 500)))
    return Clock(random.choice((0, random.randrange(S), random.randrange(1 << 46))), ppm)


def channels_in(random: Random) -> tuple[int, ...]:
    return ALL if random.random() < 0.7 else tuple(sorted(random.sample(ALL, random.randint(1, 2))))


def scan_in(random: Random, interval: int, air: int) -> tuple[int, int]:
    """Return scanInterval and scanWindow: one of few PDUs, all of the interval, or anything."""
    scan = random.randint(max(4, interval // (20 * 625 * US)), 2 + 3 * interval // (625 * US)) * 625 * US
    windows = (scan, scan, air + random.randint(-1, 1), 2 * air, random.randrange(scan) + 1)
    return scan, random.choice(windows)


def edge_offset(random: Random, case: le_discovery.Case, pdu: le_discovery.Pdu) -> int:
    """Return an offset of the windows with which one of them begins or ends with *pdu*, within 1 ns, or in it."""
    window = random.randrange(20)
    if random.random() < 0.8 and pdu.channel in case.scanned:
        window = 3 * window + case.scanned.index(pdu.channel)
        window = window if len(case.scanned) == 3 else window * len(case.scanned)
    edge, within = window * case.scan_interval, random.randint(-1, 1)
    match random.randrange(4):
        case 0:
            return case.scanner.local(pdu.start) + within - edge
        case 1:
            return case.scanner.local(pdu.end) + within - edge - case.window
        case 2:
            return case.scanner.local(random.randint(pdu.start, pdu.end)) - edge
    return random.randrange(3 * case.scan_interval)


def case_in(random: Random) -> Drawn:
    """Return a case of about ten events, one of whose PDUs is at an edge."""
    air = random.choice((128 * US, 176 * US, PACKET, PACKET, random.randint(80_000, PACKET)))
    interval = random.choice((3_750 * US, 20 * MS, 30 * MS, 100 * MS, random.randint(32, 512) * 625 * US))
    gap = random.choice((0, 224 * US, 502 * US, min(interval // 3, 10 * MS) - air))
    delays = Draws(random.getrandbits(32)) if random.random() < 0.7 else None
    advertiser, scanner = clock_in(random), clock_in(random)
    begin = random.choice((0, random.randrange(S), random.randrange(1_000 * S)))
    scan_interval, window = scan_in(random, interval, air)
    scanned = list(channels_in(random))
    random.shuffle(scanned)
    case = le_discovery.Case(
        advertiser=advertiser,
        first=advertiser.local(begin),
        interval=interval,
        air=air,
        gap=gap,
        delay=lambda event: 0 if delays is None else delays.below(10 * MS + 1, event),
        channels=channels_in(random),
        scanner=scanner,
        offset=0,
        scan_interval=scan_interval,
        window=window,
        scanned=tuple(scanned),
        since=begin,
        until=begin + random.randint(1, 12) * interval,
    )
    sent = le_discovery.pdus(case)
    case = replace(case, offset=edge_offset(random, case, random.choice(sent)))
    match random.randrange(6):
        case 0:
            case = replace(case, since=random.choice(sent).start + random.randint(-1, 1))
        case 1:
            last = le_discovery.heard(case) or random.choice(sent)
            case = replace(case, until=last.end + random.randint(-1, 1))
        case 2:
            case = replace(case, since=begin - random.randrange(interval))
    return Drawn(case, delays)


def found(drawn: Drawn) -> HeardPdu | None:
    case = drawn.case
    clocks = [NativeClock(clock.phase, clock.ppm) for clock in (case.advertiser, case.scanner)]
    advertiser = Advertiser(clocks[0], case.first, case.interval, case.air, drawn.delays, case.gap, case.channels)
    windows = ScanWindows(clocks[1], case.offset, case.scan_interval, case.window, case.scanned)
    return next_heard(advertiser, windows, case.since, case.until)


def edges(case: le_discovery.Case, heard: le_discovery.Pdu | None) -> Counter[str]:
    """Return which of the edges the case is at."""
    seen: Counter[str] = Counter()
    windows = le_discovery.windows(case)
    for pdu in le_discovery.pdus(case):
        if heard is None or pdu <= heard:
            here = [window for window in windows if window[0] == pdu.channel]
            seen["begins with a window"] += any(opening == pdu.start for _, opening, _ in here)
            seen["begins too early"] += any(opening == pdu.start + 1 for _, opening, _ in here)
            seen["ends with a window"] += any(closing == pdu.end for _, _, closing in here)
            seen["ends too late"] += any(closing == pdu.end - 1 for _, _, closing in here)
            seen["across a change"] += case.window == case.scan_interval and any(
                pdu.start < opening < pdu.end for _, opening, _ in windows
            )
            seen["ends with the search"] += pdu.end == case.until and pdu == heard
            seen["ends after the search"] += pdu.end == case.until + 1
            seen["begins with the search"] += pdu.start == case.since and pdu == heard
            seen["begins before the search"] += pdu.start == case.since - 1
    seen["never"] = heard is None
    seen["later event"] = heard is not None and heard.event > 0
    if heard is not None:
        seen[f"on {heard.channel}"] += 1
    return seen


@pytest.mark.slow
def test_what_is_heard_first_is_what_the_oracle_hears() -> None:
    seen: Counter[str] = Counter()
    for seed in range(2_000):
        drawn = case_in(Random(seed))
        slow = le_discovery.heard(drawn.case)
        assert found(drawn) == slow, (seed, drawn.case)
        seen += edges(drawn.case, slow)
    assert len(seen) == 14
    assert min(seen.values()) >= 20, seen


@pytest.mark.soak
def test_what_is_heard_first_is_what_the_oracle_hears_in_ten_thousand_cases() -> None:
    for seed in range(1_000_000, 1_000_000 + soak_count(10_000)):
        drawn = case_in(Random(seed))
        assert found(drawn) == le_discovery.heard(drawn.case), (seed, drawn.case)


@pytest.mark.slow
def test_the_oracle_hears_what_it_hears_from_instant_to_instant() -> None:
    outcomes: Counter[bool] = Counter()
    for seed in range(400):
        random = Random(seed)
        air, gap, scan = random.randint(1, 6), random.randint(0, 4), random.randint(2, 40)
        interval = 3 * (air + gap) + random.randint(0, 30)
        delays = [random.randint(0, 5) for _ in range(1_000)]
        phases, drifts = (
            [random.randrange(1_000) for _ in range(2)],
            [random.randint(-50_000, 50_000) for _ in range(2)],
        )
        clocks = [Clock(phase, drift) for phase, drift in zip(phases, drifts, strict=True)]
        case = le_discovery.Case(
            *(clocks[0], phases[0] + random.randrange(50), interval, air, gap, delays.__getitem__, channels_in(random)),
            *(clocks[1], random.randrange(500), scan, random.choice((scan, random.randint(1, scan)))),
            *(channels_in(random), random.randrange(60), random.randint(60, 400)),
        )
        slow = le_discovery.heard_by_instants(case)
        assert le_discovery.heard(case) == slow, seed
        outcomes[slow is None] += 1
    assert min(outcomes.values()) > 40, outcomes


# ---------------------------------------------------------------- latencies


class Grid(NamedTuple):
    """Cells for the densities of a set, ns: by events; of time and of first phases, and the end in time."""

    by_events: int
    by_time: tuple[int, int, int]


SETS: dict[str, tuple[tuple[int, int, int], Grid]] = {  # ms: advInterval, scanInterval, scanWindow
    "100-1000-300": ((100 * MS, 1000 * MS, 300 * MS), Grid(250_000, (250_000, 500_000, 1_200 * MS))),
    "30-2560-40": ((30 * MS, 2560 * MS, 40 * MS), Grid(250_000, (250_000, MS, 2_900 * MS))),
    "1000-2560-320": ((1000 * MS, 2560 * MS, 320 * MS), Grid(250_000, (1_250_000, 2_500_000, 19_000 * MS))),
    "60-500-50": ((60 * MS, 500 * MS, 50 * MS), Grid(250_000, (250_000, 500_000, 1_800 * MS))),
    "417.5-300-30": ((417_500 * US, 300 * MS, 30 * MS), Grid(31_250, (312_500, 625_000, 12_500 * MS))),
    # a step of 2.5 ms against two scanIntervals
    "1022.5-512.5-128.75": (
        (1_022_500 * US, 512_500 * US, 128_750 * US),
        Grid(250_000, (625_000, 1_250_000, 260_000 * MS)),
    ),
    # the window is the whole interval
    "100-30-30": ((100 * MS, 30 * MS, 30 * MS), Grid(31_250, (31_250, 62_500, 140 * MS))),
    "152.5-60-60": ((152_500 * US, 60 * MS, 60 * MS), Grid(31_250, (31_250, 62_500, 200 * MS))),
    # the window is much shorter than what lies between two events
    "318.75-1280-11.25": ((318_750 * US, 1280 * MS, 11_250 * US), Grid(250_000, (625_000, 10 * MS, 120_000 * MS))),
    "211.25-1280-11.25": ((211_250 * US, 1280 * MS, 11_250 * US), Grid(250_000, (625_000, 10 * MS, 90_000 * MS))),
    # events come back to the phases of those before
    "30-60-30": ((30 * MS, 60 * MS, 30 * MS), Grid(31_250, (31_250, 62_500, 95 * MS))),
    "500-100-10": ((500 * MS, 100 * MS, 10 * MS), Grid(31_250, (312_500, 625_000, 12_500 * MS))),
}
LOCKED = ("30-60-30", "500-100-10")
PHASES = 10_000


def latencies_of_phases(interval: int, scan_interval: int, window: int, until: int) -> list[int]:
    """Return the latencies on one channel of 10,000 even phases, each amid its step, but for those beyond *until*."""
    windows = ScanWindows(NativeClock(0), 0, scan_interval, window, (37,))
    latencies = []
    for number in range(PHASES):
        phase = (2 * number + 1) * scan_interval // (2 * PHASES)
        advertiser = Advertiser(NativeClock(0), phase, interval, PACKET, None, channels=(37,))
        heard = next_heard(advertiser, windows, phase, phase + until)
        if heard is not None:
            latencies.append(heard.end - phase)
    return latencies


@pytest.mark.slow
@pytest.mark.parametrize("name", SETS)
def test_latencies_on_one_channel_are_the_exact_ones(name: str):
    times, _ = SETS[name]
    exact = discovery.solve(*times, PACKET)
    assert (exact is None) == (name in LOCKED)
    if exact is None:
        check_locked(*times)
        return
    latencies = latencies_of_phases(*times, exact.greatest)
    assert len(latencies) == PHASES
    assert sum(latencies) / PHASES == pytest.approx(float(exact.mean), rel=0.005)
    assert max(latencies) == pytest.approx(exact.greatest, rel=0.005)


def check_locked(interval: int, scan_interval: int, window: int) -> None:
    """Check that some phases never meet."""
    common = gcd(interval, scan_interval)
    latencies = latencies_of_phases(interval, scan_interval, window, 2 * interval * scan_interval // common)
    # phases modulo the common divisor stay what they are: some of one window's length are met, the others never
    met = Fraction(min(window, common) - PACKET, common)
    assert len(latencies) / PHASES == pytest.approx(float(met), rel=0.005)


@pytest.mark.slow
def test_a_window_shorter_than_a_packet_never_meets():
    for window in (PACKET - 1, PACKET // 2, 1):
        assert discovery.solve(100 * MS, 1001 * MS, window, PACKET) is None
        assert not latencies_of_phases(100 * MS, 1001 * MS, window, 20 * S)


def drawn_latencies(case: discovery_density.Case, count: int, seed: int) -> np.ndarray:
    phases = Draws(seed, "phase")
    latencies = np.zeros(count)
    for number in range(count):
        start = phases.below(case.cycle, number)
        gap = case.spacing - case.packet
        delays = Draws(seed, "advDelay", number)
        advertiser = Advertiser(NativeClock(0), start, case.interval, case.packet, delays, gap)
        windows = ScanWindows(NativeClock(0), 0, case.scan_interval, case.window)
        heard = next_heard(advertiser, windows, start, start + 100_000 * case.interval)
        assert heard is not None
        latencies[number] = heard.end - start
    return latencies


def check_against_densities(name: str, count: int) -> None:
    times, grid = SETS[name]
    case = discovery_density.Case(*times)
    latencies = drawn_latencies(case, count, 2016)
    mean = discovery_density.event_chances(case, grid.by_events).mean
    assert latencies.mean() == pytest.approx(mean, abs=SIGMAS * latencies.std() / sqrt(count))
    computed = discovery_density.latencies(case, *grid.by_time)
    for share in (0.5, 0.95):
        error = SIGMAS * sqrt(share * (1 - share) / count)
        low, high = computed.quantile(share - error), computed.quantile(min(1.0 - 1e-6, share + error))
        assert low - US <= np.quantile(latencies, share) <= high + US


@pytest.mark.slow
@pytest.mark.parametrize("name", ["100-30-30", "30-60-30"])
def test_latencies_with_delays_are_those_of_the_densities(name: str):
    check_against_densities(name, 2_000)


@pytest.mark.soak
@pytest.mark.parametrize("name", list(SETS)[: soak_count(len(SETS))])
def test_twenty_thousand_latencies_with_delays_are_those_of_the_densities(name: str):
    check_against_densities(name, 20_000)


@pytest.mark.parametrize("delays", [None, Draws(3)])
@pytest.mark.parametrize(("ppm", "scanner_ppm"), [(0, 0), (-500, 333)])
def test_shifting_the_start_shifts_what_is_heard(delays: Draws | None, ppm: int, scanner_ppm: int):
    turns = 12_345  # of a million ns, in which a clock drifts by its ppm in ns
    clock, scanner = NativeClock(S, ppm), NativeClock(5, scanner_ppm)
    for offset in range(0, 100 * MS, 7 * MS + 1):
        outcomes = []
        for turn in (0, turns):
            by, drift, scanner_drift = turn * MS, turn * ppm, turn * scanner_ppm
            advertiser = Advertiser(clock, 2 * S + by + drift, 100 * MS, PACKET, delays)
            windows = ScanWindows(scanner, offset + by + scanner_drift, 77 * MS, 20 * MS)
            # the cycle of the channels begins with window 0 in both
            heard = next_heard(advertiser, windows, S + by, 5 * S + by)
            assert heard is not None
            outcomes.append(heard._replace(start=heard.start - by, end=heard.end - by))
        assert outcomes[0] == outcomes[1]


# ---------------------------------------------------------------- windows


def test_a_scanner_listens_for_its_window_and_changes_channel_every_interval():
    windows = ScanWindows(NativeClock(0), 5 * MS, 100 * MS, 30 * MS, (38, 39, 37))
    times = (-195 * MS, 5 * MS - 1, 5 * MS, 35 * MS - 1, 35 * MS, 105 * MS, 205 * MS, 305 * MS, 404 * MS)
    assert [windows.channel(time) for time in times] == [39, None, 38, 38, None, 39, 37, 38, None]
    continuous = replace(windows, window=100 * MS)
    assert [continuous.channel(time) for time in (5 * MS - 1, 5 * MS, 105 * MS - 1, 105 * MS)] == [37, 38, 38, 39]


def test_a_window_is_of_the_scanners_clock():
    clock = NativeClock(0, 500)
    windows = ScanWindows(clock, 0, 100 * S, 30 * S)
    closing = clock.at_local(30 * S)
    assert closing < 30 * S
    assert [windows.channel(time) for time in (closing - 1, closing)] == [37, None]


@pytest.mark.parametrize(
    ("interval", "window", "channels", "told"),
    [
        (30 * MS, 30 * MS + 1, ALL, "a window of 30000001 ns in an interval of 30000000 ns"),
        (30 * MS, 0, ALL, "a window of 0 ns"),
        (30 * MS, 30 * MS, (), "are not some of"),
        (30 * MS, 30 * MS, (37, 36), "are not some of"),
        (30 * MS, 30 * MS, (37, 37), "are not some of"),
    ],
)
def test_windows_that_cannot_be_are_refused(interval: int, window: int, channels: tuple[int, ...], told: str):
    with pytest.raises(ValueError, match=told):
        ScanWindows(NativeClock(0), 0, interval, window, channels)


# ---------------------------------------------------------------- back-off


class Largest:
    """Draws of which each is the largest that it may be."""

    def below(self, bound: int, number: int) -> int:
        return bound - 1


def limits(answers: str, limit: int = 1) -> list[int]:
    """Return upperLimit after each of the *answers*: + or -."""
    backoff, seen = Backoff(Largest(), upper_limit=limit), []
    for answer in answers:
        while not backoff.asks():
            pass
        backoff.asked(answer == "+")
        assert backoff.count == backoff.upper_limit
        seen.append(backoff.upper_limit)
    return seen


@pytest.mark.parametrize(
    ("answers", "limit", "told"),
    [
        ("----", 1, [1, 2, 2, 4]),
        ("-+-+-+", 4, [4, 4, 4, 4, 4, 4]),
        ("++++", 8, [8, 4, 4, 2]),
        ("--+-++--", 1, [1, 2, 2, 2, 2, 1, 1, 2]),
        ("---+--", 1, [1, 2, 2, 2, 2, 4]),
        ("+++-++", 8, [8, 4, 4, 4, 4, 2]),
        ("----", 128, [128, 256, 256, 256]),
        ("++++", 2, [2, 1, 1, 1]),
    ],
)
def test_two_failures_in_a_row_double_the_limit_and_two_successes_halve_it(answers: str, limit: int, told: list[int]):
    assert limits(answers, limit) == told


def test_every_state_of_the_table_has_both_outcomes():
    assert set(BACKOFF) == {(run, answered) for run in Run for answered in (True, False)}


def test_a_count_is_uniform_from_1_to_the_limit_and_counts_what_could_be_asked():
    backoff = Backoff(Draws(11))
    assert backoff.asks()  # the first of all
    counts: Counter[int] = Counter()
    backoff.upper_limit = 4
    for number in range(4_000):
        backoff.asked(number % 2 == 0)  # never two of a kind
        counts[backoff.count] += 1
        waited = 1
        while not backoff.asks():
            waited += 1
        assert waited == 1 + Draws(11).below(4, number)
    assert set(counts) == {1, 2, 3, 4}
    for count in counts.values():
        assert count == pytest.approx(1_000, abs=SIGMAS * sqrt(4_000 * 3 / 16))


def test_a_scanner_awaits_the_outcome_of_each_request():
    backoff = Backoff(Draws(12))
    with pytest.raises(LocalProtocolError, match="none was sent"):
        backoff.asked(True)
    backoff.asks()
    with pytest.raises(LocalProtocolError, match="awaited"):
        backoff.asks()
