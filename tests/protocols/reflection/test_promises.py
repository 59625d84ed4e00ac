"""Ways: shortest promises, ghosts of helpers and own ghosts (paper 000, sections 3.2, 4.2, 4.3)."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.units import S
from protocols.reflection.goals import GoalBook
from protocols.reflection.promises import GAIN_M, Ways

GOAL = (10.0, 0.0)
OWNER, ME = 0, 1


def setting(life: int | None = None) -> Ways:
    """A helper that knows the owner's goal and has no way to it yet."""
    book = GoalBook(ME, 4)
    book.consider(OWNER, 4, *GOAL)
    return Ways(book, life)


def look(ways: Ways, here: tuple[float, float], *visible: bool, now: int = 0) -> float | None:
    """Look from *here*; return the length of the way, if there is one."""
    assert len(ways.points()) == len(visible)
    ways.look(list(visible), *here, now)
    way = ways.of[OWNER]
    return None if way is None else way.length(*here)


def test_who_sees_the_goal_promises_the_straight_way() -> None:
    ways = setting()
    assert look(ways, (7.0, 4.0), True) == pytest.approx(5.0)
    way = ways.of[OWNER]
    assert way is not None
    assert way.direct


def test_the_own_ghost_is_the_last_place_from_which_the_goal_was_seen() -> None:
    """Fig. 8: R(t1) sees the goal at 3 m; then it goes 4 m, then round a second corner 2 m more."""
    ways = setting()
    look(ways, (7.0, 0.0), True)
    assert look(ways, (7.0, 1.0), False) == pytest.approx(3.0 + 1.0)
    assert look(ways, (7.0, 4.0), False, True) == pytest.approx(3.0 + 4.0)
    way = ways.of[OWNER]
    assert way is not None
    assert (way.x_m, way.y_m, way.rest_m) == (7.0, 0.0, 3.0)
    assert look(ways, (5.0, 4.0), False, False) == pytest.approx(3.0 + 4.0 + 2.0)
    assert (way.x_m, way.y_m) == (7.0, 4.0)
    assert look(ways, (6.0, 3.0), False, True) == pytest.approx(7.0 + math.sqrt(2.0))
    assert look(ways, (8.0, 0.0), True, False) == pytest.approx(2.0)  # sees it again


def test_the_shortest_promise_wins_also_over_a_later_one_of_the_same_robot() -> None:
    """Fig. 7: what R2 promises when it has gone on, farther away from the goal, does not count."""
    ways = setting()
    here = (0.0, 0.0)
    assert ways.offer(OWNER, (3.0, 0.0), 6.0, 0, 2, here)
    assert not ways.offer(OWNER, (4.0, 0.0), 6.5, 0, 2, here)
    assert not ways.offer(OWNER, (3.0, 0.0), 6.0, 0, 2, here)
    assert not ways.offer(OWNER, (3.0, 0.0), 6.0 - 0.5 * GAIN_M, 0, 3, here)
    assert ways.offer(OWNER, (0.0, 4.0), 4.5, 0, 3, here)
    way = ways.of[OWNER]
    assert way is not None
    assert (way.via, way.length(*here)) == (3, 8.5)


def test_what_is_left_of_a_way_is_what_another_has_to_beat() -> None:
    """A helper that comes towards the seeker, away from the goal, does not turn it back: the sum stays the same."""
    ways = setting()
    ways.offer(OWNER, (4.0, 0.0), 6.0, 0, 2, (0.0, 0.0))
    look(ways, (1.0, 0.0), False, True)
    assert not ways.offer(OWNER, (3.0, 0.0), 7.0, 0, 2, (1.0, 0.0))
    assert ways.offer(OWNER, (3.0, 0.0), 6.9, 0, 2, (1.0, 0.0))


def test_by_the_letter_the_length_at_the_time_of_the_promise_is_to_beat() -> None:
    """Section 4.2: 10 m were promised; a metre later 9 m are left, and 9.5 m still count as shorter."""
    ways = Ways(setting().book, None, "stored")
    ways.offer(OWNER, (4.0, 0.0), 6.0, 0, 2, (0.0, 0.0))
    look(ways, (1.0, 0.0), False, True)
    assert not ways.offer(OWNER, (3.0, 0.0), 8.0, 0, 2, (1.0, 0.0))
    assert ways.offer(OWNER, (3.0, 0.0), 7.5, 0, 2, (1.0, 0.0))
    look(ways, (2.0, 0.0), False, True)
    assert not ways.offer(OWNER, (3.0, 0.0), 8.5, 0, 2, (2.0, 0.0))  # 9.5 m, as was promised


def test_by_the_letter_too_the_distance_by_an_own_ghost_is_the_present_one() -> None:
    """Section 4.3: a promise of 7 m, then the goal out of sight; the last place, 6.5 m before it, is its own."""
    ways = Ways(setting().book, None, "stored")
    ways.offer(OWNER, (3.0, 0.0), 4.0, 0, 2, (0.0, 0.0))
    look(ways, (0.5, 0.0), False, True)
    assert look(ways, (0.5, 5.0), False, False) == pytest.approx(6.5 + 5.0)
    assert ways.offer(OWNER, (0.5, 7.0), 9.0, 0, 3, (0.5, 5.0))
    assert not ways.offer(OWNER, (0.5, 6.0), 10.5, 0, 3, (0.5, 5.0))


def test_a_useless_way_that_is_kept_is_measured_from_here_by_the_letter_too() -> None:
    book = GoalBook(ME, 4)
    book.set_own(1, *GOAL)
    ways = Ways(book, None, "stored")
    assert ways.offer(ME, (3.0, 0.0), 6.0, 0, 2, (0.0, 0.0))
    way = ways.of[ME]
    assert way is not None
    ways.useless(way, "shorter")
    assert ways.offer(ME, (3.0, 12.0), 10.0, 0, 2, (3.0, 10.0))  # 12 m against 16, not 9


