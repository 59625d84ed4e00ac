"""Whole searches in which robots die, reboot, or lose a radio: the others find all targets, and all are stopped."""

import pytest

from tests.protocols.aggregation.team_scene import STRATEGIES, Run, ideal_radios, run

pytestmark = pytest.mark.slow


def kill(robot: int, at_s: float) -> dict[str, object]:
    return {"kind": "kill", "robot": robot, "at_s": at_s}


def assert_all_is_well(search: Run, dead: tuple[int, ...] = ()) -> None:
    """All living hosts know all targets, all the living have stopped, and each searcher is in one sub-team."""
    assert search.ended
    for robot, machine in enumerate(search.machines):
        if robot not in dead:
            assert machine.finished
    for searcher, teams in search.teams(dead).items():
        assert teams == [search.machines[searcher].membership.host]


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_search_survives_the_death_of_a_host(strategy: str) -> None:
    search = run(strategy, faults=[kill(0, 8.0)], camera_m=4.0)
    assert_all_is_well(search, dead=(0,))
    for searcher in (2, 4):
        assert [row["host"] for row in search.told("Joined", searcher)] == [1]
    assert search.outcome.metrics["hosts_alive"] == 1.0
    assert search.outcome.metrics["joins"] == 2.0
    assert search.outcome.metrics["false_suspicions"] == 0.0


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_search_survives_the_death_of_two_of_three_hosts(strategy: str) -> None:
    search = run(strategy, hosts=3, searchers=4, faults=[kill(1, 6.0), kill(0, 12.0)], camera_m=4.0)
    assert_all_is_well(search, dead=(0, 1))


def test_a_run_is_over_when_no_host_lives_any_more() -> None:
    search = run("mi", faults=[kill(0, 5.0), kill(1, 7.0)])
    assert search.outcome.simulated_s < 12.0
    assert search.outcome.metrics["completed"] == 0.0
    assert search.outcome.metrics["hosts_alive"] == 0.0


@pytest.mark.parametrize("strategy", [each for each in STRATEGIES if each != "random"])
@pytest.mark.parametrize("robot", [2, 3])
def test_a_search_survives_the_death_of_a_searcher(strategy: str, robot: int) -> None:
    """3 is the only one of host 1; its posts are given to others once it has been missed for a minute."""
    search = run(strategy, faults=[kill(robot, 6.0)], camera_m=4.0, lost_s=30.0, timeout_s_per_m2=0.3)
    assert_all_is_well(search, dead=(robot,))


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("robot", [0, 2])
def test_a_search_survives_a_crash_after_which_a_robot_boots_again(strategy: str, robot: int) -> None:
    faults = [{"kind": "crash", "robot": robot, "at_s": 7.0, "for_s": 9.0}]
    search = run(strategy, faults=faults, camera_m=4.0)
    assert_all_is_well(search)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_search_survives_that_a_host_can_neither_speak_nor_hear_for_a_while(strategy: str) -> None:
    faults = [{"kind": "radio_off", "robot": 0, "at_s": 7.0, "for_s": 25.0}]
    search = run(strategy, faults=faults, camera_m=4.0)
    assert_all_is_well(search)


@pytest.mark.parametrize("strategy", ["mrp", "mi", "mito"])
def test_a_host_without_its_long_range_radio_goes_astray_and_is_taken_back(strategy: str) -> None:
    faults = [{"kind": "radio_off", "robot": 0, "radio": 1, "at_s": 7.0, "for_s": 20.0}]
    short_m = 3.0  # hosts that are close hear each other by the other radio
    channel = ideal_radios(short_m)
    search = run(
        strategy,
        hosts=3,
        searchers=4,
        faults=faults,
        camera_m=3.0,
        channel=channel,
        short_m=short_m,
        timeout_s_per_m2=0.3,
    )
    assert_all_is_well(search)
    astray = [row["s"] for row in search.told("Departed", 0) if row["astray"]]
    assert astray
    assert 7.0 + 4.0 < astray[0] < 27.0
    assert not [row for host in (1, 2) for row in search.told("Departed", host) if row["astray"]]
    back = [row["s"] for row in search.told("Departed", 0) if row["s"] > astray[0] and not row["astray"]]
    assert back
    assert 27.0 <= back[0] < 27.0 + 2.0
    suspected = {(row["source"], row["host"]) for row in search.told("HostSuspected")}
    assert suspected == {(0, 1), (0, 2), (1, 0), (2, 0)}
    trusted = {(row["source"], row["host"]) for row in search.told("HostTrusted") if row["s"] > 27.0}
    assert trusted == suspected


def test_a_searcher_without_radio_misses_the_end_and_is_stopped_when_it_has_it_again() -> None:
    faults = [{"kind": "radio_off", "robot": 2, "at_s": 4.0, "for_s": 120.0}]
    search = run("mi", faults=faults)
    assert_all_is_well(search)
    assert search.times_s("ErrandChanged", 2)[-1] > 124.0


def test_a_searcher_that_is_carried_elsewhere_works_on() -> None:
    faults = [{"kind": "moved", "robot": 2, "at_s": 6.0, "to_m": [18.0, 18.0]}]
    assert_all_is_well(run("mi", faults=faults, camera_m=4.0))


def test_blind_robots_are_led_by_plans_and_radios() -> None:
    """Their cameras are off for a while: they see neither targets nor hosts."""
    faults = [{"kind": "camera_off", "robot": robot, "at_s": 5.0, "for_s": 6.0} for robot in (2, 3, 4)]
    assert_all_is_well(run("mrp", faults=faults, camera_m=4.0))


def test_what_a_blind_searcher_passes_it_searches_again() -> None:
    """It sees nothing while it would come past the target."""
    alone = {"hosts": 1, "searchers": 1, "camera_m": 4.0, "targets": ((17.0, 17.0),)}
    ((found_s),) = run("mi", **alone).times_s("TargetFound", 1)
    assert 4.0 < found_s < 44.0
    search = run("mi", **alone, faults=[{"kind": "camera_off", "robot": 1, "at_s": 4.0, "for_s": 40.0}])
    assert_all_is_well(search)
    assert search.times_s("TargetFound", 1)[0] > 44.0


def test_others_search_what_a_blind_searcher_has_left() -> None:
    blind = [{"kind": "camera_off", "robot": 1, "at_s": 4.0}]
    search = run("mi", hosts=1, searchers=2, camera_m=4.0, faults=blind)
    assert_all_is_well(search)
    assert {row["source"] for row in search.told("TargetFound")} <= {2}


def test_clocks_that_are_set_do_not_stop_a_search() -> None:
    faults = [
        {"kind": "clock_step", "robot": 0, "at_s": 6.0, "by_s": 2.0},
        {"kind": "clock_step", "robot": 3, "at_s": 8.0, "by_s": -3.0},
    ]
    search = run("mi", faults=faults, camera_m=4.0)
    assert search.outcome.simulated_s < search.duration_s
    assert all(machine.finished for machine in search.machines)
