"""What cosim must know of a protocol to run it, and what it tells the protocol of a run: the ends of an entry point.

A :class:`ProtocolSpec` makes machines (:mod:`cosim.machine`) for a team in its :class:`Surroundings`, and a
:class:`Referee` that judges the truth of the run.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Literal, NamedTuple, Protocol

import numpy as np

from cosim.errors import UserError
from cosim.machine import Address, Event, Machine
from cosim.page import WebPage
from cosim.settings import Settings
from cosim.units import Time

MOST_CELLS: Final = 1 << 22
"""Cells of the largest grid that robots plan on: a floor of a kilometre by a kilometre has as many of 0.5 m."""
ATTEMPTS: Final = 10_000
"""The number of places that are tried for a robot."""


class PayloadBytes(NamedTuple):
    """The longest payloads that a radio carries, in bytes; None: any. What is longer is never sent (TOO_LONG)."""

    unicast: int | None = None
    """To one robot."""
    broadcast: int | None = None
    """To everyone."""


class Surroundings(NamedTuple):
    """What a protocol may be told of a run before it starts."""

    starts_m: tuple[tuple[float, float], ...]
    """Where the robots start."""
    radius_m: float
    """Radius of the largest body."""
    speed_mps: float
    """Speed limit of the slowest robot."""
    acceleration_mps2: float
    """Lowest acceleration limit in the team."""
    tick: Time
    """Duration of a world tick."""
    walls_m: np.ndarray[Any, np.dtype[np.float64]]
    """Wall segments, shape (n, 4): x1, y1, x2, y2."""
    bounds_m: tuple[float, float, float, float]
    """Extent of the floor: x_min, y_min, x_max, y_max."""
    forbidden: Callable[[np.ndarray[Any, np.dtype[np.float64]]], np.ndarray[Any, np.dtype[np.bool_]]]
    """points (n, 2) -> True where the floor is occupied, unknown or outside; it knows no bodies and no thin walls."""
    radii_m: tuple[float, ...] = ()
    """Radius of each robot's body."""
    speeds_mps: tuple[float, ...] = ()
    """Speed limit of each robot."""
    accelerations_mps2: tuple[float, ...] = ()
    """Acceleration limit of each robot."""
    frames: tuple[tuple[float, float, float], ...] = ()
    """Origin (x, y, m) and direction (rad) in the world of each robot's own frame."""
    places_m: Mapping[str, tuple[tuple[float, float], ...]] = MappingProxyType({})
    """Points that the floor names: rooms, for example."""
    seed: int = 0
    """The seed of the run: it differs from replicate to replicate, not between the arms of one."""
    scan_range_m: float = 0.0
    """How far the robots' range scanners reach."""
    beams: int = 0
    """How many beams a scan has."""
    radios: tuple[tuple[int, ...], ...] = ()
    """The numbers of each robot's radios."""
    links: tuple[int | None, ...] = ()
    """The most links that a radio can hold at once as their master, by the number of the radio.

    None where that has no limit, or a radio needs no links; () where nothing is known of radios.
    """
    payload_bytes: tuple[PayloadBytes, ...] = ()
    """The longest payloads of each radio, by its number."""
    shares: tuple[bool, ...] = ()
    """Whether a radio can divide its time among piconets as ``Share`` says, or need not, by its number."""
    odometry_errs: bool = False
    """True if robots do not know how they have moved exactly."""
    fits: Callable[[tuple[float, float], float], bool] = lambda place_m, radius_m: True
    """(place, radius of a body, both in m) -> whether the body has room there, as starts must: thin walls count too."""


def check_cells(surroundings: Surroundings, cell_m: float, setting: str) -> None:
    """Raise UserError, naming *setting*, unless a grid of the floor with cells of *cell_m* has 1 to MOST_CELLS."""
    x_min, y_min, x_max, y_max = surroundings.bounds_m
    columns, rows = (max(0, math.floor(extent / cell_m + 1e-9)) for extent in (x_max - x_min, y_max - y_min))
    if not 1 <= columns * rows <= MOST_CELLS:
        cells = f"{columns} x {rows} cells of this floor"
        raise UserError(f"{setting}: {cell_m:g} makes {cells}, expected 1 to {MOST_CELLS} in all")


class Death(NamedTuple):
    """What a referee is told of a robot that a fault has killed, once its body has come to rest."""

    robot: Address
    at: Time
    """When its host died."""
    x_m: float
    """Where the body rests."""
    y_m: float
    radius_m: float


def anywhere(
    parameters: Any, surroundings: Surroundings, size: int, stream: np.random.Generator
) -> list[tuple[float, float]]:
    """Put each robot where chance will have it, with room for its body: for a ``place`` that wants nothing else.

    Raise UserError if there is no such place.
    """
    x_min, y_min, x_max, y_max = surroundings.bounds_m
    radii_m = np.array(surroundings.radii_m or (surroundings.radius_m,) * size)
    x_m, y_m = np.empty(len(radii_m)), np.empty(len(radii_m))
    for robot, radius_m in enumerate(radii_m.tolist()):
        for _ in range(ATTEMPTS):
            x, y = float(stream.uniform(x_min, x_max)), float(stream.uniform(y_min, y_max))
            dx_m, dy_m = x_m[:robot] - x, y_m[:robot] - y
            away_m = np.sqrt(dx_m * dx_m + dy_m * dy_m)
            if (away_m > radius_m + radii_m[:robot]).all() and surroundings.fits((x, y), radius_m):
                x_m[robot], y_m[robot] = x, y
                break
        else:
            raise UserError(f"team.starts: found no place for robot {robot}; say where robots start")
    return list(zip(x_m.tolist(), y_m.tolist(), strict=True))


