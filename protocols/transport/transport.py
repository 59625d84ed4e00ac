"""The courier of a robot: it carries letters to other robots reliably, and tells all of them news.

A letter of any size arrives once and in order, or is given up, which its author learns; of news only the latest of each
topic counts, and nobody acknowledges them (paper 004 has TCP between robots, and nothing else). Where radios need links
the master of the piconet passes on what slaves say to each other. A robot that boots again begins a new life: what it
had sent before, and what others remember of it, does not confuse the letters of the new one.

Deadlines count by a clock of its own, which stands still when the host's is set back.
"""

from collections import defaultdict
from collections.abc import Collection, Iterator
from typing import Final, NamedTuple

from cosim.errors import LocalProtocolError, WireError
from cosim.geometry.planning import Point
from cosim.machine import Address, Connected, Event, Fate, LinkCommand, LinkEvent, Outgoing, Reception
from cosim.units import Time, from_seconds
from protocols.transport.frames import ALL, NEWS_OVERHEAD, Ack, Bulletin, Frame, Part, decode, encode, life_of
from protocols.transport.links import Links
from protocols.transport.parameters import CourierParameters
from protocols.transport.sending import Counts, Dispatch
from protocols.transport.streams import Inbound
from protocols.wire import BadBytes

BEAT: Final = 0xFF
"""The topic of the news that say only that their author lives, and which robots have no master, as far as it knows."""
LIVES: Final = 4
"""Lives of a robot of which another remembers what has arrived, or what news."""


class Letter(NamedTuple):
    """A letter that has arrived."""

    source: Address
    payload: bytes


class News(NamedTuple):
    """News that have arrived."""

    source: Address
    topic: int
    payload: bytes
    at: Time
    """When they came."""


