"""Random cases for the DCF, made for its edges, and what the fast model makes of them."""

import random
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from cosim.arrays import Int64s
from cosim.channels.adhoc import tables
from cosim.channels.adhoc.carrier import carrier
from cosim.channels.adhoc.mac import KINDS, Access, Form, Packet, Timing
from cosim.channels.adhoc.state import NONE, OVER, Records, Report
from cosim.channels.adhoc.stations import Log, Rules, Stations, Wanted
from cosim.kernel import WORLD, Kernel
from cosim.machine import BROADCAST, Address
from cosim.randomness import Draws
from cosim.trace import RECEPTIONS, TRANSMISSIONS
from cosim.units import US, Time
from tests.oracles import dcf as oracle

SLOT, SIFS, DIFS, CCA, DELTA = 20 * US, 10 * US, 50 * US, 15 * US, 1 * US
ALL = Wanted(frames=True, intervals=True, transmissions=True, receptions=True)
PREAMBLE = 24 * US
"""A preamble as short as frames here are: long ones would only make cases longer."""


class Case(NamedTuple):
    """What a network is given to do."""

    hears: tuple[tuple[bool, ...], ...]
    arrivals: tuple[oracle.Arrival, ...]
    options: oracle.Options
    windows: tuple[int, int]
    seed: int
    until: Time


class Told(NamedTuple):
    """What comes out of a case: frames with what each station in reach made of them, and fates."""

    frames: list[tuple[Time, Time, Address, Address, str]]
    received: set[tuple[Time, Address, Address]]
    """(begin, source, receiver)"""
    delivered: dict[int, Time]
    done: dict[int, tuple[Time, bool]]
    doings: list[tuple[Time, Address, Time, str, str]]
    """(begin, station, end, state, detail), as in the table of intervals"""
    receptions: list[tuple[Time, Address, Address, str]]
    """(begin, source, receiver, outcome), as in the table"""
    silences: list[tuple[Address, Time, Time, str]]
    """(station, begin, end, what): when its medium was busy, and what its NAV was, until the first frame without end"""


def octets_time(octets: int) -> Time:
    """Return the air time of DATA: whole microseconds."""
    return PREAMBLE + (28 + octets) * US


def octets_form(octets: int) -> Form:
    return Form(octets_time(octets))


