"""The rules of section VI: who may enter a cell that two want, who answers whom, and when a step is agreed on."""

from dataclasses import replace
from itertools import product

import pytest

from protocols.pseudonet.algorithms.base import UNJUDGED, Evaluation
from protocols.pseudonet.coordination import Contest, Coordination, accepted, contest, helper, in_trouble
from protocols.pseudonet.messages import Action, Kind, Message, Reply, Verdict
from protocols.pseudonet.messaging import Stance
from protocols.pseudonet.setup import View
from tests.protocols.pseudonet.floors import floor

NARROW = (Verdict.POSSIBLE, Verdict.WALL, Verdict.WALL, Verdict.WALL)
CELLS = {0: 10, 1: 12, 2: 21}
"""Robots on both sides of, and above, the cell 11."""


def says(source: int, kind: Kind = Kind.STATE, action: Action = Action.STAY, **more: object) -> Message:
    return replace(Message(source, kind, 0, source, 0, action, UNJUDGED), **more)  # type: ignore[arg-type]


def test_robots_that_want_different_empty_cells_are_in_nobodys_way() -> None:
    messages = {robot: says(robot) for robot in CELLS}
    assert contest(messages, CELLS, {0: 9, 1: 13, 2: 31}) == Contest()
    assert contest(messages, CELLS, CELLS).settled()


def test_robots_that_want_one_cell_claim_it_first() -> None:
    messages = {robot: says(robot) for robot in CELLS}
    assert contest(messages, CELLS, {0: 11, 1: 11, 2: 31}) == Contest(claimants=frozenset({0, 1}))


def test_nobody_loses_before_all_rivals_have_claimed() -> None:
    messages = {0: says(0, Kind.HELP), 1: says(1), 2: says(2)}
    assert contest(messages, CELLS, {0: 11, 1: 11, 2: 31}) == Contest(claimants=frozenset({0, 1}))


def test_the_lower_number_keeps_the_cell_among_equals() -> None:
    messages = {robot: says(robot, Kind.HELP) for robot in CELLS}
    assert contest(messages, CELLS, {0: 11, 1: 11, 2: 11}) == Contest(losers=frozenset({1, 2}))


def test_the_constricted_robot_comes_before_the_lower_number() -> None:
    messages = {robot: says(robot, Kind.HELP) for robot in CELLS} | {2: says(2, Kind.HELP, verdicts=NARROW)}
    assert contest(messages, CELLS, {0: 11, 1: 11, 2: 11}) == Contest(losers=frozenset({0, 1}))


@pytest.mark.parametrize("leaving", [True, False])
def test_a_cell_in_which_somebody_stands_is_never_entered(leaving: bool) -> None:
    messages = {robot: says(robot) for robot in CELLS}
    targets = {0: 9 if leaving else 10, 1: 10, 2: 21}
    assert contest(messages, CELLS, targets) == Contest(losers=frozenset({1}))


def test_robots_do_not_change_places() -> None:
    messages = {0: says(0, Kind.HELP), 1: says(1, Kind.HELP)}
    assert contest(messages, {0: 10, 1: 11}, {0: 11, 1: 10}) == Contest(losers=frozenset({0, 1}))


def test_a_step_into_a_wall_loses() -> None:
    assert contest({0: says(0)}, {0: 10}, {0: -1}) == Contest(losers=frozenset({0}))


def test_a_step_is_agreed_on_when_everybody_accepts() -> None:
    accept = says(0, Kind.ANSWER, reply=Reply.ACCEPT)
    assert accepted([accept, replace(accept, source=1)])
    assert not accepted([accept, replace(accept, source=1, reply=Reply.YIELD)])
    assert not accepted([accept, says(1)])


def test_those_ask_for_directions_who_are_caught_or_have_nowhere_to_go() -> None:
    assert in_trouble(says(0, Kind.TRAP))
    assert in_trouble(says(0, Kind.HELP, Action.STAY))
    assert not in_trouble(says(0, Kind.HELP, Action.EAST))  # a claim
    assert not in_trouble(says(0, Kind.STOP))


def test_the_nearest_robot_answers_then_the_lower_number() -> None:
    here = says(3, Kind.TRAP, x=5, y=5)
    near, far = says(1, x=5, y=7), says(0, x=5, y=8)
    assert helper(3, {0: far, 1: near, 3: here}) == 1
    assert helper(3, {0: far, 2: says(2, x=4, y=6), 1: near, 3: here}) == 1
    assert helper(3, {0: far, 1: replace(near, kind=Kind.TRAP), 3: here}) == 0
    assert helper(3, {3: here}) is None


