"""Properties of the real machines for any team, sight, timing and loss, and any motion: bytes cross every link.

What is proved of goal reflection: the way that a robot tells is a row of straight pieces from it to the goal, so it is
never below the straight line, and along the row of robots that it was handed on by it never becomes shorter; nothing
is told of a goal that nobody has seen for longer than a promise lives.
"""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cosim.units import MS, from_seconds
from protocols.reflection.setup import into_frame
from tests.protocols.reflection.arena import out_of_frame
from tests.protocols.reflection.stage import STEP_M, TICK, Stage
from tests.tiers import soak_count

LIFE_S = 1.5
LATEST = 7
"""A frame arrives at most so many ticks late."""
APART_M = 0.4
"""Bodies are solid: two at one place would see each other nowhere."""
ROUNDING_M = 1e-4
"""Numbers on the wire are single floats: up to 128 m they are rounded by at most 4 um a hop."""


class Script:
    """A row of bytes that decides everything; when it is used up, the play is over."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    @property
    def ended(self) -> bool:
        return self._at >= len(self._data)

    def below(self, bound: int) -> int:
        """Return the next number, below *bound* (at most 256); 0 when there is none."""
        if self.ended:
            return 0
        self._at += 1
        return self._data[self._at - 1] % bound

    def bits(self, count: int) -> int:
        """Return *count* random bits."""
        value = 0
        for _ in range(-(-count // 8)):
            value = value << 8 | self.below(256)
        return value & (1 << count) - 1


class Play:
    """Robots walk at random; who sees whom, goals and ghosts changes now and then.

    Some are carried away, but not in plays with delays: a frame that is under way then is put where its sender is seen.
    """

    def __init__(self, data: bytes, delays: bool, **more: object) -> None:
        self.script = script = Script(data)
        size = 2 + script.below(7)
        places = [(2.0 * script.below(16), 2.0 * robot + 16.0 * script.below(2)) for robot in range(size)]
        frames = [(float(script.below(9)), float(script.below(9)), 0.1 * script.below(63)) for _ in range(size)]
        owners = 1 + script.below(min(size, 3))
        goals = [[(3.0 * script.below(11), 3.0 * script.below(11)) for _ in range(4)] for _ in range(owners)]
        give_up_s = (0.9, 2.1, 60.0)[script.below(3)]
        renewal = ("stored", "shorter", "any")[script.below(3)]
        more = {"promise_life_s": LIFE_S, "give_up_s": give_up_s, "patience_s": 0.4, "renewal": renewal, **more}
        self.stage = Stage(places, frames, goals, **more)
        self.size, self.delays = size, delays
        self._sees: list[list[int]] = [[] for _ in places]
        self._goals_seen = [0] * size
        self._ghosts_seen = [False] * size

    def tick(self, moving: bool = True) -> None:
        script, stage = self.script, self.stage
        for robot in range(self.size):
            step = script.below(32) if moving else 0
            if step >= 16:
                x, y = stage.places[robot]
                angle = step * math.pi / 8.0
                carried = step == 31 and not self.delays and script.below(4) == 0
                way_m = 9.0 if carried else STEP_M
                there = x + way_m * math.cos(angle), y + way_m * math.sin(angle)
                others = stage.places[:robot] + stage.places[robot + 1 :]
                if all(math.dist(there, other) >= APART_M for other in others):
                    stage.places[robot] = there
        if moving and script.below(3) == 0:
            self._look_anew()
        delays = [self._delay() for _ in range(self.size)]
        stage.tick(self._sees, self._goals_seen, self._ghosts_seen, delays)

    def close_eyes(self) -> None:
        """From now on nobody sees a goal, and everybody everybody and every ghost."""
        self._goals_seen = [0] * self.size
        self._ghosts_seen = [True] * self.size
        self._sees = [[other for other in range(self.size) if other != robot] for robot in range(self.size)]

    def _look_anew(self) -> None:
        count = self.size * (self.size - 1) // 2
        pairs = self.script.bits(count)
        if self.script.below(2):
            pairs &= self.script.bits(count)
        self._sees = [[] for _ in range(self.size)]
        for one in range(self.size):
            for other in range(one):
                if pairs & 1:
                    self._sees[one].append(other)
                    self._sees[other].append(one)
                pairs >>= 1
        self._goals_seen = [max(self.script.below(40) - 32, 0) for _ in range(self.size)]
        ghosts = self.script.bits(self.size)
        self._ghosts_seen = [bool(ghosts >> robot & 1) for robot in range(self.size)]

    def _delay(self) -> int | None:
        """Return in how many ticks a frame arrives: at once or never, or, in plays with delays, later."""
        return (0, 0, 0, None, *((1, 2, 3, LATEST) if self.delays else ()))[self.script.below(8 if self.delays else 4)]


plays = st.binary(min_size=600, max_size=2400)


def check_told(play: Play) -> None:
    """Check all that was told at the last tick."""
    stage = play.stage
    now, life = stage.now - TICK, from_seconds(LIFE_S)
    for robot, owner, number, length, seen_ms, tale in stage.told:
        seen = stage.last_sight.get((owner, number))
        assert seen is not None, f"robot {robot} promises a way to a goal that nobody has seen"
        assert seen_ms * MS <= seen, f"robot {robot} says that goal {owner} was seen later than it was"
        assert now - seen_ms * MS <= life + MS, f"robot {robot} tells of goal {owner} when the promise is dead"
        longest = max(telling.length_m for telling in tale.tellings)
        assert length >= longest - ROUNDING_M, f"a promise has become shorter on its way: {tale}"
        if not play.delays:
            assert math.dist(tale.goal, stage.goals[owner][number - 1]) < ROUNDING_M
        straight_m = math.dist(stage.places[robot], tale.goal)
        assert length >= straight_m - ROUNDING_M, f"{length} m is below the straight line: {tale}"


def check_taken(play: Play) -> int:
    """Check the promises that were taken at the last tick; return how many were based on what their takers had told."""
    own = 0
    stored = play.stage.parameters.comparison == "stored"  # a promise may be longer than what is left of another then
    for robot, tale, length, before in play.stage.taken:
        assert stored or before is None or length < before, f"robot {robot} has taken a longer way than it had: {tale}"
        earlier = [telling.length_m for telling in tale.tellings if telling.robot == robot]
        own += bool(earlier)
        assert all(length >= told - ROUNDING_M for told in earlier), f"robot {robot} deceives itself: {tale}"
    return own


class Books:
    """What the books said a tick ago."""

    def __init__(self, play: Play) -> None:
        self._play = play
        self._before = [[0] * play.size for _ in range(play.size)]

    def check(self) -> None:
        """Check that no robot has taken an older goal for a newer one, nor one more often handled for a better one."""
        stage = self._play.stage
        for robot, machine in enumerate(stage.machines):
            book = machine.book
            for owner in range(self._play.size):
                identifier = book.identifiers[owner]
                if owner == robot or not identifier:
                    assert owner == robot or not self._before[robot][owner], "a goal was forgotten"
                    continue
                assert identifier >= self._before[robot][owner]
                self._before[robot][owner] = identifier
                place = out_of_frame((book.x_m[owner], book.y_m[owner]), stage.frames[robot])
                if not self._play.delays:
                    assert math.dist(place, stage.goals[owner][book.number(owner) - 1]) < ROUNDING_M


def perform(data: bytes, delays: bool, **more: object) -> tuple[Play, int]:
    """Perform and check a play; return it, and how many promises were taken that their takers had a part in."""
    play, own = Play(data, delays, **more), 0
    books = Books(play)
    while not play.script.ended:
        play.tick()
        check_told(play)
        own += check_taken(play)
        books.check()
    return play, own


@pytest.mark.slow
@settings(max_examples=60)
@given(plays, st.booleans())
def test_no_promise_is_based_on_itself_below_the_straight_line_or_told_when_it_is_dead(
    data: bytes, delays: bool
) -> None:
    perform(data, delays)


@pytest.mark.slow
@settings(max_examples=8)
@given(plays, st.booleans())
def test_nor_if_promises_are_compared_with_the_stored_length(data: bytes, delays: bool) -> None:
    perform(data, delays, comparison="stored", hidden_helper="followed")


@pytest.mark.slow
@settings(max_examples=30)
@given(plays, st.booleans())
def test_when_nobody_sees_a_goal_or_moves_any_more_no_way_shrinks_and_none_outlives_its_promise(
    data: bytes, delays: bool
) -> None:
    """Everybody sees everybody, and every frame arrives: what could circulate would."""
    play, _ = perform(data, delays)
    play.close_eyes()
    for _ in range(LATEST):
        play.tick(moving=False)
        check_told(play)
    shortest: dict[tuple[int, int], float] = {}
    for _ in range(math.ceil(LIFE_S * 1e9 / TICK) + 1):
        play.tick(moving=False)
        check_told(play)
        lengths: dict[tuple[int, int], float] = {}
        for _, owner, number, length, *_ in play.stage.told:
            lengths[owner, number] = min(length, lengths.get((owner, number), math.inf))
        for goal, length in lengths.items():
            assert length >= shortest.get(goal, 0.0) - ROUNDING_M
        shortest = lengths
    assert play.stage.told == []
    assert all(way is None for machine in play.stage.machines for way in machine.ways.of)


@pytest.mark.soak
@pytest.mark.parametrize("part", range(2))
def test_no_relay_loop_in_two_thousand_plays(part: int, record_property: Callable[[str, object], None]) -> None:
    count, own, told = soak_count(1000), 0, 0
    for number in range(count):
        data = np.random.default_rng((46, part, number)).bytes(2400)
        play, more = perform(data, delays=number % 2 == 1)
        own += more
        told += len(play.stage.taken)
    record_property("plays of goal reflection", count)
    record_property("promises taken that their takers had a part in", own)


@pytest.mark.slow
def test_plays_are_about_what_they_are_meant_to_be_about() -> None:
    """Promises do come back to robots that they are based on, goals change, long rows of robots hand promises on."""
    own, deepest, numbers = 0, 0, set()
    for number in range(20):
        data = np.random.default_rng((47, number)).bytes(2400)
        play, more = perform(data, delays=number % 2 == 1)
        own += more
        deepest = max([deepest, *(len(tale.tellings) for _, tale, *_ in play.stage.history)])
        numbers |= {goal for _, goal in play.stage.last_sight}
    assert own >= 10
    assert deepest >= 4
    assert numbers >= {1, 2, 3, 4}


# ---------------------------------------------------------------- transforms


spots = st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))
poses = st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(-math.pi, math.pi))
HOP_M = 2.5e-5
"""What a hop costs by rounding to single floats: 0.12 urad over at most 128 m, and twice 3.8 um."""


@settings(max_examples=60)
@given(st.lists(st.tuples(spots, poses), min_size=2, max_size=10), spots, st.integers(1, 3))
def test_a_goal_that_bytes_carry_along_a_chain_of_machines_is_at_its_place_in_every_frame(
    chain: list[tuple[tuple[float, float], tuple[float, float, float]]], goal: tuple[float, float], number: int
) -> None:
    """Each machine sees only its neighbours; the owner's last goal is told."""
    places, frames = [place for place, _ in chain], [frame for _, frame in chain]
    assume(all(math.dist(one, other) > 0.1 for one, other in pairwise(places)))
    assume(math.dist(goal, places[0]) > 0.5)
    goals = [places[0]] * (number - 1) + [goal]  # all but the last are reached at once, one a tick
    stage, size = Stage(places, frames, [goals]), len(chain)
    sees = [[other for other in (robot - 1, robot + 1) if 0 <= other < size] for robot in range(size)]
    for _ in range(number + size):
        stage.tick(sees, [0] * size, [False] * size, [0] * size)
    for robot, machine in enumerate(stage.machines):
        book = machine.book
        assert (book.number(0), book.identifiers[0]) == (number, number * size - max(robot - 1, 0))
        there = into_frame(goal, frames[robot])
        assert math.dist((book.x_m[0], book.y_m[0]), there) <= robot * HOP_M
