"""Sniff over Low Energy: a link's events become rarer, and as frequent as before, by connection updates on the air."""

from itertools import pairwise
from typing import Any

import pytest

from cosim.channels.ble.connections.anchors import Anchors
from cosim.channels.clock import NativeClock
from cosim.channels.energy import TRANSMIT
from cosim.machine import Lost, Mode, ModeChanged, Scan, Sniff
from cosim.trace import TRANSMISSIONS
from cosim.units import MS, US, S, Time
from tests.channels.ble.ble_field import Field

DRIFT: Time = 2 * 20 * 4_000 + 1
"""ns by which intervals of up to 4 s differ at most, by both ends' clocks."""


def recorded(size: int, **settings: Any) -> Field:
    return Field(size, tables=[TRANSMISSIONS], idle_frames=True, **settings)


def begins(field: Field, peripheral: int, since: Time, until: Time) -> list[Time]:
    """Return when device 0 has sent the first packets of events of its link to *peripheral* in [since, until)."""
    told = field.trace.columns(TRANSMISSIONS.name)
    rows = zip(told["time_ns"], told["source"], told["destination"], strict=True)
    times = [at for at, source, to in rows if source == 0 and to == peripheral and since <= at < until]
    return [at for before, at in pairwise([since - S, *times]) if at - before > 5 * MS]


def changes(field: Field, by: int, peer: int, slots: int, wait: Time = 6 * S) -> list[tuple[int, ModeChanged]]:
    """Have *by* ask for an interval of so many *slots*; return who is told of what mode, in order."""
    before = len(field.news)
    field.do(by, Sniff(peer, slots, 0, 2))
    field.until(field.kernel.now + wait)
    return [(each.address, each.what) for each in field.news[before:] if isinstance(each.what, ModeChanged)]


def both(mode: Mode) -> list[tuple[int, ModeChanged]]:
    return [(0, ModeChanged(1, mode)), (1, ModeChanged(0, mode))]


