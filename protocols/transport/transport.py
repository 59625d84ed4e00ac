"""The transport of a robot: reliable messages to one robot, and published values of which only the latest counts.

A message of any size arrives once and in order, or is given up, which its author learns. A publication goes to all in
reach, unacknowledged; of each author and topic only the latest counts, and a newer one replaces an older one that still
waits to be sent. (Paper 004 has TCP between robots, and nothing else.) Where radios need links, the master of the
piconet relays what slaves send to each other and to all. A robot that boots again begins a new incarnation: what it had
sent before, and what others remember of it, does not disturb the messages of the new one.

A machine holds one transport and passes its inputs on. After each of them it takes what has arrived, and its ``outbox``
returns what ``drain`` does::

    transport = Transport(me, size, TransportParameters(), start)
    transport.receive(data, reception, now)     # in Machine.receive
    transport.link(event, now)                  # in Machine.link
    transport.tick(visible, now)                # in Machine.observe
    transport.wake(now)                         # in Machine.wake, and wake_at() among the deadlines of Machine.wake_at
    transport.send(3, b"to robot 3", now)
    transport.publish(0, b"topic 0 is this", now)
    transport.messages(), transport.published(), transport.returned()

Deadlines count by a clock of its own, which stands still when the host's is set back.
"""

from collections import defaultdict
from collections.abc import Collection, Iterator
from typing import Final, NamedTuple

from cosim.errors import LocalProtocolError, WireError
from cosim.machine import Address, Connected, Event, Fate, LinkCommand, LinkEvent, Outgoing, Reception
from cosim.units import Time, from_seconds
from protocols.transport.frames import (
    ALL,
    PUBLICATION_OVERHEAD,
    Ack,
    Frame,
    Part,
    Publication,
    decode,
    encode,
    incarnation_of,
)
from protocols.transport.links import Links
from protocols.transport.parameters import TransportParameters
from protocols.transport.sending import Counts, Sender
from protocols.transport.streams import Inbound
from protocols.wire import BadBytes

BEAT: Final = 0xFF
"""Topic of heartbeats of the transport itself; the payload names robots that seem to have no master."""
INCARNATIONS: Final = 4
"""Number of incarnations of a robot of which another remembers what has arrived."""
_new: Final = tuple.__new__  # what a named tuple's own constructor calls; a third faster


class Message(NamedTuple):
    """A message that has arrived."""

    source: Address
    payload: bytes


class Published(NamedTuple):
    """A published value that has arrived."""

    source: Address
    topic: int
    payload: bytes
    at: Time
    """When it has arrived."""


class SteadyClock:
    """A clock that goes as the host's does, and stands still when that is set back: deadlines can be kept by it."""

    def __init__(self, start: Time) -> None:
        """Agree with the host's clock at *start*."""
        self.now = start
        """The time when it was read last."""
        self.behind: Time = 0
        """By how much the host's clock was set back altogether."""

    def read(self, now: Time) -> Time:
        """Return the time by this clock, *now* by the host's."""
        time = now + self.behind
        if time < self.now:
            self.behind += self.now - time
            return self.now
        self.now = time
        return time


