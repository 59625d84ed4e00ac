"""Robots that come back: hosts and searchers that reboot, radios that are off for a while."""

import pytest

from cosim.units import S
from protocols.aggregation.events import HostTrusted
from protocols.aggregation.messages import Assign, Heartbeat, Join, Report, Stop
from tests.protocols.aggregation.team_scene import STRATEGIES, TARGETS_M, Point, Team

pytestmark = pytest.mark.slow

STARTS_M = [(9.5, 9.0), (10.5, 9.0), (9.5, 10.4), (10.0, 10.4), (10.5, 10.4), (10.0, 11.0)]
"""Two hosts; 2 and 4 are led by host 0, 3 and 5 by host 1."""
HIDDEN_M: Point = (-500.0, -500.0)


def visited(team: Team, first: int = 2) -> set[int]:
    """Return the posts that searchers have visited."""
    return {post for machine in team.machines[first:] for post in machine.findings.visited}


def all_posts(team: Team) -> set[int]:
    return set(range(len(team.setup.ground.posts_m)))


def all_finished(team: Team) -> bool:
    return all(machine.finished for machine in team.machines)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_host_that_has_booted_again_learns_all_anew_from_its_searchers(strategy: str) -> None:
    """There is no other host to learn from: those who had receipts tell it again."""
    team = Team(STARTS_M, hosts=1, strategy=strategy, camera_m=4.0, targets=TARGETS_M)
    team.run(100.0, lambda: len(team.machines[0].findings.targets) >= 2)
    assert not all_finished(team)
    team.down.add(0)
    team.run(3.0)
    team.reboot(0)
    assert not team.machines[0].findings.targets
    team.run(600.0, lambda: all_finished(team))
    assert all_finished(team)
    assert team.machines[0].findings.targets.keys() == {0, 1, 2, 3}


def test_a_host_that_was_down_until_it_has_counted_further_than_before_is_known_to_have_booted() -> None:
    """The searchers heard five heartbeats of its first life; when they hear it again, it is at its twentieth."""
    team = Team(STARTS_M, hosts=1, strategy="mi", camera_m=4.0, targets=(HIDDEN_M,))
    team.run(5.0)
    team.lost = lambda flight: True
    team.run(30.0)
    known = visited(team, 1)
    team.lost = lambda flight: False
    team.held |= {0}
    team.run(200.0, lambda: team.machines[0].findings.visited >= known)
    heard = max(flight.message.number for flight in team.said(Heartbeat, 0))  # type: ignore[union-attr]
    team.down.add(0)
    team.lost = lambda flight: True
    team.run(1.0)
    team.reboot(0)
    team.run(heard + 10.0)
    team.lost = lambda flight: False
    team.run(30.0, lambda: team.machines[0].findings.visited >= known)
    assert team.machines[0].findings.visited >= known


@pytest.mark.parametrize("strategy", [each for each in STRATEGIES if each != "random"])
def test_a_host_that_has_booted_again_gives_its_searchers_work_to_the_end(strategy: str) -> None:
    """What it gives out bears numbers that its searchers have seen before."""
    team = Team(STARTS_M, hosts=1, strategy=strategy, camera_m=3.0, targets=(HIDDEN_M,), reconvene_s=30.0)
    team.run(6.0)
    team.down |= {0, 2}  # a searcher is lost for good: its posts have to be given to others
    team.run(3.0)
    team.reboot(0)
    team.run(300.0, lambda: visited(team, 1) == all_posts(team))
    assert visited(team, 1) == all_posts(team)
    assert [flight.at for flight in team.said(Assign, 0) if flight.at > 9 * S]


def test_the_hosts_hear_one_of_them_that_has_booted_again_at_once() -> None:
    team = Team(STARTS_M, targets=(HIDDEN_M,))
    team.run(10.0)
    team.down.add(0)
    team.run(2.0)  # less than it takes to be missed
    team.reboot(0)
    before = len(team.noted(HostTrusted, 1))
    team.run(2.0)
    assert len(team.noted(HostTrusted, 1)) == before + 1
    team.run(4.0)
    assert team.machines[0].findings.visited >= team.machines[1].findings.visited


