"""Who is in whose sub-team: joining, leaving, and what becomes of confirmations that come late or not at all."""

from typing import Any

import pytest

from cosim.units import MS, S
from protocols.aggregation.events import MemberAdded, MemberRemoved
from protocols.aggregation.frames import bitmap, stamp
from protocols.aggregation.messages import (
    Assign,
    Confirm,
    Heartbeat,
    Hello,
    Join,
    Leave,
    Plan,
    Plans,
    Receipt,
    Report,
    Status,
    Stop,
    Stopped,
)
from tests.protocols.aggregation.team_scene import Alone, Flight, Said, Team

STARTS_M = [(9.5, 9.0), (10.5, 9.0), (9.5, 10.4), (10.0, 10.4), (10.5, 10.4)]
"""Two hosts, three searchers, close together: 2 and 4 are led by host 0, 3 by host 1."""


def beat(number: int, now: int, **more: Any) -> Heartbeat:
    """Return a heartbeat of a host that stands at its start and knows nothing."""
    plain = {"round": 0, "plan": 1, "found": 0, "visited": 0, "over": False, "syncing": False, "astray": False}
    return Heartbeat(number, stamp(now), 9.5, 9.0, **{**plain, "silent": (), **more})


def messages(said: list[Said], kind: type, to: int | None = None) -> list[Any]:
    """Return the messages of one kind."""
    return [each.message for each in said if isinstance(each.message, kind) and to in (None, each.destination)]


def hello(host: Alone, searcher: int, epoch: int, assignment: int = 0, plan: int = 0) -> list[Said]:
    """Have a host hear a searcher's hello."""
    return host.hears(searcher, Hello(epoch, 9.5, 10.4, assignment, plan))


# ---------------------------------------------------------------- the searcher's side


def forsaken(**changes: Any) -> Alone:
    """Return searcher 2 at its host's place, after it has given host 0 up: it has found a target meanwhile."""
    searcher = Alone(2, STARTS_M, strategy="mi", targets=((9.5, 13.0),), **changes)
    plan = Plan(0, 1, stamp(0), 1.0, ((9.5, 9.0),))
    other = Plan(1, 1, stamp(0), 1.0, ((10.5, 9.0),))
    searcher.hears(0, Plans((plan, other)))
    searcher.passes(3.0 + 4.0 + 2.5)
    assert searcher.machine.state.value == "change"
    return searcher


def test_a_searcher_that_hears_nothing_close_to_where_its_host_must_be_gives_it_up() -> None:
    searcher = Alone(2, STARTS_M, strategy="mi", targets=((9.5, 13.0),))
    searcher.hears(0, Plans((Plan(0, 1, 0, 1.0, ((9.5, 9.0),)),)))
    searcher.passes(2.6)
    assert searcher.machine.state.value == "meet"
    searcher.passes(3.8)
    assert searcher.machine.state.value == "meet"
    searcher.passes(0.4)
    assert searcher.machine.state.value == "change"


def test_it_asks_no_other_host_as_long_as_it_hears_its_own() -> None:
    searcher = Alone(2, STARTS_M)
    assert messages(searcher.hears(1, beat(1, searcher.now)), Join) == []
    searcher.passes(2.0)
    assert messages(searcher.hears(1, beat(2, searcher.now)), Join) == []


def test_it_asks_the_next_host_that_it_hears_again_and_again_with_one_epoch_until_it_is_taken() -> None:
    searcher = forsaken()
    epochs = []
    for number in range(3):
        (join,) = messages(searcher.hears(1, beat(number, searcher.now)), Join, to=1)
        epochs.append(join.epoch)
        searcher.passes(1.0)
    assert len(set(epochs)) == 1
    assert epochs[0] > 0
    searcher.hears(1, Confirm(epochs[0]))
    said = searcher.hears(1, beat(3, searcher.now))
    assert messages(said, Join) == []
    assert messages(said, Hello)[0].epoch == epochs[0]


def test_a_new_host_is_told_all_that_the_old_one_knew_already() -> None:
    searcher = Alone(2, STARTS_M, strategy="mi", targets=((9.5, 13.0),))
    (report,) = messages(searcher.hears(0, beat(0, 0)), Report)
    searcher.hears(0, Receipt(report.number))
    assert messages(searcher.hears(0, beat(1, S)), Report) == []
    searcher.passes(3.0 + 4.0 + 2.5)
    (join,) = messages(searcher.hears(1, beat(0, searcher.now)), Join)
    searcher.hears(1, Confirm(join.epoch))
    (again,) = messages(searcher.hears(1, beat(1, searcher.now)), Report)
    assert again.targets == report.targets
    assert report.targets
    assert again.epoch == join.epoch


