"""What cosim must know of goal reflection: the entry point ``reflection`` names ``SPEC``."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.errors import UserError
from cosim.geometry.boundary import Boundary, boundary, inflated
from cosim.machine import Address
from cosim.protocol import Death, Metric, ProtocolSpec, Referee, Surroundings
from cosim.units import Time, to_seconds
from protocols.reflection.events import EVENTS
from protocols.reflection.frames import decode
from protocols.reflection.guidance import algorithm, way_back
from protocols.reflection.machine import Reflection
from protocols.reflection.parameters import Parameters
from protocols.reflection.seeking import Target
from protocols.reflection.setup import Point, Pose, Setup, Task, into_frame, targets
from protocols.transport.links import most_robots

TEAM_LIMIT = 256
"""Addresses on the wire are single bytes."""
WORLD: Pose = (0.0, 0.0, 0.0)
LOOPS_SLACK_M = 0.002
"""Extra distance that VisBug keeps from walls, so that rounding does not make bodies touch."""
ATTEMPTS = 10_000
"""Number of places that are tried for a robot that has neither a room nor a patrol to start in."""

METRICS = (
    Metric("motion_steps", "1", "ticks until the last target was reached, or until the end, summed over explorers"),
    Metric("targets_reached", "1", "targets that explorers have come to, in their order, up to the first given up"),
    Metric("goals_reached", "1", "targets that explorers say they have reached: also those after one given up"),
    Metric("steps_per_target", "1", "motion steps over targets reached; NaN if none was"),
    Metric("targets_given_up", "1", "targets that explorers did without"),
    Metric("frames", "1", "frames that all robots have sent"),
    Metric("payload_bytes", "B", "bytes in these frames"),
    Metric("promises_taken", "1", "promises for own goals that were shorter than what a robot had"),
    Metric("ghosts_reached", "1", "times that a robot came to where its helper was and did not see its goal"),
    Metric("troubles", "1", "times that a robot got into trouble"),
    Metric("targets_reflected", "1", "targets for which a promise was taken"),
    Metric("first_useful_reflection_s", "s", "from turning to such a target until its first promise was taken, mean"),
    Metric("advice", "1", "promises for own goals that came in from robots in sight, useful or not"),
    Metric("advice_unseen", "1", "promises for own goals that came in from robots out of sight, which are of no use"),
    Metric("stale_advice", "1", "share of advice that was outdated or late on arrival; NaN if none came in"),
    Metric("advice_outdated", "1", "share of advice that was about a goal that the robot had no more"),
    Metric("advice_late", "1", "share of advice that was older than stale_s"),
    *(
        Metric(f"steps_to_{target}", "1", f"motion steps in which explorers headed for {meaning}")
        for target, meaning in (
            ("goal", "a goal in sight"),
            ("promise", "the place of a promise"),
            ("helper", "another robot, in trouble"),
            ("algorithm", "where the algorithm A led"),
        )
    ),
)


def place(parameters: Parameters, surroundings: Surroundings, size: int, stream: np.random.Generator) -> list[Point]:
    """Place each explorer in a room, each helper at its patrol's first free way point, others anywhere they fit."""
    parameters = located(parameters, surroundings)
    starts: list[Point] = []
    for robot in range(size):
        if robot < parameters.explorers:
            choices = parameters.rooms[robot:] + parameters.rooms[:robot]
        else:
            choices = patrol_of(parameters, robot)
        starts.append(_free(choices, starts, surroundings, stream))
    return starts


def located(parameters: Parameters, surroundings: Surroundings) -> Parameters:
    """Return *parameters* with the rooms and patrols that the floor names, if they name none themselves."""
    places = surroundings.places_m
    patrols = tuple(places[name] for name in sorted(places) if name.startswith("patrol"))
    named = {"rooms": parameters.rooms or places.get("rooms", ()), "patrols": parameters.patrols or patrols}
    return parameters.model_copy(update=named)


