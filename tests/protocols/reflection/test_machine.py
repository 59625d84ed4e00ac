"""The machine: a team of robots in a small world with walls."""

import math

import numpy as np
import pytest

from cosim.geometry.segments import segment_grid
from cosim.machine import Reception
from cosim.randomness import Draws
from protocols.reflection.events import (
    BadBytes,
    Displaced,
    GhostReached,
    GoalGivenUp,
    GoalReached,
    GoalSet,
    PromiseTaken,
    TroubleChanged,
)
from protocols.reflection.frames import Frame, decode, encode
from protocols.reflection.guidance import draws_of
from protocols.reflection.seeking import Target
from tests.protocols.reflection.arena import GHOST, GOAL, HELPER, SCREEN, SEEKER, STEP_M, Arena, advise, advised, screen


def test_alone_a_robot_that_sees_its_goal_goes_there_straight() -> None:
    arena = Arena([(0.0, 0.0)], [[(3.0, 4.0)]])
    ticks = arena.run(100, GoalReached)
    assert ticks == math.ceil((5.0 - 0.3) / STEP_M) + 1
    assert arena.machines[0].finished
    assert arena.payloads == [[]]  # there is nobody to talk to


def test_a_robot_that_sees_the_goal_reflects_it_and_the_seeker_comes_round_the_wall() -> None:
    arena = screen()
    ticks = arena.run(400, GoalReached)
    assert [event.helper for event in arena.told(0, PromiseTaken)] == [1]
    way_m = math.dist(SEEKER, HELPER) + math.dist(HELPER, GOAL)
    assert arena.told(0, PromiseTaken)[0].way_m == pytest.approx(way_m, abs=2.0 * STEP_M)
    assert ticks * STEP_M < way_m + 0.5


def test_without_sharing_goals_the_seeker_stays_behind_the_wall_and_nothing_is_said() -> None:
    arena = screen(share_goals=False)
    arena.run(300)
    assert not arena.told(0, GoalReached)
    assert arena.places[0][0] < 2.0
    assert arena.payloads == [[], []]


def test_in_frames_that_nobody_else_knows_the_robots_do_the_same() -> None:
    in_world, in_frames = screen(), screen(frames=[(1.0, 2.0, 2.5), (-3.0, 0.5, -1.2)])
    for _ in range(40):  # later the beams of turned scanners meet other points of the wall
        in_world.tick()
        in_frames.tick()
        for one, other in zip(in_world.places, in_frames.places, strict=True):
            assert one == pytest.approx(other, abs=1e-4)
    assert in_frames.machines[0].ways.of[0] is not None


def test_a_promise_goes_from_robot_to_robot_and_grows_on_its_way() -> None:
    """Three robots in a row round two corners: only the last sees the goal; the seeker sees only the next."""
    walls = [(2.0, 0.0, 2.0, -9.0), (2.0, 0.0, 4.0, 2.0), (4.0, 2.0, 4.0, 9.0), (0.0, 2.0, 2.5, 4.5)]
    starts = [(0.0, -3.0), (1.2, 0.6), (3.2, 3.0), (3.5, 8.0)]
    arena = Arena(starts, [[(3.0, 7.0)]], walls=walls, sight_m=4.6)
    arena.tick(7)
    sent = decode(arena.payloads[1][-1])
    owner, identifier, length, _ = sent.pledges[0]
    assert (owner, identifier) == (0, 4)
    assert length == pytest.approx(math.dist(starts[1], starts[2]) + math.dist(starts[2], (3.0, 7.0)), rel=1e-6)
    assert [term[1] for term in decode(arena.payloads[2][-1]).terms] == [2]  # kM - 2: by two others
    assert arena.told(0, PromiseTaken)[0].helper == 1


def test_a_goal_in_sight_beats_every_promise() -> None:
    arena = Arena([(0.0, 0.0), (0.0, 3.0)], [[(4.0, 0.0)]])
    arena.tick(3)
    assert arena.machines[0].seeker is not None
    assert arena.machines[0].seeker.target is Target.GOAL
    assert arena.places[0][1] == 0.0


