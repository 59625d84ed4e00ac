"""Which frontier each robot of a team goes to: against a plain model, against all choices there are, and on maps."""

import itertools
import math

import numpy as np
import pytest

from cosim.geometry.planning import Point
from cosim.machine import Event
from cosim.navigation.schemas import Floats
from protocols.exploration.belief import Belief
from protocols.exploration.journal import Explored, FrontierGivenUp, PathLaid
from protocols.exploration.parameters import EscapeParameters, RivalParameters
from protocols.exploration.records import Records
from protocols.exploration.rivals import Rival, away_cells, by_assignment, by_utility
from tests.exploration.hand_map import at, drawn, observed, renew

INF = math.inf


def random_costs(seed: int) -> Floats:
    """Return costs of few robots and frontiers, of which some cannot be come to."""
    draw = np.random.default_rng(seed)
    costs = draw.uniform(1.0, 60.0, draw.integers(1, 6, 2))
    costs[draw.random(costs.shape) < 0.25] = INF
    return costs


# ---------------------------------------------------------------- utility less cost (Burgard et al., 2005)


def model(costs: list[list[float]], away: list[list[float]], reach: float, weight: float) -> dict[int, int]:
    """Return Algorithm 1 of the paper, step by step, in plain Python."""
    finite = [cost for row in costs for cost in row if cost < INF]
    most = max(finite, default=1.0)
    utility = dict.fromkeys(range(len(costs[0])), 1.0)
    chosen: dict[int, int] = {}
    while True:
        best = None
        for robot, row in enumerate(costs):
            for frontier, cost in enumerate(row):
                if robot not in chosen and cost < INF:
                    worth = utility[frontier] - weight * cost / most
                    if best is None or worth > best[0]:
                        best = worth, robot, frontier
        if best is None:
            return chosen
        chosen[best[1]] = best[2]
        for frontier in utility:
            d = away[best[2]][frontier]
            utility[frontier] -= 1.0 - d / reach if d < reach else 0.0


@pytest.mark.parametrize("weight", [0.0, 0.5, 1.0, 3.0])
def test_utilities_are_dealt_out_as_the_algorithm_is_printed(weight: float) -> None:
    several = 0
    for seed in range(60):
        costs = random_costs(seed)
        cells = np.random.default_rng(seed + 1000).choice(40 * 30, costs.shape[1], replace=False)
        away = away_cells(cells, 40)
        expected = model(costs.tolist(), away.tolist(), 25.0, weight)
        assert by_utility(costs, away, 25.0, weight) == [expected.get(robot) for robot in range(len(costs))]
        several += len(set(expected.values())) > 1
    assert several > 20


def test_distances_between_frontiers_are_straight() -> None:
    away = away_cells(np.array([0, 3 + 4 * 10, 9]), 10)
    assert away.tolist() == [[0.0, 5.0, 9.0], [5.0, 0.0, pytest.approx(math.hypot(6, 4))], [9.0, away[1, 2], 0.0]]


def test_a_second_robot_leaves_what_the_first_will_see() -> None:
    """Both are nearest to frontier 0, frontier 1 is beside it, frontier 2 far off."""
    costs = np.array([[10.0, 11.0, 20.0], [12.0, 13.0, 20.0]])
    away = away_cells(np.array([0, 1, 30]), 100)
    assert by_utility(costs, away, 25.0, 1.0) == [0, 2]
    assert by_utility(costs, away, 25.0, 9.0) == [0, 0]  # if ways count for much
    assert by_utility(costs, away, 0.5, 1.0) == [0, 1]  # if it will see frontier 0 only


# ---------------------------------------------------------------- assignment


def best_of_all(costs: Floats) -> tuple[int, float]:
    """Return the most robots that can go, each to another frontier, and the least sum then, of all ways to choose."""
    robots, frontiers = costs.shape
    found = []
    for choice in itertools.product([None, *range(frontiers)], repeat=robots):
        taken = [(robot, frontier) for robot, frontier in enumerate(choice) if frontier is not None]
        if len({frontier for _, frontier in taken}) == len(taken):
            total = sum(costs[pair] for pair in taken)
            if total < INF:
                found.append((-len(taken), total))
    most, least = min(found)
    return -most, least


def test_the_assignment_is_that_of_the_least_sum() -> None:
    for seed in range(40):
        costs = random_costs(seed)[:4, :4]
        chosen = by_assignment(costs)
        taken = [(robot, frontier) for robot, frontier in enumerate(chosen) if frontier is not None]
        assert len(chosen) == len(costs)
        assert len({frontier for _, frontier in taken}) == len(taken)
        count, least = best_of_all(costs)
        assert len(taken) == count
        assert sum(costs[pair] for pair in taken) == pytest.approx(least)


