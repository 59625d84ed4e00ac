"""What cosim must know of exploration: the entry point ``exploration`` names ``SPEC``."""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from cosim.arrays import Floats
from cosim.errors import UserError
from cosim.geometry.marking import CERTAIN, DOUBTFUL, Weights
from cosim.geometry.segments import SegmentGrid, segment_grid, swept_clearance
from cosim.machine import Address, Event
from cosim.protocol import Metric, ProtocolSpec, Surroundings
from cosim.units import Time, from_seconds
from protocols.exploration.beacons import Tethered
from protocols.exploration.behaviour import Behaviour
from protocols.exploration.escaping import Escape
from protocols.exploration.events import EVENTS, Counters
from protocols.exploration.explorer import Explorer, Leader
from protocols.exploration.parameters import Parameters, SchemaParameters
from protocols.exploration.positioning import EVENTS as POSITIONING_EVENTS
from protocols.exploration.positioning import Filtered, Positioning
from protocols.exploration.referee import CoverageReferee
from protocols.exploration.rivals import Rival
from protocols.exploration.setup import Setup
from protocols.exploration.targets import Targets
from protocols.exploration.terrain import Terrain
from protocols.mapping.belief import Belief, frame_of
from protocols.mapping.frames import MOST_CELLS
from protocols.mapping.sharing import Sharing
from protocols.transport.star import MOST_ROBOTS
from protocols.wire import BadBytes

TEAM_LIMIT: Final = 256
"""Addresses on the wire are single bytes."""
APART: Final = 4.0
"""Robots without a place start so many radii from each other."""
ROOM: Final = 1.5
"""So many radii about each are free then,"""
WAY: Final = 1.2
"""and so many on both sides of the way from the first."""
ATTEMPTS: Final = 10_000
"""So many places are tried."""

METRICS: Final = (
    Metric("time_50_s", "s", "until half of what can be seen had been; NaN if it never was"),
    Metric("time_95_s", "s", "until 95 % had been"),
    Metric("time_99_s", "s", "until 99 % had been"),
    Metric("coverage", "1", "share of the cells that can be seen that were"),
    Metric("cells_missed", "1", "cells that could be seen and were not"),
    Metric("covered_twice", "1", "share of the cells seen that a second robot has seen as well; NaN if none was"),
    Metric("way_m", "m", "driven by all robots"),
    Metric("stalls", "1", "times that robots were caught in local minima"),
    Metric("escape_share", "1", "share of the steps on paths out of local minima"),
    Metric("share_frontier", "1", "share of the steps in which the sum of frontiers and path was the strongest schema"),
    Metric("share_obstacle", "1", "share of the steps in which that of obstacles was"),
    Metric("share_robot", "1", "share of the steps in which that of robots was; NaN for all if no schema led any step"),
    Metric("blocked_ticks", "1", "ticks in which a wall or a body held a robot up"),
    Metric("given_up", "1", "frontier cells that robots gave up"),
    Metric("waited_share", "1", "share of the ticks in which robots waited to be localised again"),
    Metric("frames", "1", "messages that all robots have sent"),
    Metric("payload_bytes", "B", "bytes in these messages"),
)