def test_the_seeker_heads_for_the_helper_s_ghost_and_forgets_the_promise_there() -> None:
    """Fig. 7: the helper has left, and what it promises later is longer."""
    arena = advised()
    arena.tick()
    advise(arena, 5.0)
    arena.places[1] = (0.0, 4.0)
    arena.tick(10)
    advise(arena, 9.0)
    ticks = arena.run(40, GhostReached)
    assert [event.helper for event in arena.told(0, PromiseTaken)] == [1]
    assert arena.told(0, PromiseTaken)[0].way_m == pytest.approx(8.0, abs=STEP_M + 1e-9)
    assert arena.places[0] == pytest.approx(GHOST, abs=STEP_M)
    assert ticks == pytest.approx(20, abs=2)
    arena.tick(3)
    assert arena.machines[0].seeker is not None
    assert arena.machines[0].seeker.target is Target.ALGORITHM
    assert len(arena.told(0, GhostReached)) == 1


def test_a_goal_that_was_in_sight_is_headed_for_behind_a_corner_too() -> None:
    """A body that comes round a corner loses sight of what it heads for; it goes on, as long as it comes nearer."""
    arena = Arena([(0.0, 0.0)], [[(5.0, 0.0)]], sight_m=6.0)
    arena.tick(2)
    arena._sight_m = 3.5
    arena.tick(2)
    way = arena.machines[0].ways.of[0]
    assert way is not None
    assert not way.direct
    assert arena.machines[0].seeker is not None
    assert arena.machines[0].seeker.target is Target.GOAL


def test_where_it_has_been_itself_a_seeker_learns_nothing() -> None:
    """It has seen its goal, but glass is before it: its own ghost is forgotten, and any promise is welcome."""
    arena = Arena([(0.0, 0.0), GHOST], [[(5.0, 0.0)]], sight_m=6.0, solid=False, patience_s=1.0)
    arena.silent = {1}
    arena.tick(2)
    arena._sight_m = 3.5
    for _ in range(20):
        arena.tick()
        arena.places[0] = (0.0, 0.0)
    assert arena.told(0, GhostReached) == []
    assert arena.machines[0].ways.of[0] is None
    advise(arena, 50.0)
    arena.tick()
    assert arena.machines[0].seeker is not None
    assert arena.machines[0].seeker.target is Target.PROMISE


def test_each_time_a_goal_in_sight_is_not_come_to_the_algorithm_is_left_alone_for_longer() -> None:
    """A dead body stands on the goal: 2 s of trying, then 4 s by the algorithm, 2 s, 8 s, 2 s, 16 s."""
    arena = Arena([(2.0, 0.0), (3.0, 0.0)], [[(3.0, 0.0)]], patience_s=2.0, detour_s=4.0)
    arena.silent = {1}
    spells, ticks = [], 0
    for _ in range(400):
        before = arena.machines[0].counters.steps[Target.ALGORITHM]
        arena.tick()
        if arena.machines[0].counters.steps[Target.ALGORITHM] > before:
            ticks += 1
        elif ticks:
            spells.append(ticks)
            ticks = 0
    assert spells[:3] == pytest.approx([40, 80, 160], abs=2)


def test_who_follows_a_helper_keeps_away_from_it() -> None:
    wall = [(2.0, -99.0, 2.0, 99.0)]
    arena = Arena([(1.7, 3.0), (0.3, 3.0)], [[GOAL]], (), wall, share_states=True, trouble_limit=25, progress_window=5)
    nearest = math.inf
    for _ in range(300):
        arena.tick()
        nearest = min(nearest, math.dist(*arena.places))
    assert 0.85 < nearest < 1.05
    assert [event.in_trouble for event in arena.told(0, TroubleChanged)][:2] == [True, False]


def test_frames_are_sent_once_in_a_period() -> None:
    sent = {}
    for period in (None, 0.5):
        arena = screen(period_s=period)
        arena.tick(20)
        sent[period] = len(arena.payloads[1])
    assert sent == {None: 20, 0.5: 4}


def test_frames_of_robots_that_are_not_in_sight_are_of_no_use() -> None:
    arena = Arena([(0.0, 3.0), (3.0, 3.0)], [[GOAL]], walls=SCREEN)
    arena.tick(10)
    assert arena.machines[0].ways.of[0] is None
    assert arena.machines[1].book.known == []


