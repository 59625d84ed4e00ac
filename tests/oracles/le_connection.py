"""A slow model of a connection of Bluetooth Low Energy that goes from packet to packet and counts every event.

Sources: Bluetooth Core v5.0, Vol 6 Part B: channels 4.5.8, transmit window 4.5.3, window widening 4.2.2 and 4.5.7,
event 4.5.1 and 4.5.6, acknowledgement 4.5.9, supervision 4.5.2, instants 5.1.1 and 5.5. Integers of ns; local times are
counted on each end's own clock, whose time is phase + t + floor(t ppm / 10^6).

Readings, where the specification or the readings of the channel leave a choice:

1. A packet is heard in a window if its start lies within it, both ends included. Where windows overlap it counts for
   the earlier event. w has 16 us of jitter in it; an event for which w reaches interval / 2 - T_IFS is not listened to,
   and at its expected time the peripheral gives the connection up.
2. Within a transmit window w is that of the window's end. A window of an update adds to one that is still open.
3. A peripheral that has heard the first packet of an event with any CRC is anchored by it. It sleeps through `latency`
   events after one whose last packet that came with a right CRC had MD = 0, if it has nothing to send or repeat but
   empty packets, and knows of no instant to come.
4. The central repeats what is not acknowledged, empty packets too. It begins an exchange only if its packet, T_IFS, the
   packet that the peripheral has to repeat, or else an empty one, and T_IFS end by the event's limit; in the first
   exchange it sends an empty packet if a new one does not fit. The peripheral sends an empty packet for a new one that,
   with T_IFS, does not end by the limit.
5. After an answer with a wrong CRC the central goes on if its own MD was 1.
6. The timer of supervision begins anew at the instant of an update, which is where its event was to be without it. A
   deadline that is that instant comes first. Instants of this very event have passed.
7. An end is gone once its TERMINATE is acknowledged, or once it has sent the packet that acknowledges one. With one end
   gone the event is over.
"""

from collections import deque
from fractions import Fraction
from math import ceil
from typing import NamedTuple, TypeAlias

US = 1_000
T_IFS = 150 * US
JITTER = 16 * US
CONTINUATION, START, CONTROL = 1, 2, 3
HEARD, MISSED, BAD = "heard", "missed", "bad_crc"
MAP_OCTETS, UPDATE_OCTETS, TERMINATE_OCTETS = 8, 12, 2
PER_OCTET = {"1M": 8, "2M": 4, "Coded S=2": 16, "Coded S=8": 64}
EMPTY_US = {"1M": 80, "2M": 44, "Coded S=2": 462, "Coded S=8": 720}
"""Air time of a packet without payload."""


class Put(NamedTuple):
    """A data PDU that a host hands to an end before the event of this number, counted from the first."""

    before: int
    side: int
    octets: int


class Update(NamedTuple):
    before: int
    size: int
    offset: int
    interval: int
    latency: int
    timeout: int


class Map(NamedTuple):
    before: int
    used: tuple[int, ...]


class Bye(NamedTuple):
    before: int
    side: int


class Case(NamedTuple):
    """A run; *limits*: time of events from their anchors on, *receptions*: of packets in order; both come again."""

    interval: int
    latency: int
    timeout: int
    size: int
    offset: int
    start: int
    created: int
    clocks: tuple[tuple[int, int], tuple[int, int]]
    ppm: int
    address: int
    hop: int
    algorithm_2: bool
    used: tuple[int, ...]
    phy: str
    first: int
    events: int
    limits: tuple[int, ...]
    receptions: tuple[str, ...]
    inputs: tuple[Put | Update | Map | Bye, ...]


class Sent(NamedTuple):
    """A packet; *event* is the central's number, *reception* what came of it with who listened."""

    event: int
    channel: int
    start_ns: int
    air_ns: int
    side: int
    llid: int
    nesn: int
    sn: int
    md: bool
    octets: int
    reception: str


class Result(NamedTuple):
    packets: list[Sent]
    delivered: list[tuple[int, int, int]]
    """(receiver, number of the PDU among its sender's, end of the packet)"""
    acknowledged: list[tuple[int, int, int]]
    """(sender, number of the PDU, end of the packet that told so)"""
    losses: tuple[tuple[str, int] | None, tuple[str, int] | None]


