"""The setup of a deployment, which all robots know beforehand: the floor, the team and the plays."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from cosim.documents import read_yaml, validated
from cosim.errors import UserError
from cosim.geometry.polylines import middle
from cosim.machine import Address
from cosim.protocol import Surroundings, check_cells
from cosim.units import Time
from protocols.deployment.driving.exploring import Ground, ground_of
from protocols.deployment.member.camera import half_turn_s
from protocols.deployment.parameters import Parameters
from protocols.deployment.planning.play import Play
from protocols.deployment.planning.playbook import BUILT_IN, Playbook
from protocols.deployment.tasks.crew import Body, Crew
from protocols.deployment.tasks.plan import Place
from protocols.localization.positioning import KnownMaps
from protocols.motion.floor import Floor

_LINES: Final = 6
"""Number of lines, in each direction, of the lattice of places all over a floor."""


@dataclass(frozen=True, eq=False)
class Setup:
    """The floor, the team and the plays of a run."""

    size: int
    tick: Time
    floor: Floor
    crew: Crew
    playbook: Playbook
    starts_m: tuple[Place, ...]
    beams: int
    """Number of beams of a scanner."""
    named_m: dict[str, tuple[Place, ...]]
    """Places that the floor names."""
    floors: tuple[Floor, ...]
    """Floor of each robot; robots with cells of the same size share one, also with the planner."""
    maps: KnownMaps
    """Floor as maps on which robots localise."""
    ground: Ground
    """What robots that explore know beforehand."""

    def far_m(self) -> tuple[Place, ...]:
        """Return the farthest places from base that all robots can get to, at most one per robot.

        They are chosen among named places and a lattice over the whole floor.
        """
        radius_m, base_m = max(body.radius_m for body in self.crew.bodies), self.crew.base_m
        x_min, y_min, x_max, y_max = self.floor.bounds_m
        shares = [(each + 0.5) / _LINES for each in range(_LINES)]
        lattice = [(x_min + a * (x_max - x_min), y_min + b * (y_max - y_min)) for a in shares for b in shares]
        named = [place for places in self.named_m.values() for place in places]
        back = self.floor.field(radius_m, base_m)
        far = {place: back.distance_m(place) for place in (*named, *lattice) if self.floor.free(radius_m, place)}
        places = sorted((place for place in far if 0.0 < far[place] < math.inf), key=lambda place: -far[place])
        return tuple(places[: self.size])


def setup_of(parameters: Parameters, surroundings: Surroundings) -> Setup:
    """Return the setup of a run; raise UserError for parameters that do not fit the team or the floor."""
    size = len(surroundings.starts_m)
    _check_robots(parameters, size)
    check_cells(surroundings, parameters.driving.cell_m, "protocol.parameters.driving.cell_m")
    for number, cell_m in enumerate(parameters.cells_m or ()):
        check_cells(surroundings, cell_m, f"protocol.parameters.cells_m[{number}]")
    floor = Floor.of(surroundings, parameters.driving)
    bodies = _bodies(parameters, surroundings, size)
    ground = ground_of(parameters.exploring, surroundings)
    if parameters.map == "learned" and ground.why_not:
        raise UserError(f"protocol.parameters.map: learned, but {ground.why_not}")
    return Setup(
        size=size,
        tick=surroundings.tick,
        floor=floor,
        crew=Crew(bodies, _base_m(parameters, floor, bodies, surroundings.starts_m)),
        playbook=_playbook(parameters),
        starts_m=tuple((float(x), float(y)) for x, y in surroundings.starts_m),
        beams=surroundings.beams,
        named_m={name: tuple(places) for name, places in surroundings.places_m.items()},
        floors=_floors(parameters, surroundings, floor, size),
        maps=KnownMaps(surroundings),
        ground=ground,
    )


def _check_robots(parameters: Parameters, size: int) -> None:
    named: dict[str, Sequence[Address]] = {
        "host": (parameters.host,),
        "cameras": parameters.cameras or (),
        "sonars": parameters.sonars,
    }
    for name, robots in named.items():
        for robot in robots:
            if not 0 <= robot < size:
                raise UserError(f"protocol.parameters.{name}: {robot} is not one of 0 to {size - 1}, the team's robots")

    if parameters.cells_m is not None and len(parameters.cells_m) != size:
        raise UserError(f"protocol.parameters.cells_m: {len(parameters.cells_m)} sizes are given for {size} robots")


def _floors(parameters: Parameters, surroundings: Surroundings, common: Floor, size: int) -> tuple[Floor, ...]:
    known = {parameters.driving.cell_m: common}
    cells_m = parameters.cells_m or (parameters.driving.cell_m,) * size
    for cell_m in cells_m:
        if cell_m not in known:
            known[cell_m] = Floor.of(surroundings, parameters.driving.model_copy(update={"cell_m": cell_m}))
    return tuple(known[cell_m] for cell_m in cells_m)


def _bodies(parameters: Parameters, surroundings: Surroundings, size: int) -> tuple[Body, ...]:
    radii_m = surroundings.radii_m or (surroundings.radius_m,) * size
    speeds_mps = surroundings.speeds_mps or (surroundings.speed_mps,) * size
    accelerations = surroundings.accelerations_mps2 or (surroundings.acceleration_mps2,) * size
    return tuple(
        Body(
            radius_m=radii_m[robot],
            speed_mps=speeds_mps[robot],
            acceleration_mps2=accelerations[robot],
            half_turn_s=half_turn_s(parameters.member.look_radps),
            camera=parameters.cameras is None or robot in parameters.cameras,
            sensor="sonar" if robot in parameters.sonars else "laser",
        )
        for robot in range(size)
    )


def _playbook(parameters: Parameters) -> Playbook:
    own = () if parameters.library is None else (Path(parameters.library),)
    return Playbook.read([BUILT_IN, *own], _read)


def _read(path: Path) -> Play:
    return validated(Play, read_yaml(path), str(path))


def _base_m(parameters: Parameters, floor: Floor, bodies: Sequence[Body], starts_m: Sequence[Place]) -> Place:
    """Return the place of base: as given, or the middle of the starts, or the start next to that."""
    radius_m = max(body.radius_m for body in bodies)
    if parameters.base_m is not None:
        if not floor.free(radius_m, parameters.base_m):
            raise UserError(f"protocol.parameters.base_m: {parameters.base_m} is no place for a robot of {radius_m} m")
        return parameters.base_m
    centre = middle(list(starts_m))
    if floor.free(radius_m, centre):
        return centre
    return min(starts_m, key=lambda start: (math.dist(start, centre), start))
