"""Quality of a failure detector: Chen's metrics of its speed and of its mistakes, from its transitions.

Chen, Toueg and Aguilera, "On the quality of service of failure detectors", IEEE Transactions on Computers 51(5), 2002,
section 2: an S-transition is from trust to suspicion, a T-transition back. T_D is from the crash to the last
S-transition; before the crash, T_MR is from one S-transition to the next, T_M from an S-transition to the T-transition
after it, and P_A the share of time with trust.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from cosim.units import Time, to_seconds
from protocols.detection.detectors import Detector


class Transition(NamedTuple):
    """A change of a detector between trust and suspicion."""

    time: Time
    suspects: bool


@dataclass(frozen=True)
class Quality:
    """The metrics of one detector that watches one peer; means of nothing are None."""

    detection_s: float | None
    """T_D, 0 if it suspected before and for good, inf if it trusts at the end; None if there is no crash."""
    observed_s: float
    """Time before the crash, to which all else refers."""
    mistakes: int
    """S-transitions."""
    mistaken_s: float
    """Time with suspicion."""
    mean_mistake_s: float | None
    """E(T_M), of the mistakes that were corrected."""
    mean_recurrence_s: float | None
    """E(T_MR), from the first to the last S-transition."""

    @property
    def mistake_rate_per_s(self) -> float:
        """lambda_M, S-transitions a second."""
        return self.mistakes / self.observed_s if self.observed_s else math.nan

    @property
    def accuracy(self) -> float:
        """P_A, the probability of trust at a random instant."""
        return 1.0 - self.mistaken_s / self.observed_s if self.observed_s else math.nan


class History:
    """The transitions of one detector, which trusts at first; of several at one instant the last counts."""

    def __init__(self) -> None:
        self.transitions: list[Transition] = []
        self.suspects = False

    def note(self, time: Time, suspects: bool) -> None:
        """Note the detector's state at *time*, which is not before the last one."""
        if suspects == self.suspects:
            return
        self.suspects = suspects
        if self.transitions and self.transitions[-1].time == time:
            self.transitions.pop()
        else:
            self.transitions.append(Transition(time, suspects))


def watch(detector: Detector, arrivals: Iterable[tuple[int, Time]], end: Time) -> list[Transition]:
    """Give *detector* the *arrivals*, pairs of number and time in order of time; return its transitions before *end*.

    It trusts at first. A heartbeat that arrives at the very instant at which suspicion would begin prevents it; of
    several that arrive at an instant, the detector's state after the last counts.
    """
    history = History()

    def wait(until: Time) -> None:
        due = detector.suspects_at()
        if due is not None and due < until:
            history.note(due, True)

    for number, time in arrivals:
        if time >= end:
            break
        wait(time)
        detector.heartbeat(number, time)
        history.note(time, detector.suspects(time))
    wait(end)
    return history.transitions


def quality(transitions: Sequence[Transition], start: Time, end: Time, crash: Time | None = None) -> Quality:
    """Return the metrics over [start, end) of a detector with these *transitions*, for a peer that stops at *crash*.

    It trusts before its first transition, which may be before *start*. Mistakes count if they begin in the time
    observed, which ends with the *crash*. Raises ValueError if the transitions do not alternate in order of time.
    """
    for one, other in pairwise(transitions):
        if other.time < one.time or other.suspects == one.suspects:
            raise ValueError(f"{one} cannot be followed by {other}")
    if transitions and not transitions[0].suspects:
        raise ValueError("a detector trusts at first, its first transition is to suspicion")
    until = end if crash is None else min(max(crash, start), end)
    ends = [transition.time for transition in transitions[1::2]]
    spells = [(begin, ends[k] if k < len(ends) else None) for k, begin in enumerate(t.time for t in transitions[::2])]
    begins = [begin for begin, _ in spells if start <= begin < until]
    corrected = [over - begin for begin, over in spells if start <= begin and over is not None and over < until]
    mistaken = sum(max(min(until if over is None else over, until) - max(begin, start), 0) for begin, over in spells)
    return Quality(
        detection_s=None if crash is None else _detection_s(transitions, end, crash),
        observed_s=to_seconds(until - start),
        mistakes=len(begins),
        mistaken_s=to_seconds(mistaken),
        mean_mistake_s=to_seconds(sum(corrected)) / len(corrected) if corrected else None,
        mean_recurrence_s=to_seconds(begins[-1] - begins[0]) / (len(begins) - 1) if len(begins) > 1 else None,
    )


def _detection_s(transitions: Sequence[Transition], end: Time, crash: Time) -> float:
    """Return T_D as seen at *end*."""
    seen = [transition for transition in transitions if transition.time < end]
    if not seen or not seen[-1].suspects:
        return math.inf
    return to_seconds(max(seen[-1].time - crash, 0))
