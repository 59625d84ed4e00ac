"""How robots that have a map each get to know each other's: pieces of it, told once a period, and again on demand.

Once a period a robot tells all in reach the cells that it has come to know by its own sensors, and how many pieces of
whose maps it has. Who hears that it lacks some, tells it: its own pieces always, those of others only if their author
has not been heard for a while, so that not all tell the same. Nothing is acknowledged but by these counts.
"""

from collections.abc import Collection
from typing import Final

import numpy as np

from cosim.errors import WireError
from cosim.geometry.planning import Point
from cosim.machine import BROADCAST, Address, Event, LinkCommand, Outgoing, Reception
from cosim.units import Time, to_seconds
from protocols.exploration.frames import MOST_PIECES, PIECE_OVERHEAD, Message, Piece, Summary, decode, encode
from protocols.exploration.journal import BadBytes
from protocols.exploration.ledger import Ledger
from protocols.exploration.records import Records
from protocols.exploration.runs import Ints, fits, to_runs

AWAY_PERIODS: Final = 3
"""Who has not been heard for so many periods is taken to be out of the reach of whom we hear."""


class Sharing:
    """One robot's part in it."""

    def __init__(
        self, me: Address, size: int, cells: int, period: Time, octets: int, most: int, records: Records, start: Time
    ) -> None:
        """Tell maps of so many *cells* each *period*, in frames of at most so many *octets*, *most* again at a time.

        Who starts late has booted again: it has lost its own pieces, and gets them back before it makes new ones.
        """
        self.me = me
        self.ledger = Ledger(size)
        self.bad: list[Event] = []
        self._cells = cells
        self._period = period
        self._runs = (octets - PIECE_OVERHEAD) // 4
        self._most = most
        self._records = records
        self._news: dict[int, bool] = {}
        """Cells that have changed since the last piece, and whether they are occupied."""
        self._next = start
        self._heard: list[Time] = [start] * size
        self._numbered = start == 0
        """Whether the number of the next own piece is known."""
        self._places: dict[Address, tuple[Point, Time]] = {}
        """Where the others have said that they were, and when."""
        self._outbox: list[Outgoing | LinkCommand] = []

    def places(self, now: Time) -> list[tuple[Address, Point, float]]:
        """Return who has said where it was, and how many seconds ago; those who have been heard lately."""
        recent = now - AWAY_PERIODS * self._period
        return [(other, place, to_seconds(now - at)) for other, (place, at) in self._places.items() if at >= recent]

    @property
    def silent(self) -> bool:
        """Whether all that is known has been told once."""
        return not self._news

    def changed(self, cells: Ints, occupied: Collection[bool]) -> None:
        """Note cells that the robot's own sensors have changed."""
        self._news.update(zip(cells.tolist(), occupied, strict=True))

    def tick(self, x_m: float, y_m: float, now: Time) -> None:
        """Tell what is new, if it is time."""
        if now < self._next:
            return
        self._next = now + self._period
        for piece in self._pieces() if self._numbered else ():
            self.ledger.add(piece)
            self._say(piece)
        self._say(Summary(x_m, y_m, tuple(self.ledger.counts)))

    def _pieces(self) -> list[Piece]:
        """Return the news in as many pieces as it takes; what no number is left for is never told."""
        words = to_runs(np.array(list(self._news), np.int32), list(self._news.values()))
        self._news.clear()
        first = self.ledger.counts[self.me]
        parts = range(0, len(words), self._runs)
        return [
            Piece(self.me, first + nth, words[at : at + self._runs])
            for nth, at in enumerate(parts)
            if first + nth < MOST_PIECES
        ]

    def receive(self, data: bytes, reception: Reception, now: Time) -> Piece | Summary | None:
        """Return a piece that was not known yet, or a summary, which is answered; None for all else."""
        try:
            sender, message = decode(data)
            self._check(sender, message)
        except WireError:
            self.bad.append(BadBytes(reception.source, len(data)))
            return None
        if sender == self.me:
            return None
        self._heard[sender] = now
        if isinstance(message, Summary):
            self._places[sender] = (message.x_m, message.y_m), now
            self._numbered = self._numbered or message.pieces[self.me] <= self.ledger.counts[self.me]
            self._answer(sender, message, now)
            return message
        return message if self.ledger.add(message) else None

    def _check(self, sender: Address, message: Message) -> None:
        """Raise WireError for a message that nobody of this team can have sent."""
        size = len(self.ledger.counts)
        match message:
            case Piece(author=author, runs=runs):
                wrong = author >= size or not fits(runs, self._cells)
            case Summary(pieces=pieces):
                wrong = len(pieces) != size
        if wrong or sender >= size:
            raise WireError("of another team")

    def _answer(self, sender: Address, summary: Summary, now: Time) -> None:
        """Tell who has spoken what it lacks, as far as nobody else will."""
        away = now - AWAY_PERIODS * self._period
        counts = list(summary.pieces)
        for author, ours in enumerate(self.ledger.counts):
            near = author != self.me and self._heard[author] > away
            if author == sender or near:
                counts[author] = ours
        for piece in self.ledger.lacking(counts, self._most):
            self._say(piece, sender)

    def _say(self, message: Message, destination: Address = BROADCAST) -> None:
        data = encode(self.me, message)
        self._records.frames += 1
        self._records.payload_bytes += len(data)
        self._outbox.append(Outgoing(destination, data))

    def drain(self) -> list[Outgoing | LinkCommand]:
        """Return what is to be sent, once."""
        outbox, self._outbox = self._outbox, []
        return outbox