def drawn(seed: int) -> Case:
    """Return the case *seed*: lines, stars and others of few stations; frames come at the edges of slots and spaces."""
    chance = random.Random(seed)
    count = chance.randint(2, 5)
    shape = chance.choice(["all", "line", "star", "random"])
    hears = [[False] * count for _ in range(count)]
    for a in range(count):
        for b in range(a):
            near = {"all": True, "line": a - b == 1, "star": b == 0, "random": chance.random() < 0.6}[shape]
            hears[a][b] = hears[b][a] = near
    arrivals = []
    time = 0
    for _ in range(chance.randint(1, 14)):
        gap = chance.choice(
            [0, 0, 1, DIFS // US, SIFS // US, SLOT // US, chance.randint(0, 60), chance.randint(0, 900)]
        )
        time += (gap + chance.choice([0, 0, 0, -1, 1]) if gap else 0) * US
        station = chance.randrange(count)
        others = [other for other in range(count) if other != station]
        destination = chance.choice([BROADCAST, *others, *others])
        arrivals.append(
            oracle.Arrival(max(0, time), station, destination, chance.choice([0, 4, 30, 31, chance.randint(0, 90)]))
        )
    arrivals.sort(key=lambda arrival: arrival.time_ns)
    threshold = chance.choice([None, None, 30, 0])
    bianchi = chance.random() < 0.3
    limits = chance.choice([(7, 4), (2, 2), (None, None), (3, 1)])
    cw_min = chance.choice([0, 1, 3, 7, 31])
    windows = cw_min, chance.choice([cw_min, 2 * cw_min + 1, 63 if cw_min < 63 else cw_min])
    return Case(
        tuple(map(tuple, hears)), tuple(arrivals), oracle.Options(bianchi, threshold, *limits), windows, seed, 8000 * US
    )


def slow(case: Case) -> Told:
    """Return what the oracle makes of *case*."""
    control = PREAMBLE + 14 * US
    timing = oracle.Timing(
        SLOT,
        SIFS,
        DIFS,
        CCA,
        PREAMBLE,
        DELTA,
        *case.windows,
        octets_time,
        octets_time,
        control,
        control,
        control,
        control,
    )
    key = Draws(case.seed, "mac").key
    result = oracle.run(timing, case.hears, case.arrivals, case.options, key, case.until)
    frames = [(f.begin_ns, f.end_ns, f.source, f.destination, f.kind) for f in result.frames]
    received = {(f.begin_ns, f.source, b) for (f, b), what in result.outcomes.items() if what == oracle.RECEIVED}
    delivered = {i: fate.delivered_ns for i, fate in enumerate(result.fates) if fate.delivered_ns is not None}
    done = {i: (fate.done_ns, True) for i, fate in enumerate(result.fates) if fate.done_ns is not None}
    done |= {i: (fate.dropped_ns, False) for i, fate in enumerate(result.fates) if fate.dropped_ns is not None}
    followed = [each for each in result.intervals if each.state not in (oracle.BUSY, oracle.NAV)]
    doings = sorted((i.begin_ns, i.station, i.end_ns, i.state, _backoff(*i.slots)) for i in followed)
    receptions = [
        (f.begin_ns, f.source, b, "received" if what == oracle.RECEIVED else "collided")
        for (f, b), what in result.outcomes.items()
    ]
    receptions += [
        (f.begin_ns, f.source, f.destination, "out_of_range")
        for f in result.frames
        if f.end_ns + DELTA < case.until and f.destination != BROADCAST and not case.hears[f.source][f.destination]
    ]
    until = min([f.begin_ns for f in result.frames if f.end_ns + DELTA >= case.until], default=case.until)
    silences = [
        (i.station, i.begin_ns, min(i.end_ns, until), i.state)
        for i in result.intervals
        if i.state in (oracle.BUSY, oracle.NAV) and i.begin_ns < until
    ]
    return Told(sorted(frames), received, delivered, done, doings, sorted(receptions), sorted(silences))


def _backoff(*slots: int) -> str:
    return "slots={} of={} cw={}".format(*slots) if slots else ""


class Network:
    """The fast model's stations, and what they tell."""

    def __init__(self, case: Case) -> None:
        self.told = Told([], set(), {}, {}, [], [], [])
        self._sent: list[tuple[Any, ...]] = []
        self._heard: list[tuple[Any, ...]] = []
        self._case = case
        self._kernel = Kernel()
        control = Form(PREAMBLE + 14 * US)
        bianchi, threshold, *limits = case.options
        timeout = SIFS + 2 * DELTA + (US if bianchi else SLOT + PREAMBLE)
        eifs = DIFS if bianchi else SIFS + control.duration + DIFS
        timing = Timing(
            SLOT, SIFS, DIFS, eifs, CCA, DELTA, timeout, control, control, control, octets_form, octets_form
        )
        rules = Rules(timing, Access(*case.windows, threshold, *limits, bianchi), None)
        count = len(case.hears)
        self._stations = Stations(count, rules, self._kernel, Draws(case.seed, "mac"), self, ALL)
        for number, (time, station, destination, octets) in enumerate(case.arrivals):
            packet = Packet(destination, bytes(octets), number)
            self._kernel.at(time, partial(self._stations.send, station, packet), WORLD)

    def run(self) -> Told:
        self._kernel.run(self._case.until)
        self._stations.close(self._case.until)
        network, under_way, until = self._stations._network, 0, self._case.until
        for first in ("first_begun", "first_there"):  # frames that have not ended yet
            number = network.common[0][first]
            while number != NONE:
                under_way += 1
                frame = network.frames[number]
                until = min(until, int(frame["begin"]))
                self._add(*(int(frame[name]) for name in ("begin", "source", "destination", "kind")), frame["form"][0])
                number = frame["next"]
        assert network.common[0]["frames_under_way"] == under_way
        assert self._packets_held() == sum(packet["users"] > 0 for packet in network.packets)
        self._look_at_silences(until)
        for rows in self.told:
            if isinstance(rows, list):
                rows.sort()
        return self.told

    def _look_at_silences(self, until: Time) -> None:
        columns = [[field.name for field in table.fields] for table in (TRANSMISSIONS, RECEPTIONS)]
        sent, heard = (
            {name: [row[at] for row in rows] for at, name in enumerate(names)}
            for names, rows in zip(columns, (self._sent, self._heard), strict=True)
        )
        for robot in range(len(self._case.hears)):
            for what, silences in zip((oracle.BUSY, oracle.NAV), carrier(sent, heard, robot, DELTA), strict=True):
                self.told.silences.extend(
                    (robot, begin, min(end, until), what) for begin, end in silences.tolist() if begin < until
                )

    def _packets_held(self) -> int:
        """Return how many packets are not free."""
        network = self._stations._network
        held, number = len(network.packets), network.common[0]["free_packet"]
        while number != NONE:
            held, number = held - 1, network.packets[number]["next"]
        return held

    def write_rows(self, first: Address, last: Address, rows: Records, begin: int) -> Int64s:
        ends, end = np.zeros(len(self._case.hears), np.int64), begin
        for source in range(first, last + 1):
            addresses = [other for other, hears in enumerate(self._case.hears[source]) if hears and other != source]
            begin, end = end, end + len(addresses)
            rows["address"][begin:end], rows["mw"][begin:end] = addresses, 1.0
            ends[source] = end
        return ends

    def noted(self, report: Report, packet: Packet | None) -> None:
        if report.what == OVER:
            self._add(report.begin, report.source, report.destination, report.kind, report.duration)
        elif report.right:
            self.told.received.add((report.begin, report.source, report.station))

    def logged(self, log: Log) -> None:
        starts, stations, ends, *rest = tables.doings(log.intervals)
        self.told.doings.extend(zip(starts.tolist(), stations.tolist(), ends.tolist(), *rest, strict=True))
        self._sent.extend(zip(*tables.transmissions(log.transmissions, log.carried, False), strict=True))
        rows = list(zip(*tables.receptions(log.receptions), strict=True))
        self._heard.extend(rows)
        for time, source, receiver, power_dbm, sinr_db, outcome, part in rows:
            assert (power_dbm, sinr_db, part) == (None, None, "")
            self.told.receptions.append((int(time), int(source), int(receiver), outcome))

    def _add(self, begin: Time, source: Address, destination: Address, kind: int, duration: Time) -> None:
        self.told.frames.append((begin, begin + int(duration), source, destination, KINDS[kind]))

    def received(self, receivers: Sequence[Address], source: Address, packet: Packet, mw: Sequence[float]) -> None:
        assert packet.token is not None
        if packet.destination != BROADCAST:
            self.told.delivered[packet.token] = self._kernel.now

    def done(self, address: Address, packet: Packet, acknowledged: bool) -> None:
        assert packet.token is not None
        self.told.done[packet.token] = self._kernel.now, acknowledged


def fast(case: Case) -> Told:
    """Return what the fast model makes of *case*."""
    return Network(case).run()
