"""How robots that have a map each get to know each other's: pieces of it, told once a period, and again on demand.

Once a period a robot tells all in reach the cells whose state its own sensors have changed, and a summary: how many
pieces of whose maps it has, and whom it asks for more, one of those who have claimed to have more. Who is asked tells
them to all, since others may lack them as well; those who are not asked are silent. So little is told twice but what
was lost, and pieces come over any number of robots to those who have never been in reach of their author. Nothing is
acknowledged but by these counts. Who asks in vain asks another the next time.

Where radios need links, each talks to whom its part in a piconet lets it talk to, and the master says again what slaves
have said.
"""

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from pydantic import Field

from cosim.arrays import Bools, Int32s
from cosim.errors import WireError
from cosim.geometry.planning import Point
from cosim.machine import BROADCAST, Address, Event, LinkCommand, LinkEvent, Outgoing, Reception, drained
from cosim.observation import Sighting
from cosim.settings import Count, Period, Settings
from cosim.units import MS, Time, from_seconds, to_seconds
from protocols.mapping.frames import (
    ENTRY_BYTES,
    MOST_PIECES,
    PIECE_OVERHEAD,
    RUN_BYTES,
    STAMPS,
    SUMMARY_OVERHEAD,
    Entry,
    Message,
    Piece,
    Stream,
    Summary,
    decode,
    encode,
    fits,
    from_runs,
    to_runs,
)
from protocols.transport.star import MASTER, LinkParameters, piconet_of
from protocols.wire import BadBytes

AWAY_PERIODS: Final = 3
"""Who has not been heard for so many periods is taken to be out of reach."""
QUIET_PERIODS: Final = 5
"""When so many periods have brought nothing new, neither told nor heard, all has been told."""
_NEWEST: Final = np.iinfo(np.int64).max


@dataclass(slots=True)
class SharingCounters:
    """What one robot counts as it shares its map."""

    frames: int = 0
    payload_bytes: int = 0
    pieces_again: int = 0
    """Pieces of maps that it has told on demand; they had been told before."""
    pieces_known: int = 0
    """Pieces that it has heard and had already."""


class SharingParameters(Settings):
    """How maps are merged by messages."""

    period_s: Period = Field(default=1.0, gt=0, description="s, from one telling to the next")
    octets: int = Field(default=200, ge=21, le=65535, description="bytes, the longest frame")
    again: Count = Field(default=4, ge=1, description="pieces that are told again in answer to one summary")
    links: LinkParameters | None = Field(
        default=None, description="talk over the links of a piconet: what Bluetooth needs; by default to all in reach"
    )


class Told(NamedTuple):
    """What another has told of some cells, each array (n,)."""

    cells: Int32s
    occupied: Bools
    newer: Bools
    """Whether that counts for more than what the robot has known of the cell."""


class Ledger:
    """The pieces that are known, by stream and number."""

    def __init__(self) -> None:
        self._pieces: dict[Stream, dict[int, Piece]] = {}
        self.counts: dict[Stream, int] = {}
        """How many pieces of each stream are known from the first on without a gap."""

    def add(self, piece: Piece) -> bool:
        """Note a piece; return whether it was not known."""
        known = self._pieces.setdefault(piece.stream, {})
        if piece.number in known:
            return False
        known[piece.number] = piece
        count = self.counts.get(piece.stream, 0)
        while count in known:
            count += 1
        self.counts[piece.stream] = count
        return True

    def count(self, stream: Stream) -> int:
        """Return how many pieces of *stream* are known from the first on without a gap."""
        return self.counts.get(stream, 0)

    def beyond(self, stream: Stream, count: int) -> list[Piece]:
        """Return the pieces of *stream* that somebody with the first *count* of them lacks, in order."""
        return [self._pieces[stream][number] for number in range(count, self.count(stream))]


