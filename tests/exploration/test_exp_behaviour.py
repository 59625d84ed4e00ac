"""The paper's behaviour: the sum of its schemas, and the nine steps of its algorithm, on maps drawn by hand."""

import math
from typing import Any

import numpy as np
import pytest

from cosim.geometry.marking import CERTAIN
from cosim.machine import Event
from cosim.units import MS
from protocols.exploration.behaviour import Behaviour
from protocols.exploration.belief import Belief, Frame
from protocols.exploration.journal import Explored, FrontierGivenUp, PathLaid, PathLeft, Stalled
from protocols.exploration.parameters import Parameters
from protocols.exploration.records import Records
from tests.exploration.hand_map import ORIGIN_M, at, drawn, observed, path_of, renew

CORRIDOR = """
    ##############################
    #............................?
    #............................?
    #............................?
    ##############################
"""
"""From its left end, no obstacle is within half a metre of the middle row, and no frontier within 5 m."""
CLOSED = "####### #..#..? #..#..? #######"


class Led:
    """One robot that is led, and where the path that it has laid is."""

    def __init__(self, belief: Belief, **changes: Any) -> None:
        self.belief = belief
        self.records = Records()
        self.journal: list[Event] = []
        parameters = Parameters.model_validate(changes)
        self.behaviour = Behaviour(parameters, belief, self.records, self.journal, 0.0, 2.5, 100 * MS)

    def lead(self, ix: float, iy: float, *others: tuple[float, float], gained: bool = True) -> float | None:
        return self.behaviour.lead(observed(at(ix, iy), *others), gained)

    @property
    def path(self) -> list[tuple[int, int]]:
        return path_of(self.behaviour._overlay.path, self.belief)

    def named(self, kind: type) -> list[Any]:
        return [event for event in self.journal if isinstance(event, kind)]


# ---------------------------------------------------------------- equations 2 to 5


def forces(belief: Belief, wanted: Any, place: Any, reach_m: float) -> Any:
    """Return the sum of 1 / d^2 towards the cells *wanted*, as the paper prints it."""
    iy, ix = np.nonzero(wanted)
    away = np.stack(at(ix, iy), axis=1) - place if len(ix) else np.empty((0, 2))
    d = np.hypot(*away.T)
    near = d <= reach_m
    return (away[near] / d[near, None] ** 3).sum(axis=0)


