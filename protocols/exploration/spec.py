"""What cosim must know of exploration: the entry point ``exploration`` names ``SPEC``."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from cosim.errors import UserError
from cosim.geometry.marking import CERTAIN, DOUBTFUL
from cosim.machine import Address, Machine, Metric, ProtocolSpec, Surroundings
from cosim.units import Time, from_seconds, to_seconds
from protocols.exploration.belief import Belief, frame_of
from protocols.exploration.explorer import Explorer
from protocols.exploration.journal import EVENTS
from protocols.exploration.knowledge import Knowledge
from protocols.exploration.parameters import Parameters
from protocols.exploration.records import Records
from protocols.exploration.referee import CoverageReferee
from protocols.exploration.runs import MOST_CELLS
from protocols.exploration.sharing import Sharing

TEAM_LIMIT: Final = 256
"""Addresses on the wire are single bytes."""
APART: Final = 4.0
"""Robots without a place start so many radii from each other."""

METRICS: Final = (
    Metric("time_50_s", "s", "until half of what can be seen had been; NaN if it never was"),
    Metric("time_95_s", "s", "until 95 % had been"),
    Metric("time_99_s", "s", "until 99 % had been"),
    Metric("coverage", "1", "share of the cells that can be seen that were"),
    Metric("cells_missed", "1", "cells that could be seen and were not"),
    Metric("way_m", "m", "driven by all robots"),
    Metric("stalls", "1", "times that robots were caught in local minima"),
    Metric("escape_share", "1", "share of the steps on paths out of local minima"),
    Metric("blocked_ticks", "1", "ticks in which a wall or a body held a robot up"),
    Metric("given_up", "1", "frontier cells that robots gave up"),
    Metric("frames", "1", "messages that all robots have sent"),
    Metric("payload_bytes", "B", "bytes in these messages"),
)


def place(
    parameters: Parameters, surroundings: Surroundings, size: int, stream: np.random.Generator
) -> list[tuple[float, float]]:
    """Put the robots close to each other, about a place that is drawn; raise UserError if none is found."""
    x_min, y_min, x_max, y_max = surroundings.bounds_m
    apart_m = APART * surroundings.radius_m
    side = int(np.ceil(np.sqrt(size)))
    offsets = np.array([(k % side, k // side) for k in range(size)]) * apart_m
    for _ in range(10_000):
        corner = stream.uniform((x_min, y_min), (x_max, y_max))
        places = corner + offsets
        around = [
            places + surroundings.radius_m * 1.5 * np.array(way) for way in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
        ]
        if not surroundings.forbidden(np.concatenate(around)).any() and _clear(surroundings, places):
            return [(float(x), float(y)) for x, y in places]
    raise UserError("team.starts: found no place for the team; say where robots start")


def _clear(surroundings: Surroundings, places: "np.ndarray[Any, np.dtype[np.float64]]") -> bool:
    from cosim.geometry.segments import segment_grid, swept_clearance

    walls = segment_grid(surroundings.walls_m)
    first = np.broadcast_to(places[0], places.shape)
    return bool(
        (swept_clearance(walls, first, places, 1.5 * surroundings.radius_m) > 1.2 * surroundings.radius_m).all()
    )


def prepare(parameters: Parameters, surroundings: Surroundings) -> Any:
    """Return what all robots know; raise UserError for a floor that is too large for the map."""
    frame = frame_of(surroundings.bounds_m, parameters.cell_m)
    if frame.nx * frame.ny > MOST_CELLS:
        raise UserError(f"protocol.parameters.cell_m: {frame.nx} x {frame.ny} cells, at most {MOST_CELLS} in all")
    if not parameters.schemas.obstacle_m < RANGE_M < parameters.schemas.frontier_m:
        raise UserError(
            f"protocol.parameters.schemas: obstacle_m {parameters.schemas.obstacle_m} < range {RANGE_M} < frontier_m "
            f"{parameters.schemas.frontier_m} does not hold (paper 001, 3.3 and 3.7)"
        )
    size = len(surroundings.starts_m)
    weights = DOUBTFUL if parameters.false_returns else CERTAIN
    return Knowledge(
        size=size,
        tick=surroundings.tick,
        frame=frame,
        starts_m=tuple(surroundings.starts_m),
        radii_m=surroundings.radii_m or (surroundings.radius_m,) * size,
        speeds_mps=surroundings.speeds_mps or (surroundings.speed_mps,) * size,
        range_m=RANGE_M,
        beams=BEAMS,
        shared=Belief(frame, weights, RANGE_M) if parameters.map == "shared" else None,
        places_m=dict(enumerate(surroundings.starts_m)) if parameters.map == "shared" else {},
    ), surroundings


RANGE_M: Final = 2.5
BEAMS: Final = 360


def make(parameters: Parameters, known: Any, me: Address, stream: np.random.Generator, start: Time) -> Machine:
    """Return the machine of robot *me*."""
    knowledge: Knowledge = known[0]
    records = Records()
    weights = DOUBTFUL if parameters.false_returns else CERTAIN
    belief = knowledge.shared or Belief(knowledge.frame, weights, knowledge.range_m)
    sharing = None
    if knowledge.shared is None:
        own, cells = parameters.sharing, knowledge.frame.nx * knowledge.frame.ny
        period = from_seconds(own.period_s)
        sharing = Sharing(me, knowledge.size, cells, period, own.octets, own.again, records, start)
    return Explorer(parameters, knowledge, me, belief, sharing, records)


def referee(parameters: Parameters, known: Any) -> CoverageReferee:
    """Return the judge of the coverage."""
    return CoverageReferee(*known)


def measure(machines: Sequence[Explorer]) -> dict[str, float]:
    """Return what the machines have counted."""
    records = [machine.records for machine in machines]
    steps = sum(each.steps + each.escape_steps for each in records)
    return {
        "way_m": sum(each.way_m for each in records),
        "stalls": float(sum(each.stalls for each in records)),
        "escape_share": sum(each.escape_steps for each in records) / steps if steps else 0.0,
        "blocked_ticks": float(sum(each.blocked for each in records)),
        "given_up": float(sum(each.given_up for each in records)),
        "frames": float(sum(each.frames for each in records)),
        "payload_bytes": float(sum(each.payload_bytes for each in records)),
    }


SPEC = ProtocolSpec(
    name="exploration",
    parameters=Parameters,
    place=place,
    prepare=prepare,
    make=make,
    referee=referee,
    metrics=METRICS,
    measure=measure,
    events=EVENTS,
    team_limit=TEAM_LIMIT,
    needs_sight=True,
    needs_view=True,
)
