"""A kernel, an air with holes, and devices with chosen or random clocks, for the tests of inquiry and paging."""

from cosim.channels.bluetooth.clock import NativeClock
from cosim.channels.bluetooth.radio import Air, Heard
from cosim.kernel import Kernel
from cosim.units import TICK

CLOCK_RANGE = 1 << 28


class Field:
    """What is sent is recorded in ``frames`` as (frame, outcome); ``outages`` are (source, destination, from, to)."""

    def __init__(self):
        self.kernel = Kernel()
        self.frames = []
        self.outages = []
        self.air = Air(self._reach, lambda frame, heard: self.frames.append((frame, heard)))

    def _reach(self, source, destination, time):
        return not any(
            (source, destination) == (one, other) and start <= time < end for one, other, start, end in self.outages
        )

    def sent(self, kind=None, source=None):
        """(start, kind, source, outcome) of the recorded frames, in order of their starts."""
        return [
            (frame.start, frame.kind, frame.source, heard)
            for frame, heard in sorted(self.frames, key=lambda row: row[0].start)
            if kind in (None, frame.kind) and source in (None, frame.source)
        ]

    def starts(self, kind, source=None, heard=Heard.RECEIVED):
        """Starts of the frames of one kind that had one outcome."""
        return [start for start, _, _, outcome in self.sent(kind, source) if outcome is heard]


def random_clock(rng, ppm=0):
    """Any phase of the 28-bit clock, to the nanosecond, and a drift of up to *ppm* either way."""
    return NativeClock(int(rng.integers(CLOCK_RANGE * TICK)), int(rng.integers(-ppm, ppm + 1)))


def clock_in_block(phase, ticks=1000):
    """A clock that is *ticks* into the block of bits 16-12 = *phase* at time 0."""
    return NativeClock(((phase << 12) + ticks) * TICK)
