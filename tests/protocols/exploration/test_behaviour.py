"""The paper's behaviour: the sum of its schemas, and the nine steps of its algorithm, on maps drawn by hand."""

import math
from typing import Any

import numpy as np
import pytest

from cosim.geometry.marking import CERTAIN
from cosim.machine import Event
from cosim.units import MS
from protocols.exploration import overlay
from protocols.exploration.behaviour import Behaviour, Stalling
from protocols.exploration.events import Counters, Explored, FrontierGivenUp, PathLaid, PathLeft, Stalled
from protocols.exploration.parameters import Parameters
from protocols.exploration.terrain import Terrain
from protocols.mapping.belief import Belief, Frame
from tests.protocols.exploration.hand_map import ORIGIN_M, at, drawn, observed, path_of, renew

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

    def __init__(self, belief: Belief, radius_m: float = 0.0, **changes: Any) -> None:
        self.belief = belief
        self.counters = Counters()
        self.journal: list[Event] = []
        parameters = Parameters.model_validate(changes)
        self.behaviour = Behaviour(
            parameters, Terrain(belief, parameters.escape), self.counters, self.journal, radius_m, 2.5, 100 * MS
        )

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
    for away_m, heading in ((1.19, 0.0), (1.21, None)):  # 2 times 0.6 m
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
    assert led.counters.stalls == 1


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
    led.behaviour._overlay.note(np.array([30 + 20], np.int32))
    for ix in range(3, 29):
        led.lead(ix, 2)
    assert led.named(PathLeft) == [PathLeft("walked")]


def test_without_escape_a_robot_that_no_force_draws_stalls_once_and_stays() -> None:
    led = Led(drawn(CORRIDOR), escape={"enabled": False, "period_s": 2.0})
    assert [led.lead(2, 2) for _ in range(100)] == [None] * 100
    assert led.journal == [Stalled("no force")]
    assert (led.path, led.counters.stalls) == ([], 1)
    assert not led.behaviour.done


def test_without_escape_a_robot_has_done_when_there_is_no_frontier() -> None:
    led = Led(drawn(CORRIDOR.replace("?", "#")), escape={"enabled": False})
    assert led.lead(2, 2) is None
    assert led.journal == [Stalled("no force"), Explored()]
    assert led.behaviour.done
    late = Led(drawn(CORRIDOR), escape={"enabled": False, "period_s": 2.0})
    late.lead(2, 2)
    late.belief.evidence[:, 29] = 127  # another has seen that there is nothing
    renew(late.belief)
    for _ in range(20):
        late.lead(2, 2)
    assert late.journal == [Stalled("no force"), Explored()]


def test_without_escape_a_box_that_stays_small_is_one_stall() -> None:
    led = Led(drawn(CORRIDOR), escape={"enabled": False, "period_s": 1.0})
    for tick in range(60):
        assert led.lead(22 + 0.2 * (tick % 2), 2) is not None
    assert led.journal == [Stalled("no way made")]


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


def test_frontiers_that_no_way_leads_to_are_given_up_by_groups_and_all_is_explored() -> None:
    led = Led(drawn(CLOSED))
    for _ in range(100):
        led.lead(1, 1)
    assert path_of(led.belief.frontier, led.belief) == [(6, 1), (6, 2)]
    assert led.named(FrontierGivenUp) == [FrontierGivenUp(*at(6, 1.5), "no way leads there", 2)]
    assert led.journal[-1] == Explored()
    assert led.behaviour.done
    assert led.lead(1, 1) is None
    assert led.counters.given_up == 2


def test_frontiers_that_are_apart_are_given_up_apart() -> None:
    led = Led(drawn("####### #..#..? #..#..# #..#..? #######"))
    for _ in range(100):
        led.lead(1, 1)
    given_up = led.named(FrontierGivenUp)
    assert {(event.x_m, event.y_m) for event in given_up} == {at(6, 1), at(6, 3)}
    assert [event.cells for event in given_up] == [1, 1]


def test_who_has_done_goes_on_when_the_map_has_new_frontiers() -> None:
    led = Led(drawn(CLOSED), schemas={"obstacle_gain": 0.0})
    for _ in range(100):
        led.lead(1, 1)
    assert led.behaviour.done
    led.belief.evidence[2, 0] = 0
    renew(led.belief)
    assert not led.behaviour.done
    assert led.lead(1, 2) == pytest.approx(math.pi)
    assert not led.behaviour.done


