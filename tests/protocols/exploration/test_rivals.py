"""Which frontier each robot of a team goes to: against a plain model, against all choices there are, and on maps."""

import itertools
import math

import numpy as np
import pytest

from cosim.arrays import Floats
from cosim.geometry.planning import Point
from cosim.machine import Event
from protocols.exploration.events import Counters, Explored, FrontierGivenUp, PathLaid
from protocols.exploration.parameters import EscapeParameters, RivalParameters
from protocols.exploration.rivals import Rival
from protocols.exploration.targets import Targets, by_assignment, by_utility
from protocols.exploration.terrain import Terrain
from protocols.mapping.belief import Belief
from tests.protocols.exploration.hand_map import at, drawn, observed, renew

INF = math.inf


def random_costs(seed: int) -> Floats:
    """Return costs of few robots and frontiers, of which some cannot be come to."""
    draw = np.random.default_rng(seed)
    costs = draw.uniform(1.0, 60.0, draw.integers(1, 6, 2))
    costs[draw.random(costs.shape) < 0.25] = INF
    return costs


# ---------------------------------------------------------------- utility less cost (Burgard et al., 2005)


def model(costs: list[list[float]], places: list[list[float]], reach: float, weight: float) -> dict[int, int]:
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
            d = math.dist(places[best[2]], places[frontier])
            utility[frontier] -= 1.0 - d / reach if d < reach else 0.0


@pytest.mark.parametrize("weight", [0.0, 0.5, 1.0, 3.0])
def test_utilities_are_dealt_out_as_the_algorithm_is_printed(weight: float) -> None:
    several = 0
    for seed in range(60):
        costs = random_costs(seed)
        places = np.random.default_rng(seed + 1000).uniform(0.0, 40.0, (costs.shape[1], 2))
        expected = model(costs.tolist(), places.tolist(), 25.0, weight)
        assert by_utility(costs, places, 25.0, weight) == [expected.get(robot) for robot in range(len(costs))]
        several += len(set(expected.values())) > 1
    assert several > 20


def test_a_second_robot_leaves_what_the_first_will_see() -> None:
    """Both are nearest to frontier 0, frontier 1 is beside it, frontier 2 far off."""
    costs = np.array([[10.0, 11.0, 20.0], [12.0, 13.0, 20.0]])
    places = np.array([[0.0, 0.0], [0.6, 0.8], [24.0, 18.0]])
    assert by_utility(costs, places, 25.0, 1.0) == [0, 2]
    assert by_utility(costs, places, 25.0, 9.0) == [0, 0]  # if ways count for much
    assert by_utility(costs, places, 0.5, 1.0) == [0, 1]  # if it will see frontier 0 only


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


def team(algorithm: str, belief: Belief, places: dict[int, Point], size: int = 4, least: int = 2) -> Targets:
    """Return what chooses for robots that are points."""
    own = RivalParameters(least_cells=least)
    terrain = Terrain(belief, EscapeParameters())
    return Targets(algorithm, own, terrain, (0.0,) * size, 2.5, places)


def rival(targets: Targets, me: int = 0) -> tuple[Rival, list[Event]]:
    events: list[Event] = []
    return Rival(targets, Counters(), events, me, 10, 30), events


def goes_to(algorithm: str, places: list[Point], me: int) -> Point:
    """Return where a robot of a team goes in the corridor."""
    leader, events = rival(team(algorithm, drawn(CORRIDOR), dict(enumerate(places))), me)
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


def test_a_robot_keeps_its_target_while_it_is_a_frontier() -> None:
    """Even when another one has become the nearer."""
    leader, events = rival(team("nearest", drawn(CORRIDOR), {}))
    for tick in range(25):
        heading = leader.lead(observed(at(9 + 0.1 * tick, 2)), True)
        assert heading is not None
        assert abs(heading) == pytest.approx(math.pi, abs=0.1)
    assert [type(event) for event in events] == [PathLaid]


