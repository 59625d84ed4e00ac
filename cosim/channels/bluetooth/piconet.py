"""A connected piconet: one master, up to seven slaves, time division duplex.

The master transmits in slots that start where 4 divides its tick; only the slave that it addresses answers, in the next
slot. At every free TX slot the master serves, in this order: the link whose poll is overdue, the head of its queue,
nobody. There is one queue a device, strictly first in, first out, broadcasts among the rest. (Core v1.2, Vol 2 Part B,
sections 4.5, 7 and 8.)

What is sent in a slot pair is decided at its start, in the kernel's phase AIR, with what is queued and received at that
instant; what becomes of a frame, at its end. Kernel events exist only for slots with a payload in them and for
supervision time-outs; idle polls are a loop over arrays, run for all piconets together when somebody looks (``band``).
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from cosim.channels.bluetooth import polling
from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.frames import FrameLog
from cosim.channels.bluetooth.links import Links, Presence
from cosim.channels.bluetooth.packets import ACL, PacketType, smallest
from cosim.channels.bluetooth.polling import (
    EVERYONE,
    HEARD_DOWN,
    HEARD_UP,
    HELD,
    JOINED,
    MOST_SLAVES,
    NEXT,
    NOTHING,
    RUNNING,
)
from cosim.channels.bluetooth.queues import News, Payload, Queues, fate
from cosim.channels.bluetooth.radio import Air
from cosim.channels.bluetooth.scanning import first_transmission
from cosim.channels.bluetooth.schedule import SCHEDULERS, Schedule, Scheduler
from cosim.channels.bluetooth.slots import Deliver, Slots
from cosim.kernel import WAKE, Handle, Kernel
from cosim.machine import BROADCAST, Address, Lost, Outcome, Outgoing
from cosim.units import S, Time


class PiconetSettings(NamedTuple):
    """Parameters of a connected piconet."""

    types: tuple[PacketType, ...] = tuple(ACL.values())
    """Packet types in use."""
    n_bc: int = 1
    """How often a broadcast is sent."""
    t_poll_slots: int = 40
    """Slots from one packet to a slave until the next is due; even."""
    supervision: Time = 20 * S
    """A side that has heard nothing for so long takes the link for lost."""
    scheduler: Scheduler = "lazy"
    """How the master chooses whom to address."""


class Piconet:
    """The links of the master at *address*, and what waits to be sent on either side of them."""

    def __init__(
        self,
        kernel: Kernel,
        air: Air,
        address: Address,
        hop_address: int,
        clock: NativeClock,
        settings: PiconetSettings,
        frames: FrameLog,
        deliver: Deliver,
        on_lost: Callable[[Address, Address], None] = lambda side, peer: None,
    ) -> None:
        """*on_lost* is called with (side, peer) before the side's host learns that its link is lost."""
        self.address = address
        self.clock = clock
        piconet, table = air.band.piconets[address], air.band.links[address]
        longest = max(kind.slots for kind in settings.types)
        polling.reset(piconet, table, settings.t_poll_slots, clock.phase, clock.ppm, longest)
        piconet[polling.MASTER], piconet[polling.WORD] = address, hop_address
        self.links = Links(address, piconet, table)
        frames.attach(self.links)
        self._kernel = kernel
        self._air = air
        self._settings = settings
        self._frames = frames
        self._deliver = deliver
        self._on_lost = on_lost
        piconet[polling.SCHEDULER] = SCHEDULERS[settings.scheduler]
        self._queues = Queues(table, SCHEDULERS[settings.scheduler])
        schedule = Schedule(self.links, self._queues)
        self._slots = Slots(
            kernel, air, address, clock, settings.n_bc, self.links, self._queues, schedule, frames, deliver
        )
        self._supervision: Handle | None = None

    # ------------------------------------------------------------ links

    def members(self) -> tuple[Address, ...]:
        """Return the slaves whose link the master takes to be up, by LT_ADDR."""
        return tuple(self.links.slaves[k] for k in self.links.held())

    def free_lt_addr(self) -> int | None:
        """Return the smallest LT_ADDR that no side of a link uses, or None."""
        return next((k for k in range(1, MOST_SLAVES + 1) if k not in self.links.slaves), None)

    def join(self, slave: Address, lt_addr: int) -> None:
        """Bring the side of *slave* up: it has received the first POLL now."""
        self.advance(self._kernel.now)
        self.links.join(slave, lt_addr, self._kernel.now)
        self._air.changed(self._kernel.now)
        self._supervise()

    def admit(self, slave: Address, due: int) -> None:
        """Bring the master's side up: it has heard *slave* now; the next packet to it is due at the tick *due*."""
        self.advance(self._kernel.now)
        self.links.admit(self.links.lt_addr[slave], due, self._kernel.now)
        self._air.changed(self._kernel.now)
        self._supervise()
        self._slots.arm()

    def add_slave(self, slave: Address, lt_addr: int, due: int) -> None:
        """Bring both sides of a link up now, without a page."""
        self.join(slave, lt_addr)
        self.admit(slave, due)

    def close(self, side: Address, peer: Address) -> None:
        """End the link between *side* and *peer* at once on its own side and, if it is in reach, on the other.

        The time that the detach message takes is neglected. A peer out of reach finds out by supervision.
        """
        self.advance(self._kernel.now)
        from_master = side == self.address
        k = self.links.lt_addr.get(peer if from_master else side)
        if k is None or self.address not in (side, peer):
            return
        heard = self._air.reaches(self._air.carrier(side, peer))
        news = self._drop(k, HELD) if from_master or heard else []
        news += self._drop(k, JOINED) if heard or not from_master else []
        self._slots.arm()
        self._tell(news)

    def vanish(self, device: Address) -> None:
        """Take *device*, whose radio is switched off, out of the piconet without telling anybody."""
        self.advance(self._kernel.now)
        if device == self.address:
            for k in self.links.held():
                self._drop(k, HELD)
        elif device in self.links.lt_addr:
            self._drop(self.links.lt_addr[device], JOINED)
        self._slots.arm()

    # ------------------------------------------------------------ time

    def advance(self, now: Time) -> None:
        """Decide all slots before *now*; needed before anything changes, and before the state is looked at."""
        self._air.advance(now)

    def set_presence(self, device: Address, presence: Presence) -> None:
        """Note when *device*, the master or a slave, is there from now on."""
        self.advance(self._kernel.now)
        self.links.set_presence(device, presence)
        self._air.changed(self._kernel.now)
        self._slots.arm()

    def suspend(self) -> None:
        """Leave the piconet's slots alone from now on: the master inquires or pages."""
        self.advance(self._kernel.now)
        self.links.piconet[RUNNING] = 0
        self._air.changed(self._kernel.now)
        self._slots.arm()

    def resume(self) -> None:
        """Go on at the first TX slot from now on."""
        self.advance(self._kernel.now)
        self.links.piconet[RUNNING] = 1
        self._air.changed(self._kernel.now)
        first = first_transmission(self.clock, self._kernel.now)
        self.links.piconet[NEXT] = max(int(self.links.piconet[NEXT]), first)
        self._slots.arm()

    def pair_ends(self) -> Time | None:
        """Return when the slot pair under way is over, or None if there is none. To be asked before the phase AIR."""
        now = self._kernel.now
        self.advance(now)
        free = int(self.links.piconet[NEXT])
        return self.clock.time_of(free) if free > first_transmission(self.clock, now) else None

    def next_pause(self) -> Time | None:
        """Return None if the piconet may be suspended for a procedure that starts now: no slot under way, no link due.

        Otherwise return the start of the next TX slot at which to ask again. To be asked in an earlier phase than AIR.
        """
        now = self._kernel.now
        self.advance(now)
        tick = first_transmission(self.clock, now)
        free = int(self.links.piconet[NEXT])
        if free <= tick and polling.overdue(self.links.piconet, self.links.table, tick) == NOTHING:
            return None
        return self.clock.time_of(free if free > tick else tick + 4)

    def counts(self) -> dict[str, int]:
        """Return the number of frames sent so far by packet type, and of polls without a payload on either side."""
        self.advance(self._kernel.now)
        piconet = self.links.piconet
        polls = {"POLL": piconet[polling.POLLS], "NULL": piconet[polling.NULLS], "idle": piconet[polling.IDLE]}
        return {**self._frames.payloads, **{name: int(count) for name, count in polls.items()}}

    # ------------------------------------------------------------ payloads

    def send(self, source: Address, outgoing: Outgoing) -> None:
        """Queue a payload at *source*, the master or a slave. A fate that is clear at once comes as a new event."""
        queue, lt_addr = self._route(source, outgoing.destination)
        length = len(outgoing.payload)
        kind = smallest(self._settings.types, length)
        if lt_addr == NOTHING:
            self._tell(fate(source, outgoing, Outcome.NO_LINK))
        elif kind is None:
            self._tell(fate(source, outgoing, Outcome.TOO_LONG))
        else:
            overtaking = self._overtaking()
            if overtaking:
                self.advance(self._kernel.now)
            if self._queues.push(queue, Payload(lt_addr, outgoing, kind, kind.air_time(length))) or overtaking:
                self.advance(self._kernel.now)
                self._slots.arm()

    def _overtaking(self) -> bool:
        """Return whether a payload that is not the head may change what is sent next."""
        piconet = self.links.piconet
        return bool(piconet[polling.SHARED]) or self._settings.scheduler != "lazy"

    def flush(self, source: Address, destination: Address) -> None:
        """Take out of the queue of *source* what is meant for *destination* and has never been on the air."""
        queue = EVERYONE if source == self.address else self.links.lt_addr.get(source, NOTHING)
        if queue == NOTHING:
            return
        self.advance(self._kernel.now)
        news = self._queues.flush(queue, source, lambda p: _untouched(p, destination))
        self._slots.arm()
        self._tell(news)

    def _route(self, source: Address, destination: Address) -> tuple[int, int]:
        """Return (number of the queue, LT_ADDR of the packets), or NOTHING for the latter where there is no link."""
        links = self.links
        if source != self.address:
            k = links.lt_addr.get(source, NOTHING)
            return k, k if destination == self.address and links.up(k, JOINED) else NOTHING
        if destination == BROADCAST:
            return EVERYONE, EVERYONE if links.held() else NOTHING
        k = links.lt_addr.get(destination, NOTHING)
        return EVERYONE, k if links.up(k, HELD) else NOTHING

    # ------------------------------------------------------------ ends

    def _supervise(self) -> None:
        """Wait for the earliest time-out; that a deadline has moved later is found when its event fires."""
        heard = self.links.last_heard()
        if heard is None:
            return
        deadline = heard + self._settings.supervision
        if self._supervision is not None:
            if self._supervision.time <= deadline:
                return
            self._supervision.cancel()
        self._supervision = self._kernel.at(deadline, self._expire, WAKE)

    def _expire(self) -> None:
        self._supervision = None
        now = self._kernel.now
        self.advance(now)
        limit = now - self._settings.supervision
        news: News = []
        for k in sorted(self.links.slaves):
            for side, heard in ((HELD, HEARD_UP), (JOINED, HEARD_DOWN)):
                if self.links.table[heard, k] <= limit:
                    news += self._drop(k, side)
        self._supervise()
        self._slots.arm()
        if news:
            self._deliver((), news)

    def _drop(self, k: int, side: int) -> News:
        """Take one side of a link down and return what its host learns: Lost, and the fates of what it had queued."""
        if not self.links.up(k, side):
            return []
        slave = self.links.slaves[k]
        self.links.take_down(k, side)
        self._air.changed(self._kernel.now)
        if side == HELD:
            host, peer = self.address, slave
            fates = self._queues.flush_link(k, host, master_alone=not self.links.held())
        else:
            host, peer = slave, self.address
            fates = self._queues.flush(k, host)
        self._on_lost(host, peer)
        return [(host, Lost(peer)), *fates]

    def _tell(self, news: News) -> None:
        """Deliver *news* in a new event at this instant; in the last phase before AIR, so that any caller may ask."""
        if news:
            self._kernel.at(self._kernel.now, partial(self._deliver, (), news), WAKE)


def _untouched(payload: Payload, destination: Address) -> bool:
    """Return whether *payload* is meant for *destination*, has never been on the air, and is not about to be."""
    return payload.outgoing.destination == destination and not payload.tries and not payload.chosen
