"""The protocol Pseudonet as cosim needs it: the entry point ``pseudonet`` names ``SPEC``."""

import math
from collections.abc import Sequence

import numpy as np

from cosim.errors import UserError
from cosim.geometry.grids import CoverageGrid, coverage_grid
from cosim.machine import Address
from cosim.protocol import Metric, ProtocolSpec, Surroundings
from cosim.units import Time, to_seconds
from protocols.pseudonet import messages, wide
from protocols.pseudonet.algorithms.base import Algorithm
from protocols.pseudonet.algorithms.oscard import Oscard
from protocols.pseudonet.algorithms.planned import Planned
from protocols.pseudonet.algorithms.random_walk import RandomWalk
from protocols.pseudonet.coordination import Coordination
from protocols.pseudonet.coverage import CoverageReferee
from protocols.pseudonet.events import EVENTS
from protocols.pseudonet.machine import Pseudonet
from protocols.pseudonet.messages import MESSAGE_KINDS, Packet
from protocols.pseudonet.parameters import Parameters, TeamParameters, piconet_size, timing
from protocols.pseudonet.plans.boustrophedon import boustrophedon
from protocols.pseudonet.plans.spanning_tree import spanning_tree
from protocols.pseudonet.setup import Setup
from protocols.pseudonet.wide import ROBOTS
from protocols.transport.links import MOST_ROBOTS

TEAM_LIMIT = ROBOTS
"""Size of a team whose robots have numbers of 5 bits in the wide form of packets."""
COLUMN_LIMIT = 4096
"""Number of columns, or rows, that 12 bits of a message can hold."""
PLANNERS = {"boustrophedon": boustrophedon, "spanning_tree": spanning_tree}
FREE_STEPS = 4
"""Default step limit of the algorithms that need not end, in multiples of each robot's share of the cells."""

METRICS = (
    Metric("coverage", "1", "share of the cells that living robots can reach around the dead that were entered"),
    Metric("time_to_cover_s", "s", "when all were covered; NaN if never"),
    Metric("overlap_ratio", "1", "entries of cells that were covered already, over the cells covered"),
    Metric("cells", "1", "cells that could be reached in the beginning"),
    Metric("steps", "1", "steps that the team agreed on"),
    *(Metric(f"messages_{kind.name.lower()}", "1", f"{kind.name.lower()} messages sent") for kind in MESSAGE_KINDS),
    Metric("exchanges", "1", "exchanges completed, by the robot that has completed most"),
    Metric("exchange_s", "s", "mean duration of an exchange (cycle time), measured by masters"),
    Metric("radio_wait_s", "s", "time in which the team stood still while messages were exchanged"),
    Metric("setup_s", "s", "from the start until the team was called up, mean over robots"),
    Metric("inquiry_s", "s", "from asking for an inquiry to its end, as the hosts that ask see it, all inquiries"),
    Metric("page_s", "s", "from asking for a link to the answer, as the hosts that ask see it, all pages"),
    Metric("reform_s", "s", "from the loss of a team until the next one makes a step, mean over robots and losses"),
    Metric("teams_lost", "1", "how often a robot has lost its team, summed over robots"),
    Metric(
        "robots_dropped",
        "1",
        "robots that are not in the largest team at the end and have not left one of their own accord",
    ),
)


def _grid(
    parameters: TeamParameters, surroundings: Surroundings, starts_m: Sequence[tuple[float, float]]
) -> CoverageGrid:
    if 2 * surroundings.radius_m > parameters.cell_m:
        raise UserError(
            f"protocol.parameters.cell_m: {parameters.cell_m} is not >= {2 * surroundings.radius_m}, "
            "the diameter of the largest robot"
        )
    x_min, y_min, x_max, y_max = surroundings.bounds_m
    columns, rows = (math.floor(side / parameters.cell_m + 1e-9) for side in (x_max - x_min, y_max - y_min))
    if not (1 <= columns <= COLUMN_LIMIT and 1 <= rows <= COLUMN_LIMIT):
        raise UserError(
            f"protocol.parameters.cell_m: {parameters.cell_m} makes {columns} x {rows} cells of this floor, "
            f"expected 1 to {COLUMN_LIMIT} a side"
        )
    for robot, (x_m, y_m) in enumerate(starts_m):
        if x_m - x_min >= columns * parameters.cell_m or y_m - y_min >= rows * parameters.cell_m:
            raise UserError(f"team.starts[{robot}]: ({x_m}, {y_m}) is beyond the last whole cell of the floor")
    grid = coverage_grid(
        surroundings.bounds_m,
        parameters.cell_m,
        surroundings.radius_m,
        surroundings.walls_m,
        surroundings.forbidden,
        starts_m,
    )
    if not grid.reachable.any():
        raise UserError(f"protocol.parameters.cell_m: no cell of {parameters.cell_m} m is free on this floor")
    return grid


