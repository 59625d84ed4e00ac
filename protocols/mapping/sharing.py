"""Merging of maps by messages: each robot broadcasts pieces of its map once a period, and again on request.

Once a period a robot sends to all in reach the cells whose state its own sensors have changed, and a summary: how many
pieces of which maps it has, and which robot it asks for more, one of those that have claimed to have more. The robot
that is asked broadcasts them, since others may lack them as well; the others stay silent. So little is sent twice
except what was lost, and pieces travel over any number of robots to those that were never in reach of their author.
Only these counts acknowledge anything. A robot that asks in vain asks another robot the next time.

A piece never changes, so two robots that have the same numbers have the same map, from whichever robots they got it.
Only changes of cells are sent: where hits are certain, no robot reports a cell more than twice, however long a run is.

Where radios need links, each robot sends to those that its role in a piconet lets it reach, and the master relays what
slaves send.
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
from protocols.transport.links import Links
from protocols.transport.parameters import PagingParameters
from protocols.transport.transport import SteadyClock
from protocols.wire import BadBytes

AWAY_PERIODS: Final = 3
"""Periods of silence after which a robot counts as out of reach."""
QUIET_PERIODS: Final = 5
"""Periods without anything new, sent or received, after which all has been sent."""
NEAR_SHARE: Final = 0.5
"""Share of the greatest distance of a robot that was heard, within which robots are likely to be in reach."""
_NEWEST: Final = np.iinfo(np.int64).max


@dataclass(slots=True)
class SharingCounters:
    """What one robot counts as it shares its map."""

    frames: int = 0
    payload_bytes: int = 0
    pieces_again: int = 0
    """Pieces of maps that it has sent on request; they had been sent before."""
    pieces_known: int = 0
    """Pieces that it has received and had already."""


class SharingParameters(Settings):
    """How maps are merged by messages."""

    period_s: Period = Field(default=1.0, gt=0, description="s, from one sending to the next")
    octets: int = Field(default=200, ge=21, le=65535, description="bytes, the longest frame")
    again: Count = Field(default=4, ge=1, description="pieces that are sent again in answer to one summary")
    links: PagingParameters | None = Field(
        default=None, description="send over the links of a piconet: what Bluetooth needs; by default to all in reach"
    )


class Update(NamedTuple):
    """Another robot's states of some cells, each array (n,)."""

    cells: Int32s
    occupied: Bools
    newer: Bools
    """True where that counts for more than what the robot has known of the cell."""


class Ledger:
    """The pieces of all robots' maps that one robot has, by stream and number."""

    def __init__(self) -> None:
        self._pieces: dict[Stream, dict[int, Piece]] = {}
        self.counts: dict[Stream, int] = {}
        """Pieces of each stream that are known from the first on without a gap."""

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
        """Return the number of pieces of *stream* that are known from the first on without a gap."""
        return self.counts.get(stream, 0)

    def beyond(self, stream: Stream, count: int) -> list[Piece]:
        """Return the pieces of *stream* that a robot with the first *count* of them lacks, in order."""
        return [self._pieces[stream][number] for number in range(count, self.count(stream))]


