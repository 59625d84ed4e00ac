"""The clock of recorded runs: simulated time, played at any speed from any time until the longest has ended."""

import time
from collections.abc import Callable

from cosim.errors import UserError
from cosim.units import Time, from_seconds
from cosim.web.messages import Again, Operate, Pause, Play, Seek, Speed, Step, Wish
from cosim.web.pacing import Pace


class Clock:
    """Simulated time by a wall clock, from 0 to *end*; several runs may go by one."""

    def __init__(self, end: Time, wall: Callable[[], float] = time.monotonic, playing: bool = True) -> None:
        self.end = end
        self.jumps = 0
        """Number of times that time has jumped."""
        self._wall = wall
        self._pace = Pace(playing=playing, wall_s=wall())

    @property
    def now(self) -> Time:
        """The present time; at the end it stands still."""
        wall_s = self._wall()
        now = self._pace.due(wall_s)
        if now < self.end:
            return now
        self._pace.jump(self.end, wall_s)
        self._pace.pause(wall_s)
        return self.end

    @property
    def speed(self) -> float:
        """Simulated seconds a second."""
        return self._pace.speed

    @property
    def state(self) -> str:
        """It is playing, paused or ended."""
        return "ended" if self.now >= self.end else "playing" if self._pace.playing else "paused"

    def wish(self, wish: Wish) -> None:
        """Do what a page asks for, steps excepted; raise UserError, one line, if it cannot be done."""
        wall_s = self._wall()
        match wish:
            case Play():
                if self.now >= self.end:
                    self.jump(0)
                self._pace.play(wall_s)
            case Pause():
                self._pace.pause(wall_s)
            case Speed(speed=speed):
                self._pace.change(speed, wall_s)
            case Seek(time_s=seconds):
                self.jump(from_seconds(seconds))
            case Again():
                raise UserError("this run is a recorded one: go back to its beginning instead")
            case Operate():
                raise UserError("this run is a recorded one: nobody hears its operator")
            case Step():
                raise ValueError("a clock knows no steps: they are those of a run")

    def jump(self, to: Time, fresh: bool = True) -> None:
        """Go *to* a time, or the end before it; *fresh*: a page is to forget what it was sent before."""
        self._pace.jump(min(max(to, 0), self.end), self._wall())
        self.jumps += fresh

    def step(self, to: Time, back: bool) -> None:
        """Pause, and go *to* a time, which is reached by steps *back*, or on."""
        self._pace.pause(self._wall())
        self.jump(to, fresh=back)