class Scripted:
    """An algorithm that takes the first action of a list that was not given up."""

    def __init__(self, *actions: Action) -> None:
        self.actions = actions
        self.enlisted = 0
        self.targets: list[int] = []
        self.commits: list[tuple[Action, int]] = []

    def enlist(self, view: View) -> None:
        self.enlisted += 1

    def evaluate(self, view: View) -> Evaluation:
        action = next((action for action in self.actions if action not in view.omitted), Action.STAY)
        return Evaluation(action, UNJUDGED)

    def directed(self, target: int) -> None:
        self.targets.append(target)

    def committed(self, action: Action, cell: int) -> None:
        self.commits.append((action, cell))


def team(
    me: int = 0, stop_at: int | None = None, *actions: Action, rounds: int = 0
) -> tuple[Coordination, Scripted, dict[str, int]]:
    """Return robot *me* of three, 0 at a, 1 at c, 2 at h."""
    setup, cells = floor(
        """
        g h i
        d e f
        a b c
        """.replace(" ", "")
    )
    algorithm = Scripted(*actions)
    coordination = Coordination(setup, me, algorithm, stop_at, rounds)
    coordination.team_changed((0, 1, 2))
    coordination.view.cells |= {0: cells["a"], 1: cells["c"], 2: cells["h"]}
    return coordination, algorithm, cells


def at(source: int, column: int, row: int, action: Action = Action.STAY, kind: Kind = Kind.STATE) -> Message:
    return Message(source, kind, 0, column, row, action, UNJUDGED)


def test_the_loser_evaluates_again_without_its_action_and_yields() -> None:
    coordination, _, _ = team(1, None, Action.WEST, Action.NORTH)
    coordination.evaluate_actions()
    messages = {
        0: at(0, 0, 0, Action.EAST, Kind.HELP),
        1: at(1, 2, 0, Action.WEST, Kind.HELP),
        2: at(2, 1, 2),
    }
    assert coordination.negotiate(messages) is Stance.YIELD
    assert coordination.evaluation.action == Action.NORTH
    assert coordination.view.omitted == {Action.WEST}


def test_the_winner_accepts_once_the_loser_has_yielded() -> None:
    coordination, _, _ = team(0, None, Action.EAST)
    coordination.evaluate_actions()
    rivals = {0: at(0, 0, 0, Action.EAST), 1: at(1, 2, 0, Action.WEST), 2: at(2, 1, 2)}
    assert coordination.negotiate(rivals) is Stance.CLAIM
    claims = {robot: replace(m, kind=Kind.HELP) for robot, m in rivals.items()}
    assert coordination.negotiate(claims) is Stance.REPEAT
    assert coordination.negotiate({**claims, 1: at(1, 2, 0, Action.NORTH)}) is Stance.ACCEPT


def test_what_was_agreed_on_is_where_everybody_is_next() -> None:
    coordination, algorithm, cells = team(1, None, Action.NORTH)
    coordination.evaluate_actions()
    coordination.view.omitted.add(Action.WEST)
    mine = coordination.commit({0: at(0, 0, 0, Action.EAST), 1: at(1, 2, 0, Action.NORTH), 2: at(2, 1, 2)})
    assert mine == cells["f"]
    assert coordination.view.cells == {0: cells["b"], 1: cells["f"], 2: cells["h"]}
    assert algorithm.commits == [(Action.NORTH, cells["f"])]
    assert coordination.view.omitted == set()


def test_a_cell_is_covered_when_its_robot_reports_from_it_at_rest() -> None:
    coordination, _, cells = team()
    coordination.take_positions({0: at(0, 0, 0), 1: replace(at(1, 2, 0), busy=True), 2: at(2, 1, 2)})
    assert coordination.view.covered == {cells["a"], cells["h"]}
    assert coordination.own_cells == 1


def test_a_place_that_is_none_is_not_believed() -> None:
    coordination, _, cells = team()
    coordination.take_positions({1: at(1, 77, 0)})
    assert coordination.view.cells[1] == cells["c"]
    assert coordination.view.covered == set()


def test_a_robot_stops_when_it_has_covered_its_programmed_share() -> None:
    coordination, _, _ = team(0, 2, Action.EAST)
    coordination.take_positions({0: at(0, 0, 0)})
    assert coordination.evaluate_actions().kind == Kind.STATE
    coordination.take_positions({0: at(0, 1, 0)})
    evaluation = coordination.evaluate_actions()
    assert (evaluation.kind, evaluation.action) == (Kind.STOP, Action.STAY)
    evaluation = coordination.evaluate_actions()
    assert (evaluation.kind, evaluation.action) == (Kind.STATE, Action.STAY)  # dormant, and said so already


