"""What a robot counts: frames, bytes and energy by radio, its way; what the metrics are made of."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from cosim.units import Time


@dataclass(slots=True)
class Counters:
    """Counts of one life of a robot. Instants are told by ticks, which all robots have in common: see ``told``."""

    tick: Time
    before: "Counters | None" = None
    """Those of the robot's life before a reboot."""
    frames: int = 0
    payload_bytes: int = 0
    radio_j: float = 0.0
    joins: list[Time] = field(default_factory=list)
    """When a searcher was taken in by another host."""
    contacts: int = 0
    """Times that a searcher came into contact with its host."""
    reported: int = 0
    """Targets that a host has heard of first from a searcher of its own."""
    failures: list[tuple[int, Time]] = field(default_factory=list)
    """(host, when) it was taken for failed."""
    known_at: Time | None = None
    """When a host knew all targets."""
    stopped_at: Time | None = None
    """When a searcher heard that it is over."""
    ways_m: list[float] = field(default_factory=list)
    """The way driven up to each tick."""
    begun: Time = 0
    """When it observed first."""
    last_tick: Time = 0
    """When it observed last: a dead one's death."""
    ahead: Time = 0
    """By how much faults have set the robot's clock forward since it began, as the last tick showed."""

    def spend(self, cost: tuple[float, float], octets: int) -> None:
        """Count the energy of a frame with *octets* of payload."""
        self.radio_j += cost[0] + cost[1] * octets

    def moved(self, way_m: float, now: Time) -> None:
        """Count the way of one tick."""
        if not self.ways_m:
            self.begun = now if self.before is None else self.begun
        self.last_tick = self.begun + len(self.ways_m) * self.tick
        self.ahead = now - self.last_tick
        self.ways_m.append((self.ways_m[-1] if self.ways_m else 0.0) + way_m)

    def follow(self, before: "Counters", now: Time) -> None:
        """Be those of the robot's next life, which begins with the first tick not before *now*, the true time."""
        self.before = before
        self.begun = self.last_tick = -(-now // self.tick) * self.tick

    def lives(self) -> "Iterator[Counters]":
        """Yield these records, and those of the lives before."""
        life: Counters | None = self
        while life is not None:
            yield life
            life = life.before

    def told(self, now: Time) -> Time:
        """Return the instant *now* as a clock tells it that no fault has stepped (right but in the tick of a step)."""
        return now - self.ahead
