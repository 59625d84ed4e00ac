"""The messages of AODV: requests, replies, errors and hellos (RFC 3561, sections 6.5 to 6.11).

How the RFC is read where it leaves a choice:

- A route whose sequence number is newer than what a message offers is not changed, 6.5 (3) notwithstanding; see
  ``aodv_routes`` for why, and for what happens to sequence numbers.
- The destination of a request takes over a newer number of itself (6.1), which covers 6.6.1; so does a robot that finds
  itself in a reply or an error.
- A reply that is not newer is passed on too, with what is known here: 6.7 would end it, and the originator would get
  none.
- A robot does not answer for a destination with a route over the neighbour that asks.
- An error ends a route over its sender whatever its sequence number; an error about a payload without a route goes to
  the neighbour that it has come from, too (6.11, case ii), but does not increment the number of an entry that has ended
  before.
- The neighbour that a payload comes from becomes a precursor of its destination, so that it learns of the route's end.
- A robot is part of an active route, and sends hellos (6.9), as long as a route that it uses or has replied with lasts.
  The next hello is due a HELLO_INTERVAL after the last broadcast, less a jitter that the RFC does not know.
"""

from cosim.channels.adhoc.routing.aodv_output import Output
from cosim.channels.adhoc.routing.aodv_routes import MASK, RouteTable, newer
from cosim.channels.adhoc.routing.aodv_search import RateLimit
from cosim.channels.adhoc.routing.aodv_settings import AodvSettings
from cosim.channels.adhoc.routing.aodv_wire import (
    MOST_DESTINATIONS,
    Message,
    Rerr,
    Rrep,
    RrepAck,
    Rreq,
)
from cosim.channels.adhoc.routing.flooding import Seen
from cosim.channels.adhoc.routing.ip import Datagram
from cosim.channels.adhoc.routing.watch import RouteWatch
from cosim.machine import BROADCAST, Address
from cosim.randomness import Draws
from cosim.units import MS, Time

_MOST_HOPS = 255
_MOST_LIFETIME_MS = 0xFFFFFFFF


