"""Polling schedulers: the link that a master addresses next, and the packet that it sends.

Whatever the scheduler, links whose poll is due go first, so that T_poll is kept. Else "lazy" sends the head of the
master's queue, and nothing in slots in which nothing waits. The others give every free slot to a link, after a
broadcast at the head of the queue. That is the link served the longest ago (round robin), the same link as long as
anything waits on either side of it (exhaustive), or the link with the most payloads on both sides (backlog). It gets
the first payload of the queue that is for it, or POLL. The last two assume that the master knows how many payloads a
slave holds, as the literature's ideal schedulers do (Capone, Gerla, Kapoor, "Efficient polling schemes for Bluetooth
picocells", ICC 2001); a real master learns it from the packets.

With ``best_packets`` a payload gets its packet type when it is sent for the first time: the one with the best expected
rate at the Es/N0 of the link at that instant, for a broadcast that of the worst link. Interference does not count, as
the sender cannot know what it will meet.
"""

from collections.abc import Iterator
from typing import NamedTuple

from cosim.channels.bluetooth import polling
from cosim.channels.bluetooth.bits.errors import best_type
from cosim.channels.bluetooth.polling import BEACON, EVERYONE, NEVER, NEXT, NOTHING, SHARED, STOPPED
from cosim.channels.bluetooth.queues import Payload
from cosim.channels.bluetooth.state import PiconetState


class Turn(NamedTuple):
    """The packet that is sent in a slot."""

    k: int
    """LT_ADDR of the link that is addressed; EVERYONE for a broadcast."""
    payload: Payload | None
    """Payload of the packet; None for POLL, or for a beacon without one."""


class Schedule:
    """The choice of packets in one piconet."""

    def __init__(self, state: PiconetState) -> None:
        self._links = state.links
        self._piconet, self._table = state.links.piconet, state.links.table
        self._queues = state.queues
        self._air = state.air
        self._types = state.settings.types
        self._fits = state.settings.best_packets
        self._lazy = state.settings.scheduler == "lazy"

    def next_slot(self) -> int:
        """Return the next TX slot with a payload or a beacon in it, or NOTHING."""
        piconet, table = self._piconet, self._table
        if self._lazy and not piconet[SHARED]:
            head = self._queues.head(EVERYONE)
            if head is None:
                return polling.next_served(piconet, table)
            return polling.next_free(piconet, table, head.lt_addr)
        ticks = [self._opening(payload, int(piconet[NEXT])) for payload in self._unasked()]
        if piconet[BEACON] != NEVER:
            ticks.append(self._next_beacon(int(max(piconet[NEXT], piconet[BEACON]))))
        ticks.append(polling.next_served(piconet, table))
        return min((tick for tick in ticks if tick not in (NEVER, NOTHING)), default=NOTHING)

    def choose(self, tick: int) -> Turn | None:
        """Return what is sent in the TX slot *tick*, which is not decided yet, or None."""
        payload = self._ready(tick)
        if tick >= self._piconet[BEACON] and self._next_beacon(tick) == tick:
            return Turn(EVERYONE, payload if payload is not None and payload.lt_addr == EVERYONE else None)
        k = polling.overdue(self._piconet, self._table, tick)
        if self._lazy:
            if k != NOTHING:
                return Turn(k, payload if payload is not None and payload.lt_addr == k else None)
            return None if payload is None else Turn(payload.lt_addr, payload)
        if k == NOTHING:
            if payload is not None:
                return Turn(EVERYONE, payload)
            k = polling.turn(self._piconet, self._table, tick)
        if k == NOTHING:
            return None
        return Turn(k, self._first(tick, (payload for payload in self._sendable() if payload.lt_addr == k)))

    def _ready(self, tick: int) -> Payload | None:
        """Return the payload that is sent at *tick* if the slot is free, whichever link has the turn."""
        if not self._lazy or self._piconet[SHARED]:
            return self._first(tick, self._unasked())
        head = self._queues.head(EVERYONE)
        return None if head is None or self._opening(self.sized(head), tick) != tick else head

    def _first(self, tick: int, payloads: Iterator[Payload]) -> Payload | None:
        """Return the first of *payloads* that can be sent at *tick*."""
        return next((payload for payload in payloads if self._opening(payload, tick) == tick), None)

    def _next_beacon(self, tick: int) -> int:
        opening: int = polling.open_slot(self._piconet, self._table, EVERYONE, tick, 1)
        return opening

    def _opening(self, payload: Payload, tick: int) -> int:
        if self._table[STOPPED, payload.lt_addr]:
            return NEVER
        opening: int = polling.open_slot(self._piconet, self._table, payload.lt_addr, tick, payload.kind.slots)
        return opening

    def _unasked(self) -> Iterator[Payload]:
        """Return the payloads that are sent as soon as a slot is free, whichever link has the turn."""
        return (payload for payload in self._sendable() if self._lazy or payload.lt_addr == EVERYONE)

    def _sendable(self) -> Iterator[Payload]:
        return self._sized(self._queues.sendable())

    def _sized(self, payloads: Iterator[Payload]) -> Iterator[Payload]:
        return map(self.sized, payloads) if self._fits else payloads

    def sized(self, payload: Payload, up: bool = False) -> Payload:
        """Return *payload*, which goes *up* to the master or down, in the packet type that it is to be sent in."""
        if self._fits and not payload.tries:
            length = len(payload.outgoing.payload)
            payload.kind = best_type(self._types, length, self._es_n0_db(payload.lt_addr, up))
            payload.air = payload.kind.air_time(length)
        return payload

    def _es_n0_db(self, k: int, up: bool) -> float:
        """Return the Es/N0 of link *k* now, *up* to the master or down; for EVERYONE that of the worst link."""
        links, carrier = self._links, self._air.carrier
        if k == EVERYONE:
            power_dbm = min((carrier(links.master, slave) for slave in links.slaves.values()), default=float("-inf"))
        elif up:
            power_dbm = carrier(links.slaves[k], links.master)
        else:
            power_dbm = carrier(links.master, links.slaves[k])
        noise = self._air.noise
        noise_dbm = float("-inf") if noise is None else noise.dbm
        return power_dbm - noise_dbm if power_dbm > float("-inf") else power_dbm