def test_a_robot_that_was_carried_away_notices_and_finds_its_goal_from_there() -> None:
    arena = screen()
    arena.tick(20)
    arena.places[0] = (9.0, -3.0)
    arena.run(200, GoalReached)
    assert [round(event.distance_m, 1) for event in arena.told(0, Displaced)] == [
        round(math.dist((9.0, -3.0), (0.71, 1.13)), 1)
    ] or len(arena.told(0, Displaced)) == 1
    assert arena.told(0, GoalReached)


def test_a_helper_that_was_carried_away_promises_nothing_from_before() -> None:
    arena = screen()
    arena.tick(5)
    assert arena.machines[1].ways.of[0] is not None
    arena.places[1] = (-9.0, 9.0)
    arena.tick()
    assert arena.told(1, Displaced)
    assert arena.machines[1].ways.of[0] is None
    assert decode(arena.payloads[1][-1]).pledges == ()


def test_a_goal_outside_the_floor_is_given_up_and_the_next_one_reached() -> None:
    box = [(-1.0, -1.0, 5.0, -1.0), (5.0, -1.0, 5.0, 5.0), (5.0, 5.0, -1.0, 5.0), (-1.0, 5.0, -1.0, -1.0)]
    arena = Arena([(0.0, 0.0), (4.0, 0.0)], [[(50.0, 2.0), (3.0, 3.0)]], walls=box, give_up_s=10.0)
    arena.run(300, GoalReached)
    assert [(event.number, event.reason) for event in arena.told(0, GoalGivenUp)] == [(1, "time")]
    assert [event.number for event in arena.told(0, GoalSet)] == [1, 2]
    assert [event.number for event in arena.told(0, GoalReached)] == [2]
    assert arena.machines[1].book.number(0) == 2


@pytest.mark.parametrize("data", [b"", b"\x52", b"\x52" * 40, bytes(100), bytes(range(256))])
def test_garbage_becomes_an_event(data: bytes) -> None:
    arena = screen()
    arena.tick()
    arena.inject(0, 1, data)
    assert len(arena.told(0, BadBytes)) == 1
    arena.tick(400)
    assert arena.told(0, GoalReached)


def test_a_frame_about_robots_that_do_not_exist_is_noted_and_the_rest_of_it_used() -> None:
    arena = screen()
    arena.tick()
    bearing = decode(arena.payloads[1][-1]).bearings
    frame = Frame(False, False, 0, bearing, ((77, 5, 0.0, 0.0),), ((78, 5, 1.0, 0), (0, 2, 1.0, 0)))
    arena.inject(0, 1, encode(frame))
    assert len(arena.told(0, BadBytes)) == 2
    assert arena.machines[0].ways.of[0] is not None


def test_what_is_known_of_a_goal_is_forgotten_with_the_goal() -> None:
    arena = Arena([(0.0, 3.0), (2.0, -2.0)], [[(0.0, 3.6), (0.0, 20.0)]], sight_m=6.0)
    arena.tick(2)
    assert arena.machines[1].ways.of[0] is not None
    arena.tick(6)
    assert arena.machines[1].book.number(0) == 2
    assert arena.machines[1].ways.of[0] is None


def test_a_goal_in_sight_that_no_straight_way_leads_to_is_left_to_the_algorithm_for_a_while() -> None:
    """A dead body stands on it."""
    arena = Arena([(0.0, 0.0), (3.0, 0.0)], [[(3.0, 0.0)]], patience_s=2.0, detour_s=4.0)
    arena.silent = {1}
    arena.tick(27 + 20)
    steps = arena.machines[0].counters.steps
    assert steps[Target.ALGORITHM] <= 2
    arena.tick(40)
    assert 35 <= steps[Target.ALGORITHM] <= 42


def test_objects_are_found_by_those_who_see_them() -> None:
    """Nobody knows where the object is; the helper sees it and says so."""
    arena = screen(goals="object", frames=[(0.0, 3.0, 1.0), (2.0, -2.0, -2.0)])
    arena.tick(2)
    terms = decode(arena.payloads[0][-1])
    assert terms.objects
    assert arena.run(400, GoalReached) < 400