Input: TypeAlias = Put | Update | Map | Bye


class Item(NamedTuple):
    llid: int
    octets: int
    number: int
    what: Update | Map | Bye | None = None
    instant: int = 0


NOTHING = Item(CONTINUATION, 0, -1)


class Ear:
    """One end."""

    def __init__(self, case: Case, side: int) -> None:
        self.phase, self.drift = case.clocks[side]
        self.sequence = 0
        self.expects = 0
        self.unacknowledged: Item | None = None
        self.urgent: deque[Item] = deque()
        self.queue: deque[Item] = deque()
        self.used = case.used
        self.interval, self.latency, self.timeout = case.interval, case.latency, case.timeout
        self.since = self.local(case.created)
        self.ever = False
        self.coming: list[Item] = []
        self.event = case.first
        """The event for which it waits, or that it will begin."""
        self.due = 0
        """Local time of that event."""
        self.gone: tuple[str, int] | None = None
        self.told = False
        self.puts = 0

    def local(self, time: int) -> int:
        return self.phase + time + time * self.drift // 1_000_000

    def time(self, local: int) -> int:
        """Return the first instant at which it is *local*."""
        time = local - self.phase
        while self.local(time) != local:
            step = local - self.local(time)
            if abs(step) <= 2:
                break
            time += step
        while self.local(time) < local:
            time += 1
        while self.local(time - 1) >= local:
            time -= 1
        return time

    def deadline(self) -> tuple[str, int]:
        if self.ever:
            return "supervision", self.time(self.since + self.timeout)
        return "not_established", self.time(self.since + 6 * self.interval)

    def give_up(self, why: str, when: int) -> None:
        if self.gone is None:
            self.gone = why, when

    def give_up_by(self, now: int) -> None:
        why, when = self.deadline()
        if when <= now:
            self.give_up(why, when)

    def has_news(self) -> bool:
        return len(self.urgent) + len(self.queue) > 0

    def would_send(self) -> Item:
        if self.unacknowledged is not None:
            return self.unacknowledged
        if self.urgent:
            return self.urgent[0]
        return self.queue[0] if self.queue else NOTHING

    def take_out(self, item: Item) -> None:
        if self.unacknowledged is None and item is not NOTHING:
            (self.urgent if self.urgent else self.queue).popleft()
        self.unacknowledged = item


