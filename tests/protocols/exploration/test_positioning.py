"""Where robots take themselves to be, and how fast a filter lets them go for that."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from cosim.arrays import Floats
from cosim.geometry.segments import clearance
from cosim.machine import Drive, Event
from cosim.navigation.schemas import beam_directions
from cosim.observation import Observation, Seen, Sighting
from cosim.protocol import Surroundings
from cosim.testing import check_machine
from cosim.units import MS, S
from protocols.exploration.explorer import Explorer
from protocols.exploration.parameters import Parameters, PositioningParameters, SpeedControlParameters
from protocols.exploration.positioning import (
    Filtered,
    Given,
    Localised,
    Position,
    Resumed,
    SpeedControl,
    Waiting,
    turned,
)
from protocols.exploration.setup import prepare
from protocols.exploration.spec import SPEC
from protocols.mapping.belief import Frame
from tests.navigation.slam_scene import CELL_M, ORIGIN_M, RANGE_M, ROOM, SHAPE, TWO_ROOMS, course, scan

TICK = 100 * MS
BEAMS = 180
DIRECTIONS = beam_directions(BEAMS)
FRAME = Frame(ORIGIN_M, CELL_M, SHAPE[1], SHAPE[0])
HERE = (0.8, 1.2)


class Scanned:
    """A view that shows some ranges."""

    def __init__(self, ranges_m: Floats) -> None:
        self._ranges_m = ranges_m

    def sees(self, points_m: Any) -> list[bool]:
        return [False] * len(points_m)

    def ranges_m(self) -> Floats:
        return self._ranges_m


def control(*told: Event, **own: float) -> tuple[SpeedControl, list[Event]]:
    events = list(told)
    parameters = SpeedControlParameters(**{"slow_m": 0.1, "stop_m": 0.3, "resume_m": 0.2, "creep": 0.25} | own)
    return SpeedControl(parameters, TICK, events.append), events


# ---------------------------------------------------------------- speed control


def test_speed_falls_linearly_with_the_spread_but_a_moving_robot_creeps_at_least() -> None:
    speed, events = control()
    shares = [speed.share(spread) for spread in (0.0, 0.1, 0.15, 0.2, 0.25, 0.29)]
    assert shares == pytest.approx([1.0, 1.0, 0.75, 0.5, 0.25, 0.25])
    assert events == []


def test_a_robot_waits_from_one_threshold_on_until_its_spread_is_below_another() -> None:
    speed, events = control()
    assert [speed.share(spread) for spread in (0.3, 0.25, 0.2)] == [0.0, 0.0, 0.0]
    assert speed.share(0.19) == pytest.approx(0.55)
    assert speed.share(0.29) == pytest.approx(0.25)  # below the threshold: it waits no more
    assert events == [Waiting(0.3), Resumed(0.19, "localised")]


def test_nobody_waits_for_ever() -> None:
    speed, events = control(wait_s=0.5, creep_s=0.3)
    shares = [speed.share(9.0) for _ in range(14)]
    assert shares == [0.0] * 5 + [0.25] * 4 + [0.0] * 5
    assert events == [Waiting(9.0), Resumed(9.0, "waited long enough"), Waiting(9.0)]


def test_who_creeps_on_and_is_localised_drives_as_fast_as_that_allows() -> None:
    speed, _ = control(wait_s=0.1, creep_s=1.0)
    assert [speed.share(spread) for spread in (9.0, 9.0, 0.15, 9.0)] == pytest.approx([0.0, 0.25, 0.75, 0.25])


@pytest.mark.parametrize("own", [{"slow_m": 0.3}, {"resume_m": 0.31}, {"creep": 0.0}])
def test_thresholds_out_of_order_are_refused(own: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        control(**own)


# ---------------------------------------------------------------- the place


def told(pose: tuple[float, float, float], *others: Sighting, ranges_m: Floats | None = None) -> Observation:
    ranges_m = np.full(BEAMS, np.inf) if ranges_m is None else ranges_m
    picture = Seen(tuple(each.address for each in others), others)
    return Observation(*pose, 0.3, True, False, picture, Scanned(ranges_m))


def filtered(events: list[Event], seed: int = 1, **own: Any) -> Filtered:
    parameters = PositioningParameters.model_validate({"kind": "slam", **own})
    return Filtered(parameters, FRAME, RANGE_M, (0.2, 0.3), TICK, np.random.default_rng(seed), events.append)


def drifting(poses: list[tuple[float, float, float]], rad_per_step: float) -> list[tuple[float, float, float]]:
    """Return what odometry tells on a way that it takes for a bend: from the true first pose on."""
    found = [poses[0]]
    for step, (before, now) in enumerate(itertools.pairwise(poses), 1):
        turn = step * rad_per_step
        dx, dy = now[0] - before[0], now[1] - before[1]
        x, y, _ = found[-1]
        found.append(
            (
                x + math.cos(turn) * dx - math.sin(turn) * dy,
                y + math.sin(turn) * dx + math.cos(turn) * dy,
                now[2] + turn,
            )
        )
    return found


def test_what_is_given_is_taken_as_it_is() -> None:
    observation = told((1.0, 2.0, 0.3))
    position = Given().locate(observation, observation.ranges_m, DIRECTIONS)
    assert position.observation is observation
    assert (position.turned_rad, position.share) == (0.0, 1.0)


def test_with_a_filter_all_that_is_seen_lies_in_the_frame_of_the_map() -> None:
    poses = course([(0.9, 1.3), (4.2, 1.4), (7.2, 1.2)])
    filter_ = filtered([], control={"enabled": False})
    for pose, odometry in zip(poses, drifting(poses, 0.01), strict=True):
        ranges = scan(TWO_ROOMS, pose, odometry[2])
        ahead = 0.7 * np.array([math.cos(odometry[2] + 0.5), math.sin(odometry[2] + 0.5)])
        other = Sighting(1, odometry[0] + ahead[0], odometry[1] + ahead[1])
        position = filter_.locate(told(odometry, other, ranges_m=ranges), ranges, DIRECTIONS)
        found = position.observation
    assert math.dist(odometry[:2], pose[:2]) > 0.6
    assert math.dist((found.x_m, found.y_m), pose[:2]) < 0.2
    assert abs(math.remainder(found.heading_rad - pose[2], math.tau)) < 0.05
    assert found.heading_rad == pytest.approx(odometry[2] + position.turned_rad)
    ((_, x, y),) = found.sightings
    bearing = math.atan2(y - found.y_m, x - found.x_m) - found.heading_rad
    assert math.hypot(x - found.x_m, y - found.y_m) == pytest.approx(0.7)
    assert math.remainder(bearing - 0.5, math.tau) == pytest.approx(0.0, abs=1e-9)
    hit = ranges < RANGE_M
    ends = np.array([found.x_m, found.y_m]) + (ranges[:, None] * turned(DIRECTIONS, position.turned_rad))[hit]
    assert np.median(clearance(TWO_ROOMS, ends, 1.0)) < 0.1
    assert np.median(clearance(TWO_ROOMS, odometry[:2] + (ranges[:, None] * DIRECTIONS)[hit], 1.0)) > 0.3


def test_beams_that_have_met_a_robot_in_sight_are_kept_from_the_filter() -> None:
    events: list[Event] = []
    filter_ = filtered(events)
    ranges = np.full(BEAMS, np.inf)
    ranges[80:101] = 0.8  # a body of 0.3 m in the west, 1 m off, and what stands behind it
    ranges[10] = 1.9
    with_robot = told((1.0, 1.0, 0.0), Sighting(1, 0.0, 1.0), ranges_m=ranges)
    kept = filter_._without_bodies(with_robot, ranges, DIRECTIONS)
    assert np.isnan(kept[80:101]).all()
    assert kept[10] == 1.9
    assert np.isinf(kept[[0, 70, 110]]).all()
    far = np.where(ranges == 0.8, 1.7, ranges)
    assert not np.isnan(filter_._without_bodies(with_robot, far, DIRECTIONS)).any()
    assert filter_._without_bodies(told((1.0, 1.0, 0.0)), ranges, DIRECTIONS) is ranges


def test_the_same_stream_gives_the_same_places() -> None:
    poses = course([(0.9, 1.3), (4.2, 1.4)])
    places = []
    for seed in (1, 1, 2):
        filter_ = filtered([], seed)
        for pose, odometry in zip(poses, drifting(poses, 0.02), strict=True):
            ranges = scan(TWO_ROOMS, pose, odometry[2])
            found = filter_.locate(told(odometry, ranges_m=ranges), ranges, DIRECTIONS).observation
        places.append(found[:3])
    assert places[0] == places[1]
    assert places[0] != places[2]


def test_once_a_second_it_is_noted_where_the_robot_takes_itself_to_be() -> None:
    events: list[Event] = []
    filter_ = filtered(events)
    ranges = scan(ROOM, (*HERE, 0.3), 0.3)
    for _ in range(21):
        filter_.locate(told((*HERE, 0.3), ranges_m=ranges), ranges, DIRECTIONS)
    assert [type(event) for event in events] == [Localised] * 3
    first = events[0]
    assert isinstance(first, Localised)
    assert (first.x_m, first.y_m, first.heading_rad, first.share) == pytest.approx((*HERE, 0.3, 1.0))


# ---------------------------------------------------------------- the explorer


class Ahead:
    """A leader that wants to go east, until it is told otherwise, and counts how often it is asked."""

    done = underway = False
    heading: float | None = 0.0

    def __init__(self) -> None:
        self.gained: list[bool] = []

    def lead(self, observation: Observation, gained: bool) -> float | None:
        self.gained.append(gained)
        return self.heading


class Elsewhere:
    """Tells a robot that it is elsewhere than it is told, on a turned map."""

    def __init__(self, place_m: tuple[float, float], turned_rad: float, shares: list[float]) -> None:
        self._place_m, self._turned_rad, self._shares = place_m, turned_rad, shares

    def locate(self, observation: Observation, ranges_m: Floats, beams: Floats) -> Position:
        x_m, y_m = self._place_m
        moved = observation._replace(x_m=x_m, y_m=y_m, heading_rad=observation.heading_rad + self._turned_rad)
        return Position(moved, self._turned_rad, self._shares.pop(0))


FLOOR = (-2.0, -2.0, 12.0, 10.0)


def told_of_the_floor(robots: int = 1, **changes: Any) -> tuple[Parameters, Any]:
    parameters = Parameters.model_validate({"false_returns": True, **changes})
    starts_m = ((0.8, 1.2), (1.6, 1.2))[:robots]
    walls = np.array([(0.03, 0.07, 3.63, 0.07)])
    surroundings = Surroundings(starts_m, 0.2, 0.3, 1.0, TICK, walls, FLOOR, lambda points: np.zeros(0, np.bool_))
    return parameters, prepare(parameters, surroundings._replace(scan_range_m=RANGE_M, beams=BEAMS))


def explorer_at(place_m: tuple[float, float], turned_rad: float, shares: list[float]) -> tuple[Explorer, Ahead]:
    parameters, setup = told_of_the_floor()
    leader, where = Ahead(), Elsewhere(place_m, turned_rad, shares)
    explorer = Explorer(parameters, setup, 0, None, 0)
    explorer.leader, explorer.positioning = leader, where
    return explorer, leader


def test_the_map_is_marked_where_the_robot_takes_itself_to_be() -> None:
    pose, odometry = (0.8, 1.2, 0.3), (5.0, 4.0, 1.1)
    explorer, _ = explorer_at(pose[:2], pose[2] - odometry[2], [1.0])
    explorer.observe(told(odometry, ranges_m=scan(ROOM, pose, odometry[2])), 0)
    assert explorer.place_m == pose[:2]
    occupied = np.flatnonzero(explorer.belief.evidence > 0)
    centres = np.array([explorer.belief.frame.centre_m(cell) for cell in occupied])
    assert len(centres) > 50
    assert clearance(ROOM, centres, 1.0).max() < 0.08


def test_the_way_and_the_wheels_are_in_the_frame_of_odometry() -> None:
    """East on a map that is turned by 0.4 is 0.4 to the right for odometry."""
    explorer, _ = explorer_at((0.8, 1.2), 0.4, [1.0, 0.5, 0.5])
    orders = []
    for tick in range(3):
        explorer.observe(told((5.0, 4.0, -0.1)), tick * TICK)
        orders += explorer.commands()
    assert orders == [Drive(0.3, pytest.approx(-0.6)), *[Drive(0.15, pytest.approx(-0.3))] * 2]
    assert explorer.counters.way_m == 0.0  # as told: the map's corrections are no way


def test_a_robot_that_waits_stands_and_its_leader_is_not_asked() -> None:
    explorer, leader = explorer_at((0.8, 1.2), 0.0, [1.0, 0.0, 0.0, 0.0, 1.0])
    orders = []
    for tick in range(5):
        explorer.observe(told((0.8, 1.2, 0.0)), tick * TICK)
        orders.append(explorer.commands())
    going = [Drive(0.3, 0.0)]
    assert orders == [going, [Drive(0.0, 0.0)], [], [], going]
    assert len(leader.gained) == 2
    assert (explorer.counters.waited, explorer.counters.ticks) == (3, 5)


def test_the_leader_of_a_slow_robot_is_asked_less_often_but_misses_no_gain() -> None:
    explorer, leader = explorer_at((0.8, 1.2), 0.0, [0.4] * 10)
    for tick in range(10):
        ranges = np.full(BEAMS, 1.0 if tick == 3 else np.nan)  # only the fourth scan shows anything
        explorer.observe(told((0.8, 1.2, 0.0), ranges_m=ranges), tick * TICK)
    assert leader.gained == [False, True, False, False]
    assert explorer.counters.waited == 0


@pytest.mark.slow
@pytest.mark.parametrize("filter_", [{"kind": "slam", "filter": {"particles": 3}}, {"kind": "features"}])
def test_explorers_with_a_filter_keep_the_laws(filter_: dict[str, Any]) -> None:
    setup: list[Any] = []

    def make(me: int, start: int) -> Any:
        if me == 0:
            setup[:] = told_of_the_floor(2, map="messages", positioning=filter_)
        return SPEC.make(setup[0], setup[1], me, np.random.default_rng(me), start)

    check_machine(make, ((0.8, 1.2), (1.6, 1.2)), S)


def test_maps_may_reach_beyond_the_floor() -> None:
    _, plain = told_of_the_floor()
    _, wider = told_of_the_floor(positioning={"margin_m": 1.5})
    assert (wider.frame.nx, wider.frame.ny) == (plain.frame.nx + 30, plain.frame.ny + 30)
    assert wider.frame.origin_m == pytest.approx([each - 1.5 for each in plain.frame.origin_m])


def test_who_may_err_counts_evidence() -> None:
    """A wall that was seen once and then seen through is forgotten."""
    for evidence in ("certain", "counted"):
        _, setup = told_of_the_floor(false_returns=False, evidence=evidence)
        for range_m in (1.03, *[2.0] * 20):
            setup.common.belief.mark((4.02, 4.03), np.array([range_m]), DIRECTIONS[:1], np.empty((0, 3)))
        row, column = divmod(setup.frame.cell_at((5.05, 4.03)), setup.frame.nx)
        assert (setup.common.belief.evidence[row, column] < 0) == (evidence == "counted")


def test_who_has_done_looks_no_more_until_it_goes_on() -> None:
    explorer, leader = explorer_at((0.8, 1.2), 0.0, [1.0] * 5)
    far, near = (told((0.8, 1.2, 0.0), ranges_m=np.full(BEAMS, range_m)) for range_m in (2.0, 1.0))
    explorer.observe(far, 0)
    leader.done, leader.heading = True, None
    explorer.observe(far, TICK)
    before = explorer.belief.evidence.copy()
    explorer.observe(near, 2 * TICK)
    assert (explorer.belief.evidence == before).all()
    assert leader.gained[-1] is False
    leader.heading = 0.0
    explorer.observe(near, 3 * TICK)  # it is led on,
    explorer.observe(near, 4 * TICK)
    assert (explorer.belief.evidence != before).any()


def test_how_much_was_waited_is_a_metric() -> None:
    explorer, _ = explorer_at((0.8, 1.2), 0.0, [1.0, 0.0, 0.0, 1.0])
    for tick in range(4):
        explorer.observe(told((0.8, 1.2, 0.0)), tick * TICK)
    assert SPEC.measure([explorer])["waited_share"] == 0.5
    assert "waited_share" in {metric.name for metric in SPEC.metrics}