def test_in_trouble_a_robot_follows_one_that_is_not_and_stays_behind_it() -> None:
    """The wall has no end here, and nobody sees the goal."""
    wall = [(2.0, -99.0, 2.0, 99.0)]
    patrol = [(), ((0.0, -2.0), (0.0, -12.0))]
    arena = Arena(
        [(1.7, 3.0), (0.0, -2.0)], [[GOAL]], patrol, wall, share_states=True, trouble_limit=10, progress_window=5
    )
    arena.run(60, TroubleChanged)
    assert arena.told(0, TroubleChanged)[0].in_trouble
    arena.tick(40)
    assert arena.machines[0].counters.steps[Target.HELPER] > 10
    assert arena.places[0][1] < 1.0
    assert math.dist(arena.places[0], arena.places[1]) > 0.8
    assert decode(arena.payloads[0][-1]).in_trouble
    assert not decode(arena.payloads[1][-1]).in_trouble


def test_nobody_follows_a_robot_that_is_in_trouble_itself() -> None:
    wall = [(2.0, -99.0, 2.0, 99.0)]
    goals = [[GOAL], [(4.0, 0.0)]]
    arena = Arena([(1.7, 3.0), (1.7, 0.0)], goals, (), wall, share_states=True, trouble_limit=10, progress_window=5)
    arena.tick(150)
    assert all(machine.seeker is not None and machine.seeker.trouble.active for machine in arena.machines)
    assert arena.machines[0].counters.steps[Target.HELPER] < 5


def hides(trouble_limit: int, **more: object) -> Arena:
    """A seeker in trouble before a wall without end, whose helper vanishes as soon as it is headed for."""
    wall = [(2.0, -99.0, 2.0, 99.0)]
    arena = Arena([(1.7, 3.0), (0.0, -2.0)], [[GOAL]], (), wall, share_states=True, trouble_limit=trouble_limit, **more)
    steps = arena.machines[0].counters.steps
    for _ in range(2 * trouble_limit):
        arena.tick()
        if steps[Target.HELPER] == 3:
            break
    assert steps[Target.HELPER] == 3
    arena.silent = {1}
    arena.places[1] = (-90.0, 90.0)
    return arena


def test_a_helper_that_gets_out_of_sight_is_left_to_itself() -> None:
    arena = hides(80)
    arena.tick(70)
    assert arena.machines[0].counters.steps[Target.HELPER] <= 4
    assert arena.places[0][1] > 2.5


def test_a_helper_out_of_sight_may_be_followed_to_where_it_was_seen_last() -> None:
    """Rule 3 of section 5 by its letter: until it is no longer in trouble; 53 steps lead to that place."""
    arena = hides(80, hidden_helper="followed")
    nearest = math.inf
    for _ in range(58):
        arena.tick()
        nearest = min(nearest, math.dist(arena.places[0], (0.0, -2.0)))
    assert nearest < 2.0 * STEP_M
    steps = arena.machines[0].counters.steps
    there = steps[Target.HELPER]
    assert there == pytest.approx(53, abs=3)
    arena.tick(10)  # there it is where the helper was, and goes on by itself
    assert steps[Target.HELPER] == there


def test_a_helper_out_of_sight_is_followed_as_long_as_there_is_trouble() -> None:
    arena = hides(20, hidden_helper="followed")
    arena.tick(25)
    assert arena.machines[0].counters.steps[Target.HELPER] == pytest.approx(20, abs=2)
    assert [event.in_trouble for event in arena.told(0, TroubleChanged)] == [True, False]


def put_across(arena: Arena, share: float) -> None:
    """Put a wall across the seeker's way to where its helper was, after so much of it."""
    x, y = arena.places[0]
    to_x, to_y = 0.0 - x, -2.0 - y
    middle_x, middle_y = x + share * to_x, y + share * to_y
    across = (middle_x - 9.0 * to_y, middle_y + 9.0 * to_x, middle_x + 9.0 * to_y, middle_y - 9.0 * to_x)
    arena.grid = segment_grid(np.array([(2.0, -99.0, 2.0, 99.0), across]))


