"""OSCARD by the rules of Fig. 10 and the triggers of section III.A, and the random walk."""

from collections.abc import Mapping

import numpy as np
import pytest

from protocols.pseudonet.algorithms.base import Evaluation, judge
from protocols.pseudonet.algorithms.oscard import Oscard
from protocols.pseudonet.algorithms.random_walk import RandomWalk
from protocols.pseudonet.messages import TRAIL_LIMIT, Action, Kind, Verdict
from protocols.pseudonet.setup import View
from tests.protocols.pseudonet.floors import floor, view_of

N, E, S, W, STAY = Action.NORTH, Action.EAST, Action.SOUTH, Action.WEST, Action.STAY
OPEN, WALL, COVERED, ROBOT, NEARER, LOST = Verdict


def oscard(patience: int = 2, history: int = 12, revisits: int = 3, k_forced: int = 4, seed: int = 1) -> Oscard:
    return Oscard(np.random.default_rng(seed), patience, history, revisits, k_forced)


def drawn(view: View, times: int = 40) -> set[Action]:
    """Return which actions a fresh robot chooses, over many streams."""
    return {oscard(seed=seed).evaluate(view).action for seed in range(times)}


def view(picture: str, covered: str = "") -> View:
    """Return the view of robot 0 at 'a'; robots 1 to 3 stand at 'b' to 'd'."""
    setup, cells = floor(picture)
    places: Mapping[int, int] = {number: cells[mark] for number, mark in enumerate("abcd") if mark in cells}
    return view_of(setup, 0, places, [cells[mark] for mark in covered])


def walk(robot: Oscard, view: View, evaluation: Evaluation) -> None:
    """Carry *evaluation* out."""
    cell = view.target(0, evaluation.action)
    view.cells[0] = cell
    view.covered.add(cell)
    robot.committed(evaluation.action, cell)


SQUARE = """
    nne
    wae
    wss
"""


def test_covered_cells_are_avoided() -> None:
    seen = view(
        """
        .n.
        wae
        .s.
        """,
        covered="nw",
    )
    assert judge(seen, avoid_covered=True, keep_distance=True) == (COVERED, OPEN, OPEN, COVERED)
    assert drawn(seen) == {E, S}


def test_walls_and_robots_are_told_apart() -> None:
    seen = view(
        """
        ...
        #ab
        .#.
        """
    )
    assert judge(seen, avoid_covered=True, keep_distance=True) == (OPEN, ROBOT, WALL, WALL)


def test_an_action_that_was_given_up_is_not_chosen_again() -> None:
    seen = view(SQUARE)
    seen.omitted = {N, E, S}
    assert judge(seen, avoid_covered=True, keep_distance=True) == (LOST, LOST, LOST, OPEN)
    assert drawn(seen) == {W}


def test_steps_that_bring_a_robot_nearer_to_another_are_avoided() -> None:
    seen = view(
        """
        .....
        .a..b
        .....
        """
    )
    assert judge(seen, avoid_covered=True, keep_distance=True) == (OPEN, NEARER, OPEN, OPEN)
    assert drawn(seen) == {N, S, W}


def test_a_step_that_leaves_the_nearest_robot_as_far_away_is_possible() -> None:
    verdicts = judge(view("b.a..c"), avoid_covered=True, keep_distance=True)
    assert verdicts == (WALL, OPEN, WALL, NEARER)  # eastward, the other one becomes the nearest


def test_a_step_that_keeps_two_cells_apart_is_taken_where_all_lead_nearer() -> None:
    assert drawn(view("a...b")) == {E}
    assert drawn(view("a..b")) == {E}  # two cells are left between their centres
    assert drawn(view("wa.b", covered="w")) == {W}  # the uncovered cell is too near, so the robot is trapped
    assert drawn(view("a.b")) == {E}  # and breaks the loop by the only step that there is


def test_a_trapped_robot_at_a_boundary_turns_to_the_longer_side() -> None:
    south_wall = view(
        """
        .....
        .....
        .....
        .a...
        """
    )
    south_wall.covered |= set(south_wall.setup.cells)
    assert drawn(south_wall) == {N}  # a boundary along the X axis: YMax - y is greater
    north_wall = view(
        """
        .a...
        .....
        .....
        .....
        """
    )
    north_wall.covered |= set(north_wall.setup.cells)
    assert drawn(north_wall) == {S}
    west_wall = view(
        """
        ....
        a...
        ....
        """
    )
    west_wall.covered |= set(west_wall.setup.cells)
    assert drawn(west_wall) == {E}  # a boundary along the Y axis: XMax - x is greater


def test_a_trapped_robot_away_from_boundaries_keeps_two_cells_apart() -> None:
    seen = view(
        """
        .....
        .a.b.
        .....
        """
    )
    seen.covered |= set(seen.setup.cells)
    assert drawn(seen) == {N, S, W}


def test_a_robot_that_stays_trapped_asks_for_help() -> None:
    seen = view(
        """
        ....
        .a..
        ....
        """
    )
    seen.covered |= set(seen.setup.cells)
    robot = oscard(patience=2, revisits=99)
    asked = []
    for _ in range(3):
        evaluation = robot.evaluate(seen)
        asked.append((evaluation.kind, evaluation.action == STAY))
        walk(robot, seen, evaluation)
    assert asked == [(Kind.STATE, False), (Kind.STATE, False), (Kind.HELP, True)]


