"""A piconet of a team whose members are known beforehand; another robot takes over when the master dies, if wanted.

Radios such as Bluetooth's carry nothing without a link, and their slaves talk to the master alone. The robot that the
parameters name first is the master: it pages the others by their addresses, which needs no inquiry, and pages again
those that it has lost; the others scan. A page suspends the piconet, and one of a robot out of reach takes seconds. So
the master waits ever longer from one page of a robot to the next, unless that robot is likely to be near, and is there
for its slaves for a while after a page in vain. The master relays what a slave sends to others.

With ``takeover`` there is an order of masters: the first, then all others by their addresses. A robot that has been
without a master for a while takes over: it waits the longer, the more robots before it in the order may be alive, so
that the next living robot succeeds a dead master. A master goes on scanning. When two masters find each other, because
one was out of the other's reach or was booted again, the one that is later in the order gives up its piconet and joins
the other's, whose master then pages its slaves. The specification asks for this (the host may die in mid-play); the
paper (004) has a network that needs no links.
"""

from collections.abc import Collection, Iterable
from typing import Final, Self

from cosim.errors import UserError
from cosim.machine import (
    BROADCAST,
    Address,
    Connected,
    Disconnect,
    LinkCommand,
    LinkEvent,
    Lost,
    Page,
    PageFailed,
    Reception,
    Role,
    Scan,
)
from cosim.protocol import Surroundings
from cosim.units import Time, from_seconds
from protocols.transport.parameters import LinkParameters, PagingParameters

MOST_ROBOTS: Final = 8
"""Robots of a piconet whose radio has no limit: a master and seven active slaves, as over Bluetooth."""


def most_links(surroundings: Surroundings, radio: int = 0) -> int | None:
    """Return how many links *radio* can hold as a master; None if there is no limit, or nothing is known of it."""
    return surroundings.links[radio] if radio < len(surroundings.links) else None


def most_robots(surroundings: Surroundings, radio: int = 0) -> int:
    """Return how many robots a piconet of *radio* has at most: one for each link that it can hold, and the master.

    Where the radio has no limit that is ``MOST_ROBOTS``, so that a team has the links over it that it has by Bluetooth.
    """
    links = most_links(surroundings, radio)
    return MOST_ROBOTS if links is None else links + 1


def check_piconet(surroundings: Surroundings, setting: str) -> None:
    """Raise UserError, naming *setting*, if the team has more robots than a piconet of radio 0."""
    size, most = len(surroundings.starts_m), most_robots(surroundings)
    if size > most:
        raise UserError(f"{setting}: {size} robots, a piconet has at most {most}")