def _free(
    choices: Sequence[Point], taken: Sequence[Point], surroundings: Surroundings, stream: np.random.Generator
) -> Point:
    apart_m = 2.5 * surroundings.radius_m
    for choice in choices:
        if all(math.dist(choice, other) > apart_m for other in taken):
            return choice
    x_min, y_min, x_max, y_max = surroundings.bounds_m
    walls = surroundings.walls_m
    for _ in range(ATTEMPTS):
        point = float(stream.uniform(x_min, x_max)), float(stream.uniform(y_min, y_max))
        clear = _distance_to_walls(walls, point) > 1.2 * surroundings.radius_m
        if (
            clear
            and not surroundings.forbidden(np.array([point]))[0]
            and all(math.dist(point, other) > apart_m for other in taken)
        ):
            return point
    raise UserError(f"team.starts: found no place for robot {len(taken)}; give places, rooms or patrols")


def _distance_to_walls(walls_m: Floats, point: Point) -> float:
    if not len(walls_m):
        return math.inf
    start, way = walls_m[:, :2], walls_m[:, 2:] - walls_m[:, :2]
    square = np.maximum((way**2).sum(axis=1), 1e-300)
    share = np.clip(((np.array(point) - start) * way).sum(axis=1) / square, 0.0, 1.0)
    return float(elementary.hypots(*(start + share[:, None] * way - np.array(point)).T).min())


def patrol_of(parameters: Parameters, robot: Address) -> tuple[Point, ...]:
    """Return the way points of a helper, in the world's frame."""
    if robot < parameters.explorers or not parameters.patrols:
        return ()
    return parameters.patrols[(robot - parameters.explorers) % len(parameters.patrols)]


def prepare(parameters: Parameters, surroundings: Surroundings) -> Setup:
    """Return the setup: draw the targets, and put each robot's task into its frame; raise UserError for bad tasks."""
    parameters = located(parameters, surroundings)
    size = len(surroundings.starts_m)
    if parameters.explorers > size:
        raise UserError(f"protocol.parameters.explorers: {parameters.explorers} is not <= {size}, the team's size")
    wanted = targets(parameters, surroundings.seed)
    frames = surroundings.frames or (WORLD,) * size
    speeds = surroundings.speeds_mps or (surroundings.speed_mps,) * size
    steps_m = tuple(speed * to_seconds(surroundings.tick) for speed in speeds)
    tasks = []
    for robot in range(size):
        frame = frames[robot]
        own = tuple(tuple(into_frame(target, frame) for target in row) for row in wanted)
        patrol = tuple(into_frame(point, frame) for point in patrol_of(parameters, robot))
        objects = own + ((),) * (size - len(own)) if parameters.goals == "object" else ()
        by_loops = parameters.algorithm == "visbug" and robot < len(own)
        loops = _loops(surroundings, robot, frame, steps_m[robot]) if by_loops else None
        tasks.append(Task(own[robot] if robot < len(own) else (), patrol, objects, loops))
    most = most_robots(surroundings)
    return Setup(size, surroundings.tick, steps_m, surroundings.radius_m, tuple(tasks), wanted, most)


def _loops(surroundings: Surroundings, robot: Address, frame: Pose, step_m: float) -> Boundary:
    """Return the walls, grown by the robot's radius and by how far a step cuts a round corner, in its own frame."""
    radius_m = surroundings.radii_m[robot] if surroundings.radii_m else surroundings.radius_m
    obstacles, enclosures = (
        [np.array([into_frame((x, y), frame) for x, y in ring.tolist()]) for ring in rings]
        for rings in inflated(surroundings.walls_m, radius_m + step_m * step_m / (8.0 * radius_m) + LOOPS_SLACK_M)
    )
    return boundary(obstacles, enclosures)


def make(parameters: Parameters, setup: Setup, me: Address, stream: np.random.Generator, start: Time) -> Reflection:
    """Return the machine of robot *me*."""
    seeks = bool(setup.tasks[me].goals_m)
    navigator = algorithm(parameters, setup.tasks[me].loops, stream) if seeks else way_back(parameters, stream)
    return Reflection(parameters, setup, me, navigator, start)


