"""The band against a model that looks at every microsecond of it: two and three technologies at once."""

import heapq
from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest

from cosim.channels.air import band as bands
from cosim.channels.air.band import Band, Emission
from cosim.channels.air.emissions import Tuning, Wanted
from cosim.channels.air.spectra import CLASSIC, DSSS, JAMMER, LE_1M, LE_2M, OFDM, OFFSETS, shares
from cosim.units import US, Time
from tests.oracles.shared_band import NEGLECTED_MW, Ear, Exchanges, Plan, Signal, World, hears, sent
from tests.tiers import soak_count

SYSTEMS = ((DSSS, OFDM), (CLASSIC,), (LE_1M, LE_2M))
"""The kinds that each channel sends and receives; a channel's jammers are of the last one."""
ISOLATION_DB = 20.0
LENGTHS = (1, 2, 80, 126, 366)


def table(sender: int, receiver: int, offset: int) -> float:
    return float(shares()[sender, receiver, offset]) if offset < OFFSETS else 0.0


def gains_db(random: np.random.Generator, size: int) -> list[list[float]]:
    gains = random.integers(-110, -30, (size, size)).astype(float)
    return (np.tril(gains) + np.tril(gains, -1).T).tolist()


def ratios(gains: Sequence[Sequence[float]]) -> list[list[float]]:
    return [
        [10 ** (-(ISOLATION_DB if i == j else -db) / 10) for j, db in enumerate(row)] for i, row in enumerate(gains)
    ]


class Question(NamedTuple):
    at: int
    ear: Ear
    begin: int
    end: int


class Case(NamedTuple):
    size: int
    signals: list[Signal]
    moves: list[tuple[int, list[list[float]]]]
    questions: list[Question]


def near(random: np.random.Generator, signal: Signal) -> int:
    """Return a centre at, or about, that of a signal or the border of what is heard of it."""
    widths = (0, 1, 2, 3, 20, 21, 22, 23, 24, 44, 45, OFFSETS - 1, OFFSETS)
    return signal.centre + int(random.choice((-1, 1))) * int(random.choice(widths))


def case(seed: int) -> Case:
    """Draw up to 25 signals of which many touch, or begin at once, and questions about the times at their edges."""
    random = np.random.default_rng((28, seed))
    size = int(random.integers(2, 5))
    edges, signals = [100], [Signal(100, 200, CLASSIC, 4804, 0, 1, 1.0)]
    for _ in range(int(random.integers(3, 25))):
        begin = max(0, int(random.choice(edges)) + int(random.choice((0, 0, -1, 1, random.integers(-300, 300)))))
        end = begin + int(random.choice((*LENGTHS, random.integers(1, 400))))
        system = int(random.integers(3))
        kind = int(random.choice((*SYSTEMS[system], JAMMER)))
        power = float(random.choice((1.0, 2.5, 31.6, 100.0)))
        sender = int(random.integers(size))
        signals.append(
            Signal(begin, end, kind, near(random, signals[int(random.integers(len(signals)))]), sender, system, power)
        )
        edges += [begin, end]
    moves = [(0, gains_db(random, size))]
    moves += [(int(at), gains_db(random, size)) for at in sorted({int(random.choice(edges)) for _ in range(2)} - {0})]
    questions = []
    for _ in range(12):
        begin = max(0, int(random.choice(edges)) + int(random.integers(-1, 2)))
        end = begin + int(random.choice((*LENGTHS, abs(int(random.choice(edges)) - begin) or 1)))
        system = int(random.integers(3))
        close = signals[int(random.integers(len(signals)))]
        ear = Ear(
            int(random.choice(SYSTEMS[system])),
            near(random, close),
            int(random.integers(size)),
            system,
            int(random.integers(-1, size)),
        )
        questions.append(Question(end + int(random.choice((0, 0, 100))), ear, begin, end))
        if random.random() < 0.3:  # just above or below what is neglected
            gain = next(held for since, held in reversed(moves) if since <= close.begin)
            heard = ratios(gain)[close.sender][ear.receiver] * table(
                close.kind, ear.kind, abs(close.centre - ear.centre)
            )
            if heard > 0:
                hair = float(random.choice((1 - 1e-9, 1 + 1e-9)))
                signals.append(close._replace(mw=NEGLECTED_MW / heard * hair))
    return Case(size, signals, moves, questions)


