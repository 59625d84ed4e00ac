"""The slot-by-slot oracle of a connected piconet: every half-slot of the master is visited, every slot pair decided.

Readings: overdue polls first, then the head of the one queue, then nothing; stop and wait. Instead of sequence bits
each receiver remembers which payload it took last, and each sender waits for word of that very payload.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from cosim.channels.bluetooth.hopping import basic_channel
from tests.oracles.medium import (
    HEADER_AIR,
    NOT_TUNED,
    OUT_OF_RANGE,
    RECEIVED,
    US,
    Clock,
    Reach,
    Sighting,
)

ALL = -1
NEVER = 1 << 62


class Kind(NamedTuple):
    """A packet type: slots, capacity in bytes, bytes of payload header, and whether every 10 bits are sent as 15."""

    slots: int
    capacity: int
    header: int
    coded: bool


KINDS = {
    "DM1": Kind(1, 17, 1, True),
    "DH1": Kind(1, 27, 1, False),
    "DM3": Kind(3, 121, 2, True),
    "DH3": Kind(3, 183, 2, False),
    "DM5": Kind(5, 224, 2, True),
    "DH5": Kind(5, 339, 2, False),
}


class Send(NamedTuple):
    """A host's payload of *length* bytes; *token* also names it."""

    time: int
    source: int
    destination: int
    length: int
    token: int


class Flush(NamedTuple):
    """A host's wish to forget what it has queued for *destination*."""

    time: int
    source: int
    destination: int


class Suspend(NamedTuple):
    """The master leaves its piconet alone in [time, until)."""

    time: int
    until: int


class Join(NamedTuple):
    """A link comes up; its first poll is due at the tick *due*."""

    time: int
    address: int
    lt_addr: int
    due: int


class Delivery(NamedTuple):
    """A payload, named by its token, reaches a host."""

    time: int
    source: int
    receiver: int
    token: int
    broadcast: bool


class Verdict(NamedTuple):
    """The fate of a payload."""

    time: int
    owner: int
    token: int
    outcome: str


class Loss(NamedTuple):
    """*owner* gives up *peer*."""

    time: int
    owner: int
    peer: int