class Courier:
    """One robot's courier."""

    def __init__(self, me: Address, size: int, parameters: CourierParameters, start: Time) -> None:
        """Carry for robot *me* of a team of *size*, whose life begins at *start*."""
        self.me = me
        self.bad: list[Event] = []
        """What was no frame of the team; to be drained by who reads it."""
        self.links = None if parameters.links is None else Links(me, size, parameters.links, start)
        self._size = size
        self._life = life_of(start)
        self._dispatch = Dispatch(me, self._life, parameters, self.links)
        self._news_octets = parameters.octets - NEWS_OVERHEAD
        self._patience = from_seconds(parameters.ack_s)
        self._beat = None if parameters.links is None else from_seconds(parameters.links.beat_s)
        self._floods = parameters.flood and self.links is None
        self._now = start
        self._behind: Time = 0
        """By how much the host's clock was set back altogether."""
        self._inbound: dict[Address, dict[int, Inbound]] = defaultdict(dict)
        """Letters that come in, by author and life; of an author's lives that was heard last which is last."""
        self._known: dict[tuple[Address, int], dict[int, int]] = defaultdict(dict)
        """Of each author and topic, the greatest number of news that was heard of each life; the last life is last."""
        self._posted = 0
        self._told = 0
        self._told_at = start
        self._heard: dict[Address, Time] = {}
        self._letters: list[Letter] = []
        self._news: list[News] = []
        self._returned: list[tuple[Address, int]] = []
        self._wake: Time | None = None

    @property
    def counts(self) -> Counts:
        """What it has sent."""
        return self._dispatch.counts

    @property
    def news_octets(self) -> int:
        """The length of the longest news."""
        return self._news_octets

    # ------------------------------------------------------------ what the robot says

    def post(self, destination: Address, payload: bytes, now: Time) -> int:
        """Send a letter, and return its number; one to oneself has arrived. Raise LocalProtocolError for no robot."""
        self._check(destination)
        time = self._time(now)
        self._posted += 1
        if destination == self.me:
            self._letters.append(Letter(self.me, payload))
        else:
            self._dispatch.post(destination, self._posted, payload, time)
        self._act(time)
        return self._posted

    def tell(self, topic: int, payload: bytes, now: Time) -> None:
        """Tell all in reach; raise LocalProtocolError for news that are too long, or of a topic not in 0..254."""
        if not 0 <= topic < BEAT or len(payload) > self._news_octets:
            raise LocalProtocolError(f"no news: {len(payload)} bytes, topic {topic}")
        time = self._time(now)
        self._tell(topic, payload, time)
        self._act(time)

    def _tell(self, topic: int, payload: bytes, time: Time) -> None:
        self._told += 1
        self._told_at = time
        bulletin = Bulletin(topic, self._told, payload)
        self._dispatch.say(self.me, bulletin, encode(Frame(self.me, ALL, self._life, bulletin)), time)

    def forget(self, other: Address, now: Time) -> None:
        """Give up all letters for *other*, which is taken for dead."""
        self._check(other)
        time = self._time(now)
        self._returned += [(other, number) for number in self._dispatch.forget(other)]
        if self.links is not None:
            self.links.forget(other)
        self._act(time)

    def _check(self, robot: Address) -> None:
        if not 0 <= robot < self._size:
            raise LocalProtocolError(f"there is no robot {robot}")

    # ------------------------------------------------------------ what it is told

    def letters(self) -> list[Letter]:
        """Return the letters that have arrived, once."""
        letters, self._letters = self._letters, []
        return letters

    def news(self) -> list[News]:
        """Return the news that have arrived, once."""
        news, self._news = self._news, []
        return news

    def returned(self) -> list[tuple[Address, int]]:
        """Return the destinations and numbers of the letters that were given up, once: some may have arrived."""
        returned, self._returned = self._returned, []
        return returned

    def heard(self, other: Address) -> Time | None:
        """Return when anything of *other* came last, by the host's clock as it is set now; None if nothing has."""
        at = self._heard.get(other)
        return None if at is None else at - self._behind

    def drain(self) -> list[Outgoing | LinkCommand]:
        """Return what is to be sent, and the link commands, once."""
        return self._dispatch.drain()

    # ------------------------------------------------------------ what happens to it

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a frame; what is none becomes an event in ``bad``."""
        time = self._time(now)
        try:
            self._take(decode(data), data, reception, time)
        except WireError:
            self.bad.append(BadBytes(reception.source, len(data)))
        self._act(time)

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take news about links, and what has become of frames."""
        time = self._time(now)
        if isinstance(event, Fate):
            self._dispatch.fate(event, time)
        elif self.links is not None:
            self.links.link(event, time)
            if isinstance(event, Connected):
                self._dispatch.hasten(range(self._size), time)
            if self.links.left:
                self._tell(BEAT, bytes(self.links.left), time)
                self.links.left = ()
        self._act(time)

    def tick(self, here: Point, seen: Collection[Address], now: Time) -> None:
        """Keep the links, once a world tick; *seen* are those in sight. Where it is, *here*, decides nothing yet."""
        time = self._time(now)
        if self.links is not None and self._beat is not None:
            self.links.tick(seen, time)
            if self.links.audience is not None and time - self._told_at >= self._beat:
                self._tell(BEAT, b"", time)
        self._act(time)

    def wake(self, now: Time) -> None:
        """Act on all deadlines up to *now*."""
        self._act(self._time(now))

    def wake_at(self) -> Time | None:
        """Return the earliest deadline."""
        return None if self._wake is None else self._wake - self._behind

    @property
    def settled(self) -> bool:
        """Whether no letter waits for an answer, and nobody for one of this robot's.

        News are not waited for: a radio that is off never says what has become of them.
        """
        waits = any(outbound.deadline is not None for outbound in self._dispatch.outbound.values())
        time = self._now + self._behind
        return not waits and not any(each.due is not None and each.due > time for _, each in self._streams())

    def _time(self, now: Time) -> Time:
        """Return *now* by the own clock, which never goes back."""
        self._behind += max(self._now - now, 0)
        self._now = now
        return now + self._behind

    def _act(self, time: Time) -> None:
        """Act on deadlines that are over, send what may be sent, and find the next deadline."""
        self._returned += self._dispatch.time_out(time)
        self._dispatch.send(self._streams(), time)
        # acknowledgements that are overdue wait for the radio, not for a time
        dues = (inbound.due for _, inbound in self._streams() if inbound.due is not None and inbound.due > time)
        self._wake = min([*self._dispatch.deadlines(time), *dues], default=None)

    def _streams(self) -> Iterator[tuple[Address, Inbound]]:
        return ((author, inbound) for author, lives in self._inbound.items() for inbound in lives.values())

    # ------------------------------------------------------------ receiving

    def _take(self, frame: Frame, data: bytes, reception: Reception, time: Time) -> None:
        """Take a frame; raise WireError for one that nobody of this team can have meant."""
        author, destination = frame.author, frame.destination
        if author >= self._size or (destination != ALL and destination >= self._size):
            raise WireError("of another team")
        if author == self.me:
            return
        if destination in (ALL, self.me):
            self._hear(frame, data, time)
        if self.links is not None:
            self.links.heard(reception.source, time)
            if reception.source == author and not reception.broadcast:
                self._relay(frame, data, self.links, time)
        self._heard[author] = time
        self._dispatch.hasten((author,), time)

    def _relay(self, frame: Frame, data: bytes, links: Links, time: Time) -> None:
        """Say again, as a master, what a slave has said to others."""
        if isinstance(frame.message, Bulletin):
            if not links.slaves <= {frame.author}:
                self._dispatch.say(frame.author, frame.message, data, time)
        elif frame.destination in links.slaves:
            self._dispatch.relay(frame.destination, data)

    def _hear(self, frame: Frame, data: bytes, time: Time) -> None:
        """Take a frame that is meant for this robot."""
        match frame.message:
            case Part() as part:
                self._hear_part(frame.author, frame.life, part, time)
            case Ack() as ack if ack.of == self._life:
                outbound = self._dispatch.outbound.get(frame.author)
                if outbound is None:
                    raise WireError("an acknowledgement of what was never sent")
                outbound.acknowledged(ack, frame.life, time)
            case Bulletin(topic, number, payload) as news:
                known = self._known[frame.author, topic]
                if number <= known.get(frame.life, 0):
                    return
                known.pop(frame.life, None)
                known[frame.life] = number
                if len(known) > LIVES:
                    del known[next(iter(known))]
                if topic != BEAT:
                    self._news.append(News(frame.author, topic, payload, time - self._behind))
                elif self.links is not None:
                    self.links.find(payload)
                if self._floods:
                    self._dispatch.say(frame.author, news, data, time)

    def _hear_part(self, author: Address, life: int, part: Part, time: Time) -> None:
        lives = self._inbound[author]
        inbound = lives.pop(life, None) or Inbound(life, self._patience)
        letters = inbound.take(part, time)
        lives[life] = inbound
        if len(lives) > LIVES:
            del lives[next(iter(lives))]
        self._letters += [Letter(author, payload) for payload in letters]
