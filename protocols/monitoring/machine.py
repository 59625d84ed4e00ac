"""The machine of monitoring: it sends heartbeats, and watches the robots that send some.

Each incarnation of a robot is watched by a detector of its own: a heartbeat of a later incarnation than the known one
ends the watch over that. A robot that has never been heard is watched as if it had been started with the watcher, so
that one which is dead from the beginning is suspected as well; phi accrual, which waits for a first heartbeat, is given
one at the start.
"""

from dataclasses import dataclass, field

from pydantic import Field

from cosim.errors import WireError
from cosim.machine import BROADCAST, Address, Drains, LinkEvent, Outgoing, Reception
from cosim.observation import Observation
from cosim.settings import Count, Seconds, Settings
from cosim.units import Time, from_seconds
from protocols.detection.accrual import PhiSettings
from protocols.detection.chen import NfdESettings
from protocols.detection.detectors import DetectorSettings, make_detector
from protocols.detection.incarnations import Watch
from protocols.monitoring.heartbeats import Heartbeat, decode, encode

# ---------------------------------------------------------------- events
# The events of monitoring: suspicion, trust, and bytes that are no heartbeat.


_PEER = {"meaning": "the robot that is watched"}


@dataclass(frozen=True, slots=True)
class Suspected:
    """A robot suspects another from now on."""

    peer: int = field(metadata=_PEER)


@dataclass(frozen=True, slots=True)
class Trusted:
    """A robot trusts another again: the suspicion was a mistake, or the other has been rebooted."""

    peer: int = field(metadata=_PEER)


@dataclass(frozen=True, slots=True)
class BadHeartbeat:
    """Bytes that are no heartbeat, or from a robot that is not to send any."""

    sender: int = field(metadata={"meaning": "the last hop"})
    length: int = field(metadata={"unit": "B", "meaning": "length of the payload"})
    reason: str = field(metadata={"meaning": "what is wrong"})


EVENTS = (Suspected, Trusted, BadHeartbeat)


# ---------------------------------------------------------------- parameters


class Parameters(Settings):
    """Parameters of monitoring: which robots send heartbeats, how often, and how they are judged."""

    period_s: Seconds = Field(default=1.0, ge=1e-6, description="s, eta, from one heartbeat of a robot to the next")
    senders: Count | None = Field(
        default=None, ge=1, description="number of robots that send heartbeats, the first ones; all if not given"
    )
    spread: bool = Field(
        default=True,
        description="robots that start together send evenly spread over the period, not all at one instant",
    )
    detector: DetectorSettings = Field(
        default_factory=NfdESettings, description="failure detector for each robot that is watched"
    )


class Monitor(Drains):
    """One robot's machine; it drives nowhere and never finishes."""

    finished = False

    def __init__(self, parameters: Parameters, size: int, me: Address, start: Time) -> None:
        super().__init__()
        self.me = me
        self.sent = 0
        self.heard = 0
        """Number of heartbeats of others, copies included."""
        self.last_seen: Time = start
        """Last instant at which the machine was driven."""
        self.past: list[Watch] = []
        """Watches over incarnations that are known to be over."""
        self._parameters = parameters
        self._period = from_seconds(parameters.period_s)
        senders = size if parameters.senders is None else min(parameters.senders, size)
        self._start = start
        self._shift = self._period // senders if parameters.spread else 0
        self._begun = self._begins(me)
        self._number: int | None = 0 if me < senders else None
        """Number of the next heartbeat; None if there are to be none."""
        self.watches: dict[Address, Watch] = {peer: self._first_watch(peer) for peer in range(senders) if peer != me}
        self._next: Time | None = None
        self._rearm()

    # ------------------------------------------------------------ what comes in

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Process a heartbeat of another robot; other bytes become an event, and own ones are ignored."""
        self.last_seen = max(now, self.last_seen)
        try:
            heartbeat = decode(data)
        except WireError as error:
            self._events.append(BadHeartbeat(reception.source, len(data), str(error)))
            return
        peer = heartbeat.source
        if peer == self.me:
            return
        if peer not in self.watches:
            self._events.append(BadHeartbeat(reception.source, len(data), f"robot {peer} is not watched"))
            return
        self.heard += 1
        watch = self._watch_over(heartbeat, now)
        if watch is not None:
            suspected = watch.suspects
            watch.heartbeat(heartbeat.number, now)
            self._report(peer, suspected, watch)
            self._arm(watch.due())

    def link(self, event: LinkEvent, now: Time) -> None:
        """Ignore link events: broadcasts reach the robots that they reach."""
        self.last_seen = max(now, self.last_seen)

    def observe(self, observation: Observation, now: Time) -> None:
        """Ignore observations: a robot is judged by what it sends."""
        self.last_seen = max(now, self.last_seen)

    def wake(self, now: Time) -> None:
        """Send the heartbeat that is due, and suspect robots whose time is over."""
        self.last_seen = max(now, self.last_seen)
        self._beat(now)
        for peer, watch in self.watches.items():
            due = watch.due()
            if due is not None and due <= now:
                watch.look(now)
                self._report(peer, False, watch)
        self._rearm()

    def wake_at(self) -> Time | None:
        """Return the instant of the next heartbeat or the next suspicion, or an earlier one."""
        return self._next

    # ------------------------------------------------------------ watches and deadlines

    def _begins(self, robot: Address) -> Time:
        """Return the instant at which *robot* sends its heartbeat 0 if it has been started with this one."""
        return self._start + robot * self._shift

    def _first_watch(self, peer: Address) -> Watch:
        """Return the watch over a robot that has not been heard yet, as if it had been started with this one."""
        watch = self._new_watch(self._start, self._begins(peer), None)
        if isinstance(self._parameters.detector, PhiSettings):
            watch.heartbeat(-1, self._start)
        return watch

    def _new_watch(self, since: Time, epoch: Time, begun: Time | None) -> Watch:
        return Watch(make_detector(self._parameters.detector, self._period, since, epoch), since, begun)

    def _watch_over(self, heartbeat: Heartbeat, now: Time) -> Watch | None:
        """Return the watch over the incarnation that sent *heartbeat*; None if that is known to be over."""
        peer, begun, _ = heartbeat
        watch = self.watches[peer]
        if watch.begun is None and begun == self._begins(peer):
            watch.begun = begun
        if watch.begun == begun:
            return watch
        if watch.begun is not None:
            if begun < watch.begun:
                return None
            watch.close(now)
            self.past.append(watch)
        self.watches[peer] = self._new_watch(now, begun, begun)
        if watch.suspects:
            self._events.append(Trusted(peer))
        return self.watches[peer]

    def _report(self, peer: Address, suspected: bool, watch: Watch) -> None:
        if watch.suspects != suspected:
            self._events.append(Suspected(peer) if watch.suspects else Trusted(peer))

    def _beat(self, now: Time) -> None:
        """Send the heartbeat that is due; of several, because the clock was set forward, the last."""
        last = (now - self._begun) // self._period
        if self._number is not None and last >= self._number:
            self._outbox.append(Outgoing(BROADCAST, encode(Heartbeat(self.me, self._begun, last))))
            self._number = last + 1
            self.sent += 1

    def _arm(self, due: Time | None) -> None:
        """Be woken at *due* at the latest; a deadline that has moved later is noticed when the old one comes."""
        if due is not None and (self._next is None or due < self._next):
            self._next = due

    def _rearm(self) -> None:
        self._next = None if self._number is None else self._begun + self._number * self._period
        for watch in self.watches.values():
            self._arm(watch.due())
