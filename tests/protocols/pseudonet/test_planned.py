"""The complete algorithms without radio or bodies: everything is covered, nobody enters a cell that is taken."""

import numpy as np
import pytest

from protocols.pseudonet.algorithms import planned
from protocols.pseudonet.algorithms.planned import Planned, Task, joint_step
from protocols.pseudonet.messages import Action, Kind
from protocols.pseudonet.plans.boustrophedon import boustrophedon
from protocols.pseudonet.plans.spanning_tree import spanning_tree
from protocols.pseudonet.setup import Setup
from tests.protocols.pseudonet.floors import TIMES, PaperTeam, flood, floor, grid_of, maze, view_of
from tests.tiers import soak_count

PLANNERS = (boustrophedon, spanning_tree)
SLOW_CASES = 300
SOAK_CASES = 5_000


def random_team(seed: int) -> tuple[PaperTeam, set[int]]:
    """Return one to eight robots on a random maze, of narrow corridors, with loops, with rooms; and its cells."""
    rng = np.random.default_rng(seed)
    width, height = (int(side) for side in rng.integers(1, 8, 2))
    free = maze(rng, width, height, float(rng.choice([0.0, 0.1, 0.5])), int(rng.integers(0, 4)))
    grid = grid_of(free)
    cells = np.flatnonzero(grid.free)
    size = int(rng.integers(1, min(8, len(cells)) + 1))
    starts = rng.choice(cells, size, replace=False).tolist()
    setup = Setup(grid, size, TIMES)
    planner = PLANNERS[seed % 2]
    return PaperTeam(setup, starts, [Planned(planner) for _ in starts]), flood(grid, starts[0])


def cover(team: PaperTeam, cells: set[int], most: int) -> int:
    """Step until *cells* are covered; return after how many steps, or fail after *most*."""
    for steps in range(most + 1):
        if team.covered >= cells:
            return steps
        team.step()
    raise AssertionError(f"{len(cells - team.covered)} of {len(cells)} cells are left after {most} steps")


def campaign(seeds: range) -> int:
    """Run the cases of *seeds*; return in how many of them a robot had to make room.

    Each cell costs at most the way to it, and for each of its steps the time that a chain of all robots needs.
    """
    for seed in seeds:
        team, cells = random_team(seed)
        bound = len(cells) * 4 + len(team.cells) * 40
        try:
            cover(team, cells, bound)
        except AssertionError as error:
            raise AssertionError(f"seed {seed}: {error}") from None
        assert team.covered == cells
    return len(seeds)


@pytest.mark.slow
def test_random_teams_cover_random_mazes() -> None:
    assert campaign(range(SLOW_CASES)) == SLOW_CASES


@pytest.mark.soak
def test_many_random_teams_cover_random_mazes() -> None:
    count = soak_count(SOAK_CASES)
    print(f"{campaign(range(SLOW_CASES, SLOW_CASES + count))} teams on random mazes covered them")


@pytest.mark.parametrize("planner", PLANNERS)
def test_a_robot_alone_covers_a_corridor_from_its_middle(planner: object) -> None:
    setup, cells = floor("...a....")
    team = PaperTeam(setup, [cells["a"]], [Planned(planner)])  # type: ignore[arg-type]
    # to the near end and back is 3 + 7 steps, to the far end first 4 + 7
    assert cover(team, set(setup.cells), 11) in (10, 11)


def test_a_dormant_robot_clears_the_corridor_that_it_stands_in() -> None:
    setup, cells = floor("x.ab...")
    view = view_of(setup, 0, {0: cells["a"], 1: cells["b"]}, covered=[cells["x"] + 1])
    task = Task(1, cells["x"], 3)  # robot 1 wants to go west, robot 0 has nothing to do
    assert joint_step(view, [task]) == {0: Action.WEST}


def test_a_chain_of_dormant_robots_gives_way_from_its_far_end() -> None:
    setup, cells = floor("x.abcd")
    view = view_of(setup, 0, {0: cells["a"], 1: cells["b"], 2: cells["c"], 3: cells["d"]})
    assert joint_step(view, [Task(3, cells["x"], 5)]) == {0: Action.WEST}


