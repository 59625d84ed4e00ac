"""Who is in which sub-team: the host's roster of its searchers, and the searcher's side, its membership.

Memberships are distinguished by an epoch, which the searcher chooses: greater than any before, and at least the time in
seconds, so that a searcher that has been rebooted and remembers nothing supersedes its former membership. (A searcher
that joins, is rebooted, and joins another host within a second is in two rosters until one of them forgets it.)
"""

from collections.abc import Collection

from cosim.geometry.planning import Point
from cosim.machine import Address
from cosim.units import S, Time
from protocols.aggregation.course import Course, course_of
from protocols.aggregation.frames import COUNTS, following, instant
from protocols.aggregation.messages import Plans

LEAVES = 3
"""Number of times that a host that was left is sent a Leave when it is heard; other hosts correct its roster, too."""


class Member:
    """A searcher of the sub-team."""

    def __init__(self, epoch: int, now: Time) -> None:
        self.epoch = epoch
        self.heard = now
        self.place_m: Point | None = None
        self.number = 0
        """Number of its last assignment; 0 before the first."""
        self.posts: tuple[int, ...] = ()
        self.stopped = False
        self.round = -1
        """Round of the last meeting that it came to."""

    def give(self, posts: tuple[int, ...]) -> None:
        """Assign *posts* to it."""
        self.posts = posts
        self.number = following(self.number)

    def left(self, visited: Collection[int]) -> tuple[int, ...]:
        """Return its posts that are not *visited*."""
        return tuple(post for post in self.posts if post not in visited)


class Roster:
    """The members of one sub-team."""

    def __init__(self) -> None:
        self.members: dict[Address, Member] = {}

    def add(self, searcher: Address, epoch: int, now: Time) -> bool:
        """Add *searcher*, or note that it has been heard; return True if it is new here, or has joined again."""
        member = self.members.get(searcher)
        if member is None or epoch > member.epoch:
            self.members[searcher] = Member(epoch, now)
            return True
        member.heard = now
        return False

    def remove(self, searcher: Address, epoch: int) -> bool:
        """Remove *searcher* unless it has joined with a newer *epoch*; return True if it was removed."""
        member = self.members.get(searcher)
        if member is None or member.epoch > epoch:
            return False
        del self.members[searcher]
        return True

    def forgotten(self, since: Time) -> list[Address]:
        """Return the searchers that have not been heard *since*."""
        return [searcher for searcher, member in self.members.items() if member.heard < since]

    def taken(self, visited: Collection[int]) -> set[int]:
        """Return the posts that members still have to visit."""
        return {post for member in self.members.values() for post in member.left(visited)}


class Membership:
    """A searcher's membership in a sub-team, and the plans of hosts that it knows."""

    def __init__(self, host: Address | None, epoch: int) -> None:
        """Begin in the sub-team of *host*, or in none."""
        self.host = host
        self.epoch = epoch
        self.asked: Address | None = None
        """Host that has been asked and has not confirmed yet."""
        self.former: dict[Address, int] = {}
        """Hosts that are to be sent a Leave -> how many times more."""
        self.courses: dict[Address, Course] = {}
        """Course of the last plan of each host."""
        self.plans = 0
        """Version of the own host's plans, by the host's count."""
        self._asked_epoch = epoch

    def ask(self, host: Address, now: Time) -> int:
        """Return the epoch for a request to join *host*; the same until another host is asked."""
        if self.asked != host:
            self.asked = host
            self._asked_epoch = min(max(self._asked_epoch + 1, now // S), COUNTS - 1)
        return self._asked_epoch

    def confirmed(self, host: Address, epoch: int) -> bool:
        """Process a confirmation; return True if *host* has become the own host.

        One that comes late, after another host has been asked, is void: that host will be sent a Leave.
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
        """Return True if *host*, which has just been heard, is to be sent a Leave (once more)."""
        left = self.former.get(host, 0)
        if left == 1:
            del self.former[host]
        elif left:
            self.former[host] = left - 1
        return left > 0

    def learn(self, sender: Address, message: Plans, now: Time) -> None:
        """Store the plans of *sender*, a host: its own first, then those of its neighbours where they are newer."""
        for plan in message.plans:
            known = self.courses.get(plan.host)
            if plan.host == sender or known is None or known.departed < instant(plan.departed_ms, now):
                self.courses[plan.host] = course_of(plan, now)
        if sender == self.host:
            self.plans = message.plans[0].version
