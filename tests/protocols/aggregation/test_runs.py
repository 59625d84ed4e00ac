"""Whole searches of a small floor: all targets are found, everybody is told to stop, and the run ends by itself."""

import math
from functools import cache
from itertools import pairwise

import pytest
from shapely import LineString

from tests.protocols.aggregation.team_scene import SHORT_M, STRATEGIES, TARGETS_M, WALLS_M, Run, ideal_radios, run
from tests.tiers import two_tiers

pytestmark = pytest.mark.slow

HOSTS, SEARCHERS = (0, 1), (2, 3, 4)


@cache
def plain(strategy: str, seed: int = 1) -> Run:
    return run(strategy, seed)


def assert_all_found_and_stopped(search: Run) -> None:
    """Both hosts know all targets where they are, all searchers have been told, and nobody goes on walking."""
    assert search.ended
    for host in search.machines[: search.setup.hosts]:
        found = {number: (finding.x_m, finding.y_m) for number, finding in host.findings.targets.items()}
        assert found == dict(enumerate(TARGETS_M))
    end_s = search.outcome.simulated_s
    for searcher in range(search.setup.hosts, search.setup.size):
        (stopped_s,) = [row["s"] for row in search.told("ErrandChanged", searcher) if row["errand"] == "stop"]
        assert search.machines[searcher].finished
        assert search.way_m(searcher, stopped_s, end_s) < 2.5  # it brakes from 2 m/s at 1 m/s^2


@pytest.mark.parametrize("seed", two_tiers([1, 2, 3], 1))
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_every_strategy_finds_all_targets_and_stops_everybody(strategy: str, seed: int) -> None:
    assert_all_found_and_stopped(plain(strategy, seed))


def test_ways_of_a_wavefront_do_as_well() -> None:
    search = run("mi", planner="wavefront")
    assert search.setup.ground.roadmap is None
    assert_all_found_and_stopped(search)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_every_target_was_found_by_a_camera_before_a_host_knew_it(strategy: str) -> None:
    search = plain(strategy)
    for target in range(len(TARGETS_M)):
        seen = min(row["s"] for row in search.told("TargetFound") if row["target"] == target)
        known = [row for row in search.told("TargetKnown") if row["target"] == target]
        assert {row["source"] for row in known} == set(HOSTS)
        assert min(row["s"] for row in known) > seen
        first = min(known, key=lambda row: row["s"])
        assert first["teller"] in SEARCHERS


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("camera_m", [6.0, 12.0])
def test_targets_are_found_from_where_they_are_in_range_and_in_sight(strategy: str, camera_m: float) -> None:
    """With 12 m walls are in between."""
    search = run(strategy, camera_m=camera_m)
    walls = [LineString([(a, b), (c, d)]) for a, b, c, d in WALLS_M]
    for row in search.told("TargetFound"):
        here, there = search.place_m(row["source"], row["s"]), TARGETS_M[row["target"]]
        assert math.dist(here, there) <= camera_m + 1e-6
        assert not any(LineString([here, there]).crosses(wall) for wall in walls)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_the_search_ends_though_a_third_of_all_frames_is_lost(strategy: str) -> None:
    assert_all_found_and_stopped(run(strategy, channel=ideal_radios(loss=0.3)))


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_the_search_ends_though_frames_overtake_each_other(strategy: str) -> None:
    assert_all_found_and_stopped(run(strategy, channel=ideal_radios(jitter_s=0.5, loss=0.1)))


@pytest.mark.parametrize("strategy", ["mrp", "mi", "mito"])
def test_a_host_that_strays_out_of_reach_finds_back_to_the_others(strategy: str) -> None:
    """The paper's second case: one host's way is not kept within reach, which here is 9 m."""
    long_m = 9.0
    channel = ideal_radios(3.0, long_m)
    search = run(strategy, channel=channel, short_m=3.0, long_m=long_m, strays=(0,), camera_m=3.0, timeout_s_per_m2=0.3)
    assert_all_found_and_stopped(search)
    astray = [row["s"] for row in search.told("Departed", 0) if row["astray"]]
    assert astray
    assert [row["s"] for row in search.told("Departed", 0) if not row["astray"] and row["s"] > astray[0]]
    orderly = run(strategy, channel=channel, short_m=3.0, long_m=long_m, camera_m=3.0, timeout_s_per_m2=0.3)
    assert not [row for row in orderly.told("Departed") if row["astray"]]


@pytest.mark.parametrize("strategy", ["mi", "mrp"])
def test_the_search_ends_over_an_ad_hoc_network(strategy: str) -> None:
    radios = [{"kind": "adhoc", "range_m": reach} for reach in (SHORT_M, 60.0)]
    assert_all_found_and_stopped(run(strategy, channel={"kind": "radios", "radios": radios}))


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_one_host_alone_leads_a_search(strategy: str) -> None:
    assert_all_found_and_stopped(run(strategy, hosts=1))


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_equal_seeds_give_equal_runs(strategy: str) -> None:
    assert run(strategy).outcome.digest == plain(strategy).outcome.digest


# ---------------------------------------------------------------- the static rally point


def test_a_static_host_does_not_move_once_it_is_at_its_rally_point() -> None:
    search = plain("srp")
    for host in HOSTS:
        (departed,) = search.told("Departed", host)
        there_s = departed["s"] + 3.0 + departed["length_m"] / 1.0 + 3.0
        assert there_s < search.outcome.simulated_s - 5.0
        assert departed["length_m"] > 1.0
        assert search.way_m(host, there_s) < 0.01