class Links:
    """One robot's part in the piconet; *now* never decreases."""

    def __init__(self, me: Address, size: int, parameters: LinkParameters, start: Time) -> None:
        """Be in a team of *size*, as many as a piconet of the radio has at most."""
        self.me = me
        self.leading = me == parameters.first
        """True if it is a master, with or without slaves."""
        self.master: Address | None = None
        """Its master, if it has one."""
        self.slaves: set[Address] = set()
        self.left: tuple[Address, ...] = ()
        """Its former slaves, which it has left to follow its master; the master is to learn of them."""
        self._first = parameters.first
        self._takeover = parameters.takeover
        self._patience = from_seconds(parameters.patience_s)
        self._service = parameters.service
        self._least = from_seconds(parameters.page_s)
        self._most = from_seconds(parameters.page_most_s)
        self._silence = None if parameters.silence_s is None else from_seconds(parameters.silence_s)
        self._alone = from_seconds(parameters.alone_s)
        self._stagger = from_seconds(parameters.stagger_s)
        self._others = [other for other in range(size) if other != me]
        self._dead: set[Address] = set()
        """Robots taken for dead, or out of reach: none waits for them to take over."""
        self._since = start
        """When it lost its master."""
        self._heard: dict[Address, Time] = {}
        """When each robot with a link was heard last, or got the link."""
        self._tried: dict[Address, Time] = {}
        """When each robot without a link was paged last, or lost."""
        self._waits = dict.fromkeys(self._others, self._least)
        """How long each is not paged after that."""
        self._paging: tuple[Address, Time] | None = None
        """The robot that is being paged, and since when."""
        self._rests_until = start
        """Until when, after a page in vain, a master is there for its slaves, or can be paged itself."""
        # no robot pages the first unless another can be a master, too
        self.commands: list[LinkCommand] = [Scan(enabled=self._takeover or not self.leading)]
        """Link commands that are still to be drained."""

    @classmethod
    def of_star(cls, me: Address, size: int, parameters: PagingParameters, start: Time) -> Self:
        """Return a part in the piconet of robot 0, of which nobody takes over.

        The radio alone says which links are lost. For few and small frames: robots that were lost are found sooner if a
        page in vain is followed by the next one.
        """
        return cls(me, size, LinkParameters(takeover=False, silence_s=None, service=0, **dict(parameters)), start)

    # ------------------------------------------------------------ who hears whom

    def hop(self, destination: Address) -> Address | None:
        """Return the next hop to *destination*; None if there is no way to it now."""
        if self.master is not None:
            return self.master
        return destination if destination in self.slaves else None

    @property
    def audience(self) -> Address | None:
        """Destination of what is meant for all; None without a link."""
        if self.master is not None:
            return self.master
        return BROADCAST if self.slaves else None

    def relays(self, author: Address, reception: Reception) -> bool:
        """Return whether to relay a frame: *author* has sent it to this master alone, and there are other slaves."""
        return reception.source == author and not reception.broadcast and not self.slaves <= {author}

    def before(self, other: Address) -> bool:
        """Return whether *other* is before this robot in the order of masters."""
        return self._place(other) < self._place(self.me)

    def _place(self, robot: Address) -> tuple[bool, Address]:
        return robot != self._first, robot

    # ------------------------------------------------------------ time

    def heard(self, neighbour: Address, now: Time) -> None:
        """Note that a frame of *neighbour* has come, over one hop."""
        self._heard[neighbour] = now

    def find(self, robots: Iterable[Address]) -> None:
        """Page soon *robots* that, as another has reported, are there and have no master."""
        for robot in robots:
            if robot in self._waits and robot not in self.slaves:
                self._expect(robot)

    def _expect(self, robot: Address) -> None:
        self._dead.discard(robot)
        self._waits[robot] = self._least
        self._tried.pop(robot, None)

    def forget(self, other: Address) -> None:
        """Take *other* for dead, and page it rarely, until it is linked again."""
        self._dead.add(other)
        if other in self._waits:
            self._waits[other] = self._most

    def tick(self, near: Collection[Address], now: Time) -> None:
        """Take over if that is due, or page a robot that is due; those *near* are likely to be in reach."""
        # a radio that was off has forgotten its links, and does not report it
        for peer in self._silent(now):
            self.commands.append(Disconnect(peer))
            self._lost(peer, now)
        if self._takeover and self.master is None and not self.leading:
            rank = sum(self.before(other) and other not in self._dead for other in self._others)
            if now - self._since >= self._alone + rank * self._stagger:
                self.leading = True
                self._dead.update(filter(self.before, self._others))  # else they would have taken over
        if self.leading:
            self._page(near, now)

    def _silent(self, now: Time) -> list[Address]:
        if self._silence is None:
            return []
        return sorted(peer for peer in self._linked if now - self._heard[peer] >= self._silence)

    def _page(self, near: Collection[Address], now: Time) -> None:
        if self._paging is not None:
            peer, since = self._paging
            if now - since < self._patience:  # a radio that is dead does not answer its host
                return
            self._failed(peer, now)
        due = [peer for peer in self._others if peer not in self.slaves and self._due(peer, peer in near, now)]
        if now < self._rests_until:
            due = [peer for peer in due if self.slaves and self._hopeful(peer)]
        if due:
            peer = min(due, key=self._urgency)
            self._paging = peer, now
            self._tried[peer] = now
            self.commands.append(Page(peer))

    def _hopeful(self, peer: Address) -> bool:
        """Return whether *peer* is likely to answer a page: not paged in vain since anything was heard of it."""
        return self._waits[peer] == self._least and peer not in self._dead

    def _urgency(self, peer: Address) -> tuple[bool, bool, Time, Address]:
        """Return a key that is smaller for robots to page earlier: the hopeful, then those that have waited longest."""
        return not self._hopeful(peer), peer in self._tried, self._tried.get(peer, 0), peer

    def _due(self, peer: Address, near: bool, now: Time) -> bool:
        wait = self._least if near else self._waits[peer]
        return peer not in self._tried or now - self._tried[peer] >= wait

    # ------------------------------------------------------------ events of links

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take an event of a link."""
        match event:
            case Connected(peer=peer, role=role):
                self._connected(peer, role, now)
            case PageFailed(peer=peer) if self._paging is not None and self._paging[0] == peer:
                self._failed(peer, now)
            case Lost(peer=peer) if peer in self._linked:
                self._lost(peer, now)

    @property
    def _linked(self) -> set[Address]:
        return self.slaves if self.master is None else {self.master}

    def _lost(self, peer: Address, now: Time) -> None:
        """Note that a link is lost; a master that is lost is no longer waited for."""
        self._tried[peer] = now
        self._waits[peer] = self._least
        self.slaves.discard(peer)
        if peer == self.master:
            self._dead.add(peer)
            self.master = None
            self._since = now
            self.commands.append(Scan(enabled=True))

    def _connected(self, peer: Address, role: Role, now: Time) -> None:
        self.slaves.discard(peer)  # the loss of a former link was not reported
        self._heard[peer] = now
        paged = self._paging is not None and self._paging[0] == peer
        if paged:
            self._paging = None
        if peer not in self._waits:
            self.commands.append(Disconnect(peer))
        elif role is Role.MASTER and self.leading:
            self._dead.discard(peer)
            if not self.slaves:  # it was out of reach of all: robots paged in vain may have been near another
                self._waits = dict.fromkeys(self._others, self._least)
            self.slaves.add(peer)
            self._waits[peer] = self._least
            if self._takeover:
                self.commands.append(Scan(enabled=True))  # a device that gets a link stops scanning
        elif role is Role.SLAVE and self._prefers(peer):
            self._follow(peer)
        else:
            self.commands.append(Disconnect(peer))
            self._expect(peer)

    def _prefers(self, other: Address) -> bool:
        """Return whether *other*, which has paged this robot, is to be its master."""
        if not self._takeover:
            return other == self._first
        if self.leading:
            return self.before(other)
        return self.master is None or self._place(other) <= self._place(self.master)

    def _follow(self, master: Address) -> None:
        self.commands.extend(Disconnect(peer) for peer in sorted(self._linked - {master}))
        self._dead.discard(master)
        self.left = tuple(sorted(self.slaves))
        self.slaves.clear()
        self.leading = False
        self.master = master
        self._paging = None

    def _failed(self, peer: Address, now: Time) -> None:
        """Note that a page was in vain: for as long as it has lasted, or longer, page no robot that may be dead."""
        # A page suspends the piconet, and a robot that pages cannot be paged; the first needs no such rest while it is
        # alone, since no robot pages it.
        spent = 0 if self._paging is None else now - self._paging[1]
        self._paging = None
        self._tried[peer] = now
        self._waits[peer] = min(2 * self._waits[peer], self._most)
        if self.slaves or self.me != self._first:
            # half of the address more, so that two that page each other fall out of step
            times = 2 * (self._service if self.slaves else 1) + self.me
            self._rests_until = now + times * spent // 2

    def drain(self) -> list[LinkCommand]:
        """Return the link commands, once."""
        commands, self.commands = self.commands, []
        return commands
