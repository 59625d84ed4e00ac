"""SRP by section VII.B: finds wait for "the static integration time"; where a searcher has been does not."""

import math
from functools import cache
from itertools import pairwise
from typing import Any

import pytest

from cosim.units import S, Time
from protocols.aggregation.events import ErrandChanged
from protocols.aggregation.findings import Findings, Reports
from protocols.aggregation.frames import bitmap, posts_in, stamp
from protocols.aggregation.messages import Assign, Finding, Heartbeat, Plan, Plans, Receipt, Report
from tests.protocols.aggregation import team_scene
from tests.protocols.aggregation.team_scene import Alone, Point, Run, Said, Team, ideal_radios, run

STARTS_M = [(9.5, 9.0), (10.5, 9.0), (9.5, 10.4), (10.0, 10.4), (10.5, 10.4)]
"""Two hosts, three searchers, close together: 2 and 4 are led by host 0, 3 by host 1."""
HIDDEN_M: Point = (-500.0, -500.0)
SEEN_M: Point = (9.5, 13.0)
"""A target that is in view of searcher 2 from the start."""
STANDING = Plan(0, 1, 0, 1.0, ((9.5, 9.0),))
"""Host 0 stays where it starts."""


def searching(integrate_s: float = 30.0, start: Time = 0, **changes: Any) -> Alone:
    """Return searcher 2, which has found a target, has a tour of two posts, and stays where it is."""
    options = {"targets": (SEEN_M, HIDDEN_M), "strategy": "srp", "report": "appointed", "suspect_s": 1000.0, **changes}
    options["muster_s"] = 0.1
    searcher = Alone(2, STARTS_M, start, integrate_s=integrate_s, **options)
    searcher.hears(0, Plans((STANDING,)))
    searcher.hears(0, Assign(0, 1, (0, 1)))
    return searcher


def beat(searcher: Alone, number: int) -> list[Said]:
    """Have it hear a heartbeat of its host; return what it says."""
    return searcher.hears(0, Heartbeat(number, stamp(searcher.now), 9.5, 9.0, 0, 1, 0, 0, False, False, False, ()))


def reports(said: list[Said]) -> list[Report]:
    return [each.message for each in said if isinstance(each.message, Report)]


def errands(searcher: Alone) -> list[tuple[str, str]]:
    return [(each.errand, each.why) for each in searcher.noted if isinstance(each, ErrandChanged)]


# ---------------------------------------------------------------- one searcher


def test_in_contact_before_the_time_it_tells_where_it_has_been_and_not_what_it_has_found() -> None:
    searcher = searching()
    searcher.machine.findings.visit([3])
    (early,) = reports(beat(searcher, 0))
    assert (early.targets, list(posts_in(early.visited))) == ((), [3])
    searcher.hears(0, Receipt(early.number))
    searcher.passes(1.0)
    assert reports(beat(searcher, 1)) == []  # there is nothing that the host may know and does not


def test_in_contact_at_the_time_it_tells_what_it_has_found() -> None:
    searcher = searching()
    told: dict[float, tuple[Finding, ...]] = {}
    for number in range(32):
        for report in reports(beat(searcher, number)):
            told[searcher.now / S] = report.targets
            searcher.hears(0, Receipt(report.number))
        searcher.passes(1.0)
    assert told == {0.0: (), 30.0: (Finding(0, *SEEN_M),)}


def test_a_finder_out_of_contact_stays_on_its_tour_until_the_time_and_then_goes_to_the_rally_point() -> None:
    searcher = searching()
    searcher.passes(29.9)
    assert errands(searcher) == [("search", "work")]
    searcher.passes(0.1)
    assert errands(searcher) == [("search", "work"), ("meet", "due")]


@pytest.mark.parametrize("targets", [(SEEN_M, HIDDEN_M), (HIDDEN_M,)], ids=["a finder", "empty-handed"])
def test_it_goes_to_the_rally_point_once_and_then_on_with_its_tour(targets: tuple[Point, ...]) -> None:
    searcher = searching(targets=targets)
    searcher.passes(31.0)
    assert searcher.machine.state.value == "meet"
    (report,) = reports(beat(searcher, 40))
    assert len(report.targets) == len(targets) - 1
    searcher.passes(0.1)
    assert searcher.machine.state.value == "meet"  # it waits for the receipt
    searcher.hears(0, Receipt(report.number))
    searcher.passes(0.1)
    assert errands(searcher)[-1] == ("search", "told")
    searcher.passes(60.0)
    assert errands(searcher)[-1] == ("search", "told")


