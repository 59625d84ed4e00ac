"""The protocol gathering as cosim needs it: the entry point ``gathering`` names ``SPEC``.

All layers but the coordination layer are Pseudonet's: the packets, the exchanges, the set-up and its repair.
"""

import math
from typing import Final

import numpy as np

from cosim.arrays import Floats
from cosim.geometry.grids import Cell, CoverageGrid
from cosim.machine import Address
from cosim.protocol import Death, Metric, ProtocolSpec, Referee, Surroundings
from cosim.units import Time, to_seconds
from protocols.gathering.gathering import GatheringCoordination
from protocols.pseudonet import spec as pseudonet
from protocols.pseudonet.events import EVENTS
from protocols.pseudonet.machine import Pseudonet
from protocols.pseudonet.parameters import TeamParameters
from protocols.pseudonet.setup import Setup

# ---------------------------------------------------------------- referee
# The truth about gathering: how many robots stand together, since when, and how close.


def largest_group(grid: CoverageGrid, cells: list[Cell]) -> int:
    """Return the size of the largest group in *cells* whose robots each stand a step of the grid from another."""
    left, largest = set(cells), 0
    while left:
        group, edge = 0, [left.pop()]
        while edge:
            cell = edge.pop()
            group += cells.count(cell)
            beside = left.intersection(grid.steps[cell].tolist())
            left -= beside
            edge += beside
        largest = max(largest, group)
    return largest


class GatheringReferee(Referee):
    """Follows the places of living robots; sees poses and deaths only, never what machines believe."""

    def __init__(self, setup: Setup) -> None:
        self._grid = setup.grid
        self._dead: set[Address] = set()
        self._places: Floats = np.empty((0, 2))
        self._cells: list[Cell] = []
        self._together = 0
        self._gathered_at: Time | None = None

    def look(self, x_m: Floats, y_m: Floats, now: Time) -> bool:
        """Find the robots that stand together; never end the run: the team itself finds its end."""
        grid = self._grid
        living = [robot for robot in range(len(x_m)) if robot not in self._dead]
        self._places = np.stack((x_m, y_m), axis=1)[living]
        columns = np.floor((self._places[:, 0] - grid.origin_m[0]) / grid.cell_m).astype(np.int64)
        rows = np.floor((self._places[:, 1] - grid.origin_m[1]) / grid.cell_m).astype(np.int64)
        cells = (rows * grid.nx + columns).tolist()
        if cells != self._cells:
            self._cells = cells
            self._together = largest_group(grid, cells)
            if self._together < len(cells):
                self._gathered_at = None
            elif self._gathered_at is None:
                self._gathered_at = now
        return False

    def died(self, death: Death) -> None:
        """Leave a dead robot out: the living are to gather."""
        self._dead.add(death.robot)

    def verdict(self, now: Time) -> dict[str, float]:
        """Return the share of the living that stand together, since when all do, and how far from their centre."""
        if not len(self._places):
            return {"gathered": math.nan, "time_to_gather_s": math.nan, "spread_m": math.nan}
        offsets = self._places - self._places.mean(axis=0)
        return {
            "gathered": self._together / len(self._cells),
            "time_to_gather_s": math.nan if self._gathered_at is None else to_seconds(self._gathered_at),
            "spread_m": float(np.sqrt((offsets**2).sum(axis=1).mean())),
        }


OF_COVERAGE: Final = {"coverage", "time_to_cover_s", "overlap_ratio"}
"""Metrics of Pseudonet without a meaning for a team that gathers."""

METRICS: Final = (
    Metric("gathered", "1", "share of the living robots that stand together at the end, each beside another"),
    Metric("time_to_gather_s", "s", "since when all of them do; NaN if they do not"),
    Metric("spread_m", "m", "distance of the living robots from their common centre at the end, root mean square"),
    *(metric for metric in pseudonet.METRICS if metric.name not in OF_COVERAGE),
)


class Parameters(TeamParameters):
    """Parameters of gathering, in which a team comes together round its most central robot."""


def make(parameters: Parameters, setup: Setup, me: Address, stream: np.random.Generator, start: Time) -> Pseudonet:
    """Return the machine of robot *me*: Pseudonet's, with another coordination layer."""
    coordination = GatheringCoordination(setup, me, parameters.rounds)
    return Pseudonet(parameters, setup, me, coordination, parameters.step_limit, start)


def referee(parameters: Parameters, setup: Setup, surroundings: Surroundings) -> GatheringReferee:
    """Return the judge of gathering."""
    return GatheringReferee(setup)


SPEC = ProtocolSpec(
    name="gathering",
    about="A team comes together round its most central robot, step by step, by Pseudonet's messages.",
    parameters=Parameters,
    place=pseudonet.place,
    prepare=pseudonet.prepare,
    make=make,
    referee=referee,
    metrics=METRICS,
    measure=pseudonet.measure,
    over_time=("gathered", "spread_m"),
    events=EVENTS,
    decode=pseudonet.decode,
    believes=Pseudonet.believed,
    team_limit=pseudonet.TEAM_LIMIT,
)
