"""Whether a robot is caught in a local minimum: the box of its movement in a time has become too small (section 3.5).

Or, beyond the paper, it has learnt nothing for long: drawn to a frontier that it cannot see, a robot may circle.
"""

from collections import deque

from cosim.geometry.planning import Point


class Stalling:
    """The places of the last so many ticks, and for how long there has been no gain."""

    def __init__(self, ticks: int, box_m: float, patience_ticks: float) -> None:
        self._box_m = box_m
        self._patience = patience_ticks
        self._barren = 0
        self._xs: deque[float] = deque(maxlen=ticks)
        self._ys: deque[float] = deque(maxlen=ticks)

    def note(self, place_m: Point, gain: bool) -> None:
        """Note where the robot is at a tick, and whether it has come to know a cell, or on along its path."""
        self._barren = 0 if gain else self._barren + 1
        self._xs.append(place_m[0])
        self._ys.append(place_m[1])

    def begin(self) -> None:
        """Forget all places: something else is tried from now on."""
        self._xs.clear()
        self._ys.clear()
        self._barren = 0

    @property
    def stalled(self) -> bool:
        """Whether the whole time has been noted, and the longer side of the box is shorter than it should be."""
        if self._barren > self._patience:
            return True
        if len(self._xs) < (self._xs.maxlen or 0):
            return False
        return max(max(self._xs) - min(self._xs), max(self._ys) - min(self._ys)) < self._box_m
