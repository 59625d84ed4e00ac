"""The book of goals: whose goal is where, and how good that knowledge is (paper 000, section 3.1, rules 1 and 2).

A robot's k-th goal bears the identifier Id = k M in a team of M; every robot that passes the goal on makes it one less.
So k = 1 + (Id - 1) div M, and Id - (k - 1) M is M if the owner itself has told the goal, and smaller the more robots
have handled it, each of which has added its error. A report is accepted if its Id is greater than or equal to that of
what is stored: if the goal is newer, or comes by no more hands. The equal case refreshes it.

What was told by as many hands as the team has is not passed on: one less would be an Id of the goal before.
"""

from enum import IntEnum
from typing import Final

from cosim.machine import Address


class Verdict(IntEnum):
    """What becomes of a report."""

    REFUSED = 0
    """Older than what is known, or by more hands."""
    REFRESHED = 1
    """The same goal: its place is that of this report now."""
    NEW = 2
    """The owner has another goal now."""


REFUSED: Final = Verdict.REFUSED  # Python 3.11 finds a member in its class ten times slower than a name in its module
REFRESHED: Final = Verdict.REFRESHED
NEW: Final = Verdict.NEW


def goal_number(identifier: int, team: int) -> int:
    """Return which of its owner's goals, from 1, *identifier* means in a *team* of M robots."""
    return 1 + (identifier - 1) // team


def handlings(identifier: int, team: int) -> int:
    """Return by how many robots the goal has been handed on: 0 if its owner has told it."""
    return team - (identifier - (goal_number(identifier, team) - 1) * team)


class GoalBook:
    """One robot's knowledge of everybody's current goal: an Id (0: none) and a place for each owner, O(M) in all."""

    def __init__(self, me: Address, team: int) -> None:
        self.me = me
        self.team = team
        self.identifiers = [0] * team
        self.x_m = [0.0] * team
        """Places in the own frame, metres."""
        self.y_m = [0.0] * team
        self.known: list[Address] = []
        """Whose goals are known, in order of addresses."""

    def set_own(self, number: int, x_m: float, y_m: float) -> None:
        """Make (x, y) this robot's goal *number*, from 1."""
        self._store(self.me, number * self.team, x_m, y_m)

    def clear_own(self) -> None:
        """Have no goal any more."""
        self.identifiers[self.me] = 0
        self.known = [owner for owner in self.known if owner != self.me]

    def consider(self, owner: Address, identifier: int, x_m: float, y_m: float) -> Verdict:
        """Take the report of *owner*'s goal if it is as good as what is known; nobody else knows better about mine."""
        stored = self.identifiers[owner]
        if owner == self.me or identifier < stored:
            return REFUSED
        newer = stored == 0 or (identifier - 1) // self.team > (stored - 1) // self.team
        self._store(owner, identifier, x_m, y_m)
        return NEW if newer else REFRESHED

    def number(self, owner: Address) -> int:
        """Return which of its goals *owner* has as far as is known, from 1; 0 if nothing is."""
        return 1 + (self.identifiers[owner] - 1) // self.team

    def told_as(self, owner: Address) -> int:
        """Return the Id that this robot tells *owner*'s goal with; 0 if it is not to be passed on."""
        identifier = self.identifiers[owner]
        if owner == self.me:
            return identifier
        return identifier - 1 if (identifier - 1) % self.team else 0

    def _store(self, owner: Address, identifier: int, x_m: float, y_m: float) -> None:
        if not self.identifiers[owner]:
            self.known = sorted([*self.known, owner])
        self.identifiers[owner] = identifier
        self.x_m[owner] = x_m
        self.y_m[owner] = y_m
