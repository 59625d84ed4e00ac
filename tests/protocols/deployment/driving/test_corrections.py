"""Robots whose places are corrected while they drive: corrections, and errors of odometry, are nobody's motion."""

import itertools
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.geometry.segments import packed_walls
from cosim.navigation.localization.motion import Pose
from cosim.observation import Observation, Sighting
from cosim.randomness import Streams
from cosim.robots.senses import WORLD_FRAME, Senses, SenseSettings
from protocols.localization.positioning import shifted
from protocols.localization.scan import Scan, Sensor
from protocols.motion.driver import Driver
from protocols.motion.floor import Floor
from protocols.motion.frames import Located, Shift, start, step
from protocols.motion.parameters import DrivingParameters
from protocols.motion.traffic import Other, Traffic
from tests.protocols.deployment.driving_scene import SIGHT_M, TICK, Scene, body, box, line
from tests.protocols.localization.positioning_scene import DRIFT, told
from tests.tiers import two_tiers

BEAMS = 60
WALLS = [*box(8.0, 8.0), *line((3.0, 4.0), (3.5, 4.0)), *line((4.5, 4.0), (5.0, 4.0))]
CORNERS = [(1.2, 1.2), (6.8, 1.2), (6.8, 6.8), (1.2, 6.8)]
SPEEDS_MPS = (0.5, 0.5, 0.95, 0.6)
ERROR_M, ERROR_RAD, KEPT = 0.03, 0.02, 0.7
"""How far off places are, and how much of that is left a tick later."""

POSES = st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.floats(-3, 3))


class Corrected(Scene):
    """Robots at the corners of a hall whose odometry drifts, and whose places are the truth but for errors that change.

    It stands for a filter that corrects them at every tick, and is worse.
    """

    def __init__(self, seed: int, drift: dict[str, float]) -> None:
        self.draw = np.random.default_rng(seed)
        bodies = [body(radius_m=0.3, speed_mps=speed, acceleration_mps2=0.3) for speed in SPEEDS_MPS]
        super().__init__(WALLS, CORNERS, bodies, headings=self.draw.uniform(-3, 3, 4).tolist())
        scanner = SenseSettings.model_validate({"beams": BEAMS, "beam_range_m": 8.0, **drift})
        frames = [WORLD_FRAME] * 4
        self.sensed = Senses(scanner, packed_walls(self.grid), self.radii, frames, SIGHT_M, TICK, Streams(seed))
        self.senses = SimpleNamespace(observe=self.corrected)  # type: ignore[assignment]
        self.believed: list[Located] = []
        self.errors = np.zeros((4, 3))

    def corrected(self, fleet: Any) -> list[Located]:
        self.errors = KEPT * self.errors + self.draw.uniform(-1.0, 1.0, (4, 3)) * (ERROR_M, ERROR_M, ERROR_RAD)
        truth = fleet.observed[:, :3] + self.errors
        self.believed = []
        for seen, pose in zip(self.sensed.observe(fleet), truth.tolist(), strict=True):
            assert seen.view is not None
            there = shifted(seen, Shift.between(seen[:3], tuple(pose)), Scan(seen.view, Sensor(BEAMS), None))
            self.believed.append(Located.of(there, seen[:3]))
        return self.believed

    def told(self, me: int) -> Other:
        x_m, y_m, heading_rad = self.believed[me][:3]
        return super().told(me)._replace(x_m=x_m, y_m=y_m, heading_rad=heading_rad)

    def cross(self, rounds: int, seconds: float) -> None:
        """Send all to a corner that another leaves, again and again."""
        for _ in range(rounds):
            for mover, corner in zip(self.movers, self.draw.permutation(4).tolist(), strict=True):
                mover.go(CORNERS[corner])
            self.run(seconds, self.all_there)


def turned(vector: Any, angle: float) -> Any:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]])


@pytest.mark.slow
def test_all_know_how_they_and_those_in_sight_have_moved() -> None:
    """To the rounding: what they take for motion is that of the bodies, though places and odometry are wrong."""
    scene = Corrected(1, DRIFT)
    for mover, corner in zip(scene.movers, (2, 3, 0, 1), strict=True):
        mover.go(CORNERS[corner])
    compared, moving = 0, 0
    for _ in range(60):
        before = scene.fleet.positions_m.copy()
        scene.tick()
        gone = scene.fleet.positions_m - before
        for me, mover in enumerate(scene.movers):
            wrong_rad = scene.believed[me].heading_rad - float(scene.fleet.observed[me, 2])
            own, traffic = mover._driver.motion[-2:], mover._traffic
            if scene.now > TICK:
                np.testing.assert_allclose(turned(own, -wrong_rad), gone[me], rtol=0, atol=1e-9)
            for other in set(range(4)) - {me}:
                track = traffic.of(other)
                if track is None or track.seen != scene.now - TICK or track.gone_m is None:
                    continue
                np.testing.assert_allclose(turned(track.gone_m, -wrong_rad), gone[other], rtol=0, atol=1e-9)
                compared, moving = compared + 1, moving + (np.hypot(*gone[other]) > 0.02)
    assert compared > 600
    assert moving > 300


