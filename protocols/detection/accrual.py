"""The phi accrual failure detector: suspicion as a number that grows while no heartbeat comes.

Hayashibara, Defago, Yared and Katayama, "The phi accrual failure detector", SRDS 2004: with F the distribution of the
time between arrivals, estimated from the last ones, and t the time since the last arrival,

    phi(t) = -log10(1 - F(t)),

and suspicion from phi >= 1 on is wrong once in ten times, from phi >= 2 on once in a hundred, if the model holds.
F is normal. Two models of its tail differ where it matters, far out, and must not be mistaken for each other:

- ``phi_akka``: the logistic approximation of Akka's PhiAccrualFailureDetector; phi = 38 at 10 standard deviations;
- ``phi_normal``: the normal tail itself; phi = 23 there.

All else is as in Akka: the mean is shifted by an acceptable pause, the standard deviation has a floor, the history
begins with two made-up intervals, and an interval at whose end the process was suspected does not enter it.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import Literal

from pydantic import Field

import cosim.elementary as elementary
from cosim.settings import Count, Seconds, Settings
from cosim.units import Time, from_seconds

_LN_10 = 2.302585092994046


class PhiSettings(Settings):
    """Phi accrual with the defaults of Akka's cluster."""

    kind: Literal["phi_akka", "phi_normal"] = Field(
        default="phi_akka", description="the tail of the normal distribution: Akka's approximation of it, or itself"
    )
    threshold: float = Field(default=8.0, gt=0, le=300, description="phi from which on the process is suspected")
    window: Count = Field(default=1000, gt=0, description="intervals between arrivals that are remembered")
    min_deviation_s: Seconds = Field(default=0.1, ge=1e-9, description="s, floor of the standard deviation")
    acceptable_pause_s: Seconds = Field(default=3.0, ge=0, description="s, added to the mean interval")
    first_estimate_s: Seconds | None = Field(
        default=None, gt=0, description="s, the mean with which the history begins; by default the heartbeats' period"
    )


def akka_phi(deviations: float) -> float:
    """Return phi at a number of standard *deviations* above the mean, by Akka's approximation.

    Akka writes e = exp(-y (1.5976 + 0.070566 y^2)) and phi = -log10(e / (1 + e)); this is the same without overflow.
    """
    exponent = deviations * (1.5976 + 0.070566 * deviations * deviations)
    return (max(exponent, 0.0) + elementary.log1p(elementary.exp(-abs(exponent)))) / _LN_10


def normal_phi(deviations: float) -> float:
    """Return phi at a number of standard *deviations* above the mean: -log10 of the normal tail; inf beyond 38."""
    tail = 0.5 * elementary.erfc(abs(deviations) * math.sqrt(0.5))
    if deviations < 0.0:
        return -elementary.log1p(-tail) / _LN_10
    return -elementary.log(tail) / _LN_10 if tail > 0.0 else math.inf


class IntervalHistory:
    """The last intervals, with their mean and variance from exact sums, which do not drift as intervals leave."""

    def __init__(self, size: int) -> None:
        self._intervals: deque[Time] = deque(maxlen=size)
        self._sum = 0
        self._square_sum = 0

    def append(self, interval: Time) -> None:
        """Remember *interval*, and forget the oldest if there are too many."""
        if len(self._intervals) == self._intervals.maxlen:
            oldest = self._intervals[0]
            self._sum -= oldest
            self._square_sum -= oldest * oldest
        self._intervals.append(interval)
        self._sum += interval
        self._square_sum += interval * interval

    def mean(self) -> float:
        """Return the mean in nanoseconds; there must be an interval."""
        return self._sum / len(self._intervals)

    def variance(self) -> float:
        """Return the population variance in square nanoseconds; there must be an interval."""
        n = len(self._intervals)
        return (n * self._square_sum - self._sum * self._sum) / (n * n)


class PhiAccrual:
    """Akka's detector with either model of the tail; never suspects a process that has not been heard yet."""

    def __init__(self, settings: PhiSettings, period: Time) -> None:
        """Watch a process that sends a heartbeat each *period*, which matters if there is no first estimate."""
        self._phi = akka_phi if settings.kind == "phi_akka" else normal_phi
        self._limit = _crossing(self._phi, settings.threshold)
        self._pause = from_seconds(settings.acceptable_pause_s)
        self._floor = float(from_seconds(settings.min_deviation_s))
        estimate = period if settings.first_estimate_s is None else from_seconds(settings.first_estimate_s)
        self._history = IntervalHistory(settings.window)
        self._history.append(estimate - estimate // 4)
        self._history.append(estimate + estimate // 4)
        self._newest = 0
        self._last: Time | None = None
        self._mean = self._deviation = 0.0
        self._suspects_at: Time | None = None

    def heartbeat(self, number: int, now: Time) -> None:
        """Process heartbeat *number*, received at *now*; one that newer ones have overtaken is ignored."""
        if self._last is not None:
            if number <= self._newest:
                return
            # a clock set back makes an interval that never was
            if now >= self._last and not self.suspects(now):
                self._history.append(now - self._last)
        self._newest = number
        self._last = now
        self._mean = self._history.mean() + self._pause
        self._deviation = max(math.sqrt(self._history.variance()), self._floor)
        self._suspects_at = now + self._first_suspicious()

    def phi(self, now: Time) -> float:
        """Return phi at *now*; 0 as long as nothing has arrived."""
        return 0.0 if self._last is None else self._phi(self._deviations(now - self._last))

    def suspects(self, now: Time) -> bool:
        """Return whether phi has reached the threshold at *now*, which is not before the last arrival."""
        return self._suspects_at is not None and now >= self._suspects_at

    def suspects_at(self) -> Time | None:
        """Return the instant at which phi reaches the threshold; None as long as nothing has arrived."""
        return self._suspects_at

    def _deviations(self, elapsed: Time) -> float:
        return (elapsed - self._mean) / self._deviation

    def _first_suspicious(self) -> Time:
        """Return the least time since the last arrival, not below 0, at which phi is not below the threshold."""
        # one less than the estimate, whose rounding errors can have carried it across an integer
        elapsed = math.ceil(self._mean + self._limit * self._deviation) - 1
        while self._deviations(elapsed) < self._limit:
            elapsed += 1
        return max(elapsed, 0)


def _crossing(phi: Callable[[float], float], threshold: float) -> float:
    """Return the least number of deviations at which the rising *phi* is not below *threshold*, to the last bit."""
    below, reached = -40.0, 1.0
    while phi(reached) < threshold:
        reached *= 2.0
    while below < (middle := 0.5 * (below + reached)) < reached:
        if phi(middle) < threshold:
            below = middle
        else:
            reached = middle
    return reached
