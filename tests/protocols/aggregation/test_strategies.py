"""Where hosts go by their strategy, and how searchers find them: by radio, by sight, or by the plan they were told."""

import math

import pytest

from cosim.units import S, Time
from protocols.aggregation.course import course_of
from protocols.aggregation.events import Departed, Reconvened
from protocols.aggregation.frames import stamp
from protocols.aggregation.messages import Assign, Finding, Heartbeat, Hello, Plan, Plans, Report
from protocols.aggregation.strategies import Strategy
from tests.protocols.aggregation.team_scene import STRATEGIES, TARGETS_M, Alone, Point, Team

pytestmark = pytest.mark.slow

STARTS_M = [(9.5, 9.0), (10.5, 9.0), (9.5, 10.4), (10.0, 10.4), (10.5, 10.4)]
"""Two hosts, three searchers, close together: 2 and 4 are led by host 0, 3 by host 1."""
HIDDEN_M: Point = (-500.0, -500.0)


# ---------------------------------------------------------------- the mobile rally point


def reconvening(**changes: object) -> Team:
    team = Team(STARTS_M, strategy="mrp", targets=(HIDDEN_M,), reconvene_s=12.0, **changes)
    team.run(90.0)
    return team


def test_a_mobile_rally_point_stands_while_it_synchronises() -> None:
    team = reconvening()
    for host in (0, 1):
        beats = {flight.at: flight.message for flight in team.said(Heartbeat, host)}
        standing: dict[int, set[Point]] = {}
        moving: dict[int, set[Point]] = {}
        for beat in beats.values():
            assert isinstance(beat, Heartbeat)
            (standing if beat.syncing else moving).setdefault(beat.round, set()).add((beat.x_m, beat.y_m))
        assert len(standing) >= 3
        assert all(len(places) == 1 for places in standing.values())
        assert len(moving[0]) > 3


def test_it_waits_until_all_have_reported_or_for_so_long() -> None:
    team = reconvening()
    assert {event.missing for event in team.noted(Reconvened)} == {0}
    late = Team(STARTS_M, strategy="mrp", targets=(HIDDEN_M,), reconvene_s=12.0, sync_s=6.0)
    late.run(4.0)
    late.down.add(2)
    late.run(40.0)
    first = next((at, event) for at, robot, event in late.events if isinstance(event, Reconvened) and robot == 0)
    assert first[1].missing == 1
    assert 3.0 + 12.0 + 6.0 <= first[0] / S <= 3.0 + 12.0 + 6.0 + 0.3


def test_each_reconvening_point_lies_farther_along_the_way_to_the_far_end() -> None:
    team = reconvening(rounds=4)
    for host in (0, 1):
        far = Strategy(team.parameters, team.setup, host).far_m
        region = [team.setup.ground.posts_m[post] for post in team.setup.regions[host]]
        middle = (STARTS_M[0][0] + STARTS_M[1][0]) / 2.0, (STARTS_M[0][1] + STARTS_M[1][1]) / 2.0
        assert math.dist(far, middle) == max(math.dist(post, middle) for post in region)
        ends = []
        for flight in team.said(Plans, host):
            assert isinstance(flight.message, Plans)
            end = flight.message.plans[0].way_m[-1]
            if end not in ends:
                ends.append(end)
        left = [team.setup.ground.length_m(end, far) or 0.0 for end in ends[:4]]
        rally = Strategy(team.parameters, team.setup, host).rally_m
        assert len(left) == 4
        assert left[-1] < 0.5
        to_rally = team.setup.ground.length_m(STARTS_M[host], rally) or 0.0
        onward = team.setup.ground.length_m(rally, far) or 0.0
        route = to_rally + onward
        gone = [team.setup.ground.length_m(STARTS_M[host], end) or 0.0 for end in ends[:4]]
        assert all(way <= route * (k + 1) / 4 + 0.6 for k, way in enumerate(gone))
        assert gone == sorted(gone) or left == sorted(left, reverse=True)


