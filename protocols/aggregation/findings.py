"""What a robot knows of the task: posts visited, targets found, and what of that a searcher still has to report.

A report holds all that the searcher knows, so a lost one needs no repetition of its own: the next one, at the next
heartbeat that is heard, holds the same and more. Only targets may be kept back for a time.
"""

from collections.abc import Iterable, Sequence

from cosim.geometry.planning import Point
from cosim.observation import Observation
from protocols.aggregation.frames import COUNTS, bitmap
from protocols.aggregation.messages import Finding, Report


class Findings:
    """A map of the task that only grows: posts visited and targets found."""

    def __init__(self) -> None:
        self.visited: set[int] = set()
        self.targets: dict[int, Finding] = {}
        self.changes = 0
        """Number of times that something new was added."""

    def visit(self, posts: Iterable[int]) -> bool:
        """Add visited posts; return True if one of them is new."""
        before = len(self.visited)
        self.visited.update(posts)
        grown = len(self.visited) > before
        self.changes += grown
        return grown

    def add(self, findings: Iterable[Finding]) -> list[Finding]:
        """Add findings; return those whose targets are new."""
        new = [finding for finding in findings if finding.number not in self.targets]
        for finding in new:
            self.targets[finding.number] = finding
        self.changes += bool(new)
        return new

    def all_targets(self) -> tuple[Finding, ...]:
        """Return all known targets in the order of their numbers."""
        return tuple(self.targets[number] for number in sorted(self.targets))


class Camera:
    """Recognises targets that are in range and in sight.

    What it sees is decided by where the robot truly is, and a target is found where it appears by the robot's own pose.
    The camera holds the true places only to look there: no decision rests on them.
    """

    def __init__(self, targets_m: Sequence[Point], range_m: float) -> None:
        self._targets_m = targets_m
        self._left = [*range(len(targets_m))]
        """Numbers of the targets that were not known when it looked last."""
        self._left_m = [*targets_m]
        """Where they are."""
        self._range_m = range_m

    def look(self, observation: Observation, known: Findings) -> list[Finding]:
        """Return the targets in view that are not *known*."""
        if len(self._left) + len(known.targets) != len(self._targets_m):  # what is known only grows
            self._left = [number for number in range(len(self._targets_m)) if number not in known.targets]
            self._left_m = [self._targets_m[number] for number in self._left]
        seen = observation.detects(self._left_m, self._range_m)
        if not any(seen):  # asked every tick, when hardly ever one is: zip takes twice as long
            return []
        return [Finding(number, *place) for number, place in zip(self._left, seen, strict=True) if place is not None]


class Reports:
    """What one searcher still has to report to its host: all that changed since the last report with a receipt."""

    def __init__(self, findings: Findings, posts: int) -> None:
        self._findings = findings
        self._posts = posts
        self._confirmed = -1
        """Version of the findings that the host has confirmed; -1 for none."""
        self._confirmed_targets = 0
        self._sent: dict[int, tuple[int, int]] = {}
        """Reports without a receipt: number -> (version, number of targets)."""
        self._number = 0
        self.withholds = False
        """True while targets are kept back: reports then hold only where the searcher has been."""

    @property
    def pending(self) -> bool:
        """True if the host lacks something that is not kept back, or has not confirmed anything yet."""
        return self._confirmed != self._findings.changes or (self.finds and not self.withholds)

    @property
    def finds(self) -> bool:
        """True if the host lacks a target."""
        return len(self._findings.targets) > self._confirmed_targets

    def reset(self) -> None:
        """Report everything again, to another host."""
        self._confirmed = -1
        self._confirmed_targets = 0
        self._sent.clear()

    def make(self, epoch: int) -> Report:
        """Return a report of all findings that are not kept back."""
        self._number = (self._number + 1) % COUNTS
        known = self._findings
        targets = () if self.withholds else known.all_targets()
        self._sent[self._number] = known.changes, len(targets)
        return Report(self._number, epoch, targets, bitmap(known.visited, self._posts))

    def received(self, number: int) -> None:
        """Process the host's receipt."""
        state = self._sent.pop(number, None)
        if state is not None:
            self._confirmed = max(self._confirmed, state[0])
            self._confirmed_targets = max(self._confirmed_targets, state[1])
            # of two reports of one version the later has more if finds were kept back before
            self._sent = {each: other for each, other in self._sent.items() if other > state}
