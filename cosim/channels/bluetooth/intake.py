"""What hosts hand to the devices of a piconet: queued, refused, or taken out again because it has waited too long.

Automatic flush: a payload that has not been acknowledged a given time after it was queued leaves the queue at the next
TX slot boundary, when nothing that concerns it is on the air. SEQN has one bit, so a receiver could take the payload
behind it for its repetition: the two sides settle that when they flush (the time that this takes is neglected), and the
next payload is new. Broadcasts, which nobody acknowledges, do not expire.
"""

from collections.abc import Callable

from cosim.channels.bluetooth import polling
from cosim.channels.bluetooth.links import Links
from cosim.channels.bluetooth.packets import PacketType, smallest
from cosim.channels.bluetooth.polling import (
    ARQN,
    EVERYONE,
    HELD,
    JOINED,
    MOST_SLAVES,
    NEXT,
    NOTHING,
    SEEN_DOWN,
    SEEN_UP,
    SEQ_DOWN,
    SEQ_UP,
)
from cosim.channels.bluetooth.queues import News, Payload, Queues, fate
from cosim.channels.bluetooth.radio import Air
from cosim.channels.bluetooth.slots import Slots
from cosim.kernel import Handle, Kernel
from cosim.machine import BROADCAST, Address, Outcome, Outgoing
from cosim.units import Time


class Intake:
    """The queues of a piconet from the hosts' side. *tell* takes news in a new event of the same instant.

    *limit* is how many payloads a device holds, *timeout* how long; None for any number, and for ever.
    """

    def __init__(
        self,
        kernel: Kernel,
        air: Air,
        links: Links,
        queues: Queues,
        slots: Slots,
        types: tuple[PacketType, ...],
        limit: int | None,
        timeout: Time | None,
        tell: Callable[[News], None],
    ) -> None:
        self._kernel = kernel
        self._air = air
        self._links = links
        self._queues = queues
        self._slots = slots
        self._types = types
        self._limit = limit
        self._timeout = timeout
        self._tell = tell
        self._expiry: Handle | None = None

    def send(self, source: Address, outgoing: Outgoing) -> Outcome | None:
        """Queue a payload at *source*, the master or a slave, or return why not; that also comes as a new event."""
        queue, lt_addr = self._route(source, outgoing.destination)
        length = len(outgoing.payload)
        kind = smallest(self._types, length)
        if lt_addr == NOTHING:
            why = Outcome.NO_LINK
        elif kind is None:
            why = Outcome.TOO_LONG
        elif self._limit is not None and self._queues.length(queue) >= self._limit:
            why = Outcome.QUEUE_FULL
        else:
            self.push(queue, Payload(lt_addr, outgoing, kind, kind.air_time(length), self._kernel.now))
            return None
        self._tell(fate(source, outgoing, why))
        return why

    def push(self, queue: int, payload: Payload) -> None:
        """Append *payload* to a queue."""
        piconet, now = self._links.piconet, self._kernel.now
        # whether a payload that is not the head may change what is sent next
        overtaking = piconet[polling.SHARED] or piconet[polling.SCHEDULER] != polling.LAZY
        if overtaking:
            self._air.advance(now)
        if self._queues.push(queue, payload) or overtaking:
            self._air.advance(now)
            self._slots.arm()
        if self._timeout is not None:
            self._expire_at(max(now, payload.queued + self._timeout))

    def _expire_at(self, time: Time) -> None:
        if self._expiry is not None:
            if self._expiry.time <= time:
                return
            self._expiry.cancel()
        self._expiry = self._kernel.at(time, self._expire)

    def flush(self, source: Address, destination: Address) -> None:
        """Take out of the queue of *source* what is meant for *destination* and has never been on the air."""
        queue = EVERYONE if source == self._links.master else self._links.lt_addr.get(source, NOTHING)
        if queue == NOTHING:
            return
        self._air.advance(self._kernel.now)
        news = self._queues.flush(queue, source, lambda p: _untouched(p, destination))
        self._slots.arm()
        self._tell(news)

    def _route(self, source: Address, destination: Address) -> tuple[int, int]:
        """Return (number of the queue, LT_ADDR of the packets), or NOTHING for the latter where there is no link."""
        links = self._links
        if source != links.master:
            k = links.lt_addr.get(source, NOTHING)
            return k, k if destination == links.master and links.up(k, JOINED) else NOTHING
        if destination == BROADCAST:
            return EVERYONE, EVERYONE if links.audience() else NOTHING
        k = links.lt_addr.get(destination, NOTHING)
        return EVERYONE, k if links.up(k, HELD) else NOTHING

    # ------------------------------------------------------------ automatic flush

    def _expire(self) -> None:
        """Take out what is too old, at the next slot boundary; wait for the next that will be."""
        now, timeout = self._kernel.now, self._timeout
        self._expiry = None
        self._air.advance(now)
        boundary = polling.time_of(self._links.piconet, self._links.piconet[NEXT])
        if timeout is None:
            return
        if boundary > now:
            self._expiry = self._kernel.at(int(boundary), self._expire)
            return
        news: News = []
        for queue in range(MOST_SLAVES + 1):
            news += self._flush_old(queue, now - timeout)
        ages = [payload.queued for queue in range(MOST_SLAVES + 1) for payload in self._queues.acknowledged(queue)]
        if ages:
            self._expiry = self._kernel.at(min(ages) + timeout, self._expire)
        self._slots.arm()
        self._tell(news)

    def _flush_old(self, queue: int, limit: Time) -> News:
        """Flush what was queued at *limit* or before."""
        table = self._links.table
        old = {payload for payload in self._queues.acknowledged(queue) if payload.queued <= limit}
        for payload in old:
            if payload.tries and queue == EVERYONE:
                table[SEEN_DOWN, payload.lt_addr] = table[SEQ_DOWN, payload.lt_addr]
            elif payload.tries:
                table[SEEN_UP, queue] = table[SEQ_UP, queue]
                table[ARQN, queue] = 0
        source = self._links.master if queue == EVERYONE else self._links.slaves.get(queue, NOTHING)
        return self._queues.flush(queue, source, lambda payload: payload in old) if old else []


def _untouched(payload: Payload, destination: Address) -> bool:
    """Return whether *payload* is meant for *destination*, has never been on the air, and is not about to be."""
    return payload.outgoing.destination == destination and not payload.tries and not payload.chosen
