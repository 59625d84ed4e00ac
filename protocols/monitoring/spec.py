"""The protocol monitoring as cosim needs it: the entry point ``monitoring`` names ``SPEC``.

The metrics know no crash but the one that the referee sees. A suspicion that is taken back counts as a mistake; one
that stands at the end counts as a detection, and the time watched ends with it. The metrics of Chen, Toueg and Aguilera
are computed by that rule; ``suspected_at_s`` less ``died_at_s`` is their T_D if one robot dies, and negative (T_D = 0)
if a mistake was never corrected.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from cosim.arrays import Floats
from cosim.errors import UserError
from cosim.machine import Address
from cosim.protocol import Death, Metric, ProtocolSpec, Referee, Surroundings
from cosim.units import Time, to_seconds
from protocols.monitoring.heartbeats import decode
from protocols.monitoring.machine import EVENTS, Monitor, Parameters

TEAM_LIMIT: Final = 1 << 16
"""Addresses on the wire have 16 bits."""
APART: Final = 4.0
"""Distance between robots without given places, in radii."""

METRICS: Final = (
    Metric("heartbeats_sent", "1", "heartbeats sent, by all robots"),
    Metric("heartbeats_heard", "1", "heartbeats that have arrived, at all robots"),
    Metric("watched_s", "s", "time that robots were watched, summed over pairs; until the suspicion that stands"),
    Metric("mistakes", "1", "suspicions that were taken back, of all pairs"),
    Metric("mistake_rate_per_s", "1/s", "lambda_M, mistakes over the time watched"),
    Metric("mean_mistake_s", "s", "E(T_M), from suspicion until it was taken back; NaN without a mistake"),
    Metric("accuracy", "1", "P_A, share of the time watched without suspicion"),
    Metric("suspicions_standing", "1", "suspicions that stand at the end"),
    Metric("suspected_at_s", "s", "when those began, on the mean; NaN if there are none"),
    Metric("died_at_s", "s", "when the first robot died; NaN if none has"),
)


class DeathReferee(Referee):
    """The truth about deaths. It never ends a run."""

    def __init__(self) -> None:
        self._first: Time | None = None

    def look(self, x_m: Floats, y_m: Floats, now: Time) -> bool:
        """Let the run go on."""
        return False

    def died(self, death: Death) -> None:
        """Note the first death."""
        self._first = death.at if self._first is None else min(self._first, death.at)

    def verdict(self, now: Time) -> dict[str, float]:
        """Return the time of the first death."""
        return {"died_at_s": math.nan if self._first is None else to_seconds(self._first)}


def place(
    parameters: Parameters, surroundings: Surroundings, size: int, stream: np.random.Generator
) -> list[tuple[float, float]]:
    """Place the robots on a grid, close to each other, in the middle of the floor; raise UserError if that is not free.

    A study of the radio gives the robots' places itself.
    """
    apart_m, side = APART * surroundings.radius_m, math.isqrt(size - 1) + 1
    x_min, y_min, x_max, y_max = surroundings.bounds_m
    left_m, low_m = ((low + high - (side - 1) * apart_m) / 2.0 for low, high in ((x_min, x_max), (y_min, y_max)))
    starts = [(left_m + k % side * apart_m, low_m + k // side * apart_m) for k in range(size)]
    radii_m = surroundings.radii_m or (surroundings.radius_m,) * size
    if not all(map(surroundings.fits, starts, radii_m)):
        raise UserError("team.starts: the middle of the floor is not free; say where robots start")
    return starts


def prepare(parameters: Parameters, surroundings: Surroundings) -> int:
    """Return the size of the team, which is all that robots know beforehand; raise UserError for too many senders."""
    size = len(surroundings.starts_m)
    if parameters.senders is not None and parameters.senders > size:
        raise UserError(f"protocol.parameters.senders: {parameters.senders} is not <= {size}, the team's size")
    return size


def make(parameters: Parameters, size: int, me: Address, stream: np.random.Generator, start: Time) -> Monitor:
    """Return the machine of robot *me*."""
    return Monitor(parameters, size, me, start)


def referee(parameters: Parameters, size: int, surroundings: Surroundings) -> DeathReferee:
    """Return the referee, which notes the first death."""
    return DeathReferee()


def measure(machines: Sequence[Monitor]) -> dict[str, float]:
    """Return the metrics of all machines, but for those that a reboot has replaced."""
    watches = [(watch, machine.last_seen) for machine in machines for watch in machine.watches.values()]
    past = [(watch, machine.last_seen) for machine in machines for watch in machine.past]
    found = [watch.settled(end) for watch, end in (*watches, *past)]
    watched_s = math.fsum(each.observed_s for each in found)
    mistakes, mistaken_s = sum(each.mistakes for each in found), math.fsum(each.mistaken_s for each in found)
    standing = [to_seconds(watch.history.transitions[-1].time) for watch, _ in watches if watch.suspects]
    return {
        "heartbeats_sent": float(sum(machine.sent for machine in machines)),
        "heartbeats_heard": float(sum(machine.heard for machine in machines)),
        "watched_s": watched_s,
        "mistakes": float(mistakes),
        "mistake_rate_per_s": mistakes / watched_s if watched_s else math.nan,
        "mean_mistake_s": mistaken_s / mistakes if mistakes else math.nan,
        "accuracy": 1.0 - mistaken_s / watched_s if watched_s else math.nan,
        "suspicions_standing": float(len(standing)),
        "suspected_at_s": math.fsum(standing) / len(standing) if standing else math.nan,
    }


SPEC = ProtocolSpec(
    name="monitoring",
    about="Robots send heartbeats, and each decides by a failure detector which others have failed.",
    parameters=Parameters,
    place=place,
    prepare=prepare,
    make=make,
    referee=referee,
    metrics=METRICS,
    measure=measure,
    events=EVENTS,
    decode=lambda parameters, size, data: decode(data),
    team_limit=TEAM_LIMIT,
)
