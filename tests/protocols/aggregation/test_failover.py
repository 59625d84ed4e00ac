"""Hosts that fail: their searchers find another, are given work there, and nobody does what is known to be done.

Frames are passed by hand; bodies go straight where they want.
"""

import math
from collections.abc import Iterator

import pytest

from cosim.units import S
from protocols.aggregation.events import Departed, HostFailed, HostSuspected, HostTrusted, Joined
from protocols.aggregation.frames import posts_in
from protocols.aggregation.messages import Assign, Heartbeat, Hello, Join, Plans, Report
from tests.protocols.aggregation.team_scene import STRATEGIES, TARGETS_M, Flight, Point, Team

pytestmark = pytest.mark.slow

STARTS_M = [(9.5, 9.0), (10.5, 9.0), (9.5, 10.4), (10.0, 10.4), (10.5, 10.4), (10.0, 11.0)]
"""Two hosts; 2 and 4 are led by host 0, 3 and 5 by host 1."""
HIDDEN_M: Point = (-500.0, -500.0)
"""A target that is never found: the search goes on until all posts are visited, and on."""


def visited(team: Team) -> set[int]:
    """Return the posts that searchers have visited."""
    return {post for robot in range(2, len(team.machines)) for post in team.machines[robot].findings.visited}


def all_visited(team: Team) -> bool:
    return visited(team) == set(range(len(team.setup.ground.posts_m)))


def assignments(team: Team, host: int) -> Iterator[tuple[Flight, set[int]]]:
    """Yield what a host has told its members, with what others than that member had reported to it before."""
    done: dict[int, set[int]] = {robot: set() for robot in range(team.setup.size)}
    for flight in team.flights:
        message = flight.message
        if isinstance(message, Report) and flight.receiver == host:
            done[flight.source] = set(posts_in(message.visited))
        elif isinstance(message, Assign) and flight.source == host:
            yield flight, set().union(*(posts for robot, posts in done.items() if robot != flight.receiver))


def shared_posts(team: Team) -> set[int]:
    """Return the posts that a living host has given to two of its members at once."""
    twice: set[int] = set()
    for host in {0, 1} - team.down:
        machine, seen = team.machines[host], set[int]()
        for member in machine.team.roster.members.values():
            left = set(member.left(machine.findings.visited))
            twice |= left & seen
            seen |= left
    return twice


# ---------------------------------------------------------------- a host dies


@pytest.mark.parametrize("strategy", [each for each in STRATEGIES if each != "random"])
def test_the_searchers_of_a_dead_host_join_the_other_and_do_its_work(strategy: str) -> None:
    """One of them dies with it: what that one leaves undone is given to others."""
    team = Team(STARTS_M, strategy=strategy, targets=(HIDDEN_M,), camera_m=4.0)
    team.run(8.0)
    team.down |= {0, 4}
    team.run(200.0, lambda: all_visited(team) and team.members(1) >= {2, 3, 5})
    assert all_visited(team)
    assert team.members(1) == {2, 3, 5}
    assert {event.host for event in team.noted(Joined, 2)} == {1}
    given = {post for flight in team.said(Assign, 1) for post in flight.message.posts}  # type: ignore[union-attr]
    left = team.setup.regions[0] - team.machines[4].findings.visited - team.machines[2].findings.visited
    assert left <= given


@pytest.mark.parametrize("strategy", ["srp", "mi"])
@pytest.mark.parametrize("camera_m", [3.0, 4.0])
def test_nobody_is_sent_where_somebody_is_known_to_have_been_or_to_go(strategy: str, camera_m: float) -> None:
    team = Team(STARTS_M, strategy=strategy, targets=(HIDDEN_M,), camera_m=camera_m)
    team.run(8.0)
    team.down |= {0, 4}
    team.run(200.0, lambda: all_visited(team) or bool(shared_posts(team)))
    assert not shared_posts(team)
    told = [*assignments(team, 0), *assignments(team, 1)]
    assert len(told) > 4
    for flight, done in told:
        assert isinstance(flight.message, Assign)
        assert flight.message.posts
        assert not set(flight.message.posts) & done


