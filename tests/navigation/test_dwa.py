"""The law of the dynamic window: who obeys it can always stop, alone or among others who do, and with real bodies.

The bodies are those of the simulator, whose own drive and contacts are the judge: nobody is ever stopped by a touch.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.geometry.segments import segment_grid, swept_clearance
from cosim.machine import Drive
from cosim.navigation.dwa import (
    BODY_COLUMNS,
    OWN,
    STATE,
    braking_way,
    choose,
    chord,
    nearest_points,
    stopping_m,
    towards,
    unknown_points,
    unseen_gap,
    walls_near,
)
from cosim.robots.body import BodySettings
from cosim.robots.motion import Fleet
from cosim.robots.motion import braking_way as drive_braking_way
from cosim.robots.motion import chord as drive_chord
from cosim.robots.motion import towards as drive_towards
from cosim.units import MS
from tests.tiers import soak_count

TICK = 100 * MS
LONG = settings(max_examples=soak_count(200))
T = 0.1
ROOM = np.array([(0, 0, 6, 0), (6, 0, 6, 6), (6, 6, 0, 6), (0, 6, 0, 0), (2, 2, 4, 2.5), (3, 4, 3, 6)], float)
MARGIN = 0.02


def row(body, stray=0.04, arc=0.0):
    """Return what DWA is told of a body; *arc*: the metres up to which the article's own terms look, or 0."""
    own = np.empty(OWN)
    own[:] = (
        body.radius_m,
        body.speed_mps * T,
        body.acceleration_mps2 * T * T,
        body.turn_radps * T,
        body.turn_acceleration_radps2 * T * T,
        MARGIN,
        stray,
        0.3,
        2.0,
        0.2,
        0.2,
        arc,
    )
    return own


class Drivers:
    """Bodies that all obey DWA, and aim where they are told; each knows the others as its camera shows them."""

    def __init__(self, bodies, starts, walls=ROOM, headings=0.0, stray=0.04, arc=0.0):
        self.bodies = bodies
        self.grid = segment_grid(walls)
        self.fleet = Fleet(bodies, starts, self.grid, TICK, headings_rad=headings)
        self.own = [row(body, stray, arc) for body in bodies]
        self.wanted = np.zeros((len(bodies), 2))
        self.state = np.zeros((len(bodies), STATE))
        self.state[:, :2], self.state[:, 2] = starts, headings
        self.deaf = set()

    def tick(self, aims, most=None):
        for i, (way, turn) in enumerate(self.wanted):
            self.fleet.apply([(i, Drive(way / T, turn / T))])
        self.fleet.step()
        rows = self.fleet.observed
        assert not rows[:, 5].any(), f"touched: {rows[:, 5]}"
        for i in range(len(self.bodies)):
            x, y, heading, speed = rows[i, :4]
            own, last = self.own[i], self.state[i].copy()
            way = towards(self.wanted[i, 0], speed * T, own[2])
            turn = towards(self.wanted[i, 1], last[4], own[4])
            self.state[i] = x, y, heading, way, turn, x - last[0], y - last[1]
        table = np.empty((len(self.bodies), BODY_COLUMNS))
        for i, body in enumerate(self.bodies):
            table[i] = *self.state[i, :2], *self.state[i, 5:7], body.radius_m, self.own[i][2]
        for i, aim in enumerate(aims):
            if i in self.deaf:
                self.wanted[i] = 0.0, 0.0
                continue
            walls = walls_near(self.grid, *self.state[i, :2], 3.0)
            others = np.delete(table, i, axis=0)
            limit = self.own[i][1] if most is None else most
            way, turn, _ = choose(self.own[i], self.state[i], walls, np.empty((0, 2)), others, *aim, limit)
            self.wanted[i] = way, turn

    def gap(self):
        places, radii = self.fleet.positions_m, [body.radius_m for body in self.bodies]
        return min(math.dist(places[i], places[j]) - radii[i] - radii[j] for i in range(len(radii)) for j in range(i))


def differential(**limits):
    return BodySettings(drive="differential", **limits)


bodies = st.builds(
    differential,
    radius_m=st.floats(0.1, 0.3),
    speed_mps=st.floats(0.2, 1.5),
    acceleration_mps2=st.floats(0.3, 3.0),
    turn_radps=st.floats(0.5, 3.0),
    turn_acceleration_radps2=st.floats(1.0, 8.0),
)
places = st.tuples(st.floats(-1, 7), st.floats(-1, 7))


@given(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(1e-3, 0.1), st.floats(-3, 3))
def test_the_arithmetic_is_that_of_the_drive(wanted, last, change, heading):
    assert towards(wanted, last, change) == drive_towards(wanted, last, change)
    assert chord(heading, wanted, last) == drive_chord(heading, wanted, last)
    if wanted > 0.0:
        assert braking_way(wanted, change) == drive_braking_way(wanted, change)
        assert stopping_m(braking_way(wanted, change), change) == pytest.approx(wanted, abs=1e-9)