class Control(Output):
    """The part of a robot's router that exchanges messages with other routers."""

    def __init__(self, address: Address, settings: AodvSettings, draws: Draws, now: Time = 0) -> None:
        super().__init__(address, settings, draws, now)
        self.table = RouteTable(address, self.times.delete)
        self.sequence = now // MS & MASK
        """The robot's own sequence number (6.1); a router that starts again begins above all that it has had."""
        self._silent_until = now + self.times.delete if settings.reboot_hold and now else now
        """Instant until which it neither asks nor answers nor forwards, after a start at another time than 0 (6.13)."""
        self._seen = Seen(self.times.discovery)
        self._errors = RateLimit(settings.rerr_ratelimit)
        self._neighbours: dict[Address, tuple[Time, Time]] = {}
        """Instants at which each neighbour that sends hellos last sent one, and was last heard: in that order."""
        self._blacklist: dict[Address, Time] = {}
        """Instants until which requests of a neighbour are ignored (6.8)."""
        self._acks: dict[Address, Time] = {}
        """Instants until which a neighbour has to acknowledge a reply."""
        self._engaged_until: Time = -1
        if settings.use_hello and settings.hello_always:
            self._plan_hello(now + self._draw(self.times.hello))

    def be_watched(self, watch: RouteWatch | None) -> None:
        """Tell *watch* of all routes from now on."""
        self.table.watch = watch

    def settle(self, now: Time) -> None:
        """Tell who watches of routes that are over."""
        self.table.settle(now)

    # ------------------------------------------------------------ what comes in

    def next_hop(self, destination: Address, now: Time) -> Address | None:
        """Return the next hop of a payload to *destination* now, if there is a route."""
        self.table.age(now)
        route = self.table.active(destination)
        return None if route is None else route.next_hop

    def _hears(self, message: Message, datagram: Datagram, hop: Address, now: Time) -> None:
        match message:
            case Rrep() if datagram.destination == BROADCAST:
                self._on_hello(message, hop, now)
            case Rrep():
                self._on_reply(message, hop, now)
            case Rreq():
                self._on_request(message, datagram.ttl, hop, now)
            case Rerr():
                self._on_error(message, hop, now)
            case RrepAck():
                self._acks.pop(hop, None)

    def _on_request(self, rreq: Rreq, ttl: int, hop: Address, now: Time) -> None:
        """Learn the way back, then answer the request or pass it on (6.5)."""
        if self._blacklist.get(hop, now) > now:
            return
        self.table.hear(hop, now + self.times.active_route)
        hops = rreq.hops + 1
        fresh = rreq.originator != self.address and self._seen.first((rreq.originator, rreq.number), now)
        if not fresh or hops > _MOST_HOPS:
            return
        until = now + 2 * (self.times.network - hops * self.times.traversal)
        back = self.table.active(rreq.originator)
        longest = until if back is None else max(until, back.until)
        self.table.offer(rreq.originator, hop, hops, rreq.originator_sequence, longest)
        self.table.prolong((rreq.originator,), until)
        if rreq.destination == self.address:
            self._catch_up(rreq.sequence)
            lifetime = self.times.my_route
            self._reply(Rrep(0, self.address, self.sequence, rreq.originator, lifetime // MS), now)
            self._engage(now + lifetime, now)
        elif now >= self._silent_until and not self._answers(rreq, hop, now) and ttl > 1:
            route = self.table.get(rreq.destination)
            newest = rreq.sequence
            known = None if route is None else route.sequence
            if known is not None and (newest is None or newer(known, newest)):
                newest = known
            self._send_message(rreq._replace(hops=hops, sequence=newest), BROADCAST, now, ttl - 1, held=True)

    def _answers(self, rreq: Rreq, hop: Address, now: Time) -> bool:
        """Answer for the destination if there is a route to it that is new enough (6.6.2, 6.6.3)."""
        route, back = self.table.active(rreq.destination), self.table.active(rreq.originator)
        if route is None or back is None or rreq.destination_only or route.next_hop == hop:
            return False
        if not route.known or route.sequence is None or back.sequence is None:
            return False
        if rreq.sequence is not None and newer(rreq.sequence, route.sequence):
            return False
        route.precursors.add(hop)
        back.precursors.add(route.next_hop)
        lifetime, lifetime_back = _ms(route.until - now), _ms(back.until - now)
        self._reply(Rrep(route.hops, rreq.destination, route.sequence, rreq.originator, lifetime), now)
        if rreq.gratuitous:
            self._reply(Rrep(back.hops, rreq.originator, back.sequence, rreq.destination, lifetime_back), now)
        self._engage(route.until, now)
        return True

    def _on_hello(self, rrep: Rrep, hop: Address, now: Time) -> None:
        """Note that a neighbour is there (6.9)."""
        if rrep.destination != hop or rrep.hops:
            return
        self.table.hear(hop, now + rrep.lifetime_ms * MS, rrep.sequence)
        if self.settings.use_hello:
            self._neighbours[hop] = now, now  # the last in their order, by ``receive``
            self._expect(now + self.times.loss)

    def _on_reply(self, rrep: Rrep, hop: Address, now: Time) -> None:
        """Take over the route, and pass the reply on towards its originator (6.7)."""
        until = now + rrep.lifetime_ms * MS
        if rrep.ack:
            self._send_message(RrepAck(), hop, now)
        self.table.hear(hop, now + self.times.active_route)
        if rrep.destination == self.address:
            self._catch_up(rrep.sequence)
            return
        hops = rrep.hops + 1
        if hops > _MOST_HOPS:
            return
        self.table.offer(rrep.destination, hop, hops, rrep.sequence, until)
        route = self.table.active(rrep.destination)
        if route is None or not route.known or route.sequence is None:
            return
        if route.next_hop == hop and route.sequence == rrep.sequence:
            route.until = max(route.until, until)
        self._engage(route.until, now)
        if rrep.originator != self.address:
            lifetime = _ms(route.until - now)
            self._reply(Rrep(route.hops, rrep.destination, route.sequence, rrep.originator, lifetime), now)

    def _reply(self, rrep: Rrep, now: Time) -> None:
        """Send a reply one hop towards its originator, and note which neighbours will use the route (6.7)."""
        back = self.table.active(rrep.originator)
        route = self.table.active(rrep.destination)
        if back is None or (route is not None and route.next_hop == back.next_hop) or now < self._silent_until:
            return
        if route is not None:
            route.precursors.add(back.next_hop)
            following = self.table.active(route.next_hop)
            if following is not None:
                following.precursors.add(back.next_hop)
        back.until = max(back.until, now + self.times.active_route)
        if self.settings.use_rrep_ack:
            self._expect(self._acks.setdefault(back.next_hop, now + self.times.next_hop_wait))
        self._send_message(rrep._replace(ack=self.settings.use_rrep_ack), back.next_hop, now)

    def _on_error(self, rerr: Rerr, hop: Address, now: Time) -> None:
        """End routes over *hop*, and report it to the robots that use them (6.11, case iii)."""
        gone = []
        for destination, sequence in rerr.unreachable:
            route = self.table.active(destination)
            if destination == self.address:
                self._catch_up(sequence)
            elif route is not None and route.next_hop == hop:
                gone.append(destination)
                if not rerr.no_delete:
                    self.table.end(destination, now, sequence)
        self._report(gone, now, no_delete=rerr.no_delete)

    def _catch_up(self, sequence: int | None) -> None:
        """Take over a number of this robot that is newer than its own (6.1)."""
        if sequence is not None and newer(sequence, self.sequence):
            self.sequence = sequence

    # ------------------------------------------------------------ links

    def _break(self, neighbour: Address, now: Time, repaired: Address | None = None) -> None:
        """End all routes over *neighbour*, and report those not to be *repaired* to the robots that use them (6.11)."""
        gone = self.table.through(neighbour)
        self.counts["links_broken"] += bool(gone)
        self._neighbours.pop(neighbour, None)
        for destination in gone:
            self.table.end(destination, now)
        self._report([each for each in gone if each != repaired], now)

    def _report(self, gone: list[Address], now: Time, also: Address | None = None, no_delete: bool = False) -> None:
        """Send errors about ended routes to their precursors, and to one neighbour *also*: to one alone, or to all."""
        receivers: set[Address] = set() if also is None else {also}
        pairs = []
        for destination in gone:
            route = self.table.get(destination)
            if also is not None or (route is not None and route.precursors):
                pairs.append((destination, 0 if route is None else route.sequence or 0))
                receivers |= set() if route is None else route.precursors
        if not pairs or self._errors.free_at(now) > now:
            return
        for destination, _ in pairs:
            route = self.table.get(destination)
            if route is not None and not no_delete:
                route.precursors.clear()
        for begin in range(0, len(pairs), MOST_DESTINATIONS):
            self._errors.count(now)
            self.counts["route_errors"] += 1
            some = tuple(pairs[begin : begin + MOST_DESTINATIONS])
            self._send_message(Rerr(some, no_delete), min(receivers) if len(receivers) == 1 else BROADCAST, now)

    def _engage(self, until: Time, now: Time) -> None:
        """Send hellos until then at least."""
        self._engaged_until = max(self._engaged_until, until)
        if self.settings.use_hello and self._hello_at is None:
            self._plan_hello(now + self._draw(self.times.hello))

    def _tend_links(self, now: Time) -> None:
        """Send a hello if one is due, and break links to neighbours that have fallen silent (6.8, 6.9)."""
        if self._hello_at is not None and self._hello_at <= now:
            self._hello_at = None
            if self.settings.hello_always or now < self._engaged_until:
                self._hello_at = now  # sending it plans the next
                self._drawn += 1  # one number is skipped, as earlier versions had drawn with it: runs stay the same
                self._send_message(
                    Rrep(0, self.address, self.sequence, self.address, self.times.loss // MS), BROADCAST, now
                )
        while self._neighbours:
            neighbour, (hello, heard) = next(iter(self._neighbours.items()))
            if heard + self.times.loss > now:
                break
            del self._neighbours[neighbour]
            if hello + self.times.delete > now:
                self._break(neighbour, now)
        for neighbour, until in list(self._acks.items()):
            if until <= now:
                del self._acks[neighbour]
                self._blacklist[neighbour] = now + self.times.blacklist

    def _links_due(self) -> list[Time]:
        due = [*self._acks.values()]
        if self._neighbours:
            due.append(next(iter(self._neighbours.values()))[1] + self.times.loss)
        if self._hello_at is not None:
            due.append(self._hello_at)
        if self._held:
            due.append(self._held[0][0])
        return due


def _ms(time: Time) -> int:
    return min(max(0, time // MS), _MOST_LIFETIME_MS)
