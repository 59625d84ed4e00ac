"""What a robot counts for the metrics: frames, bytes and energy of its radios, and its way."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

from cosim.geometry.planning import Point
from cosim.units import Time


@dataclass(slots=True)
class Counters:
    """Counts of one incarnation of a robot.

    Instants are counted by ticks, which all robots have in common: see ``true_time``.
    """

    tick: Time
    before: "Counters | None" = None
    """Counters of the robot's incarnation before its last reboot."""
    frames: int = 0
    payload_bytes: int = 0
    radio_j: float = 0.0
    joins: list[Time] = field(default_factory=list)
    """Instants at which a searcher was taken in by another host."""
    contacts: int = 0
    """Number of times that a searcher came into contact with its host."""
    reported: int = 0
    """Number of targets that a host learned first from a searcher of its own."""
    failures: list[tuple[int, Time]] = field(default_factory=list)
    """(host, instant) of each suspicion."""
    known_at: Time | None = None
    """Instant from which on a host knew all targets."""
    stopped_at: Time | None = None
    """Instant at which a searcher received that the task is over."""
    ways_m: list[float] = field(default_factory=list)
    """Distance driven up to each tick, by odometry."""
    place_m: Point | None = None
    """Where the robot was at its last observation, in its own frame."""
    begun: Time = 0
    """Instant of its first observation."""
    last_tick: Time = 0
    """Instant of its last observation: the death of a robot that has died."""
    ahead: Time = 0
    """Time by which faults have set the robot's clock forward since it began, as of the last tick."""

    def moved(self, place_m: Point, now: Time) -> None:
        """Count the way of one tick, to where the robot is in its own frame."""
        ways_m, before = self.ways_m, self.place_m
        way_m = 0.0 if before is None else math.dist(place_m, before)
        self.place_m = place_m
        if ways_m:
            self.last_tick += self.tick
            way_m += ways_m[-1]
        else:
            self.last_tick = self.begun = now if self.before is None else self.begun
        self.ahead = now - self.last_tick
        ways_m.append(way_m)

    def follow(self, before: "Counters", now: Time) -> None:
        """Continue *before* in the next incarnation, from the first tick on that is not before the true time *now*."""
        self.before = before
        self.begun = self.last_tick = -(-now // self.tick) * self.tick

    def incarnations(self) -> "Iterator[Counters]":
        """Yield these counters and those of all incarnations before."""
        incarnation: Counters | None = self
        while incarnation is not None:
            yield incarnation
            incarnation = incarnation.before

    def true_time(self, now: Time) -> Time:
        """Return *now* as a clock without faults shows it; wrong only in the tick in which a fault steps the clock."""
        return now - self.ahead
