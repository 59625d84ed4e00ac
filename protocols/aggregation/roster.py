"""Who is in which sub-team: the host's list of its searchers, and a searcher's side of it.

Memberships are told apart by an epoch, which the searcher chooses: greater than any before, and the time in seconds at
least, so that one that has been rebooted and remembers nothing outdoes what it was before. (Who joins, is rebooted, and
joins another host within a second is in two lists until one of them forgets it.)
"""

from collections.abc import Collection

from cosim.geometry.planning import Point
from cosim.machine import Address
from cosim.units import S, Time
from protocols.aggregation.course import Course, course_of
from protocols.aggregation.frames import COUNTS, following
from protocols.aggregation.messages import Plans

LEAVES = 3
"""How often a host that was left is told so, when it is heard: its sub-team's list is mended by the others, too."""


class Member:
    """A searcher of the sub-team."""

    def __init__(self, epoch: int, now: Time) -> None:
        self.epoch = epoch
        self.heard = now
        self.place_m: Point | None = None
        self.number = 0
        """Of its last assignment; 0 before the first."""
        self.posts: tuple[int, ...] = ()
        self.stopped = False
        self.round = -1
        """The last meeting of all that it has reported to."""

    def give(self, posts: tuple[int, ...]) -> None:
        """Note a new assignment."""
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
        """Take *searcher* in, or note that it has been heard; return whether it is new here, or has joined anew."""
        member = self.members.get(searcher)
        if member is None or epoch > member.epoch:
            self.members[searcher] = Member(epoch, now)
            return True
        member.heard = now
        return False

    def remove(self, searcher: Address, epoch: int) -> bool:
        """Strike *searcher* off unless it has joined with a newer *epoch*; return whether it was there."""
        member = self.members.get(searcher)
        if member is None or member.epoch > epoch:
            return False
        del self.members[searcher]
        return True

    def forgotten(self, since: Time) -> list[Address]:
        """Return who has not been heard *since*."""
        return [searcher for searcher, member in self.members.items() if member.heard < since]

    def taken(self, visited: Collection[int]) -> set[int]:
        """Return the posts that members are to visit yet."""
        return {post for member in self.members.values() for post in member.left(visited)}


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
