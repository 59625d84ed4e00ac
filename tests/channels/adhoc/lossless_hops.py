"""A network for tests of routers: hops that always arrive after the same time, over links that a test can cut."""

from collections.abc import Callable, Iterable
from functools import partial
from heapq import heappop, heappush
from itertools import count

from cosim.channels.adhoc.mac import Packet
from cosim.channels.adhoc.routing.base import Delivery, Router
from cosim.machine import BROADCAST, Address, Outcome
from cosim.units import MS, Time

DELAY = MS


class LosslessHops:
    """Routers 0, 1, ... and *links* in both directions; a unicast over no link is told to be unacknowledged."""

    def __init__(self, routers: list[Router], links: Iterable[tuple[Address, Address]]) -> None:
        self.routers = routers
        self.links = {frozenset(link) for link in links}
        self.now: Time = 0
        self.delivered: list[tuple[Time, Address, Delivery]] = []
        self.fates: list[tuple[Time, Address, int, Outcome]] = []
        self.sent: list[tuple[Time, Address, Packet]] = []
        self._events: list[tuple[Time, int, Callable[[], None]]] = []
        self._order = count()
        self._woken: dict[Address, Time] = {}
        for address in range(len(routers)):
            self._drain(address)

    def at(self, time: Time, action: Callable[[], None]) -> None:
        heappush(self._events, (time, next(self._order), action))

    def send(self, source: Address, destination: Address, payload: bytes, token: int | None = None) -> None:
        self.routers[source].send(destination, payload, token, self.now)
        self._drain(source)

    def run(self, until: Time) -> None:
        """Let everything happen until *until*, including what happens then."""
        while self._events and self._events[0][0] <= until:
            self.now, _, action = heappop(self._events)
            action()
        self.now = until

    def _drain(self, address: Address) -> None:
        router = self.routers[address]
        for hop in router.hops():
            self.sent.append((self.now, address, hop))
            self.at(self.now + DELAY, partial(self._arrive, address, hop))
        self.delivered += [(self.now, address, each) for each in router.deliveries()]
        self.fates += [(self.now, address, *each) for each in router.fates()]
        at = router.wake_at()
        if at is not None and self._woken.get(address) != at:
            assert at >= self.now
            self._woken[address] = at
            self.at(at, lambda: self._wake(address))

    def _wake(self, address: Address) -> None:
        self.routers[address].wake(self.now)
        self._drain(address)

    def _arrive(self, source: Address, hop: Packet) -> None:
        targets = range(len(self.routers)) if hop.destination == BROADCAST else (hop.destination,)
        heard = [each for each in targets if frozenset((source, each)) in self.links]
        for each in heard:
            self.routers[each].receive(hop.payload, source, self.now)
            self._drain(each)
        if hop.token is not None:
            self.routers[source].hop_done(hop.token, bool(heard) or hop.destination == BROADCAST, self.now)
            self._drain(source)
