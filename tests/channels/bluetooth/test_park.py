"""Parked slaves: more than seven members, beacons, broadcasts for all, coming back, and getting lost."""

import itertools

import pytest

from cosim.machine import BROADCAST, Address, Lost, Mode, Outcome, Park, Unpark
from cosim.units import MS, SLOT, S
from tests.channels.bluetooth.piconet_bench import Bench

INTERVAL = 256
WINDOW = 32


def park_and_join(bench: Bench, parked: int, size: int) -> None:
    """Park the first slaves and give their places to others."""
    for slave in range(1, parked + 1):
        bench.ask(slave * SLOT, 0, Park(slave))
    for i in range(size - 7):
        bench.kernel.at((20 + i) * SLOT, lambda i=i: bench.piconet.add_slave(8 + i, 1 + i, 100))


def make(size: int, **settings: object) -> Bench:
    """A piconet whose slaves 8 to *size* have taken the places of as many that were parked."""
    bench = Bench(7, park_interval_slots=INTERVAL, park_window_slots=WINDOW, devices=size + 1, **settings)
    park_and_join(bench, size - 7, size)
    return bench


def test_seven_active_and_several_parked_members_all_get_a_broadcast() -> None:
    bench = make(11)
    bench.send(100 * SLOT, 0, BROADCAST, b"all", token=1)
    bench.run(400 * SLOT)
    assert len(bench.piconet.members()) == 7
    assert sorted(address for _, address, data in bench.arrivals if data == b"all") == list(range(1, 12))
    # it has waited for the window that begins at slot 256
    assert [tick for tick, kind, k in bench.on_air("DM1") if k == 0] == [2 * INTERVAL] * 11
    assert [outcome for *_, outcome in bench.fates()] == [Outcome.SENT]


def test_an_empty_beacon_is_sent_in_every_window_and_nothing_else_is_an_event() -> None:
    bench = make(8)
    bench.run(50 * SLOT)
    before = bench.kernel.executed
    bench.run((10 * INTERVAL + 50) * SLOT)
    beacons = [tick for tick, kind, k in bench.on_air("NULL") if k == 0]
    assert beacons == [2 * INTERVAL * i for i in range(1, 11)]
    assert bench.kernel.executed - before <= 2 * 10 + 1  # a start and an end each, and the end of the run


def test_links_are_polled_on_while_others_are_parked() -> None:
    bench = make(9, t_poll_slots=16)
    bench.run(2 * S)
    polls = [tick for tick, kind, k in bench.on_air("POLL") if k == 7]
    assert max(b - a for a, b in itertools.pairwise(polls)) <= 32 + 28 + 4


def test_a_parked_slave_comes_back_with_the_next_beacon_if_a_place_is_free() -> None:
    bench = Bench(2, park_interval_slots=INTERVAL, park_window_slots=WINDOW)
    bench.ask(10 * SLOT, 0, Park(1))
    bench.ask(300 * SLOT, 0, Unpark(1))
    bench.send(320 * SLOT, 0, 1, b"refused", token=1)
    bench.send(600 * SLOT, 0, 1, b"down", token=2)
    bench.send(600 * SLOT, 1, 0, b"up", token=3)
    bench.run(1 * S)
    beacon_ends = 2 * INTERVAL * SLOT + 126_000
    assert bench.modes() == [
        (10 * SLOT, 0, 1, Mode.PARKED),
        (10 * SLOT, 1, 0, Mode.PARKED),
        (beacon_ends, 0, 1, Mode.ACTIVE),
        (beacon_ends, 1, 0, Mode.ACTIVE),
    ]
    assert [(token, outcome) for *_, token, outcome in bench.fates()] == [
        (1, Outcome.NO_LINK),
        (2, Outcome.DELIVERED),
        (3, Outcome.DELIVERED),
    ]
    assert [data for *_, data in bench.arrivals] == [b"down", b"up"]


def test_without_a_free_place_a_slave_stays_parked() -> None:
    bench = make(9)
    bench.ask(100 * SLOT, 0, Unpark(1))
    bench.run(1 * S)
    assert bench.modes()[-1] == (100 * SLOT, 0, 1, Mode.PARKED)
    assert len(bench.piconet.members()) == 7


