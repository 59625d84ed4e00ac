"""Interference: how long robots are below their free speed because of another robot, in robot-seconds.

Paper 004, section 5, augments its strategies "to reduce interference" and prints no measure of it. Ours compares, tick
by tick, the speed v that a robot's order leads to with the speed u that it would have had no other robot been there
since it set off: its *double* (:mod:`protocols.deployment.driving.double`) is at the same place at every tick, looks at
the same walls, has the same goal and the same limits of its drive, but sees no bodies, and has the speed and the
heading that it has itself come to, not the robot's. So what a robot that was stopped needs to get up to speed again
counts too, and a corner, a narrow door or the end of the way counts nothing. A robot that nobody has ever hindered goes
as its double does: its shortfall is 0. What a detour round another robot is longer counts nothing either: it is driven
freely.

Two readings of "robot-seconds below the free speed" are kept:

* *lost* time, sum of (1 - v / u) dt: on a given way the time that it took, less the time that it would have taken, for
  the sum of v / u dt is the sum of ds / u; who stands loses all of a second, who goes at half the free speed a half;
* *hindered* time, sum of dt where v is below u by more than ``SLIGHT`` of it: the words as they stand.

A robot that goes back, or aside to make way, gets no nearer to its goal: it counts as standing (v <= 0). One that does
not want to move (it has arrived, or waits for its turn as it was told to) has no free speed: that is no interference.
"""

from typing import Final

from cosim.units import Time, to_seconds

SLIGHT: Final = 0.05
"""A speed that is less than this share below the free one counts as free where seconds are counted whole."""
STILL_MPS: Final = 1e-6
"""A double that is as slow as this wants to stand, or to turn on the spot: nobody can hinder it."""


def shortfall(speed_mps: float, free_mps: float) -> float:
    """Return which share of its free speed a robot lacks, 0 to 1; 0 if it could not go anyway."""
    if free_mps <= STILL_MPS:
        return 0.0
    return min(max(1.0 - max(speed_mps, 0.0) / free_mps, 0.0), 1.0)


class Shortfall:
    """What one robot has lost to others so far, of ticks that are *tick* ns long."""

    def __init__(self, tick: Time) -> None:
        self._tick_s = to_seconds(tick)
        self._lost = 0.0
        self._hindered = 0
        self._ticks = 0

    def note(self, speed_mps: float, free_mps: float) -> None:
        """Count a tick of a robot under way, that goes *speed_mps* towards its goal, its double *free_mps*."""
        lacking = shortfall(speed_mps, free_mps)
        self._ticks += 1
        self._lost += lacking
        self._hindered += lacking > SLIGHT

    @property
    def lost_s(self) -> float:
        """Seconds that it lost."""
        return self._lost * self._tick_s

    @property
    def hindered_s(self) -> float:
        """Seconds in which it was slower than it would have been."""
        return self._hindered * self._tick_s

    @property
    def under_way_s(self) -> float:
        """Seconds in which it was under way at all."""
        return self._ticks * self._tick_s
