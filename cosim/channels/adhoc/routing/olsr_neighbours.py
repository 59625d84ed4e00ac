"""The neighbourhood of an OLSR robot, from HELLOs: links, neighbours, theirs, relays (RFC 3626, 7, 8, 13, 14).

Deadlines are instants from which on something no longer holds. Nothing happens at a deadline: before the sets are read,
``advance`` is called, which brings all of them to that time.
"""

from dataclasses import dataclass
from typing import NamedTuple

from cosim.channels.adhoc.routing.olsr_graph import select_mprs
from cosim.channels.adhoc.routing.olsr_wire import (
    ASYM_LINK,
    LOST_LINK,
    MPR_NEIGH,
    NOT_NEIGH,
    SYM_LINK,
    SYM_NEIGH,
    Hello,
    link_code,
    link_types,
)
from cosim.machine import Address
from cosim.units import Time


class Hysteresis(NamedTuple):
    """Thresholds of link quality (section 14.3)."""

    high: float
    """Quality above which a link is taken up."""
    low: float
    """Quality below which a link is dropped."""
    scaling: float
    """Weight of the latest packet."""


@dataclass(slots=True)
class Link:
    """A link tuple (sections 4.2.1 and 14.1), with what is needed to notice lost packets."""

    symmetric_until: Time
    heard_until: Time
    until: Time
    willingness: int
    lost_until: Time
    pending: bool
    quality: float
    next_number: int | None
    """Number of the next packet; None if missing ones do not matter."""
    interval: Time
    """Htime of the last HELLO."""
    silent_at: Time
    """Instant at which the next packet is taken as lost."""

    def symmetric(self, now: Time) -> bool:
        """Return whether the link is up (section 14.2)."""
        return self.symmetric_until > now and self.lost_until <= now and not self.pending

    def kind(self, now: Time) -> int | None:
        """Return the type of link for a HELLO; None if the link is not to be listed (sections 6.2 and 14.2)."""
        if self.lost_until > now:
            return LOST_LINK
        if self.pending:
            return None
        if self.symmetric_until > now:
            return SYM_LINK
        return ASYM_LINK if self.heard_until > now else LOST_LINK