def test_the_host_that_it_has_left_is_told_so_when_it_is_heard_again() -> None:
    searcher = forsaken()
    (join,) = messages(searcher.hears(1, beat(0, searcher.now)), Join)
    searcher.hears(1, Confirm(join.epoch))
    said = searcher.hears(0, beat(50, searcher.now))
    assert messages(said, Leave, to=0) == [Leave(join.epoch)]
    assert messages(said, Hello) == messages(said, Report) == []


def test_a_confirmation_of_who_was_not_asked_changes_nothing() -> None:
    searcher = Alone(2, STARTS_M)
    searcher.hears(1, Confirm(9))
    assert messages(searcher.hears(0, beat(1, searcher.now)), Hello)[0].epoch == 0
    assert messages(searcher.hears(1, beat(1, searcher.now)), Hello) == []
    assert messages(searcher.hears(1, beat(2, searcher.now)), Leave, to=1)


def test_a_confirmation_with_another_epoch_than_asked_for_changes_nothing() -> None:
    searcher = forsaken()
    (join,) = messages(searcher.hears(1, beat(0, searcher.now)), Join)
    searcher.hears(1, Confirm(join.epoch - 1))
    assert messages(searcher.hears(1, beat(1, searcher.now)), Hello) == []


def test_a_searcher_that_has_booted_asks_whom_it_hears_and_outdoes_what_it_was_before() -> None:
    searcher = Alone(2, STARTS_M, start=40 * S)
    (join,) = messages(searcher.hears(1, beat(40, searcher.now)), Join, to=1)
    assert join.epoch >= 40
    searcher.hears(1, Confirm(join.epoch))
    assert messages(searcher.hears(1, beat(41, searcher.now)), Hello)


def test_who_is_near_another_host_that_its_own_is_missed_by_asks_that_one() -> None:
    """Out of contact with its own; while it is in contact, what others miss is nothing to it."""
    searcher = Alone(2, STARTS_M)
    assert messages(searcher.hears(1, beat(1, searcher.now, silent=(0,))), Join) == []
    searcher.passes(2.7)
    assert messages(searcher.hears(1, beat(2, searcher.now, silent=(0,))), Join, to=1)


def test_a_searcher_stops_at_the_word_of_any_host_and_says_so_each_time() -> None:
    searcher = Alone(2, STARTS_M)
    assert not searcher.machine.finished
    assert messages(searcher.hears(1, Stop()), Stopped, to=1)
    assert searcher.machine.finished
    assert messages(searcher.hears(0, Stop()), Stopped, to=0)


# ---------------------------------------------------------------- the host's side


def leader(**changes: Any) -> Alone:
    """Return host 0."""
    return Alone(0, STARTS_M, **changes)


def news(*members: tuple[int, int]) -> Status:
    return Status((), b"", members, Plan(1, 1, 0, 1.0, ((10.5, 9.0),)))


def test_a_host_confirms_whom_it_takes_in_and_gives_it_work() -> None:
    host = leader()
    said = host.hears(3, Join(5, 10.0, 10.4))
    assert messages(said, Confirm, to=3) == [Confirm(5)]
    assert host.noted[-1] == MemberAdded(3, 5)
    hello(host, 2, 0)
    host.hears(2, Leave(0))  # its posts are free now
    (assign,) = messages(hello(host, 3, 5), Assign, to=3)
    assert assign.epoch == 5
    assert assign.posts


def test_a_lost_confirmation_is_repeated_when_the_searcher_asks_again() -> None:
    host = leader()
    host.hears(3, Join(5, 10.0, 10.4))
    assert messages(host.hears(3, Join(5, 10.0, 10.4)), Confirm) == [Confirm(5)]
    assert host.noted.count(MemberAdded(3, 5)) == 1


def test_a_hello_of_one_that_takes_itself_for_a_member_is_enough_to_be_one() -> None:
    host = leader(start=S)
    host.looks()
    hello(host, 2, 0)
    assert MemberAdded(2, 0) in host.noted


@pytest.mark.parametrize(("claimed", "struck"), [(1, True), (0, False)])
def test_the_newer_epoch_wins_when_another_host_lists_the_same_searcher(claimed: int, struck: bool) -> None:
    host = leader()
    host.hears(1, news((2, claimed)), radio=1)
    assert (MemberRemoved(2, "joined another") in host.noted) == struck
    assert bool(messages(hello(host, 2, 0), Assign)) != struck


