"""What all explorers of a run know beforehand, and what a robot, or a team that shares all at once, knows of the floor.

``map: shared`` is the papers' baseline: one map in one memory. What a robot sees, where it stands and which targets are
chosen is known to all others in the same instant, without a message. It is the assumption that cosim exists to test,
and the one place where explorers touch each other but by bytes: :attr:`Setup.common`. Everything else in a setup is
constant. With ``map: messages`` each robot has a :class:`WorldModel` of its own, and its messages make it grow.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from cosim.errors import UserError
from cosim.geometry.marking import CERTAIN, DOUBTFUL
from cosim.geometry.planning import Point
from cosim.machine import Address
from cosim.protocol import Surroundings
from cosim.units import Time
from protocols.exploration.parameters import Parameters, SchemaParameters
from protocols.exploration.targets import Targets
from protocols.exploration.terrain import Terrain
from protocols.mapping.belief import Belief, Frame, frame_of
from protocols.mapping.frames import MOST_CELLS
from protocols.transport.links import check_piconet


class WorldModel:
    """A map, and what goes by it: where robots can go, what targets are chosen, where the others are."""

    def __init__(
        self,
        parameters: Parameters,
        frame: Frame,
        radii_m: Sequence[float],
        range_m: float,
        places_m: dict[Address, Point],
    ) -> None:
        """Know nothing of the floor but its *frame*; scans reach *range_m*.

        *places_m*, where robots with bodies of *radii_m* are, is read and not copied: it changes as robots move.
        """
        self.belief = Belief(frame, DOUBTFUL if parameters.counted else CERTAIN, range_m)
        self.terrain = Terrain(self.belief, parameters.escape)
        self.places_m = places_m
        self.targets = (
            None
            if parameters.algorithm == "schemas"
            else Targets(parameters.algorithm, parameters.rivals, self.terrain, radii_m, range_m, places_m)
        )
        """What chooses frontiers; None if none are chosen."""


@dataclass(frozen=True, eq=False)
class Setup:
    """The team, the frame of its maps, and, if the scenario says so, the one world model that all have."""

    size: int
    tick: Time
    frame: Frame
    starts_m: tuple[Point, ...]
    radii_m: tuple[float, ...]
    speeds_mps: tuple[float, ...]
    range_m: float
    """How far the robots' range scanners reach."""
    beams: int
    common: WorldModel | None
    """The memory in common, which all robots read and write at once: the only mutable part of a setup, and the
    assumption that cosim exists to test. None if each robot has a world model of its own."""


def prepare(parameters: Parameters, surroundings: Surroundings) -> Setup:
    """Return what all robots know; raise UserError for a floor that is too large, or for ranges that do not fit."""
    _check_ranges(parameters.schemas, surroundings.scan_range_m)
    x_min, y_min, x_max, y_max = surroundings.bounds_m
    margin_m = parameters.positioning.margin_m
    frame = frame_of((x_min - margin_m, y_min - margin_m, x_max + margin_m, y_max + margin_m), parameters.cell_m)
    if frame.nx * frame.ny > MOST_CELLS:
        raise UserError(f"protocol.parameters.cell_m: {frame.nx} x {frame.ny} cells, at most {MOST_CELLS} in all")
    size, range_m = len(surroundings.starts_m), surroundings.scan_range_m
    if parameters.sharing.links is not None:
        check_piconet(surroundings, "protocol.parameters.sharing.links")
    radii_m = surroundings.radii_m or (surroundings.radius_m,) * size
    places_m = dict(enumerate(surroundings.starts_m))
    return Setup(
        size=size,
        tick=surroundings.tick,
        frame=frame,
        starts_m=tuple(surroundings.starts_m),
        radii_m=radii_m,
        speeds_mps=surroundings.speeds_mps or (surroundings.speed_mps,) * size,
        range_m=range_m,
        beams=surroundings.beams,
        common=WorldModel(parameters, frame, radii_m, range_m, places_m) if parameters.map == "shared" else None,
    )


def _check_ranges(schemas: SchemaParameters, range_m: float) -> None:
    """Raise UserError unless obstacle_m < range < frontier_m (paper 001, sections 3.3 and 3.7)."""
    path, of = "protocol.parameters.schemas", f"{range_m}, team.senses.beam_range_m"
    if not schemas.obstacle_m < range_m:
        raise UserError(f"{path}.obstacle_m: {schemas.obstacle_m} is not < {of} (paper 001, 3.7)")
    if not range_m < schemas.frontier_m:
        raise UserError(f"{path}.frontier_m: {schemas.frontier_m} is not > {of} (paper 001, 3.3)")
