"""How a device of the oracle of the whole band hands to its host what it has received: one payload after the other."""

from dataclasses import dataclass, field

REFUSED = "refused"
"""Outcome of a frame that arrived whole, with a payload for which there is no place."""


@dataclass
class Transport:
    """From a device to its host at *bps* bit/s, with places for *room* payloads of each peer; None: at once."""

    bps: int | None
    room: int
    over: int = 0
    """When all that was received so far is delivered."""
    places: list[tuple[int, int]] = field(default_factory=list)
    """(peer, when its place is free again), of every payload to be acknowledged that was ever received."""

    def has_place(self, peer: int, now: int) -> bool:
        taken = [until for whose, until in self.places if whose == peer and until > now]
        return self.bps is None or len(taken) < self.room

    def take(self, length: int, peer: int | None, now: int) -> int:
        """Take *length* bytes received now; return when the host has them.

        They take a place of *peer*, or none if that is None: a broadcast.
        """
        if self.bps is None:
            return now
        bits = 8 * length * 1_000_000_000
        self.over = max(now, self.over) + max(1, -(-bits // self.bps))
        if peer is not None:
            self.places.append((peer, self.over))
        return self.over
