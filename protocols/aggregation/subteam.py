"""A host's sub-team: who is in it, what each is to do, and what each says and lacks.

A searcher that takes itself for a member is one, unless another host has heard from it since; the epoch of a membership
tells (see ``roster``). One that says hello is sent what it lacks: so nothing that was lost is lost for good.

The paper (002, section VI.A) asks for "dynamic task allocation" and does not say which. Chosen: a searcher that has
nothing left is given a part of what nobody has been given yet; if there is nothing, half of what the busiest of those
in contact has left. The region of a host that has fallen silent, or leads nobody, falls to the one whose rally point is
nearest: all who hear each other agree who that is.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence

from cosim.geometry.planning import Point
from cosim.machine import Address, Event
from cosim.units import Time, from_seconds
from protocols.aggregation.events import Assigned, MemberAdded, MemberRemoved
from protocols.aggregation.findings import Findings
from protocols.aggregation.frames import COUNTS
from protocols.aggregation.itinerary import Itinerary
from protocols.aggregation.messages import Assign, Confirm, Hello, Join, Leave, Plans, Receipt, Report, Stop
from protocols.aggregation.neighbours import Neighbours
from protocols.aggregation.parameters import Parameters
from protocols.aggregation.radio import Radio
from protocols.aggregation.roster import Member, Roster
from protocols.aggregation.setup import Setup, Tours
from protocols.aggregation.tours import tours

RECENT_BEATS = 6
"""Who has been heard in the time of so many heartbeats is taken to be in contact."""


class Work:
    """The posts of one sub-team."""

    def __init__(self, setup: Setup, host: Address, rallies_m: Sequence[Point], at_random: bool) -> None:
        """Divide nothing if the searchers move *at_random*."""
        self._setup = setup
        self._host = host
        self._rallies_m = rallies_m
        self._random = at_random
        self._own = setup.regions[host]

    def first(self, searchers: Sequence[Address]) -> Mapping[Address, tuple[int, ...]]:
        """Return the tours of all *searchers* at the start."""
        starts = [self._setup.starts_m[searcher] for searcher in searchers]
        if not searchers:
            return {}
        return dict(zip(searchers, tours(self._setup.ground, self._own, starts), strict=True))

    def next(
        self, here_m: Point, roster: Roster, visited: Collection[int], idle: Collection[Address], waiting: int
    ) -> tuple[int, ...]:
        """Return what a searcher at *here_m* is to do, if *waiting* others need work, too; nothing if all is given."""
        if self._random:
            return ()
        free = self._responsible(idle) - set(visited) - roster.taken(visited)
        if not free:
            return ()
        parts = tours(self._setup.ground, free, [here_m] * min(1 + waiting, len(free)))
        return next((part for part in parts if part), ())

    def shared(self, posts: Collection[int], here_m: Point, there_m: Point) -> tuple[tuple[int, ...], ...]:
        """Return the *posts* of a searcher in two parts: for one that is here, and for itself, there."""
        return tours(self._setup.ground, posts, [here_m, there_m])

    def _responsible(self, idle: Collection[Address]) -> set[int]:
        """Return the own posts, and those of *idle* hosts that are nearest to this one."""
        posts = set(self._own)
        living = [host for host in range(self._setup.hosts) if host not in idle]
        for host in idle:
            rally = self._rallies_m[host]
            heir = min(living, key=lambda each: (math.dist(self._rallies_m[each], rally), each))
            if heir == self._host:
                posts |= self._setup.regions[host]
        return posts


class SubTeam:
    """The sub-team of one host."""

    def __init__(
        self,
        parameters: Parameters,
        work: Work,
        findings: Findings,
        radio: Radio,
        events: list[Event],
        neighbours: Neighbours,
        itinerary: Itinerary,
    ) -> None:
        self.roster = Roster()
        self.changed = False
        """Whether the other hosts are to be told who is in it."""
        self.reassigned = False
        """Whether somebody has been given other work since the host's way was planned."""
        self._lost = from_seconds(parameters.lost_s)
        self._recent = from_seconds(RECENT_BEATS * parameters.heartbeat_s)
        self._work = work
        self._findings = findings
        self._radio = radio
        self._events = events
        self._neighbours = neighbours
        self._itinerary = itinerary

    def begin(self, searchers: tuple[Address, ...], at_random: bool, start: Time) -> Tours:
        """Take in the *searchers* that everybody knows to be this host's; return the tours that they are given."""
        first = self._work.first(searchers)
        for searcher in searchers:
            self.roster.add(searcher, 0, start)
            if not at_random:
                self._give(searcher, self.roster.members[searcher], first[searcher])
        self.reassigned = False
        return tuple(first.values())

    @property
    def stopped(self) -> bool:
        """Whether all members have said that they have stopped."""
        return all(member.stopped for member in self.roster.members.values())

    @property
    def tours(self) -> Tours:
        """What each member has been given, and is not known to have visited."""
        return tuple(member.left(self._findings.visited) for member in self.roster.members.values())

    def gathered(self, now: Time) -> bool:
        """Return whether all members are in contact: then nobody relies on a plan that is changed."""
        return all(now - member.heard <= self._recent for member in self.roster.members.values())

    def missing(self) -> int:
        """Return how many members have not come to the present meeting."""
        return sum(1 for member in self.roster.members.values() if member.round != self._itinerary.round)

    # ------------------------------------------------------------ what searchers say

    def hello(self, searcher: Address, hello: Hello, over: bool, plans: Callable[[], Plans], now: Time) -> None:
        """Send a searcher what it lacks."""
        member = self._member(searcher, hello.epoch, now)
        if member is None:
            self._radio.send(Leave(hello.epoch), searcher)
            return
        member.place_m = hello.x_m, hello.y_m
        if self._itinerary.syncing:
            member.round = self._itinerary.round
        if over:
            if not member.stopped:
                self._radio.send(Stop(), searcher)
            return
        if not member.number:  # new here: what it has may bear any number
            member.number = hello.assignment
        self._employ(searcher, member, now)
        if member.posts and member.number != hello.assignment and member.number:
            self._radio.send(Assign(member.epoch, member.number, member.posts), searcher)
        if hello.plan != self._itinerary.version:
            self._radio.send(plans(), searcher)

    def report(self, searcher: Address, report: Report, now: Time) -> bool:
        """Give a member a receipt for its report; return whether it is one. Another's member goes on telling."""
        if self._member(searcher, report.epoch, now) is None:
            return False
        self._radio.send(Receipt(report.number), searcher)
        return True

    def join(self, searcher: Address, join: Join, over: bool, now: Time) -> None:
        """Take a searcher in, and confirm it; have it stop at once if the task is over."""
        self._add(searcher, join.epoch, now)
        member = self.roster.members[searcher]
        member.place_m = join.x_m, join.y_m
        self._radio.send(Confirm(member.epoch), searcher)
        if over:
            self._radio.send(Stop(), searcher)

    def leave(self, searcher: Address, epoch: int, why: str) -> None:
        """Strike a searcher off, unless it has joined anew since *epoch*."""
        if self.roster.remove(searcher, epoch):
            self._events.append(MemberRemoved(searcher, why))
            self.changed = True

    def stop(self, searcher: Address) -> None:
        """Note that a searcher has stopped."""
        member = self.roster.members.get(searcher)
        if member is not None:
            member.stopped = True

    # ------------------------------------------------------------ who is in it

    def claimed(self, members: tuple[tuple[Address, int], ...]) -> None:
        """Strike off those who are in another host's sub-team, as that has told, with a newer epoch."""
        for searcher, epoch in members:
            member = self.roster.members.get(searcher)
            if member is not None and epoch > member.epoch:
                self.leave(searcher, member.epoch, "joined another")

    def recall(self, members: tuple[tuple[Address, int], ...], now: Time) -> None:
        """Take in those whom this host led before a reboot, but for those who are in other sub-teams now."""
        for searcher, epoch in members:
            if searcher not in self.roster.members and self._neighbours.newer_epoch(searcher) <= epoch:
                self._add(searcher, epoch, now)

    def forget(self, now: Time) -> None:
        """Strike off those who have not been heard for long: their posts are to be visited by others."""
        for searcher in self.roster.forgotten(now - self._lost):
            self.leave(searcher, COUNTS, "lost")

    def _member(self, searcher: Address, epoch: int, now: Time) -> Member | None:
        """Return the member that *searcher* is, taken in if it takes itself for one; None if another host has it."""
        if searcher not in self.roster.members and self._neighbours.newer_epoch(searcher) > epoch:
            return None
        self._add(searcher, epoch, now)
        return self.roster.members[searcher]

    def _add(self, searcher: Address, epoch: int, now: Time) -> None:
        if self.roster.add(searcher, epoch, now):
            self._events.append(MemberAdded(searcher, epoch))
            self.changed = True

    # ------------------------------------------------------------ who does what

    def _employ(self, searcher: Address, member: Member, now: Time) -> None:
        """Give a searcher something to do if it has nothing left, and there is anything."""
        visited = self._findings.visited
        if member.left(visited) or member.place_m is None:
            return
        others = self._waiting(searcher)
        posts = self._work.next(member.place_m, self.roster, visited, self._neighbours.idle, others)
        if posts:
            self._give(searcher, member, posts)
        else:
            self._relieve(searcher, member, member.place_m, now)

    def _relieve(self, searcher: Address, member: Member, here_m: Point, now: Time) -> None:
        """Give a searcher half of the posts of the one that has most left, of those in contact."""
        visited = self._findings.visited
        busy = [
            (len(left), other)
            for other, each in self.roster.members.items()
            if len(left := each.left(visited)) > 1 and now - each.heard <= self._recent and each.place_m is not None
        ]
        if not busy:
            return
        other = max(busy)[1]
        busiest = self.roster.members[other]
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
        visited, members = self._findings.visited, self.roster.members
        idle = sum(1 for each, member in members.items() if each != searcher and not member.left(visited))
        hosts = self._neighbours.hosts
        orphans = {each for host in self._neighbours.silent for each in hosts[host].members}
        return idle + len(orphans - members.keys() - {searcher})
