"""Roles: the assignment is the cheapest of all permutations, and what is short is named truly."""

import math
from itertools import combinations, permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.deployment.planning.binding import Role
from protocols.deployment.planning.play import Needs
from protocols.deployment.planning.roles import Prices, Shortage, assigned, unfit, wanted
from protocols.deployment.tasks.crew import Body


@st.composite
def priced(draw: st.DrawFn) -> tuple[list[Role], list[int], Prices]:
    """Draw roles, robots and prices, some of which are reasons."""
    roles = [Role(f"role {number}", ()) for number in range(draw(st.integers(1, 4)))]
    robots = draw(st.lists(st.integers(0, 9), max_size=5, unique=True))
    prices: dict[tuple[str, int], float | str] = {}
    for role in roles:
        for robot in robots:
            prices[role.name, robot] = draw(st.integers(0, 20).map(float) | st.just(f"{robot} cannot play {role.name}"))
    return roles, robots, prices


def cheapest(roles: list[Role], robots: list[int], prices: Prices) -> float:
    """Return the least sum of prices of all assignments, by trying all."""

    def total(cast: tuple[int, ...]) -> float:
        found = [prices[role.name, robot] for role, robot in zip(roles, cast, strict=True)]
        return sum(math.inf if isinstance(price, str) else price for price in found)

    return min((total(cast) for cast in permutations(robots, len(roles))), default=math.inf)


def able(name: str, robots: list[int], prices: Prices) -> set[int]:
    return {robot for robot in robots if not isinstance(prices[name, robot], str)}


@given(priced())
def test_the_assignment_is_the_cheapest_or_there_is_none(case: tuple[list[Role], list[int], Prices]) -> None:
    roles, robots, prices = case
    found = assigned(roles, robots, prices)
    best = cheapest(roles, robots, prices)
    assert isinstance(found, Shortage) == math.isinf(best)
    if isinstance(found, Shortage):
        assert set(found.robots) == {robot for name in found.roles for robot in able(name, robots, prices)}
        assert len(found.robots) < len(found.roles)  # Hall: so they cannot all be played
        refused = {prices[name, robot] for name in found.roles for robot in robots} - {0.0}
        assert set(found.reasons) == {why for why in refused if isinstance(why, str)}
        unplayed = min(
            len(roles) - size
            for size in range(len(roles) + 1)
            for some in combinations(roles, size)
            if not math.isinf(cheapest(list(some), robots, prices)) or not some
        )
        assert len(found.lacking) == unplayed
    else:
        assert found.keys() == {role.name for role in roles}
        assert len(set(found.values())) == len(found)
        assert sum(float(prices[name, robot]) for name, robot in found.items()) == best


def test_two_robots_change_places_if_that_is_shorter_together() -> None:
    """Each robot is nearest to the same place; the sum decides, not who comes first."""
    prices = {("a", 0): 1.0, ("a", 1): 2.0, ("b", 0): 3.0, ("b", 1): 9.0}
    assert assigned([Role("a", ()), Role("b", ())], [0, 1], prices) == {"a": 1, "b": 0}


@pytest.mark.parametrize(
    ("needs", "body", "why"),
    [
        (Needs(camera=True), Body(camera=False), "robot 3 has no camera"),
        (Needs(camera=True), Body(camera=True), None),
        (Needs(sensor="sonar"), Body(sensor="laser"), "robot 3 has a laser, no sonar"),
        (Needs(sensor="laser"), Body(sensor="laser"), None),
        (Needs(passage_m=0.5), Body(radius_m=0.3), "robot 3 is 0.6 m wide, too wide for a passage of 0.5 m"),
        (Needs(passage_m=0.6), Body(radius_m=0.3), None),
    ],
)
def test_a_robot_fits_a_role_or_it_is_told_why_not(needs: Needs, body: Body, why: str | None) -> None:
    assert unfit((Needs(), needs), 3, body) == why


def test_needs_are_told_in_words() -> None:
    assert wanted((Needs(),)) == "a robot"
    assert wanted((Needs(camera=True), Needs(sensor="laser", passage_m=0.9), Needs(passage_m=0.7))) == (
        "a robot with a camera with a laser at most 0.7 m wide"
    )


def test_nobody_there_at_all_is_a_shortage_of_each_role() -> None:
    found = assigned([Role("a", ()), Role("b", ())], [], {})
    assert isinstance(found, Shortage)
    assert (set(found.lacking), found.robots) == ({"a", "b"}, ())


def test_equal_prices_are_decided_the_same_way_every_time() -> None:
    stream = np.random.default_rng(1)
    roles = [Role(f"role {number}", ()) for number in range(5)]
    prices = {(role.name, robot): float(stream.integers(3)) for role in roles for robot in range(6)}
    first = assigned(roles, range(6), prices)
    assert all(assigned(roles, range(6), dict(reversed(prices.items()))) == first for _ in range(3))