def test_a_target_that_is_no_frontier_any_more_is_left_after_a_time() -> None:
    belief = drawn(CORRIDOR)
    leader, events = rival(team("nearest", belief, {}))
    leader.lead(observed(at(8, 2)), True)
    belief.evidence[1:4, 0] = 127
    renew(belief)
    headings = [leader.lead(observed(at(8, 2)), True) for _ in range(11)]
    assert [heading == pytest.approx(0.0) for heading in headings] == [False] * 9 + [True] * 2
    assert [type(event) for event in events] == [PathLaid] * 2
    assert (events[1].x_m, events[1].y_m) == pytest.approx(RIGHT)  # type: ignore[attr-defined]


def test_the_target_is_the_cell_of_the_group_that_the_cheapest_way_leads_to() -> None:
    """Not the middle of a long frontier."""
    belief = drawn("?????????? .......... .......... ..........")
    for ix in (2, 5, 7):
        leader, events = rival(team("nearest", belief, {}))
        leader.lead(observed(at(ix, 0)), True)
        (laid,) = events
        assert isinstance(laid, PathLaid)
        assert (laid.x_m, laid.y_m) == pytest.approx(at(ix, 2))


@pytest.mark.parametrize("algorithm", ["nearest", "assignment"])
def test_who_has_come_to_a_frontier_in_vain_leaves_it_and_all_in_sight_near_by_for_good(algorithm: str) -> None:
    belief = drawn(CORRIDOR)
    targets = team(algorithm, belief, {})
    leader, events = rival(targets)
    for ix in (5, 2):
        leader.lead(observed(at(ix, 2)), False)
    assert [type(event) for event in events[:4]] == [PathLaid] + [FrontierGivenUp] * 3
    gone = {(event.x_m, event.y_m, event.why) for event in events[1:4] if isinstance(event, FrontierGivenUp)}
    assert gone == {(*at(1, iy), "nothing new is seen there") for iy in (1, 2, 3)}
    assert isinstance(events[4], PathLaid)
    assert (events[4].x_m, events[4].y_m) == pytest.approx(RIGHT)
    belief.version += 1
    other, seen = rival(targets, 1)
    other.lead(observed(at(3, 2)), True)
    assert isinstance(seen[0], PathLaid)
    assert (seen[0].x_m, seen[0].y_m) == pytest.approx(RIGHT), "nor does another with the same map go there"


def test_a_robot_waits_with_that_while_another_may_hide_what_is_there() -> None:
    leader, events = rival(team("nearest", drawn(CORRIDOR), {}))
    for ix in (4, 3, 2):
        leader.lead(observed(at(ix, 2), at(1, 1)), False)
    assert [type(event) for event in events] == [PathLaid]
    for _ in range(17):
        leader.lead(observed(at(2, 2), at(1, 1)), False)
    assert FrontierGivenUp in [type(event) for event in events], "but not for ever"


def test_who_makes_no_way_goes_round_who_stands_near() -> None:
    belief = drawn(CORRIDOR)
    leader, events = rival(team("nearest", belief, {}))
    for _ in range(32):
        leader.lead(observed(at(7, 2), at(5, 1), at(5, 2), at(5, 3)), False)
    assert [type(event) for event in events] == [PathLaid] * 2
    assert (events[1].x_m, events[1].y_m) == pytest.approx(RIGHT)  # type: ignore[attr-defined]


@pytest.mark.parametrize("algorithm", ["nearest", "utility", "assignment"])
def test_who_makes_no_way_alone_gives_the_target_up(algorithm: str) -> None:
    leader, events = rival(team(algorithm, drawn(CORRIDOR), {}))
    for _ in range(32):
        leader.lead(observed(at(7, 2)), False)
    assert events[1:4] == [FrontierGivenUp(*at(1, iy), "no way is made there") for iy in (1, 2, 3)]
    assert isinstance(events[4], PathLaid)
    assert (events[4].x_m, events[4].y_m) == pytest.approx(RIGHT)


