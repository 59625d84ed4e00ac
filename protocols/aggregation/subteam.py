"""A host's sub-team: its members, what each is to do, and the answers to what each sends.

A searcher that considers itself a member is one, unless it has joined another host since, as the epoch of its
membership shows (see ``roster``). A searcher that sends a Hello is sent what it lacks, so that no loss is final.

The paper (002, section VI.A) asks for "dynamic task allocation" and does not say which. Chosen: a searcher that has
nothing left is given a part of the posts that are not assigned yet; if there are none, half of what the busiest of
those in contact has left. The region of a host that is suspected, or has no members, falls to the host whose rally
point is nearest: all hosts that hear each other agree which one that is.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cache

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
"""Number of heartbeats for which a searcher that was heard counts as in contact."""


class Work:
    """The division of one sub-team's posts among its searchers."""

    def __init__(self, setup: Setup, host: Address, rally_m: Callable[[Address], Point], at_random: bool) -> None:
        """Divide nothing if the searchers move *at_random*; *rally_m* is asked for each host's when one is idle."""
        self._setup = setup
        self._host = host
        self._rally_m = cache(rally_m)
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
        """Return posts for a searcher at *here_m* while *waiting* others need some, too; none if all are assigned."""
        if self._random:
            return ()
        free = self._responsible(idle) - set(visited) - roster.taken(visited)
        if not free:
            return ()
        parts = tours(self._setup.ground, free, [here_m] * min(1 + waiting, len(free)))
        return next((part for part in parts if part), ())

    def shared(self, posts: Collection[int], here_m: Point, there_m: Point) -> tuple[tuple[int, ...], ...]:
        """Divide the *posts* of a searcher there between one that is here and itself."""
        return tours(self._setup.ground, posts, [here_m, there_m])

    def _responsible(self, idle: Collection[Address]) -> set[int]:
        """Return the own posts and those of *idle* hosts that fall to this one."""
        posts = set(self._own)
        living = [host for host in range(self._setup.hosts) if host not in idle]
        for host in idle:
            rally = self._rally_m(host)
            heir = min(living, key=lambda each: (math.dist(self._rally_m(each), rally), each))
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
        """True if the other hosts are to be informed of the members."""
        self.reassigned = False
        """True if a member's posts have changed since the host's way was planned."""
        self._lost = from_seconds(parameters.lost_s)
        self._recent = from_seconds(RECENT_BEATS * parameters.heartbeat_s)
        self._work = work
        self._findings = findings
        self._radio = radio
        self._events = events
        self._neighbours = neighbours
        self._itinerary = itinerary

    def begin(self, searchers: tuple[Address, ...], at_random: bool, start: Time) -> Tours:
        """Add the *searchers* that begin in this sub-team; return the tours that they are given."""
        first = self._work.first(searchers)
        for searcher in searchers:
            self.roster.add(searcher, 0, start)
            if not at_random:
                self._give(searcher, self.roster.members[searcher], first[searcher])
        self.reassigned = False
        return tuple(first.values())

    @property
    def stopped(self) -> bool:
        """True if all members have reported that they have stopped."""
        return all(member.stopped for member in self.roster.members.values())

    @property
    def tours(self) -> Tours:
        """The posts that each member has been given and is not known to have visited."""
        return tuple(member.left(self._findings.visited) for member in self.roster.members.values())

    def gathered(self, now: Time) -> bool:
        """Return whether all members are in contact: then no member relies on an old plan if the plan is changed."""
        return all(now - member.heard <= self._recent for member in self.roster.members.values())

    def missing(self) -> int:
        """Return the number of members that have not come to the present meeting."""
        return sum(1 for member in self.roster.members.values() if member.round != self._itinerary.round)

    # ------------------------------------------------------------ messages of searchers

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
        if not member.number:  # new here: its last assignment may have any number
            member.number = hello.assignment
        self._employ(searcher, member, now)
        if member.posts and member.number != hello.assignment and member.number:
            self._radio.send(Assign(member.epoch, member.number, member.posts), searcher)
        if hello.plan != self._itinerary.version:
            self._radio.send(plans(), searcher)

    def report(self, searcher: Address, report: Report, now: Time) -> bool:
        """Send a member a receipt for its report; return whether it is a member. Another host's member gets none."""
        if self._member(searcher, report.epoch, now) is None:
            return False
        self._radio.send(Receipt(report.number), searcher)
        return True

    def join(self, searcher: Address, join: Join, over: bool, now: Time) -> None:
        """Add a searcher and confirm it; stop it at once if the task is over."""
        self._add(searcher, join.epoch, now)
        member = self.roster.members[searcher]
        member.place_m = join.x_m, join.y_m
        self._radio.send(Confirm(member.epoch), searcher)
        if over:
            self._radio.send(Stop(), searcher)

    def leave(self, searcher: Address, epoch: int, why: str) -> None:
        """Remove a searcher unless it has joined again since *epoch*."""
        if self.roster.remove(searcher, epoch):
            self._events.append(MemberRemoved(searcher, why))
            self.changed = True

    def stop(self, searcher: Address) -> None:
        """Note that a searcher has stopped."""
        member = self.roster.members.get(searcher)
        if member is not None:
            member.stopped = True

    # ------------------------------------------------------------ members

    def claimed(self, members: tuple[tuple[Address, int], ...]) -> None:
        """Remove searchers that another host has reported as members with a newer epoch."""
        for searcher, epoch in members:
            member = self.roster.members.get(searcher)
            if member is not None and epoch > member.epoch:
                self.leave(searcher, member.epoch, "joined another")

    def recall(self, members: tuple[tuple[Address, int], ...], now: Time) -> None:
        """Add the members that this host had before a reboot, except those that are in other sub-teams now."""
        for searcher, epoch in members:
            if searcher not in self.roster.members and self._neighbours.newer_epoch(searcher) <= epoch:
                self._add(searcher, epoch, now)

    def forget(self, now: Time) -> None:
        """Remove members that have been silent for long: their posts are to be visited by others."""
        for searcher in self.roster.forgotten(now - self._lost):
            self.leave(searcher, COUNTS, "lost")

    def _member(self, searcher: Address, epoch: int, now: Time) -> Member | None:
        """Return *searcher* as a member, added if it considers itself one; None if another host has it."""
        if searcher not in self.roster.members and self._neighbours.newer_epoch(searcher) > epoch:
            return None
        self._add(searcher, epoch, now)
        return self.roster.members[searcher]

    def _add(self, searcher: Address, epoch: int, now: Time) -> None:
        if self.roster.add(searcher, epoch, now):
            self._events.append(MemberAdded(searcher, epoch))
            self.changed = True

    # ------------------------------------------------------------ assignments

    def _employ(self, searcher: Address, member: Member, now: Time) -> None:
        """Assign posts to a searcher that has none left, if there are any."""
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
        """Assign to a searcher half of the posts of the member in contact that has most left."""
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
        """Return the number of other searchers that have no posts, or may join because their host is suspected."""
        visited, members = self._findings.visited, self.roster.members
        idle = sum(1 for each, member in members.items() if each != searcher and not member.left(visited))
        hosts = self._neighbours.hosts
        orphans = {each for host in self._neighbours.silent for each in hosts[host].members}
        return idle + len(orphans - members.keys() - {searcher})
