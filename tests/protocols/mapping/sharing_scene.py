"""Robots that share maps, without bodies: what their sensors see, and who hears whom, is said by hand."""

from collections.abc import Callable
from typing import Any

import numpy as np

from cosim.machine import BROADCAST, Address, Connected, LinkCommand, Lost, Outgoing, Page, PageFailed, Reception, Role
from cosim.units import MS, S, Time
from protocols.mapping.frames import Message, Piece, decode
from protocols.mapping.sharing import Sharing, SharingCounters, SharingParameters
from protocols.transport.parameters import PagingParameters

CELLS = 400
MASTER: Address = 0
PERIOD: Time = S
TICK: Time = 100 * MS
UNKNOWN, EMPTY, OCCUPIED = 0, 1, 2


class Team:
    """Robots of which each hears whom *reach* says, unless a frame is lost; with *links*, if it has a link to them."""

    def __init__(
        self,
        size: int,
        certain: bool = True,
        octets: int = 60,
        again: int = 4,
        loss: float = 0.0,
        links: bool = False,
    ) -> None:
        self.reach: Callable[[Address, Address], bool] = lambda teller, hearer: True
        self.now: Time = 0
        self.loss = loss
        self.frames: list[tuple[Address, bytes]] = []
        """All that was sent, and by whom."""
        self.pages: list[Address] = []
        """All who were paged, in order."""
        self._settings = certain, octets, again, links
        self._linked: set[Address] = set()
        self._luck = np.random.default_rng(size)
        self._certain = certain
        self.counters = [SharingCounters() for _ in range(size)]
        self.robots = [self._robot(me, size) for me in range(size)]
        self.maps = np.zeros((size, CELLS), np.int8)

    def _robot(self, me: Address, size: int) -> Sharing:
        certain, octets, again, links = self._settings
        own = PagingParameters(patience_s=6.0, page_s=1.0, page_most_s=8.0) if links else None
        parameters = SharingParameters(octets=octets, again=again, links=own)
        return Sharing(parameters, me, size, CELLS, self.counters[me], self.now, certain)

    def boot(self, me: Address) -> None:
        """Have a robot boot again: it has forgotten everything."""
        self.robots[me] = self._robot(me, len(self.robots))
        self.maps[me] = UNKNOWN

    def see(self, me: Address, cell: int, state: int) -> None:
        """Have a robot's sensors see a cell; what is certain to be occupied stays so."""
        before = self.maps[me, cell]
        if before != state and not (self._certain and before == OCCUPIED):
            self.maps[me, cell] = state
            self.robots[me].changed(np.array([cell], np.int32), [state == OCCUPIED])

    def hear(self, me: Address, sender: Address, data: bytes, broadcast: bool = True) -> None:
        """Have a robot hear a frame, and take over what it tells."""
        told = self.robots[me].receive(data, Reception(sender, broadcast), self.now)
        if told is not None:
            take = told.newer | (self.maps[me, told.cells] == UNKNOWN)
            self.maps[me, told.cells[take]] = np.where(told.occupied[take], OCCUPIED, EMPTY)

    def tick(self) -> None:
        """Have all robots tell what is due, and hear it, and the answers to it."""
        for robot in self.robots:
            robot.tick(1.0 * robot.me, 0.0, self.now)
        self._lose_links()
        while sent := [(robot.me, item) for robot in self.robots for item in robot.drain()]:
            for teller, item in sent:
                if not isinstance(item, Outgoing):
                    self._command(teller, item)
                    continue
                self.frames.append((teller, item.payload))
                to_all = item.destination == BROADCAST
                for hearer in range(len(self.robots)) if to_all else (item.destination,):
                    if hearer != teller and self._carries(teller, hearer) and self._luck.random() >= self.loss:
                        self.hear(hearer, teller, item.payload, to_all)
        self.now += TICK

    def _carries(self, teller: Address, hearer: Address) -> bool:
        if self._settings[-1] and (MASTER not in (teller, hearer) or not {teller, hearer} - {MASTER} <= self._linked):
            return False
        return self.reach(teller, hearer)

    def _command(self, me: Address, command: LinkCommand) -> None:
        if isinstance(command, Page):
            peer = command.peer
            self.pages.append(peer)
            if self.reach(me, peer):
                self._linked.add(peer)
                self.robots[me].link(Connected(peer, Role.MASTER), self.now)
                self.robots[peer].link(Connected(me, Role.SLAVE), self.now)
            else:
                self.robots[me].link(PageFailed(peer), self.now)

    def _lose_links(self) -> None:
        for peer in [peer for peer in self._linked if not self.reach(MASTER, peer)]:
            self._linked.discard(peer)
            self.robots[MASTER].link(Lost(peer), self.now)
            self.robots[peer].link(Lost(MASTER), self.now)

    def pass_periods(self, count: int) -> None:
        for _ in range(count * PERIOD // TICK):
            self.tick()

    def messages(self, kind: type[Any]) -> list[tuple[Address, Any]]:
        """Return all messages of a kind that were sent, and by whom."""
        found: list[tuple[Address, Message]] = [decode(data) for _, data in self.frames]
        return [(sender, message) for sender, message in found if isinstance(message, kind)]

    def told(self) -> list[tuple[Address, int, int]]:
        """Return author, life and number of all pieces that were sent, in order."""
        return [(*piece.stream, piece.number) for _, piece in self.messages(Piece)]

    def count(self, name: str) -> int:
        """Return what all robots have counted."""
        return sum(getattr(counters, name) for counters in self.counters)

    @property
    def agree(self) -> bool:
        """Whether all have the same pieces, and the same map."""
        first = self.robots[0].ledger.counts
        alike = all(robot.ledger.counts == first for robot in self.robots)
        return alike and bool((self.maps == self.maps[0]).all())