class Neighbourhood:
    """The contents of HELLOs; with ``hysteresis`` None a link is up with the first HELLO that names this robot."""

    def __init__(self, address: Address, hold: Time, coverage: int, hysteresis: Hysteresis | None) -> None:
        self._address = address
        self._hold = hold
        self._coverage = coverage
        self._hysteresis = hysteresis
        self._links: dict[Address, Link] = {}
        self._two_hop: dict[tuple[Address, Address], Time] = {}
        self._selectors: dict[Address, Time] = {}
        self._due: Time | None = None
        self._current: tuple[object, ...] = ()
        self.willingness: dict[Address, int] = {}
        """Willingness of all symmetric neighbours."""
        self.reach: dict[Address, set[Address]] = {}
        """Symmetric neighbours of each symmetric neighbour."""
        self.selectors: frozenset[Address] = frozenset()
        """Robots that have chosen this one as a relay."""
        self.mprs: frozenset[Address] = frozenset()
        """Relays that this robot has chosen."""
        self.version = 0
        """Number of changes of any of these."""

    # ------------------------------------------------------------ what comes in

    def packet(self, neighbour: Address, number: int, now: Time) -> None:
        """Note a packet with *number*, and those that are missing before it (section 14.3)."""
        self.advance(now - 1)  # a packet that comes at the very end of an interval has come in it
        link = self._links.get(neighbour)
        if link is None or self._hysteresis is None:
            return
        missing = 0 if link.next_number is None else (number - link.next_number) & 0xFFFF
        if missing < 1 << 15:  # otherwise the other robot has started to count again
            for _ in range(min(missing, 64)):  # after which nothing is left of the quality
                self._weaken(link, now)
        link.quality += self._hysteresis.scaling * (1.0 - link.quality)
        if link.quality > self._hysteresis.high:
            link.pending, link.lost_until = False, now
        link.next_number = (number + 1) & 0xFFFF
        link.silent_at = now + link.interval
        self._settle(now)

    def hello(self, origin: Address, hello: Hello, validity: Time, number: int, now: Time) -> None:
        """Take a HELLO of *origin* that came in the packet *number* (sections 7.1.1, 8.1.1, 8.2.1, 8.4.1)."""
        self.advance(now)
        until = now + validity
        listed = [(types, addresses) for code, addresses in hello.links.items() if (types := link_types(code))]
        named = [(kind, neighbour, address) for (kind, neighbour), addresses in listed for address in addresses]
        link = self._sense(origin, hello, number, now)
        link.heard_until = until
        for kind, _, address in named:
            if address != self._address:
                continue
            if kind == LOST_LINK:
                link.symmetric_until = now
            elif kind in (SYM_LINK, ASYM_LINK):
                link.symmetric_until = until
                link.until = until + self._hold
        link.until = max(link.until, link.heard_until)
        for _, neighbour, address in named:
            if address == self._address:
                if neighbour == MPR_NEIGH:
                    self._selectors[origin] = until
            elif neighbour == NOT_NEIGH:
                self._two_hop.pop((origin, address), None)
            elif link.symmetric(now):
                self._two_hop[origin, address] = until
        self._settle(now)

    def broken(self, neighbour: Address, now: Time) -> bool:
        """Note the link layer's report that *neighbour* is out of reach (section 13); return whether it was one."""
        self.advance(now)
        if (link := self._links.get(neighbour)) is None:
            return False
        link.lost_until = link.until = now + self._hold
        was = neighbour in self.willingness
        self._settle(now)
        return was

    # ------------------------------------------------------------ what is known

    def links(self, now: Time) -> dict[int, list[Address]]:
        """Return all neighbours by link code, for a HELLO (section 6.2)."""
        self.advance(now)
        codes: dict[int, list[Address]] = {}
        for address in sorted(self._links):
            if (kind := self._links[address].kind(now)) is not None:
                known = SYM_NEIGH if address in self.willingness else NOT_NEIGH
                code = link_code(kind, MPR_NEIGH if address in self.mprs else known)
                codes.setdefault(code, []).append(address)
        return codes

    def advance(self, now: Time) -> None:
        """Drop what has expired until *now*."""
        if self._due is not None and now >= self._due:
            if self._hysteresis is not None:
                for link in self._links.values():
                    while link.silent_at <= now and link.silent_at < link.until:
                        self._weaken(link, link.silent_at)
                        link.next_number = None  # what was sent meanwhile counts as lost already
                        link.silent_at += link.interval
            self._settle(now)

    # ------------------------------------------------------------ inside

    def _sense(self, origin: Address, hello: Hello, number: int, now: Time) -> Link:
        link = self._links.get(origin)
        if link is None:
            quality = 1.0 if self._hysteresis is None else self._hysteresis.scaling
            link = Link(now, now, now, 0, now, self._hysteresis is not None, quality, (number + 1) & 0xFFFF, 0, 0)
            self._links[origin] = link
        link.willingness = hello.willingness
        link.interval = hello.interval
        link.silent_at = now + hello.interval
        return link

    def _weaken(self, link: Link, now: Time) -> None:
        assert self._hysteresis is not None
        link.quality *= 1.0 - self._hysteresis.scaling
        if link.quality < self._hysteresis.low:
            link.pending = True
            link.lost_until = min(link.until, now + self._hold)

    def _settle(self, now: Time) -> None:
        """Drop what has expired, and what depends on lost neighbours (section 8.5); choose relays again."""
        self._links = {address: link for address, link in self._links.items() if link.until > now}
        up = {address: link.willingness for address, link in sorted(self._links.items()) if link.symmetric(now)}
        self._two_hop = {key: until for key, until in self._two_hop.items() if until > now and key[0] in up}
        self._selectors = {key: until for key, until in self._selectors.items() if until > now and key in up}
        reach: dict[Address, set[Address]] = {address: set() for address in up}
        for neighbour, far in self._two_hop:
            reach[neighbour].add(far)
        current = up, reach, frozenset(self._selectors)
        if current != self._current:
            self._current = current
            self.willingness, self.reach, self.selectors = current
            self.mprs = select_mprs(up, reach, self._coverage)
            self.version += 1
        deadlines = [*self._two_hop.values(), *self._selectors.values()]
        for link in self._links.values():
            deadlines += link.symmetric_until, link.lost_until, link.until
            if self._hysteresis is not None:
                deadlines.append(link.silent_at)
        self._due = min((deadline for deadline in deadlines if deadline > now), default=None)
