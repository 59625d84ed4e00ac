"""The searches of AODV for routes, with the payloads that wait for them, and limits of rates."""

from collections import deque
from dataclasses import dataclass, field

from cosim.channels.adhoc.routing.aodv_settings import AodvSettings, AodvTimes
from cosim.channels.adhoc.routing.ip import Datagram
from cosim.machine import Address
from cosim.units import S, Time


class RateLimit:
    """A limit of the number of messages in any second."""

    def __init__(self, most: int) -> None:
        self._last: deque[Time] = deque(maxlen=most)

    def free_at(self, now: Time) -> Time:
        """Return from when on one more is allowed; *now* if it is."""
        full = len(self._last) == self._last.maxlen
        return max(now, self._last[0] + S) if full else now

    def count(self, now: Time) -> None:
        """Count one."""
        self._last.append(now)


@dataclass(slots=True, eq=False)
class Carried:
    """A payload on its way over this robot."""

    datagram: Datagram
    previous: Address | None
    """Neighbour that it has come from; None: it is this robot's own."""
    token: int | None = None
    """Token by which its fate is reported to the host."""
    failures: int = 0
    """Number of times that the next hop has not acknowledged it."""
    since: Time = 0
    """Instant at which it began to wait for a route."""


@dataclass(slots=True, eq=False)
class Search:
    """The search for a route to one destination: an expanding ring, then the whole network (6.3, 6.4)."""

    ttl: int
    repair: int | None = None
    """Hops of the route that a local repair is to replace; None: an ordinary search."""
    due: Time = 0
    """Instant at which the wait for a reply ends, or that until the next request may be sent."""
    asked: bool = False
    """True if the request of this *ttl* is on its way."""
    floods: int = 0
    """Number of requests that went as far as the network reaches."""
    waiting: list[Carried] = field(default_factory=list)

    def ask(self, now: Time, settings: AodvSettings, times: AodvTimes) -> None:
        """Note that a request is sent *now*, and until when to wait for a reply."""
        self.asked = True
        if self.ttl < settings.net_diameter or self.repair is not None:
            self.due = now + 2 * times.traversal * (self.ttl + settings.timeout_buffer)
        else:
            self.due = now + (times.network << self.floods)
            self.floods += 1

    def widen(self, settings: AodvSettings) -> bool:
        """Go on to the next request after no reply has come; return whether there is one."""
        if self.repair is not None or self.floods > settings.rreq_retries:
            return False
        self.ttl = settings.next_ttl(self.ttl)
        self.asked = False
        return True
