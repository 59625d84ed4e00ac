"""The Bluetooth room of teams that need several piconets: formation by a coordinator, after BTCP.

BTCP (see ``topology``) elects its coordinator by meetings of pairs; here it is the paper's appointed initiator, or who
stands in for it (``bluetooth``). The rest is BTCP's: the coordinator has found all others by inquiry, so that it knows
their addresses and clocks; it pages as many as there must be masters, designs the topology, and tells each master which
robots to page as its slaves, with their clocks relative to the master's:

    offset(master -> slave) = offset(coordinator -> slave) - offset(coordinator -> master)  mod 2**28

Then it leaves those masters that are not to be its own slaves, and pages its own. Masters welcome their slaves: so each
robot learns which piconet it is in, and, where there are several, how its time is divided among them. When a master has
paged all its slaves it reports to the root, the coordinator, which calls the roll when all have reported. If masters do
not report in time the scatternet is dissolved and formed again without them; so it is when it breaks (``relay``).
There is no local repair.
"""

from cosim.machine import (
    Address,
    Connected,
    Disconnect,
    Discovered,
    Fate,
    LinkEvent,
    Lost,
    Outgoing,
    PageFailed,
    Role,
    Scan,
    Share,
)
from cosim.units import SLOT, Time
from protocols.pseudonet.bluetooth import Input, Setup
from protocols.pseudonet.membership import MORE_ATTEMPTS, NOBODY, PAUSE_PERIODS, Job, Membership
from protocols.pseudonet.topology import Piconet, colours, design, piconets_needed
from protocols.pseudonet.wide import Assignment, Census, encode

CLOCK_RANGE = 1 << 28


class Scatternet(Membership):
    """One robot's share of the formation of a scatternet, as its coordinator or as another."""

    def _report(self, slaves: tuple[Address, ...], hop: tuple[int, int], now: Time) -> None:
        """Report that all slaves are paged, and wait for the roll call."""
        if self._root is None:  # nobody else may be alive
            self._coordinate()
            self._finish_design(now)
        self.deadline = None if self._root == self.me else now + self._patience
        own = Piconet(self.me, slaves)
        census = Census(False, 0, 0, self._number, self._count, self._root or 0, self._formation, own)
        self._relay.enter()
        self._relay.placed(census, now)

    def _attend(self, master: Address) -> None:
        """Be there for the welcome of a new master: without parts a device is where its last link came up."""
        numbers = [number for number, piconet in enumerate(self._design) if piconet.master == master]
        if self._root == self.me and numbers:
            self._piconets[numbers[0]] = master
            self._divide_time()
        elif self._piconets:
            self.out.append(Share(2 * self._slots, (), self.me))

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take news about links."""
        match event:
            case Discovered(peer=peer, clock_offset=offset):
                self._offsets[peer] = offset
                super().link(event, now)
            case Connected(peer=peer, role=role) if role is not Role.SLAVE:
                self._connected(event, now)
            case PageFailed(peer=peer) if self.state is Setup.PAGING and self._jobs and peer == self._jobs[0].peer:
                self._page_failed(now)
            case PageFailed():
                pass
            case Lost(peer=peer) if peer in self._leaving:
                self._leaving.discard(peer)
            case _:
                super().link(event, now)

    def fate(self, fate: Fate, now: Time) -> None:
        """Leave a master that has been told everything, unless it is to be a slave of this one."""
        master = self._untold.pop(fate.token, None)
        if master is None:
            return
        if master not in self._design[0].slaves and master in self.links:
            del self.links[master]
            self._leaving.add(master)
            self.out.append(Disconnect(master))
        if not self._untold and self.state is Setup.PAGING:
            self._next(now)

    def _lost(self, peer: Address, now: Time) -> None:
        super()._lost(peer, now)
        if peer in self._untold.values():
            self._untold = {token: master for token, master in self._untold.items() if master != peer}
            if not self._untold and self.state is Setup.PAGING and not self._connecting:
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
            self._move(Input.ALL_PAGED, now)

    def _masters(self) -> list[Address]:
        return [self.me, *(peer for peer, role in self.links.items() if role is Role.MASTER)]

    def _inquired(self, now: Time) -> None:
        self.inquiry_time += now - self._since
        if self._look_again():
            self._move(Input.TOO_FEW, now)
            return
        self._coordinate()
        self._count = piconets_needed(1 + len(self.found), self._topology, self._most)
        self._connecting = True
        self._jobs = [Job(peer, self._page_attempts) for peer in self.found] if self._count > 1 else []
        if not self.found:
            self._finish_design(now)
            self._move(Input.ALONE, now)
        elif self._jobs:
            self._move(Input.ENOUGH, now)
        else:
            self._finish_design(now)
            self._move(Input.ENOUGH, now)

    def _coordinate(self) -> None:
        """Begin a new formation as its coordinator."""
        self._root = self.me
        self._formations = self._formation = (self._formations + 1) % 256
        self._number = 0
        self._piconets = {0: self.me}

    def _finish_design(self, now: Time) -> None:
        """Design the topology of all that were found, with those as masters that are connected."""
        self._connecting = False
        masters = self._masters()
        others = [peer for peer in self.found if peer not in masters]
        self._count = len(masters)
        self._design = design(masters, others, self._topology, self._most)
        attempts = self._page_attempts + MORE_ATTEMPTS
        self._jobs = [Job(peer, attempts) for peer in self._design[0].slaves if peer not in masters]
        deadline = now + self._times.stagger
        self._relay.expect(tuple(piconet.master for piconet in self._design), self._formation, deadline)

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
