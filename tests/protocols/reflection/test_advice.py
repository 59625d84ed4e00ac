"""What a seeker makes of promises and of the ghosts that they leave."""

import math

import pytest

from cosim.units import MS
from protocols.reflection.events import (
    GhostReached,
    GoalGivenUp,
    PromiseForgotten,
)
from protocols.reflection.frames import Frame, encode
from tests.protocols.reflection.arena import GHOST, GOAL, HELPER, SCREEN, SEEKER, Arena, advise, advised, screen


def test_a_seeker_goes_to_the_very_place_of_a_ghost() -> None:
    """A step beside it, the jamb of a door may hide what was seen from there."""
    arena = advised()
    arena.tick()
    advise(arena, 5.0)
    arena.places[1] = (0.0, 4.0)
    arena.run(60, GhostReached)
    assert math.dist(arena.places[0], GHOST) < 0.02


def test_a_seeker_keeps_its_ghost_though_a_corner_hides_it() -> None:
    """What is out of sight is no place of its own: it would turn back to where it saw the helper last."""
    arena = advised()
    arena.tick()
    advise(arena, 5.0)
    arena.places[1] = (0.0, 4.0)
    arena.tick(3)
    arena._sight_m = 1.0
    arena.tick(3)
    way = arena.machines[0].ways.of[0]
    assert way is not None
    assert (way.x_m, way.y_m) == GHOST
    assert arena.run(60, GhostReached) < 60


def test_a_shorter_promise_is_followed_at_once() -> None:
    arena = advised()
    arena.tick()
    advise(arena, 5.0)
    arena.places[1] = (0.0, 4.0)
    arena.tick(5)
    advise(arena, 2.0)
    arena.tick(20)
    assert arena.places[0][1] > 1.0


@pytest.mark.parametrize(("renewal", "follows"), [("stored", True), ("shorter", False), ("any", True)])
def test_after_a_ghost_only_a_shorter_way_counts(renewal: str, follows: bool) -> None:
    arena = Arena([(0.0, 0.0), GHOST], [[(20.0, 0.0)]], sight_m=6.0, renewal=renewal)
    arena.silent = {1}
    arena.tick()
    advise(arena, 5.0)
    arena.places[1] = (0.0, 2.0)
    arena.run(60, GhostReached)
    advise(arena, 4.0)  # from (0, 2), 3.6 m away: longer than the 5 m from the ghost
    arena.tick(10)
    assert (arena.places[0][1] > 0.3) is follows
    advise(arena, 0.5)
    arena.tick(10)
    assert arena.places[0][1] > 0.3


@pytest.mark.parametrize(("renewal", "follows"), [("stored", False), ("shorter", True), ("any", True)])
def test_the_stored_distance_is_not_computed_again_as_the_robot_moves(renewal: str, follows: bool) -> None:
    """A promise of 3 + 5 m led nowhere; 10 m away from there, one of 9 m is longer than that, and shorter than 15 m."""
    arena = Arena([(0.0, 0.0), GHOST], [[(40.0, 0.0)]], sight_m=12.0, renewal=renewal)
    arena.silent = {1}
    arena.tick()
    advise(arena, 5.0)
    arena.places[1] = (3.0, 2.0)
    arena.run(60, GhostReached)
    arena.run(100)
    x, _ = arena.places[0]
    assert 12.0 < x < 14.0
    arena.places[1] = (x, 2.0)
    arena.tick()
    advise(arena, 7.0)
    arena.tick(10)
    assert (arena.places[0][1] > 0.3) is follows
    arena.places[1] = (arena.places[0][0], 2.0)
    arena.tick()
    advise(arena, 3.0)
    arena.tick(10)
    assert arena.places[0][1] > 0.3


def test_with_the_next_goal_all_promises_count_again() -> None:
    arena = Arena([(0.0, 0.0), GHOST], [[(20.0, 0.0), (0.0, 30.0)]], sight_m=6.0, give_up_s=6.0)
    arena.silent = {1}
    arena.tick()
    advise(arena, 1.0)
    arena.places[1] = (0.0, 4.0)
    arena.run(60, GhostReached)
    assert arena.machines[0].ways.bound_m < 5.0
    arena.run(60, GoalGivenUp)
    arena.places[1] = (arena.places[0][0], 3.0)
    arena.tick()
    arena.inject(0, 1, encode(Frame(False, False, arena.now // MS, (), (), ((0, 4, 40.0, 0),))))
    arena.tick()
    assert arena.machines[0].ways.of[0] is not None


def test_promises_of_a_dead_helper_age() -> None:
    arena = Arena([(-9.0, -2.0), (2.0, -2.0)], [[GOAL]], walls=SCREEN, promise_life_s=3.0)
    arena.tick(5)
    arena.silent = {1}
    assert arena.machines[0].ways.of[0] is not None
    arena.tick(31)
    assert [event.reason for event in arena.told(0, PromiseForgotten)] == ["out of sight, or too old"]
    assert arena.machines[0].ways.of[0] is None


def test_advice_about_a_former_goal_is_counted_as_stale_and_not_followed() -> None:
    arena = Arena([SEEKER, HELPER], [[(0.0, 3.1), GOAL]], walls=SCREEN)
    arena.tick()
    machine = arena.machines[0]
    assert machine.book.number(0) == 2
    before = machine.counters.outdated
    arena.inject(0, 1, encode(Frame(False, False, 0, ((0, 1.0),), (), ((0, 2, 0.5, 0),))))
    assert machine.counters.outdated == before + 1
    assert machine.ways.of[0] is None or machine.ways.of[0].rest_m != 0.5


def test_a_promise_is_as_old_as_the_sight_of_its_goal() -> None:
    arena = Arena([(0.0, 0.0), GHOST], [[(20.0, 0.0)]], sight_m=6.0, promise_life_s=3.0)
    arena.silent = {1}
    arena.tick(50)
    for seen_ms, followed in ((1000, False), (4000, True)):
        arena.inject(0, 1, encode(Frame(False, False, 4900, (), (), ((0, 2, 5.0, seen_ms),))))
        arena.tick()
        assert (arena.machines[0].ways.of[0] is not None) is followed


def test_a_promise_that_brings_no_progress_is_given_up() -> None:
    """The helper's body stays where it stood when it made its promise."""
    arena = advised()
    arena.tick()
    advise(arena, 5.0)
    arena.run(150, PromiseForgotten)
    assert [event.reason for event in arena.told(0, PromiseForgotten)] == ["no progress"]


def test_late_advice_is_counted() -> None:
    arena = screen(delay=8)
    arena.tick(30)
    counters = arena.machines[0].counters
    assert counters.advice > 10
    assert counters.late == counters.stale == counters.advice
    prompt = screen(delay=2)
    prompt.tick(30)
    assert prompt.machines[0].counters.late == 0
