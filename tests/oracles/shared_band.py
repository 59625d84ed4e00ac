"""A slow model of a band that several technologies share: it looks at every microsecond. Times are microseconds.

What a sender radiates comes to each receiver with the gain that held when it began. The receiver takes in the share of
its power that the table has for the two kinds and the distance of their centres, nothing below -140 dBm, nothing of
its own channel's sender that it listens to, and nothing that its own radio of that channel sends. There is a kind, that
of jammers, of which each channel hears its own only.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import fsum
from typing import NamedTuple

Shares = Callable[[int, int, int], float]
"""Function from kinds of sender and receiver, and steps of 0.5 MHz between their centres, to a share."""
NEGLECTED_MW = 1e-14


class Signal(NamedTuple):
    """What somebody sends from *begin* on, and no longer at *end*."""

    begin: int
    end: int
    kind: int
    centre: int
    sender: int
    system: int
    mw: float


class Ear(NamedTuple):
    """Who listens, to whom, and how."""

    kind: int
    centre: int
    receiver: int
    system: int
    sender: int


class World:
    """Gains over time: from each instant on those between all, as ratios."""

    def __init__(self, shares: Shares, jammer: int) -> None:
        self._shares = shares
        self._jammer = jammer
        self._gains: list[tuple[int, Sequence[Sequence[float]]]] = []

    def move(self, since: int, gains: Sequence[Sequence[float]]) -> None:
        self._gains.append((since, gains))

    def share(self, signal: Signal, ear: Ear) -> float:
        return self._shares(signal.kind, ear.kind, abs(signal.centre - ear.centre))

    def taken_mw(self, signal: Signal, ear: Ear) -> float:
        """Return the power of a signal behind the filter of a receiver."""
        if signal.system == ear.system and signal.sender in (ear.sender, ear.receiver):
            return 0.0
        if signal.kind == self._jammer and signal.system != ear.system:
            return 0.0
        held = [gains for since, gains in self._gains if since <= signal.begin]
        if not held:
            return 0.0
        mw = signal.mw * held[-1][signal.sender][ear.receiver] * self.share(signal, ear)
        return mw if mw > NEGLECTED_MW else 0.0

    def each_microsecond(self, signals: Sequence[Signal], ear: Ear, begin: int, end: int) -> list[float]:
        """Return what disturbs a receiver in each microsecond of [begin, end)."""
        powers = [(signal, mw) for signal in signals if (mw := self.taken_mw(signal, ear)) > 0.0]
        levels = []
        for now in range(begin, end):
            levels.append(fsum(mw for signal, mw in powers if signal.begin <= now < signal.end))
        return levels

    def overlap(self, signals: Sequence[Signal], ear: Ear, begin: int, end: int, least: float) -> list[Signal]:
        """Return what is there in any microsecond of [begin, end), with *least* of its power in the filter."""
        counts = [s for s in signals if self.share(s, ear) >= least and self.taken_mw(s, ear) > 0.0]
        return [signal for signal in counts if any(signal.begin <= now < signal.end for now in range(begin, end))]


class Plan(NamedTuple):
    """A frame, and the answer that its receiver gives *pause* after its end if it was not disturbed too much."""

    frame: Signal
    receiver: int
    listens: int
    """The kind of both receivers."""
    limit_mw: float
    """The most that a frame, or an answer, survives."""
    pause: int
    length: int
    """Of the answer; of the sender's next frame too, which follows the answer's end by another pause if it is right."""


@dataclass
class Exchanges:
    """All plans, carried out microsecond by microsecond."""

    world: World
    plans: Sequence[Plan]
    signals: list[Signal] = field(default_factory=list)
    fates: dict[tuple[int, int], bool] = field(default_factory=dict)
    """Whether the step of a plan was received: (plan, 0) the frame, (plan, 1) the answer, (plan, 2) the last frame."""

    def run(self, until: int) -> None:
        """Have everything happen that begins before *until*, and its end."""
        due = [(plan.frame.begin, number, 0) for number, plan in enumerate(self.plans)]
        under_way: list[tuple[int, int, Signal, float]] = []
        now = 0
        while now < until or under_way:
            for number, step, signal, worst in list(under_way):
                if signal.end == now:
                    under_way.remove((number, step, signal, worst))
                    right = worst <= self.plans[number].limit_mw
                    self.fates[number, step] = right
                    if right and step < 2:
                        due.append((now + self.plans[number].pause, number, step + 1))
            for begin, number, step in due:
                if begin == now < until:
                    signal = sent(self.plans[number], step, begin)
                    self.signals.append(signal)
                    under_way.append((number, step, signal, 0.0))
            for place, (number, step, signal, worst) in enumerate(under_way):
                ear = hears(self.plans[number], step)
                level = fsum(
                    self.world.taken_mw(other, ear) for other in self.signals if other.begin <= now < other.end
                )
                under_way[place] = (number, step, signal, max(worst, level))
            now += 1


def sent(plan: Plan, step: int, begin: int) -> Signal:
    """Return what is sent in a step of a plan."""
    frame = plan.frame
    length = plan.length if step else frame.end - frame.begin
    sender = plan.receiver if step == 1 else frame.sender
    return frame._replace(begin=begin, end=begin + length, sender=sender)


def hears(plan: Plan, step: int) -> Ear:
    """Return who receives a step of a plan."""
    frame, other = plan.frame, plan.receiver
    sender, receiver = (other, frame.sender) if step == 1 else (frame.sender, other)
    return Ear(plan.listens, frame.centre, receiver, frame.system, sender)
