"""A robot's part in the formation of a scatternet: it is welcomed, may be told whom to page, and divides its time.

See ``scatternet`` for the whole.
"""

from abc import abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from cosim.machine import (
    Address,
    Connected,
    Disconnect,
    Outgoing,
    Page,
    Role,
    Scan,
    Share,
)
from cosim.units import Time
from protocols.pseudonet.bluetooth import Bluetooth, Input, Setup
from protocols.pseudonet.parameters import TeamParameters, Timing
from protocols.pseudonet.relay import Relay
from protocols.pseudonet.topology import Directory, Piconet, colour, colours
from protocols.pseudonet.wide import Assignment, Welcome, encode

PAUSE_PERIODS = 2
"""Periods of the piconets' time between two pages: a device that pages is absent from its piconets."""
MORE_ATTEMPTS = 2
"""A bridge may be paging others when it is paged."""
NOBODY = Directory(())


@dataclass(slots=True)
class Job:
    """A robot that is to be paged."""

    peer: Address
    attempts: int
    clock_offset: int | None = None


class Membership(Bluetooth):
    """A robot that is given its place in a scatternet. *relay* is the broadcast room above."""

    def __init__(
        self,
        me: Address,
        size: int,
        links: dict[Address, Role],
        times: Timing,
        parameters: TeamParameters,
        relay: Relay,
        taken: Callable[[Time], None],
    ) -> None:
        super().__init__(me, size, links, times, parameters, self._report, taken)
        self._patience = times.stagger + times.stagger // 4  # the root gives up after the stagger, and says so
        self._relay = relay
        self._topology = parameters.topology
        self._most = parameters.piconet_size
        self._slots = parameters.share_slots
        self._offsets: dict[Address, int] = {}
        self._jobs: list[Job] = []
        self._piconets: dict[int, Address] = {}
        """The masters of the piconets that this robot is in, by number."""
        self._count = 0
        self._number = 0
        self._root: Address | None = None
        self._formation = 0
        """Of whose formation, and which of them, this robot is a part."""
        self._formations = 0
        self._assigned: dict[int, Assignment] = {}
        self._connecting = False
        """As the coordinator: the masters are being paged."""
        self._pausing = False
        """Between two pages, so that the links that there are are not starved."""
        self._called = False
        self._token = 0
        self._design: list[Piconet] = []
        self._untold: dict[int, Address] = {}
        """By token of its last assignment, each master that has not been told everything yet."""
        self._leaving: set[Address] = set()

    @abstractmethod
    def _report(self, slaves: tuple[Address, ...], hop: tuple[int, int], now: Time) -> None:
        """Report that all slaves are paged, and wait for the roll call."""

    @abstractmethod
    def _attend(self, master: Address) -> None:
        """Be there for the welcome of a new master."""

    @abstractmethod
    def _next(self, now: Time) -> None:
        """Go on with paging, or with what comes after it."""

    def called_up(self, members: tuple[Address, ...]) -> None:
        """Take notice that this robot is in a team of *members*."""
        super().called_up(members)
        if not self._called and self.links:
            self.out.append(Scan(enabled=False))
        self._called = True

    def _close(self, now: Time) -> None:
        self._relay.leave()
        self._forget()
        self.out.append(Share(2 * self._slots, (), self.me))
        super()._close(now)

    def _forget(self) -> None:
        """Be in no formation."""
        self._called = self._pausing = False
        self._root = None
        self._piconets.clear()
        self._assigned.clear()
        self._untold.clear()
        self._leaving.clear()

    def reform(self, dead: Iterable[Address], now: Time) -> None:
        """Leave the scatternet, when there was time to pass on that it is dissolved, and begin anew."""
        self._others = tuple(other for other in self._others if other not in set(dead))
        if not self.links:
            self._close(now)
            return
        self._move(Input.BREAK_UP, now)
        self.deadline = now + self._times.settle

    def _connected(self, event: Connected, now: Time) -> None:
        if self.state is not Setup.PAGING or not self._jobs or event.peer != self._jobs[0].peer:
            self.out.append(Disconnect(event.peer))  # the answer to a page that I have given up
            return
        self.hop = (event.hop_address, event.hop_clock)
        self.links[event.peer] = Role.MASTER
        if not self._connecting:
            self._welcome(event.peer)
            self._relay.met(event.peer)
            self.out.append(Scan(enabled=True))
        self._paged(now)

    def _welcome(self, slave: Address) -> None:
        packet = Welcome(self._number, self._count, self._root or 0, self._formation, *self.hop)
        self.out.append(Outgoing(slave, encode(packet, NOBODY)))

    def _paged_by(self, peer: Address, now: Time) -> None:
        forming = self.state is Setup.JOINED or (self.state in (Setup.PAGING, Setup.LEADING) and self._root is not None)
        if forming and not (self._left or self._called):
            self.links[peer] = Role.SLAVE  # a bridge, or a master that is a slave as well
            self._relay.met(peer)
            self._attend(peer)
            return
        super()._paged_by(peer, now)
        if self.state is Setup.JOINED and peer in self.links:
            self._forget()

    def instruct(self, packet: Assignment | Welcome, source: Address, now: Time) -> None:
        """Take what a master says while the scatternet is formed."""
        if self.links.get(source) is not Role.SLAVE or self._called:
            return
        if self._root not in (None, packet.root) or (self._formation != packet.formation and self._root is not None):
            self._refuse(packet, source, now)
            return
        self._root = packet.root
        self._formation = packet.formation
        self._count = packet.piconets
        self._relay.enter()
        if self.state is Setup.JOINED:
            self.deadline = now + self._patience
        match packet:
            case Welcome():
                self._piconets[packet.piconet] = source
                self._divide_time()
                self.out.append(Scan(enabled=True))  # it may be a bridge
            case Assignment() if self.state is Setup.JOINED:
                self._assigned[packet.place] = packet
                if len(self._assigned) == packet.count:
                    self._begin_own(packet, now)

    def _refuse(self, packet: Assignment | Welcome, source: Address, now: Time) -> None:
        """Belong to one formation only; if the coordinator has begun anew, the one that I am a part of is void."""
        del self.links[source]
        self.out.append(Disconnect(source))
        if packet.root == self._root:
            self._relay.dissolve((), now)

    def _begin_own(self, packet: Assignment, now: Time) -> None:
        self._number = packet.piconet
        self._piconets[packet.piconet] = self.me
        self._divide_time()
        attempts = self._page_attempts + MORE_ATTEMPTS
        self._jobs = [Job(a.slave, attempts, a.clock_offset) for _, a in sorted(self._assigned.items())]
        self._move(Input.ASSIGNED, now)

    def _divide_time(self) -> None:
        """Ask the device to be in each piconet during the part of its colour, if that is needed."""
        if self._count < 2 or (len(self._piconets) < 2 and self.me not in self._piconets.values()):
            return
        slots = self._slots
        parts = tuple(
            (master, slots * colour(self._topology, number, self._count, self._most), slots)
            for number, master in sorted(self._piconets.items())
        )
        if len({first for _, first, _ in parts}) < len(parts):
            return  # no topology has a device in two piconets of one colour: some master does not know what it says
        self.out.append(Share(slots * colours(self._topology, self._count), parts, self._root or 0))

    def wake(self, now: Time) -> None:
        """Act on the deadline: go on with paging, or give up waiting."""
        if self._pausing and self.deadline is not None and now >= self.deadline:
            self._pausing = False
            if self.state is Setup.PAGING:
                self._move(Input.NEXT, now)
                return
        super().wake(now)

    def _page(self) -> None:
        job = self._jobs[0]
        self.out.append(Page(job.peer, job.clock_offset))

    def _page_failed(self, now: Time) -> None:
        if self._untold or not self._jobs:  # nobody was paged: some master has not acknowledged its assignments
            self._untold.clear()
            self._next(now)
            return
        job = self._jobs[0]
        if job.attempts > 1:
            self._jobs.append(Job(job.peer, job.attempts - 1, job.clock_offset))
        self._paged(now)

    def _paged(self, now: Time) -> None:
        self.page_time += now - self._since
        self._jobs.pop(0)
        self._next(now)
