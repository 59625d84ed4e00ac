"""Patrols: way points in turn, back to the way along a thread, and what a lost helper does."""

import math
from collections.abc import Sequence

import pytest

from cosim.navigation.status import Status
from cosim.navigation.steering import Steer
from cosim.observation import Observation
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.units import MS, S
from protocols.reflection.patrolling import Patrol
from protocols.reflection.straight import Straight

POINTS = ((0.0, 0.0), (9.0, 0.0), (9.0, 5.0))
STEP_M = 0.1


class Upwards:
    """A navigator that is easy to recognise."""

    def steer(
        self,
        x_m: float,
        y_m: float,
        goal_m: tuple[float, float],
        ranges_m: Sequence[float],
        sightings_m: Sequence[tuple[float, float]] = (),
        step_m: float = 0.1,
    ) -> Steer:
        return Steer(0.0, 1.0, Status.UNDERWAY)

    def restart(self) -> None:
        pass


def patrol(shuttle: bool = True) -> Patrol:
    return Patrol(POINTS, shuttle, STEP_M, Straight(0.2, STEP_M, 2 * S, 0), Upwards())


def at(x_m: float, y_m: float) -> Observation:
    return Observation(x_m, y_m, 0.0, 0.0, False, False)


@pytest.mark.parametrize(("shuttle", "order"), [(True, [1, 2, 1, 0, 1]), (False, [1, 2, 0, 1, 2])])
def test_way_points_follow_each_other(shuttle: bool, order: list[int]) -> None:
    walk, seen, now = patrol(shuttle), [], 0
    here = POINTS[0]
    for _ in order:
        now += S
        here = walk.choose(at(*here), {}, now)
        seen.append(POINTS.index(here))
    assert seen == order


def test_a_robot_that_left_its_way_goes_back_along_a_thread() -> None:
    walk = patrol()
    walk.look([], (1.0, 0.0))
    walk.left((1.0, 0.0))
    assert walk.places() == [(1.0, 0.0)]
    walk.look([True], (1.0, 1.0))
    assert walk.places() == [(1.0, 0.0)]
    walk.look([False], (2.0, 2.0))  # round a corner
    assert walk.places() == [(1.0, 1.0), (1.0, 0.0)]
    assert walk.choose(at(2.0, 2.0), {}, S) == (1.0, 1.0)
    walk.look([True, True], (1.5, 0.5))
    assert walk.choose(at(1.5, 0.5), {}, S) == (1.0, 0.0)
    assert walk.choose(at(1.05, 0.0), {}, S) == POINTS[0]
    assert not walk.off_its_way


def test_a_helper_that_comes_nowhere_takes_to_the_algorithm_until_it_is_at_a_way_point() -> None:
    walk = patrol()
    going = [walk.choose(at(4.0, 4.0), {}, now) for now in range(0, 5 * S, 100 * MS)]
    assert going[0] == POINTS[0]
    assert going[25] == POINTS[1]  # tries the next
    assert going[-1] == pytest.approx((4.0, 5.0))  # lost: ten steps upwards
    assert walk.places() == list(walk.points_m)
    walk.look([False, False, False, False], (4.0, 5.0))
    assert walk.choose(at(4.0, 5.0), {}, 11 * S) == pytest.approx((4.0, 6.0))
    walk.look([False, False, True, False], (4.0, 6.0))
    assert walk.choose(at(4.0, 6.0), {}, 12 * S) == POINTS[2]
    assert not walk.off_its_way
    assert walk.choose(at(*POINTS[2]), {}, 13 * S) == POINTS[1]


def test_a_lost_helper_that_sees_a_way_point_tries_the_algorithm_for_a_while_first() -> None:
    """It has just failed to go there straight."""
    walk = patrol()
    for now in range(0, 5 * S, 100 * MS):
        walk.choose(at(4.0, 4.0), {}, now)
    walk.look([True] * 4, (4.0, 4.0))
    assert walk.choose(at(4.0, 4.0), {}, 5 * S) == pytest.approx((4.0, 5.0))
    walk.look([True] * 4, (4.0, 4.0))
    assert walk.choose(at(4.0, 4.0), {}, 10 * S) == POINTS[0]


def test_a_helper_that_was_carried_away_is_lost() -> None:
    walk = patrol()
    walk.displaced(0)
    assert walk.choose(at(4.0, 4.0), {}, 0) == pytest.approx((4.0, 5.0))


@pytest.mark.slow
def test_a_way_point_that_is_seen_past_a_jamb_does_not_hold_a_lost_helper_in_a_room_for_ever() -> None:
    """It sees the end of the corridor through the door, and its body does not pass the door on that line."""
    walls = [[0, 6, 14.45, 6], [15.55, 6, 24, 6], [12, 0, 12, 6], [16, 0, 16, 6], [0, 8, 24, 8]]
    patrol = [(23.0, 6.5), (1.0, 6.5)]
    scenario = Scenario.model_validate(
        {
            "duration_s": 320,
            "floorplan": {"map": "walls", "bounds_m": [0, 0, 24, 14], "walls": walls},
            "team": {
                "size": 2,
                "starts": [(2.0, 3.0), (14.0, 3.0)],
                "sight_range_m": 12,
                "body": {"radius_m": 0.2, "speed_mps": 1.0, "acceleration_mps2": 100, "drive": "omni"},
                "senses": {"frames": "own", "beams": 24},
            },
            "channel": {"kind": "optical", "range_m": 12},
            "protocol": {
                "use": "reflection",
                "parameters": {
                    "algorithm": "straight",
                    "give_up_s": 1000,
                    "targets": [[(-50.0, -50.0)]],
                    "patrols": [patrol],
                },
            },
        }
    )
    nearest = math.inf
    run = Simulation(scenario, 1)
    run.begin()
    for second in range(1, 320):
        run.kernel.run(second * S)
        nearest = min(nearest, *(math.dist(run.fleet.positions_m[1], point) for point in patrol))
    assert nearest < 0.3
