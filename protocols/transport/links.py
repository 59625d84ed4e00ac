"""A piconet of a team that knows its members beforehand, and in which another takes over when the master dies.

Radios such as Bluetooth's carry nothing without a link, and have their slaves talk to the master alone. There is an
order of masters: the first that the parameters name, then all by their addresses. The first pages the others by their
addresses, which needs no inquiry, and pages those again that it has lost; they scan. What a slave says to others the
master says again. A robot that has been without a master for a while takes over: the later, the more robots are before
it in the order that may be alive. So a dead master is succeeded by the next that lives. A master goes on scanning: when
two find each other, one of which has been out of the other's reach or was booted again, the one that is behind in the
order gives up its piconet and joins the other's, and then its slaves are paged.

The specification asks for this (the host may die in mid-play); the paper (004) has a network that needs no links.
``protocols.transport.star`` is the same without succession.
"""

from collections.abc import Collection, Iterable
from typing import Final

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
    Role,
    Scan,
)
from cosim.units import Time, from_seconds
from protocols.transport.parameters import LinkParameters

MOST_ROBOTS: Final = 8
"""A master and seven active slaves."""
SERVICE: Final = 3
"""A master is there for its slaves so many times as long as it has just paged in vain, or more."""


class Links:
    """One robot's part in it; *now* never decreases."""

    def __init__(self, me: Address, size: int, parameters: LinkParameters, start: Time) -> None:
        """Be in a team of *size*, up to ``MOST_ROBOTS``."""
        self.me = me
        self.leading = me == parameters.first
        """Whether it is a master, maybe of nobody."""
        self.master: Address | None = None
        """Who is its master, if it has one."""
        self.slaves: set[Address] = set()
        self.left: tuple[Address, ...] = ()
        """Whom it has left to follow its master, which is to be told of them."""
        self._first = parameters.first
        self._patience = from_seconds(parameters.patience_s)
        self._least = from_seconds(parameters.page_s)
        self._most = from_seconds(parameters.page_most_s)
        self._silence = from_seconds(parameters.silence_s)
        self._alone = from_seconds(parameters.alone_s)
        self._stagger = from_seconds(parameters.stagger_s)
        self._others = [other for other in range(size) if other != me]
        self._dead: set[Address] = set()
        """Who is taken for dead, or out of reach: nobody waits for them to take over."""
        self._since = start
        """Since when it has no master."""
        self._heard: dict[Address, Time] = {}
        """When each that has a link was heard last, or got the link."""
        self._tried: dict[Address, Time] = {}
        """When each that has no link was paged last, or lost."""
        self._waits = dict.fromkeys(self._others, self._least)
        """How long each is left alone after that."""
        self._paging: tuple[Address, Time] | None = None
        """Who is being paged, and since when."""
        self._rests_until = start
        """Until when a master is there for its slaves, or can be paged itself, after a page in vain."""
        self._out: list[LinkCommand] = [Scan(enabled=True)]

    # ------------------------------------------------------------ who hears whom

    def hop(self, destination: Address) -> Address | None:
        """Return to whom to send what is meant for *destination*; None if there is no way to it now."""
        if self.master is not None:
            return self.master
        return destination if destination in self.slaves else None

    @property
    def audience(self) -> Address | None:
        """To whom to send what is meant for all; None without a link."""
        if self.master is not None:
            return self.master
        return BROADCAST if self.slaves else None

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
        """Page soon those of whom another has said that they are there, and have no master."""
        for robot in robots:
            if robot in self._waits and robot not in self.slaves:
                self._expect(robot)

    def _expect(self, robot: Address) -> None:
        self._dead.discard(robot)
        self._waits[robot] = self._least
        self._tried.pop(robot, None)

    def forget(self, other: Address) -> None:
        """Take *other* for dead until it is linked again: it is paged rarely."""
        self._dead.add(other)
        if other in self._waits:
            self._waits[other] = self._most

    def tick(self, seen: Collection[Address], now: Time) -> None:
        """Take over if that is due, or page who is due; *seen* are those in sight."""
        # a radio that was off, as robots are not told, has forgotten its links
        for peer in sorted(peer for peer in self._linked if now - self._heard[peer] >= self._silence):
            self._out.append(Disconnect(peer))
            self._lost(peer, now)
        if self.master is None and not self.leading:
            rank = sum(self.before(other) and other not in self._dead for other in self._others)
            if now - self._since >= self._alone + rank * self._stagger:
                self.leading = True
                self._dead.update(filter(self.before, self._others))  # else they would have taken over
        if self.leading:
            self._page(seen, now)

    def _page(self, seen: Collection[Address], now: Time) -> None:
        if self._paging is not None:
            peer, since = self._paging
            if now - since < self._patience:
                return
            self._failed(peer, now)
        due = [peer for peer in self._others if peer not in self.slaves and self._due(peer, peer in seen, now)]
        if now < self._rests_until:
            due = [peer for peer in due if self.slaves and self._hopeful(peer)]
        if due:
            peer = min(due, key=self._urgency)
            self._paging = peer, now
            self._tried[peer] = now
            self._out.append(Page(peer))

    def _hopeful(self, peer: Address) -> bool:
        """Return whether a robot is likely to answer a page: it was not paged in vain since there was news of it."""
        return self._waits[peer] == self._least and peer not in self._dead

    def _urgency(self, peer: Address) -> tuple[bool, bool, Time, Address]:
        """Return what is smaller for those who are paged earlier: the hopeful, then who has waited longest."""
        return not self._hopeful(peer), peer in self._tried, self._tried.get(peer, 0), peer

    def _due(self, peer: Address, near: bool, now: Time) -> bool:
        wait = self._least if near else self._waits[peer]
        return peer not in self._tried or now - self._tried[peer] >= wait

    # ------------------------------------------------------------ news of links

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take news about links."""
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
        """Note that a link is lost: nobody waits any more for a master that was."""
        self._tried[peer] = now
        self._waits[peer] = self._least
        self.slaves.discard(peer)
        if peer == self.master:
            self._dead.add(peer)
            self.master = None
            self._since = now
            self._out.append(Scan(enabled=True))

    def _connected(self, peer: Address, role: Role, now: Time) -> None:
        self.slaves.discard(peer)  # of a former link nobody knew that it was lost
        self._heard[peer] = now
        paged = self._paging is not None and self._paging[0] == peer
        if paged:
            self._paging = None
        if peer not in self._waits:
            self._out.append(Disconnect(peer))
        elif role is Role.MASTER and self.leading:
            self._dead.discard(peer)
            if not self.slaves:  # it was out of reach of all: who was paged in vain may have been near another
                self._waits = dict.fromkeys(self._others, self._least)
            self.slaves.add(peer)
            self._waits[peer] = self._least
            self._out.append(Scan(enabled=True))  # a device that gets a link stops scanning
        elif role is Role.SLAVE and self._prefers(peer):
            self._follow(peer)
        else:
            self._out.append(Disconnect(peer))
            self._expect(peer)

    def _prefers(self, other: Address) -> bool:
        """Return whether *other*, which has paged this robot, is to be its master."""
        if self.leading:
            return self.before(other)
        return self.master is None or self._place(other) <= self._place(self.master)

    def _follow(self, master: Address) -> None:
        self._out.extend(Disconnect(peer) for peer in sorted(self._linked - {master}))
        self._dead.discard(master)
        self.left = tuple(sorted(self.slaves))
        self.slaves.clear()
        self.leading = False
        self.master = master
        self._paging = None

    def _failed(self, peer: Address, now: Time) -> None:
        """Note that a page was in vain: for as long as it has lasted, or longer, nobody is paged who may be dead.

        A page suspends the piconet, and who pages cannot be paged: but nobody pages the first, as long as it is alone.
        """
        spent = 0 if self._paging is None else now - self._paging[1]
        self._paging = None
        self._tried[peer] = now
        self._waits[peer] = min(2 * self._waits[peer], self._most)
        if self.slaves or self.me != self._first:
            times = 2 * (SERVICE if self.slaves else 1) + self.me  # no two that page each other do so in step for ever
            self._rests_until = now + times * spent // 2

    def drain(self) -> list[LinkCommand]:
        """Return the link commands that are to be carried out, once."""
        out, self._out = self._out, []
        return out