@pytest.mark.parametrize("strategy", ["srp", "mrp", "mi", "mito"])
@pytest.mark.parametrize("camera_m", [3.0, 4.0, 6.0])
def test_as_long_as_nobody_fails_no_post_is_visited_twice(strategy: str, camera_m: float) -> None:
    team = Team(STARTS_M, strategy=strategy, targets=(HIDDEN_M,), camera_m=camera_m)
    team.run(200.0, lambda: all_visited(team))
    counts = sum(len(team.machines[robot].findings.visited) for robot in range(2, 6))
    assert counts == len(team.setup.ground.posts_m)


def test_the_first_of_two_orphans_leaves_work_for_the_second() -> None:
    """Their host has died before it could give them anything to do."""
    team = Team(STARTS_M, strategy="srp", targets=(HIDDEN_M,), camera_m=3.0)
    team.lost = lambda flight: isinstance(flight.message, Assign) and flight.source == 0
    team.run(6.0)
    team.down.add(0)
    team.run(100.0, lambda: {flight.receiver for flight in team.said(Assign, 1)} >= {2, 4})
    (first, second) = (team.said(Assign, 1, searcher)[0].message for searcher in (2, 4))
    assert isinstance(first, Assign)
    assert isinstance(second, Assign)
    assert set(first.posts) | set(second.posts) == team.setup.regions[0]
    assert abs(len(first.posts) - len(second.posts)) <= len(team.setup.regions[0]) // 2


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_the_search_ends_after_a_host_has_died(strategy: str) -> None:
    """All targets were found by searchers, also those that only the dead one knew of."""
    team = Team(STARTS_M, strategy=strategy, targets=TARGETS_M, camera_m=4.0)
    team.run(12.0)
    team.down.add(0)
    living = [team.machines[robot] for robot in (1, 2, 3, 4, 5)]
    team.run(600.0, lambda: all(machine.finished for machine in living))
    assert all(machine.finished for machine in living)
    assert team.machines[1].findings.targets.keys() == {0, 1, 2, 3}


def test_a_searcher_goes_to_the_nearest_of_its_neighbour_hosts() -> None:
    """Three hosts at rally points; that of host 0 fails while its searcher is in its region."""
    starts = [(9.5, 9.0), (10.5, 9.0), (10.0, 9.0), (9.5, 10.4), (10.0, 10.4), (10.5, 10.4)]
    team = Team(starts, hosts=3, strategy="srp", targets=(HIDDEN_M,))
    team.run(15.0)
    team.down.add(0)
    team.run(100.0, lambda: bool(team.noted(HostFailed, 3)))
    here = team.places_m[3]
    ways = {}
    for host in (1, 2):
        way_m = team.setup.ground.length_m(here, team.places_m[host])
        assert way_m is not None
        ways[host] = way_m
    assert abs(ways[1] - ways[2]) > 0.5
    team.run(60.0, lambda: bool(team.noted(Joined, 3)))
    assert team.noted(Joined, 3)[0].host == min(ways, key=lambda host: ways[host])


def test_if_the_first_neighbour_is_dead_too_the_searcher_tries_the_next() -> None:
    starts = [(9.5, 9.0), (10.5, 9.0), (10.0, 9.0), (9.5, 10.4), (10.0, 10.4), (10.5, 10.4)]
    team = Team(starts, hosts=3, strategy="srp", targets=(HIDDEN_M,))
    team.run(15.0)
    team.down |= {0, 1}
    team.run(300.0, lambda: team.members(2) >= {3, 4, 5})
    assert team.members(2) >= {3, 4, 5}
    assert {event.host for event in team.noted(HostFailed)} >= {0, 1}