class CellMap(NamedTuple):
    """A map of cells that a machine has made of the floor."""

    cells: np.ndarray[Any, np.dtype[np.int8]]
    """Shape (rows, columns), row 0 at the bottom: 0 where nothing is known, below 0 what is empty, above 0 occupied."""
    corner_m: tuple[float, float]
    """The lower left corner of the first cell."""
    cell_m: float
    version: int
    """Another number whenever the cells have changed."""
    common: bool = False
    """True if all machines of the team have this one in common."""


class PoseEstimate(NamedTuple):
    """Where a machine takes its robot to be, and the covariance of that place, m^2; NaN where it knows none."""

    x_m: float
    y_m: float
    heading_rad: float
    xx_m2: float = math.nan
    xy_m2: float = math.nan
    yy_m2: float = math.nan


class Belief(NamedTuple):
    """What a machine believes, for people who look on: nothing in the run depends on it."""

    map: CellMap | None = None
    way_m: Sequence[tuple[float, float]] = ()
    """The points by which the robot means to go from where it is; empty if it follows no path."""
    goal_m: tuple[float, float] | None = None
    """Where it wants to get to in the end; None if nowhere, or if it does not know where that is."""
    estimate: PoseEstimate | None = None
    """What it has worked out of its own place; None if it takes what it observes."""
    frame: Literal["own", "world"] = "own"
    """Whose frame all of this is in: that of the robot's observations, or the world's, if the machine knows that."""


class Referee(Protocol):
    """Judge of the truth of one run: sees the bodies, and hears what machines report, but not what they believe."""

    def look(
        self, x_m: np.ndarray[Any, np.dtype[np.float64]], y_m: np.ndarray[Any, np.dtype[np.float64]], now: Time
    ) -> bool:
        """Note the robots' true positions (metres) at a tick; return whether the run is over."""

    def note(self, robot: Address, event: Event, now: Time) -> None:
        """Note an event of a machine, also an ``Unrecorded`` one, at the true time *now*, before the next ``look``."""
        return  # who derives from this class need not hear it

    def died(self, death: Death) -> None:
        """Note that a robot is dead, and where its body rests for ever; before the ``look`` of the same tick."""
        return

    def verdict(self, now: Time) -> dict[str, float]:
        """Return the metrics that the truth decides, by name."""


class Metric(NamedTuple):
    """A column of the table of runs: its name, unit and meaning."""

    name: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class ProtocolSpec:
    """What an entry point of the group ``cosim.protocols`` names: all that cosim must know of a protocol."""

    name: str
    parameters: type[Settings]
    """Model of the protocol's parameters in a scenario."""
    place: Callable[[Any, Surroundings, int, np.random.Generator], Sequence[tuple[float, float]]]
    """(parameters, surroundings without starts, team size, random stream) -> starts, where the scenario gives none.

    ``anywhere`` will do for many.
    """
    prepare: Callable[[Any, Surroundings], Any]
    """(parameters, surroundings) -> setup: what all machines of a run know beforehand; computed once a run.

    Raises UserError when the protocol cannot run there.
    """
    make: Callable[[Any, Any, Address, Any, Time], Machine]
    """(parameters, setup, own address, random stream, start time) -> a machine."""
    referee: Callable[[Any, Any, Surroundings], Referee]
    """(parameters, setup, surroundings) -> the judge of one run."""
    metrics: tuple[Metric, ...]
    """The columns that ``measure`` and the referee fill."""
    measure: Callable[[Sequence[Any]], dict[str, float]]
    """(machines) -> the metrics that the machines count themselves."""
    events: tuple[type, ...]
    """The event types, frozen dataclasses, that the machines emit."""
    notices: tuple[type, ...] = ()
    """Those of the event types that a person is to be told of: ``cosim run`` prints what ``str`` makes of them."""
    over_time: tuple[str, ...] = ()
    """Metrics of the referee that are worth to be followed: its ``verdict`` may be asked for at any tick, and again.

    They are rows of the table ``metrics``, and curves of the timeline.
    """
    about: str = ""
    """What its robots do, in a sentence for ``cosim list``."""
    team_limit: int | None = None
    """The largest team that the protocol can address."""
    radio: int | None = 0
    """The number of the radio that its robots send by, so that each must have it; None if some can do without."""
    succeed: Callable[[Any, Any, Time], None] | None = None
    """(a crashed host's machine, the one that boots in its place, the true time): hand over what the metrics count."""
    needs_sight: bool = False
    """Observations name the robots in sight."""
    needs_view: bool = False
    """Observations tell as well where robots are seen, how far the walls are, and what points are in sight."""
    rehearsal: Callable[[Sequence[Any]], Sequence[Any]] | None = None
    """(machines) -> what an operator may say at all consoles, JSON data, so that robots do what he mostly wants.

    It is said in a run that is thrown away: nobody is to wait for the kernels that it needs.
    """
    decode: Callable[[Any, int, bytes], Any] | None = None
    """(parameters, team size, a payload) -> what it says, for who looks at a frame; WireError if it says nothing.

    That is a NamedTuple, a dataclass, a pydantic model, a mapping or a text; :mod:`cosim.decoding` makes plain data of
    it. The bytes may be any.
    """
    believes: Callable[[Any], Belief] | None = None
    """(machine) -> what it believes now, for who looks at the run. It is asked at any tick, and changes nothing."""
    page: WebPage | None = None
    """The page that the operator of such a run is shown; None if the protocol brings none."""
