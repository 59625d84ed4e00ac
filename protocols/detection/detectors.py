"""Failure detectors: when a robot that sends heartbeats is suspected to have crashed.

A detector watches one incarnation of a peer. It is given the number and the arrival of each heartbeat, by the clock of
the robot that watches; times are arguments. It suspects, or it trusts, and it knows beforehand when it will begin to
suspect. A peer that counts from 0 again, after a reboot, is another incarnation and gets a detector of its own.
"""

from typing import Annotated, Literal, Protocol, TypeAlias

from pydantic import Field

from cosim.settings import Seconds, Settings
from cosim.units import Time, from_seconds
from protocols.detection.accrual import PhiAccrual, PhiSettings
from protocols.detection.chen import NfdE, NfdESettings, NfdS, NfdSSettings


class Detector(Protocol):
    """What decides whether a peer is alive; ``suspects(now)`` is the same as ``now >= suspects_at()``."""

    def heartbeat(self, number: int, now: Time) -> None:
        """Process heartbeat *number*, received at *now*; copies and overtaken ones change nothing."""

    def suspects(self, now: Time) -> bool:
        """Return whether the peer is suspected at *now*, which must not be before the last arrival."""

    def suspects_at(self) -> Time | None:
        """Return the instant from which on the peer is suspected if nothing more arrives; it may have passed.

        None if the detector knows nothing of the peer yet. Takes constant time, to serve as a deadline.
        """


class FixedTimeoutSettings(Settings):
    """Suspicion when no heartbeat has come for a fixed time."""

    kind: Literal["fixed"] = "fixed"
    timeout_s: Seconds = Field(default=3.0, gt=0, description="s, from the last arrival until the peer is suspected")


DetectorSettings: TypeAlias = Annotated[
    FixedTimeoutSettings | NfdSSettings | NfdESettings | PhiSettings, Field(discriminator="kind")
]
"""The failure detectors that a scenario can choose from; the defaults are for a heartbeat each second."""


class FixedTimeout:
    """Suspects a peer that has not been heard for a fixed time."""

    def __init__(self, settings: FixedTimeoutSettings, start: Time) -> None:
        """Watch from *start* on, as if a heartbeat had arrived then."""
        self._timeout = from_seconds(settings.timeout_s)
        self._newest: int | None = None
        self._suspects_at = start + self._timeout

    def heartbeat(self, number: int, now: Time) -> None:
        """Process heartbeat *number*, received at *now*; one that newer ones have overtaken is ignored."""
        if self._newest is None or number > self._newest:
            self._newest = number
            self._suspects_at = now + self._timeout

    def suspects(self, now: Time) -> bool:
        """Return whether the peer is suspected at *now*."""
        return now >= self._suspects_at

    def suspects_at(self) -> Time:
        """Return the end of the time-out."""
        return self._suspects_at


def make_detector(settings: DetectorSettings, period: Time, start: Time, epoch: Time = 0) -> Detector:
    """Return the detector that *settings* choose, for a peer with a heartbeat each *period*, watched from *start* on.

    Heartbeat i is sent at *epoch* + i *period*, which only NFD-S uses. Phi accrual watches from the first heartbeat
    only: to have a peer suspected that is never heard, count the *start* as a heartbeat with number -1.
    """
    match settings:
        case FixedTimeoutSettings():
            return FixedTimeout(settings, start)
        case NfdSSettings():
            return NfdS(settings, period, start, epoch)
        case NfdESettings():
            return NfdE(settings, period, start)
        case PhiSettings():
            return PhiAccrual(settings, period)