class Model:
    """A connection as *case* has it."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self.central, self.peripheral = self.ears = Ear(case, 0), Ear(case, 1)
        opening = 1250 * US + case.offset
        self.central.due = self.central.since + opening + case.start
        self.peripheral.due = self.peripheral.since + opening
        self.heard_at = self.peripheral.since
        self.window = case.size
        self.wakes = case.first
        self.sent = 0
        self.result = Result([], [], [], (None, None))

    # the peripheral's windows

    def widening(self) -> int:
        elapsed = self.peripheral.due + self.window - self.heard_at
        return ceil(Fraction(self.case.ppm * elapsed, 1_000_000)) + JITTER

    def deaf(self) -> bool:
        return self.widening() >= self.peripheral.interval // 2 - T_IFS

    def wait_for(self, now: int) -> bool:
        """Let the peripheral pass all windows that close before *now*; return whether one is open."""
        ear = self.peripheral
        while ear.gone is None:
            self.change_peripheral(now)
            if self.deaf():
                loss = ear.time(ear.due)
                self.give_up_peripheral(min(now, loss))
                if loss <= now:
                    ear.give_up("widening", loss)
                return False
            width = self.widening()
            if ear.local(now) < ear.due - width:
                break
            if ear.local(now) <= ear.due + self.window + width:
                self.give_up_peripheral(now)
                return ear.gone is None
            ear.event += 1
            ear.due += ear.interval
        self.give_up_peripheral(now)
        return False

    def give_up_peripheral(self, now: int) -> None:
        self.peripheral.give_up_by(now)

    def change_peripheral(self, now: int) -> None:
        ear = self.peripheral
        while ear.coming and ear.coming[0].instant == ear.event and ear.gone is None:
            if isinstance(ear.coming[0].what, Update) and ear.local(now) < ear.due - self.widening():
                return
            item = ear.coming.pop(0)
            if isinstance(item.what, Map):
                ear.used = item.what.used
                continue
            assert isinstance(item.what, Update)
            if not self.deaf():
                self.give_up_peripheral(ear.time(ear.due))
            elif ear.deadline()[1] <= ear.time(ear.due):
                ear.give_up(*ear.deadline())
            else:
                ear.give_up("widening", ear.time(ear.due))
            update(ear, item.what)
            self.window += item.what.size

    # one event

    def channel(self, ear: Ear) -> int:
        case, used = self.case, ear.used
        if not case.algorithm_2:
            unmapped = 0
            for _ in range((ear.event + 1) % 37):
                unmapped = (unmapped + case.hop) % 37
            return unmapped if unmapped in used else used[unmapped % len(used)]
        key = case.address // 65536 ^ case.address % 65536
        number = ear.event % 65536 ^ key
        for _ in range(3):
            octets = (number >> 8, number & 255)
            high, low = (sum((octet >> bit & 1) << 7 - bit for bit in range(8)) for octet in octets)
            number = (17 * (256 * high + low) + key) % 65536
        number ^= key
        return number % 37 if number % 37 in used else used[len(used) * number // 65536]

    def air(self, item: Item) -> int:
        return (EMPTY_US[self.case.phy] + PER_OCTET[self.case.phy] * item.octets) * US

    def run(self) -> Result:
        now = 0
        for count in range(self.case.events):
            self.hand_in(count)
            central = self.central
            while central.coming and central.coming[0].instant == central.event:
                item = central.coming.pop(0)
                if isinstance(item.what, Map):
                    central.used = item.what.used
                else:
                    assert isinstance(item.what, Update)
                    central.give_up_by(central.time(central.due))
                    update(central, item.what)
            now = central.time(central.due)
            central.give_up_by(now)
            listening = self.wait_for(now)
            if central.gone is not None:
                break
            self.hold_event(count, now, listening)
            central.event += 1
            central.due += central.interval
        end = now + 40_000_000_000
        for ear in self.ears:
            while ear.coming:  # updates go on to happen
                self.run_out(ear)
        self.central.give_up_by(end)
        self.wait_for(end)
        return self.result._replace(losses=(self.central.gone, self.peripheral.gone))

    def run_out(self, ear: Ear) -> None:
        """Let the next instant of an end come without any packet."""
        if ear is self.peripheral:
            while ear.coming and ear.gone is None:
                self.wait_for(ear.time(ear.due + self.window + self.widening()) + 1)
            ear.coming = ear.coming if ear.gone is None else []
            return
        item = ear.coming.pop(0)
        ear.due += (item.instant - ear.event) * ear.interval
        ear.event = item.instant
        if isinstance(item.what, Update):
            ear.give_up_by(ear.time(ear.due))
            update(ear, item.what)

    def hand_in(self, count: int) -> None:
        for wish in self.case.inputs:
            if wish.before != count:
                continue
            if isinstance(wish, Put):
                ear = self.ears[wish.side]
                ear.queue.append(Item(START, wish.octets, ear.puts))
                ear.puts += 1
            elif isinstance(wish, Bye):
                self.ears[wish.side].urgent.append(Item(CONTROL, TERMINATE_OCTETS, -2, wish))
            else:
                octets = MAP_OCTETS if isinstance(wish, Map) else UPDATE_OCTETS
                instant = self.central.event + self.central.latency + 7
                item = Item(CONTROL, octets, -2, wish, instant)
                self.central.urgent.append(item)
                self.central.coming.append(item)
                self.central.coming.sort(key=lambda coming: coming.instant)

    def hold_event(self, count: int, anchor: int, listening: bool) -> None:
        case, central, peripheral = self.case, self.central, self.peripheral
        limit = anchor + case.limits[count % len(case.limits)]
        listening = (
            listening
            and (peripheral.event >= self.wakes or self.burdened() or bool(peripheral.coming))
            and self.channel(central) == self.channel(peripheral)
        )
        bad, now, first = [0, 0], anchor, True
        quiet = met = False
        while True:
            answer = peripheral.unacknowledged or NOTHING
            item = central.would_send()
            room = limit - now - self.air(answer) - 2 * T_IFS
            if self.air(item) > room and first and central.unacknowledged is None:
                item = NOTHING
            if self.air(item) > room:
                break
            reception = self.transmit(0, item, now, listening)
            central_more = central.has_news()
            now += self.air(item)
            if reception == MISSED:
                break
            met = True
            if reception == HEARD:
                bad[1], quiet = 0, not central_more
                self.hear(peripheral, central, item, now)
            else:
                bad[1] += 1
            if bad[1] == 2 or self.over():
                break
            now += T_IFS
            answer = peripheral.would_send()
            if now + self.air(answer) + T_IFS > limit:
                answer = NOTHING
            reception = self.transmit(1, answer, now, True)
            more = peripheral.has_news()
            now += self.air(answer)
            if peripheral.told:
                peripheral.give_up("terminated", now)
            if reception == HEARD:
                bad[0] = 0
                self.hear(central, peripheral, answer, now)
            else:
                bad[0], more = bad[0] + 1, False
            if reception == MISSED or bad[0] == 2 or not (more or central_more) or self.over():
                break
            now, first = now + T_IFS, False
        if met:
            self.anchor_peripheral(anchor, quiet)

    def anchor_peripheral(self, anchor: int, quiet: bool) -> None:
        ear = self.peripheral
        rests = quiet and not self.burdened() and not ear.coming
        self.wakes = ear.event + 1 + (ear.latency if rests else 0)
        self.heard_at, self.window = ear.local(anchor), 0
        ear.event, ear.due = ear.event + 1, self.heard_at + ear.interval

    def burdened(self) -> bool:
        pending = self.peripheral.unacknowledged
        return self.peripheral.has_news() or (pending is not None and pending is not NOTHING)

    def over(self) -> bool:
        return any(ear.gone is not None for ear in self.ears)

    def transmit(self, side: int, item: Item, start: int, listened: bool) -> str:
        ear = self.ears[side]
        ear.take_out(item)
        reception = self.case.receptions[self.sent % len(self.case.receptions)] if listened else MISSED
        self.sent += 1
        channel = self.channel(self.central)
        bits = (ear.expects, ear.sequence, ear.has_news())
        packet = (start, self.air(item), side, item.llid, *bits, item.octets, reception)
        self.result.packets.append(Sent(self.central.event, channel, *packet))
        self.carried = ear.expects, ear.sequence
        if side == 0 and ear.told:
            ear.give_up("terminated", start + self.air(item))
        return reception

    def hear(self, ear: Ear, other: Ear, item: Item, end: int) -> None:
        """Let *ear* take the packet with a right CRC that *other* has just sent."""
        acknowledgement, sequence = self.carried
        ear.since, ear.ever = ear.local(end), True
        pending = ear.unacknowledged
        if pending is not None and acknowledgement == (ear.sequence + 1) % 2:
            ear.sequence, ear.unacknowledged = acknowledgement, None
            if isinstance(pending.what, Bye):
                ear.give_up("terminated", end)
            if pending.number >= 0:
                self.result.acknowledged.append((self.ears.index(ear), pending.number, end))
        if sequence != ear.expects:
            return
        ear.expects = (ear.expects + 1) % 2
        if item.number >= 0:
            self.result.delivered.append((self.ears.index(ear), item.number, end))
        if isinstance(item.what, Bye):
            ear.told = True
        elif item.what is not None:
            if item.instant % 65536 == ear.event % 65536 or (item.instant - ear.event) % 65536 >= 32767:
                ear.give_up("instant_passed", end)
            else:
                instant = ear.event + (item.instant - ear.event) % 65536
                ear.coming.append(item._replace(instant=instant))
                ear.coming.sort(key=lambda coming: coming.instant)


def update(ear: Ear, new: Update) -> None:
    """Let an end that is at the instant of an update begin with its parameters."""
    ear.since = ear.due
    ear.due += new.offset
    ear.interval, ear.latency, ear.timeout = new.interval, new.latency, new.timeout