def test_hosts_notice_that_one_of_them_is_gone_and_say_so() -> None:
    team = Team(STARTS_M, detector={"kind": "fixed", "timeout_s": 3.0})
    team.run(10.0)
    team.down.add(0)
    died = team.now
    team.run(6.0)
    ((at, _, event),) = [each for each in team.events if isinstance(each[2], HostSuspected)]
    assert event == HostSuspected(0)
    assert 2 * S < at - died <= 3 * S + S // 100
    beats = [flight.message for flight in team.said(Heartbeat, 1) if flight.at > at]
    assert beats
    assert all(isinstance(beat, Heartbeat) and beat.silent == (0,) for beat in beats)


# ---------------------------------------------------------------- a host out of the others' reach


def cut_off(team: Team) -> None:
    """Have no frame get from host to host."""
    team.lost = lambda flight: flight.source < 2 and flight.receiver < 2


@pytest.mark.parametrize("strategy", ["mrp", "mi", "mito"])
def test_a_host_out_of_reach_heads_for_the_last_middle_of_the_hosts_and_tells_its_searchers(strategy: str) -> None:
    team = Team(STARTS_M, strategy=strategy, targets=(HIDDEN_M,), reconvene_s=100.0, muster_s=1.0)
    team.held |= {2, 3, 4, 5}  # within reach
    team.run(8.0)
    cut_off(team)
    last = {host: team.said(Heartbeat, host, 1 - host)[-1].message for host in (0, 1)}
    team.run(8.0, lambda: len([each for each in team.noted(Departed) if each.astray]) == 2)
    here = team.places_m[0]
    told = last[1]
    assert isinstance(told, Heartbeat)
    middle = (here[0] + told.x_m) / 2.0, (here[1] + told.y_m) / 2.0
    team.run(3.0)
    plans = team.said(Plans, 0, 2)
    assert isinstance(plans[-1].message, Plans)
    assert math.dist(plans[-1].message.plans[0].way_m[-1], middle) < 0.5
    team.run(30.0)
    assert math.dist(team.places_m[0], middle) < 1.0
    assert all(flight.message.astray for flight in team.said(Heartbeat, 0) if flight.at > team.now - 5 * S)  # type: ignore[union-attr]


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_host_that_is_heard_again_is_taken_back_and_goes_on(strategy: str) -> None:
    team = Team(STARTS_M, strategy=strategy, targets=(HIDDEN_M,), reconvene_s=100.0)
    team.run(8.0)
    cut_off(team)
    team.run(10.0)
    assert team.machines[0].neighbours.silent == (1,)
    team.lost = lambda flight: False
    team.run(3.0)
    assert HostTrusted(1) in team.noted(HostTrusted, 0)[1:]
    for host in (0, 1):
        assert team.machines[host].neighbours.silent == ()
        beat = team.said(Heartbeat, host)[-1].message
        assert isinstance(beat, Heartbeat)
        assert beat.silent == ()
        assert not beat.astray
    if strategy != "srp":
        assert not team.noted(Departed, 0)[-1].astray


def test_a_static_host_stays_at_its_rally_point_when_it_hears_no_other() -> None:
    team = Team(STARTS_M, strategy="srp", targets=(HIDDEN_M,))
    team.run(20.0)
    here = team.places_m[0]
    cut_off(team)
    team.run(20.0)
    assert team.places_m[0] == here
    assert not any(event.astray for event in team.noted(Departed))


def test_two_hosts_that_have_each_listed_the_same_searcher_agree_once_they_hear_each_other() -> None:
    """The searcher changes to host 1 while the hosts cannot hear each other, and its farewells are lost."""
    team = Team(STARTS_M, strategy="mito", timeout_s_per_m2=0.005, targets=(HIDDEN_M,), lost_s=1000.0)
    team.held |= set(range(6))
    team.run(4.0)
    team.lost = lambda flight: {flight.source, flight.receiver} in ({0, 1}, {0, 2})
    team.run(30.0, lambda: 2 in team.members(1))
    assert 2 in team.members(0)
    assert 2 in team.members(1)
    team.run(3.0)
    assert team.said(Hello, 2, 1)
    team.lost = lambda flight: {flight.source, flight.receiver} == {0, 2}
    team.run(4.0)
    assert 2 not in team.members(0)
    assert 2 in team.members(1)
    assert len(team.said(Join, 2)) < 4
