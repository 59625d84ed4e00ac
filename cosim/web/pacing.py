"""The simulated time that belongs to an instant of the wall clock: play, pause, change of speed, jump.

The wall clock is an argument, in seconds of any origin, so that a test can be its own clock.
"""

from cosim.units import S, Time

SLOWEST, FASTEST = 0.01, 1000.0
"""Minimum and maximum speed, in simulated seconds a second."""


class Pace:
    """Simulated time as a function of the wall clock: constant while paused, else a line of slope ``speed``."""

    def __init__(self, speed: float = 1.0, playing: bool = True, wall_s: float = 0.0) -> None:
        self.speed = speed
        self.playing = playing
        self._from: Time = 0
        self._since_s = wall_s

    def due(self, wall_s: float) -> Time:
        """Return the simulated time that belongs to *wall_s*."""
        if not self.playing:
            return self._from
        return self._from + round(max(0.0, wall_s - self._since_s) * self.speed * S)

    def play(self, wall_s: float) -> None:
        """Let time go on from where it is."""
        if not self.playing:
            self._since_s = wall_s
            self.playing = True

    def pause(self, wall_s: float) -> None:
        """Keep time where it is."""
        self.jump(self.due(wall_s), wall_s)
        self.playing = False

    def change(self, speed: float, wall_s: float) -> None:
        """Let time go on with another *speed*, from where it is."""
        self.jump(self.due(wall_s), wall_s)
        self.speed = speed

    def jump(self, time: Time, wall_s: float) -> None:
        """Set the simulated time at *wall_s* to *time*: on request, or where the simulation lags behind."""
        self._from = time
        self._since_s = wall_s