def place(
    parameters: TeamParameters, surroundings: Surroundings, size: int, stream: np.random.Generator
) -> list[tuple[float, float]]:
    """Place *size* robots in random cells of the largest connected part of the floor (Fig. 10)."""
    grid = _grid(parameters, surroundings, ())
    cells = np.flatnonzero(grid.reachable)
    if len(cells) < size:
        raise UserError(f"team.size: {size} robots, but the floor has {len(cells)} cells")
    return [grid.centre_m(int(cell)) for cell in stream.choice(cells, size=size, replace=False)]


def prepare(parameters: TeamParameters, surroundings: Surroundings) -> Setup:
    """Lay the grid over the floor.

    Raise UserError if a robot stands in no free cell, or two in one, or for piconets that cannot be.
    """
    grid = _grid(parameters, surroundings, surroundings.starts_m)
    taken: dict[int, int] = {}
    for robot, (x_m, y_m) in enumerate(surroundings.starts_m):
        cell = grid.cell_at(x_m, y_m)
        if not grid.free[cell]:
            raise UserError(f"team.starts[{robot}]: ({x_m}, {y_m}) is not in a cell that the robot fits into")
        if cell in taken:
            raise UserError(f"team.starts[{robot}]: ({x_m}, {y_m}) is in the same cell as team.starts[{taken[cell]}]")
        taken[cell] = robot
    together = piconet_size(parameters, surroundings)
    return Setup(grid, len(surroundings.starts_m), timing(parameters, surroundings), together)


def make(parameters: Parameters, setup: Setup, me: Address, stream: np.random.Generator, start: Time) -> Pseudonet:
    """Return the machine of robot *me*."""
    share = math.ceil(len(setup.cells) / setup.size)
    step_limit = parameters.step_limit
    if step_limit is None and parameters.algorithm not in PLANNERS:
        step_limit = FREE_STEPS * share
    stop_at = None if parameters.algorithm in PLANNERS else math.ceil(parameters.stop_ratio * len(setup.cells))
    chosen = algorithm(parameters, stream)
    coordination = Coordination(setup, me, chosen, stop_at, parameters.rounds, parameters.departure)
    return Pseudonet(parameters, setup, me, coordination, step_limit, start)


def algorithm(parameters: Parameters, stream: np.random.Generator) -> Algorithm:
    """Return one robot's instance of the coverage algorithm that *parameters* name."""
    if parameters.algorithm in PLANNERS:
        return Planned(PLANNERS[parameters.algorithm])
    if parameters.algorithm == "random_walk":
        return RandomWalk(stream)
    return Oscard(stream, parameters.patience, parameters.history, parameters.revisits, parameters.k_forced)


def measure(machines: Sequence[Pseudonet]) -> dict[str, float]:
    """Return the metrics of all machines, but for the referee's."""
    applications = [machine.application for machine in machines]
    counters = [each.counters for each in applications]
    led = sum(record.led for record in counters)
    setups = [record.setup for record in counters if record.setup is not None]
    resumed = sum(record.resumed for record in counters)
    departed = {each.me for each in applications if each.departed}
    finished = [each for each in applications if each.finished and not each.departed] or applications
    largest = max(len(set(each.broadcast.members) - departed) for each in finished)
    sums = {
        f"messages_{kind.name.lower()}": float(sum(each.messaging.sent[kind] for each in applications))
        for kind in MESSAGE_KINDS
    }
    return sums | {
        "cells": float(len(applications[0].coordination.view.setup.cells)),
        "steps": float(max(each.steps for each in applications)),
        "exchanges": float(max(record.exchanges for record in counters)),
        "exchange_s": to_seconds(sum(record.exchange_time for record in counters)) / led if led else math.nan,
        "radio_wait_s": to_seconds(sum(record.radio_wait for record in counters)),
        "setup_s": to_seconds(sum(setups)) / len(setups) if setups else math.nan,
        "reform_s": to_seconds(sum(record.reform_time for record in counters)) / resumed if resumed else math.nan,
        "teams_lost": float(sum(record.breaks for record in counters)),
        "inquiry_s": to_seconds(sum(machine.bluetooth.inquiry_time for machine in machines)),
        "page_s": to_seconds(sum(machine.bluetooth.page_time for machine in machines)),
        "robots_dropped": float(len(machines) - len(departed) - largest),
    }


def referee(parameters: Parameters, setup: Setup, surroundings: Surroundings) -> CoverageReferee:
    """Return the judge of coverage."""
    return CoverageReferee(setup)


def decode(parameters: TeamParameters, size: int, data: bytes) -> Packet | dict[str, object]:
    """Return the packet that *data* is in a team of *size*; raise WireError if it is none."""
    if size > messages.NARROW.robots and messages.is_broad(data):
        return messages.decode(data, messages.BROAD)
    return messages.decode(data) if size <= (parameters.piconet_size or MOST_ROBOTS) else wide.decode_anonymous(data)


SPEC = ProtocolSpec(
    name="pseudonet",
    about="A team covers a floor cell by cell, and agrees on each step in exchanges over a piconet.",
    parameters=Parameters,
    place=place,
    prepare=prepare,
    make=make,
    referee=referee,
    metrics=METRICS,
    measure=measure,
    over_time=("coverage", "overlap_ratio"),
    events=EVENTS,
    decode=decode,
    believes=Pseudonet.believed,
    team_limit=TEAM_LIMIT,
)