class Listed:
    """A channel of which all that it sends is known, and told when it begins, or, if *lazy*, when somebody asks."""

    def __init__(self, band: Band, signals: Sequence[Signal], questions: Sequence[Question], lazy: bool) -> None:
        self.number = band.join(self)
        self._band, self._signals, self._lazy = band, list(signals), lazy
        self._questions = list(questions)
        self.now = 0

    @property
    def asks_from(self) -> Time:
        return min((question.begin for question in self._questions if question.at >= self.now), default=self.now) * US

    def catch_up(self, until: Time) -> None:
        if self._lazy:
            self.tell(until)

    def tell(self, until: Time) -> None:
        """Tell what starts before *until*; backwards: the order does not matter."""
        due = [signal for signal in self._signals if signal.begin * US < until]
        self._signals = [signal for signal in self._signals if signal not in due]
        for signal in reversed(due):
            self._band.tell(emission(signal, self.number))


def emission(signal: Signal, tenant: int) -> Emission:
    return Emission(signal.begin * US, signal.end * US, signal.kind, signal.centre, signal.sender, tenant, signal.mw)


def compare(seed: int, seen: Counter[str]) -> None:
    size, signals, moves, questions = case(seed)
    world = World(table, JAMMER)
    for since, gains in moves:
        world.move(since, ratios(gains))
    random = np.random.default_rng((29, seed))
    band = Band(size, ISOLATION_DB)
    systems = [
        Listed(
            band,
            [signal for signal in signals if signal.system == number],
            [question for question in questions if question.ear.system == number],
            bool(random.integers(2)),
        )
        for number in range(3)
    ]
    numbers = [system.number for system in systems]
    assert numbers == [0, 1, 2]
    events = sorted(
        [(at, 0, number) for number, (at, _) in enumerate(moves)]
        + [(question.at, 1, number) for number, question in enumerate(questions)]
    )
    for at, what, number in events:
        for system in systems:
            system.now = at
            if not system._lazy or what:  # who asks has told what it sends itself
                system.tell(at * US)
        if what == 0:
            band.moved(np.array(moves[number][1]), at * US)
        else:
            answer(band, world, signals, questions[number], random, seen)
    assert len(band.table.rows) < 70, "what is over has not been forgotten"


