"""What a host knows of the other hosts: their places, plans and members, and whether they are suspected."""

from collections.abc import Callable, Iterable, Sequence

from cosim.geometry.planning import Point
from cosim.geometry.polylines import middle
from cosim.machine import Address
from cosim.units import Time
from protocols.aggregation.frames import CLOCK_MS, instant
from protocols.aggregation.messages import Heartbeat, Plan, Status
from protocols.detection.detectors import Detector
from protocols.detection.incarnations import Incarnation


class Neighbour:
    """Another host."""

    def __init__(self, detector: Detector, period: Time) -> None:
        self.detector = detector
        self.incarnation = Incarnation(period, CLOCK_MS)
        self.number = -1
        """Number of its last heartbeat; -1 before the first."""
        self.suspected = False
        self.place_m: Point | None = None
        self.plan: Plan | None = None
        self.members: dict[Address, int] = {}
        """Its last reported members: searcher -> epoch."""


class Neighbours:
    """All other hosts, as one host knows them."""

    def __init__(
        self, others: Iterable[Address], period: Time, make: Callable[[Time, Time], Detector], start: Time
    ) -> None:
        """Watch *others*, with heartbeats *period* apart, from *start* on as if they had been heard then."""
        self._make = make
        self._period = period
        self.hosts = {host: Neighbour(self._watching(start), period) for host in others}

    def _watching(self, now: Time) -> Detector:
        detector = self._make(now, now)
        detector.heartbeat(-1, now)
        return detector

    def take_heartbeat(self, host: Address, beat: Heartbeat, now: Time) -> bool:
        """Process a heartbeat; return True if the host had been suspected, is heard first, or has been rebooted."""
        one = self.hosts[host]
        rebooted = one.incarnation.is_new(beat.number, beat.stamp_ms)
        first = one.number < 0
        if rebooted or first:  # only now it is known when its count began
            began = instant(beat.stamp_ms, now) - beat.number * self._period
            one.detector, one.number = self._make(now, began), -1
        one.detector.heartbeat(beat.number, now)
        one.number = max(one.number, beat.number)
        one.place_m = beat.x_m, beat.y_m
        back = one.suspected and not one.detector.suspects(now)
        one.suspected = one.suspected and not back
        return back or first or rebooted

    def take_status(self, host: Address, status: Status) -> bool:
        """Process a host's status; return True if its way has changed (its version counts other changes, too)."""
        one = self.hosts[host]
        one.members = dict(status.members)
        changed = one.plan is None or one.plan[2:] != status.plan[2:]
        one.plan = status.plan
        return changed

    def fall_silent(self, now: Time) -> list[Address]:
        """Suspect the hosts whose detectors do so now; return those that were trusted before."""
        silent = [host for host, one in self.hosts.items() if not one.suspected and one.detector.suspects(now)]
        for host in silent:
            self.hosts[host].suspected = True
        return silent

    def next_silence(self) -> Time | None:
        """Return the instant at which the next host will be suspected if no heartbeat comes; None if there is none."""
        instants = [
            at for one in self.hosts.values() if not one.suspected and (at := one.detector.suspects_at()) is not None
        ]
        return min(instants, default=None)

    @property
    def silent(self) -> tuple[Address, ...]:
        """Hosts that are suspected."""
        return tuple(host for host, one in self.hosts.items() if one.suspected)

    @property
    def idle(self) -> tuple[Address, ...]:
        """Hosts that lead no searcher as far as is known: those that are suspected, or have reported no members."""
        return tuple(
            host for host, one in self.hosts.items() if one.suspected or (one.plan is not None and not one.members)
        )

    def alone(self) -> bool:
        """Return True if there are other hosts and all are suspected."""
        return bool(self.hosts) and all(one.suspected for one in self.hosts.values())

    def centroid(self, here_m: Point) -> Point:
        """Return the middle of the last places of all hosts, this one at *here_m* included (section VI.B)."""
        return middle([here_m, *(one.place_m for one in self.hosts.values() if one.place_m is not None)])

    def newer_epoch(self, searcher: Address) -> int:
        """Return the newest epoch with which a trusted host has *searcher* as a member, or -1."""
        return max((one.members.get(searcher, -1) for one in self.hosts.values() if not one.suspected), default=-1)

    def plans(self) -> Sequence[Plan]:
        """Return the known plans of the other hosts."""
        return [one.plan for one in self.hosts.values() if one.plan is not None]
