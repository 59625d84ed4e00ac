"""What a piconet puts on the air: the decision at the start of each slot pair that concerns anybody."""

from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeAlias

from cosim.channels.base import Arrival
from cosim.channels.bluetooth import polling
from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.frames import FrameLog
from cosim.channels.bluetooth.links import Links
from cosim.channels.bluetooth.packets import HEADER_AIR
from cosim.channels.bluetooth.polling import ACKED, EVERYONE, FRESH, HEARD, NEXT, NOTHING
from cosim.channels.bluetooth.queues import News, Payload, Queues
from cosim.channels.bluetooth.radio import Heard
from cosim.kernel import AIR, Handle, Kernel
from cosim.machine import Address, LinkEvent, Outcome, Reception
from cosim.units import Time

Deliver: TypeAlias = Callable[[Iterable[Arrival], Iterable[tuple[Address, LinkEvent]]], None]


class Slots:
    """The TX slots of the master at *address*: one kernel event for the next one with a payload in it."""

    def __init__(
        self,
        kernel: Kernel,
        address: Address,
        clock: NativeClock,
        n_bc: int,
        links: Links,
        queues: Queues,
        frames: FrameLog,
        deliver: Deliver,
    ) -> None:
        self.address = address
        self.clock = clock
        self.links = links
        self.suspended = False
        """Whether the slots are left alone: the master inquires or pages."""
        self._kernel = kernel
        self._n_bc = n_bc
        self._queues = queues
        self._frames = frames
        self._deliver = deliver
        self._receptions: dict[tuple[Address, bool], Reception] = {}
        self._slot: Handle | None = None
        self._slot_tick = NOTHING

    def arm(self) -> None:
        """Have the next slot that concerns somebody as a kernel event; all slots before now are decided."""
        tick = NOTHING
        if not self.suspended:
            busy = self._queues.head(EVERYONE) is not None
            piconet = self.links.piconet
            tick = int(piconet[NEXT]) if busy else polling.next_served(piconet, self.links.table)
        if self._slot is not None:
            if tick == self._slot_tick:
                return
            self._slot.cancel()
            self._slot = None
        if tick != NOTHING:
            self._slot_tick = tick
            self._slot = self._kernel.at(self.clock.time_of(tick), self._decide, AIR)

    def _decide(self) -> None:
        self._slot = None
        tick = self._slot_tick
        if self._frames.idle_wanted:
            self.links.advance(self._kernel.now)
        self.links.refresh()
        head = self._queues.head(EVERYONE)
        wanted = NOTHING if head is None else head.lt_addr
        k = polling.decide(self.links.piconet, self.links.table, tick, wanted)
        if k > 0:
            self._transact(tick, k, head if wanted == k else None)
        elif k == EVERYONE and head is not None:
            self._broadcast(tick, head)
        self.arm()

    def _transact(self, tick: int, k: int, payload: Payload | None) -> None:
        """Send *payload*, or POLL, to the slave *k*, and let it answer."""
        links, slave = self.links, self.links.slaves[k]
        idle = payload is None and self._queues.head(k) is None
        slots, air, first = _shape(payload)
        got = polling.ask(links.piconet, links.table, tick, k, first, payload is not None, slots, air)
        self._note(tick, "POLL", payload, (self.address, slave), links.heard_down, k, idle)
        if not got:
            return
        news = self._queues.pop(k).fate(slave, Outcome.DELIVERED) if got & ACKED else []
        self._hand_over(tick, air, payload if got & FRESH else None, self.address, slave, news)
        tick += 2 * slots
        answer = self._queues.head(k)
        slots, air, first = _shape(answer)
        got = polling.reply(links.piconet, links.table, tick, k, first, answer is not None, slots, air)
        self._note(tick, "NULL", answer, (slave, self.address), links.heard_up, k, idle)
        news = []
        if payload is not None and got & HEARD:
            news = self._queues.pop(EVERYONE).fate(self.address, Outcome.DELIVERED)
        self._hand_over(tick, air, answer if got & FRESH else None, slave, self.address, news)

    def _broadcast(self, tick: int, payload: Payload) -> None:
        slaves = self.links.slaves
        got = polling.broadcast(self.links.piconet, self.links.table, tick, payload.kind.slots, payload.air)
        self._frames.payloads[payload.kind.name] += 1
        if self._frames.wanted:
            length = len(payload.outgoing.payload)
            for k, slave in sorted(slaves.items()):
                ends, heard = (self.address, slave), self.links.heard_down(k)
                self._frames.record(tick, payload.kind.name, payload.air, ends, heard, EVERYONE, length)
        fresh = got & ~payload.taken
        payload.taken |= got
        payload.tries += 1
        news: News = []
        if payload.tries >= self._n_bc:
            news = self._queues.pop(EVERYONE).fate(self.address, Outcome.SENT)
        reception, data = self._reception(self.address, True), payload.outgoing.payload
        arrivals = [(slave, data, reception) for k, slave in slaves.items() if fresh >> k & 1]
        self._deliver_at(tick, payload.air, arrivals, news)

    def _hand_over(
        self, tick: int, air: Time, payload: Payload | None, source: Address, receiver: Address, news: News
    ) -> None:
        """Deliver, at the end of a frame of a transaction, what it brought and the fate of what it acknowledged."""
        arrivals: list[Arrival] = []
        if payload is not None:
            arrivals = [(receiver, payload.outgoing.payload, self._reception(source, False))]
        self._deliver_at(tick, air, arrivals, news)

    def _deliver_at(self, tick: int, air: Time, arrivals: list[Arrival], news: News) -> None:
        if arrivals or news:
            self._kernel.at(self.clock.time_of(tick) + air, partial(self._deliver, arrivals, news))

    def _reception(self, source: Address, broadcast: bool) -> Reception:
        key = (source, broadcast)
        if key not in self._receptions:
            self._receptions[key] = Reception(source, broadcast)
        return self._receptions[key]

    def _note(
        self,
        tick: int,
        empty: str,
        payload: Payload | None,
        ends: tuple[Address, Address],
        heard: Callable[[int], Heard],
        k: int,
        idle: bool,
    ) -> None:
        """Count and record one frame of a transaction: *payload*, or a packet of the type *empty*."""
        kind, air, length = empty, HEADER_AIR, 0
        if payload is not None:
            payload.tries += 1
            kind, air, length = payload.kind.name, payload.air, len(payload.outgoing.payload)
            self._frames.payloads[kind] += 1
        if self._frames.idle_wanted or (self._frames.wanted and not idle):
            self._frames.record(tick, kind, air, ends, heard(k), k, length)


def _shape(payload: Payload | None) -> tuple[int, Time, bool]:
    """Return (slots, air time, whether it goes on the air for the first time) of a packet with or without a payload."""
    if payload is None:
        return 1, HEADER_AIR, False
    return payload.kind.slots, payload.air, payload.tries == 0
