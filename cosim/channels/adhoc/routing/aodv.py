"""AODV, ad hoc on-demand distance vector routing (RFC 3561): a robot looks for a route when it has a payload for it.

This file has payloads, searches and time, ``aodv_control`` the messages between routers, ``aodv_routes`` the table. A
router that starts again waits (6.13) unless set not to. In either case it begins with a sequence number, its time in
ms, above all that it has had. Left out: multicast, subnets and extensions (sections 4, 7, 9). The RFC does not cover
payloads to all: they are flooded, as far as NET_DIAMETER hops, and distinguished by source and IP identification for
PATH_DISCOVERY_TIME.
"""

from collections.abc import Sequence
from functools import lru_cache

from cosim.channels.adhoc.routing.aodv_control import Control
from cosim.channels.adhoc.routing.aodv_output import Watch
from cosim.channels.adhoc.routing.aodv_routes import MASK
from cosim.channels.adhoc.routing.aodv_search import Carried, RateLimit, Search
from cosim.channels.adhoc.routing.aodv_settings import AodvSettings
from cosim.channels.adhoc.routing.aodv_wire import Message, Rreq, decode_message
from cosim.channels.adhoc.routing.base import Delivery, Unsent
from cosim.channels.adhoc.routing.flooding import Seen
from cosim.channels.adhoc.routing.ip import AODV_PORT, PAYLOAD_PORT, Datagram, decode, encode
from cosim.errors import WireError
from cosim.machine import BROADCAST, Address, Outcome
from cosim.randomness import Draws
from cosim.units import Time

__all__ = ["Aodv", "AodvSettings"]

DATA_TTL = 64
"""TTL of payloads to one robot: the default of RFC 1700."""