@pytest.mark.parametrize("seed", range(12))
def test_the_heading_is_that_of_the_sum_of_equation_2(seed: int) -> None:
    draw = np.random.default_rng(seed)
    belief = Belief(Frame(ORIGIN_M, 0.5, 29, 23), CERTAIN, 2.5)
    belief.evidence[:] = draw.choice(np.array([-1, 0, 127], np.int8), (23, 29), p=(0.8, 0.15, 0.05))
    belief.evidence[11, 13:16] = -1
    renew(belief)
    place = np.array(at(14.2, 11.3))
    others = [(place[0] + x, place[1] + y) for x, y in draw.uniform(-1.5, 1.5, (4, 2))]
    schemas = {"frontier_m": 4.1, "frontier_gain": 0.7, "obstacle_m": 1.3, "obstacle_gain": 0.9}
    robot_m, robot_gain = 0.9 * 1.3, 3.0 * 0.9
    led = Led(belief, schemas={**schemas, "robot_range_scale": 0.9, "robot_gain_scale": 3.0})
    unknown, empty = belief.evidence == 0, np.pad(belief.evidence < 0, 1)
    beside = np.zeros_like(unknown)
    for dy in range(3):
        for dx in range(3):
            beside |= empty[dy : dy + 23, dx : dx + 29]
    total = 0.7 * forces(belief, unknown & beside, place, 4.1) - 0.9 * forces(belief, belief.evidence > 0, place, 1.3)
    for other in others:
        away = np.array(other) - place
        d = math.hypot(*away)
        total = total - (robot_gain * away / d**3 if d <= robot_m else 0.0)
    expected = math.atan2(total[1], total[0])
    found = led.behaviour.lead(observed((place[0], place[1]), *others), True)
    assert found is not None
    assert math.remainder(found - expected, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert led.journal == []


def test_robots_repel_up_to_their_range_and_not_beyond() -> None:
    for away_m, heading in ((1.24, 0.0), (1.26, None)):  # 2.5 times 0.5 m
        led = Led(drawn(CORRIDOR), escape={"enabled": False})
        x, y = at(5, 2)
        assert led.lead(5, 2, (x - away_m, y)) == (None if heading is None else pytest.approx(heading))


def test_who_stands_where_another_is_seen_is_not_repelled_at_random() -> None:
    led = Led(drawn(CORRIDOR), escape={"enabled": False})
    assert led.lead(5, 2, at(5, 2)) is None


# ---------------------------------------------------------------- steps 2 to 9 of section 3.8


def test_without_a_force_a_path_is_laid_to_the_nearest_frontier_and_attracts() -> None:
    led = Led(drawn(CORRIDOR))
    heading = led.lead(2, 2)
    assert led.journal[0] == Stalled("no force")
    laid = led.journal[1]
    assert isinstance(laid, PathLaid)
    assert laid.in_sight
    assert (laid.x_m, laid.y_m) in {at(29, iy) for iy in range(5)}
    assert led.path == [(ix, 2) for ix in range(3, 29)] + [led.path[-1]]
    assert led.behaviour.underway
    assert heading == pytest.approx(0.0, abs=0.05)
    assert led.records.stalls == 1


def test_a_path_is_taken_back_within_the_obstacles_range_and_left_when_a_frontier_is_in_sight() -> None:
    led = Led(drawn(CORRIDOR))
    led.lead(2, 2)
    laid = led.path
    for ix in range(3, 23):
        assert led.lead(ix, 2) == pytest.approx(0.0, abs=0.2)
        assert led.path == [cell for cell in laid if cell[0] > ix + 1]  # a cell is 0.5 m, as is obstacle_m
    assert led.named(PathLeft) == []
    for _ in range(5):
        led.lead(24, 2)  # 2.5 m from (29, 2)
    assert led.named(PathLeft) == [PathLeft("frontier in sight")]
    assert led.path == []
    assert not led.behaviour.underway
    assert led.lead(24, 2) == pytest.approx(0.0)


def test_a_path_that_was_walked_to_its_end_is_left() -> None:
    led = Led(drawn(CORRIDOR))
    led.lead(2, 2)
    led.belief.evidence[:, 29] = 127  # another has seen that there is nothing
    led.belief.evidence[1, 20] = 0
    renew(led.belief)
    led.behaviour._overlay.give_up([30 + 20])
    for ix in range(3, 29):
        led.lead(ix, 2)
    assert led.named(PathLeft) == [PathLeft("walked")]


def test_without_escape_a_robot_that_no_force_draws_stalls_and_stays() -> None:
    led = Led(drawn(CORRIDOR), escape={"enabled": False, "period_s": 2.0})
    assert [led.lead(2, 2) for _ in range(20)] == [None] * 20
    assert led.journal == [Stalled("no force")]
    assert (led.path, led.records.stalls) == ([], 1)
    assert not led.behaviour.done
    for _ in range(20):
        led.lead(2, 2)
    assert led.journal == [Stalled("no force")] * 2  # once in a period


def test_without_escape_a_robot_goes_on_when_a_force_draws_it_again() -> None:
    led = Led(drawn(CORRIDOR), escape={"enabled": False})
    assert led.lead(2, 2) is None
    assert led.lead(22, 2) == pytest.approx(0.0)
    assert led.lead(2, 2) is None
    assert led.journal == [Stalled("no force")] * 2


def test_a_robot_whose_box_is_small_lays_a_path_though_a_force_draws_it() -> None:
    led = Led(drawn(CORRIDOR), escape={"period_s": 1.0})
    for tick in range(9):
        assert led.lead(22 + 0.2 * (tick % 2), 2) is not None
    assert led.journal == []
    led.lead(22, 2)
    assert led.journal[0] == Stalled("no way made")
    assert isinstance(led.journal[1], PathLaid)


def test_who_learns_nothing_for_long_lays_a_path_unless_only_the_box_counts() -> None:
    for patience, stalls in ((1.0, 1), (None, 0)):
        led = Led(drawn(CORRIDOR), escape={"period_s": 0.5, "patience_s": patience})
        for tick in range(12):
            led.lead(21 + 3 * (tick % 2), 2, gained=False)
        assert led.named(Stalled) == [Stalled("no way made")] * stalls


def test_frontiers_that_no_way_leads_to_are_given_up_and_all_is_explored() -> None:
    led = Led(drawn(CLOSED))
    assert led.lead(1, 1) is None or not led.journal
    for _ in range(100):
        led.lead(1, 1)
    places = {(event.x_m, event.y_m) for event in led.named(FrontierGivenUp)}
    frontiers = path_of(led.belief.frontier, led.belief)
    assert places == {at(ix, iy) for ix, iy in frontiers}
    assert {event.why for event in led.named(FrontierGivenUp)} == {"no way leads there"}
    assert led.journal[-1] == Explored()
    assert led.behaviour.done
    assert led.lead(1, 1) is None
    assert led.records.given_up == len(frontiers) > 0


def test_who_has_done_goes_on_when_the_map_has_new_frontiers() -> None:
    led = Led(drawn(CLOSED))
    for _ in range(100):
        led.lead(1, 1)
    led.belief.evidence[2, 0] = 0
    renew(led.belief)
    assert not led.behaviour.done
    walls = 0.3 / 0.5**2  # from the left and from below
    assert led.lead(1, 1) == pytest.approx(math.atan2(math.sqrt(2) + walls, walls - math.sqrt(2)))


def test_a_frontier_is_given_up_that_has_been_planned_to_three_times_and_is_still_there() -> None:
    led = Led(drawn(CORRIDOR), escape={"period_s": 0.5})
    for _ in range(400):
        led.lead(2, 2)
    gone = [event for event in led.journal if isinstance(event, PathLaid | FrontierGivenUp)]
    goals = list(dict.fromkeys((event.x_m, event.y_m) for event in gone))
    assert len(goals) == 3
    for goal in goals:
        own = [event for event in gone if (event.x_m, event.y_m) == goal]
        assert [type(event) for event in own] == [PathLaid] * 3 + [FrontierGivenUp]
        assert own[-1].why == "tried too often"
    assert led.journal[-1] == Explored()
