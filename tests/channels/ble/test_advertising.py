"""Events of legacy advertising: when they begin, where their PDUs are, and that any of them can be asked for."""

from itertools import islice, pairwise
from math import sqrt

import pytest

from cosim.channels.ble.advertising import LONGEST_DELAY, REQUEST_ROOM, Advertiser, Event
from cosim.channels.clock import NativeClock
from cosim.randomness import Draws

US, MS, S = 1_000, 1_000_000, 1_000_000_000
CLOCK = NativeClock(123_456_789, -37)
FIRST = 150 * MS


def advertiser(
    interval: int = 100 * MS, delays: Draws | None = None, clock: NativeClock = CLOCK, first: int = FIRST
) -> Advertiser:
    return Advertiser(clock, first, interval, 376 * US, delays)


def first_events(made: Advertiser, count: int) -> list[Event]:
    return list(islice(made.events_from(0), count))


def test_the_delays_are_those_of_the_stream_between_0_and_10_ms():
    count = 10_000
    draws = Draws(5, "advDelay")
    events = first_events(advertiser(delays=draws), count + 1)
    assert [event.number for event in events] == list(range(count + 1))
    assert events[0].local == FIRST
    delays = [after.local - before.local - 100 * MS for before, after in pairwise(events)]
    assert 0 <= min(delays) < 10 * MS / 1000
    assert 10 * MS * 0.999 < max(delays) <= LONGEST_DELAY == 10 * MS
    # uniform: the standard deviation is the range divided by the root of 12
    assert sum(delays) / count == pytest.approx(5 * MS, abs=4 * 10 * MS / sqrt(12 * count))
    assert delays == [draws.below(10 * MS + 1, number) for number in range(count)]


def test_high_duty_cycle_has_no_delays():
    made = Advertiser(CLOCK, FIRST, 3_750 * US, 176 * US, None)
    assert first_events(made, 400) == [Event(n, FIRST + n * 3_750 * US) for n in range(400)]


def test_behind_a_pdu_there_is_room_for_a_request():
    made = advertiser(clock=NativeClock(0))
    # 376 us of the PDU, T_IFS of 150, a CONNECT_IND of 80 + 8 x 34
    assert [made.start(Event(3, 7 * S), pdu) for pdu in range(3)] == [7 * S, 7 * S + 878 * US, 7 * S + 1_756 * US]
    assert REQUEST_ROOM == 502 * US
    told = Advertiser(NativeClock(0), 0, 20 * MS, 376 * US, None, gap=224 * US)
    assert [told.start(Event(0, 0), pdu) for pdu in range(3)] == [0, 600 * US, 1_200 * US]


@pytest.mark.parametrize("ppm", [-500, 0, 20, 500])
def test_a_pdu_begins_at_the_first_instant_of_its_local_time(ppm: int):
    made = advertiser(delays=Draws(6), clock=NativeClock(987_654_321, ppm), first=S)
    for event in first_events(made, 50):
        for pdu in range(3):
            start, local = made.start(event, pdu), event.local + pdu * 878 * US
            assert made.clock.local(start - 1) < local <= made.clock.local(start)


@pytest.mark.parametrize("delays", [None, Draws(7)])
@pytest.mark.parametrize("ppm", [-500, 0, 499, -300_000, 300_000])  # the last two stand still or leap often
def test_the_event_from_a_time_on_is_the_first_with_a_pdu_then(delays: Draws | None, ppm: int):
    clock = NativeClock(123_456_789, ppm)
    events = first_events(advertiser(delays=delays, clock=clock), 60)
    asked = advertiser(delays=delays, clock=clock)
    lasts = [asked.start(event, 2) for event in events]
    for n, last in enumerate(lasts[:-1]):
        assert asked.event_from(last) == events[n]
        assert asked.event_from(last + 1) == events[n + 1]
    for n in (40, 3, 0, 17, 17, 59, 1):  # in any order
        assert asked.event_from(lasts[n] - 1) == asked.event_from(lasts[n]) == events[n]
    assert asked.event_from(-10 * S) == events[0]


@pytest.mark.parametrize("delays", [None, Draws(8)])
def test_far_ahead_are_the_events_that_one_after_the_other_leads_to(delays: Draws | None):
    made, event = advertiser(20 * MS, delays), Event(0, FIRST)
    for _ in range(5_000):
        event = made.after(event)
    assert advertiser(20 * MS, delays).event_from(made.start(event, 0)) == event


@pytest.mark.parametrize("delays", [None, Draws(9)])
def test_shifting_the_start_shifts_all_events(delays: Draws | None):
    shift = 12_345 * MS + 1
    plain = first_events(advertiser(delays=delays), 200)
    later = first_events(advertiser(delays=delays, first=FIRST + shift), 200)
    assert later == [Event(number, local + shift) for number, local in plain]


def test_advertisers_are_equal_whatever_they_were_asked():
    one, other = advertiser(delays=None), advertiser(delays=None)
    one.event_from(10 * S)
    assert one == other


@pytest.mark.parametrize(
    ("interval", "air_time", "gap", "channels", "told"),
    [
        (20 * MS, 376 * US, 502 * US, (), "are not some of"),
        (20 * MS, 376 * US, 502 * US, (38, 37), "are not some of"),
        (20 * MS, 376 * US, 502 * US, (37, 37), "are not some of"),
        (20 * MS, 376 * US, 502 * US, (36, 37), "are not some of"),
        (20 * MS, 0, 502 * US, (37,), "PDUs of 0 ns"),
        (20 * MS, 376 * US, -1, (37,), "gaps of -1 ns"),
        (30 * MS, 376 * US, 9_624 * US + 1, (37, 38, 39), "PDUs of 376000 ns with gaps of 9624001 ns"),
        (2 * 878 * US + 376 * US - 1, 376 * US, 502 * US, (37, 38, 39), "does not hold an event"),
    ],
)
def test_events_that_do_not_fit_are_refused(
    interval: int, air_time: int, gap: int, channels: tuple[int, ...], told: str
):
    with pytest.raises(ValueError, match=told):
        Advertiser(CLOCK, 0, interval, air_time, None, gap, channels)


def test_events_that_just_fit_are_not_refused():
    Advertiser(CLOCK, 0, 30 * MS, 376 * US, None, 9_624 * US, (37, 38, 39))
    Advertiser(CLOCK, 0, 2 * 878 * US + 376 * US, 376 * US, None)
