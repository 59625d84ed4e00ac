"""What a searcher has still to tell its host: everything that changed since the report that the host has a receipt for.

A report holds all that the searcher knows, so a lost one needs no repetition of its own: the next one, at the next
heartbeat that is heard, says the same and more.
"""

from protocols.aggregation.counts import COUNTS
from protocols.aggregation.findings import Findings
from protocols.aggregation.frames import bitmap
from protocols.aggregation.messages import Report


class Reports:
    """The reports of one searcher."""

    def __init__(self, findings: Findings, posts: int) -> None:
        self._findings = findings
        self._posts = posts
        self._told = -1
        """The state of the findings that the host has."""
        self._told_targets = 0
        self._sent: dict[int, tuple[int, int]] = {}
        """Reports on their way: number -> (state, targets)."""
        self._number = 0

    @property
    def pending(self) -> bool:
        """Whether the host lacks something, or has never been told anything."""
        return self._told != self._findings.changes

    @property
    def finds(self) -> bool:
        """Whether the host lacks a target."""
        return len(self._findings.targets) > self._told_targets

    def anew(self) -> None:
        """Have everything told again: to another host."""
        self._told = -1
        self._told_targets = 0
        self._sent.clear()

    def make(self, epoch: int) -> Report:
        """Return a report of all that is known."""
        self._number = (self._number + 1) % COUNTS
        known = self._findings
        self._sent[self._number] = known.changes, len(known.targets)
        return Report(self._number, epoch, known.all_targets(), bitmap(known.visited, self._posts))

    def received(self, number: int) -> None:
        """Take the host's receipt."""
        state = self._sent.pop(number, None)
        if state is not None:
            self._told, self._told_targets = max(self._told, state[0]), max(self._told_targets, state[1])
            self._sent = {each: other for each, other in self._sent.items() if other[0] > state[0]}
