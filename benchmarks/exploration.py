"""What explorers cost: their kernels on the floors of ``experiments/exploration_teams``, and a minute of a whole run.

What a robot alone senses on the office floor is recorded once and replayed, to maps, to machines and to filters.
"""

from collections.abc import Callable
from functools import cache
from statistics import median
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from benchmarks.workloads import FLOORS, Work
from cosim.arrays import Bools, Floats
from cosim.documents import read_yaml
from cosim.geometry.astar import astar, clearance_cost, passable_cells
from cosim.geometry.marking import CERTAIN
from cosim.geometry.segments import ray_casts
from cosim.navigation.frontier_fields import sum_of_frontiers, sum_of_obstacles
from cosim.navigation.localization.likelihood import KnownMap, known_map
from cosim.navigation.localization.localizer import Localizer
from cosim.navigation.schemas import beam_directions
from cosim.navigation.slam import MapGrid, Slam
from cosim.observation import Observation
from cosim.randomness import Draws
from cosim.scenario import Scenario, build
from cosim.simulation import Simulation
from cosim.units import S, Time
from protocols.exploration.events import Stalled
from protocols.mapping.belief import Belief, frame_of

SWEEP = FLOORS.parent / "exploration_teams" / "sweep.yaml"
RECORDED: Time = 300 * S
MINUTE: Time = 60 * S
BEAMS = 360
RANGE_M = 2.5
LASER_M = 8.0
"""Of the robot that knows the map, and only asks where it is."""
CELL_M = 0.1
BODY_CELLS = 3.0
CLEAR_CELLS = 6.0
CLEAR_COST = 5.0
"""As robots plan by default."""
PAIRS = 50
PAIRS_OF_PASSES = 7
FIRST_LOOK: Time = 60 * S
NOBODY = np.empty((0, 3))
TURNS = 2.0 * np.pi * np.arange(BEAMS) / BEAMS


class Still:
    """A view that has been taken: the ranges that it had."""

    def __init__(self, ranges_m: Floats) -> None:
        self._ranges_m = ranges_m

    def sees(self, points_m: Any) -> list[bool]:
        """Return that nothing is seen."""
        return [False] * len(points_m)

    def ranges_m(self) -> Floats:
        """Return the ranges."""
        return self._ranges_m


class Recording(NamedTuple):
    """What an explorer alone has sensed on the office floor, tick by tick, and its map at the end."""

    seen: list[tuple[Observation, Time]]
    belief: Belief


def _simulation(floor: str, robots: int, seed: int) -> Simulation:
    plain = read_yaml(SWEEP)["parameters"]["scenario"]
    plain |= {"floorplan": {"map": f"../floors/explore_{floor}.yaml"}, "team": plain["team"] | {"size": robots}}
    scenario: Scenario = build(plain, "sweep.yaml", SWEEP.parent)
    return Simulation(scenario, seed)


def _machine(simulation: Simulation) -> Any:
    return simulation.machines[0]


@cache
def _recorded(seed: int) -> Recording:
    simulation = _simulation("office", 1, seed)
    machine, seen = _machine(simulation), []
    observe = machine.observe

    def record(observation: Observation, now: Time) -> None:
        still = observation._replace(view=Still(observation.ranges_m))
        seen.append((still, now))
        observe(still, now)

    machine.observe = record
    simulation.begin()
    simulation.kernel.run(RECORDED)
    return Recording(seen, machine.belief)


# ---------------------------------------------------------------- marking, and steps


def marked_scans(seed: int) -> Work:
    """The scans of five minutes, marked into a map that begins empty."""
    recording = _recorded(seed)
    belief = Belief(recording.belief.frame, CERTAIN, RANGE_M)
    scans = [((at.x_m, at.y_m), at.ranges_m) for at, _ in recording.seen]
    beams = beam_directions(BEAMS)

    def work() -> float:
        for place_m, ranges_m in scans:
            belief.mark(place_m, ranges_m, beams, NOBODY)
        return len(scans)

    return work


def explorer_steps(seed: int) -> Work:
    """The same five minutes, observed by a machine that marks, decides, plans and steers."""
    recording = _recorded(seed)
    machine = _machine(_simulation("office", 1, seed))

    def work() -> float:
        for observation, now in recording.seen:
            machine.observe(observation, now)
            machine.commands()
            machine.events()
        return len(recording.seen)

    return work


def schema_steps(seed: int) -> float:
    """Return the seconds of one step of an explorer beyond marking, in ticks in which it does not plan.

    What it costs to plan is in ``explorer_steps``, and A* stands by itself. It is the difference of two measurements,
    between which a machine may change its speed: of several such pairs the median is taken.
    """
    return median(_unplanned(seed) - _marking(seed) for _ in range(PAIRS_OF_PASSES))


def _marking(seed: int) -> float:
    marks = marked_scans(seed)
    started = process_time()
    count = marks()
    return (process_time() - started) / count


def _unplanned(seed: int) -> float:
    """Return the seconds of a tick, marking included, of those in which the robot does not plan."""
    seen, planned = _recorded(seed).seen, _planned(seed)
    machine, planning = _machine(_simulation("office", 1, seed)), 0.0
    started = process_time()
    for tick, (observation, now) in enumerate(seen):
        if tick not in planned:
            machine.observe(observation, now)
            machine.commands()
            machine.events()
            continue
        began = process_time()
        machine.observe(observation, now)
        planning += process_time() - began
    return (process_time() - started - planning) / (len(seen) - len(planned))


@cache
def _planned(seed: int) -> frozenset[int]:
    """Return the ticks of the recording in which the robot is caught in a local minimum, and plans."""
    machine, planned = _machine(_simulation("office", 1, seed)), set()
    for tick, (observation, now) in enumerate(_recorded(seed).seen):
        machine.observe(observation, now)
        if any(isinstance(event, Stalled) for event in machine.events()):
            planned.add(tick)
    return frozenset(planned)