@pytest.mark.slow
@pytest.mark.parametrize("seed", two_tiers(range(6), 2))
def test_robots_whose_places_are_corrected_all_the_time_do_not_touch(seed: int) -> None:
    scene = Corrected(seed, DRIFT)
    scene.cross(3, 40.0)
    assert not scene.touched
    assert scene.least_gap_m > 0.0


# ---------------------------------------------------------------- one robot


def driver() -> Driver:
    floor = Floor(np.array(box(8.0, 8.0)), (0.0, 0.0, 8.0, 8.0), None, DrivingParameters())
    return Driver(floor, 0.3, 0.5, 0.5, DrivingParameters(), TICK)


def located(pose: Pose, odometry: Pose, *others: Sighting, blocked: bool = False) -> Located:
    return Located.of(told(pose, *others)._replace(speed_mps=0.0, blocked=blocked), odometry)


@settings(max_examples=40)
@given(POSES, POSES)
def test_a_step_leads_from_where_it_starts_to_where_it_ends(before: Pose, after: Pose) -> None:
    gone = step(before, after)
    assert start(after, gone)[:2] == pytest.approx(before[:2], abs=1e-9)
    assert math.hypot(*gone[:2]) == pytest.approx(math.dist(before[:2], after[:2]), abs=1e-9)


@settings(max_examples=30)
@given(POSES, POSES)
def test_nobody_who_stands_moves_by_a_correction(first: Pose, then: Pose) -> None:
    """Neither the robot nor whom it sees, who has stood there all the while."""
    driving, traffic = driver(), Traffic(0, 0.3, 0.005, 0.1)
    driving.order(0.0, 0.0)
    for tick, pose in enumerate((first, then, first, then)):
        there = Shift.between((0.0, 0.0, 0.0), pose).point(2.0, 1.0)
        seen = located(pose, (0.0, 0.0, 0.0), Sighting(1, *there))
        driving.follow(seen, tick * TICK)
        driving.order(0.0, 0.0)
        traffic.look(seen, [], tick * TICK, driving.carried)
        assert np.hypot(*driving.motion[-2:]) < 1e-9
        assert driving.here == pose[:2]
    track = traffic.of(1)
    assert track is not None
    assert track.gone_m == pytest.approx((0.0, 0.0), abs=1e-9)
    assert track.place_m == pytest.approx(there)
    assert track.still_s(3 * TICK) == pytest.approx(0.3)


def driven(odometry: Pose, blocked: bool = False) -> Any:
    """Return how a robot has moved, as it takes it, that was told to turn left, and what odometry says of it."""
    driving = driver()
    for tick in range(3):
        driving.follow(located((1.0, 1.0, 0.0), (0.0, 0.0, 0.0)), tick * TICK)
        driving.order(0.0, 0.12 if tick == 1 else 0.0)
    driving.follow(located((1.0, 1.0, 0.0), odometry, blocked=blocked), 3 * TICK)
    assert driving.carried is not None
    return driving.carried.turned_rad


def test_odometry_is_believed_where_it_is_far_from_what_was_commanded_or_the_robot_was_held() -> None:
    """All that it saw seems to have turned as much against its heading, which was told the same."""
    assert driven((0.0, 0.0, 0.02)) == pytest.approx(-0.04)  # as fast as it may: 4 rad/s2
    assert driven((0.0, 0.0, 0.02), blocked=True) == pytest.approx(-0.02)
    assert driven((0.0, 0.0, 0.9)) == pytest.approx(-0.9)


# ---------------------------------------------------------------- who is where


def test_whom_a_robot_sees_is_where_it_is_seen_whatever_it_says() -> None:
    """What another says of its place is in error by both robots' errors; what is seen of it, by none."""
    traffic = Traffic(0, 0.3, 0.005, 0.1)
    says = Other(1, 5.0, 5.0, 0.3, 0.5, 0.0)
    for tick in range(2):
        seen = located((1.0, 1.0, 0.0), (0.0, 0.0, 0.0), Sighting(1, 3.0, 1.0))
        traffic.look(seen, [says], tick * TICK, Shift() if tick else None)
    ((x, y, gone_x, gone_y, *_),) = traffic.bodies().tolist()
    assert (x, y, gone_x, gone_y) == pytest.approx((3.0, 1.0, 0.0, 0.0))


def test_what_is_located_is_the_observation_itself() -> None:
    seen: Observation = told((1.0, 2.0, 0.3), Sighting(2, 4.0, 4.0))
    found = Located.of(seen, (0.0, 0.1, 0.2))
    assert found == seen
    assert found.odometry == (0.0, 0.1, 0.2)
    assert list(itertools.islice(found, 3)) == [1.0, 2.0, 0.3]
