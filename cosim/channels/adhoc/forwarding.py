"""The routers of a network, driven between hosts and stations as nodes drive machines.

A router that is switched on is a new one, without memory.
"""

from collections.abc import Callable, Iterable
from typing import Protocol

from cosim.channels.adhoc.mac import Packet
from cosim.channels.adhoc.routing.aodv import Aodv
from cosim.channels.adhoc.routing.aodv_settings import AodvSettings
from cosim.channels.adhoc.routing.base import Delivery, Router
from cosim.channels.adhoc.routing.flooding import Flooding, FloodingSettings
from cosim.channels.adhoc.routing.olsr import Olsr, OlsrSettings
from cosim.channels.adhoc.routing.watch import RouteWatch
from cosim.channels.adhoc.settings import RoutingSettings
from cosim.errors import LocalProtocolError
from cosim.intervals import Intervals
from cosim.kernel import WAKE, Handle, Kernel
from cosim.machine import Address, Outcome, Outgoing
from cosim.protocol import Metric
from cosim.randomness import Draws
from cosim.units import Time


class Ends(Protocol):
    """The two ends that routers stand between: stations and hosts."""

    def transmit(self, address: Address, packet: Packet) -> None:
        """Have the station of *address* send *packet* to a neighbour, or to all in reach; or call ``refused``."""

    def arrived(self, address: Address, delivery: Delivery) -> None:
        """Hand a payload to the host of *address*."""

    def note_unsent(self, source: Address, destination: Address, length: int, why: Outcome) -> None:
        """Count a payload of *source* that has never been on the air."""

    def report_fate(self, address: Address, token: int, outcome: Outcome) -> None:
        """Report the fate of a payload to the host of *address*."""


def make_router(settings: RoutingSettings, address: Address, draws: Draws, now: Time) -> Router:
    """Return the router of the robot *address*, which begins at *now* and knows nothing."""
    match settings:
        case FloodingSettings():
            return Flooding(address, settings, draws, now)
        case AodvSettings():
            return Aodv(address, settings, draws, now)
        case OlsrSettings():
            return Olsr(address, settings, draws, now)


class Forwarding:
    """All routers of a run."""

    def __init__(
        self,
        size: int,
        make: Callable[[Address, Time], Router],
        kernel: Kernel,
        ends: Ends,
        intervals: Intervals | None = None,
    ) -> None:
        """Write routes to *intervals*, if these are wanted."""
        self._make = make
        self._kernel = kernel
        self._ends = ends
        self._intervals = intervals
        self._watches: dict[Address, RouteWatch] = {}
        self.routers = [make(address, kernel.now) for address in range(size)]
        for address in range(size):
            self._watch(address)
        self._on = [True] * size
        self._past: dict[str, float] = {}
        """Counts of the earlier routers of robots that have been switched on again."""
        self._timers: list[Handle | None] = [None] * size
        for address in range(size):
            self._drain(address)

    def send(self, source: Address, outgoing: Outgoing) -> None:
        """Hand a host's payload to its router."""
        self.routers[source].send(outgoing.destination, outgoing.payload, outgoing.token, self._kernel.now)
        self._drain(source)

    def received(self, receivers: Iterable[Address], source: Address, packet: bytes) -> None:
        """Hand a packet from the air, sent by their neighbour *source*, to the routers of *receivers*."""
        now, routers = self._kernel.now, self.routers
        for address in receivers:
            if routers[address].receive(packet, source, now):
                self._drain(address)

    def done(self, address: Address, packet: Packet, acknowledged: bool) -> None:
        """Report the fate of a packet to the router at *address*."""
        if packet.token is not None:
            self.routers[address].hop_done(packet.token, acknowledged, self._kernel.now)
            self._drain(address)

    def refused(self, address: Address, packet: Packet) -> None:
        """Report to the router at *address*, within ``transmit``, that its station has no room for a packet."""
        if packet.token is not None:
            self.routers[address].hop_refused(packet.token, self._kernel.now)

    def power(self, address: Address, on: bool) -> None:
        """Stop the router at *address*, or put a new one without memory in its place."""
        self._on[address] = on
        if on:
            _add(self._past, self.routers[address].summary())
            self.routers[address] = self._make(address, self._kernel.now)
            self._watch(address)
        elif address in self._watches:
            self.routers[address].settle(self._kernel.now)
            self.routers[address].be_watched(None)
            self._watches.pop(address).take_all({}, self._kernel.now)
        self._drain(address)

    def settle(self, now: Time) -> None:
        """End intervals of routes that are over *now*."""
        for address in self._watches:
            self.routers[address].settle(now)

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """The metrics that ``summary`` returns."""
        return self.routers[0].metrics

    def summary(self) -> dict[str, float]:
        """Return what all routers have counted, summed up, earlier ones included."""
        total = dict(self._past)
        for router in self.routers:
            _add(total, router.summary())
        return total

    def _watch(self, address: Address) -> None:
        """Write down the routes of a new router, if these are wanted."""
        if self._intervals is not None and self._intervals.wanted:
            self._watches[address] = RouteWatch(address, self._intervals)
            self.routers[address].be_watched(self._watches[address])

    def _drain(self, address: Address) -> None:
        """Act on what a router has left, and schedule its next wake."""
        if not self._on[address]:
            return
        router, ends = self.routers[address], self._ends
        if router.left:
            for packet in router.hops():
                ends.transmit(address, packet)
        if router.left:  # mostly there were packets only
            for delivery in router.deliveries():
                ends.arrived(address, delivery)
            for token, outcome in router.fates():
                ends.report_fate(address, token, outcome)
            for destination, length, why in router.unsent():
                ends.note_unsent(address, destination, length, why)
        deadline, timer = router.wake_at(), self._timers[address]
        if deadline is not None and (timer is None or deadline < timer.time):  # one that is too early looks again
            self._arm(address, deadline)

    def _arm(self, address: Address, deadline: Time) -> None:
        timer = self._timers[address]
        if timer is not None:
            timer.cancel()
        wake = max(deadline, self._kernel.now)
        self._timers[address] = self._kernel.at(wake, lambda: self._wake(address), WAKE)

    def _wake(self, address: Address) -> None:
        self._timers[address] = None
        if not self._on[address]:
            return
        now, deadline = self._kernel.now, self.routers[address].wake_at()
        if deadline is not None and deadline <= now:
            self.routers[address].wake(now)
            again = self.routers[address].wake_at()
            if again is not None and again <= now:
                raise LocalProtocolError(f"router {address}: after wake({now}) wake_at() is {again}, not later")
        self._drain(address)


def _add(total: dict[str, float], counts: dict[str, float]) -> None:
    for name, count in counts.items():
        total[name] = total.get(name, 0.0) + count