class Sharing:
    """One robot's part in it.

    All who have the same pieces, and have told what they have seen, have the same map, in whatever order the pieces
    came. Where hits are certain, a cell is occupied if anybody has seen that. Where they are not, what was told last
    counts: stamps are milliseconds of the teller's clock, but greater than those of all that it had heard, so that who
    contradicts what it has heard is right.
    """

    def __init__(
        self,
        parameters: SharingParameters,
        me: Address,
        size: int,
        cells: int,
        counters: SharingCounters,
        start: Time,
        certain: bool = True,
    ) -> None:
        """Share maps of so many *cells* in a team of *size*, as *parameters* say, from *start* on.

        Robots send one after the other, so that they do not all contend for the air. *certain*: there are no false
        returns. What a robot has sent before it booted again is to it what any other robot has sent.
        """
        self.me = me
        self.ledger = Ledger()
        self.bad: list[Event] = []
        self._size = size
        self._cells = cells
        self._period = from_seconds(parameters.period_s)
        self._runs = (parameters.octets - PIECE_OVERHEAD) // RUN_BYTES
        self._entries = (parameters.octets - SUMMARY_OVERHEAD) // ENTRY_BYTES
        self._again = parameters.again
        self._counters = counters
        self._versions: np.ndarray[Any, np.dtype[np.int64]] | None = None if certain else np.zeros(cells, np.int64)
        """Stamp and author of what is known of each cell; greatest for what is to be told."""
        self._stream = Stream(me, start // MS % STAMPS)
        self._stamp = 0
        """The greatest stamp that was told or heard."""
        self._news: dict[int, bool] = {}
        """Cells that have changed since the last piece, and whether they are occupied."""
        self._last = start - self._period + self._period * me // size
        """When it told last."""
        self._beat = 0
        """How often it has told: periods are counted, since clocks may be set."""
        self._stirred = 0
        """In what period anything new was told or heard."""
        self._recent: set[tuple[Stream, int]] = set()
        """Pieces that were told in this period: who seems to lack them may not have got them yet."""
        self._claims: dict[Stream, dict[Address, tuple[int, int]]] = {}
        """How many pieces others have said to have, and in what period."""
        self._places: dict[Address, tuple[Point, Time, int]] = {}
        """Where the others have said that they were, or were seen, when, and in what period."""
        self.places_m: dict[Address, Point] = {}
        """Where the others were when they were heard or seen last."""
        self._here: Point | None = None
        self._piconet = None if parameters.links is None else piconet_of(me, size, parameters.links)
        self._outbox: list[Outgoing | LinkCommand] = []

    def places(self, now: Time) -> list[tuple[Address, Point, float]]:
        """Return where others were, and how many seconds ago: those who have been heard or seen lately."""
        return [
            (other, place, max(to_seconds(now - at), 0.0))
            for other, (place, at, beat) in self._places.items()
            if self._lately(beat)
        ]

    @property
    def silent(self) -> bool:
        """Whether all that is known has been told, and nobody has asked for more for a while."""
        return not self._news and self._beat - self._stirred >= QUIET_PERIODS

    def _lately(self, beat: int) -> bool:
        return self._beat - beat <= AWAY_PERIODS

    # ------------------------------------------------------------ telling

    def changed(self, cells: Int32s, occupied: Collection[bool]) -> None:
        """Note cells whose state the robot's own sensors have changed."""
        self._news.update(zip(cells.tolist(), occupied, strict=True))
        if self._versions is not None:
            self._versions[cells] = _NEWEST

    def tick(self, x_m: float, y_m: float, now: Time, sightings: Collection[Sighting] = ()) -> None:
        """Tell what is new, and what is known, if it is time; *sightings*: where others are seen, on the map."""
        self._here = x_m, y_m
        for other, at_x, at_y in sightings:
            self._stands(other, (at_x, at_y), now)
        if self._piconet is not None:
            self._piconet.tick(self._here, self.places_m, [other for other, _, _ in sightings], now)
        if 0 <= now - self._last < self._period:
            return
        self._last = now
        self._beat += 1
        self._recent.clear()
        for piece in self._pieces(now):
            self.ledger.add(piece)
            self._tell(piece)
        entries = list(self._known())
        for at in range(0, max(len(entries), 1), self._entries):
            self._say(Summary(x_m, y_m, tuple(entries[at : at + self._entries])))

    def _pieces(self, now: Time) -> Iterator[Piece]:
        """Yield the news in as many pieces as it takes."""
        if not self._news:
            return
        cells = np.array(list(self._news), np.int32)
        words = to_runs(cells, list(self._news.values()))
        self._news.clear()
        self._stamp = min(max(now // MS, self._stamp + 1), STAMPS - 1)
        if self._versions is not None:
            self._versions[cells] = self._version(self._stamp, self.me)
        for at in range(0, len(words), self._runs):
            if self.ledger.count(self._stream) == MOST_PIECES:
                self._stream = Stream(self.me, max(self._stamp, self._stream.life + 1) % STAMPS)
            yield Piece(self._stream, self.ledger.count(self._stream), self._stamp, words[at : at + self._runs])

    def _known(self) -> Iterator[Entry]:
        """Yield what is known of each stream, and whom to ask for more: in turn those who had more lately."""
        for stream in sorted(self.ledger.counts.keys() | self._claims.keys()):
            ours, claims = self.ledger.count(stream), self._claims.get(stream, {})
            having = sorted(other for other, (count, beat) in claims.items() if count > ours and self._lately(beat))
            if ours or having:
                yield Entry(stream, ours, self._whom(having))

    def _whom(self, having: list[Address]) -> Address:
        """Return whom of those who have more to ask: each in turn, but a piconet's master rather than its slaves."""
        if not having:
            return self.me
        if self._piconet is not None and MASTER in having:
            return MASTER
        return having[self._beat % len(having)]

    def _tell(self, piece: Piece) -> None:
        self._stirred = self._beat
        self._recent.add((piece.stream, piece.number))
        self._say(piece)

    def _say(self, message: Message) -> None:
        self._send(encode(self.me, message))

    def _send(self, data: bytes) -> None:
        """Send a frame to all who can be reached, if anybody can."""
        audience = BROADCAST if self._piconet is None else self._piconet.audience
        if audience is not None:
            self._counters.frames += 1
            self._counters.payload_bytes += len(data)
            self._outbox.append(Outgoing(audience, data))

    def drain(self) -> list[Outgoing | LinkCommand]:
        """Return what is to be sent, and the link commands, once."""
        outbox = drained(self._outbox)
        return outbox if self._piconet is None else [*self._piconet.drain(), *outbox]

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take news about links, if any are needed."""
        if self._piconet is not None:
            self._piconet.link(event, now)

    # ------------------------------------------------------------ hearing

    def receive(self, data: bytes, reception: Reception, now: Time) -> Told | None:
        """Return what a piece tells that was not known yet; note and answer a summary."""
        try:
            sender, message = decode(data)
            self._check(sender, message)
        except WireError:
            self.bad.append(BadBytes(reception.source, len(data)))
            return None
        if sender == self.me:
            return None
        if self._piconet is not None and self._piconet.relays(sender, reception):
            self._send(data)
        if isinstance(message, Piece):
            return self._learn(message)
        self._note(sender, message, now)
        self._answer(message)
        return None

    def _note(self, sender: Address, message: Summary, now: Time) -> None:
        """Note where the sender is, and what it has."""
        self._stands(sender, (message.x_m, message.y_m), now)
        for stream, count, _ in message.entries:
            if stream != self._stream:  # nobody has more of that
                self._claims.setdefault(stream, {})[sender] = count, self._beat
        if self._piconet is not None and self._here is not None:
            self._piconet.heard(math.dist(self._here, self.places_m[sender]))

    def _stands(self, other: Address, place_m: Point, now: Time) -> None:
        self._places[other] = place_m, now, self._beat
        self.places_m[other] = place_m

    def _check(self, sender: Address, message: Message) -> None:
        """Raise WireError for a message that nobody of this team can have sent."""
        match message:
            case Piece(stream=stream, number=number, runs=runs):
                wrong = stream.author >= self._size or not fits(runs, self._cells)
                wrong |= stream == self._stream and number >= self.ledger.count(stream)
            case Summary(entries=entries):
                wrong = any(entry.stream.author >= self._size for entry in entries)
        if wrong or sender >= self._size:
            raise WireError("of another team")

    def _learn(self, piece: Piece) -> Told | None:
        if not self.ledger.add(piece):
            self._counters.pieces_known += 1
            return None
        self._stirred = self._beat
        self._stamp = max(self._stamp, piece.stamp)
        cells, occupied = from_runs(piece.runs)
        if self._versions is None:
            return Told(cells, occupied, occupied)
        version = self._version(piece.stamp, piece.stream.author)
        newer = self._versions[cells] < version
        self._versions[cells[newer]] = version
        return Told(cells, occupied, newer)

    @staticmethod
    def _version(stamp: int, author: Address) -> int:
        return (stamp << 8 | author) + 1

    def _answer(self, summary: Summary) -> None:
        """Tell what the sender lacks, if it asks this robot; the oldest first."""
        lacking = [
            piece
            for stream, count, source in summary.entries
            if source == self.me
            for piece in self.ledger.beyond(stream, count)
            if (stream, piece.number) not in self._recent
        ]
        for piece in sorted(lacking, key=lambda piece: (piece.stamp, piece.stream, piece.number))[: self._again]:
            self._counters.pieces_again += 1
            self._tell(piece)