def test_searchers_stay_with_a_host_that_was_down_only_for_a_moment() -> None:
    team = Team(STARTS_M, strategy="mi", targets=(HIDDEN_M,))
    team.run(6.0)
    team.down.add(0)
    team.run(1.0)
    team.reboot(0)
    team.run(40.0, lambda: visited(team) == all_posts(team) and team.members(0) == {2, 4})
    assert team.members(0) == {2, 4}
    assert team.members(1) == {3, 5}
    assert not team.said(Join)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_dead_hosts_searchers_are_in_one_sub_team_each_after_it_has_come_back(strategy: str) -> None:
    team = Team(STARTS_M, strategy=strategy, camera_m=4.0, targets=TARGETS_M)
    team.run(8.0)
    team.down.add(0)
    team.run(25.0)
    team.reboot(0)
    team.run(600.0, lambda: all_finished(team))
    assert all_finished(team)
    for searcher in range(2, 6):
        assert sum(searcher in team.members(host) for host in (0, 1)) == 1
        assert searcher in team.members(team.machines[searcher].membership.host)


def test_a_host_that_comes_back_when_all_is_over_learns_it_from_the_others() -> None:
    team = Team(STARTS_M, strategy="srp", targets=TARGETS_M)
    team.down.add(0)
    team.run(300.0, lambda: all(machine.finished for machine in team.machines[1:]))
    team.reboot(0)
    team.run(5.0)
    assert team.machines[0].finished
    assert team.machines[0].findings.targets == team.machines[1].findings.targets


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_searcher_that_has_booted_again_finds_a_host_and_works_on(strategy: str) -> None:
    team = Team(STARTS_M, strategy=strategy, camera_m=4.0, targets=TARGETS_M)
    team.run(7.0)
    team.down.add(3)
    team.run(4.0)
    team.reboot(3)
    team.run(600.0, lambda: all_finished(team))
    assert all_finished(team)
    assert sum(3 in team.members(host) for host in (0, 1)) == 1


def test_a_searcher_that_has_booted_again_is_given_what_it_was_given_before() -> None:
    """It has forgotten its tour, and is beside its host: the host knows what is left of it."""
    team = Team(STARTS_M, hosts=1, strategy="mi", camera_m=3.0, targets=(HIDDEN_M,))
    team.held |= set(range(6))
    team.run(4.0)
    first = team.said(Assign, 0, 3)[0].message
    team.down.add(3)
    team.run(2.0)
    team.reboot(3)
    team.run(4.0)
    later = team.said(Assign, 0, 3)[-1].message
    assert isinstance(first, Assign)
    assert isinstance(later, Assign)
    assert later.epoch > first.epoch
    assert set(later.posts) == set(first.posts)


def test_the_word_to_stop_gets_through_though_its_first_ten_messages_are_lost() -> None:
    team = Team(STARTS_M, strategy="mi", targets=TARGETS_M)
    lost: list[int] = []

    def lose(flight: object) -> bool:
        if isinstance(flight.message, Stop) and len(lost) < 10:  # type: ignore[attr-defined]
            lost.append(flight.receiver)  # type: ignore[attr-defined]
            return True
        return False

    team.lost = lose
    team.run(200.0, lambda: all_finished(team))
    assert all_finished(team)
    assert len(lost) == 10
    stopped = len(team.said(Stop))
    team.run(5.0)
    assert len(team.said(Stop)) == stopped  # who has said that it has stopped is not asked any more


def test_reports_that_are_lost_are_said_again_until_there_is_a_receipt() -> None:
    team = Team(STARTS_M, strategy="mi", targets=((9.5, 12.0), HIDDEN_M))
    team.held |= set(range(6))
    team.lost = lambda flight: isinstance(flight.message, Report)
    team.run(5.0)
    assert not team.machines[0].findings.targets
    assert len(team.said(Report, 2, 0)) >= 4
    team.lost = lambda flight: False
    team.run(2.0)
    assert team.machines[0].findings.targets.keys() == team.machines[1].findings.targets.keys() == {0}
    said = len(team.said(Report, 2, 0))
    team.run(5.0)
    assert len(team.said(Report, 2, 0)) == said
