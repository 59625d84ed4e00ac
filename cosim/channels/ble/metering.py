"""What the radio of an LE device does, ns by ns, for the energy that it takes.

It transmits while a packet of it is on the air; while there are two, as a link that rests polls although its end sends
to everyone, that time counts once. It receives

- while a packet that it waits for is on the air, whether it makes anything of it or not,
- for T_IFS and as long as preamble and access address take after a packet of it that may be answered: an ADV_IND, the
  packets of a central, and those of a peripheral while either end has more to say (NimBLE waits 2 us longer, see
  ``ble_phy_wfr_enable``),
- for T_IFS before it sends an answer, when its receiver becomes a transmitter,
- as a peripheral, from when it expects the first packet of an event at the earliest, until that comes or is too late.

Else it is idle, which is listening on LE 1M, in its windows, and asleep outside of them.

Nothing is done for an advertisement, nor for the events of a link that rests: these follow from arithmetic. So whoever
is about to change what the radio does has the meter settled before: in between, all is known.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

from cosim.channels.ble.antenna import Doing
from cosim.channels.ble.phy import LE_1M, T_IFS
from cosim.channels.ble.station import Station
from cosim.channels.energy import IDLE, OFF, RECEIVE, SLEEP, TRANSMIT, Use, Uses
from cosim.units import S, Time

_AT_ONCE: Final[Time] = S
"""Longest time that is settled at once."""


class Meter:
    """The meter of the device *station*, from the beginning of the run on."""

    def __init__(self, station: Station) -> None:
        self._station = station
        self._on = True
        self._settled: Time = 0
        self._doing: list[Doing] = []
        """What is known, and not settled."""
        self._times: dict[Use, Time] = {}

    def note(self, doing: Doing) -> None:
        """Note what the radio will do, from now on or later."""
        if self._on:
            self._doing.append(doing)

    def switch(self, now: Time, on: bool) -> None:
        """Note that the device is on, or off, from *now* on."""
        self.settle(now)
        self._on, self._doing = on, []

    def uses(self, now: Time) -> Uses:
        """Return how long the radio has done what up to *now*."""
        self.settle(now)
        return self._times

    def settle(self, now: Time) -> None:
        """Account for all times before *now*: what the radio does may be something else from then on."""
        while self._settled < now:
            since, self._settled = self._settled, min(now, self._settled + _AT_ONCE)
            if not self._on:
                self._add(Use(OFF), self._settled - since)
                continue
            doing = [*self._doing, *self._arithmetic(since, self._settled)]
            self._sweep(doing, since, self._settled)
            self._doing = [each for each in doing if each.end > self._settled]

    def _arithmetic(self, since: Time, until: Time) -> Iterator[Doing]:
        """Yield what the radio does from some time in [since, until) on, and nobody has noted."""
        station = self._station
        for packet in station.beacon.packets(since, until):
            yield Doing(packet.start, packet.end, Use(TRANSMIT, LE_1M.name))
            yield Doing(packet.end, packet.end + T_IFS + LE_1M.lead, Use(RECEIVE, LE_1M.name))
        for claim in station.antenna.claims:
            yield from claim.doing(station.address, since, until)

    def _sweep(self, doing: list[Doing], since: Time, until: Time) -> None:
        """Account for [since, until), in which the radio is *doing* that: sending goes first, and windows last."""
        order = sorted(each for each in doing if each.end > since and each.start < until)
        marks = {min(max(time, since), until) for each in order for time in each[:2]}
        active: list[Doing] = []
        at = 0
        for begin, end in pairwise(sorted({since, until} | marks)):
            while at < len(order) and order[at].start <= begin:
                active.append(order[at])
                at += 1
            active = [each for each in active if each.end > begin]
            if active:
                self._add(max(active, key=_rank).use, end - begin)
            else:
                listened = self._station.windows.open_time(begin, end)
                self._add(Use(IDLE, LE_1M.name), listened)
                self._add(Use(SLEEP), end - begin - listened)

    def _add(self, use: Use, time: Time) -> None:
        if time:
            self._times[use] = self._times.get(use, 0) + time


def _rank(doing: Doing) -> tuple[bool, Doing]:
    return doing.use.state == TRANSMIT, doing