def test_robots_that_know_the_same_get_their_parts_of_one_step_and_others_their_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    setup, cells = floor("..ab..")
    places = {0: cells["a"], 1: cells["b"]}
    views = [view_of(setup, me, places) for me in places]
    algorithms = [Planned(boustrophedon) for _ in views]
    for algorithm, view in zip(algorithms, views, strict=True):
        algorithm.enlist(view)
    steps: list[int] = []
    monkeypatch.setattr(planned, "joint_step", lambda view, tasks: steps.append(view.me) or joint_step(view, tasks))
    actions = [algorithm.evaluate(view).action for algorithm, view in zip(algorithms, views, strict=True)]
    assert actions == [Action.WEST, Action.EAST]
    assert steps == [0]
    views[0].covered |= {cells["a"] - 1, cells["a"] - 2}  # in the same set: what was known then is a copy
    assert algorithms[0].evaluate(views[0]).action == Action.STAY
    assert algorithms[1].evaluate(views[1]).action == Action.EAST
    assert steps == [0, 0, 1]


def test_who_has_a_task_nearer_to_its_goal_decides_first() -> None:
    setup, cells = floor("aXbY..")
    view = view_of(setup, 0, {0: cells["a"], 1: cells["b"]})
    # both want X; robot 1 has decided before it is asked to make room
    step = joint_step(view, [Task(1, cells["X"], 1), Task(0, cells["Y"], 3)])
    assert step == {1: Action.WEST}


def test_a_robot_steps_aside_into_a_niche() -> None:
    setup, cells = floor(
        """
        ##n##
        xab..
        """
    )
    view = view_of(setup, 0, {0: cells["a"], 1: cells["b"]})
    step = joint_step(view, [Task(0, cells["b"] + 2, 3)])
    assert step == {1: Action.NORTH}  # the first direction that is free; next time the way is
    assert cells["n"] == setup.steps[cells["b"]][Action.NORTH]


def test_a_robot_leads_nobody_into_a_cell_that_another_has_taken_in_the_same_step() -> None:
    setup, cells = floor(
        """
        #b#
        aXc
        """
    )
    view = view_of(setup, 0, {0: cells["a"], 1: cells["b"], 2: cells["c"]})
    tasks = [Task(robot, cells["X"], 1) for robot in range(3)]
    assert joint_step(view, tasks) == {0: Action.EAST}


def test_a_robot_stays_where_it_is_once_it_has_lost_its_claim() -> None:
    setup, cells = floor("a...")
    robot = Planned(boustrophedon)
    view = view_of(setup, 0, {0: cells["a"]})
    robot.enlist(view)
    assert robot.evaluate(view).action == Action.EAST
    view.omitted.add(Action.EAST)
    assert robot.evaluate(view).action == Action.STAY


def test_a_robot_says_stop_once_when_its_part_is_done() -> None:
    setup, cells = floor("a..b")
    team = PaperTeam(setup, [cells["a"], cells["b"]], [Planned(boustrophedon) for _ in "ab"])
    kinds = []
    for _ in range(5):
        team.step()
        kinds.append([evaluation.kind for evaluation in team.evaluations])
    for robot in range(2):
        assert [kind for kind in (row[robot] for row in kinds) if kind == Kind.STOP] == [Kind.STOP]


def test_parts_of_the_floor_that_do_not_hang_together_are_covered_by_those_who_are_there() -> None:
    setup, cells = floor("a...#b..c")
    starts = [cells["a"], cells["b"], cells["c"]]
    team = PaperTeam(setup, starts, [Planned(boustrophedon) for _ in starts])
    assert cover(team, set(setup.cells), 4) == 3
    assert team.cells[0] < cells["b"]


def test_what_lies_behind_a_dropped_robot_is_left() -> None:
    setup, cells = floor("..a.b..")
    view = view_of(setup, 0, {0: cells["a"]})
    view.obstacles = frozenset({cells["b"]})
    assert view.remaining() == {0, 1, 3}
    view.covered |= {0, 1, 3}
    assert view.complete()


def test_who_makes_room_for_somebody_does_not_decide_again() -> None:
    setup, cells = floor(
        """
        xYab
        ##n#
        """
    )
    view = view_of(setup, 0, {0: cells["a"], 1: cells["b"]})
    step = joint_step(view, [Task(1, cells["x"], 3), Task(0, cells["Y"], 1)])
    assert step == {0: Action.SOUTH}
