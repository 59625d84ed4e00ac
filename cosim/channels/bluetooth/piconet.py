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
from cosim.channels.bluetooth.adaptation import Adaptation
from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.fitting import BestFit
from cosim.channels.bluetooth.frames import FrameLog
from cosim.channels.bluetooth.intake import Intake
from cosim.channels.bluetooth.links import Links, Presence
from cosim.channels.bluetooth.modes import Modes
from cosim.channels.bluetooth.packets import ACL, PacketType
from cosim.channels.bluetooth.parking import Parking
from cosim.channels.bluetooth.polling import (
    EVERYONE,
    HELD,
    JOINED,
    NEXT,
    NOTHING,
    RUNNING,
    SEEN_DOWN,
    SEEN_UP,
    SEQ_DOWN,
    SEQ_UP,
)
from cosim.channels.bluetooth.queues import News, Payload, Queues
from cosim.channels.bluetooth.radio import Air
from cosim.channels.bluetooth.scanning import first_transmission
from cosim.channels.bluetooth.schedule import SCHEDULERS, Schedule, Scheduler
from cosim.channels.bluetooth.slots import Deliver, Slots
from cosim.channels.bluetooth.supervision import Supervision
from cosim.channels.bluetooth.traffic import Traffic
from cosim.channels.bluetooth.transport import Transport
from cosim.kernel import WAKE, Kernel
from cosim.machine import Address, Lost, Outcome, Outgoing
from cosim.units import SLOT, S, Time


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
    queue: int | None = None
    """How many payloads a device holds; None for any number."""
    flush: Time | None = None
    """How long a payload may wait for its acknowledgement; None for ever."""
    park_interval_slots: int = 2048
    """Slots from one beacon window for parked slaves to the next; even."""
    park_window_slots: int = 64
    """Slots of a beacon window; even."""
    best_packets: bool = False
    """Whether payloads go in the packet type of the best expected rate, or in the smallest that holds them."""
    afh: tuple[Time, Time] | None = None
    """How often the hop set is adapted, and after what time a bad channel is tried again; None for the basic one."""


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
        transport: Transport | None = None,
    ) -> None:
        """*on_lost* is called with (side, peer) before the side's host learns that its link is lost.

        Payloads reach hosts through *transport*, if there is one, else by *deliver* at once.
        """
        self.address = address
        self.clock = clock
        piconet, table = air.band.piconets[address], air.band.links[address]
        longest = max(kind.slots for kind in settings.types)
        polling.reset(piconet, table, settings.t_poll_slots, clock.phase, clock.ppm, longest)
        piconet[polling.MASTER], piconet[polling.WORD] = address, hop_address
        self.links = Links(address, piconet, table, transport)
        frames.attach(self.links)
        self._kernel = kernel
        self._air = air
        self._frames = frames
        self._deliver = deliver
        self._on_lost = on_lost
        piconet[polling.SCHEDULER] = SCHEDULERS[settings.scheduler]
        self._queues = Queues(table, SCHEDULERS[settings.scheduler])
        self._parking = Parking(self.links, settings.park_interval_slots, settings.park_window_slots)
        own = (kernel, air, clock, self.links, self._queues, self._parking)
        longest_silence = settings.supervision - 2 * settings.t_poll_slots * SLOT
        self.modes = Modes(*own, longest_silence, self._tell, self._changed)
        fit = BestFit(air, self.links, settings.types) if settings.best_packets else None
        rules = (Schedule(self.links, self._queues, fit), settings.n_bc)
        traffic = Traffic(air, clock, self.links, frames)
        self._slots = Slots(*own, *rules, traffic, deliver, self.modes.beacon_heard)
        hand_in = (settings.types, settings.queue, settings.flush, self._tell)
        self._intake = Intake(kernel, air, self.links, self._queues, self._slots, *hand_in)
        self._adaptation = Adaptation(kernel, air, self.links, *settings.afh) if settings.afh else None
        watched = (self.links, self._parking)
        self._supervision = Supervision(kernel, settings.supervision, *watched, self.advance, self._expire)

    # ------------------------------------------------------------ links

    def members(self) -> tuple[Address, ...]:
        """Return the slaves whose link the master takes to be up, by LT_ADDR."""
        return tuple(self.links.slaves[k] for k in self.links.held())

    def free_lt_addr(self) -> int | None:
        """Return the smallest LT_ADDR that no side of a link uses, or None."""
        return self.links.free_lt_addr()

    def linked(self, slave: Address) -> bool:
        """Return whether either side takes *slave* for a member, parked or not."""
        return slave in self.links.lt_addr or self._parking.number(slave) is not None

    def join(self, slave: Address, lt_addr: int) -> None:
        """Bring the side of *slave* up: it has received the first POLL now."""
        self.advance(self._kernel.now)
        self.links.join(slave, lt_addr, self._kernel.now)
        self._changed()

    def admit(self, slave: Address, due: int) -> None:
        """Bring the master's side up: it has heard *slave* now; the next packet to it is due at the tick *due*."""
        self.advance(self._kernel.now)
        self.links.admit(self.links.lt_addr[slave], due, self._kernel.now)
        self._changed()

    def _changed(self) -> None:
        self._air.changed(self._kernel.now)
        self._supervision.watch()
        self._slots.arm()
        if self._adaptation is not None:
            self._adaptation.wake()

    def hand_over(self, slave: Address, other: "Piconet") -> News:
        """Turn the link to *slave* round: from now on *other*, its piconet, has it, with all that waits on either side.

        Return the fates of broadcasts, which are flushed. To be called between two slot pairs.
        """
        k = self.links.lt_addr[slave]
        bits = [int(self.links.table[row, k]) for row in (SEQ_UP, SEEN_UP, SEQ_DOWN, SEEN_DOWN)]
        down, up = self._queues.take(EVERYONE), self._queues.take(k)
        for side in (HELD, JOINED):
            self.links.take_down(k, side)
        self._changed()
        other.resume()
        other.add_slave(self.address, 1, int(other.links.piconet[NEXT]))
        other.links.table[[SEQ_DOWN, SEEN_DOWN, SEQ_UP, SEEN_UP], 1] = bits
        other._take_over([payload for payload in down if payload.lt_addr != EVERYONE], up)
        return self._queues.fates([payload for payload in down if payload.lt_addr == EVERYONE], self.address)

    def _take_over(self, up: list[Payload], down: list[Payload]) -> None:
        """Queue what waits on a link that has been turned round to LT_ADDR 1, in its slave (*up*) and here (*down*)."""
        for payload in (*up, *down):
            payload.lt_addr = 1
        for queue, payloads in ((1, up), (EVERYONE, down)):
            for payload in payloads:
                self._intake.push(queue, payload)

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
        k = self._number(peer if from_master else side)
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
        k = self._number(device)
        if device == self.address:
            for held in (*self.links.held(), *self._parking.members):
                self._drop(held, HELD)
        elif k is not None:
            self._drop(k, JOINED)
        self._slots.arm()

    def _number(self, slave: Address) -> int | None:
        """Return the LT_ADDR of a slave, or its number if it is parked."""
        return self.links.lt_addr.get(slave, self._parking.number(slave))

    # ------------------------------------------------------------ time

    def advance(self, now: Time) -> None:
        """Decide all slots before *now*; needed before anything changes, and before the state is looked at."""
        self._air.advance(now)

    def set_presence(self, device: Address, presence: Presence) -> None:
        """Note when *device*, the master or a slave, is there from now on."""
        self.advance(self._kernel.now)
        parked = self._parking.number(device)
        if parked is None:
            self.links.set_presence(device, presence)
        else:
            self._parking.members[parked].presence = presence
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
        self.advance(now := self._kernel.now)
        free = int(self.links.piconet[NEXT])
        return self.clock.time_of(free) if free > first_transmission(self.clock, now) else None

    def boundary(self) -> Time:
        """Return the start of the first TX slot about which nothing has been decided: nothing is on the air then."""
        self.advance(self._kernel.now)
        return self.clock.time_of(int(self.links.piconet[NEXT]))

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

    def send(self, source: Address, outgoing: Outgoing) -> Outcome | None:
        """Queue a payload at *source*, the master or a slave, or return why not; that also comes as a new event."""
        return self._intake.send(source, outgoing)

    def flush(self, source: Address, destination: Address) -> None:
        """Take out of the queue of *source* what is meant for *destination* and has never been on the air."""
        self._intake.flush(source, destination)

    # ------------------------------------------------------------ ends

    def _expire(self, silent: list[tuple[int, int]]) -> None:
        news: News = []
        for k, side in silent:
            news += self._drop(k, side)
        self._slots.arm()
        if news:
            self._deliver((), news)

    def _drop(self, k: int, side: int) -> News:
        """Take one side of a link down and return what its host learns: Lost, and the fates of what it had queued."""
        parked = k in self._parking.members
        if not (self._parking.up(k, side) if parked else self.links.up(k, side)):
            return []
        slave = self._parking.members[k].slave if parked else self.links.slaves[k]
        (self._parking if parked else self.links).take_down(k, side)
        self._air.changed(self._kernel.now)
        if side == HELD:
            host, peer = self.address, slave
            fates = self._queues.flush_link(k, host, master_alone=not self.links.audience())
        else:
            host, peer = slave, self.address
            fates = [] if parked else self._queues.flush(k, host)
        self._on_lost(host, peer)
        return [(host, Lost(peer)), *fates]

    def _tell(self, news: News) -> None:
        """Deliver *news* in a new event at this instant; in the last phase before AIR, so that any caller may ask."""
        if news:
            self._kernel.at(self._kernel.now, partial(self._deliver, (), news), WAKE)