def test_of_two_that_drive_close_to_each_other_that_with_the_higher_number_waits() -> None:
    belief = drawn(CORRIDOR)
    high, low = at(8, 2), at(7, 2)

    def drives(me: int, here: Point, others: list[list[Point]]) -> bool:
        leader, _ = rival(team("nearest", belief, {}, 9), me)
        return [leader.lead(observed(here, *places), True) is not None for places in others][-1]

    beside = (low[0] - 0.1, low[1])
    assert drives(8, low, [[at(2, 2)]])
    assert not drives(8, (beside[0] + 0.25, low[1]), [[beside], [(beside[0] - 0.01, low[1])]])
    assert drives(8, (beside[0] + 0.25, low[1]), [[beside], [beside]]), "who stands is gone round"
    assert drives(0, (beside[0] + 0.25, low[1]), [[beside], [(beside[0] - 0.01, low[1])]]), "the other waits"
    assert drives(8, (beside[0] + 0.45, low[1]), [[beside], [(beside[0] - 0.01, low[1])]]), "there is room"
    assert drives(8, low, [[(low[0] + 0.2, low[1])], [(low[0] + 0.21, low[1])]]), "the other is behind"
    assert drives(8, high, [[], [beside]]), "nothing is known of how it drives"


def test_a_choice_for_one_is_a_choice_for_all_with_the_same_map() -> None:
    """Robot 1 has been alone with the left frontier; robot 0 comes to be nearer to it."""
    belief, places = drawn(CORRIDOR), {1: at(6, 2)}
    targets = team("assignment", belief, places)
    second, events = rival(targets, 1)
    second.lead(observed(at(6, 2)), True)
    first, _ = rival(targets, 0)
    first.lead(observed(at(3, 2)), True)
    assert len(events) == 1
    assert second.lead(observed(at(6, 2)), True) == pytest.approx(0.0)
    assert isinstance(events[-1], PathLaid)
    assert (events[-1].x_m, events[-1].y_m) == pytest.approx(RIGHT)


def test_a_robot_that_stands_where_it_does_not_fit_finds_its_way_out() -> None:
    """By its map the wall is in its cell; the floor under it is unknown."""
    belief = drawn("######## #......? #......? #..??..? #......? #......? ########")
    terrain = Terrain(belief, EscapeParameters())
    assert terrain.entry(at(4, 4), 0.45) == [4 * 8 + 4]
    assert not terrain.passable(0.45)[5, 4]
    assert terrain.entry(at(4, 5), 0.45) == [5 * 8 + 4, 4 * 8 + 4]
    assert terrain.entry(at(4, 6), 0.45) == [6 * 8 + 4, 5 * 8 + 4, 4 * 8 + 4]
    assert terrain.entry(at(4, 3), 0.45) in ([3 * 8 + 4, 4 * 8 + 4], [3 * 8 + 4, 2 * 8 + 4])
    belief.evidence[1:, 3] = 127
    belief.evidence[1:, 5] = 127
    belief.evidence[1, :] = 127
    belief.version += 1
    assert terrain.entry(at(4, 6), 0.45) == []


def test_terrain_is_worked_out_once_for_each_version_of_the_map() -> None:
    belief = drawn(CORRIDOR)
    terrain = Terrain(belief, EscapeParameters())
    passable, extra = terrain.passable(0.0), terrain.extra()
    assert passable.sum() == 3 * 18
    assert terrain.passable(0.0) is passable
    assert terrain.extra() is extra
    assert terrain.passable(0.4) is not passable
    belief.evidence[2, 5] = 127
    assert terrain.passable(0.0) is passable
    belief.version += 1
    assert not terrain.passable(0.0)[2, 5]
    assert terrain.extra()[2, 6] > extra[2, 6]


def test_frontiers_that_no_way_leads_to_are_named_once_and_the_robot_stands() -> None:
    belief = drawn("########## #...#....? #...#....? #...#....? ##########")
    leader, events = rival(team("utility", belief, {}))
    assert not leader.done
    assert [leader.lead(observed(at(2, 2)), False) for _ in range(5)] == [None] * 5
    assert leader.done
    names = [FrontierGivenUp(*at(8, iy), "no way leads there") for iy in (1, 2, 3)]
    assert events == [*names, Explored()]
    belief.evidence[2, 4] = -1
    renew(belief)
    assert not leader.done
    headings = [leader.lead(observed(at(2, 2)), True) for _ in range(10)]
    assert headings[4] is None, "it looks at the map again after a time only"
    assert headings[-1] == pytest.approx(0.0)
    belief.evidence[2, 4] = 127
    renew(belief)
    leader._way = []
    leader.lead(observed(at(2, 2)), True)
    assert [type(event) for event in events[4:]] == [PathLaid, Explored]