@pytest.mark.slow
@settings(max_examples=30)
@given(bodies, st.floats(-3, 3), st.lists(places, min_size=40, max_size=40))
def test_one_robot_touches_no_wall_whatever_it_aims_at(body, heading, aims):
    scene = Drivers([body], [(1.0, 1.0)], headings=heading)
    for aim in aims:
        for _ in range(3):
            scene.tick([aim])
            assert swept_clearance(scene.grid, scene.state[:, :2], scene.state[:, :2], 1.0)[0] >= body.radius_m


@pytest.mark.slow
@pytest.mark.parametrize("arc", [0.0, 1.0], ids=["ours", "fox"])
@settings(max_examples=60)
@given(
    body=bodies, heading=st.floats(-3, 3), aims=st.lists(places, min_size=12, max_size=12), moment=st.integers(1, 35)
)
def test_who_dies_at_any_moment_stops_without_a_touch(arc, body, heading, aims, moment):
    scene = Drivers([body], [(1.0, 1.0)], headings=heading, arc=arc)
    for tick in range(moment):
        scene.tick([aims[tick // 3]])
    scene.fleet.freeze(0, True)
    for _ in range(80):
        scene.fleet.step()
        assert not scene.fleet.observed[0, 5]
    assert scene.fleet.rests(0)


def test_straight_at_a_wall_it_stops_a_margin_short_of_it_and_uses_the_room():
    body = differential()
    scene = Drivers([body], [(0.5, 1.0)])
    for _ in range(200):
        scene.tick([(20.0, 1.0)])
    assert 6.0 - 0.2 - MARGIN - 0.01 <= scene.state[0, 0] <= 6.0 - 0.2 - MARGIN + 1e-6
    assert scene.state[0, 3] == 0.0


@given(st.floats(0.3, 1.5), st.floats(0.3, 2.0), st.floats(0.25, 2.0))
def test_the_textbooks_law_holds_on_a_straight_way(speed, acceleration, room):
    """v dt + v^2 / (2 a) <= free distance: with ticks of T the stop is v T / 2 longer, which counts here."""
    body = differential(speed_mps=speed, acceleration_mps2=acceleration)
    scene = Drivers([body], [(6.0 - 0.2 - room, 1.0)])
    for _ in range(60):
        scene.tick([(20.0, 1.0)])
        x, way = scene.state[0, 0], scene.state[0, 3]
        free = 6.0 - 0.2 - x - way
        chosen = scene.wanted[0, 0] / T
        assert chosen * T / 2 + chosen**2 / (2 * acceleration) <= free + 1e-6


def two_robots_never_touch(one, other, heading, aims):
    scene = Drivers([one, other], [(1.0, 1.0), (4.9, 1.0)], headings=[heading, heading + 3.0])
    for aim in aims:
        for _ in range(5):
            scene.tick(aim)
            assert scene.gap() >= -1e-9


def head_on_both_stop_short(one, other, aside):
    scene = Drivers([one, other], [(0.5, 1.0), (5.5, 1.0 + aside)], headings=[0.0, math.pi])
    for _ in range(200):
        scene.tick([(5.5, 1.0), (0.5, 1.0)])
        assert scene.gap() > 0.0


def one_that_dies_is_not_touched(one, other, moment, aims):
    scene = Drivers([one, other], [(1.0, 1.0), (4.9, 1.0)], headings=[0.0, 3.0])
    for tick in range(15 * 8):
        if tick == moment:
            scene.deaf.add(1)
        scene.tick(aims[tick // 8])
        assert scene.gap() >= -1e-9


def four_in_a_throng_never_touch(team, aims):
    scene = Drivers(team, [(1.0, 1.0), (5.0, 1.0), (1.0, 5.0), (5.0, 5.0)], headings=[0.7, 2.3, -0.7, -2.3])
    for aim in aims:
        for _ in range(6):
            scene.tick(aim)
            assert scene.gap() >= -1e-9


AIMS = st.lists(st.tuples(places, places), min_size=25, max_size=25)
FEW_AIMS = st.lists(st.tuples(places, places), min_size=15, max_size=15)
THRONG = st.lists(st.lists(places, min_size=4, max_size=4), min_size=15, max_size=15)
CASES = {
    two_robots_never_touch: (40, given(bodies, bodies, st.floats(-3, 3), AIMS)),
    head_on_both_stop_short: (20, given(bodies, bodies, st.floats(-0.3, 0.3))),
    one_that_dies_is_not_touched: (30, given(bodies, bodies, st.integers(0, 60), FEW_AIMS)),
    four_in_a_throng_never_touch: (15, given(st.lists(bodies, min_size=4, max_size=4), THRONG)),
}


@pytest.mark.slow
@pytest.mark.parametrize("law", CASES, ids=lambda law: law.__name__)
def test_among_others(law):
    examples, cases = CASES[law]
    settings(max_examples=examples)(cases(law))()


@pytest.mark.soak
@pytest.mark.parametrize("law", CASES, ids=lambda law: law.__name__)
def test_among_others_soak(law):
    LONG(CASES[law][1](law))()


def is_a_way(segment: tuple[float, ...]) -> bool:
    """Return whether a robot stands or goes at least a micrometre: less is lost in rounding, and may miss by 1e-7 m."""
    length = math.dist(segment[:2], segment[2:])
    return length == 0.0 or length >= 1e-6


segments = st.tuples(*[st.floats(-2, 2)] * 4).filter(is_a_way)


@given(segments, segments)
def test_two_robots_find_the_same_points_between_them(one, other):
    a = nearest_points(*one, *other)
    b = nearest_points(*other, *one)
    brute = min(
        math.hypot(
            one[0] + s * (one[2] - one[0]) - other[0] - u * (other[2] - other[0]),
            one[1] + s * (one[3] - one[1]) - other[1] - u * (other[3] - other[1]),
        )
        for s in np.linspace(0, 1, 41)
        for u in np.linspace(0, 1, 41)
    )
    found = math.hypot(a[2] - a[0], a[3] - a[1])
    assert found == pytest.approx(math.hypot(b[2] - b[0], b[3] - b[1]), abs=1e-9)
    assert brute - 0.2 <= found <= brute + 1e-9


def test_what_the_scan_meets_is_known_or_not():
    walls = np.array([(2.0, -5.0, 2.0, 5.0)])
    others = np.array([(0.0, 3.0, 0.0, 0.0, 0.3, 0.01)])
    ranges = np.array([2.05, 2.72, 1.5, math.inf])  # a wall, a body, something, nothing
    found = unknown_points(walls, others, 0.0, 0.0, ranges, 3.0, 0.1)
    assert found == pytest.approx(np.array([(-1.5, 0.0)]))
    assert len(unknown_points(walls, others, 0.0, 0.0, ranges, 1.0, 0.1)) == 0


def test_an_unknown_thing_is_stopped_for():
    own, state = row(differential()), np.array([1.0, 1.0, 0.0, 0.05, 0.0, 0.05, 0.0])
    nothing = np.empty((0, 4)), np.empty((0, 2)), np.empty((0, BODY_COLUMNS))
    free = choose(own, state, *nothing, 5.0, 1.0, 0.05)
    held = choose(own, state, nothing[0], np.array([(1.40, 1.0)]), nothing[2], 5.0, 1.0, 0.05)
    assert free == (0.05, 0.0, True)
    assert held[0] <= 0.045


def test_who_could_come_round_a_corner_is_unseen():
    corner = np.array([(2.0, 0.0, 2.0, -3.0), (2.0, 0.0, 5.0, 0.0)])
    assert unseen_gap(corner, 0.0, -0.1, 0.0) == pytest.approx(math.hypot(2.0, 0.1))
    assert unseen_gap(corner, 0.0, -0.1, math.pi) == math.inf  # behind it
    inner = np.array([(2.0, 0.0, 2.0, -3.0), (2.0, 0.0, -5.0, 0.0)])
    assert unseen_gap(inner, 0.0, -1.0, 0.0) == pytest.approx(math.hypot(2.0, 2.0))  # only the far end of that wall
    row_of_two = np.array([(2.0, -3.0, 2.0, 0.0), (2.0, 0.0, 2.0, 3.0)])
    assert unseen_gap(row_of_two, 0.0, 0.0, 0.0) == pytest.approx(math.hypot(2.0, 3.0))
    jamb = np.array([(0.0, 1.0, 4.0, 1.0), (2.0, 1.0, 2.0, 0.5)])
    assert unseen_gap(jamb, 0.5, 0.0, 0.0) == pytest.approx(math.hypot(1.5, 0.5))


@given(st.floats(-4, 10), st.floats(-4, 10), st.floats(0, 4))
def test_walls_that_are_near_are_found_once(x, y, reach):
    grid = segment_grid(ROOM)
    found = walls_near(grid, x, y, reach).tolist()
    near = [
        wall
        for wall in ROOM.tolist()
        if float(swept_clearance(segment_grid([wall]), [(x, y)], [(x, y)], 100.0)[0]) <= reach - 1e-9
    ]
    assert len(found) == len({tuple(wall) for wall in found})
    assert all(wall in found for wall in near)