class TargetReferee(Referee):
    """Observes where the explorers are, and never what machines believe.

    The targets of an explorer count in their order, one a tick. A target that its machine gives up stays open here, and
    so do all after it: such a run ends when the machines have finished.
    """

    def __init__(self, setup: Setup, epsilon_m: float) -> None:
        self._targets_m = setup.targets_m
        self._epsilon_m = epsilon_m
        self._next = [0] * len(self._targets_m)
        self._steps = [0] * len(self._targets_m)
        self._open = [explorer for explorer, targets in enumerate(self._targets_m) if targets]
        """Explorers that are alive and have targets left."""
        self._begun = False

    def look(self, x_m: Floats, y_m: Floats, now: Time) -> bool:
        """Count a motion step for every living explorer with open targets; return whether there is none."""
        for explorer in self._open.copy():
            self._steps[explorer] += self._begun
            x, y = self._targets_m[explorer][self._next[explorer]]
            if math.hypot(x_m.item(explorer) - x, y_m.item(explorer) - y) < self._epsilon_m:
                self._reached(explorer)
        self._begun = True
        return not self._open and bool(self._targets_m)

    def _reached(self, explorer: Address) -> None:
        self._next[explorer] += 1
        if self._next[explorer] == len(self._targets_m[explorer]):
            self._open.remove(explorer)

    def died(self, death: Death) -> None:
        """Expect no more targets of a dead robot."""
        if death.robot in self._open:
            self._open.remove(death.robot)

    def verdict(self, now: Time) -> dict[str, float]:
        """Return motion steps and targets reached, all explorers together."""
        steps, reached = sum(self._steps), sum(self._next)
        return {
            "motion_steps": float(steps),
            "targets_reached": float(reached),
            "steps_per_target": steps / reached if reached else math.nan,
        }


def referee(parameters: Parameters, setup: Setup, surroundings: Surroundings) -> TargetReferee:
    """Return the judge of the explorers."""
    return TargetReferee(setup, parameters.epsilon_m)


def steps_with_target(metrics: Mapping[str, float]) -> float:
    """Return the motion steps that explorers have made while they had a target, from the *metrics* of a run."""
    return sum(metrics[f"steps_to_{target.name.lower()}"] for target in Target)


def measure(machines: Sequence[Reflection]) -> dict[str, float]:
    """Return the metrics that the machines have counted."""
    counters = [machine.counters for machine in machines]
    advice = sum(record.advice for record in counters)
    reflected = sum(record.reflected for record in counters)
    waited = sum(record.waited for record in counters)
    steps = {
        f"steps_to_{target.name.lower()}": float(sum(record.steps[target] for record in counters)) for target in Target
    }
    return steps | {
        "goals_reached": float(sum(record.reached for record in counters)),
        "targets_given_up": float(sum(record.given_up for record in counters)),
        "frames": float(sum(record.frames for record in counters)),
        "payload_bytes": float(sum(record.payload_bytes for record in counters)),
        "promises_taken": float(sum(record.promises for record in counters)),
        "ghosts_reached": float(sum(record.ghosts for record in counters)),
        "troubles": float(sum(record.troubles for record in counters)),
        "targets_reflected": float(reflected),
        "first_useful_reflection_s": to_seconds(waited) / reflected if reflected else math.nan,
        "advice": float(advice),
        "advice_unseen": float(sum(record.unseen_advice for record in counters)),
        "stale_advice": sum(record.stale for record in counters) / advice if advice else math.nan,
        "advice_outdated": sum(record.outdated for record in counters) / advice if advice else math.nan,
        "advice_late": sum(record.late for record in counters) / advice if advice else math.nan,
    }


SPEC = ProtocolSpec(
    name="reflection",
    about="Robots visit targets, and those that see each other help by reflecting each other's goals.",
    parameters=Parameters,
    place=place,
    prepare=prepare,
    make=make,
    referee=referee,
    metrics=METRICS,
    measure=measure,
    over_time=("motion_steps", "targets_reached", "steps_per_target"),
    events=EVENTS,
    decode=lambda parameters, size, data: decode(data),
    team_limit=TEAM_LIMIT,
    needs_sight=True,
    needs_view=True,
    believes=Reflection.believed,
)