def test_a_surrounded_robot_asks_for_help_at_once() -> None:
    seen = view(
        """
        #b#
        #a#
        """
    )
    evaluation = oscard().evaluate(seen)
    assert (evaluation.kind, evaluation.action) == (Kind.HELP, STAY)
    assert evaluation.verdicts == (ROBOT, WALL, WALL, WALL)


def test_a_robot_that_finds_an_uncovered_cell_is_trapped_no_more() -> None:
    seen = view("a........")
    seen.covered |= set(seen.setup.cells) - {5}
    robot = oscard(patience=2, revisits=99)
    for _ in range(2):
        walk(robot, seen, robot.evaluate(seen))
    seen.covered.discard(seen.cells[0] + 1)
    assert robot.evaluate(seen).action == E
    seen.covered.add(seen.cells[0] + 1)
    assert robot.evaluate(seen).kind == Kind.STATE  # the count has begun anew


def test_an_answer_leads_along_the_shortest_way() -> None:
    setup, cells = floor(
        """
        .....
        .##.#
        a...t
        """
    )
    seen = view_of(setup, 0, {0: cells["a"]}, list(setup.cells - {cells["t"]}))
    robot = oscard()
    robot.directed(cells["t"])
    actions = []
    while seen.cells[0] != cells["t"]:
        evaluation = robot.evaluate(seen)
        actions.append(evaluation.action)
        walk(robot, seen, evaluation)
    assert actions == [E, E, E, E]


def test_an_answer_is_forgotten_when_somebody_else_has_covered_its_cell() -> None:
    seen = view("a..t", covered="t")
    seen.covered |= set(seen.setup.cells)
    robot = oscard(patience=0)
    robot.directed(3)
    assert robot.evaluate(seen).kind == Kind.HELP


def revisiting(k_forced: int = 3) -> tuple[Oscard, View]:
    """Return a robot in the middle of covered cells that has come back to its cell for the second time."""
    seen = view(
        """
        ...........
        ...........
        .....a.....
        ...........
        ...........
        """
    )
    seen.covered |= set(seen.setup.cells)
    robot = oscard(patience=99, revisits=2, k_forced=k_forced)
    for action in (E, W, N, S):
        walk(robot, seen, Evaluation(action, judge(seen, avoid_covered=True, keep_distance=True)))
    return robot, seen


def test_a_robot_that_revisits_a_cell_sends_trap_with_its_trail() -> None:
    robot, seen = revisiting()
    evaluation = robot.evaluate(seen)
    assert (evaluation.kind, evaluation.action) == (Kind.TRAP, STAY)
    assert evaluation.trail == (E, W, N, S)


def test_a_trail_is_no_longer_than_a_message_carries() -> None:
    robot, seen = revisiting()
    for _ in range(5):
        for action in (E, W, N, S):
            walk(robot, seen, Evaluation(action, judge(seen, avoid_covered=True, keep_distance=True)))
    assert len(robot.evaluate(seen).trail) == TRAIL_LIMIT


@pytest.mark.parametrize("k_forced", [2, 3])
def test_without_an_answer_a_robot_makes_k_steps_in_one_direction(k_forced: int) -> None:
    robot, seen = revisiting(k_forced)
    walk(robot, seen, robot.evaluate(seen))
    forced = []
    for _ in range(k_forced):
        evaluation = robot.evaluate(seen)
        forced.append(evaluation.action)
        walk(robot, seen, evaluation)
    assert len(set(forced)) == 1
    assert forced[0] != STAY
    robot.directed(seen.cells[0])  # covered: says nothing
    assert robot._forced is None


def test_an_answer_spares_the_forced_steps() -> None:
    robot, seen = revisiting()
    walk(robot, seen, robot.evaluate(seen))
    far = seen.setup.grid.nx - 1
    seen.covered.discard(far)
    robot.directed(far)
    actions = [robot.evaluate(seen).action]
    assert actions[0] in (E, S)
    seen.covered.add(far)  # somebody else was faster
    robot.evaluate(seen)
    assert robot._forced is None


def test_forced_steps_end_at_a_wall() -> None:
    robot, seen = revisiting(k_forced=50)
    walk(robot, seen, robot.evaluate(seen))
    for _ in range(12):
        evaluation = robot.evaluate(seen)
        assert seen.target(0, evaluation.action) >= 0
        walk(robot, seen, evaluation)


def test_forced_steps_end_at_an_uncovered_cell() -> None:
    robot, seen = revisiting(k_forced=50)
    walk(robot, seen, robot.evaluate(seen))
    walk(robot, seen, robot.evaluate(seen))
    uncovered = seen.target(0, E)
    seen.covered.discard(uncovered)
    assert robot.evaluate(seen).action == E
    assert robot._forced is None


def test_a_random_walk_takes_every_possible_step_whether_covered_or_not() -> None:
    seen = view(
        """
        .n.
        wab
        .#.
        """,
        covered="n",
    )
    assert {RandomWalk(np.random.default_rng(seed)).evaluate(seen).action for seed in range(40)} == {N, W}


def test_a_random_walk_draws_fairly() -> None:
    seen = view(SQUARE)
    robot = RandomWalk(np.random.default_rng(3))
    counts = np.bincount([robot.evaluate(seen).action for _ in range(4_000)], minlength=5)
    assert counts[STAY] == 0
    assert (abs(counts[:4] - 1_000) < 5 * np.sqrt(750)).all()  # five standard deviations of a binomial


def test_a_random_walk_stays_where_no_step_is_possible() -> None:
    assert RandomWalk(np.random.default_rng(1)).evaluate(view("ab")).action == STAY
