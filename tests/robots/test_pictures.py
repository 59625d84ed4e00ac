"""Pictures and scans that are asked for at once, late, by some robots or by none: against a plain model of all pairs.

The model goes through all robots and all walls for each question, in complex numbers, and knows no cells.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from cosim.arrays import Floats
from cosim.geometry.segments import packed_walls, segment_grid
from cosim.machine import Drive
from cosim.observation import Observation
from cosim.randomness import Streams
from cosim.robots.body import BodySettings
from cosim.robots.motion import Fleet
from cosim.robots.senses import Senses, SenseSettings
from cosim.units import MS

TICK = 100 * MS
TICKS = 7
RADII_M = 0.1, 0.3
BEAMS = 36


class Truth(NamedTuple):
    """Where robots are at one tick, and whose cameras are off."""

    places: list[complex]
    headings: list[float]
    blind: frozenset[int]


class Scene:
    """Robots of two sizes that drive about among walls, drawn from a seed."""

    def __init__(self, seed: int, **settings: Any) -> None:
        draw = self.draw = np.random.default_rng(seed)
        self.count = int(draw.choice([2, 7, 40]))
        side = float(draw.choice([4.0, 12.0, 25.0]))
        ends = draw.uniform(0, side, (int(draw.choice([0, 3, 25])), 2))
        self.walls: Floats = np.hstack((ends, ends + draw.uniform(-2, 2, ends.shape)))
        self.radii = [float(radius) for radius in draw.choice(RADII_M, self.count)]
        self.range_m = float(draw.choice([1.5, 6.0, math.inf]))
        self.frames = [(*draw.uniform(-5, 5, 2).tolist(), float(draw.uniform(-3, 3))) for _ in self.radii]
        self.settings = SenseSettings(
            frames="own",
            beams=BEAMS,
            beam_range_m=float(draw.choice([0.5, 3.0])),
            field_of_view_deg=float(draw.choice([70.0, 360.0])),
            bodies_occlude=bool(draw.random() < 0.5),
            camera_period_s=[None, 0.3][draw.integers(2)],
            **settings,
        )
        grid = segment_grid(self.walls)
        starts, headings = draw.uniform(0, side, (self.count, 2)), draw.uniform(-3, 3, self.count)
        bodies = [BodySettings(radius_m=radius, drive="omni") for radius in self.radii]
        self.fleet = Fleet(bodies, starts, grid, TICK, headings_rad=headings)
        walls = packed_walls(grid)
        self.senses = Senses(self.settings, walls, self.radii, self.frames, self.range_m, TICK, Streams(seed))
        self.blind: set[int] = set()

    def truth(self) -> Truth:
        places = [complex(x, y) for x, y in self.fleet.positions_m.tolist()]
        return Truth(places, self.fleet.observed[:, 2].tolist(), frozenset(self.blind))

    def move(self) -> None:
        orders = [(robot, Drive(*self.draw.uniform(-0.5, 0.5, 2).tolist())) for robot in range(self.count)]
        self.fleet.apply(orders)
        self.fleet.step()

    def switch(self) -> None:
        """Switch a camera on or off, between two ticks."""
        robot = int(self.draw.integers(self.count))
        self.blind ^= {robot}
        self.senses.blind(robot, robot in self.blind)

    # ------------------------------------------------------------ the model

    def sees(self, truth: Truth, robot: int, point: complex, but: int) -> bool:
        """Return whether *robot* sees a point, with all other bodies but one in the way if they hide anything."""
        here, way = truth.places[robot], point - truth.places[robot]
        aside = math.remainder(np.angle(way) - truth.headings[robot], math.tau)
        if (
            robot in truth.blind
            or abs(way) > self.range_m
            or abs(aside) > self.settings.field_of_view_deg * math.pi / 360
        ):
            return False
        if self.settings.bodies_occlude:
            for other, (place, radius) in enumerate(zip(truth.places, self.radii, strict=True)):
                part = min(max(((place - here) / way).real, 0.0), 1.0)
                if other not in (robot, but) and abs(place - here - part * way) < radius:
                    return False
        return not any(met(here, way, wall) < 1.0 for wall in self.walls)

    def seen(self, truth: Truth, robot: int) -> dict[int, tuple[float, float]]:
        """Return whom *robot* sees, and where in its own frame."""
        x, y, turn = self.frames[robot]
        return {
            other: ((place := (there - complex(x, y)) * np.exp(-1j * turn)).real, place.imag)
            for other, there in enumerate(truth.places)
            if other != robot and self.sees(truth, robot, there, other)
        }

    def ranges(self, truth: Truth, robot: int) -> list[float]:
        """Return how far each beam of *robot* goes."""
        here, reach = truth.places[robot], self.settings.beam_range_m
        found = []
        for k in range(BEAMS):
            way = reach * np.exp(1j * (self.frames[robot][2] + math.tau * k / BEAMS))
            parts = [met(here, way, wall) for wall in self.walls]
            for other, (place, radius) in enumerate(zip(truth.places, self.radii, strict=True)):
                along, off = ((place - here) / way).real * reach, ((place - here) / way).imag * reach
                if other != robot and along > 0.0 and abs(off) <= radius:
                    parts.append(max((along - math.sqrt(radius**2 - off**2)) / reach, 0.0))
            nearest = min(parts, default=math.inf)
            found.append(nearest * reach if nearest <= 1.0 else math.inf)
        return found


def met(here: complex, way: complex, wall: Floats) -> float:
    """Return at which part of the way from a place a wall is met, or inf."""
    one, two = ((complex(x, y) - here) / way for x, y in (wall[:2], wall[2:]))  # the way is from 0 to 1
    if one.imag * two.imag > 0.0:
        return math.inf
    part = one.real + (two.real - one.real) * one.imag / (one.imag - two.imag)
    return part if part >= 0.0 else math.inf


def look_about(scene: Scene, asks: bool) -> list[tuple[list[Observation], Truth, list[Truth]]]:
    """Return what is observed at each tick, the truth then, and of each robot the truth at its last picture."""
    seen: list[tuple[list[Observation], Truth, list[Truth]]] = []
    pictured: list[Truth] = []
    period = round((scene.settings.camera_period_s or 0.1) / 0.1)
    for tick in range(TICKS):
        if tick:
            if scene.draw.random() < 0.6:
                scene.switch()
                pictured = [truth._replace(blind=truth.blind | scene.blind) for truth in pictured]
            scene.move()
        observations, truth = scene.senses.observe(scene.fleet), scene.truth()
        if tick % period == 0:
            pictured = [truth] * scene.count
        seen.append((observations, truth, pictured))
        for robot, observation in enumerate(observations):
            what = scene.draw.integers(4) if asks else 0
            if what == 1:
                assert list(observation.visible) == list(scene.seen(pictured[robot], robot))
            if what == 2:
                check_picture(scene, observation, pictured[robot], robot)
            if asks and scene.draw.random() < 0.8:
                assert observation.ranges_m.tolist() == pytest.approx(scene.ranges(truth, robot), abs=1e-9)
                assert observation.ranges_m.tolist() == pytest.approx(scene.ranges(truth, robot), abs=1e-9)
    return seen


def check_picture(scene: Scene, observation: Observation, pictured: Truth, robot: int) -> None:
    expected = scene.seen(pictured, robot)
    assert observation.visible == tuple(expected)
    assert tuple(each.address for each in observation.sightings) == tuple(expected)
    places = [place for _, *xy in observation.sightings for place in xy]
    assert places == pytest.approx([each for xy in expected.values() for each in xy], abs=1e-9)
    x, y, reach_m = observation.x_m + 0.5, observation.y_m - 0.3, 2.0
    near = [other for other, place in expected.items() if math.dist(place, (x, y)) < reach_m]
    around = observation.picture.around(x, y, reach_m)
    assert [each.address for each in around] == near
    assert set(around) <= set(observation.sightings)


@pytest.mark.parametrize("seed", range(16))
def test_what_is_asked_now_and_then_is_what_a_plain_model_says(seed: int) -> None:
    scene = Scene(seed)
    seen = look_about(scene, asks=True)
    for tick in scene.draw.permutation(TICKS):  # nobody has asked for some of them, and all that was there has moved
        observations, _, pictured = seen[tick]
        for robot in scene.draw.permutation(scene.count)[:12].tolist():
            check_picture(scene, observations[robot], pictured[robot], robot)


@pytest.mark.parametrize("seed", range(6))
def test_what_is_asked_never_or_late_changes_nothing(seed: int) -> None:
    noisy = {"distance_error": 0.2, "bearing_error": 1.0, "range_noise_m": 0.02, "odometry_slip": 0.1}
    asked, late = Scene(seed, **noisy), Scene(seed, **noisy)
    every: list[Any] = []
    for tick in range(TICKS):
        for scene in (asked, late):
            if tick:
                scene.move()
        at_once, later = asked.senses.observe(asked.fleet), late.senses.observe(late.fleet)
        every += zip([(one.visible, one.sightings, one.ranges_m.tolist()) for one in at_once], later, strict=True)
        if tick in (2, 3, 5):
            assert [one[2] for one, _ in every[-asked.count :]] == [other.ranges_m.tolist() for other in later]
    for (visible, sightings, _), other in every:
        assert (other.visible, other.sightings) == (visible, sightings)


@pytest.mark.parametrize("seed", range(24))
def test_who_is_near_is_seen_alike_before_all_are_looked_for(seed: int) -> None:
    scene, other = (Scene(seed, distance_error=[0.0, 0.4][seed % 2], bearing_error=1.0) for _ in range(2))
    seen = [one.sightings for one in other.senses.observe(other.fleet)]
    found = 0
    observations = scene.senses.observe(scene.fleet)
    for reach_m in (1.0, 3.0, 2.0):
        for one, sightings in zip(observations, seen, strict=True):
            for x, y in ((one.x_m, one.y_m), (one.x_m + 1.5, one.y_m - 2.3)):
                around = list(one.picture.around(x, y, reach_m))
                assert around == [each for each in sightings if math.dist(each[1:], (x, y)) < reach_m]
                found += len(around)
    assert found or scene.count < 40


def test_of_many_in_sight_none_is_left_out() -> None:
    """More than there is room for at first."""
    places = [(0.5 * (k % 12), 0.5 * (k // 12)) for k in range(144)]
    grid = segment_grid(np.empty((0, 4)))
    fleet = Fleet([BodySettings()] * 144, places, grid, TICK)
    frames = [(0.0, 0.0, 0.0)] * 144
    senses = Senses(SenseSettings(), packed_walls(grid), [0.2] * 144, frames, math.inf, TICK, Streams(1))
    for robot, observation in enumerate(senses.observe(fleet)):
        assert observation.sightings == tuple((k, *place) for k, place in enumerate(places) if k != robot)
