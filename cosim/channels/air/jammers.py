"""What a jammer sends in a band: a box of 1 MHz on each channel that it is on, for as long as it is on it."""

from collections.abc import Iterator

from cosim.channels.air.band import Emission
from cosim.channels.air.spectra import JAMMER, STEPS_PER_MHZ
from cosim.channels.jamming import CONSTANT, PULSED, Jammer
from cosim.units import Time

LOWEST_MHZ = 2402
"""Centre of channel 0."""


def emissions(jammer: Jammer, sender: int, tenant: int, sent_mw: float, since: Time, until: Time) -> Iterator[Emission]:
    """Yield what the *jammer*, which is *sender* in its tenant, sends in [since, until), cut to that time."""
    for start, end, channels in _turns(jammer, max(since, jammer.start), min(until, jammer.end)):
        for channel in channels:
            centre = STEPS_PER_MHZ * (LOWEST_MHZ + channel)
            yield Emission(start, end, JAMMER, centre, sender, tenant, sent_mw)


def _turns(jammer: Jammer, since: Time, until: Time) -> Iterator[tuple[Time, Time, tuple[int, ...]]]:
    """Yield (start, end, channels that it is on) within [since, until), without those that are empty."""
    if since >= until:
        return
    if jammer.mode == CONSTANT:
        yield since, until, jammer.channels
        return
    step = jammer.period if jammer.mode == PULSED else jammer.dwell
    lasts = jammer.on if jammer.mode == PULSED else jammer.dwell
    for number in range((since - jammer.start) // step, (until - 1 - jammer.start) // step + 1):
        begin = jammer.start + number * step
        start, end = max(since, begin), min(until, begin + lasts)
        if start < end:
            swept = jammer.channels[number % len(jammer.channels)]
            yield start, end, jammer.channels if jammer.mode == PULSED else (swept,)