def test_searchers_of_a_static_host_stop_where_the_radio_connects() -> None:
    """They hear it each second, at 1 m/s: at most 1 m and their braking way inside its reach."""
    search = run("srp", searcher_mps=1.0)
    met = 0
    for searcher in SEARCHERS:
        changes = search.told("ErrandChanged", searcher)
        for before, after in pairwise(changes):
            if (before["errand"], after["errand"]) != ("meet", "wait"):
                continue
            host = search.machines[searcher].membership.host
            begin_s, end_s = before["s"], after["s"]
            apart_m = [
                math.dist(search.place_m(searcher, at_s), search.place_m(host, at_s)) for at_s in (begin_s, end_s)
            ]
            if apart_m[0] <= SHORT_M:
                continue
            later_s = [row["s"] for row in changes if row["s"] > end_s]
            if min([*later_s, search.outcome.simulated_s]) < end_s + 4.0:
                continue
            met += 1
            assert search.way_m(searcher, end_s + 1.0, end_s + 4.0) < 0.1
            rests_m = math.dist(search.place_m(searcher, end_s + 1.0), search.place_m(host, end_s + 1.0))
            assert SHORT_M - 1.0 - 0.5 - 0.3 < rests_m <= SHORT_M
    assert met


def test_with_a_static_host_whoever_finds_a_target_out_of_reach_goes_to_the_rally_point_at_once() -> None:
    reasons = {row["why"] for row in plain("srp").told("ErrandChanged") if row["errand"] == "meet"}
    assert "found" in reasons
    assert reasons <= {"found", "done", "alone"}
    reasons = {row["why"] for row in run("srp", report="area").told("ErrandChanged") if row["errand"] == "meet"}
    assert reasons <= {"done", "alone"}


# ---------------------------------------------------------------- the mobile integrator


def test_only_finders_and_those_who_are_done_leave_their_tours_with_a_mobile_integrator() -> None:
    search = run("mi", camera_m=4.0)
    finders = 0
    for searcher in SEARCHERS:
        finds = [row["s"] for row in search.told("TargetFound", searcher)]
        for row in search.told("ErrandChanged", searcher):
            if row["errand"] != "meet":
                continue
            assert row["why"] in ("found", "done", "alone")
            if row["why"] == "found":
                assert any(at <= row["s"] for at in finds)
                finders += 1
    assert finders


def test_the_integrators_host_is_slow_and_moves_all_the_time_that_its_searchers_are_on_their_tours() -> None:
    search = run("mi", targets=((3.0, 3.0), (17.0, 17.0)), camera_m=3.0)
    host_m = search.way_m(0, 5.0, 25.0)
    assert 0.5 < host_m < 20.0 * 1.0
    steps_m = [search.way_m(0, at_s, at_s + 5.0) for at_s in (5.0, 10.0, 15.0, 20.0)]
    assert min(steps_m) > 0.0


# ---------------------------------------------------------------- the time-out


def test_a_time_out_brings_a_searcher_to_its_host_and_back_to_work() -> None:
    """6 s without having heard the host: the paper's fourth strategy; the third one knows no such reason."""
    search = run("mito", camera_m=3.0, timeout_s_per_m2=0.06)
    assert_all_found_and_stopped(search)
    due = [row for row in search.told("ErrandChanged") if row["why"] == "due"]
    assert due
    back = 0
    for row in due:
        changes = [each for each in search.told("ErrandChanged", row["source"]) if each["s"] > row["s"]]
        back += changes[0]["errand"] == "search"
        assert changes[0]["why"] in ("told", "idle", "failed", "over", "joined")
    assert back
    assert "due" not in {row["why"] for row in run("mi", camera_m=3.0).told("ErrandChanged")}


def test_a_time_out_that_is_armed_by_the_own_find_calls_nobody_who_has_found_nothing() -> None:
    def due(search: Run) -> dict[bool, int]:
        """Count the times that searchers were due, by whether they had found a target themselves."""
        calls = [row for row in search.told("ErrandChanged") if row["why"] == "due"]
        found = [min(search.times_s("TargetFound", row["source"]), default=math.inf) <= row["s"] for row in calls]
        return {each: found.count(each) for each in (False, True)}

    always, armed = (run("mito", camera_m=3.0, timeout_s_per_m2=0.06, timeout_armed=how) for how in ("always", "find"))
    assert due(always)[False] > 0
    assert due(armed)[False] == 0
    assert due(armed)[True] > 0
    assert_all_found_and_stopped(armed)


# ---------------------------------------------------------------- random motion, and people


def test_searchers_at_random_are_given_no_posts_and_leave_off_only_to_report() -> None:
    search = plain("random")
    assert search.told("Assigned") == []
    reasons = {(row["errand"], row["why"]) for row in search.told("ErrandChanged")}
    assert ("meet", "found") in reasons
    assert not {"done", "due"} & {why for _, why in reasons}


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_person_takes_part(strategy: str) -> None:
    search = run(strategy, humans=(3,))
    assert_all_found_and_stopped(search)
    assert search.way_m(3) > 5.0
    if strategy != "random":
        assert search.machines[3].findings.visited & search.setup.regions[1]