def test_a_team_that_has_stopped_is_complete() -> None:
    coordination, _, _ = team(0, 2)
    stops = {robot: at(robot, x, y, kind=Kind.STOP) for robot, (x, y) in enumerate([(0, 0), (2, 0), (1, 2)])}
    coordination.take_positions({0: stops[0], 1: stops[1], 2: at(2, 1, 2)})
    assert not coordination.complete()
    coordination.take_positions(stops)
    assert coordination.complete()


def test_a_robot_that_is_directed_knows_where_to() -> None:
    coordination, algorithm, cells = team()
    answer = Message(1, Kind.ANSWER, 0, 2, 0, Action.STAY, UNJUDGED, False, 0, Reply.DIRECT, (2, 2))
    coordination.directed(answer)
    coordination.directed(replace(answer, target=(3, 2)))  # no such cell
    coordination.directed(replace(answer, reply=Reply.NONE))
    assert algorithm.targets == [cells["i"]]


def test_the_nearest_robot_names_the_nearest_uncovered_cell() -> None:
    messages = {0: at(0, 0, 0, kind=Kind.TRAP), 1: at(1, 2, 0), 2: at(2, 1, 2)}
    for me, expected in ((1, "e"), (2, None)):
        coordination, _, cells = team(me)
        coordination.view.covered |= {cells[name] for name in "abcd"}
        assert coordination.direction_for(0, messages) == (cells[expected] if expected else None)


QUIET = (at(0, 0, 0), at(0, 0, 0, Action.EAST, Kind.HELP), at(0, 0, 0, kind=Kind.STOP))
ASKING = (at(0, 0, 0, kind=Kind.TRAP), at(0, 0, 0, kind=Kind.HELP))
PLACES = ((0, 0), (2, 0), (1, 2))


@pytest.mark.parametrize("asker", [0, 1, 2])
def test_who_asks_is_answered_by_one_robot_unless_all_ask_at_once(asker: int) -> None:
    others = [robot for robot in range(3) if robot != asker]
    for said in product(QUIET + ASKING, repeat=2):
        spoken = {asker: ASKING[0], **dict(zip(others, said, strict=True))}
        messages = {
            robot: replace(m, source=robot, x=PLACES[robot][0], y=PLACES[robot][1]) for robot, m in spoken.items()
        }
        answers = []
        for me in range(3):
            coordination, _, cells = team(me)
            coordination.view.covered |= set(cells.values()) - {cells["e"]}
            answers.append(coordination.direction_for(asker, messages))
        expected = 0 if set(said) <= set(ASKING) else 1
        assert answers.count(cells["e"]) == expected, messages
        assert answers.count(None) == 3 - expected


def test_who_is_cut_off_from_all_that_is_left_is_not_answered() -> None:
    coordination, _, cells = team(1)
    coordination.view.covered |= set(cells.values()) - {cells["i"]}
    messages = {0: at(0, 0, 0, kind=Kind.TRAP), 1: at(1, 2, 0), 2: at(2, 1, 2)}
    assert coordination.direction_for(0, messages) == cells["i"]
    coordination.view.obstacles = frozenset({cells["b"], cells["d"]})
    assert coordination.direction_for(0, messages) is None


def test_who_has_stopped_is_to_leave_only_where_a_stop_is_a_departure() -> None:
    for departure in (False, True):
        coordination, _, cells = team()
        coordination.departure = departure
        coordination.take_positions({0: at(0, 0, 0), 1: at(1, 2, 0, kind=Kind.STOP), 2: at(2, 1, 2)})
        assert coordination.departing() == ({1} if departure else set())
        coordination.team_changed((0, 2))
        assert coordination.departing() == set()
        assert coordination.view.obstacles == ({cells["c"]} if departure else set())  # it stands there for good


def test_a_robot_that_is_to_leave_is_not_asked_for_directions() -> None:
    messages = {0: at(0, 0, 0, kind=Kind.TRAP), 1: at(1, 2, 0, kind=Kind.STOP), 2: at(2, 1, 2)}
    for departure, answers in ((False, (1,)), (True, (2,))):
        for me in (1, 2):
            coordination, _, _ = team(me)
            coordination.departure = departure
            coordination.take_positions({1: messages[1]})
            assert (coordination.direction_for(0, messages) is not None) == (me in answers)
    coordination.take_positions({0: at(0, 0, 0, kind=Kind.STOP)})  # a peer's fault: it has stopped, and asks
    assert coordination.direction_for(0, messages) is not None


def test_a_dropped_robot_is_believed_nowhere_and_its_work_is_divided_anew() -> None:
    coordination, algorithm, cells = team()
    coordination.plan()
    coordination.team_changed((0, 2))
    assert coordination.plan_due
    assert coordination.view.cells == {0: cells["a"], 2: cells["h"]}
    coordination.plan()
    assert algorithm.enlisted == 2


