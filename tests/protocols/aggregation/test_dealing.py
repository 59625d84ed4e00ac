"""How posts are dealt: no post to two, none forgotten, and those of silent hosts to exactly one of the others."""

from functools import cache

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.aggregation.parameters import Parameters
from protocols.aggregation.roster import Member, Roster
from protocols.aggregation.setup import Setup
from protocols.aggregation.strategies import Strategy
from protocols.aggregation.subteam import Work
from tests.protocols.aggregation.team_scene import prepared
from tests.tiers import tiers

pytestmark = pytest.mark.slow

SIZE = 12


@cache
def floor(hosts: int, camera_m: float = 4.0) -> tuple[Parameters, Setup]:
    starts = [(8.0 + 0.5 * (robot % 4), 8.5 + 0.5 * (robot // 4)) for robot in range(SIZE)]
    return prepared(starts, hosts=hosts, camera_m=camera_m)


def work(hosts: int, host: int, at_random: bool = False) -> Work:
    parameters, setup = floor(hosts)
    return Work(setup, host, lambda each: Strategy(parameters, setup, each).rally_m, at_random)


def all_posts(hosts: int) -> set[int]:
    return set(range(len(floor(hosts)[1].ground.posts_m)))


@pytest.mark.parametrize("hosts", [1, 2, 3, 4, 5])
def test_regions_cover_all_posts_and_share_none(hosts: int) -> None:
    regions = floor(hosts)[1].regions
    assert len(regions) == hosts
    assert sorted(post for region in regions for post in region) == sorted(all_posts(hosts))


@pytest.mark.parametrize("hosts", [1, 2, 3, 4])
@pytest.mark.parametrize("searchers", [1, 2, 5])
def test_the_first_tours_of_a_sub_team_cover_its_region_and_share_nothing(hosts: int, searchers: int) -> None:
    for host in range(hosts):
        tours = work(hosts, host).first(tuple(range(hosts, hosts + searchers)))
        assert sorted(tours) == list(range(hosts, hosts + searchers))
        assert sorted(post for tour in tours.values() for post in tour) == sorted(floor(hosts)[1].regions[host])


@given(st.data())
def test_what_is_given_is_new_to_everybody_and_to_be_seen_to_by_this_host(data: st.DataObject) -> None:
    hosts = data.draw(st.integers(1, 4))
    host = data.draw(st.integers(0, hosts - 1))
    posts = sorted(all_posts(hosts))
    silent = (
        data.draw(st.sets(st.sampled_from([each for each in range(hosts) if each != host]))) if hosts > 1 else set()
    )
    visited = data.draw(st.sets(st.sampled_from(posts)))
    roster = Roster()
    left = list(posts)
    for searcher in range(hosts, hosts + data.draw(st.integers(0, 3))):
        roster.add(searcher, 0, 0)
        tour = data.draw(st.lists(st.sampled_from(left), unique=True, max_size=6)) if left else []
        left = [post for post in left if post not in tour]
        roster.members[searcher].give(tuple(tour))
    mine = set(floor(hosts)[1].regions[host])
    of_silent = {post for each in silent for post in floor(hosts)[1].regions[each]}
    taken = {post for member in roster.members.values() for post in member.posts} - visited
    waiting = data.draw(st.integers(0, 4))
    given_posts = work(hosts, host).next(
        data.draw(st.sampled_from(floor(1)[1].ground.posts_m)), roster, visited, silent, waiting
    )
    assert len(set(given_posts)) == len(given_posts)
    assert set(given_posts) <= mine | of_silent
    assert not set(given_posts) & visited
    assert not set(given_posts) & taken
    if mine - visited - taken:
        assert given_posts  # whoever asks is given something as long as there is anything, though others wait


@given(hosts=st.integers(2, 5), data=st.data())
def test_all_posts_of_silent_hosts_fall_to_exactly_one_of_the_living(hosts: int, data: st.DataObject) -> None:
    silent = data.draw(st.sets(st.integers(0, hosts - 1), max_size=hosts - 1))
    living = [host for host in range(hosts) if host not in silent]
    owners: dict[int, list[int]] = {post: [] for post in all_posts(hosts)}
    for host in living:
        for post in work(hosts, host).next((9.0, 9.0), Roster(), (), silent, 0):
            owners[post].append(host)
    assert all(len(hosts_of) == 1 for hosts_of in owners.values())
    for host in living:
        assert all(owners[post] == [host] for post in floor(hosts)[1].regions[host])


@tiers(30, 300, st.integers(1, 3), st.integers(1, 5), st.data())
def test_those_who_ask_one_after_the_other_end_up_with_all_the_posts_and_none_twice(
    hosts: int, asking: int, data: st.DataObject
) -> None:
    """Each says what it has done before it asks again; some are lost on the way, and what they had is given anew."""
    host = data.draw(st.integers(0, hosts - 1))
    dealer, roster = work(hosts, host), Roster()
    for searcher in range(asking):
        roster.add(searcher, 0, 0)
    visited: set[int] = set()
    region = set(floor(hosts)[1].regions[host])
    for _ in range(60):
        if visited == region:
            break
        searcher = data.draw(st.sampled_from(sorted(roster.members)))
        if len(roster.members) > 1 and data.draw(st.integers(0, 9)) == 0:
            roster.remove(searcher, 1)
            continue
        member: Member = roster.members[searcher]
        visited |= set(member.left(visited))
        idle = sum(not each.left(visited) for each in roster.members.values()) - 1
        posts = dealer.next((9.0, 9.0), roster, visited, (), idle)
        others = {post for each in roster.members.values() if each is not member for post in each.left(visited)}
        assert not set(posts) & (visited | others)
        if posts:
            member.give(posts)
    for member in roster.members.values():
        visited |= set(member.left(visited))
    for searcher in [*roster.members]:
        posts = dealer.next((9.0, 9.0), roster, visited, (), 0)
        roster.members[searcher].give(posts)
        visited |= set(posts)
    assert visited == region


def test_nobody_is_given_posts_who_searches_at_random() -> None:
    assert work(2, 0, at_random=True).next((9.0, 9.0), Roster(), (), (), 0) == ()
    assert work(2, 0, at_random=True).next((9.0, 9.0), Roster(), (), (1,), 3) == ()


@given(st.lists(st.tuples(st.sampled_from("jlf"), st.integers(5, 7), st.integers(0, 4)), max_size=30))
def test_a_roster_holds_each_searcher_with_the_newest_epoch_that_it_has_not_left_since(
    steps: list[tuple[str, int, int]],
) -> None:
    """A model: what a searcher's last word about membership was, by epochs."""
    roster = Roster()
    model: dict[int, int] = {}
    for kind, searcher, epoch in steps:
        if kind == "j":
            fresh = epoch > model.get(searcher, -1)
            assert roster.add(searcher, epoch, 0) == fresh
            model[searcher] = max(epoch, model.get(searcher, -1))
        elif kind == "l":
            goes = searcher in model and model[searcher] <= epoch
            assert roster.remove(searcher, epoch) == goes
            if goes:
                del model[searcher]
        else:
            assert roster.forgotten(0) == []
        assert {each: member.epoch for each, member in roster.members.items()} == model
