"""The Bluetooth layer of teams that need several piconets: formation by a coordinator, after BTCP.

BTCP (see ``topology``) elects its coordinator by meetings of pairs; here it is the paper's appointed initiator, or the
robot that stands in for it (``bluetooth``). The rest is BTCP's: the coordinator has found all others by inquiry, so
that it knows their addresses and clocks; it pages as many as there must be masters, designs the topology, and sends
each master the robots to page as its slaves, with their clocks relative to the master's:

    offset(master -> slave) = offset(coordinator -> slave) - offset(coordinator -> master)  mod 2**28

Then it leaves those masters that are not to be its own slaves, and pages its own. Masters welcome their slaves: so each
robot learns which piconet it is in, and, where there are several, how its time is divided among them. When a master has
paged all its slaves it reports to the root, the coordinator, which calls the roll when all have reported. If masters do
not report in time the scatternet is dissolved and formed again without them; so it is when it breaks (``relay``).
There is no local repair.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from cosim.machine import (
    Address,
    Connected,
    Disconnect,
    Discovered,
    Fate,
    LinkEvent,
    Lost,
    Outgoing,
    Page,
    PageFailed,
    Role,
    Scan,
    Share,
)
from cosim.units import SLOT, Time
from protocols.pseudonet.bluetooth import Bluetooth, LinkInput, LinkState
from protocols.pseudonet.parameters import TeamParameters, Timing
from protocols.pseudonet.relay import Relay
from protocols.pseudonet.topology import Directory, Piconet, colour, colours, design, piconets_needed
from protocols.pseudonet.wide import Assignment, Census, Welcome, encode

CLOCK_RANGE = 1 << 28
PAUSE_PERIODS = 2
"""Pause between two pages, in periods of the piconets: a device that pages is absent from its piconets."""
MORE_ATTEMPTS = 2
"""Additional attempts to page a slave: a bridge may be paging others when it is paged."""
NOBODY = Directory(())


@dataclass(slots=True)
class Job:
    """A page that is to be made."""

    peer: Address
    attempts: int
    clock_offset: int | None = None


class Scatternet(Bluetooth):
    """One robot's share of the formation of a scatternet; *relay* is the broadcast layer above."""

    def __init__(
        self,
        me: Address,
        team: tuple[int, int],
        links: dict[Address, Role],
        times: Timing,
        parameters: TeamParameters,
        relay: Relay,
        taken: Callable[[Time], None],
    ) -> None:
        """*team* is its size, and the most devices of each of its piconets."""
        size, self._most = team
        super().__init__(me, size, links, times, parameters, self._report, taken)
        self._patience = times.stagger + times.stagger // 4  # the root gives up after the stagger, and announces it
        self._relay = relay
        self._topology = parameters.topology
        self._slots = parameters.share_slots
        self._offsets: dict[Address, int] = {}
        self._jobs: list[Job] = []
        self._piconets: dict[int, Address] = {}
        """Masters of the piconets that this robot is in, by number of the piconet."""
        self._count = 0
        self._number = 0
        self._root: Address | None = None
        """Coordinator of the formation that this robot is a part of."""
        self._formation = 0
        """Number of that formation among the coordinator's."""
        self._formations = 0
        self._assigned: dict[int, Assignment] = {}
        self._connecting = False
        """True while the coordinator pages the masters."""
        self._pausing = False
        """True between two pages: a pause, so that the present links are not starved."""
        self._called = False
        self._token = 0
        self._design: list[Piconet] = []
        self._untold: dict[int, Address] = {}
        """Masters whose last assignment, with this token, has not been acknowledged yet."""
        self._leaving: set[Address] = set()

    def called_up(self, members: tuple[Address, ...]) -> None:
        """Process that this robot is in a team of *members*."""
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
        """Forget the formation."""
        self._called = self._pausing = False
        self._root = None
        self._piconets.clear()
        self._assigned.clear()
        self._untold.clear()
        self._leaving.clear()

    def reform(self, dead: Iterable[Address], now: Time) -> None:
        """Leave the scatternet, after a time to forward its dissolution, and begin the set-up again."""
        self._others = tuple(other for other in self._others if other not in set(dead))
        if not self.links:
            self._close(now)
            return
        self._move(LinkInput.BREAK_UP, now)
        self.deadline = now + self._times.settle

    def link(self, event: LinkEvent, now: Time) -> None:
        """Process a link event."""
        match event:
            case Discovered(peer=peer, clock_offset=offset):
                self._offsets[peer] = offset
                super().link(event, now)
            case Connected(peer=peer, role=role) if role is not Role.SLAVE:
                self._connected(event, now)
            case PageFailed(peer=peer) if self.state is LinkState.PAGING and self._jobs and peer == self._jobs[0].peer:
                self._page_failed(now)
            case PageFailed():
                pass
            case Lost(peer=peer) if peer in self._leaving:
                self._leaving.discard(peer)
            case _:
                super().link(event, now)

    def fate(self, fate: Fate, now: Time) -> None:
        """Leave a master that has all its assignments, unless it is to be a slave of this one."""
        master = self._untold.pop(fate.token, None)
        if master is None:
            return
        if master not in self._design[0].slaves and master in self.links:
            del self.links[master]
            self._leaving.add(master)
            self.out.append(Disconnect(master))
        if not self._untold and self.state is LinkState.PAGING:
            self._next(now)

    def wake(self, now: Time) -> None:
        """Act on the deadline: go on with paging, or give up waiting."""
        if self._pausing and self.deadline is not None and now >= self.deadline:
            self._pausing = False
            if self.state is LinkState.PAGING:
                self._move(LinkInput.NEXT, now)
                return
        super().wake(now)

    # ------------------------------------------------------------ as any robot: being given a place

    def instruct(self, packet: Assignment | Welcome, source: Address, now: Time) -> None:
        """Process what a master sends while the scatternet is formed."""
        if self.links.get(source) is not Role.SLAVE or self._called:
            return
        if self._root not in (None, packet.root) or (self._formation != packet.formation and self._root is not None):
            self._refuse(packet, source, now)
            return
        self._root = packet.root
        self._formation = packet.formation
        self._count = packet.piconets
        self._relay.enter()
        if self.state is LinkState.JOINED:
            self.deadline = now + self._patience
        match packet:
            case Welcome():
                self._piconets[packet.piconet] = source
                self._divide_time()
                self.out.append(Scan(enabled=True))  # it may be a bridge
            case Assignment() if self.state is LinkState.JOINED:
                self._assigned[packet.place] = packet
                if len(self._assigned) == packet.count:
                    self._begin_own(packet, now)

    def _refuse(self, packet: Assignment | Welcome, source: Address, now: Time) -> None:
        """Refuse a second formation; if it is of the same coordinator, dissolve the first, which is void."""
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
        self._move(LinkInput.ASSIGNED, now)

    def _divide_time(self) -> None:
        """Have the device be in each piconet during the part of its colour, if that is needed."""
        if self._count < 2 or (len(self._piconets) < 2 and self.me not in self._piconets.values()):
            return
        slots = self._slots
        parts = tuple(
            (master, slots * colour(self._topology, number, self._count, self._most), slots)
            for number, master in sorted(self._piconets.items())
        )
        if len({first for _, first, _ in parts}) < len(parts):
            return  # no topology has a device in two piconets of one colour: some master is wrong
        self.out.append(Share(slots * colours(self._topology, self._count), parts, self._root or 0))

    def _connected(self, event: Connected, now: Time) -> None:
        if self.state is not LinkState.PAGING or not self._jobs or event.peer != self._jobs[0].peer:
            self.out.append(Disconnect(event.peer))  # the answer to a page that was given up
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
        forming = self.state is LinkState.JOINED or (
            self.state in (LinkState.PAGING, LinkState.LEADING) and self._root is not None
        )
        if forming and not (self._left or self._called):
            self.links[peer] = Role.SLAVE  # a bridge, or a master that is a slave as well
            self._relay.met(peer)
            self._attend(peer)
            return
        super()._paged_by(peer, now)
        if self.state is LinkState.JOINED and peer in self.links:
            self._forget()

    def _lost(self, peer: Address, now: Time) -> None:
        super()._lost(peer, now)
        if peer in self._untold.values():
            self._untold = {token: master for token, master in self._untold.items() if master != peer}
            if not self._untold and self.state is LinkState.PAGING and not self._connecting:
                self._next(now)

    def _report(self, slaves: tuple[Address, ...], hop: tuple[int, int], now: Time) -> None:
        """Report that all slaves are paged, and wait for the roll call."""
        if self._root is None:  # no other robot may be alive
            self._coordinate()
            self._finish_design(now)
        self.deadline = None if self._root == self.me else now + self._patience
        own = Piconet(self.me, slaves)
        census = Census(False, 0, 0, self._number, self._count, self._root or 0, self._formation, own)
        self._relay.enter()
        self._relay.placed(census, now)

    def _attend(self, master: Address) -> None:
        """Be present for the welcome of a new master: without parts a device is where its last link came up."""
        numbers = [number for number, piconet in enumerate(self._design) if piconet.master == master]
        if self._root == self.me and numbers:
            self._piconets[numbers[0]] = master
            self._divide_time()
        elif self._piconets:
            self.out.append(Share(2 * self._slots, (), self.me))

    # ------------------------------------------------------------ as a master or the coordinator: paging

    def _page(self) -> None:
        job = self._jobs[0]
        self.out.append(Page(job.peer, job.clock_offset))

    def _page_failed(self, now: Time) -> None:
        if self._untold or not self._jobs:  # no robot was paged: some master has not acknowledged its assignments
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

    def _next(self, now: Time) -> None:
        if self._connecting and len(self._masters()) == self._count:
            self._jobs.clear()
        if self._jobs:
            self._pausing = True
            self.deadline = now + PAUSE_PERIODS * SLOT * self._slots * colours(self._topology, self._count)
        elif self._connecting:
            self._assign(now)
        elif not self._untold:
            self._move(LinkInput.ALL_PAGED, now)

    # ------------------------------------------------------------ as the coordinator: designing the scatternet

    def _masters(self) -> list[Address]:
        return [self.me, *(peer for peer, role in self.links.items() if role is Role.MASTER)]

    def _inquired(self, now: Time) -> None:
        self.inquiry_time += now - self._since
        if self._look_again():
            self._move(LinkInput.TOO_FEW, now)
            return
        self._coordinate()
        self._count = piconets_needed(1 + len(self.found), self._topology, self._most)
        self._connecting = True
        self._jobs = [Job(peer, self._page_attempts) for peer in self.found] if self._count > 1 else []
        if not self.found:
            self._finish_design(now)
            self._move(LinkInput.ALONE, now)
        elif self._jobs:
            self._move(LinkInput.ENOUGH, now)
        else:
            self._finish_design(now)
            self._move(LinkInput.ENOUGH, now)

    def _coordinate(self) -> None:
        """Begin a new formation as its coordinator."""
        self._root = self.me
        self._formations = self._formation = (self._formations + 1) % 256
        self._number = 0
        self._piconets = {0: self.me}

    def _finish_design(self, now: Time) -> None:
        """Design the topology of all robots found, with those that are connected as masters."""
        self._connecting = False
        masters = self._masters()
        others = [peer for peer in self.found if peer not in masters]
        self._count = len(masters)
        self._design = design(masters, others, self._topology, self._most)
        attempts = self._page_attempts + MORE_ATTEMPTS
        self._jobs = [Job(peer, attempts) for peer in self._design[0].slaves if peer not in masters]
        deadline = now + self._times.stagger
        self._relay.enter()
        self._relay.registry.expect(tuple(piconet.master for piconet in self._design), self._formation, deadline)

    def _assign(self, now: Time) -> None:
        self._finish_design(now)
        for number, piconet in enumerate(self._design[1:], 1):
            if piconet.master in self._design[0].slaves:
                self._welcome(piconet.master)
            self._tell_slaves(number, piconet)
        self._divide_time()
        self.out.append(Scan(enabled=True))
        self.deadline = now + self._times.page
        if not self._untold:
            self._next(now)

    def _tell_slaves(self, number: int, piconet: Piconet) -> None:
        base = self._offsets.get(piconet.master, 0)
        for place, slave in enumerate(piconet.slaves, 1):
            offset = (self._offsets.get(slave, 0) - base) % CLOCK_RANGE
            count = len(piconet.slaves)
            last = place == count
            order = Assignment(number, self._count, self.me, self._formation, count, place, slave, offset)
            if last:
                self._token += 1
                self._untold[self._token] = piconet.master
            self.out.append(Outgoing(piconet.master, encode(order, NOBODY), self._token if last else None))