@pytest.mark.parametrize(("slots", "interval"), [(480, 300 * MS), (100, 60 * MS), (6400, 3_990 * MS)])
def test_events_become_rarer_and_frequent_again_and_both_hosts_hear_of_it(slots: int, interval: Time) -> None:
    field = recorded(2)
    field.link(0, 1)
    assert changes(field, 0, 1, slots) == both(Mode.SNIFF)
    since = field.kernel.now
    field.until(since + 12 * S)
    rare = begins(field, 1, since, since + 12 * S)
    assert len(rare) in (12 * S // interval, 12 * S // interval + 1)
    assert all(abs(later - earlier - interval) < DRIFT for earlier, later in pairwise(rare))
    field.send(0, 1, b"down")
    field.send(1, 0, b"up")
    field.until(field.kernel.now + 8 * S)
    assert field.arrived(1) == [b"down"]
    assert field.arrived(0) == [b"up"]
    assert changes(field, 0, 1, 0, 40 * S) == both(Mode.ACTIVE)  # that takes 7 events of 4 s
    since = field.kernel.now
    field.until(since + 3 * S)
    assert len(begins(field, 1, since, since + 3 * S)) == 100


def test_who_cannot_change_an_interval_hears_at_once_what_it_is() -> None:
    field = Field(3)
    field.link(0, 1)
    assert changes(field, 1, 0, 480) == [(1, ModeChanged(0, Mode.ACTIVE))]  # centrals announce changes
    assert changes(field, 0, 2, 480) == [(0, ModeChanged(2, Mode.NONE))]
    assert changes(field, 0, 1, 40) == [(0, ModeChanged(1, Mode.ACTIVE))]  # 25 ms: less than it has
    assert changes(field, 0, 1, 8000) == [(0, ModeChanged(1, Mode.ACTIVE))]  # 5 s: more than there is
    field.do(0, Sniff(1, 480, 0, 2))
    assert changes(field, 0, 1, 960) == [(0, ModeChanged(1, Mode.ACTIVE)), *both(Mode.SNIFF)]
    assert changes(field, 1, 0, 0) == [(1, ModeChanged(0, Mode.SNIFF))]


@pytest.mark.parametrize(
    ("first_s", "slots", "interval", "timeout"),
    [(0.5, 1600, 990 * MS, 1990 * MS), (4.0, 480, 300 * MS, 4 * S)],
    ids=["two intervals", "as long as before"],
)
def test_a_link_with_rare_events_is_watched_for_as_long_or_longer(
    first_s: float, slots: int, interval: Time, timeout: Time
) -> None:
    field = Field(2, connection={"supervision_s": first_s})
    field.link(0, 1)
    changes(field, 0, 1, slots, 20 * S)
    field.until(field.kernel.now + 60 * S)
    assert not field.of(0, Lost) + field.of(1, Lost)
    gone = field.kernel.now
    field.channel.power(1, False)
    field.until(gone + 5 * S)
    (lost,) = field.of(0, Lost)
    assert timeout - interval < lost.time - gone <= timeout + DRIFT


def test_links_of_one_central_keep_out_of_each_others_way() -> None:
    field = recorded(4, connection={"interval_s": 0.03, "links": 3})
    field.link(0, 1, 2, 3)
    changes(field, 0, 2, 480)
    changes(field, 0, 3, 144)
    since = field.kernel.now
    field.until(since + 9 * S)
    assert [len(begins(field, peer, since, since + 9 * S)) for peer in (1, 2, 3)] == [300, 30, 100]
    every = sorted(at for peer in (1, 2, 3) for at in begins(field, peer, since, since + 9 * S))
    assert min(later - earlier for earlier, later in pairwise(every)) > 9 * MS


def test_hosts_cannot_tell_whether_a_link_rests_in_between() -> None:
    told = []
    for settings in ({}, {"idle_frames": True}):  # what writes all polls down does not rest
        field = Field(3, tables=[TRANSMISSIONS], **settings)
        field.link(0, 1, 2)
        for at, slots in enumerate((480, 0, 960, 96, 0)):
            field.do(0, Sniff(1, slots, 0, 2), Sniff(2, 2 * slots, 0, 2))
            field.until(field.kernel.now + 3 * S + at * 7 * MS)
            field.send(0, 1, bytes([at]))
            field.send(2, 0, bytes(300))
            field.until(field.kernel.now + 9 * S)
        told.append(field.news)
    assert told[0] == told[1]
    assert len(told[0]) > 25


def test_rare_events_take_less_of_a_radio() -> None:
    field = Field(2, energy="states")
    field.link(0, 1)
    field.do(0, Scan(False))
    for slots, interval in ((0, 30 * MS), (480, 300 * MS)):
        changes(field, 0, 1, slots)
        before = _sent(field)
        field.until(field.kernel.now + 30 * S)
        polls = (_sent(field) - before) / (80 * US)
        assert abs(polls - 30 * S / interval) <= 1


def _sent(field: Field) -> Time:
    """Return how long device 0 has sent."""
    assert field.channel.accounts is not None
    uses = field.channel.accounts.uses(0, field.kernel.now)
    return sum(time for use, time in uses.items() if use.state == TRANSMIT)


def test_earlier_anchors_are_those_of_before() -> None:
    clock = NativeClock(0)
    anchors = Anchors(0, 5 * MS, 30 * MS).updated(10, 0, 90 * MS)
    assert [anchors.at(event) for event in (8, 9, 10, 11)] == [245 * MS, 275 * MS, 305 * MS, 395 * MS]
    times = [245 * MS, 245 * MS + 1, 275 * MS + 1, 305 * MS, 305 * MS + 1, 395 * MS + 1]
    assert [anchors.first_from(clock, time) for time in times] == [8, 9, 10, 10, 11, 12]