def test_who_is_in_contact_at_the_time_stays_until_its_finds_are_received() -> None:
    searcher = searching()
    searcher.passes(29.5)
    for report in reports(beat(searcher, 40)):
        searcher.hears(0, Receipt(report.number))
    searcher.passes(0.5)
    assert errands(searcher)[-1] == ("meet", "due")
    beat(searcher, 41)  # the receipt for that is lost
    searcher.passes(0.5)
    assert errands(searcher)[-1] == ("meet", "due")
    (again,) = reports(beat(searcher, 42))
    searcher.hears(0, Receipt(again.number))
    searcher.passes(0.1)
    assert errands(searcher)[-1] == ("search", "told")


def test_who_is_done_before_the_time_waits_where_the_radio_connects_and_may_be_given_another_area() -> None:
    searcher = searching()
    searcher.passes(4.0)
    searcher.machine._motion.assign(())
    searcher.passes(0.1)
    assert errands(searcher)[-1] == ("meet", "done")
    for report in reports(beat(searcher, 5)):
        assert report.targets == ()
        searcher.hears(0, Receipt(report.number))
    searcher.passes(0.1)
    assert errands(searcher)[-1] == ("wait", "idle")
    assert searcher.goal_m() == searcher.here
    searcher.hears(0, Assign(0, 2, (4,)))
    searcher.passes(0.1)
    assert errands(searcher)[-1] == ("search", "work")
    assert searcher.now < 30 * S


def test_after_the_time_it_tells_what_it_finds_when_its_area_is_done() -> None:
    searcher = searching(targets=(HIDDEN_M, (3.0, 17.0)))
    searcher.passes(30.0)
    (report,) = reports(beat(searcher, 40))
    searcher.hears(0, Receipt(report.number))
    searcher.passes(5.0)
    searcher.looks((5.0, 16.0))  # out of contact, with a target in view
    searcher.passes(5.0)
    assert searcher.machine.findings.targets.keys() == {1}
    assert searcher.machine.state.value == "search"
    searcher.machine._motion.assign(())
    searcher.passes(0.1)
    assert errands(searcher)[-1] == ("meet", "done")
    assert reports(beat(searcher, 50))[0].targets == (Finding(1, 3.0, 17.0),)


def test_a_rebooted_searcher_knows_the_time_by_the_clock_of_the_team() -> None:
    searcher = searching(start=20 * S)
    assert searcher.machine._reports.withholds
    searcher.passes(9.9)
    assert searcher.machine._reports.withholds
    searcher.passes(0.1)
    assert not searcher.machine._reports.withholds


def test_no_other_reading_and_no_other_strategy_has_such_a_time() -> None:
    for strategy, report in (("srp", "first"), ("srp", "area"), ("mi", "appointed"), ("mrp", "appointed")):
        _, setup = team_scene.prepared(STARTS_M, strategy, report=report, integrate_s=30.0)
        assert setup.integration_s is None


# ---------------------------------------------------------------- its reports


def test_a_receipt_for_a_report_without_finds_is_none_for_the_finds() -> None:
    """It may come late, when the report that holds them is under way."""
    known = Findings()
    mine = Reports(known, 8)
    mine.withholds = True
    known.visit([2])
    known.add([Finding(0, 1.0, 1.0)])
    early = mine.make(0)
    assert early == Report(1, 0, (), bitmap([2], 8))
    mine.withholds = False
    late = mine.make(0)
    assert late.targets == (Finding(0, 1.0, 1.0),)
    mine.received(early.number)
    assert mine.pending
    assert mine.finds
    mine.received(late.number)
    assert not mine.pending
    assert not mine.finds


# ---------------------------------------------------------------- when it is


def told(team: Team) -> float:
    """Return the time by what hosts have told: the longest way by a searcher's posts to the end of its host's plan."""
    takes_s = []
    for searcher in range(team.setup.hosts, team.setup.size):
        host = team.setup.host_of(searcher)
        assign, plans = team.said(Assign, host, searcher)[0].message, team.said(Plans, host)[0].message
        assert isinstance(assign, Assign)
        assert isinstance(plans, Plans)
        posts_m = [team.setup.ground.posts_m[post] for post in assign.posts]
        places = [STARTS_M[searcher], *posts_m, plans.plans[0].way_m[-1]]
        takes_s.append(sum(math.dist(a, b) for a, b in pairwise(places)) / team.setup.speeds_mps[searcher])
    return team.parameters.muster_s + max(takes_s)