def test_hosts_are_within_long_range_whenever_they_synchronise() -> None:
    team = reconvening(long_m=14.0)
    places: dict[int, dict[int, Point]] = {0: {}, 1: {}}
    for flight in team.said(Heartbeat):
        beat = flight.message
        assert isinstance(beat, Heartbeat)
        if beat.syncing:
            places[flight.source][beat.round] = beat.x_m, beat.y_m
    assert len(places[0]) >= 4
    for here in places[0].values():
        assert all(math.dist(here, there) <= 14.0 for there in places[1].values())
    for each in (*places[0].values(), *places[1].values()):
        assert math.dist(each, (10.0, 9.0)) <= 0.95 * 7.0 + 0.1  # the middle of the hosts' starts


def test_the_searchers_go_on_with_their_tours_after_a_meeting() -> None:
    team = reconvening(camera_m=3.0)
    changes = [(at, event) for at, robot, event in team.events if robot == 2 and hasattr(event, "errand")]
    met = [at for at, event in changes if event.why in ("due", "done")]
    resumed = [at for at, event in changes if event.errand == "search"]
    assert any(later > met[0] for later in resumed)
    first = next(at for at, robot, event in team.events if isinstance(event, Reconvened) and robot == 0)
    again = min(at for at in resumed if at > first)
    assert again - first <= 1.2 * S  # with the first heartbeat that tells the new plan


# ---------------------------------------------------------------- the others


def test_a_static_host_tells_one_way_and_its_end_is_where_it_stays() -> None:
    team = Team(STARTS_M, strategy="srp", targets=(HIDDEN_M,))
    team.run(40.0)
    for host in (0, 1):
        (departed,) = team.noted(Departed, host)
        assert not departed.astray
        plans = [flight.message.plans[0] for flight in team.said(Plans, host)]  # type: ignore[union-attr]
        assert math.dist(plans[-1].way_m[-1], team.places_m[host]) < 0.3
        region = [team.setup.ground.posts_m[post] for post in team.setup.regions[host]]
        middle = sum(x for x, _ in region) / len(region), sum(y for _, y in region) / len(region)
        posts = team.setup.ground.posts_m
        assert math.dist(plans[-1].way_m[-1], middle) == pytest.approx(
            min(math.dist(post, middle) for post in posts), abs=1e-3
        )


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_hosts_go_where_their_plans_have_them(strategy: str) -> None:
    """Bodies here go straight to where they are sent: what is left is the ways' and the orders' own error."""
    team = Team(STARTS_M, strategy=strategy, targets=(HIDDEN_M,))
    plans: dict[int, Plan] = {}
    seen = 0
    for _ in range(300):
        team.run(0.1)
        for flight in team.flights[seen:]:
            if isinstance(flight.message, Plans):
                plans[flight.source] = flight.message.plans[0]
        seen = len(team.flights)
        for host, plan in plans.items():
            course = course_of(plan, team.now)
            if team.now >= course.departed + S:
                assert math.dist(course.place(team.now), team.places_m[host]) <= 4.5


def test_the_integrators_host_follows_its_searchers_into_another_region() -> None:
    """One of three hosts and its searcher have died: their posts are given out, and the searchers' middle is there."""
    starts = [*STARTS_M[:2], (10.0, 9.0), *STARTS_M[2:]]
    team = Team(starts, hosts=3, strategy="mi", targets=(HIDDEN_M,), camera_m=3.0)
    team.run(6.0)
    team.down |= {1, 4}
    team.run(100.0, lambda: any(flight.at > 12 * S for host in (0, 2) for flight in team.said(Assign, host)))
    heir = next(flight.source for flight in team.said(Assign) if flight.at > 12 * S)
    before = len(team.noted(Departed, heir))
    team.run(40.0)
    assert len(team.noted(Departed, heir)) > before
    assert not any(event.astray for event in team.noted(Departed))


def test_a_finder_at_random_says_what_a_finder_of_the_integrator_says_byte_for_byte() -> None:
    """The same heartbeats, receipts and places; only where they want to go differs."""
    alike = [Alone(2, STARTS_M, strategy=strategy, targets=((9.5, 13.0), HIDDEN_M)) for strategy in ("mi", "random")]
    for number in range(3):
        beat = Heartbeat(number, stamp(alike[0].now), 9.5, 9.0, 0, 1, 0, 0, False, False, False, ())
        said = [each.hears(0, beat, broadcast=True) for each in alike]
        assert said[0] == said[1]
        assert any(isinstance(one.message, Report) for one in said[0])
        assert [type(one.message) for one in said[0]][-1] is Hello
        for each in alike:
            each.passes(1.0)


