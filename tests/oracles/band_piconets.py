"""Connected piconets in the oracle of the whole band: every tick of a master is visited, every slot pair decided.

A pair is decided at its start; its frames go on the air and are judged one after the other. Instead of sequence bits
each receiver remembers which payload it took last, and each sender waits for word of that very payload.
"""

from dataclasses import dataclass

from cosim.channels.bluetooth.hopping import basic_channel
from tests.oracles.band_air import POLLING
from tests.oracles.band_hosts import REFUSED
from tests.oracles.band_scene import ALL, KINDS, FlowNote, Seen, Sent
from tests.oracles.band_stage import AIR, DELIVER, Device, Entry, Link, Stage
from tests.oracles.medium import HEADER_AIR, NOT_TUNED, OUT_OF_RANGE, RECEIVED, OnAir


def heard(outcome: str, part: str | None) -> bool:
    """Return whether the header of a frame with that fate was received, and so all that it says."""
    return outcome in (RECEIVED, REFUSED) or part == "payload"


@dataclass
class Piconet:
    """The piconet of *master*, if it has one."""

    stage: Stage
    master: Device

    def start(self) -> None:
        """Visit every tick from now on."""
        self.visit_at(self.master.clock.tick(self.stage.now))

    def visit_at(self, tick: int) -> None:
        time = self.master.clock.start(tick)
        if time < self.stage.now:
            return self.visit_at(tick + 1)
        self.stage.at(time, AIR, self.master.address, lambda: self.visit(tick))
        return None

    def visit(self, tick: int) -> None:
        if tick % 4 == 0 and tick >= self.master.free and self.master.own():
            self.decide(tick)
        self.visit_at(tick + 1)

    # ------------------------------------------------------------ the decision

    def need(self, slots: int) -> int:
        """Return the ticks of a pair that begins with a packet of *slots*, with the longest answer there may be."""
        return 2 * (slots + max(KINDS[name].slots for name in self.stage.scene.kinds))

    def here(self, slots: int) -> bool:
        return self.stage.present(self.master, self.master.address, self.need(slots))

    def believed_here(self, link: Link, slots: int) -> bool:
        """Return whether the slave is here as far as the master knows: it knows the parts."""
        share = self.stage.devices[link.slave].share
        return share is None or self.stage.in_part(share, self.master.address, self.need(slots))

    def can_poll(self, link: Link, slots: int) -> bool:
        return self.here(slots) and self.believed_here(link, slots)

    def payload(self) -> Entry | None:
        """Return the first payload of the queue that can be sent now."""
        before: list[int] = []
        for entry in self.master.queue:
            if entry.destination == ALL:
                return entry if not before and self.here(entry.slots) else None
            link = self.master.to(entry.destination)
            assert link is not None
            if entry.destination not in before and not link.stopped and self.can_poll(link, entry.slots):
                return entry
            before.append(entry.destination)
        return None

    def decide(self, tick: int) -> None:
        overdue = [link for link in self.master.own() if link.due <= tick and self.can_poll(link, 1)]
        data = self.payload()
        if overdue:
            link = min(overdue, key=lambda link: (link.due, link.lt_addr))
            Pair(self, tick, link, data if data and data.destination == link.slave else None).begin()
        elif data is not None and data.destination == ALL:
            self.broadcast(tick, data)
        elif data is not None:
            to = self.master.to(data.destination)
            assert to is not None
            Pair(self, tick, to, data).begin()

    def broadcast(self, tick: int, data: Entry) -> None:
        """Send *data* to all slaves once (more)."""
        stage, now = self.stage, self.stage.now
        data.sent += 1
        stage.book.counts[data.kind] += 1
        last = data.sent == stage.scene.n_bc
        if last:
            self.master.queue.remove(data)
        self.master.free = tick + 2 * data.slots + 2
        channel = basic_channel(self.master.body.word, tick)
        frame = stage.air.put(now, data.air, self.master.address, channel)
        contents = data.token, data.sent > 1
        stage.book.sent.append(Sent(now, self.master.address, data.kind, ALL, data.air, channel, 0, *contents))
        links = [
            link
            for link in self.master.links
            if link.master == self.master.address and (link.above.alive or link.below.alive)
        ]
        listeners = [
            (
                link,
                stage.air.power(self.master.address, link.slave, now),
                stage.present(stage.devices[link.slave], self.master.address, self.need(data.slots)),
            )
            for link in sorted(links, key=lambda link: link.lt_addr)
        ]
        stage.at(frame.end, DELIVER, self.master.address, lambda: self.end_broadcast(frame, data, listeners, last))

    def end_broadcast(self, frame: OnAir, data: Entry, listeners: list[tuple[Link, float, bool]], last: bool) -> None:
        stage = self.stage
        for link, carrier, here in listeners:
            if not (link.above.alive or link.below.alive):
                continue  # nobody's slave any more
            slave = stage.devices[link.slave]
            outcome, part = self.outcome(frame, slave.address, carrier, data, here and link.below.alive)
            stage.book.seen.append(self.seen(frame, data.kind, slave.address, 0, outcome, part))
            stage.arrive(frame, slave.address, carrier, outcome, part)
            if heard(outcome, part):
                stage.hear(link, slave, frame.end)
            if outcome == RECEIVED and data.token not in link.broadcasts:
                link.broadcasts.add(data.token)
                stage.deliver(slave, self.master.address, data)
        if last:
            stage.verdict(self.master.address, data.token, "sent")

    def outcome(
        self, frame: OnAir, receiver: int, carrier: float, data: Entry | None, tuned: bool
    ) -> tuple[str, str | None]:
        if self.stage.air.out_of_range(carrier):
            return OUT_OF_RANGE, None
        if not tuned:
            return NOT_TUNED, None
        contents = data.contents if data else POLLING
        return self.stage.air.judge(frame, receiver, carrier, contents, self.stage.now)

    def seen(self, frame: OnAir, kind: str, to: int, lt_addr: int, outcome: str, part: str | None) -> Seen:
        start, end, source, channel = frame
        return Seen(start, end - start, kind, source, to, channel, lt_addr, outcome, part)