class Aodv(Control):
    """One robot's router; *draws* are for jitter and the phase of hellos."""

    def __init__(self, address: Address, settings: AodvSettings, draws: Draws, now: Time = 0) -> None:
        super().__init__(address, settings, draws, now)
        self._searches: dict[Address, Search] = {}
        self._requests = RateLimit(settings.rreq_ratelimit)
        self._flooded = Seen(self.times.discovery)

    # ------------------------------------------------------------ the router's contract

    def send(self, destination: Address, payload: bytes, token: int | None, now: Time) -> None:
        """Bring *payload* to *destination*, searching a route if there is none, or flood it to all.

        Its fate is DELIVERED when the next hop has acknowledged it, SENT if it is to all, NO_ROUTE when a search has
        failed, UNACKNOWLEDGED when no next hop has taken it, QUEUE_FULL if it has given way to others that wait for
        routes or the station has no room, TOO_LONG if no IP packet holds it.
        """
        self.table.age(now)
        if self._settled(destination, payload, token):
            return
        ttl = self.settings.payload_ttl_to_all if destination == BROADCAST else DATA_TTL
        carried = Carried(self._datagram(destination, ttl, PAYLOAD_PORT, payload), None, token)
        if destination == BROADCAST:
            watch = None if token is None else Watch(BROADCAST, carried, False)
            self._put(BROADCAST, encode(carried.datagram), now, watch)
        else:
            self._route(carried, now)

    def receive(self, packet: bytes, hop: Address, now: Time) -> bool:
        """Take a packet that *hop* has put on the air; bytes that make no sense are counted and dropped."""
        self.table.age(now)
        me, due, (datagram, message) = self.address, self._due, _understood(packet, hop)
        if datagram is None or hop == me or (message is not None and datagram.destination not in (BROADCAST, me)):
            self.counts["packets_malformed"] += 1
            return False
        known = self._neighbours.pop(hop, None)
        if known is not None:
            self._neighbours[hop] = known[0], now
        if message is not None:
            self._hears(message, datagram, hop, now)
        elif datagram.port == PAYLOAD_PORT and datagram.source != me:
            self._carry(datagram, hop, now)
        if self._searches:
            self._go_on(now)
        return self._due != due or bool(self._hops or self._deliveries or self._fates or self._unsent)

    def hop_done(self, token: Watch, acknowledged: bool, now: Time) -> None:
        """Note an acknowledgement, or a link that is broken (6.8, 6.10, 6.12)."""
        self.table.age(now)
        neighbour, carried, reply = token
        if neighbour == BROADCAST or acknowledged or not self.settings.use_mac_feedback:
            if carried is not None:
                good = Outcome.SENT if neighbour == BROADCAST else Outcome.DELIVERED
                self._report_fate(carried.token, good if acknowledged else Outcome.UNACKNOWLEDGED)
            return
        if reply:
            self._blacklist[neighbour] = now + self.times.blacklist
        repaired = None if carried is None else self._worth_repair(carried)
        last = None if repaired is None else self.table.active(repaired)
        self._break(neighbour, now, repaired)
        if carried is not None and carried.previous is None:
            self._salvage(carried, now)
        elif carried is not None and (last is not None or self._repairs(carried.datagram.destination)):
            self._seek(carried, now, None if last is None else last.hops)
        elif carried is not None:
            self._lose(carried)
        self._go_on(now)

    def hop_refused(self, token: Watch, now: Time) -> None:
        """Lose a payload that the station has had no room for; that breaks no link."""
        if token.reply:
            self._acks.pop(token.neighbour, None)
        if token.carried is not None:
            self._lose(token.carried, Outcome.QUEUE_FULL)

    def wake(self, now: Time) -> None:
        """Do what is due: held broadcasts, hellos, silent neighbours, and searches without a reply."""
        self.table.age(now)
        self._release(now)
        self._tend_links(now)
        dues: list[Time] = []
        if self._searches:
            self._search_on(now)
            dues += [search.due for search in self._searches.values()]
        self._due = min(dues + self._links_due(), default=None)

    def wake_at(self) -> Time | None:
        """Return an instant before which nothing is due if nothing comes in; right after ``wake`` something is then."""
        return self._due

    # ------------------------------------------------------------ payloads

    def _lose(self, carried: Carried, outcome: Outcome = Outcome.UNACKNOWLEDGED) -> None:
        self.counts["payloads_unrouted"] += 1
        if carried.previous is None and carried.failures == 0 and outcome is Outcome.NO_ROUTE:
            self._unsent.append(Unsent(carried.datagram.destination, len(carried.datagram.data), outcome))
        self._report_fate(carried.token, outcome)

    def _carry(self, datagram: Datagram, hop: Address, now: Time) -> None:
        """Deliver a payload that has come over *hop*, and pass on what is for others."""
        source, destination, ttl = datagram.source, datagram.destination, datagram.ttl
        if destination == BROADCAST:
            if not self._flooded.first((source, datagram.number), now):
                return
            self._deliveries.append(Delivery(source, datagram.data, True))
            if ttl > 1:
                self.counts["payloads_forwarded"] += 1
                self._put(BROADCAST, encode(datagram._replace(ttl=ttl - 1)), now, held=True)
        elif destination == self.address:
            self._deliveries.append(Delivery(source, datagram.data, False))
            self._use((source, hop), now)
        elif ttl <= 1:
            self.counts["payloads_unrouted"] += 1
        else:
            shorter = Datagram(source, destination, ttl - 1, PAYLOAD_PORT, datagram.number, datagram.data)
            self._route(Carried(shorter, hop), now)

    def _use(self, robots: Sequence[Address], now: Time) -> None:
        """Prolong routes that are used to ACTIVE_ROUTE_TIMEOUT from now (6.2)."""
        until = now + self.times.active_route
        self.table.prolong(robots, until)
        self._engage(until, now)

    def _route(self, carried: Carried, now: Time) -> None:
        """Pass a payload on, or search a route, or report that there is none."""
        destination, hop = carried.datagram.destination, carried.previous
        route = self.table.active(destination)
        if route is not None:
            self._use((destination, route.next_hop), now)
            if hop is not None:
                self._use((carried.datagram.source, hop), now)
                route.precursors.add(hop)
                self.counts["payloads_forwarded"] += 1
            watched = carried.token is not None or self.settings.use_mac_feedback
            watch = Watch(route.next_hop, carried, False) if watched else None
            self._put(route.next_hop, encode(carried.datagram), now, watch)
        elif hop is None or self._repairs(destination):
            self._seek(carried, now)
        else:
            self._lose(carried)
            self.table.keep(destination, now + self.times.delete)
            if now < self._silent_until:
                self._silent_until = now + self.times.delete
            self._report([destination], now, also=hop)

    def _salvage(self, carried: Carried, now: Time) -> None:
        carried.failures += 1
        if carried.failures > self.settings.salvages:
            self._lose(carried)
        else:
            self._route(carried, now)

    # ------------------------------------------------------------ searches

    def _search_on(self, now: Time) -> None:
        """Send the requests that are due, and end searches without a reply."""
        for destination, search in list(self._searches.items()):
            if search.due <= now:
                if search.asked and not search.widen(self.settings):
                    self._give_up(destination, now)
                else:
                    self._request(destination, search, now)

    def _repairs(self, destination: Address) -> bool:
        return self.settings.local_repair and destination in self._searches

    def _worth_repair(self, carried: Carried) -> Address | None:
        """Return the destination of a payload on its way, if it is near enough for a local repair (6.12)."""
        destination = carried.datagram.destination
        route = self.table.active(destination)
        if not self.settings.local_repair or carried.previous is None or route is None:
            return None
        return destination if route.hops <= self.settings.max_repair_ttl else None

    def _seek(self, carried: Carried, now: Time, repair: int | None = None) -> None:
        """Have a payload wait for a route, which is searched; *repair*: in place of one of that many hops."""
        destination = carried.datagram.destination
        search = self._searches.get(destination)
        if search is None:
            search = self._searches[destination] = Search(self._first_ttl(carried, repair), repair)
            self._request(destination, search, now)
        carried.since = now
        search.waiting.append(carried)
        searches = [each for each in self._searches.values() if each.waiting]
        if sum(len(each.waiting) for each in searches) > self.settings.queue_payloads:
            crowded = min(searches, key=lambda each: each.waiting[0].since)
            self._lose(crowded.waiting.pop(0), Outcome.QUEUE_FULL)

    def _first_ttl(self, carried: Carried, repair: int | None) -> int:
        if repair is None:
            known = self.table.get(carried.datagram.destination)
            return self.settings.first_ttl(None if known is None else known.hops)
        back = self.table.get(carried.datagram.source)
        farther = max(repair, 0 if back is None else back.hops // 2) + self.settings.local_add_ttl
        return min(farther, self.settings.net_diameter)

    def _request(self, destination: Address, search: Search, now: Time) -> None:
        """Send the next request of a search, or wait until the rate allows it (6.3)."""
        search.due = max(self._requests.free_at(now), self._silent_until)
        if search.due > now:
            self._expect(search.due)
            return
        self._requests.count(now)
        search.ask(now, self.settings, self.times)
        self._expect(search.due)
        self.sequence = self.sequence + 1 & MASK
        self._request_id = self._request_id + 1 & MASK
        self._seen.first((self.address, self._request_id), now)
        self.table.keep(destination, now + 2 * self.times.network)
        known = self.table.get(destination)
        sequence = None if known is None else known.sequence
        flags = self.settings.gratuitous, self.settings.destination_only
        self.counts["route_requests"] += 1
        request = Rreq(0, self._request_id, destination, sequence, self.address, self.sequence, *flags)
        self._send_message(request, BROADCAST, now, search.ttl)

    def _go_on(self, now: Time) -> None:
        """Send payloads that have waited for a route that exists now."""
        for destination in [each for each in self._searches if self.table.active(each)]:
            search = self._searches.pop(destination)
            route = self.table.active(destination)
            if search.repair is not None and route is not None and route.hops > search.repair:
                self._report([destination], now, no_delete=True)
            for carried in search.waiting:
                self._route(carried, now)

    def _give_up(self, destination: Address, now: Time) -> None:
        """Report to the hosts, and after a local repair to the precursors, that no route has been found."""
        search = self._searches.pop(destination)
        for carried in search.waiting:
            self._lose(carried, Outcome.NO_ROUTE)
        if search.repair is not None:
            self._report([destination], now)


@lru_cache(maxsize=64)  # a packet to all is decoded once, not once by every robot that it reaches
def _understood(packet: bytes, hop: Address) -> tuple[Datagram | None, Message | None]:
    """Return the datagram of a *packet* from *hop*, None if it makes no sense, and the message in it if it has one."""
    try:
        datagram = decode(packet)
        message = decode_message(datagram.data) if datagram.port == AODV_PORT else None
    except WireError:
        return None, None
    if BROADCAST in (datagram.source, hop) or (message is not None and datagram.source != hop):
        return None, None  # messages make one hop
    return datagram, message