def place(
    parameters: Parameters, surroundings: Surroundings, size: int, stream: np.random.Generator
) -> list[tuple[float, float]]:
    """Put the robots close to each other, about a place that is drawn; raise UserError if none is found."""
    x_min, y_min, x_max, y_max = surroundings.bounds_m
    side = math.isqrt(size - 1) + 1
    offsets = np.array([(k % side, k // side) for k in range(size)]) * APART * surroundings.radius_m
    walls = segment_grid(surroundings.walls_m)
    for _ in range(ATTEMPTS):
        places = stream.uniform((x_min, y_min), (x_max, y_max)) + offsets
        if _clear(surroundings, walls, places):
            return [(float(x), float(y)) for x, y in places]
    raise UserError("team.starts: found no place for the team; say where robots start")


def _clear(surroundings: Surroundings, walls: SegmentGrid, places: Floats) -> bool:
    """Return whether the robots have room at *places* (n, 2), and no wall stands between them and the first."""
    radius_m = surroundings.radius_m
    about = [places + ROOM * radius_m * np.array(way) for way in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))]
    if surroundings.forbidden(np.concatenate(about)).any():
        return False
    first = np.broadcast_to(places[0], places.shape)
    return bool((swept_clearance(walls, first, places, ROOM * radius_m) > WAY * radius_m).all())


def prepare(parameters: Parameters, surroundings: Surroundings) -> Setup:
    """Return what all robots know; raise UserError for a floor that is too large, or for ranges that do not fit."""
    _check_ranges(parameters.schemas, surroundings.scan_range_m)
    x_min, y_min, x_max, y_max = surroundings.bounds_m
    margin_m = parameters.positioning.margin_m
    frame = frame_of((x_min - margin_m, y_min - margin_m, x_max + margin_m, y_max + margin_m), parameters.cell_m)
    if frame.nx * frame.ny > MOST_CELLS:
        raise UserError(f"protocol.parameters.cell_m: {frame.nx} x {frame.ny} cells, at most {MOST_CELLS} in all")
    size, range_m = len(surroundings.starts_m), surroundings.scan_range_m
    if parameters.sharing.links is not None and size > MOST_ROBOTS:
        raise UserError(f"protocol.parameters.sharing.links: {size} robots, a piconet has at most {MOST_ROBOTS}")
    shares = parameters.map == "shared"
    shared = Belief(frame, _weights(parameters), range_m) if shares else None
    terrain = None if shared is None else Terrain(shared, parameters.escape)
    places_m = dict(enumerate(surroundings.starts_m)) if shares else {}
    radii_m = surroundings.radii_m or (surroundings.radius_m,) * size
    return Setup(
        size=size,
        tick=surroundings.tick,
        frame=frame,
        starts_m=tuple(surroundings.starts_m),
        radii_m=radii_m,
        speeds_mps=surroundings.speeds_mps or (surroundings.speed_mps,) * size,
        range_m=range_m,
        beams=surroundings.beams,
        shared=shared,
        terrain=terrain,
        targets=None if terrain is None else _targets(parameters, terrain, radii_m, range_m, places_m),
        places_m=places_m,
    )


def _targets(
    parameters: Parameters,
    terrain: Terrain,
    radii_m: Sequence[float],
    range_m: float,
    places_m: Mapping[Address, tuple[float, float]],
) -> Targets | None:
    """Return what chooses frontiers by a map, for all who have it; None if none are chosen."""
    if parameters.algorithm == "schemas":
        return None
    return Targets(parameters.algorithm, parameters.rivals, terrain, radii_m, range_m, places_m)


def _check_ranges(schemas: SchemaParameters, range_m: float) -> None:
    """Raise UserError unless obstacle_m < range < frontier_m (paper 001, sections 3.3 and 3.7)."""
    path, of = "protocol.parameters.schemas", f"{range_m}, team.senses.beam_range_m"
    if not schemas.obstacle_m < range_m:
        raise UserError(f"{path}.obstacle_m: {schemas.obstacle_m} is not < {of} (paper 001, 3.7)")
    if not range_m < schemas.frontier_m:
        raise UserError(f"{path}.frontier_m: {schemas.frontier_m} is not > {of} (paper 001, 3.3)")


def _weights(parameters: Parameters) -> Weights:
    return DOUBTFUL if parameters.counted else CERTAIN


def make(parameters: Parameters, setup: Setup, me: Address, stream: np.random.Generator, start: Time) -> Explorer:
    """Return the machine of robot *me*."""
    counters, events = Counters(), list[Event]()
    sharing, belief = None, setup.shared
    if belief is None:
        own, cells = parameters.sharing, setup.frame.nx * setup.frame.ny
        certain = not parameters.counted
        sharing = Sharing(own, me, setup.size, cells, counters, start, certain)
        belief = Belief(setup.frame, _weights(parameters), setup.range_m)
    leader = _leader(parameters, setup, me, belief, sharing, counters, events, start)
    positioning = _positioning(parameters, setup, stream, events)
    return Explorer(parameters, setup, me, belief, leader, sharing, counters, events, positioning)


def _positioning(
    parameters: Parameters, setup: Setup, stream: np.random.Generator, events: list[Event]
) -> Positioning | None:
    """Return a robot's filter; None if it takes what it is told for its place."""
    own = parameters.positioning
    if own.kind == "given":
        return None
    return Filtered(own, setup.frame, setup.range_m, setup.radii_m, setup.tick, stream, events.append)


def _leader(
    parameters: Parameters,
    setup: Setup,
    me: Address,
    belief: Belief,
    sharing: Sharing | None,
    counters: Counters,
    events: list[Event],
    start: Time,
) -> Leader:
    radius_m, tick = setup.radii_m[me], setup.tick
    terrain = setup.terrain or Terrain(belief, parameters.escape)
    places_m = setup.places_m if sharing is None else sharing.places_m
    if parameters.algorithm == "schemas":
        behaviour = Behaviour(parameters, terrain, counters, events, radius_m, setup.range_m, tick)
        if parameters.beacons.pattern == "free":
            return behaviour
        escape = Escape(parameters.escape, terrain, radius_m, setup.range_m)
        own, reading, size = parameters.beacons, parameters.escape.cost, setup.size
        return Tethered(own, behaviour, belief, me, size, escape, reading, places_m, start, tick)
    targets = setup.targets or _targets(parameters, terrain, setup.radii_m, setup.range_m, places_m)
    assert targets is not None
    spans_s = parameters.rivals.plan_s, parameters.rivals.patience_s
    plan, patience = (max(1, round(from_seconds(span_s) / tick)) for span_s in spans_s)
    return Rival(targets, counters, events, me, plan, patience)


def referee(parameters: Parameters, setup: Setup, surroundings: Surroundings) -> CoverageReferee:
    """Return the judge of the coverage."""
    return CoverageReferee(setup, surroundings)


def measure(machines: Sequence[Explorer]) -> dict[str, float]:
    """Return what the machines have counted."""
    counters = [machine.counters for machine in machines]
    steps = sum(each.steps + each.escape_steps for each in counters)
    return {
        "way_m": sum(each.way_m for each in counters),
        "stalls": float(sum(each.stalls for each in counters)),
        "escape_share": sum(each.escape_steps for each in counters) / steps if steps else 0.0,
        **_schema_shares(counters),
        "blocked_ticks": float(sum(each.blocked for each in counters)),
        "given_up": float(sum(each.given_up for each in counters)),
        "waited_share": sum(each.waited for each in counters) / max(sum(each.ticks for each in counters), 1),
        "frames": float(sum(each.frames for each in counters)),
        "payload_bytes": float(sum(each.payload_bytes for each in counters)),
    }


def _schema_shares(counters: Sequence[Counters]) -> dict[str, float]:
    counts = {
        "share_frontier": sum(each.by_frontiers for each in counters),
        "share_obstacle": sum(each.by_obstacles for each in counters),
        "share_robot": sum(each.by_robots for each in counters),
    }
    steps = sum(counts.values())
    return {name: count / steps if steps else math.nan for name, count in counts.items()}


SPEC = ProtocolSpec(
    name="exploration",
    about="Robots with range scanners map an unknown floor, by motor schemas or by choosing frontiers.",
    parameters=Parameters,
    place=place,
    prepare=prepare,
    make=make,
    referee=referee,
    metrics=METRICS,
    measure=measure,
    events=(*EVENTS, BadBytes, *POSITIONING_EVENTS),
    team_limit=TEAM_LIMIT,
    needs_sight=True,
    needs_view=True,
)
