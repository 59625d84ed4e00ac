"""A kernel, an air with holes, and devices with chosen or random clocks, for the tests of inquiry and paging."""

import numpy as np

from cosim.channels.bluetooth.radio import Air, Heard
from cosim.channels.clock import NativeClock
from cosim.kernel import Kernel
from cosim.units import TICK

CLOCK_RANGE = 1 << 28


class _HoledAir(Air):
    """Between 16 devices; carriers vanish while there is an outage."""

    def __init__(self, field):
        super().__init__(16, lambda frame, fate: field.frames.append((frame, fate.heard)))
        self._field = field

    def carrier(self, source, receiver):
        heard = self._field.reach(source, receiver, self._field.kernel.now)
        return super().carrier(source, receiver) if heard else float("-inf")

    def _sections(self, frame, receiver, *rest):
        """Have interferers, too, heard or not as they are at the end of the frame."""
        devices = range(16)
        now = self._field.kernel.now
        powers = [
            [0.0 if one != two and self._field.reach(one, two, now) else -np.inf for two in devices] for one in devices
        ]
        self.medium.power_dbm[:] = powers
        return super()._sections(frame, receiver, *rest)


class Field:
    """What is sent is recorded in ``frames`` as (frame, outcome); ``outages`` are (source, destination, from, to)."""

    def __init__(self):
        self.kernel = Kernel()
        self.frames = []
        self.outages = []
        self.air = _HoledAir(self)

    def reach(self, source, destination, time):
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
