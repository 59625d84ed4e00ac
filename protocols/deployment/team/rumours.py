"""What a robot has heard by others' news, but has not been told: of later plans, and that its own is over.

A host may die between its news of a plan and the letter with it. If nobody who lives knows that plan it is lost, and
whoever leads then may begin another one; but never by the same number, as somebody may still be at orders of the lost.
"""

from cosim.machine import Address
from cosim.units import Time
from protocols.deployment.team.succession import Succession, WhenHeard


class Rumours:
    """What the latest news of each other robot say."""

    def __init__(self, near: Time) -> None:
        """Doubt that a host lives of which nothing was heard for *near*."""
        self.over = False
        """Whether the host has said that the play is over that is known here."""
        self.doubtful = False
        """Whether nothing was heard of the host lately: it may have died before it could say so."""
        self._near = near
        self.newest = 0
        """The greatest number of a plan that was ever heard of."""
        self._plans: dict[Address, int] = {}
        self._calls: dict[Address, tuple[int, int]] = {}
        """How many of the scenario's calls have been dealt with, after the number of the plan of who says so."""
        self._dealt = 0

    def hear(self, source: Address, plan: int, calls: int) -> None:
        """Take that *source* knows the *plan* of that number, and that so many *calls* have been dealt with."""
        self.newest = max(self.newest, plan)
        self._plans[source] = plan
        self._calls[source] = plan, calls

    def tick(self, succession: Succession, heard: WhenHeard, now: Time) -> None:
        """Forget what those know who have fallen silent: they tell nobody."""
        self.doubtful = not succession.leads and now - heard(succession.host) > self._near
        for robot in [robot for robot in self._plans if succession.silent(robot, heard, now)]:
            del self._plans[robot]

    def awaited(self, number: int) -> bool:
        """Return whether somebody can tell a plan that comes after that of *number*, which is known here."""
        return any(plan > number for plan in self._plans.values())

    def calls(self, number: int) -> int:
        """Return how many calls have been dealt with, by those who know no plan after that of *number*.

        A later plan may be lost, and with it what was called; calls that were refused after that plan count.
        """
        known = [calls for plan, calls in self._calls.values() if plan <= number]
        self._dealt = max([self._dealt, *known])
        return self._dealt
