"""The step-by-step model of the DCF itself: time lines computed by hand, and what holds in any scene."""

from collections.abc import Iterable, Sequence
from itertools import count, pairwise

import numpy as np
import pytest

from cosim.randomness import Draws
from tests.oracles.dcf import (
    ACK,
    BACKOFF,
    BROADCAST,
    CTS,
    DATA,
    NOT_HEARD,
    RECEIVED,
    RTS,
    SPOILT,
    US,
    Arrival,
    Fate,
    Options,
    Result,
    Timing,
    run,
)
from tests.oracles.philox import philox

# 802.11b with long preambles, but windows of 7 to 31 slots, and one octet a microsecond (a broadcast: eight)
DSSS = Timing(
    slot=20 * US,
    sifs=10 * US,
    difs=50 * US,
    cca=15 * US,
    preamble=192 * US,
    delta=1 * US,
    cw_min=7,
    cw_max=31,
    data=lambda octets: (200 + octets) * US,
    broadcast=lambda octets: (200 + 8 * octets) * US,
    ack=304 * US,
    rts=352 * US,
    cts=304 * US,
    slow_ack=304 * US,
)
EIFS = 10 + 304 + 50
TIMEOUT = 10 + 20 + 192 + 2
DIFS = 50
EXCHANGE = 300 + 1 + 10 + 304 + 1  # us from the beginning of 100 octets to the end of their ACK at the sender
ANY = (0, 0)


# ---------------------------------------------------------------- scenes


def links(stations: int, *pairs: tuple[int, int]) -> list[list[bool]]:
    """Return who hears whom; *pairs* both ways."""
    heard = {*pairs, *((b, a) for a, b in pairs)}
    return [[(a, b) in heard for b in range(stations)] for a in range(stations)]


def with_deaf(hears: list[list[bool]], deaf: int, hit: int) -> list[list[bool]]:
    """Return *hears* with a station *deaf* that hears nobody and is heard by *hit* only."""
    return [[value or (a, b) == (deaf, hit) for b, value in enumerate(row)] for a, row in enumerate(hears)]


def everybody(stations: int) -> list[list[bool]]:
    return [[a != b for b in range(stations)] for a in range(stations)]


CHAIN = links(3, (0, 1), (1, 2))


def play(
    hears: Sequence[Sequence[bool]],
    arrivals: Iterable[tuple[int, int, int, int]],
    key: tuple[int, int] = ANY,
    until_us: int = 8_000,
    **options: int | bool | None,
) -> Result:
    """Run arrivals of (us, station, destination, octets) on the DSSS timing."""
    coming = [Arrival(time * US, *rest) for time, *rest in arrivals]
    return run(DSSS, hears, coming, Options(**options), key, until_us * US)