class Transport:
    """One robot's transport; of all its methods *now* is the time by the host's clock."""

    def __init__(self, me: Address, size: int, parameters: TransportParameters, start: Time) -> None:
        """Carry for robot *me* of a team of *size*, whose incarnation begins at *start*."""
        self.me = me
        self.bad: list[Event] = []
        """Events for bytes that were no frame of the team; the machine drains it into its own events."""
        self.links = None if parameters.links is None else Links(me, size, parameters.links, start)
        self._size = size
        self._incarnation = incarnation_of(start)
        self._sender = Sender(me, self._incarnation, parameters, self.links)
        self._publication_octets = parameters.octets - PUBLICATION_OVERHEAD
        self._patience = from_seconds(parameters.ack_s)
        self._beat = None if parameters.links is None else from_seconds(parameters.links.beat_s)
        self._floods = parameters.flood and self.links is None
        self._clock = SteadyClock(start)
        self._inbound: dict[Address, dict[int, Inbound]] = defaultdict(dict)
        """Messages that come in, by author and incarnation; the incarnation that was heard last is last."""
        self._known: dict[tuple[Address, int], dict[int, int]] = defaultdict(dict)
        """Greatest number of a publication, by author and topic, then by incarnation, the last one last."""
        self._sent = 0
        self._published_count = 0
        self._published_at = start
        self._heard: dict[Address, Time] = {}
        self._messages: list[Message] = []
        self._published: list[Published] = []
        self._returned: list[tuple[Address, int]] = []
        self._wake: Time | None = None
        self._behind = self._clock.behind
        """By how much the host's clock was set back when ``_wake`` was found."""

    @property
    def counts(self) -> Counts:
        """What it has sent."""
        return self._sender.counts

    @property
    def publication_octets(self) -> int:
        """Bytes of the longest payload that can be published."""
        return self._publication_octets

    # ------------------------------------------------------------ what the robot sends

    def send(self, destination: Address, payload: bytes, now: Time) -> int:
        """Send a message reliably, and return its number; one to the robot itself arrives at once.

        Raise LocalProtocolError if there is no robot *destination*, or if *payload* has more than 65,535 parts.
        """
        self._check(destination)
        time = self._clock.read(now)
        self._sent += 1
        if destination == self.me:
            self._messages.append(Message(self.me, payload))
        else:
            self._sender.enqueue(destination, self._sent, payload, time)
        self._act(time)
        return self._sent

    def publish(self, topic: int, payload: bytes, now: Time) -> None:
        """Send the latest value of *topic* to all in reach, or all in the piconet, without acknowledgement.

        Raise LocalProtocolError if *payload* is longer than ``publication_octets``, or *topic* not in 0..254.
        """
        if not 0 <= topic < BEAT or len(payload) > self._publication_octets:
            raise LocalProtocolError(f"cannot be published: {len(payload)} bytes, topic {topic}")
        time = self._clock.read(now)
        self._publish(topic, payload, time)
        self._act(time)

    def _publish(self, topic: int, payload: bytes, time: Time) -> None:
        self._published_count += 1
        self._published_at = time
        publication = Publication(topic, self._published_count, payload)
        self._sender.publish(self.me, publication, encode(Frame(self.me, ALL, self._incarnation, publication)), time)

    def forget(self, other: Address, now: Time) -> None:
        """Give up all messages for *other*, which is taken for dead."""
        self._check(other)
        time = self._clock.read(now)
        self._returned += [(other, number) for number in self._sender.forget(other)]
        if self.links is not None:
            self.links.forget(other)
        self._act(time)

    def _check(self, robot: Address) -> None:
        if not 0 <= robot < self._size:
            raise LocalProtocolError(f"there is no robot {robot}")

    # ------------------------------------------------------------ what the robot receives

    def messages(self) -> list[Message]:
        """Return the messages that have arrived, once, in the order of their arrival."""
        messages, self._messages = self._messages, []
        return messages

    def published(self) -> list[Published]:
        """Return the values that others have published and that have arrived, once, in the order of their arrival."""
        published, self._published = self._published, []
        return published

    def returned(self) -> list[tuple[Address, int]]:
        """Return destinations and numbers of the messages that were given up, once; some may have arrived."""
        returned, self._returned = self._returned, []
        return returned

    def heard(self, other: Address) -> Time | None:
        """Return when any frame of *other* arrived last, by the host's clock as it is set now; None if none has."""
        at = self._heard.get(other)
        return None if at is None else at - self._clock.behind

    def drain(self) -> list[Outgoing | LinkCommand]:
        """Return frames and link commands for the machine's outbox, once."""
        return self._sender.drain()

    # ------------------------------------------------------------ inputs of the machine

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        """Take a frame; bytes that are no frame of the team become an event in ``bad``.

        Return False if it has no more to send than before, no earlier deadline and no event: then all that may have
        come of it is a value for ``published``.
        """
        time = self._clock.read(now)
        acts = self._due(time)
        try:
            acts |= self._take(decode(data), data, reception, time)
        except WireError:
            self.bad.append(BadBytes(reception.source, len(data)))
            acts = True
        if acts:
            self._act(time)
        return acts

    def link(self, event: LinkEvent, now: Time) -> bool:
        """Take an event of a link, or the fate of a frame.

        Return False if it has no more to send than before and no earlier deadline: nothing has come of it.
        """
        time = self._clock.read(now)
        acts = True
        if isinstance(event, Fate):
            waited = self._sender.fate(event, time)
            acts = waited or bool(self._inbound) or self._due(time)
        elif self.links is not None:
            self.links.link(event, time)
            if isinstance(event, Connected):
                self._sender.hasten(range(self._size), time)
            if self.links.left:
                self._publish(BEAT, bytes(self.links.left), time)
                self.links.left = ()
        if acts:
            self._act(time)
        return acts

    def tick(self, seen: Collection[Address], now: Time) -> bool:
        """Keep the links, once a world tick; *seen* are robots in sight.

        Return False if it has no more to send than before and no earlier deadline: nothing has come of it.
        """
        time = self._clock.read(now)
        acts = False
        if self.links is not None and self._beat is not None:
            self.links.tick(seen, time)
            if time - self._published_at >= self._beat and self.links.audience is not None:
                self._publish(BEAT, b"", time)
                acts = True
        acts = acts or self._due(time)
        if acts:
            self._act(time)
        return acts

    def wake(self, now: Time) -> None:
        """Act on all deadlines up to *now*."""
        self._act(self._clock.read(now))

    def wake_at(self) -> Time | None:
        """Return the earliest deadline; None if there is none."""
        return None if self._wake is None else self._wake - self._clock.behind

    @property
    def settled(self) -> bool:
        """True if no message waits for an answer, and no robot for an answer of this one.

        Publications are not waited for: a radio that is off never reports what has become of them.
        """
        waits = any(outbound.deadline is not None for outbound in self._sender.outbound.values())
        time = self._clock.now
        return not waits and not any(each.due is not None and each.due > time for _, each in self._streams())

    def _due(self, time: Time) -> bool:
        """Return whether there is something to act on, whatever has come.

        That is a deadline that is over, a link command to be drained, or a host's clock that was set back, with which
        all deadlines move.
        """
        if self._wake is not None and self._wake <= time:
            return True
        return self._clock.behind != self._behind or (self.links is not None and bool(self.links.commands))

    def _act(self, time: Time) -> None:
        """Act on deadlines that are over, send what may be sent, and find the next deadline."""
        self._returned += self._sender.time_out(time)
        streams = list(self._streams()) if self._inbound else []
        self._sender.send(streams, time)
        dues = self._sender.deadlines(time)
        for _, inbound in streams:
            # acknowledgements that are overdue wait for the radio, not for a time
            if inbound.due is not None and inbound.due > time:
                dues.append(inbound.due)
        self._wake = min(dues) if dues else None
        self._behind = self._clock.behind

    def _streams(self) -> Iterator[tuple[Address, Inbound]]:
        return ((author, each) for author, incarnations in self._inbound.items() for each in incarnations.values())

    # ------------------------------------------------------------ receiving

    def _take(self, frame: Frame, data: bytes, reception: Reception, time: Time) -> bool:
        """Take a frame; raise WireError for one that no robot of this team can have meant.

        Return whether there may be more to send than before, or an earlier deadline: not after a publication that is
        not relayed, unless its author, which did not answer before, is tried again.
        """
        author, destination = frame.author, frame.destination
        if author >= self._size or (destination != ALL and destination >= self._size):
            raise WireError("of another team")
        if author == self.me:
            return False
        acts = True
        if destination == ALL:
            acts = self._hear_publication(frame, data, time)
        elif destination == self.me:
            self._hear(frame, time)
        links = self.links
        if links is not None:
            links.heard(reception.source, time)
            if links.slaves and links.relays(author, reception):
                self._relay(frame, data, links, time)
                acts = True
        self._heard[author] = time
        outbound = self._sender.outbound.get(author)
        if outbound is not None and outbound.vain > 1:
            outbound.hasten(time)
            acts = True
        return acts

    def _relay(self, frame: Frame, data: bytes, links: Links, time: Time) -> None:
        """Relay, as a master, what a slave has sent to others."""
        if isinstance(frame.body, Publication):
            self._sender.publish(frame.author, frame.body, data, time)
        elif frame.destination in links.slaves:
            self._sender.relay(frame.destination, data)

    def _hear(self, frame: Frame, time: Time) -> None:
        """Take a frame of a message to this robot, or of one of its own."""
        match frame.body:
            case Part() as part:
                self._hear_part(frame.author, frame.incarnation, part, time)
            case Ack() as ack if ack.of == self._incarnation:
                outbound = self._sender.outbound.get(frame.author)
                if outbound is None:
                    raise WireError("an acknowledgement of what was never sent")
                outbound.acknowledged(ack, frame.incarnation, time)

    def _hear_publication(self, frame: Frame, data: bytes, time: Time) -> bool:
        """Take a publication, and return whether it is to be flooded."""
        author, _, incarnation, publication = frame
        assert isinstance(publication, Publication)
        topic, number, payload = publication
        known = self._known[author, topic]
        if number <= known.get(incarnation, 0):
            return False
        known[incarnation] = number
        if len(known) > 1:
            known[incarnation] = known.pop(incarnation)  # the last one last
        if len(known) > INCARNATIONS:
            del known[next(iter(known))]
        if topic != BEAT:
            self._published.append(_new(Published, (author, topic, payload, time - self._clock.behind)))
        elif self.links is not None:
            self.links.find(payload)
        if self._floods:
            self._sender.publish(author, publication, data, time)
        return self._floods

    def _hear_part(self, author: Address, incarnation: int, part: Part, time: Time) -> None:
        incarnations = self._inbound[author]
        inbound = incarnations.pop(incarnation, None) or Inbound(incarnation, self._patience)
        complete = inbound.take(part, time)
        incarnations[incarnation] = inbound
        if len(incarnations) > INCARNATIONS:
            del incarnations[next(iter(incarnations))]
        self._messages += [Message(author, payload) for payload in complete]