@pytest.mark.parametrize("speeds_mps", [(1, 1, 2, 2, 2), (1, 1, 2, 0.5, 2), (1, 1, 1, 2, 0.7)])
def test_it_is_the_longest_tour_and_way_back_of_all_searchers(
    speeds_mps: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a floor without walls, where ways are straight."""
    monkeypatch.setattr(team_scene, "WALLS_M", [])
    options: dict[str, Any] = {"strategy": "srp", "report": "appointed", "targets": (HIDDEN_M,)}
    team = Team(STARTS_M, speeds_mps=speeds_mps, **options)
    team.run(2.0)
    assert team.setup.integration_s == pytest.approx(told(team), rel=1e-6)
    given = Team(STARTS_M, speeds_mps=speeds_mps, integrate_s=77.0, **options)
    assert given.setup.integration_s == 77.0


def test_walls_make_ways_longer() -> None:
    team = Team(STARTS_M, strategy="srp", report="appointed", targets=(HIDDEN_M,))
    team.run(2.0)
    assert told(team) < team.setup.integration_s < 1.5 * told(team)


# ---------------------------------------------------------------- whole searches

REACH_M = 3.0


@cache
def search(report: str = "appointed", integrate_s: float | None = None) -> Run:
    """Return a search by two slow searchers: a target is in view of robot 1 at the start, the other in a far corner."""
    options: dict[str, Any] = {"targets": ((10.0, 12.0), (17.0, 17.0)), "camera_m": 4.0, "lost_s": 600.0}
    options |= {"hosts": 1, "searchers": 2, "searcher_mps": 0.5, "short_m": REACH_M, "channel": ideal_radios(REACH_M)}
    return run("srp", report=report, integrate_s=integrate_s, **options)


def known_s(found: Run, target: int) -> float:
    """Return when the host has learnt of a target."""
    (row,) = [row for row in found.told("TargetKnown") if row["target"] == target]
    return float(row["s"])


def test_the_host_learns_of_an_early_find_at_the_appointed_time_and_not_before() -> None:
    found = search()
    at_s = found.setup.integration_s
    assert at_s is not None
    assert found.ended
    assert min(found.times_s("TargetFound", 1)) == 0.0
    assert all(at_s <= known_s(found, target) < at_s + 1.2 for target in (0, 1))  # by the next heartbeat
    assert known_s(search("area"), 0) < 1.2  # the finder is in contact, and nothing is kept back


def test_searchers_with_different_tours_are_at_the_rally_point_at_the_appointed_time() -> None:
    found = search()
    at_s = found.setup.integration_s
    assert at_s is not None
    posts = {row["searcher"]: row["posts"] for row in found.told("Assigned")}
    assert posts[1] != posts[2]
    for searcher in (1, 2):
        apart_m = [math.dist(found.place_m(searcher, s), found.place_m(0, s)) for s in (at_s - 40.0, at_s)]
        assert apart_m[0] > 2.0 * REACH_M
        assert apart_m[1] <= REACH_M + 0.5 * 1.5  # it has 1.5 s to go, for turning and braking on its tour
    waits_s = [row["s"] for row in found.told("ErrandChanged", 1) if row["errand"] == "wait"]
    assert waits_s
    assert found.way_m(1, waits_s[0] + 2.0, at_s) < 0.1


def test_searchers_still_out_break_their_tours_off_at_the_time_and_resume_them() -> None:
    found = search(integrate_s=20.0)
    assert found.ended
    back_s = {}
    for searcher in (1, 2):
        errands = [(row["errand"], row["why"], row["s"]) for row in found.told("ErrandChanged", searcher)]
        assert errands[1] == ("meet", "due", 20.0)
        assert errands[2][:2] == ("search", "told")
        back_s[searcher] = errands[2][2]
        assert math.dist(found.place_m(searcher, back_s[searcher]), found.place_m(0, back_s[searcher])) <= REACH_M
        assert [why for _, why, _ in errands].count("due") == 1
    assert 20.0 < known_s(found, 0) <= back_s[1]  # searcher 1 had it
    assert found.machines[0].findings.visited >= set(found.setup.regions[0])
