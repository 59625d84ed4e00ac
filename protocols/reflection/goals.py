"""The book of goals: where each robot's goal is, and how far to trust that (paper 000, section 3.1, rules 1 and 2).

A robot's k-th goal bears the identifier Id = k M in a team of M; every robot that passes the goal on makes it one less.
So k = 1 + (Id - 1) div M, and Id - (k - 1) M is M if the owner itself has sent the goal, and smaller the more robots
have passed it on, each of which has added its error. A report is accepted if its Id is greater than or equal to that of
what is stored: if the goal is newer, or has passed through no more robots. The equal case refreshes it.

A goal that as many robots have passed on as the team has is not passed on: one less would be an Id of the goal before.
"""

from enum import IntEnum
from typing import Final

from cosim.machine import Address


class Verdict(IntEnum):
    """The outcome of a report."""

    REFUSED = 0
    """The report is older than what is known, or has passed through more robots."""
    REFRESHED = 1
    """The goal is the same, and takes the place of this report."""
    NEW = 2
    """The owner has another goal."""


REFUSED: Final = Verdict.REFUSED  # Python 3.11 finds a member in its class ten times slower than a name in its module
REFRESHED: Final = Verdict.REFRESHED
NEW: Final = Verdict.NEW


def goal_number(identifier: int, team: int) -> int:
    """Return the number of a goal, from 1, among its owner's, given its *identifier* in a *team* of M robots."""
    return 1 + (identifier - 1) // team


def handlings(identifier: int, team: int) -> int:
    """Return the number of robots that have passed the goal on: 0 if its owner has sent it."""
    return team - (identifier - (goal_number(identifier, team) - 1) * team)


class GoalBook:
    """One robot's knowledge of each robot's current goal: an Id (0: none) and a place for each owner, O(M) in all."""

    def __init__(self, me: Address, team: int) -> None:
        self.me = me
        self.team = team
        self.identifiers = [0] * team
        self.x_m = [0.0] * team
        """Places in the own frame, metres."""
        self.y_m = [0.0] * team
        self.known: list[Address] = []
        """Owners of known goals, in order of addresses."""

    def set_own(self, number: int, x_m: float, y_m: float) -> None:
        """Make (x, y) this robot's goal *number*, from 1."""
        self._store(self.me, number * self.team, x_m, y_m)

    def clear_own(self) -> None:
        """Remove this robot's goal."""
        self.identifiers[self.me] = 0
        self.known = [owner for owner in self.known if owner != self.me]

    def consider(self, owner: Address, identifier: int, x_m: float, y_m: float) -> Verdict:
        """Take the report of *owner*'s goal if it is as good as what is known; the own goal is known best here."""
        stored = self.identifiers[owner]
        if owner == self.me or identifier < stored:
            return REFUSED
        newer = stored == 0 or (identifier - 1) // self.team > (stored - 1) // self.team
        self._store(owner, identifier, x_m, y_m)
        return NEW if newer else REFRESHED

    def number(self, owner: Address) -> int:
        """Return the number of *owner*'s current goal as far as is known, from 1; 0 if none is known."""
        return 1 + (self.identifiers[owner] - 1) // self.team

    def sent_as(self, owner: Address) -> int:
        """Return the Id with which this robot sends *owner*'s goal; 0 if it is not to be passed on."""
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