def answer(
    band: Band,
    world: World,
    signals: Sequence[Signal],
    question: Question,
    random: np.random.Generator,
    seen: Counter[str],
) -> None:
    ear, begin, end = question.ear, question.begin, question.end
    tuning, wanted = Tuning(ear.kind, ear.centre, ear.receiver), Wanted(ear.system, ear.sender)
    sections = band.interference(tuning, begin * US, end * US, wanted)
    assert sections[0].start == begin * US
    assert sections[-1].end == end * US
    assert all(one.end == other.start and one.mw != other.mw for one, other in pairwise(sections))
    levels = [section.mw for section in sections for _ in range((section.end - section.start) // US)]
    assert levels == pytest.approx(world.each_microsecond(signals, ear, begin, end), rel=1e-13, abs=0)
    least = float(random.choice((0.0, 1e-4, 0.5, 1.0)))
    told = band.overlapped(tuning, begin * US, end * US, wanted, least)
    met = [emission(signal, signal.system) for signal in world.overlap(signals, ear, begin, end, least)]
    assert sorted(told) == sorted(met)
    seen["several sections"] += len(sections) > 2
    seen["disturbed"] += any(levels)
    seen["silent"] += not any(levels)
    seen["several at once"] += len(met) > 2
    seen["met without a share"] += any(levels) and not met


WANTED = ("several sections", "disturbed", "silent", "several at once", "met without a share")


@pytest.mark.slow
def test_the_band_equals_the_oracle_and_everything_occurs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bands, "_ROOM", 2)
    seen: Counter[str] = Counter()
    for seed in range(60):
        compare(seed, seen)
    assert all(seen[what] >= 5 for what in WANTED), seen


@pytest.mark.soak
def test_the_band_equals_the_oracle_over_two_thousand_cases(
    monkeypatch: pytest.MonkeyPatch, record_property: Callable[[str, object], None]
) -> None:
    monkeypatch.setattr(bands, "_ROOM", 2)
    count = soak_count(2_000)
    for seed in range(1_000_000, 1_000_000 + count):
        compare(seed, Counter())
    record_property("equal band cases", count)


# ---------------------------------------------------------------- who answers what it has received


class Reactive:
    """A channel that carries out plans lazily: whether it answers depends on what disturbed it."""

    def __init__(self, band: Band, plans: Sequence[tuple[int, Plan]]) -> None:
        self.number = band.join(self)
        self._band, self._plans = band, dict(plans)
        self._events = [(plan.frame.begin, 1, number, 0) for number, plan in plans]
        heapq.heapify(self._events)
        self._under_way: dict[tuple[int, int], Signal] = {}
        self.sent: list[Signal] = []
        self.fates: dict[tuple[int, int], bool] = {}
        self.now = 0

    @property
    def asks_from(self) -> Time:
        return min((signal.begin for signal in self._under_way.values()), default=self.now) * US

    def catch_up(self, until: Time) -> None:
        """Do all that happens before *until*: an end (0), or a beginning (1)."""
        while self._events and self._events[0][0] * US < until:
            now, begins, number, step = heapq.heappop(self._events)
            self.now = now
            plan = self._plans[number]
            if begins:
                signal = sent(plan, step, now)
                self._under_way[number, step] = signal
                self.sent.append(signal)
                self._band.tell(emission(signal, self.number))
                heapq.heappush(self._events, (signal.end, 0, number, step))
                continue
            ear = hears(plan, step)
            begin = self._under_way[number, step].begin
            tuning, wanted = Tuning(ear.kind, ear.centre, ear.receiver), Wanted(self.number, ear.sender)
            sections = self._band.interference(tuning, begin * US, now * US, wanted)
            del self._under_way[number, step]
            right = max(section.mw for section in sections) <= plan.limit_mw
            self.fates[number, step] = right
            if right and step < 2:
                heapq.heappush(self._events, (now + plan.pause, 1, number, step + 1))
        self.now = max(self.now, until // US)


def plans(seed: int) -> tuple[int, list[list[float]], list[Plan]]:
    random = np.random.default_rng((30, seed))
    size, drawn = int(random.integers(2, 5)), []
    for _ in range(int(random.integers(2, 9))):
        begin = int(random.integers(0, 1_000))
        if drawn and random.random() < 0.5:
            begin = max(0, drawn[-1].frame.end + int(random.choice((-1, 0, 1))))
        system = int(random.integers(3))
        kind = int(random.choice(SYSTEMS[system]))
        sender, receiver = (int(radio) for radio in random.permutation(size)[:2])
        centre = int(random.choice((4804, 4806, 4808, 4824, 4826, 4830)))
        frame = Signal(begin, begin + int(random.choice((80, 126, 366))), kind, centre, sender, system, 1.0)
        limit_mw = 10 ** (-int(random.integers(40, 110)) / 10)
        drawn.append(Plan(frame, receiver, kind, limit_mw, int(random.choice((0, 1, 150))), 80))
    return size, gains_db(random, size), drawn


def react(seed: int, seen: Counter[str]) -> None:
    size, gains, drawn = plans(seed)
    world = World(table, JAMMER)
    world.move(0, ratios(gains))
    slow = Exchanges(world, drawn)
    slow.run(3_000)
    for asked in range(3):
        random = np.random.default_rng((31, seed, asked))
        band = Band(size, ISOLATION_DB)
        order = random.permutation(3).tolist()
        systems = []
        for system in order:  # a tenant's number in this band is not that of its system
            systems.append(Reactive(band, [(n, plan) for n, plan in enumerate(drawn) if plan.frame.system == system]))
        band.moved(np.array(gains), 0)
        for until in sorted(random.integers(1, 3_000, int(random.integers(0, 6))).tolist()):
            band.settle(until * US)
        band.settle(3_000 * US)
        assert sorted(signal for each in systems for signal in each.sent) == sorted(slow.signals), (seed, order)
        told = {key: right for each in systems for key, right in each.fates.items()}
        assert told.items() <= slow.fates.items()
        assert all(key in told for key in slow.fates if key[1] < 1 and drawn[key[0]].frame.end < 3_000)
    seen.update(f"step {step} {right}" for (_, step), right in slow.fates.items())


@pytest.mark.slow
def test_channels_that_catch_up_lazily_send_what_the_oracle_does_in_any_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bands, "_ROOM", 2)
    seen: Counter[str] = Counter()
    for seed in range(60):
        react(seed, seen)
    assert all(seen[f"step {step} {right}"] >= 15 for step in range(3) for right in (True, False)), seen


@pytest.mark.soak
def test_channels_that_catch_up_lazily_send_what_the_oracle_does_in_six_hundred_cases(
    monkeypatch: pytest.MonkeyPatch, record_property: Callable[[str, object], None]
) -> None:
    monkeypatch.setattr(bands, "_ROOM", 2)
    count = soak_count(600)
    for seed in range(1_000_000, 1_000_000 + count):
        react(seed, Counter())
    record_property("equal cases of lazy channels", count)
