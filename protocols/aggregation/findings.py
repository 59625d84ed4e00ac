"""What a robot knows of the task: which posts have been visited, and which targets have been found where."""

import math
from collections.abc import Iterable, Sequence

from cosim.geometry.planning import Point
from cosim.observation import Observation
from protocols.aggregation.messages import Finding


class Findings:
    """A map of the task that only grows: posts visited, targets found."""

    def __init__(self) -> None:
        self.visited: set[int] = set()
        self.targets: dict[int, Finding] = {}
        self.changes = 0
        """How often something new came in."""

    def visit(self, posts: Iterable[int]) -> bool:
        """Note visited posts; return whether one was not known."""
        before = len(self.visited)
        self.visited.update(posts)
        grown = len(self.visited) > before
        self.changes += grown
        return grown

    def add(self, findings: Iterable[Finding]) -> list[Finding]:
        """Note findings; return those of targets that were not known."""
        new = [finding for finding in findings if finding.number not in self.targets]
        for finding in new:
            self.targets[finding.number] = finding
        self.changes += bool(new)
        return new

    def all_targets(self) -> tuple[Finding, ...]:
        """Return what is known of targets, in the order of their numbers."""
        return tuple(self.targets[number] for number in sorted(self.targets))


class Camera:
    """Recognises targets that are in range and in sight: it is asked about places, and knows nothing else of them."""

    def __init__(self, targets_m: Sequence[Point], range_m: float) -> None:
        self._places_m = dict(enumerate(targets_m))
        self._range_m = range_m

    def look(self, observation: Observation, known: Findings) -> list[Finding]:
        """Return the targets in view that are not *known*."""
        x, y = observation.x_m, observation.y_m
        near = [
            number
            for number, (target_x, target_y) in self._places_m.items()
            if math.hypot(target_x - x, target_y - y) <= self._range_m
        ]
        if not near:
            return []
        near = [number for number in near if number not in known.targets]
        seen = observation.sees([self._places_m[number] for number in near])
        return [Finding(number, *self._places_m[number]) for number, there in zip(near, seen, strict=True) if there]
