"""What cosim must know of exploration: the entry point ``exploration`` names ``SPEC``."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from cosim.arrays import Floats
from cosim.errors import UserError
from cosim.geometry.segments import SegmentGrid, segment_grid, swept_clearance
from cosim.machine import Address
from cosim.protocol import Metric, ProtocolSpec, Surroundings
from cosim.units import Time
from protocols.exploration.events import EVENTS, Counters
from protocols.exploration.explorer import Explorer
from protocols.exploration.parameters import Parameters
from protocols.exploration.positioning import EVENTS as POSITIONING_EVENTS
from protocols.exploration.referee import CoverageReferee
from protocols.exploration.setup import Setup, prepare
from protocols.mapping.frames import decode_all
from protocols.wire import BadBytes

TEAM_LIMIT: Final = 256
"""Addresses on the wire are single bytes."""
APART: Final = 4.0
"""Distance between robots without given places, in radii."""
ROOM: Final = 1.5
"""Free radius about each of them, in radii."""
WAY: Final = 1.2
"""Free width on both sides of the way from the first to each, in radii."""
ATTEMPTS: Final = 10_000
"""Number of places that are tried."""

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
    """Place the robots close to each other, about a random place; raise UserError if none is found."""
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


def make(parameters: Parameters, setup: Setup, me: Address, stream: np.random.Generator, start: Time) -> Explorer:
    """Return the machine of robot *me*."""
    return Explorer(parameters, setup, me, stream, start)


def referee(parameters: Parameters, setup: Setup, surroundings: Surroundings) -> CoverageReferee:
    """Return the judge of the coverage."""
    return CoverageReferee(setup, surroundings)


def measure(machines: Sequence[Explorer]) -> dict[str, float]:
    """Return the metrics that the machines have counted."""
    counters = [machine.counters for machine in machines]
    steps = sum(each.steps + each.escape_steps for each in counters)
    return {
        "way_m": math.fsum(each.way_m for each in counters),
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
        "share_frontier": math.fsum(each.by_frontiers for each in counters),
        "share_obstacle": math.fsum(each.by_obstacles for each in counters),
        "share_robot": math.fsum(each.by_robots for each in counters),
    }
    steps = math.fsum(counts.values())
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
    over_time=("coverage", "cells_missed", "covered_twice"),
    events=(*EVENTS, BadBytes, *POSITIONING_EVENTS),
    decode=lambda parameters, size, data: decode_all(data),
    team_limit=TEAM_LIMIT,
    needs_sight=True,
    needs_view=True,
    believes=Explorer.believed,
)