def test_each_owner_s_ghost_is_looked_for_by_itself() -> None:
    ways = setting()
    ways.book.consider(2, 4, 0.0, 10.0)
    ways.look([True, True], 0.0, 0.0, 0)
    ways.look([False, False], 1.0, 0.0, 0)
    assert ways.points() == [GOAL, (0.0, 0.0), (0.0, 10.0), (0.0, 0.0)]
    ways.look([False, True, False, False], 2.0, 0.0, 0)
    first, second = ways.of[0], ways.of[2]
    assert first is not None
    assert second is not None
    assert (first.x_m, first.rest_m) == (0.0, 10.0)
    assert (second.x_m, second.rest_m) == (1.0, 11.0)


def test_no_promise_beats_a_goal_in_sight() -> None:
    ways = setting()
    look(ways, (0.0, 0.0), True)
    assert not ways.offer(OWNER, (1.0, 0.0), 0.0, 0, 2, (0.0, 0.0))


def test_a_promise_ages_from_when_the_goal_was_seen_and_not_from_when_it_was_told() -> None:
    ways = setting(life=10 * S)
    ways.offer(OWNER, (3.0, 0.0), 6.0, 5 * S, 2, (0.0, 0.0))
    assert look(ways, (0.0, 0.0), False, True, now=15 * S) is not None
    assert look(ways, (0.0, 0.0), False, True, now=15 * S + 1) is None


def test_a_robot_that_was_moved_forgets_its_ghosts() -> None:
    ways = setting()
    look(ways, (7.0, 0.0), True)
    ways.displaced()
    assert look(ways, (50.0, 50.0), False) is None


walks = st.lists(
    st.tuples(st.floats(-5.0, 15.0), st.floats(-5.0, 5.0), st.booleans(), st.booleans()), min_size=1, max_size=30
)


@given(walks)
def test_a_ghost_s_distance_is_never_below_the_straight_line_nor_above_the_path(
    walk: list[tuple[float, float, bool, bool]],
) -> None:
    """Whatever is in sight when: the goal, the ghost, both, none."""
    ways = setting()
    path = math.inf
    before = None
    for x, y, goal_seen, ghost_seen in walk:
        here = (x, y)
        visible = [goal_seen, ghost_seen][: len(ways.points())]
        path = math.dist(here, GOAL) if goal_seen else path + (0.0 if before is None else math.dist(here, before))
        length = look(ways, here, *visible)
        before = here
        if length is None:
            assert path == math.inf
        else:
            assert math.dist(here, GOAL) - 1e-9 <= length <= path + 1e-9


crowds = st.lists(st.tuples(st.floats(0.0, 20.0), st.floats(0.0, 20.0)), min_size=2, max_size=6)


@given(crowds, st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5), st.integers(0, 3)), max_size=80))
def test_promises_do_not_go_in_circles_for_any_team_and_order_of_messages(
    crowd: list[tuple[float, float]], meetings: list[tuple[int, int, int]]
) -> None:
    """Robots that stand; robot 0 sees the goal; frames arrive in any order, some late, some never.

    Who follows the promises from robot to robot comes to the one that sees the goal, in fewer hops than there are
    robots, and each way is as long as the robots' distances along it.
    """
    goal, team = (0.0, -1.0), len(crowd)
    books = [GoalBook(robot, team + 1) for robot in range(team)]
    everybody = [Ways(book, None) for book in books]
    for robot, book in enumerate(books):
        book.consider(team, team + 1, *goal)
        everybody[robot].look([robot == 0], *crowd[robot], 0)
    sent: list[tuple[int, float]] = []
    for sender, receiver, late in meetings:
        sender, receiver = sender % team, receiver % team
        way = everybody[sender].of[team]
        if way is not None:
            sent.append((sender, way.length(*crowd[sender])))
        for author, length in sent[-1 - late :][:1]:
            if author != receiver:
                everybody[receiver].offer(team, crowd[author], length, 0, author, crowd[receiver])
    for robot in range(team):
        at, hops = robot, [robot]
        while (way := everybody[at].of[team]) is not None and not way.direct:
            at = way.via
            hops.append(at)
            assert len(hops) <= team, f"promises go in a circle: {hops}"
        way = everybody[robot].of[team]
        if way is not None:
            assert at == 0
            along = sum(math.dist(crowd[one], crowd[other]) for one, other in pairwise(hops))
            assert way.length(*crowd[robot]) >= along + math.dist(crowd[0], goal) - 1e-6


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2), st.integers(0, 30)), max_size=60))
def test_robots_do_not_keep_an_old_promise_alive_among_each_other(meetings: list[tuple[int, int, int]]) -> None:
    """However often it is told again: once it has aged, nobody holds it."""
    life = 20 * S
    books = [GoalBook(robot, 4) for robot in range(3)]
    everybody = [Ways(book, life) for book in books]
    for robot, book in enumerate(books):
        book.consider(3, 4, *GOAL)
        everybody[robot].look([robot == 0], 0.0, float(robot), 0)
    now = 0
    for sender, receiver, pause in meetings:
        now += pause * S // 10
        for robot in range(3):
            ways = everybody[robot]
            ways.look([False] * len(ways.points()), 0.0, float(robot), now)
        way = everybody[sender].of[3]
        if way is not None and sender != receiver:
            here = (0.0, float(receiver))
            length = way.length(0.0, float(sender))
            everybody[receiver].offer(3, (0.0, float(sender)), length, way.seen, sender, here)
        if now > life:
            assert all(ways.of[3] is None for ways in everybody)