@dataclass
class Entry:
    """A payload in a queue."""

    destination: int
    token: int
    kind: str
    length: int
    sent: int = 0
    """How often it has been on the air."""

    @property
    def slots(self) -> int:
        return KINDS[self.kind].slots

    @property
    def air(self) -> int:
        kind = KINDS[self.kind]
        bits = 8 * (kind.header + self.length + 2)
        return HEADER_AIR + US * (-(-bits // 10) * 15 if kind.coded else bits)


@dataclass
class Side:
    """What one end of a link knows of the other."""

    heard: int
    """End of the last frame heard."""
    alive: bool = True
    taken: int | None = None
    """The token of the last payload taken from the other end."""
    owes_ack: int | None = None
    """Master: the token that the last answer brought."""


@dataclass
class Link:
    """One slave; the link has come up at *up*."""

    address: int
    lt_addr: int
    due: int
    up: int
    master: Side = field(init=False)
    slave: Side = field(init=False)
    queue: list[Entry] = field(default_factory=list)
    """The slave's queue."""

    def __post_init__(self) -> None:
        self.master, self.slave = Side(self.up), Side(self.up)


Input = Join | Send | Flush | Suspend


@dataclass
class Piconet:
    """The piconet of the master *address* from *start* to *end* (exclusive), with all that its hosts will do."""

    address: int
    word: int
    clock: Clock
    inputs: Sequence[Input]
    reach: Reach
    start: int
    end: int
    t_poll: int
    n_bc: int
    kinds: tuple[str, ...]
    supervision: int
    sightings: list[Sighting] = field(default_factory=list)
    idle: list[Sighting] = field(default_factory=list)
    """Those of transactions in which neither side has a payload."""
    deliveries: list[Delivery] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    losses: list[Loss] = field(default_factory=list)

    def run(self) -> None:
        self.links: list[Link] = []
        self.queue: list[Entry] = []
        self.seen_broadcasts: set[tuple[int, int]] = set()
        self.pending = sorted(self.inputs, key=lambda item: item.time)
        self.free = self.resume = self.start
        tick = self.clock.tick(self.start - 1)
        while True:
            tick += 1
            now = self.clock.start(tick)
            self.live_until(min(now, self.end - 1))
            if now >= self.end:
                break
            if tick % 4 == 0 and now >= self.free and now >= self.resume:
                self.free = self.clock.start(tick + self.slot_pair(tick, now))
        for rows in (self.sightings, self.idle, self.deliveries, self.verdicts, self.losses):
            rows.sort()

    # ------------------------------------------------------------ between the slots

    def live_until(self, now: int) -> None:
        """Do everything up to *now* that is not a slot: losses, then what hosts do, in the order of time."""
        while True:
            deadline, number, is_master = self.next_deadline()
            wish = self.pending[0].time if self.pending else NEVER
            if min(deadline, wish) > now:
                return
            if deadline <= wish:
                self.lose(deadline, self.links[number], is_master)
            else:
                self.act(self.pending.pop(0))

    def next_deadline(self) -> tuple[int, int, bool]:
        """Return the earliest supervision time-out, the number of its link, and whether it is the master's."""
        deadlines = [
            (side.heard + self.supervision, number, is_master)
            for number, link in enumerate(self.links)
            for is_master, side in ((True, link.master), (False, link.slave))
            if side.alive
        ]
        return min(deadlines, default=(NEVER, 0, False))

    def lose(self, now: int, link: Link, is_master: bool) -> None:
        if is_master:
            link.master.alive = False
            self.losses.append(Loss(now, self.address, link.address))
            self.drop(self.queue, now, self.address, lambda entry: entry.destination == link.address)
            if not any(other.master.alive for other in self.links):
                self.drop(self.queue, now, self.address, lambda entry: entry.destination == ALL)
        else:
            link.slave.alive = False
            self.losses.append(Loss(now, link.address, self.address))
            self.drop(link.queue, now, link.address, lambda entry: True)

    def drop(self, queue: list[Entry], now: int, owner: int, wanted: Callable[[Entry], bool]) -> None:
        for entry in [entry for entry in queue if wanted(entry)]:
            queue.remove(entry)
            self.verdicts.append(Verdict(now, owner, entry.token, "flushed"))

    def act(self, wish: Input) -> None:
        match wish:
            case Send():
                self.send(wish)
            case Join(now, address, lt_addr, due):
                self.links.append(Link(address, lt_addr, due, now))
                self.links.sort(key=lambda link: link.lt_addr)
            case Flush(now, source, destination):
                self.drop(
                    self.queue_of(source),
                    now,
                    source,
                    lambda entry: entry.destination == destination and entry.sent == 0,
                )
            case Suspend():
                self.resume = wish.until

    def link_to(self, address: int) -> Link | None:
        return next((link for link in self.links if link.address == address), None)

    def queue_of(self, owner: int) -> list[Entry]:
        link = self.link_to(owner)
        return self.queue if link is None else link.queue

    def send(self, wish: Send) -> None:
        fitting = [name for name in self.kinds if KINDS[name].capacity >= wish.length]
        if not self.has_link(wish.source, wish.destination):
            self.verdicts.append(Verdict(wish.time, wish.source, wish.token, "no_link"))
        elif not fitting:
            self.verdicts.append(Verdict(wish.time, wish.source, wish.token, "too_long"))
        else:
            kind = min(fitting, key=lambda name: KINDS[name].capacity)
            self.queue_of(wish.source).append(Entry(wish.destination, wish.token, kind, wish.length))

    def has_link(self, source: int, destination: int) -> bool:
        if source == self.address:
            return any(link.master.alive and destination in (link.address, ALL) for link in self.links)
        link = self.link_to(source)
        return link is not None and link.slave.alive and destination == self.address

    # ------------------------------------------------------------ the slots

    def slot_pair(self, tick: int, now: int) -> int:
        """Decide the slot pair at *tick*; return how many ticks it takes."""
        overdue = [link for link in self.links if link.master.alive and link.due <= tick]
        head = self.queue[0] if self.queue else None
        if overdue:
            link = min(overdue, key=lambda link: (link.due, link.lt_addr))
            return self.transaction(tick, now, link, head if head and head.destination == link.address else None)
        if head is None:
            return 4
        if head.destination == ALL:
            return self.broadcast(tick, now, head)
        to = self.link_to(head.destination)
        assert to is not None
        return self.transaction(tick, now, to, head)

    def transaction(self, tick: int, now: int, link: Link, data: Entry | None) -> int:
        """Exchange one packet in each direction with one slave."""
        link.due = tick + 2 * self.t_poll
        kind, air, slots = (data.kind, data.air, data.slots) if data else ("POLL", HEADER_AIR, 1)
        if data:
            data.sent += 1
        outcome = self.outcome(self.address, link.address, now, link.slave.alive)
        idle = data is None and not link.queue
        self.see(now, air, kind, self.address, link.address, tick, outcome, idle)
        acknowledged, link.master.owes_ack = link.master.owes_ack, None
        if outcome != RECEIVED:
            return 2 * slots + 2
        end = now + air
        link.slave.heard = end
        if acknowledged is not None and link.queue and link.queue[0].token == acknowledged:
            self.verdicts.append(Verdict(end, link.address, link.queue.pop(0).token, "delivered"))
        if data and link.slave.taken != data.token:
            link.slave.taken = data.token
            self.deliveries.append(Delivery(end, self.address, link.address, data.token, False))
        return 2 * slots + 2 * self.answer(tick + 2 * slots, now, link, data, idle)

    def answer(self, tick: int, decided: int, link: Link, asked: Entry | None, idle: bool) -> int:
        """Let the slave answer at *tick*; return the number of slots of its packet."""
        data = link.queue[0] if link.queue else None
        kind, air, slots = (data.kind, data.air, data.slots) if data else ("NULL", HEADER_AIR, 1)
        if data:
            data.sent += 1
        now = self.clock.start(tick)
        outcome = self.outcome(link.address, self.address, decided, True)
        self.see(now, air, kind, link.address, self.address, tick, outcome, idle)
        if outcome == RECEIVED:
            end = now + air
            link.master.heard = end
            if asked:
                self.queue.remove(asked)
                self.verdicts.append(Verdict(end, self.address, asked.token, "delivered"))
            if data:
                link.master.owes_ack = data.token
                if link.master.taken != data.token:
                    link.master.taken = data.token
                    self.deliveries.append(Delivery(end, link.address, self.address, data.token, False))
        return slots

    def broadcast(self, tick: int, now: int, data: Entry) -> int:
        """Send the head to all slaves once (more)."""
        data.sent += 1
        end = now + data.air
        for link in self.links:
            if not (link.master.alive or link.slave.alive):
                continue
            outcome = self.outcome(self.address, link.address, now, link.slave.alive)
            self.see(now, data.air, data.kind, self.address, link.address, tick, outcome)
            if outcome == RECEIVED:
                link.slave.heard = end
                if (link.address, data.token) not in self.seen_broadcasts:
                    self.seen_broadcasts.add((link.address, data.token))
                    self.deliveries.append(Delivery(end, self.address, link.address, data.token, True))
        if data.sent == self.n_bc:
            self.queue.remove(data)
            self.verdicts.append(Verdict(end, self.address, data.token, "sent"))
        return 2 * data.slots + 2

    def outcome(self, source: int, destination: int, decided: int, tuned: bool) -> str:
        if not self.reach(source, destination, decided):
            return OUT_OF_RANGE
        return RECEIVED if tuned else NOT_TUNED

    def see(
        self, start: int, air: int, kind: str, source: int, to: int, tick: int, outcome: str, idle: bool = False
    ) -> None:
        channel = basic_channel(self.word, tick)
        into = self.idle if idle else self.sightings
        into.append(Sighting(start, air, kind, source, to, channel, outcome))
