"""Progress: whether what is left of a way keeps falling, and for how long it has not.

Times are whatever the caller counts, in nanoseconds or in ticks.
"""

import math


class Progress:
    """The least distance so far, and when it last fell by enough to count."""

    def __init__(self, nearer_m: float, now: int = 0) -> None:
        """Count a decrease by more than *nearer_m* as progress, from *now* on."""
        self.nearer_m = nearer_m
        self.least_m = math.inf
        self.since = now
        """When there was progress last."""

    def begin(self, now: int, left_m: float = math.inf) -> None:
        """Begin again at *now*, with so much left."""
        self.least_m, self.since = left_m, now

    def look(self, left_m: float, now: int) -> bool:
        """Take what is left at *now*; return whether that is progress."""
        if left_m < self.least_m - self.nearer_m:
            self.least_m, self.since = left_m, now
            return True
        return False

    def held(self, now: int) -> int:
        """Return for how long there has been no progress."""
        return now - self.since
