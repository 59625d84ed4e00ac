"""The payloads that wait to be sent in one piconet: one queue for each device, strictly first in, first out."""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import TypeAlias

from cosim.channels.bluetooth.packets import PacketType
from cosim.channels.bluetooth.polling import EVERYONE, LAZY, MOST_SLAVES, QUEUED, WAITING, State
from cosim.machine import Address, Fate, LinkEvent, Outcome, Outgoing
from cosim.payloads import Payloads
from cosim.units import Time

LinkEvents: TypeAlias = list[tuple[Address, LinkEvent]]
"""(host, event)"""


@dataclass(slots=True, eq=False)
class Payload:
    """A host's payload with the packet that will carry it."""

    lt_addr: int
    outgoing: Outgoing
    kind: PacketType
    air: Time
    queued: Time
    """Instant at which its host handed it in."""
    tries: int = 0
    """Number of times that it has been on the air."""
    chosen: bool = False
    """True if a slot pair is under way in which it may go on the air."""
    taken: int = 0
    """Slaves that have received it, bit k for LT_ADDR k (broadcasts only)."""


def fate(source: Address, outgoing: Outgoing, outcome: Outcome) -> LinkEvents:
    """Return the event for *source* that its payload has ended with *outcome*; none if it has no token."""
    return [] if outgoing.token is None else [(source, Fate(outgoing.token, outcome))]


class Queues:
    """The queues of a piconet: number EVERYONE is the master's, number k that of the slave with LT_ADDR k.

    The lengths of the slaves' queues are kept in the row QUEUED of *links*, where the arithmetic of slots finds them;
    the number of payloads that the master has for each slave in the row WAITING, if *scheduler* uses it.
    """

    def __init__(
        self, links: State, scheduler: int = LAZY, payloads: Payloads | None = None, now: Callable[[], Time] = lambda: 0
    ) -> None:
        """*payloads* takes what becomes of payloads, if it wants that; *now* tells the time."""
        self._links = links
        self.payloads = payloads if payloads is not None and payloads.wanted else None
        """Takes what becomes of payloads, if a trace wants that."""
        self._now = now
        self._counts = scheduler != LAZY
        self._waiting: list[deque[Payload]] = [deque() for _ in range(MOST_SLAVES + 1)]

    def head(self, queue: int) -> Payload | None:
        """Return the payload that is next in a queue."""
        waiting = self._waiting[queue]
        return waiting[0] if waiting else None

    def length(self, queue: int) -> int:
        """Return the number of payloads in a queue."""
        return len(self._waiting[queue])

    def acknowledged(self, queue: int) -> Iterator[Payload]:
        """Return the payloads of a queue, in order, that are to be acknowledged: all but broadcasts."""
        return (payload for payload in self._waiting[queue] if payload.lt_addr != EVERYONE)

    def first_two(self, queue: int) -> list[Payload]:
        """Return the head of a queue and the payload behind it, as far as they exist."""
        return list(islice(self._waiting[queue], 2))

    def sendable(self) -> Iterator[Payload]:
        """Return the payloads of the master's queue that may be sent, in order, if those before wait for absent slaves.

        A payload never overtakes one with the same destination; a broadcast overtakes nothing, and nothing a broadcast.
        """
        waiting_for: set[int] = set()
        for payload in self._waiting[EVERYONE]:
            if payload.lt_addr == EVERYONE:
                if not waiting_for:
                    yield payload
                return
            if payload.lt_addr not in waiting_for:
                waiting_for.add(payload.lt_addr)
                yield payload

    def push(self, queue: int, payload: Payload) -> bool:
        """Append *payload* and return whether it is the head."""
        waiting = self._waiting[queue]
        waiting.append(payload)
        self._links[QUEUED, queue] = len(waiting)
        self._count(queue)
        return len(waiting) == 1

    def pop(self, queue: int) -> Payload:
        """Remove the head."""
        payload = self._waiting[queue].popleft()
        self._links[QUEUED, queue] = len(self._waiting[queue])
        return payload

    def take(self, queue: int) -> list[Payload]:
        """Empty a queue and return what was in it."""
        payloads = list(self._waiting[queue])
        self.flush(queue, 0)
        return payloads

    def remove(self, payload: Payload) -> None:
        """Remove a payload from the master's queue."""
        self._waiting[EVERYONE].remove(payload)
        self._count(EVERYONE)

    def flush(self, queue: int, source: Address, which: Callable[[Payload], bool] = lambda _: True) -> LinkEvents:
        """Remove all payloads of a queue that *which* selects, and return their fates for *source*."""
        waiting = self._waiting[queue]
        gone = [payload for payload in waiting if which(payload)]
        self._waiting[queue] = deque(payload for payload in waiting if not which(payload))
        self._links[QUEUED, queue] = len(self._waiting[queue])
        self._count(queue)
        return self.fates(gone, source)

    def fates(self, gone: list[Payload], source: Address) -> LinkEvents:
        """Return the events for *source* that payloads have been flushed."""
        return [item for payload in gone for item in self.ended(payload, source, Outcome.FLUSHED)]

    def ended(self, payload: Payload, source: Address, outcome: Outcome) -> LinkEvents:
        """Return the event for *source* that *payload* has ended now with *outcome*, if it was asked for."""
        if self.payloads is not None:
            self.payloads.end(payload, self._now(), outcome.value)
        return fate(source, payload.outgoing, outcome)

    def _count(self, queue: int) -> None:
        """Count the payloads for each slave in the master's queue, up to the first broadcast."""
        if queue != EVERYONE or not self._counts:
            return
        self._links[WAITING] = 0
        for payload in self._waiting[EVERYONE]:
            if payload.lt_addr == EVERYONE:
                break
            self._links[WAITING, payload.lt_addr] += 1

    def flush_link(self, k: int, master: Address, master_alone: bool) -> LinkEvents:
        """Flush the payloads for LT_ADDR *k* from the master's queue, and broadcasts if the master is alone now."""
        return self.flush(EVERYONE, master, lambda p: p.lt_addr == k or (master_alone and p.lt_addr == EVERYONE))
