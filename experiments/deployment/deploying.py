"""A deployment of paper 004 from places about base that are drawn.

Nothing else in such a run is drawn, unless its channel draws: replicates differ by where the robots stand at base when
the play is called. All arms of a replicate draw from one stream; teams of the same size start from the same places.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from cosim.errors import UserError
from cosim.experiment import experiment_function
from cosim.randomness import Streams
from cosim.robots.placement import misfit
from cosim.scenario import Scenario, changed
from cosim.settings import Metres, Settings
from cosim.simulation import METRICS as EVERY_RUN
from cosim.simulation import Simulation
from cosim.trace import POSES
from cosim.trace import Field as Column
from cosim.units import Time, to_seconds
from cosim.world.floorplan import Floorplan, load_floorplan
from protocols.deployment.spec import METRICS

Point: TypeAlias = tuple[float, float]

ATTEMPTS: Final = 1000
"""Number of times that the whole team is placed again."""
TRIES: Final = 200
"""Number of places that are drawn for each robot before that."""
AWAY_M: Final = 1.0
"""Distance from where a body was ordered off at which it has left."""
_OWN: Final = (
    Column(
        "until_deployed_s",
        "float",
        "s",
        "deployment_s; the longest run if they never were held",
    ),
    Column(
        "leap_ahead_s",
        "float",
        "s",
        "by how much the first body of task ahead had come 1 m from where it was ordered off before the first of task "
        "behind",
    ),
)
COLUMNS: Final = (
    *(
        Column(metric.name, "float", metric.unit, metric.meaning)
        for metric in (*METRICS, *(metric for metric in EVERY_RUN if metric.name in ("distance_m", "robots_killed")))
    ),
    *_OWN,
)


class StartSettings(Settings):
    """Where robots stand when the play is called: anywhere in a rectangle about base, so far from each other."""

    base: str = Field(description="name of the floor's place that is in its middle")
    half_m: tuple[Metres, Metres] = Field(description="m, half its width and half its height")
    apart_m: Metres = Field(gt=0, description="m, between the middles of two robots, at least")


class Parameters(Settings):
    """A deployment, and where its robots start."""

    scenario: Scenario = Field(description="the run, but for its starts")
    starts: StartSettings
    posts: str | None = Field(
        default=None, description="name of the floor's places, of which the first call gets as many as there are robots"
    )
    ahead: str | None = Field(default=None, description="beginning of the names of the tasks that are to go ahead,")
    behind: str | None = Field(default=None, description="and of those that are to come later")

    @model_validator(mode="after")
    def _makes_a_scenario(self) -> "Parameters":
        try:
            self.placed(0)
        except UserError as error:
            raise ValueError(str(error)) from None
        return self

    def placed(self, seed: int) -> Scenario:
        """Return the scenario with its starts; raise UserError for what does not fit."""
        here = Path(__file__).parent
        scenario = self.scenario.placed(here)
        floor = load_floorplan(scenario.floorplan, scenario.folder)
        changes: dict[str, Any] = {"team.starts": drawn(self.starts, scenario, floor, seed)}
        if self.posts is not None:
            changes["protocol.parameters.calls[0].call.places"] = _posts(self.posts, floor, scenario.team.size)
        return changed(scenario, changes, "starts", here)


def _posts(name: str, floor: Floorplan, size: int) -> list[list[float]]:
    posts = floor.places_m.get(name, ())
    if len(posts) < size:
        raise UserError(f"posts: the floor has {len(posts)} places {name!r}, expected {size}")
    return [list(post) for post in posts[:size]]


def drawn(starts: StartSettings, scenario: Scenario, floor: Floorplan, seed: int) -> list[list[float]]:
    """Return where the robots start, as *seed* has it; raise UserError if there is no room for all."""
    if len(floor.places_m.get(starts.base, ())) != 1:
        raise UserError(f"starts.base: {starts.base!r} is no single place of the floor")
    base, half = np.array(floor.places_m[starts.base][0]), np.array(starts.half_m)
    radii_m = [body.radius_m for body in scenario.team.bodies]
    stream = Streams(seed)("starts")
    for _ in range(ATTEMPTS):
        found = _team(stream, base, half, starts.apart_m, radii_m, floor)
        if found is not None:
            return found
    raise UserError(f"starts: found no room for {len(radii_m)} robots about {starts.base}")


def _team(
    stream: np.random.Generator, base: Any, half: Any, apart_m: float, radii_m: list[float], floor: Floorplan
) -> list[list[float]] | None:
    found: list[list[float]] = []
    for radius_m in radii_m:
        for _ in range(TRIES):
            x, y = (base + stream.uniform(-half, half)).round(3).tolist()
            clear = all(math.dist((x, y), other) >= apart_m for other in found)
            if clear and misfit((x, y), radius_m, floor) is None:
                found.append([x, y])
                break
        else:
            return None
    return found


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Make the run and return ``COLUMNS``. Raise UserError for a run that cannot be set up."""
    own = Parameters.model_validate(parameters)
    scenario = own.placed(seed)
    outcome = Simulation(scenario, seed, () if own.ahead is None or own.behind is None else (POSES,)).run()
    found = {column.name: outcome.metrics[column.name] for column in COLUMNS if column not in _OWN}
    never = math.isnan(found["deployment_s"])
    found["until_deployed_s"] = scenario.duration_s if never else found["deployment_s"]
    found["leap_ahead_s"] = math.nan
    if own.ahead is not None and own.behind is not None:
        trace = outcome.trace
        found["leap_ahead_s"] = lead_s(trace.columns("events"), trace.columns(POSES.name), own.ahead, own.behind)
    return found


def lead_s(events: Mapping[str, Any], poses: Mapping[str, Any], ahead: str, behind: str) -> float:
    """Return by how much the first robot of the tasks *ahead* had left before the first of the tasks *behind*, seconds.

    Tasks are given by the beginnings of their names. NaN if no robot has left for the one or the other.
    """
    firsts = [min(left(events, poses, name).values(), default=None) for name in (ahead, behind)]
    return math.nan if None in firsts else to_seconds(firsts[1] - firsts[0])  # type: ignore[operator]


def left(events: Mapping[str, Any], poses: Mapping[str, Any], name: str) -> dict[int, Time]:
    """Return when each robot had left by a drive of the tasks whose names begin with *name*: the body, not the order.

    That is when it was first ``AWAY_M`` from where it stood when it was first ordered to such a drive.
    """
    ordered = dict[int, tuple[Time, Point]]()
    columns = ("event", "time_ns", "source", "task", "x_m", "y_m")
    for event, time, robot, task, *at in zip(*(events.get(column, ()) for column in columns), strict=True):
        if event == "TaskStarted" and task.startswith(name):
            ordered.setdefault(robot, (time, (at[0], at[1])))
    found = dict[int, Time]()
    for time, robot, *at in zip(*(poses[column] for column in ("time_ns", "source", "x_m", "y_m")), strict=True):
        if robot in ordered and robot not in found:
            since, stood_m = ordered[robot]
            if time >= since and math.dist(at, stood_m) > AWAY_M:
                found[robot] = time
    return found
