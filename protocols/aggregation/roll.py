"""A host's list of the searchers in its sub-team, and what each has been given to do."""

from collections.abc import Collection

from cosim.geometry.planning import Point
from cosim.machine import Address
from cosim.units import Time
from protocols.aggregation.counts import following


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


class Roll:
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