def begins(result: Result, kind: str, source: int) -> list[int]:
    return [frame.begin_ns // US for frame in result.frames if (frame.kind, frame.source) == (kind, source)]


def air(result: Result) -> list[tuple[int, int, int, int, str]]:
    return [(begin // US, end // US, source, to, kind) for begin, end, source, to, kind, _ in result.frames]


def outcomes_at(result: Result, station: int) -> list[tuple[int, str]]:
    """Return (sender, outcome) of the frames whose arrival at *station* has ended, in order of their beginnings."""
    frames = sorted(frame for frame, receiver in result.outcomes if receiver == station)
    return [(frame.source, result.outcomes[frame, station]) for frame in frames]


def drawn(key: tuple[int, int], station: int, n: int, cw: int) -> int:
    """Return the back-off in the plain arithmetic of the top of a 64-bit fraction."""
    w0, w1, _, _ = philox((n, 0, station, BACKOFF), key)
    return (w0 * 2**32 + w1) * (cw + 1) // 2**64


def key_with(*wanted: tuple[int, int, int, int]) -> tuple[int, int]:
    """Return a key under which station *s* draws *c* as its *n*th back-off with window *cw*, for all (s, n, cw, c)."""
    return next((k, 0) for k in count() if all(drawn((k, 0), s, n, cw) == c for s, n, cw, c in wanted))


# ---------------------------------------------------------------- access


def test_a_frame_that_finds_the_medium_idle_goes_out_at_once_and_is_acknowledged():
    result = play(everybody(2), [(1000, 0, 1, 100)])
    assert air(result) == [(1000, 1300, 0, 1, DATA), (1311, 1615, 1, 0, ACK)]
    assert result.fates == [Fate(delivered_ns=1301 * US, done_ns=1616 * US)]
    assert outcomes_at(result, 1) == [(0, RECEIVED)]
    assert outcomes_at(result, 0) == [(1, RECEIVED)]


def test_nobody_transmits_before_difs():
    assert begins(play(everybody(2), [(0, 0, 1, 100)]), DATA, 0) == [50]
    assert begins(play(everybody(2), [(49, 0, 1, 100)]), DATA, 0) == [50]
    assert begins(play(everybody(2), [(51, 0, 1, 100)]), DATA, 0) == [51]


def test_a_frame_that_comes_during_difs_waits_for_its_end_without_back_off():
    # station 1 has acknowledged until 1615
    result = play(everybody(2), [(1000, 0, 1, 100), (1630, 1, 0, 100)])
    assert begins(result, DATA, 1) == [1615 + 50]


@pytest.mark.parametrize(("hidden", "begin"), [(2010, 2211 + 50 + 3 * 20), (2035, 2236 + 50 + 3 * 20), (2036, 2051)])
def test_a_frame_that_waits_for_the_end_of_difs_draws_if_the_medium_is_sensed_busy_first(hidden: int, begin: int):
    # 1 has heard 0 until 2001 and waits for 2051; the frame of 2 arrives there at hidden + 1 and is sensed 15 us later
    arrivals = [(1000, 0, BROADCAST, 100), (2005, 1, BROADCAST, 0), (hidden, 2, BROADCAST, 0)]
    assert begins(play(CHAIN, arrivals, key_with((1, 0, 7, 3))), DATA, 1) == [begin]


def test_energy_is_sensed_cca_after_it_begins_to_arrive():
    late = play(everybody(4), [(1000, 0, 1, 100), (1001 + 14, 2, 3, 100)])
    assert begins(late, DATA, 2)[0] == 1015
    assert outcomes_at(late, 1)[:2] == [(0, SPOILT), (2, NOT_HEARD)]
    key = key_with((2, 0, 7, 3))
    sensed = play(everybody(4), [(1000, 0, 1, 100), (1001 + 15, 2, 3, 100)], key)
    assert begins(sensed, DATA, 2) == [1616 + 50 + 3 * 20]


@pytest.mark.slow
def test_back_offs_are_the_draws_of_the_station():
    draws = Draws(7, "dcf")
    result = play(everybody(2), [(0, 1, 0, 100)] * 10, draws.key)
    gaps = [later - earlier - EXCHANGE - 50 for earlier, later in pairwise(begins(result, DATA, 1))]
    assert gaps == [20 * draws.below(8, n, 1, 1) for n in range(9)]
    assert len(set(gaps)) > 3


def test_a_back_off_follows_every_frame_and_ends_unused_if_nothing_waits():
    key = key_with((0, 0, 7, 5))
    first = (1000, 0, 1, 100)
    assert begins(play(everybody(2), [first, first], key), DATA, 0)[1] == 1616 + 50 + 5 * 20
    assert begins(play(everybody(2), [first, (1700, 0, 1, 100)], key), DATA, 0)[1] == 1616 + 50 + 5 * 20
    assert begins(play(everybody(2), [first, (1767, 0, 1, 100)], key), DATA, 0)[1] == 1767


def test_the_counter_freezes_while_the_medium_is_busy():
    # 2 draws 7 at 1100; of them 3 pass until 0 transmits again at 1666 + 3 * 20
    key = key_with((0, 0, 7, 3), (2, 0, 7, 7))
    arrivals = [(1000, 0, 1, 100), (1000, 0, 1, 100), (1100, 2, 1, 100)]
    result = play(everybody(3), arrivals, key)
    assert begins(result, DATA, 0) == [1000, 1726]
    assert begins(result, DATA, 2) == [1726 + EXCHANGE + 50 + (7 - 3) * 20]
    counted = play(everybody(3), arrivals, key, bianchi_counting=True)
    assert begins(counted, DATA, 2) == [1726 + EXCHANGE + 50 + (7 - 3 - 1) * 20]


# ---------------------------------------------------------------- collisions, errors, retries


def test_equal_back_offs_collide_and_are_repeated_after_the_timeout_in_a_doubled_window():
    key = key_with((0, 0, 7, 4), (2, 0, 7, 4), (0, 1, 15, 2))
    other = drawn(key, 2, 1, 15)
    assert other > 2
    result = play(everybody(3), [(1000, 0, 1, 100), (1000, 0, 1, 100), (1100, 2, 1, 100)], key)
    assert begins(result, DATA, 2)[0] == 1666 + 4 * 20
    assert begins(result, DATA, 0) == [1000, 1746, 2046 + TIMEOUT + DIFS + 2 * 20]
    assert outcomes_at(result, 1)[1:4] == [(0, SPOILT), (2, NOT_HEARD), (0, RECEIVED)]
    assert outcomes_at(result, 2)[2] == (0, NOT_HEARD)
    # both had begun to count at 2320
    assert begins(result, DATA, 2)[1] == 2360 + EXCHANGE + 50 + (other - 2) * 20


def test_bianchi_counting_knows_no_timeout_and_no_eifs():
    key = key_with((0, 0, 7, 4), (2, 0, 7, 4), (0, 1, 15, 0))
    arrivals = [(1000, 0, 1, 100), (1000, 0, 1, 100), (1100, 2, 1, 100), (2050, 1, 0, 100)]
    result = play(everybody(3), arrivals, key, bianchi_counting=True)
    assert begins(result, DATA, 0)[2] == 2047 + 50
    assert begins(result, DATA, 1)[0] == 2047 + 50
    alone = play(links(2), [(1000, 0, 1, 100)], bianchi_counting=True, short_limit=1)
    assert alone.fates == [Fate(dropped_ns=(1300 + 10 + 2 + 1) * US)]


def test_a_frame_may_begin_where_another_ends_but_not_before():
    touching = play(CHAIN, [(1000, 0, BROADCAST, 100), (2000, 2, BROADCAST, 100)])
    assert outcomes_at(touching, 1) == [(0, RECEIVED), (2, RECEIVED)]
    overlapping = play(CHAIN, [(1000, 0, BROADCAST, 100), (1999, 2, BROADCAST, 100)])
    assert outcomes_at(overlapping, 1) == [(0, SPOILT), (2, NOT_HEARD)]


def test_eifs_follows_an_error_until_a_correct_reception():
    result = play(
        CHAIN,
        [
            (1000, 0, BROADCAST, 100),
            (1500, 2, BROADCAST, 100),  # spoils the first until 2001, rests as energy until 2501
            (2510, 1, BROADCAST, 0),
            (4000, 0, BROADCAST, 100),
            (5010, 1, BROADCAST, 0),
        ],
    )
    assert begins(result, DATA, 1) == [2501 + EIFS, 5001 + 50]


def test_a_lock_in_which_the_station_transmits_itself_is_no_error():
    key = key_with((1, 0, 7, 3))
    arrivals = [(1000, 0, BROADCAST, 100), (1010, 1, BROADCAST, 100), (1010, 1, BROADCAST, 100)]
    result = play(everybody(2), arrivals, key)
    assert outcomes_at(result, 1) == [(0, SPOILT)]
    assert outcomes_at(result, 0)[0] == (1, NOT_HEARD)
    assert begins(result, DATA, 1) == [1010, 2010 + 50 + 3 * 20]
    # nor is it one if a deaf station hits it as well
    result = play(with_deaf(links(3, (0, 1)), 2, 1), [*arrivals, (1500, 2, BROADCAST, 0)], key)
    assert begins(result, DATA, 1) == [1010, 2010 + 50 + 3 * 20]
    # nor does it make good the error of before: the frame that arrives from 201 on is hit at 301
    before = [(200, 0, BROADCAST, 0), (300, 2, BROADCAST, 0)]
    result = play(with_deaf(links(3, (0, 1)), 2, 1), [*before, *arrivals], key)
    assert outcomes_at(result, 1)[0] == (0, SPOILT)
    assert begins(result, DATA, 1) == [1010, 2010 + EIFS + 3 * 20]


def test_energy_that_a_station_did_not_lock_onto_hides_later_frames_and_is_no_error():
    # 1 transmits until 2000; of 0 it has energy from 1011 to 3611, in which 2 begins and ends
    hears = with_deaf(links(3, (0, 1)), 2, 1)
    arrivals = [(1000, 1, BROADCAST, 100), (1010, 0, BROADCAST, 300), (2500, 2, BROADCAST, 0), (3620, 1, BROADCAST, 0)]
    result = play(hears, arrivals)
    assert outcomes_at(result, 1) == [(0, NOT_HEARD), (2, NOT_HEARD)]
    assert begins(result, DATA, 1) == [1000, 3611 + 50 + 20 * drawn(ANY, 1, 0, 7)]


def test_a_frame_is_dropped_at_the_retry_limit_and_the_window_goes_back():
    key = (5, 0)
    result = play(links(3, (0, 1)), [(1000, 0, 2, 100), (1000, 0, 1, 100)], key)
    expected = [1000]
    for n, cw in enumerate((15, 31, 31, 31, 31, 31, 7)):
        expected.append(expected[-1] + 300 + TIMEOUT + DIFS + 20 * drawn(key, 0, n, cw))
    assert begins(result, DATA, 0) == expected
    assert result.fates[0] == Fate(dropped_ns=(expected[6] + 300 + TIMEOUT) * US)
    assert result.fates[1].done_ns == (expected[7] + EXCHANGE) * US


def test_each_frame_has_retries_of_its_own():
    result = play(links(3, (0, 1)), [(1000, 0, 2, 100)] * 3, short_limit=2)
    assert [number for _, _, _, _, _, number in result.frames] == [0, 0, 1, 1, 2, 2]


def test_no_limit_means_never():
    result = play(links(3, (0, 1)), [(1000, 0, 2, 100)], short_limit=None)
    assert len(begins(result, DATA, 0)) > 7
    assert result.fates == [Fate()]


def test_a_lost_ack_is_waited_for_to_its_end_and_the_duplicate_is_acknowledged():
    # the broadcast of 2 hits the ACK at 0, which is on the air there from 1312 to 1616, over the timeout at 1524
    key = key_with((0, 0, 15, 6))
    result = play(with_deaf(links(3, (0, 1)), 2, 0), [(1000, 0, 1, 100), (1351, 2, BROADCAST, 0)], key)
    again = 1616 + EIFS + 6 * 20
    assert begins(result, DATA, 0) == [1000, again]
    assert begins(result, ACK, 1) == [1311, again + 311]
    assert result.fates[0] == Fate(delivered_ns=1301 * US, done_ns=(again + EXCHANGE) * US)


def test_a_timeout_waits_for_the_frame_that_the_station_is_locked_onto():
    # the broadcast of 2 is on the air at 0 from 1352 to 2352, over the timeout at 1524
    hears = with_deaf(links(4), 2, 0)
    result = play(hears, [(1000, 0, 3, 100), (1351, 2, BROADCAST, 100)], until_us=2600, short_limit=1)
    assert result.fates[0] == Fate(dropped_ns=2352 * US)
    # of a frame that 0 has sent into, it waits for nothing
    result = play(hears, [(1010, 0, 3, 100), (1000, 2, BROADCAST, 100)], until_us=2600, short_limit=1)
    assert outcomes_at(result, 0) == [(2, SPOILT)]
    assert result.fates[0] == Fate(dropped_ns=(1310 + TIMEOUT) * US)
    # locked for the first time at the very instant of the timeout, and one later
    result = play(hears, [(1000, 0, 3, 100), (1523, 2, BROADCAST, 100)], until_us=2600, short_limit=1)
    assert result.fates[0] == Fate(dropped_ns=2524 * US)
    result = play(hears, [(1000, 0, 3, 100), (1524, 2, BROADCAST, 100)], until_us=2600, short_limit=1)
    assert result.fates[0] == Fate(dropped_ns=1524 * US)
    # two frames on end: the second postpones no more
    twice = [(1000, 0, 3, 100), (1351, 2, BROADCAST, 0), (1551, 4, BROADCAST, 100)]
    result = play(with_deaf(with_deaf(links(5), 2, 0), 4, 0), twice, until_us=2600, short_limit=1)
    assert result.fates[0] == Fate(dropped_ns=1552 * US)
    alone = play(hears, [(1000, 0, 3, 100)], until_us=2600, short_limit=1)
    assert alone.fates[0] == Fate(dropped_ns=1524 * US)


# ---------------------------------------------------------------- broadcast, RTS and NAV


def test_a_broadcast_is_received_by_all_in_reach_and_not_answered():
    key = key_with((1, 0, 7, 6))
    result = play(CHAIN, [(1000, 1, BROADCAST, 100), (1000, 1, BROADCAST, 10)], key, rts_threshold=0)
    assert air(result) == [(1000, 2000, 1, BROADCAST, DATA), (2170, 2450, 1, BROADCAST, DATA)]
    assert set(result.outcomes.items()) == {((frame, b), RECEIVED) for frame in result.frames for b in (0, 2)}
    assert result.fates[0] == Fate(done_ns=2000 * US)


def test_hidden_terminals_spoil_each_other_without_rts():
    result = play(CHAIN, [(1000, 0, 1, 100), (1100, 2, 1, 100)])
    assert begins(result, DATA, 0)[0] == 1000
    assert begins(result, DATA, 2)[0] == 1100
    assert outcomes_at(result, 1)[:2] == [(0, SPOILT), (2, NOT_HEARD)]


def test_rts_and_cts_keep_a_hidden_terminal_away():
    key = key_with((2, 0, 7, 2))
    result = play(CHAIN, [(1000, 0, 1, 100), (1700, 2, 1, 100)], key, rts_threshold=99)
    assert air(result)[:5] == [
        (1000, 1352, 0, 1, RTS),
        (1363, 1667, 1, 0, CTS),
        (1678, 1978, 0, 1, DATA),
        (1989, 2293, 1, 0, ACK),
        (2384, 2736, 2, 1, RTS),  # 2294 + 50 + 2 * 20
    ]
    assert [fate.done_ns for fate in result.fates] == [2294 * US, (2384 + 1294) * US]


def test_frames_bear_the_number_that_their_data_has_at_its_sender():
    result = play(everybody(2), [(3000, 0, 1, 10), (1000, 0, 1, 100), (5000, 1, 0, 10)], rts_threshold=99)
    numbers = [(kind, source, number) for _, _, source, _, kind, number in result.frames]
    assert numbers == [
        *((RTS, 0, 0), (CTS, 1, 0), (DATA, 0, 0), (ACK, 1, 0)),
        *((DATA, 0, 1), (ACK, 1, 1), (DATA, 1, 0), (ACK, 0, 0)),
    ]


@pytest.mark.parametrize("comes", [1305, 1311, 1312, 1600])
def test_a_frame_that_comes_before_or_during_an_own_ack_finds_the_medium_busy(comes: int):
    result = play(everybody(2), [(1000, 0, 1, 100), (comes, 1, 0, 100)], key_with((1, 0, 7, 4)))
    assert begins(result, DATA, 1) == [1615 + 50 + 4 * 20]


def test_the_threshold_is_the_longest_body_that_goes_without_rts():
    result = play(CHAIN, [(1000, 0, 1, 100)], rts_threshold=100)
    assert [kind for *_, kind in air(result)] == [DATA, ACK]


def test_the_nav_alone_keeps_a_station_off_the_medium():
    # 3 hears RTS and DATA of 0, but neither CTS nor ACK of 1: its medium is free from 1979 on, its NAV ends at 2293
    key = key_with((3, 0, 7, 1))
    hears = links(4, (0, 1), (0, 3))
    result = play(hears, [(1000, 0, 1, 100), (2100, 3, 0, 10)], key, rts_threshold=99)
    assert begins(result, DATA, 3)[0] == 1979 + 10 + 304 + 50 + 20
    # between RTS and DATA: its NAV holds from 1353 on
    soon = play(hears, [(1000, 0, 1, 1100), (1480, 3, 0, 10)], key, rts_threshold=99, until_us=2800)
    assert begins(soon, DATA, 3) == []
    without = play(hears, [(1000, 0, 1, 100), (1360, 3, 0, 10)], key)
    assert begins(without, DATA, 3)[0] == 1301 + 10 + 304 + 50 + 20


def test_the_nav_of_an_rts_lasts_to_the_end_of_the_ack():
    # 1 is out of reach, so nothing follows the RTS; 3 holds back until its reservation is over
    key = key_with((3, 0, 7, 1))
    result = play(links(4, (0, 3)), [(1000, 0, 1, 100), (1400, 3, 0, 10)], key, rts_threshold=99, short_limit=1)
    assert begins(result, DATA, 3) == [1353 + 10 + 304 + 10 + 300 + 10 + 304 + 50 + 20]


@pytest.mark.parametrize(("begin", "answers"), [(1937, []), (1938, [2301])])
def test_cts_is_given_if_the_nav_is_over_when_the_rts_ends(begin: int, answers: list[int]):
    # the NAV of 2 from the RTS of 0 to nobody ends at 2291; the RTS of 3 has arrived at begin + 353
    hears = links(4, (0, 2), (2, 3))
    result = play(hears, [(1000, 0, 1, 100), (begin, 3, 2, 100)], rts_threshold=99, short_limit=1)
    assert outcomes_at(result, 2)[:2] == [(0, RECEIVED), (3, RECEIVED)]
    assert begins(result, CTS, 2) == answers


def test_a_nav_from_a_cts_covers_data_and_ack():
    # 2 hears the CTS of 1 until 1668, and no ACK, as the deaf 3 spoils the DATA
    key = key_with((2, 0, 7, 1))
    hears = with_deaf(links(4, (0, 1), (1, 2)), 3, 1)
    arrivals = [(1000, 0, 1, 100), (1700, 3, BROADCAST, 0), (1800, 2, 1, 10)]
    result = play(hears, arrivals, key, rts_threshold=99, long_limit=1)
    assert begins(result, DATA, 2)[0] == 1668 + 10 + 300 + 10 + 304 + 50 + 20


def jammed(hits: Sequence[int], windows: Sequence[int], **options: int) -> tuple[Result, list[int]]:
    """Return a run of 0 -> 1 in which a deaf station 2 spoils RTS (hit 0) or DATA (hit 1), and the times of the RTS."""
    key = (9, 0)
    rts, jams = [1000], []
    for n, (hit, window) in enumerate(zip(hits, windows, strict=True)):
        jams.append(rts[-1] + (678 + 50 if hit else 50))
        rts.append(rts[-1] + (978 if hit else 352) + TIMEOUT + DIFS + 20 * drawn(key, 0, n, window))
    hears = with_deaf(links(3, (0, 1)), 2, 1)
    arrivals = [(1000, 0, 1, 100), *((jam, 2, BROADCAST, 0) for jam in jams)]
    return play(hears, arrivals, key, rts_threshold=99, **options), rts


def test_data_after_rts_has_the_long_limit():
    result, rts = jammed([1, 1, 1, 1], [15, 31, 31, 7])
    assert begins(result, RTS, 0) == rts[:4]
    assert result.fates[0] == Fate(dropped_ns=(rts[3] + 978 + TIMEOUT) * US)


def test_rts_has_the_short_limit_which_a_cts_puts_back():
    result, rts = jammed([0, 0], [15, 7], short_limit=2)
    assert result.fates[0] == Fate(dropped_ns=(rts[1] + 352 + TIMEOUT) * US)
    result, rts = jammed([0, 1, 0], [15, 31, 31], short_limit=2, long_limit=2)
    assert begins(result, RTS, 0) == rts
    assert result.fates[0].done_ns == (rts[3] + 1294) * US


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_what_is_received_was_alone_and_answers_follow_at_sifs(seed: int):
    draw = np.random.default_rng(seed)
    n = int(draw.integers(2, 6))
    pairs = [(a, b) for a in range(n) for b in range(a) if draw.random() < 0.7]
    hears = links(n, *pairs)
    arrivals = []
    for _ in range(25):
        source, destination = (int(station) for station in draw.choice(n, 2, replace=False))
        time, octets = int(draw.integers(0, 15_000)), int(draw.integers(0, 300))
        arrivals.append((time, source, destination if draw.random() < 0.8 else BROADCAST, octets))
    threshold = (None, 100)[seed % 2]
    result = play(hears, arrivals, (seed, 1), 20_000, rts_threshold=threshold)
    received = set()
    for (frame, receiver), outcome in result.outcomes.items():
        begin, end = frame.begin_ns + US, frame.end_ns + US
        late = [(other, 0 if other.source == receiver else US) for other in result.frames if other != frame]
        here = [(other, delay) for other, delay in late if delay == 0 or hears[other.source][receiver]]
        hit = any(other.begin_ns + delay < end and begin < other.end_ns + delay for other, delay in here)
        assert (outcome == RECEIVED) == (not hit)
        if outcome == RECEIVED and frame.destination == receiver:
            received.add((receiver, frame.source, frame.kind, end + 10 * US))
    for frame in result.frames:
        reserved = threshold is not None and frame.end_ns - frame.begin_ns > DSSS.data(threshold)
        call = {ACK: DATA, CTS: RTS, DATA: CTS if reserved and frame.destination != BROADCAST else None}.get(frame.kind)
        assert call is None or (frame.source, frame.destination, call, frame.begin_ns) in received
    assert {kind for *_, kind, _ in result.frames} >= ({DATA, ACK} if threshold is None else {DATA, ACK, RTS, CTS})