def test_a_robot_leaves_its_nearest_frontier_to_another_if_that_is_better_for_both() -> None:
    assert by_assignment(np.array([[1.0, 2.0], [2.0, 9.0]])) == [1, 0]
    assert by_assignment(np.array([[1.0, INF], [2.0, INF]])) == [0, None]


# ---------------------------------------------------------------- on maps

CORRIDOR = """
    ####################
    ?..................?
    ?..................?
    ?..................?
    ####################
"""
LEFT, RIGHT = at(1, 2), at(18, 2)


def rival(algorithm: str, belief: Belief, places: dict[int, Point], me: int = 0) -> tuple[Rival, list[Event]]:
    events: list[Event] = []
    own = RivalParameters(least_cells=2)
    return (
        Rival(algorithm, own, EscapeParameters(), belief, Records(), events, me, 0.0, 2.5, places, 10),
        events,
    )


def goes_to(algorithm: str, places: list[Point], me: int) -> Point:
    """Return where a robot of a team goes in the corridor."""
    leader, events = rival(algorithm, drawn(CORRIDOR), dict(enumerate(places)), me)
    leader.lead(observed(places[me]), True)
    (laid,) = events
    assert isinstance(laid, PathLaid)
    return laid.x_m, laid.y_m


def test_alone_all_go_to_the_nearest_frontier() -> None:
    for algorithm in ("nearest", "utility", "assignment"):
        assert goes_to(algorithm, [at(5, 2)], 0) == pytest.approx(LEFT)
        assert goes_to(algorithm, [at(14, 2)], 0) == pytest.approx(RIGHT)


@pytest.mark.parametrize("algorithm", ["utility", "assignment"])
def test_two_that_coordinate_go_to_different_frontiers_and_both_come_to_the_same_end(algorithm: str) -> None:
    places = [at(6, 2), at(7, 2)]
    assert [goes_to(algorithm, places, me) for me in (0, 1)] == [pytest.approx(LEFT), pytest.approx(RIGHT)]
    assert [goes_to(algorithm, places[::-1], me) for me in (0, 1)] == [pytest.approx(RIGHT), pytest.approx(LEFT)]
    assert [goes_to("nearest", places, me) for me in (0, 1)] == [pytest.approx(LEFT)] * 2


def test_who_is_left_over_goes_to_the_nearest() -> None:
    places = [at(2, 2), at(17, 2), at(13, 2)]
    assert goes_to("assignment", places, 2) == pytest.approx(RIGHT)


def test_a_robot_heads_along_its_way_and_plans_anew_after_a_time() -> None:
    leader, events = rival("nearest", drawn(CORRIDOR), {})
    for tick in range(25):
        heading = leader.lead(observed(at(9 - 0.1 * tick, 2)), True)
        assert heading is not None
        assert abs(heading) == pytest.approx(math.pi, abs=0.1)
        assert len(events) == 1 + tick // 10


def test_a_robot_goes_on_to_a_frontier_that_is_near() -> None:
    """Even if it is not to be seen from where the robot is."""
    leader, _ = rival("nearest", drawn(CORRIDOR), {})
    assert leader.lead(observed(at(3, 2)), True) == pytest.approx(math.pi)


def test_a_frontier_at_which_nothing_new_is_seen_is_given_up_and_another_chosen() -> None:
    belief = drawn(CORRIDOR)
    leader, events = rival("nearest", belief, {})
    for _ in range(31):
        assert leader.lead(observed(at(2, 2)), False) is not None
    assert all(isinstance(event, PathLaid) for event in events)
    leader.lead(observed(at(2, 2)), False)
    gone = [event for event in events if isinstance(event, FrontierGivenUp)]
    assert gone == [FrontierGivenUp(*LEFT, "nothing new is seen there")]
    assert isinstance(events[-1], PathLaid)
    assert (events[-1].x_m, events[-1].y_m) == pytest.approx(RIGHT)
    patient, events = rival("nearest", belief, {})
    for tick in range(80):
        patient.lead(observed(at(2, 2)), tick % 20 == 0)
    assert not any(isinstance(event, FrontierGivenUp) for event in events)


def test_frontiers_that_no_way_leads_to_are_named_once_and_the_robot_stands() -> None:
    belief = drawn("########## #...#....? #...#....? #...#....? ##########")
    leader, events = rival("utility", belief, {})
    assert not leader.done
    assert [leader.lead(observed(at(2, 2)), False) for _ in range(5)] == [None] * 5
    assert leader.done
    assert events == [FrontierGivenUp(*at(8, 2), "no way leads there"), Explored()]
    belief.evidence[2, 4] = -1
    renew(belief)
    assert not leader.done
    assert leader.lead(observed(at(2, 2)), True) == pytest.approx(0.0)
    belief.evidence[2, 4] = 127
    renew(belief)
    leader._way = []
    leader.lead(observed(at(2, 2)), True)
    assert [type(event) for event in events[2:]] == [PathLaid, Explored]
