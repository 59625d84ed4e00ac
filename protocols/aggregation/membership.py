"""A searcher's side of a sub-team: whose it is, whom it has asked to be taken in, which plans of hosts it knows.

Memberships are told apart by an epoch, which the searcher chooses: greater than any before, and the time in seconds at
least, so that one that has been rebooted and remembers nothing outdoes what it was before. (Who joins, is rebooted, and
joins another host within a second is in two lists until one of them forgets it.)
"""

from cosim.machine import Address
from cosim.units import S, Time
from protocols.aggregation.counts import COUNTS
from protocols.aggregation.course import Course, course_of
from protocols.aggregation.messages import Plans


class Membership:
    """Whose sub-team a searcher is in."""

    def __init__(self, host: Address | None, epoch: int) -> None:
        """Begin in the sub-team of *host*, or in none."""
        self.host = host
        self.epoch = epoch
        self.asked: Address | None = None
        """The host that has been asked, and has not confirmed yet."""
        self.former: dict[Address, int] = {}
        """Hosts that have to be told that the searcher has left, and how often yet."""
        self.courses: dict[Address, Course] = {}
        """The last plan of each host."""
        self.plans = 0
        """The version of the own host's plans, as it counts them."""
        self._asked_epoch = epoch

    def ask(self, host: Address, now: Time) -> int:
        """Return the epoch with which to ask *host*, the same until another is asked."""
        if self.asked != host:
            self.asked = host
            self._asked_epoch = min(max(self._asked_epoch + 1, now // S), COUNTS - 1)
        return self._asked_epoch

    def confirmed(self, host: Address, epoch: int) -> bool:
        """Take a confirmation; return whether *host* is the own host from now on, and was not before.

        One that comes late, after another host has been asked, counts for nothing: that host is told so.
        """
        if host == self.host:
            return False
        if host != self.asked or epoch != self._asked_epoch:
            self.former[host] = LEAVES
            return False
        if self.host is not None:
            self.former[self.host] = LEAVES
        self.former.pop(host, None)
        self.host, self.epoch, self.asked, self.plans = host, epoch, None, 0
        return True

    def leaves(self, host: Address) -> bool:
        """Return whether *host*, which has just been heard, is to be told (once more) that the searcher has left."""
        left = self.former.get(host, 0)
        if left == 1:
            del self.former[host]
        elif left:
            self.former[host] = left - 1
        return left > 0

    def learn(self, sender: Address, message: Plans, now: Time) -> None:
        """Take plans that *sender*, a host, has told: its own first, then those of its neighbours as far as newer."""
        for plan in message.plans:
            course = course_of(plan, now)
            known = self.courses.get(plan.host)
            if plan.host == sender or known is None or known.departed < course.departed:
                self.courses[plan.host] = course
        if sender == self.host:
            self.plans = message.plans[0].version


LEAVES = 3
"""How often a host that was left is told so, when it is heard: its sub-team's list is mended by the others, too."""