def frontier_fields(seed: int) -> Work:
    """Sums over frontiers and obstacles at the places of the five minutes, in the map of their end."""
    recording = _recorded(seed)
    belief, places = recording.belief, [(at.x_m, at.y_m) for at, _ in recording.seen]
    frame = *belief.frame.origin_m, belief.frame.cell_m

    def work() -> float:
        for place_m in places:
            sum_of_frontiers(belief.frontier, *frame, *place_m, 5.0)
            sum_of_obstacles(belief.evidence, *frame, *place_m, 0.5, False)
        return len(places)

    return work


def minutes(seed: int) -> Work:
    """A minute of four explorers on the floor with a corridor, after the first."""
    simulation = _simulation("corridor", 4, seed)
    simulation.begin()
    simulation.kernel.run(FIRST_LOOK)

    def work() -> float:
        simulation.kernel.run(FIRST_LOOK + MINUTE)
        return 1.0

    return work


def large_floor(seed: int) -> float:
    """Return the seconds of processor time that four explorers on 150 m x 150 m take beside their exploring.

    The floor is halved by a wall, so that the truth of what can be explored is all of one half.
    """
    started = process_time()
    scenario = Scenario.model_validate(
        {
            "duration_s": 0.2,
            "floorplan": {"map": "walls", "bounds_m": [0, 0, 150, 150], "walls": [[75, 0, 75, 150]]},
            "team": {"size": 4, "senses": {"beams": BEAMS, "beam_range_m": RANGE_M}},
            "protocol": {"use": "exploration"},
        }
    )
    Simulation(scenario, seed).run()
    return process_time() - started


# ---------------------------------------------------------------- planning


class Explored(NamedTuple):
    """The office floor, 402 x 402 cells, as an explorer knows it in the end."""

    belief: Belief
    passable: Bools


@cache
def _explored() -> Explored:
    """Mark scans from everywhere."""
    floor = _simulation("office", 1, 0).floorplan
    belief = Belief(frame_of(floor.bounds_m, CELL_M), CERTAIN, LASER_M)
    x_min, y_min, x_max, y_max = floor.bounds_m
    places = [(x, y) for x in np.arange(x_min + 0.55, x_max, 1.0) for y in np.arange(y_min + 0.55, y_max, 1.0)]
    for place_m in places:
        ranges_m = ray_casts(floor.grid, np.tile(place_m, (BEAMS, 1)), TURNS, LASER_M)
        belief.mark(place_m, np.where(ranges_m < LASER_M, ranges_m, np.inf), beam_directions(BEAMS), NOBODY)
    return Explored(belief, passable_cells(belief.evidence, BODY_CELLS))


def _searches(seed: int) -> list[Callable[[], object]]:
    explored = _explored()
    extra = clearance_cost(explored.belief.evidence > 0, CLEAR_CELLS, CLEAR_COST)
    cells = np.flatnonzero(explored.passable)
    pairs = np.random.default_rng(seed).choice(cells, (PAIRS, 2)).tolist()
    return [lambda pair=pair: astar(explored.passable, extra, *pair) for pair in pairs]  # type: ignore[misc]


def searches(seed: int) -> Work:
    """A* between random places of the office floor."""
    every = _searches(seed)

    def work() -> float:
        for search in every:
            search()
        return len(every)

    return work


def hardest_search(seed: int) -> float:
    """Return the seconds of the longest of these searches."""

    def seconds(search: Callable[[], object]) -> float:
        started = process_time()
        search()
        return process_time() - started

    return max(map(seconds, _searches(seed)))


# ---------------------------------------------------------------- filters


def _stops(seed: int) -> list[Observation]:
    """Return the recorded observations between which a filter is updated."""
    stops: list[Observation] = []
    for at, _ in _recorded(seed).seen:
        if not stops or np.hypot(at.x_m - stops[-1].x_m, at.y_m - stops[-1].y_m) >= 0.25:
            stops.append(at)
    return stops


@cache
def _known() -> KnownMap:
    explored = _explored()
    frame = explored.belief.frame
    return known_map(explored.belief.evidence > 0, explored.passable, frame.origin_m, frame.cell_m)


def localization_updates(seed: int) -> Work:
    """Updates of Monte Carlo localisation with a laser of 8 m on the known floor, from a known start."""
    stops, walls = _stops(seed), _simulation("office", 1, 0).floorplan.grid
    poses = [(at.x_m, at.y_m, at.heading_rad) for at in stops]
    scans = [ray_casts(walls, np.tile(pose[:2], (BEAMS, 1)), TURNS, LASER_M) for pose in poses]
    localizer = Localizer(_known(), beam_directions(BEAMS), Draws(seed, "bench"))
    localizer.start_at(poses[0])

    def work() -> float:
        for pose, ranges_m in zip(poses, scans, strict=True):
            localizer.observe(pose, ranges_m)
        return localizer.updates

    return work


def slam_updates(seed: int) -> Work:
    """Updates of SLAM, as the explorer's scanner sees the floor; its particles begin with empty maps."""
    stops = _stops(seed)
    frame = _recorded(seed).belief.frame
    poses = [(at.x_m, at.y_m, at.heading_rad) for at in stops]
    beams = beam_directions(BEAMS)
    slam = Slam(MapGrid((frame.ny, frame.nx), frame.origin_m, frame.cell_m), poses[0], beams, Draws(seed, "bench"))

    def work() -> float:
        for pose, at in zip(poses, stops, strict=True):
            slam.observe(pose, at.ranges_m)
        return slam.updates

    return work
