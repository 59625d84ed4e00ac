"""A host's sub-team: who is in it, what each is to do, and what each says and lacks.

A searcher that takes itself for a member is one, unless another host has heard from it since; the epoch of a membership
tells (see ``membership``). One that says hello is sent what it lacks: so nothing that was lost is lost for good.
"""

from collections.abc import Callable

from cosim.geometry.planning import Point
from cosim.machine import Address, Event
from cosim.units import Time, from_seconds
from protocols.aggregation.counts import COUNTS
from protocols.aggregation.events import Assigned, MemberAdded, MemberRemoved
from protocols.aggregation.findings import Findings
from protocols.aggregation.itinerary import Itinerary
from protocols.aggregation.leading import Work
from protocols.aggregation.messages import Assign, Confirm, Hello, Join, Leave, Plans, Receipt, Report, Stop
from protocols.aggregation.neighbours import Neighbours
from protocols.aggregation.parameters import Parameters
from protocols.aggregation.roll import Member, Roll
from protocols.aggregation.setup import Tours
from protocols.aggregation.speech import Speech

RECENT_BEATS = 6
"""Who has been heard in the time of so many heartbeats is taken to be in contact."""


class SubTeam:
    """The sub-team of one host."""

    def __init__(
        self,
        parameters: Parameters,
        work: Work,
        findings: Findings,
        speech: Speech,
        events: list[Event],
        neighbours: Neighbours,
        itinerary: Itinerary,
    ) -> None:
        self.roll = Roll()
        self.changed = False
        """Whether the other hosts are to be told who is in it."""
        self.reassigned = False
        """Whether somebody has been given other work since the host's way was planned."""
        self._lost = from_seconds(parameters.lost_s)
        self._recent = from_seconds(RECENT_BEATS * parameters.heartbeat_s)
        self._work = work
        self._findings = findings
        self._speech = speech
        self._events = events
        self._neighbours = neighbours
        self._itinerary = itinerary

    def begin(self, searchers: tuple[Address, ...], at_random: bool, start: Time) -> Tours:
        """Take in the *searchers* that everybody knows to be this host's; return the tours that they are given."""
        tours = self._work.first(searchers)
        for searcher in searchers:
            self.roll.add(searcher, 0, start)
            if not at_random:
                self._give(searcher, self.roll.members[searcher], tours[searcher])
        self.reassigned = False
        return tuple(tours.values())

    @property
    def stopped(self) -> bool:
        """Whether all members have said that they have stopped."""
        return all(member.stopped for member in self.roll.members.values())

    @property
    def tours(self) -> Tours:
        """What each member has been given, and is not known to have visited."""
        return tuple(member.left(self._findings.visited) for member in self.roll.members.values())

    def gathered(self, now: Time) -> bool:
        """Return whether all members are in contact: then nobody relies on a plan that is changed."""
        return all(now - member.heard <= self._recent for member in self.roll.members.values())

    def missing(self) -> int:
        """Return how many members have not come to the present meeting."""
        return sum(1 for member in self.roll.members.values() if member.round != self._itinerary.round)

    # ------------------------------------------------------------ what searchers say

    def hello(self, searcher: Address, hello: Hello, over: bool, plans: Callable[[], Plans], now: Time) -> None:
        """Send a searcher what it lacks."""
        member = self._member(searcher, hello.epoch, now)
        if member is None:
            self._speech.say(Leave(hello.epoch), searcher)
            return
        member.place_m = hello.x_m, hello.y_m
        if self._itinerary.syncing:
            member.round = self._itinerary.round
        if over:
            if not member.stopped:
                self._speech.say(Stop(), searcher)
            return
        if not member.number:  # new here: what it has may bear any number
            member.number = hello.assignment
        self._employ(searcher, member, now)
        if member.posts and member.number != hello.assignment and member.number:
            self._speech.say(Assign(member.epoch, member.number, member.posts), searcher)
        if hello.plan != self._itinerary.version:
            self._speech.say(plans(), searcher)

    def report(self, searcher: Address, report: Report, now: Time) -> bool:
        """Give a member a receipt for its report; return whether it is one. Another's member goes on telling."""
        if self._member(searcher, report.epoch, now) is None:
            return False
        self._speech.say(Receipt(report.number), searcher)
        return True

    def join(self, searcher: Address, join: Join, over: bool, now: Time) -> None:
        """Take a searcher in, and confirm it; have it stop at once if the task is over."""
        self._add(searcher, join.epoch, now)
        member = self.roll.members[searcher]
        member.place_m = join.x_m, join.y_m
        self._speech.say(Confirm(member.epoch), searcher)
        if over:
            self._speech.say(Stop(), searcher)

    def leave(self, searcher: Address, epoch: int, why: str) -> None:
        """Strike a searcher off, unless it has joined anew since *epoch*."""
        if self.roll.remove(searcher, epoch):
            self._events.append(MemberRemoved(searcher, why))
            self.changed = True

    def stop(self, searcher: Address) -> None:
        """Note that a searcher has stopped."""
        member = self.roll.members.get(searcher)
        if member is not None:
            member.stopped = True

    # ------------------------------------------------------------ who is in it

    def claimed(self, members: tuple[tuple[Address, int], ...]) -> None:
        """Strike off those who are in another host's sub-team, as that has told, with a newer epoch."""
        for searcher, epoch in members:
            member = self.roll.members.get(searcher)
            if member is not None and epoch > member.epoch:
                self.leave(searcher, member.epoch, "joined another")

    def recall(self, members: tuple[tuple[Address, int], ...], now: Time) -> None:
        """Take in those whom this host led before a reboot, but for those who are in other sub-teams now."""
        for searcher, epoch in members:
            if searcher not in self.roll.members and self._neighbours.newer_epoch(searcher) <= epoch:
                self._add(searcher, epoch, now)

    def forget(self, now: Time) -> None:
        """Strike off those who have not been heard for long: their posts are to be visited by others."""
        for searcher in self.roll.forgotten(now - self._lost):
            self.leave(searcher, COUNTS, "lost")

    def _member(self, searcher: Address, epoch: int, now: Time) -> Member | None:
        """Return the member that *searcher* is, taken in if it takes itself for one; None if another host has it."""
        if searcher not in self.roll.members and self._neighbours.newer_epoch(searcher) > epoch:
            return None
        self._add(searcher, epoch, now)
        return self.roll.members[searcher]

    def _add(self, searcher: Address, epoch: int, now: Time) -> None:
        if self.roll.add(searcher, epoch, now):
            self._events.append(MemberAdded(searcher, epoch))
            self.changed = True

    # ------------------------------------------------------------ who does what

    def _employ(self, searcher: Address, member: Member, now: Time) -> None:
        """Give a searcher something to do if it has nothing left, and there is anything."""
        visited = self._findings.visited
        if member.left(visited) or member.place_m is None:
            return
        others = self._waiting(searcher)
        posts = self._work.next(member.place_m, self.roll, visited, self._neighbours.idle, others)
        if posts:
            self._give(searcher, member, posts)
        else:
            self._relieve(searcher, member, member.place_m, now)

    def _relieve(self, searcher: Address, member: Member, here_m: Point, now: Time) -> None:
        """Give a searcher half of the posts of the one that has most left, of those in contact."""
        visited = self._findings.visited
        busy = [
            (len(left), other)
            for other, each in self.roll.members.items()
            if len(left := each.left(visited)) > 1 and now - each.heard <= self._recent and each.place_m is not None
        ]
        if not busy:
            return
        other = max(busy)[1]
        busiest = self.roll.members[other]
        own, rest = self._work.shared(busiest.left(visited), here_m, busiest.place_m or here_m)
        if own and rest:
            self._give(searcher, member, own)
            self._give(other, busiest, rest)

    def _give(self, searcher: Address, member: Member, posts: tuple[int, ...]) -> None:
        member.give(posts)
        self.reassigned = True
        self._events.append(Assigned(searcher, member.number, len(posts)))

    def _waiting(self, searcher: Address) -> int:
        """Return how many others have nothing to do, or are likely to come because their host is silent."""
        visited, members = self._findings.visited, self.roll.members
        idle = sum(1 for each, member in members.items() if each != searcher and not member.left(visited))
        hosts = self._neighbours.hosts
        orphans = {each for host in self._neighbours.silent for each in hosts[host].members}
        return idle + len(orphans - members.keys() - {searcher})