def test_only_so_many_are_asked_back_as_there_are_places() -> None:
    bench = Bench(7, park_interval_slots=INTERVAL, park_window_slots=WINDOW, devices=9)
    park_and_join(bench, 2, 8)
    for slave in (1, 2):
        bench.ask(100 * SLOT, 0, Unpark(slave))
    bench.run(1 * S)
    assert bench.modes()[4:] == [
        (100 * SLOT, 0, 2, Mode.PARKED),
        (INTERVAL * SLOT + 126_000, 0, 1, Mode.ACTIVE),
        (INTERVAL * SLOT + 126_000, 1, 0, Mode.ACTIVE),
    ]


def test_parking_flushes_what_waits_on_either_side() -> None:
    bench = Bench(2, park_interval_slots=INTERVAL, park_window_slots=WINDOW)
    bench.outage(0, 5 * SLOT, (0, 1))
    bench.send(1, 0, 1, b"d", token=1)
    bench.send(1, 1, 0, b"u", token=2)
    bench.send(1, 0, 2, b"kept", token=3)
    bench.ask(6 * SLOT, 1, Park(0))
    bench.run(100 * MS)
    assert {token: outcome for *_, token, outcome in bench.fates()} == {
        1: Outcome.FLUSHED,
        2: Outcome.FLUSHED,
        3: Outcome.DELIVERED,
    }


@pytest.mark.parametrize(("way", "losers"), [((0, 1), [(0, 1), (1, 0)]), ((1, 0), [(0, 1)])])
def test_beacons_keep_parked_members_and_without_them_each_side_notices_for_itself(
    way: tuple[Address, Address], losers: list[tuple[Address, Address]]
) -> None:
    """A slave that hears nothing says nothing, so the master misses it as well; one that is not heard hears on."""
    bench = Bench(2, park_interval_slots=INTERVAL, park_window_slots=WINDOW, supervision=1 * S)
    bench.ask(10 * SLOT, 0, Park(1))
    last = 20 * INTERVAL * SLOT  # 3.2 s
    bench.outage(last + 1 * MS, last + 1 * S + 10 * MS, way)
    bench.run(8 * S)
    ends = last + 126_000  # of the last beacon that both have heard
    assert [lost for lost in bench.lost() if 1 in lost[1:]][: len(losers)] == [(ends + 1 * S, *pair) for pair in losers]


def test_a_parked_member_can_be_dismissed_and_the_beacons_end_with_the_last() -> None:
    bench = Bench(2, park_interval_slots=INTERVAL, park_window_slots=WINDOW)
    bench.ask(10 * SLOT, 0, Park(1))
    bench.kernel.at(300 * SLOT, lambda: bench.piconet.close(0, 1))
    bench.send(405 * SLOT, 0, BROADCAST, b"at once")
    bench.run(1 * S)
    assert [event for _, _, event in bench.news if isinstance(event, Lost)] == [Lost(1), Lost(0)]
    assert [tick for tick, kind, k in bench.on_air("NULL") if k == 0] == [2 * INTERVAL]
    assert [tick for tick, kind, k in bench.on_air("DM1")] == [812]
    assert not bench.piconet.linked(1)


def test_a_master_that_was_away_sends_its_beacon_in_the_next_window() -> None:
    bench = Bench(2, park_interval_slots=INTERVAL, park_window_slots=WINDOW)
    bench.ask(10 * SLOT, 0, Park(1))
    bench.kernel.at(200 * SLOT, bench.piconet.suspend)
    bench.kernel.at(300 * SLOT, bench.piconet.resume)
    bench.send(300 * SLOT, 0, 2)
    bench.run(1 * S)
    beacons = [tick for tick, kind, k in bench.on_air("NULL") if k == 0]
    assert beacons == [2 * INTERVAL * i for i in range(2, 7)]
    assert bench.on_air("DM1") == [(600, "DM1", 2)]


def test_nobody_is_parked_where_beacons_are_too_rare_for_supervision() -> None:
    bench = Bench(1, supervision=1 * S, park_interval_slots=1522)
    bench.ask(0, 0, Park(1))
    bench.run(10 * MS)
    assert bench.modes() == [(0, 0, 1, Mode.ACTIVE)]


def test_a_parked_slave_whose_radio_is_off_hears_nothing_and_its_master_notices() -> None:
    bench = Bench(2, park_interval_slots=INTERVAL, park_window_slots=WINDOW, supervision=1 * S)
    bench.ask(10 * SLOT, 0, Park(1))
    bench.kernel.at(20 * SLOT, lambda: bench.piconet.vanish(1))
    bench.send(100 * SLOT, 0, BROADCAST, b"all")
    bench.run(2 * S)
    assert [address for _, address, _ in bench.arrivals] == [2]
    assert bench.lost() == [(10 * SLOT + 1 * S, 0, 1)]