# ---------------------------------------------------------------- radio, sight, prediction


def leaving(plan: Plan, **changes: object) -> Alone:
    """Return searcher 2, out of contact with host 0 and done with its tour, which is on its way to meet it."""
    searcher = Alone(2, STARTS_M, strategy="mi", targets=(HIDDEN_M,), **changes)
    searcher.hears(0, Plans((plan,)))
    searcher.passes(3.0)
    assert searcher.machine.state.value == "meet"
    return searcher


STANDING = Plan(0, 1, 0, 1.0, ((3.0, 3.0),))
"""A host that stays at one place."""


def test_without_radio_or_sight_it_goes_where_the_plan_has_the_host() -> None:
    searcher = leaving(STANDING, suspect_s=100.0)
    searcher.passes(20.0, walks=True)
    assert math.dist(searcher.here, (3.0, 3.0)) < 0.5


def test_sight_leads_to_a_host_that_is_not_where_its_plan_says() -> None:
    searcher = leaving(STANDING)
    elsewhere = (16.0, 9.5)
    for _ in range(60):
        searcher.now += S // 10
        searcher.looks(searcher._next(), seen=[(0, *elsewhere)])
    assert math.dist(searcher.here, elsewhere) < 1.0


def test_who_is_seen_beyond_the_reach_of_recognition_is_not_taken_for_the_host() -> None:
    searcher = leaving(STANDING, vision_m=3.0)
    for _ in range(60):
        searcher.now += S // 10
        searcher.looks(searcher._next(), seen=[(0, 16.0, 9.5)])
    assert math.dist(searcher.here, (3.0, 3.0)) < 2.0


def test_another_robot_in_sight_is_not_the_host() -> None:
    searcher = leaving(STANDING)
    for _ in range(80):
        searcher.now += S // 10
        searcher.looks(searcher._next(), seen=[(1, 16.0, 9.5)])
    assert math.dist(searcher.here, (3.0, 3.0)) < 2.0


def test_it_stops_as_soon_as_it_hears_its_host_whatever_it_sees() -> None:
    searcher = leaving(STANDING)
    searcher.passes(2.0, walks=True)
    searcher.hears(0, Heartbeat(9, stamp(searcher.now), 3.0, 3.0, 0, 1, 0, 0, False, False, False, ()))
    searcher.passes(0.1, walks=True)
    here = searcher.here
    searcher.passes(2.0, walks=True)
    assert math.dist(searcher.here, here) < 0.3
    assert math.dist(here, (3.0, 3.0)) > 3.0


def test_a_moving_host_is_met_ahead_and_not_where_it_is_now() -> None:
    """It goes along y = 3 to the right: to head for where it is now would be a chase."""
    now: Time = 3 * S
    plan = Plan(0, 1, stamp(now), 0.5, ((3.0, 3.0), (9.0, 3.0)))
    searcher = leaving(plan, suspect_s=100.0)
    searcher.passes(0.3)
    searcher.passes(14.0, walks=True)
    course = course_of(plan, searcher.now)
    assert math.dist(searcher.here, course.place(searcher.now)) < 1.5


def test_a_host_that_was_heard_a_moment_ago_has_not_failed() -> None:
    """It is heard for a moment every 3.5 s, and takes no reports: not 4 s of silence in one piece."""
    searcher = leaving(STANDING, suspect_s=4.0)
    searcher.here = (3.0, 3.0)
    for number in range(8):
        searcher.hears(0, Heartbeat(number, stamp(searcher.now), 3.0, 3.0, 0, 1, 0, 0, False, False, False, ()))
        searcher.passes(3.5)
        assert searcher.machine.state.value == "meet"
    searcher.passes(6.0)
    assert searcher.machine.state.value == "change"


def test_findings_reach_the_host_as_they_were_seen() -> None:
    team = Team(STARTS_M, strategy="srp", targets=TARGETS_M)
    team.run(120.0, lambda: all(machine.finished for machine in team.machines))
    for number, finding in team.machines[0].findings.targets.items():
        assert finding == Finding(number, *TARGETS_M[number])