def test_a_place_of_a_helper_that_cannot_be_come_to_is_left() -> None:
    """The seeker, still in trouble, would stand before the wall for good."""
    arena = hides(80, hidden_helper="followed", patience_s=2.0)
    put_across(arena, 0.2)
    arena.tick(60)
    steps = arena.machines[0].counters.steps
    left = steps[Target.HELPER]
    assert 20 < left < 45
    assert arena.machines[0].seeker is not None
    assert arena.machines[0].seeker.trouble.active
    arena.tick(20)
    assert steps[Target.HELPER] == left


def test_to_stand_near_where_a_helper_was_is_no_progress() -> None:
    """It is where the helper is still there: then the seeker keeps up with it."""
    arena = hides(80, hidden_helper="followed", patience_s=60.0)
    put_across(arena, 0.9)
    arena.tick(160)
    assert math.dist(arena.places[0], (0.0, -2.0)) < 0.95
    assert arena.machines[0].seeker is not None
    assert arena.machines[0].seeker.trouble.active


def test_a_helper_that_was_nearer_before_it_vanished_is_followed() -> None:
    """To come near its last place is progress, though the seeker was nearer to the helper once."""
    arena = hides(80, hidden_helper="followed", patience_s=0.5)
    arena.places[1] = (-6.0, -4.0)
    arena.tick(15)
    arena.places[1] = (-90.0, 90.0)
    steps = arena.machines[0].counters.steps
    before = steps[Target.HELPER]
    arena.tick(20)
    assert steps[Target.HELPER] == before + 20


def test_who_was_carried_away_does_not_look_for_its_helper() -> None:
    arena = hides(80, hidden_helper="followed")
    arena.tick(3)
    steps = arena.machines[0].counters.steps
    assert steps[Target.HELPER] == 6
    arena.places[0] = (-20.0, 30.0)
    arena.tick(20)
    assert steps[Target.HELPER] == 6


def test_nor_does_who_has_seen_its_goal() -> None:
    """Rule 3 ends there; the wall is away for a moment."""
    arena = hides(80, hidden_helper="followed", patience_s=0.5)
    arena.tick(3)
    steps = arena.machines[0].counters.steps
    before = steps[Target.HELPER]
    wall, arena.grid = arena.grid, segment_grid(np.zeros((0, 4)))
    arena.tick(2)
    arena.grid = wall
    arena.tick(40)
    assert steps[Target.GOAL] > 0
    assert steps[Target.ALGORITHM] > 80  # in its first trouble, and now again
    assert arena.machines[0].seeker is not None
    assert arena.machines[0].seeker.trouble.active
    assert steps[Target.HELPER] == before


@pytest.mark.parametrize("team", [2, 5, 9])
def test_if_all_meet_the_bytes_of_a_tick_grow_with_the_square_of_the_team(team: int) -> None:
    starts = [(2.0 * math.cos(k), 2.0 * math.sin(k)) for k in range(team)]
    goals = [[(20.0 + k, 30.0)] for k in range(team)]
    arena = Arena(starts, goals, solid=False, sight_m=100.0)
    arena.tick(3)
    for payloads in arena.payloads:
        frame = decode(payloads[-1])
        assert (len(frame.bearings), len(frame.terms), len(frame.pledges)) == (team - 1, team, team - 1)
    total = sum(len(payloads[-1]) for payloads in arena.payloads)
    assert total == team * (11 + 5 * (team - 1) + 13 * team + 13 * (team - 1))


def test_own_frames_that_come_back_change_nothing() -> None:
    arena = screen()
    arena.tick(3)
    machine = arena.machines[0]
    before = (list(machine.book.identifiers), machine.counters.advice)
    machine.receive(arena.payloads[0][-1], Reception(0, True), arena.now)
    assert (machine.book.identifiers, machine.counters.advice) == before
    machine.receive(b"not a frame", Reception(0, True), arena.now)
    assert machine.events() == []


def test_the_noise_of_a_robot_depends_on_its_stream_only() -> None:
    one, other = (draws_of(np.random.default_rng(5)) for _ in range(2))
    assert isinstance(one, Draws)
    assert one.words(3) == other.words(3) != draws_of(np.random.default_rng(6)).words(3)
