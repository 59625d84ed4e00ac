"""An abstract Bluetooth: links that take time to make and to lose, frames that travel along links only.

What a radio does to formation and repair without its slots: an inquiry and a page take a random time, a page to a
device that does not scan fails, a device does one of them at a time; unicasts arrive in order, once, while their link
lasts; each receiver misses a broadcast with a given chance; the end of a device is noticed after the supervision time.
"""

from collections import deque
from functools import partial

import numpy as np

from cosim.channels.base import Channel
from cosim.kernel import Kernel
from cosim.machine import (
    BROADCAST,
    Address,
    Connected,
    Disconnect,
    Discovered,
    Fate,
    Inquire,
    InquiryComplete,
    LinkCommand,
    LinkEvent,
    Lost,
    Outcome,
    Outgoing,
    Page,
    PageFailed,
    Reception,
    Role,
    Scan,
)
from cosim.trace import Trace
from cosim.units import MS, S, Time

MOST_SLAVES = 7


class LinkAir(Channel):
    """All devices of a run; *loss* is the chance of each receiver to miss a broadcast."""

    def __init__(
        self, kernel: Kernel, trace: Trace, size: int, seed: int, loss: float = 0.0, supervision: Time = 2 * S
    ) -> None:
        super().__init__(kernel, trace, size)
        self.links: set[tuple[Address, Address]] = set()
        """(master, slave)"""
        self.bridges_seen = 0
        self.broadcasts_lost = 0
        self._rng = np.random.default_rng(seed)
        self._loss = loss
        self._supervision = supervision
        self._on = [True] * size
        self._scan = [True] * size
        self._said_since = [True] * size
        """Scan(True) was said since the last link came up."""
        self._busy = [False] * size
        self._waiting: list[deque[Inquire | Page]] = [deque() for _ in range(size)]
        self._clear: dict[tuple[Address, Address], Time] = {}
        """When the last frame from one to another arrives."""

    # ------------------------------------------------------------ frames

    def send(self, source: Address, outgoing: Outgoing) -> None:
        if not self._on[source]:
            return
        if outgoing.destination == BROADCAST:
            for master, slave in sorted(self.links):
                if master == source:
                    if self._rng.random() < self._loss:
                        self.broadcasts_lost += 1
                    else:
                        self._carry(source, slave, outgoing)
        elif self._linked(source, outgoing.destination):
            self._carry(source, outgoing.destination, outgoing)
        elif outgoing.token is not None:
            self._tell(source, Fate(outgoing.token, Outcome.NO_LINK))

    def _carry(self, source: Address, destination: Address, outgoing: Outgoing) -> None:
        soon = self.kernel.now + int(self._rng.integers(1 * MS, 20 * MS))
        arrival = max(soon, self._clear.get((source, destination), 0) + 1)
        self._clear[source, destination] = arrival
        self.kernel.at(arrival, partial(self._arrive, source, destination, outgoing))

    def _arrive(self, source: Address, destination: Address, outgoing: Outgoing) -> None:
        if not (self._on[source] and self._on[destination] and self._linked(source, destination)):
            return
        news: list[tuple[Address, LinkEvent]] = []
        if outgoing.token is not None:
            news.append((source, Fate(outgoing.token, Outcome.DELIVERED)))
        reception = Reception(source, outgoing.destination == BROADCAST)
        self.deliver([(destination, outgoing.payload, reception)], news)

    def _tell(self, address: Address, event: LinkEvent, delay: Time = 1) -> None:
        self.kernel.after(delay, partial(self._pass_on, address, event))

    def _pass_on(self, address: Address, event: LinkEvent) -> None:
        if self._on[address]:
            self.deliver((), [(address, event)])

    # ------------------------------------------------------------ links

    def command(self, source: Address, command: LinkCommand) -> None:
        if not self._on[source]:
            return
        match command:
            case Inquire() | Page():
                self._waiting[source].append(command)
                self._begin(source)
            case Scan(enabled=enabled):
                self._scan[source] = self._said_since[source] = enabled
            case Disconnect(peer=peer) if self._linked(source, peer):
                self._cut(source, peer)
                self._tell(source, Lost(peer))
                self._tell(peer, Lost(source), 20 * MS)

    def in_reach(self, address: Address) -> tuple[Address, ...]:
        return tuple(a for a in range(self.size) if a != address and self._on[a] and self._on[address])

    def power(self, address: Address, on: bool) -> None:
        self._on[address] = on
        self._waiting[address].clear()
        for one, other in sorted(self.links):
            if address in (one, other):
                self._cut(one, other)
                self._tell(other if one == address else one, Lost(address), self._supervision)

    def has_links(self, address: Address) -> bool:
        return any(address in link for link in self.links)

    def _linked(self, one: Address, other: Address) -> bool:
        return (one, other) in self.links or (other, one) in self.links

    def _cut(self, one: Address, other: Address) -> None:
        self.links -= {(one, other), (other, one)}

    def _scans(self, address: Address) -> bool:
        willing = self._said_since[address] if self.has_links(address) else self._scan[address]
        return self._on[address] and willing and not self._busy[address]

    # ------------------------------------------------------------ procedures

    def _begin(self, source: Address) -> None:
        if self._busy[source] or not self._waiting[source]:
            return
        self._busy[source] = True
        match self._waiting[source].popleft():
            case Inquire(duration=duration, enough=enough):
                end = self.kernel.now + duration
                answers = sorted((int(self._rng.integers(200 * MS, 6 * S)), a) for a in self.in_reach(source))
                self._await_answers(source, end, enough, answers)
            case Page(peer=peer):
                self.kernel.after(int(self._rng.integers(300 * MS, 2 * S)), partial(self._paged, source, peer))

    def _await_answers(self, source: Address, end: Time, enough: int, answers: list[tuple[int, Address]]) -> None:
        began, found = self.kernel.now, list[Address]()

        def answer(address: Address) -> None:
            if self._scans(address) and self._on[source] and len(found) < enough:
                found.append(address)
                self._pass_on(source, Discovered(address, address + 1))
                if len(found) == enough:
                    self._done(source, InquiryComplete(tuple(found)))

        def over() -> None:
            if len(found) < enough:
                self._done(source, InquiryComplete(tuple(found)))

        for delay, address in answers:
            if began + delay < end:
                self.kernel.at(began + delay, partial(answer, address))
        self.kernel.at(end, over)

    def _paged(self, source: Address, peer: Address) -> None:
        full = sum(master == source for master, _ in self.links) >= MOST_SLAVES
        if not self._scans(peer) or not self._on[source] or full or self._linked(source, peer):
            self.kernel.after(4 * S, partial(self._done, source, PageFailed(peer)))
            return
        self.links.add((source, peer))
        self.bridges_seen = max(self.bridges_seen, sum(self.is_bridge(address) for address in range(self.size)))
        self._said_since[source] = self._said_since[peer] = False
        self._pass_on(peer, Connected(source, Role.SLAVE))
        self._done(source, Connected(peer, Role.MASTER))

    def is_bridge(self, address: Address) -> bool:
        return sum(slave == address for _, slave in self.links) + any(m == address for m, _ in self.links) > 1

    def _done(self, source: Address, answer: LinkEvent) -> None:
        self._busy[source] = False
        if not self._on[source]:
            return
        self.deliver((), [(source, answer)])
        self._begin(source)
