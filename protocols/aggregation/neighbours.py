"""What a host knows of the other hosts: where they are and go, whom they lead, and whether they can still be heard."""

from collections.abc import Callable, Iterable, Sequence

from cosim.geometry.planning import Point
from cosim.geometry.polylines import middle
from cosim.machine import Address
from cosim.units import Time
from protocols.aggregation.frames import CLOCK_MS, instant
from protocols.aggregation.messages import Heartbeat, News, Plan
from protocols.detection.detectors import Detector
from protocols.detection.incarnations import Incarnation


class Neighbour:
    """Another host."""

    def __init__(self, detector: Detector, period: Time) -> None:
        self.detector = detector
        self.incarnation = Incarnation(period, CLOCK_MS)
        self.number = -1
        """Its last heartbeat."""
        self.suspected = False
        self.place_m: Point | None = None
        self.plan: Plan | None = None
        self.members: dict[Address, int] = {}
        """Searcher -> epoch, as it told last."""


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

    def heard(self, host: Address, beat: Heartbeat, now: Time) -> bool:
        """Take a heartbeat; return whether the host had been suspected, is heard first, or has begun anew."""
        one = self.hosts[host]
        anew = one.incarnation.is_new(beat.number, beat.stamp_ms)
        first = one.number < 0
        if anew or first:  # only now it is known when its count began
            began = instant(beat.stamp_ms, now) - beat.number * self._period
            one.detector, one.number = self._make(now, began), -1
        one.detector.heartbeat(beat.number, now)
        one.number = max(one.number, beat.number)
        one.place_m = beat.x_m, beat.y_m
        back = one.suspected and not one.detector.suspects(now)
        one.suspected = one.suspected and not back
        return back or first or anew

    def told(self, host: Address, news: News) -> bool:
        """Take a host's news; return whether it goes a new way: the version counts more than that."""
        one = self.hosts[host]
        one.members = dict(news.members)
        changed = one.plan is None or one.plan[2:] != news.plan[2:]
        one.plan = news.plan
        return changed

    def fall_silent(self, now: Time) -> list[Address]:
        """Return the hosts that are suspected from now on."""
        silent = [host for host, one in self.hosts.items() if not one.suspected and one.detector.suspects(now)]
        for host in silent:
            self.hosts[host].suspected = True
        return silent

    def next_silence(self) -> Time | None:
        """Return when the next host will be suspected, if none of them is heard before."""
        instants = [
            at for one in self.hosts.values() if not one.suspected and (at := one.detector.suspects_at()) is not None
        ]
        return min(instants, default=None)

    @property
    def silent(self) -> tuple[Address, ...]:
        """The hosts that are suspected."""
        return tuple(host for host, one in self.hosts.items() if one.suspected)

    @property
    def idle(self) -> tuple[Address, ...]:
        """The hosts that lead nobody, as far as can be told: those that are suspected, or have said so."""
        return tuple(
            host for host, one in self.hosts.items() if one.suspected or (one.plan is not None and not one.members)
        )

    def alone(self) -> bool:
        """Return whether there are other hosts, and all are suspected."""
        return bool(self.hosts) and all(one.suspected for one in self.hosts.values())

    def centroid(self, here_m: Point) -> Point:
        """Return the middle of all hosts, where they have been last; that of *here_m* is the asking one's (VI.B)."""
        return middle([here_m, *(one.place_m for one in self.hosts.values() if one.place_m is not None)])

    def newer_epoch(self, searcher: Address) -> int:
        """Return the newest epoch with which another host that can be heard has *searcher*, or -1."""
        return max((one.members.get(searcher, -1) for one in self.hosts.values() if not one.suspected), default=-1)

    def plans(self) -> Sequence[Plan]:
        """Return what is known of the others' ways."""
        return [one.plan for one in self.hosts.values() if one.plan is not None]