def test_frontiers_that_were_given_up_are_tried_when_others_have_found_a_way() -> None:
    led = Led(drawn(CLOSED), escape={"period_s": 1.0, "clearance_m": 0.5})
    for _ in range(100):
        led.lead(1, 1)
    assert led.behaviour.done
    led.belief.evidence[2, 3] = -1
    renew(led.belief)
    for _ in range(12):
        led.lead(1, 1)
    assert not led.behaviour.done
    assert isinstance(led.journal[-1], PathLaid)
    assert led.counters.given_up == 2


def test_who_has_done_stays_so_when_the_map_changes_and_no_way_leads_anywhere_and_names_nothing_twice() -> None:
    led = Led(drawn(CLOSED), escape={"period_s": 1.0})
    for _ in range(100):
        led.lead(1, 1)
    before = len(led.named(FrontierGivenUp))
    led.belief.evidence[0, 0] = -1
    renew(led.belief)
    led.belief.frontier[0, 0] = 0
    for _ in range(40):
        assert led.lead(1, 1) is None
    assert led.behaviour.done
    assert len(led.named(FrontierGivenUp)) == before
    assert led.counters.given_up == 2


def test_a_frontier_in_sight_where_paths_have_ended_is_given_up_by_all_who_share_the_map(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(overlay, "LOOKS", 1)
    belief = drawn(CORRIDOR)
    led, other = Led(belief), Led(belief)
    led.lead(2, 2)
    led.behaviour._overlay.note(np.array([30 * iy + 29 for iy in (1, 2, 3)], np.int32))
    for ix in range(3, 29):
        led.lead(ix, 2)
    assert led.named(PathLeft) == [PathLeft("walked")]
    assert led.named(FrontierGivenUp) == [FrontierGivenUp(*at(29, 2), "nothing new is seen there", 3)]
    assert path_of(belief.vain, belief) == [(29, 1), (29, 2), (29, 3)]
    led.lead(28, 2)
    assert led.behaviour.done
    other.lead(2, 2)
    assert other.named(PathLaid) == []
    assert other.behaviour.done
    assert (led.counters.given_up, other.counters.given_up) == (3, 0)


def test_a_frontier_that_was_looked_at_once_only_is_not_given_up() -> None:
    led = Led(drawn(CORRIDOR))
    led.lead(2, 2)
    led.behaviour._overlay.note(np.array([30 * iy + 29 for iy in (1, 2, 3)], np.int32))
    for ix in range(3, 29):
        led.lead(ix, 2)
    assert led.named(PathLeft) == [PathLeft("walked")]
    assert led.named(FrontierGivenUp) == []


def test_a_frontier_that_another_robot_may_hide_is_not_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(overlay, "LOOKS", 1)
    led = Led(drawn(CORRIDOR))
    led.lead(2, 2)
    led.behaviour._overlay.note(np.array([30 * iy + 29 for iy in (1, 2, 3)], np.int32))
    for ix in range(3, 29):
        led.lead(ix, 2, at(ix - 8, 2))
    assert led.named(PathLeft) == [PathLeft("walked")]
    assert led.named(FrontierGivenUp) == []


def test_a_path_that_is_laid_with_a_frontier_in_sight_is_walked_to_its_end() -> None:
    led = Led(drawn(CORRIDOR), escape={"period_s": 0.5})
    for tick in range(5):
        led.lead(25 + 0.1 * (tick % 2), 2)
    assert led.named(Stalled) == [Stalled("no way made")]
    assert led.behaviour.underway
    for _ in range(20):
        led.lead(25, 2)
    assert PathLeft("frontier in sight") not in led.journal
    for ix in (26, 27, 28):
        led.lead(ix, 2)
    assert led.named(PathLeft)[-1] == PathLeft("walked")


def test_a_frontier_ends_one_path_only() -> None:
    led = Led(drawn(CORRIDOR))
    led.lead(2, 2)
    for _ in range(5):
        led.lead(25, 2)
    assert led.named(PathLeft) == [PathLeft("frontier in sight")]
    led.lead(2, 2)
    assert led.behaviour.underway
    for _ in range(20):
        led.lead(25, 2)
    assert len(led.named(PathLeft)) == 1


def test_who_stalls_on_a_path_follows_the_next_alone() -> None:
    led = Led(drawn(CORRIDOR), escape={"period_s": 0.5})
    place, headings = at(25, 1.1), []
    for _ in range(12):
        headings.append(led.lead(25, 1.1))
    assert led.named(PathLeft) == [PathLeft("stalled")]
    cells = np.array(led.path)
    cells = cells[(cells != (25, 1)).any(axis=1)]
    away = np.stack(at(cells[:, 0], cells[:, 1]), axis=1) - place
    x, y = (away / np.hypot(*away.T)[:, None] ** 3).sum(axis=0)
    assert headings[-1] == pytest.approx(math.atan2(y, x))
    assert headings[0] is not None
    assert headings[0] > 0.3  # off the wall


def test_frontiers_that_three_paths_have_not_led_to_are_tried_once_more_at_the_end_and_then_given_up() -> None:
    led = Led(drawn(CORRIDOR), escape={"period_s": 0.5})
    for _ in range(800):
        led.lead(2, 2)
    assert led.behaviour.done
    assert len(led.named(PathLaid)) == 12  # at first, and in three rounds
    assert [event.cells for event in led.named(FrontierGivenUp)] == [3]
    assert led.named(FrontierGivenUp)[0].why == "not reached"
    assert led.counters.given_up == 3
    assert led.journal[-1] == Explored()


def test_nothing_is_given_up_because_the_body_does_not_fit_where_it_stands() -> None:
    """Beside a wall that has been seen from both sides, and with nothing known but a strip."""
    tight = drawn("############# #...........? ############# #############")
    led = Led(tight, radius_m=0.3)
    for _ in range(300):
        led.lead(1, 1)
    assert led.named(FrontierGivenUp) == []
    assert not led.behaviour.done
    wide = drawn("############# #...........? #...........? #...........? #...........? #############")
    led = Led(wide, radius_m=0.3, escape={"period_s": 0.5})
    for _ in range(5):
        led.lead(1, 1)
    assert [type(event) for event in led.journal] == [Stalled, PathLaid]


def test_steps_are_counted_by_the_strongest_schema() -> None:
    led = Led(drawn(CORRIDOR))
    led.lead(22, 2)
    assert (led.counters.by_frontiers, led.counters.by_obstacles, led.counters.by_robots) == (1, 0, 0)
    led.lead(22, 1)
    assert (led.counters.by_frontiers, led.counters.by_obstacles, led.counters.by_robots) == (1, 1, 0)
    led.lead(22, 2, at(21.8, 2))
    assert (led.counters.by_frontiers, led.counters.by_obstacles, led.counters.by_robots) == (1, 1, 1)


def test_what_else_attracts_is_added() -> None:
    led = Led(drawn(CORRIDOR), escape={"enabled": False})
    led.behaviour.pull = 0.0, -2.0
    assert led.lead(2, 2) == pytest.approx(-math.pi / 2)


# ---------------------------------------------------------------- whether a robot takes itself to be caught


def noted(stalling: Stalling, places: list[tuple[float, float]], gain: bool = True) -> list[bool]:
    result = []
    for place in places:
        stalling.note(place, gain)
        result.append(stalling.stalled)
    return result


def test_a_robot_that_stands_has_stalled_when_the_whole_period_is_over() -> None:
    assert noted(Stalling(4, 0.6, math.inf), [(1.0, 2.0)] * 5) == [False, False, False, True, True]


def test_the_longer_side_of_the_box_counts() -> None:
    for turned in (False, True):
        for length, stalled in ((0.59, True), (0.61, False)):
            ends = [(0.0, 0.0), (0.1, length), (0.0, 0.3)]
            places = [(y, x) for x, y in ends] if turned else ends
            assert noted(Stalling(3, 0.6, math.inf), places)[-1] == stalled


def test_a_circle_counts_as_its_box_not_as_its_way() -> None:
    circle = [(0.2 * math.cos(k), 0.2 * math.sin(k)) for k in range(40)]
    assert noted(Stalling(40, 0.6, math.inf), circle)[-1]
    assert not noted(Stalling(40, 0.3, math.inf), circle)[-1]


def test_only_the_last_period_counts() -> None:
    went = [(float(k), 0.0) for k in range(5)]
    assert noted(Stalling(3, 0.6, math.inf), [*went, went[-1], went[-1]]) == [False] * 6 + [True]


def test_all_is_forgotten_at_a_new_beginning() -> None:
    stalling = Stalling(3, 0.6, 4)
    noted(stalling, [(0.0, 0.0)] * 3, gain=False)
    assert stalling.stalled
    stalling.begin()
    assert noted(stalling, [(0.0, 0.0)] * 3, gain=False) == [False, False, True]
    far = Stalling(99, 0.6, 4)
    noted(far, [(0.0, 0.0)] * 4, gain=False)
    far.begin()
    assert noted(far, [(0.0, 0.0)] * 5, gain=False) == [False] * 4 + [True]


def test_who_gains_nothing_for_long_has_stalled_however_far_it_goes() -> None:
    went = [(float(k), 0.0) for k in range(9)]
    stalling = Stalling(3, 0.6, 4)
    assert noted(stalling, went[:4], gain=False) == [False] * 4
    assert noted(stalling, went[4:5], gain=True) == [False]
    assert noted(stalling, went[5:], gain=False) == [False] * 4
    assert noted(stalling, [(9.0, 0.0)], gain=False) == [True]