def test_a_host_that_another_one_knows_better_of_gives_no_receipts() -> None:
    host = leader()
    host.hears(1, news((2, 3)), radio=1)
    assert messages(host.hears(2, Report(1, 0, (), b"")), Receipt) == []
    assert messages(host.hears(2, Report(2, 4, (), b"")), Receipt) == [Receipt(2)]


def test_an_old_leave_does_not_strike_off_who_has_joined_since() -> None:
    host = leader()
    host.hears(2, Join(6, 10.0, 10.4))
    host.hears(2, Leave(5))
    assert not [event for event in host.noted if isinstance(event, MemberRemoved)]
    host.hears(2, Leave(6))
    assert MemberRemoved(2, "left") in host.noted


def test_who_is_not_heard_for_long_is_struck_off_and_its_posts_are_given_to_others() -> None:
    host = leader(lost_s=20.0, hosts=1)
    region = host.setup.regions[0]
    (first,) = messages(hello(host, 2, 0), Assign)
    for _ in range(25):
        host.passes(1.0)
        hello(host, 2, 0, assignment=1)
    assert MemberRemoved(4, "lost") in host.noted
    assert MemberRemoved(2, "lost") not in host.noted
    host.hears(2, Report(1, 0, (), bitmap(first.posts, 64)))
    (second,) = messages(hello(host, 2, 0, assignment=1), Assign)
    assert set(first.posts) | set(second.posts) == region
    assert not set(first.posts) & set(second.posts)


def test_who_comes_back_after_it_was_struck_off_is_given_something_new() -> None:
    """The number of what it was given last is that which the host begins with: it may not be taken for the same."""
    host = leader(lost_s=20.0, hosts=1)
    (first,) = messages(hello(host, 2, 0), Assign)
    host.passes(25.0)
    assert MemberRemoved(2, "lost") in host.noted
    said = hello(host, 2, 0, assignment=first.number)
    (again,) = messages(said, Assign)
    assert again.number != first.number
    assert messages(hello(host, 2, 0, assignment=again.number), Assign) == []


# ---------------------------------------------------------------- what may not happen


def test_who_returns_to_its_host_after_another_has_listed_it_is_not_ignored() -> None:
    """The confirmation was lost, the own host is heard again: one of them must lead it within seconds."""
    team = Team(STARTS_M, strategy="mito", timeout_s_per_m2=0.005, targets=((19.0, 19.0),))
    team.held |= {0, 1, 3, 4}
    team.run(5.0)
    team.lost = lambda flight: (flight.source, flight.receiver) == (0, 2) or isinstance(flight.message, Confirm)
    team.run(60.0, lambda: bool(team.said(Join, 2, 1)))
    team.run(0.5)
    assert team.said(Join, 2, 1)
    assert 2 in team.members(1)
    team.held.add(2)
    team.lost = lambda flight: False
    team.run(15.0)
    assert [2 in team.members(host) for host in (0, 1)].count(True) == 1
    before = len(team.said(Receipt, None, 2))
    team.machines[2].findings.visit((1,))
    team.run(3.0)
    assert len(team.said(Receipt, None, 2)) > before


def test_confirmations_that_take_longer_than_heartbeats_lead_to_one_sub_team_in_the_end() -> None:
    """A searcher without a host between two hosts: what one confirms comes after the other has been asked."""
    team = Team(STARTS_M, strategy="mi", targets=((19.0, 19.0),))
    team.held |= {0, 1, 2, 3, 4}
    team.down.add(2)
    team.run(5.0)

    def slowly(flight: Flight) -> int:
        return 900 * MS if isinstance(flight.message, Confirm) else MS

    team.delay = slowly
    team.reboot(2)
    team.run(15.0)
    host = team.machines[2].membership.host
    assert host is not None
    assert [2 in team.members(each) for each in (0, 1)].count(True) == 1
    assert 2 in team.members(host)


@pytest.mark.parametrize("booted", [False, True])
def test_a_searcher_between_two_hosts_that_are_over_is_stopped_at_once(booted: bool) -> None:
    team = Team(STARTS_M, strategy="mi", targets=((9.5, 12.0),))
    team.held |= {0, 1, 2, 3, 4}
    if booted:
        team.run(1.0)
        team.reboot(3)
    team.run(12.0, lambda: all(machine.finished for machine in team.machines))
    assert all(machine.finished for machine in team.machines)
    assert team.now < 10 * S
    assert len(team.said(Join)) <= 3