class Sharing:
    """One robot's part in the merging.

    All robots that have the same pieces, and have sent what they have seen, have the same map, in whatever order the
    pieces came. Where hits are certain, a cell is occupied if any robot has seen that. Where they are not, the latest
    report counts: stamps are milliseconds of the sender's clock, but greater than those of all that it had received, so
    that a robot that contradicts what it has received is right.
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
        """Reports of bad bytes, for the owner to drain."""
        self._size = size
        self._cells = cells
        self._period = from_seconds(parameters.period_s)
        self._runs = (parameters.octets - PIECE_OVERHEAD) // RUN_BYTES
        self._entries = (parameters.octets - SUMMARY_OVERHEAD) // ENTRY_BYTES
        self._again = parameters.again
        self._counters = counters
        self._versions: np.ndarray[Any, np.dtype[np.int64]] | None = None if certain else np.zeros(cells, np.int64)
        """Stamp and author of what is known of each cell; greatest for what is still to be sent."""
        self._stream = Stream(me, start // MS % STAMPS)
        self._stamp = 0
        """The greatest stamp that was sent or received."""
        self._unsent: dict[int, bool] = {}
        """Cells that have changed since the last piece, and whether they are occupied."""
        self._last = start - self._period + self._period * me // size
        """When it sent last."""
        self._beat = 0
        """Number of periods so far. Periods are counted, since clocks may be set."""
        self._stirred = 0
        """Period in which anything new was sent or received last."""
        self._recent: set[tuple[Stream, int]] = set()
        """Pieces that were sent in this period: a robot that seems to lack them may not have got them yet."""
        self._claims: dict[Stream, dict[Address, tuple[int, int]]] = {}
        """Pieces that others have claimed to have, and the period of the claim."""
        self._places: dict[Address, tuple[Point, Time, int]] = {}
        """Where the others have reported to be, or were seen; when, and in which period."""
        self.places_m: dict[Address, Point] = {}
        """Where the others were when they were heard or seen last."""
        self._here: Point | None = None
        self._reach_m = 0.0
        """The greatest distance of a robot that was heard."""
        self._clock = SteadyClock(start)
        self._links: Links | None = None
        if parameters.links is not None:
            self._links = Links.of_star(me, size, parameters.links, start)
        self._outbox: list[Outgoing | LinkCommand] = []

    def places(self, now: Time) -> list[tuple[Address, Point, float]]:
        """Return where others were, and how many seconds ago: those that were heard or seen recently."""
        return [
            (other, place, max(to_seconds(now - at), 0.0))
            for other, (place, at, beat) in self._places.items()
            if self._recently(beat)
        ]

    @property
    def silent(self) -> bool:
        """True if all that is known has been sent, and no robot has asked for more for a while."""
        return not self._unsent and self._beat - self._stirred >= QUIET_PERIODS

    def _recently(self, beat: int) -> bool:
        return self._beat - beat <= AWAY_PERIODS

    # ------------------------------------------------------------ sending

    def changed(self, cells: Int32s, occupied: Collection[bool]) -> None:
        """Note cells whose state the robot's own sensors have changed."""
        self._unsent.update(zip(cells.tolist(), occupied, strict=True))
        if self._versions is not None:
            self._versions[cells] = _NEWEST

    def tick(self, x_m: float, y_m: float, now: Time, sightings: Collection[Sighting] = ()) -> None:
        """Send what is new, and a summary of what is known, if it is time; *sightings*: robots in sight, on the map."""
        self._here = x_m, y_m
        for other, at_x, at_y in sightings:
            self._note_place(other, (at_x, at_y), now)
        if self._links is not None:
            self._links.tick({other for other, _, _ in sightings} | self._near(self._here), self._clock.read(now))
        if 0 <= now - self._last < self._period:
            return
        self._last = now
        self._beat += 1
        self._recent.clear()
        for piece in self._pieces(now):
            self.ledger.add(piece)
            self._send_piece(piece)
        entries = list(self._known())
        for at in range(0, max(len(entries), 1), self._entries):
            self._send(encode(self.me, Summary(x_m, y_m, tuple(entries[at : at + self._entries]))))

    def _near(self, here: Point) -> set[Address]:
        """Return the robots that were last where they are likely to be in reach."""
        near_m = NEAR_SHARE * self._reach_m
        return {other for other, place in self.places_m.items() if math.dist(here, place) <= near_m}

    def _pieces(self, now: Time) -> Iterator[Piece]:
        """Yield the unsent changes in as many pieces as it takes."""
        if not self._unsent:
            return
        cells = np.array(list(self._unsent), np.int32)
        words = to_runs(cells, list(self._unsent.values()))
        self._unsent.clear()
        self._stamp = min(max(now // MS, self._stamp + 1), STAMPS - 1)
        if self._versions is not None:
            self._versions[cells] = self._version(self._stamp, self.me)
        for at in range(0, len(words), self._runs):
            if self.ledger.count(self._stream) == MOST_PIECES:
                self._stream = Stream(self.me, max(self._stamp, self._stream.incarnation + 1) % STAMPS)
            yield Piece(self._stream, self.ledger.count(self._stream), self._stamp, words[at : at + self._runs])

    def _known(self) -> Iterator[Entry]:
        """Yield what is known of each stream, and whom to ask for more: in turn those that recently had more."""
        for stream in sorted(self.ledger.counts.keys() | self._claims.keys()):
            ours, claims = self.ledger.count(stream), self._claims.get(stream, {})
            having = sorted(other for other, (count, beat) in claims.items() if count > ours and self._recently(beat))
            if ours or having:
                yield Entry(stream, ours, self._whom(having))

    def _whom(self, having: list[Address]) -> Address:
        """Return which robot of those *having* more to ask: each in turn, but a master rather than its slaves."""
        if not having:
            return self.me
        master = None if self._links is None else self._links.master
        if master is not None and master in having:
            return master
        return having[self._beat % len(having)]

    def _send_piece(self, piece: Piece) -> None:
        self._stirred = self._beat
        self._recent.add((piece.stream, piece.number))
        self._send(encode(self.me, piece))

    def _send(self, data: bytes) -> None:
        """Send a frame to all robots that can be reached, if any can."""
        audience = BROADCAST if self._links is None else self._links.audience
        if audience is not None:
            self._counters.frames += 1
            self._counters.payload_bytes += len(data)
            self._outbox.append(Outgoing(audience, data))

    def drain(self) -> list[Outgoing | LinkCommand]:
        """Drain what is to be sent; link commands come first."""
        outbox = drained(self._outbox)
        return outbox if self._links is None else [*self._links.drain(), *outbox]

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take news about links, if any are needed."""
        if self._links is not None:
            self._links.link(event, self._clock.read(now))

    # ------------------------------------------------------------ receiving

    def receive(self, data: bytes, reception: Reception, now: Time) -> Update | None:
        """Return what was not known yet of a piece; note and answer a summary."""
        try:
            sender, message = decode(data)
            self._check(sender, message)
        except WireError:
            self.bad.append(BadBytes(reception.source, len(data)))
            return None
        if sender == self.me:
            return None
        if self._links is not None and self._links.relays(sender, reception):
            self._send(data)
        if isinstance(message, Piece):
            return self._learn(message)
        self._note(sender, message, now)
        self._answer(message)
        return None

    def _note(self, sender: Address, message: Summary, now: Time) -> None:
        """Note where the sender is, and what it has."""
        self._note_place(sender, (message.x_m, message.y_m), now)
        for stream, count, _ in message.entries:
            if stream != self._stream:  # no robot has more of that
                self._claims.setdefault(stream, {})[sender] = count, self._beat
        if self._here is not None:
            self._reach_m = max(self._reach_m, math.dist(self._here, self.places_m[sender]))

    def _note_place(self, other: Address, place_m: Point, now: Time) -> None:
        self._places[other] = place_m, now, self._beat
        self.places_m[other] = place_m

    def _check(self, sender: Address, message: Message) -> None:
        """Raise WireError for a message that no robot of this team can have sent."""
        match message:
            case Piece(stream=stream, number=number, runs=runs):
                wrong = stream.author >= self._size or not fits(runs, self._cells)
                wrong |= stream == self._stream and number >= self.ledger.count(stream)
            case Summary(entries=entries):
                wrong = any(entry.stream.author >= self._size for entry in entries)
        if wrong or sender >= self._size:
            raise WireError("of another team")

    def _learn(self, piece: Piece) -> Update | None:
        if not self.ledger.add(piece):
            self._counters.pieces_known += 1
            return None
        self._stirred = self._beat
        self._stamp = max(self._stamp, piece.stamp)
        cells, occupied = from_runs(piece.runs)
        if self._versions is None:
            return Update(cells, occupied, occupied)
        version = self._version(piece.stamp, piece.stream.author)
        newer = self._versions[cells] < version
        self._versions[cells[newer]] = version
        return Update(cells, occupied, newer)

    @staticmethod
    def _version(stamp: int, author: Address) -> int:
        return (stamp << 8 | author) + 1

    def _answer(self, summary: Summary) -> None:
        """Send what the sender lacks, if it asks this robot; the oldest first."""
        lacking = [
            piece
            for stream, count, source in summary.entries
            if source == self.me
            for piece in self.ledger.beyond(stream, count)
            if (stream, piece.number) not in self._recent
        ]
        for piece in sorted(lacking, key=lambda piece: (piece.stamp, piece.stream, piece.number))[: self._again]:
            self._counters.pieces_again += 1
            self._send_piece(piece)
