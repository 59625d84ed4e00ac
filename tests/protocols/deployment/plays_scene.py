"""A floor without walls, a team, and the library, for tests of plays."""

import math
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

from cosim.documents import read_yaml, validated
from cosim.machine import Address
from protocols.deployment.planning.planner import Call, Planner, PlannerParameters, Refusal
from protocols.deployment.planning.play import Play
from protocols.deployment.planning.playbook import BUILT_IN, Playbook
from protocols.deployment.planning.timing import LeastExploring
from protocols.deployment.tasks.crew import Body, Crew
from protocols.deployment.tasks.plan import Place, Plan


def reader(path: Path) -> Play:
    return validated(Play, read_yaml(path), str(path))


@cache
def built_in() -> Playbook:
    return Playbook.read([BUILT_IN], reader)


def playbook_of(*folders: Path) -> Playbook:
    return Playbook.read([BUILT_IN, *folders], reader)


class OpenFloor:
    """Ways are straight; within *blocked* (x, y, r) nobody can stand."""

    def __init__(self, blocked: Sequence[tuple[float, float, float]] = ()) -> None:
        self.blocked = blocked
        self.asked = 0

    def length_m(self, radius_m: float, a: Place, b: Place) -> float | None:
        self.asked += 1
        return math.dist(a, b) if self.free(radius_m, a) and self.free(radius_m, b) else None

    def way(self, radius_m: float, a: Place, b: Place) -> list[Place] | None:
        return [a, b] if self.length_m(radius_m, a, b) is not None else None

    def free(self, radius_m: float, at: Place) -> bool:
        return all(math.dist(at, (x, y)) >= r + radius_m for x, y, r in self.blocked)


BODY = Body(radius_m=0.25, speed_mps=0.5, acceleration_mps2=0.5)


class Scene:
    """A team in a row at base, and its planner."""

    def __init__(
        self,
        bodies: Sequence[Body] = (BODY,) * 4,
        floor: OpenFloor | None = None,
        playbook: Playbook | None = None,
        parameters: PlannerParameters | None = None,
        exploring: LeastExploring | None = None,
    ) -> None:
        self.exploring = exploring
        self.floor = floor or OpenFloor()
        self.playbook = playbook or built_in()
        self.parameters = parameters or PlannerParameters()
        self.starts_m: dict[Address, Place] = {robot: (-1.0 * robot, 0.0) for robot in range(len(bodies))}
        self.crew = Crew(tuple(bodies), (0.0, 0.0))
        self.planner = self._planner()

    def _planner(self) -> Planner:
        known = self.parameters, {"hall": [(30.0, 0.0)]}, dict(self.starts_m)
        return Planner(self.playbook, self.crew, self.floor, *known, exploring=self.exploring)

    def join(self, body: Body) -> None:
        """Put one more robot to the base."""
        self.starts_m[len(self.crew.bodies)] = self.crew.base_m
        self.crew = self.crew._replace(bodies=(*self.crew.bodies, body))
        self.planner = self._planner()

    def call(self, play: str, **more: object) -> Plan | Refusal:
        return self.planner.call(Call.model_validate({"play": play, **more}), self.starts_m, 7)

    def plan(self, play: str, **more: object) -> Plan:
        found = self.call(play, **more)
        assert isinstance(found, Plan), found
        return found

    def refusal(self, play: str, **more: object) -> Refusal:
        found = self.call(play, **more)
        assert isinstance(found, Refusal), found
        return found


def paths_of(playbook: Playbook) -> list[str]:
    """Return the paths of all plays and folders of a library."""
    return list(_paths(playbook.root, ""))


def _paths(folder: Play, at: str) -> Iterator[str]:
    for name, play in folder.plays.items():
        yield f"{at}{name}"
        yield from _paths(play, f"{at}{name}/")