@dataclass
class Pair:
    """A slot pair: a packet of the master at the tick *tick* and the slave's answer."""

    piconet: Piconet
    tick: int
    link: Link
    data: Entry | None

    def begin(self) -> None:
        """Fix what is sent in both directions, and how strong; send the master's packet."""
        piconet, link, data = self.piconet, self.link, self.data
        stage = piconet.stage
        master, slave = piconet.master, stage.devices[link.slave]
        now = stage.now
        link.due = self.tick + 2 * stage.scene.t_poll
        self.kind, air, self.slots = (data.kind, data.air, data.slots) if data else ("POLL", HEADER_AIR, 1)
        master.free = self.tick + 2 * self.slots + 2
        if data:
            data.sent += 1
        self.down = stage.air.power(master.address, slave.address, now)
        self.up = stage.air.power(slave.address, master.address, now)
        self.here = stage.present(slave, master.address, piconet.need(self.slots))
        self.acknowledged, link.above.owes_ack = link.above.owes_ack, None
        stop = not master.transport.has_place(slave.address, now)
        if stop:
            self.flow("slave's payload waits" if link.queue else "master stops")
        if link.stopped:
            self.flow("polled though stopped")
        waiting = [] if stop else [entry for entry in link.queue if entry.token != self.acknowledged]
        self.reply = waiting[0] if waiting else None
        if self.reply:
            self.reply.chosen = True
        self.idle = data is None and not link.queue
        stage.book.counts[self.kind] += 1
        stage.book.counts["idle"] += self.idle
        frame = stage.air.put(now, air, master.address, basic_channel(master.body.word, self.tick))
        self.sent(frame, self.kind, slave.address, data)
        stage.at(frame.end, DELIVER, master.address, lambda: self.end_of_packet(frame))

    def sent(self, frame: OnAir, kind: str, to: int, data: Entry | None) -> None:
        """Note that a frame with *data* has been sent."""
        start, end, source, channel = frame
        contents = (data.token, data.sent > 1) if data else (None, False)
        row = Sent(start, source, kind, to, end - start, channel, self.link.lt_addr, *contents, self.idle)
        self.piconet.stage.book.sent.append(row)

    def note(self, frame: OnAir, kind: str, to: int, outcome: str, part: str | None) -> None:
        book = self.piconet.stage.book
        self.piconet.stage.arrive(frame, to, self.down if to == self.link.slave else self.up, outcome, part, self.idle)
        into = book.idle if self.idle else book.seen
        into.append(self.piconet.seen(frame, kind, to, self.link.lt_addr, outcome, part))

    def flow(self, what: str) -> None:
        stage = self.piconet.stage
        start = self.piconet.master.clock.start(self.tick)
        stage.book.flow.append(FlowNote(start, what, self.link.master, self.link.slave))

    def end_of_packet(self, frame: OnAir) -> None:
        """Judge the master's packet at its slave."""
        piconet, link, stage = self.piconet, self.link, self.piconet.stage
        slave = stage.devices[link.slave]
        tuned = self.here and link.below.alive
        outcome, part = piconet.outcome(frame, slave.address, self.down, self.data, tuned)
        fresh = self.data if outcome == RECEIVED and self.data and link.below.taken != self.data.token else None
        if fresh and not slave.transport.has_place(piconet.master.address, frame.end):
            outcome = REFUSED
            self.flow("refused")
        self.note(frame, self.kind, slave.address, outcome, part)
        if not heard(outcome, part):
            if link.stopped:
                self.flow("go without answer")
            link.stopped = False
            if self.reply:
                self.reply.chosen = False
            return
        stage.hear(link, slave, frame.end)
        if link.queue and link.queue[0].token == self.acknowledged:
            stage.verdict(slave.address, link.queue.pop(0).token, "delivered")
        self.payload_taken = outcome == RECEIVED
        if fresh and outcome == RECEIVED:
            link.below.taken = fresh.token
            stage.deliver(slave, piconet.master.address, fresh)
        self.says_stop = not slave.transport.has_place(piconet.master.address, frame.end)
        stage.book.counts[self.reply.kind if self.reply else "NULL"] += 1
        tick = self.tick + 2 * self.slots
        piconet.master.free = tick + 2 * (self.reply.slots if self.reply else 1)
        stage.at(piconet.master.clock.start(tick), AIR, slave.address, lambda: self.answer(tick))

    def answer(self, tick: int) -> None:
        stage, link, reply = self.piconet.stage, self.link, self.reply
        if not link.below.alive:
            stage.doubt("a slave's side is lost before it answers")
        air = reply.air if reply else HEADER_AIR
        if reply:
            reply.sent += 1
            reply.chosen = False
        frame = stage.air.put(stage.now, air, link.slave, basic_channel(self.piconet.master.body.word, tick))
        self.sent(frame, reply.kind if reply else "NULL", link.master, reply)
        stage.at(frame.end, DELIVER, link.slave, lambda: self.end_of_answer(frame))

    def end_of_answer(self, frame: OnAir) -> None:
        """Judge the answer at the master."""
        piconet, link, reply, stage = self.piconet, self.link, self.reply, self.piconet.stage
        master = piconet.master
        outcome, part = piconet.outcome(frame, master.address, self.up, reply, link.above.alive)
        fresh = reply if outcome == RECEIVED and reply and link.above.taken != reply.token else None
        if fresh and not master.transport.has_place(link.slave, frame.end):
            outcome = REFUSED
            self.flow("refused by master")
        self.note(frame, reply.kind if reply else "NULL", master.address, outcome, part)
        if self.says_stop:
            self.flow("slave stops" if heard(outcome, part) else "stop unheard")
            if link.stopped and not heard(outcome, part):
                self.flow("go by lost answer")
        link.stopped = heard(outcome, part) and self.says_stop
        if not heard(outcome, part):
            return
        stage.hear(link, master, frame.end)
        if self.data and self.payload_taken and self.data in master.queue:
            master.queue.remove(self.data)
            stage.verdict(master.address, self.data.token, "delivered")
        if reply and outcome == RECEIVED:
            link.above.owes_ack = reply.token
        if fresh and outcome == RECEIVED:
            link.above.taken = fresh.token
            stage.deliver(master, link.slave, fresh)