def test_a_cell_that_somebody_could_not_enter_is_an_obstacle_to_all() -> None:
    coordination, _, cells = team()
    coordination.plan()
    wall = (Verdict.POSSIBLE, Verdict.WALL, Verdict.POSSIBLE, Verdict.POSSIBLE)
    outer = (Verdict.WALL, Verdict.POSSIBLE, Verdict.POSSIBLE, Verdict.WALL)
    coordination.take_positions({1: replace(at(1, 0, 0), verdicts=wall), 2: replace(at(2, 0, 2), verdicts=outer)})
    assert coordination.view.obstacles == {cells["b"]}
    assert coordination.plan_due


def test_a_robot_knows_its_own_place_better_than_its_last_message() -> None:
    coordination, _, cells = team()
    coordination.take_positions({0: at(0, 1, 0), 1: at(1, 1, 1)})
    assert coordination.view.cells == {0: cells["a"], 1: cells["e"], 2: cells["h"]}


def test_a_robot_that_has_turned_back_says_so_until_the_team_has_heard_it() -> None:
    coordination, _, cells = team(0, None, Action.EAST)
    coordination.plan()
    coordination.evaluate_actions()
    coordination.commit({0: at(0, 0, 0, Action.EAST)})
    coordination.turned_back()
    assert coordination.view.cells[0] == cells["a"]
    verdicts = coordination.obstruction()
    assert verdicts == (Verdict.POSSIBLE, Verdict.WALL, Verdict.POSSIBLE, Verdict.POSSIBLE)
    coordination.take_positions({0: replace(at(0, 0, 0), verdicts=verdicts, busy=True)})
    assert coordination.obstructed is None
    assert coordination.view.obstacles == {cells["b"]}
    assert coordination.plan_due


def test_cells_that_could_not_be_entered_are_tried_again_but_not_for_ever() -> None:
    setup, cells = floor("abc")
    coordination = Coordination(setup, 0, Scripted(), None, rounds=2)
    coordination.team_changed((0,))
    coordination.plan()
    east = (Verdict.POSSIBLE, Verdict.WALL, Verdict.POSSIBLE, Verdict.POSSIBLE)
    coordination.view.cells[0] = cells["a"]
    for left in (2, 1):
        coordination.take_positions({0: replace(at(0, 0, 0), verdicts=east)})
        assert coordination.view.obstacles == {cells["b"]}
        assert coordination.complete(), left
        coordination.plan()
        assert coordination.try_again()
        assert coordination.view.obstacles == frozenset()
        assert coordination.plan_due
        assert not coordination.complete()
    coordination.take_positions({0: replace(at(0, 0, 0), verdicts=east)})
    assert coordination.complete()
    assert not coordination.try_again()
    assert coordination.view.obstacles == {cells["b"]}
    coordination.team_changed((0,))
    assert coordination.try_again()  # a new team has its own tries


def test_nothing_is_tried_again_when_all_is_covered_or_all_have_stopped() -> None:
    coordination, _, cells = team(0, rounds=5)
    coordination.view.obstacles = frozenset({cells["b"]})
    coordination.view.covered |= set(cells.values())
    assert not coordination.try_again()
    stopped, _, _ = team(0, 1, rounds=5)
    stopped.view.obstacles = frozenset({cells["b"]})
    stopped.take_positions({robot: at(robot, 0, 0, kind=Kind.STOP) for robot in range(3)})
    assert not stopped.try_again()


def test_where_a_member_stands_is_no_obstacle() -> None:
    coordination, _, cells = team()
    coordination.view.obstacles = frozenset({cells["b"], cells["f"]})
    coordination.take_positions({1: at(1, 1, 0)})
    assert coordination.view.obstacles == {cells["f"]}


def test_a_robot_that_waits_for_a_plan_makes_all_wait_for_it() -> None:
    coordination, _, _ = team()
    coordination.plan()
    coordination.take_positions({1: at(1, 1, 0)})
    assert not coordination.plan_due
    coordination.take_positions({1: at(1, 1, 0, kind=Kind.ROLL)})
    assert coordination.plan_due


def test_what_was_meant_and_said_in_the_old_team_is_void_in_the_new() -> None:
    coordination, _, _ = team(0, 1)
    coordination.take_positions({0: at(0, 0, 0, kind=Kind.STOP)})
    assert coordination.evaluate_actions().kind == Kind.STOP
    coordination.view.omitted.add(Action.EAST)
    coordination.team_changed((0, 1))
    assert coordination.view.omitted == set()
    assert coordination.evaluate_actions().kind == Kind.STOP  # the others may not have heard it
