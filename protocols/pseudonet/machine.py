"""The machine of one robot: the application with its rooms, the Bluetooth room, and the deadlines of both."""

from functools import partial

from cosim.machine import (
    Address,
    Command,
    Event,
    Fate,
    LinkCommand,
    LinkEvent,
    Lost,
    Outgoing,
    Reception,
    Role,
    drained,
)
from cosim.observation import Observation
from cosim.units import Time
from protocols.pseudonet.application import Application
from protocols.pseudonet.bluetooth import Bluetooth
from protocols.pseudonet.broadcast import Broadcast
from protocols.pseudonet.coordination import Coordination
from protocols.pseudonet.parameters import TeamParameters
from protocols.pseudonet.relay import Relay
from protocols.pseudonet.scatternet import Scatternet
from protocols.pseudonet.setup import Setup
from protocols.pseudonet.upcalls import Upcall
from protocols.pseudonet.wide import Assignment, Welcome


class Pseudonet:
    """What cosim drives: bytes, news of links, observations and time in; payloads, link commands and motion out.

    The set-up begins at *start*, but not before the first observation tells the robot where it is. A slave that has
    heard nothing for long takes its team for lost: a host is not told that its own radio is dead, and a master's radio
    may keep a link alive though its host is dead.
    """

    def __init__(
        self,
        parameters: TeamParameters,
        setup: Setup,
        me: Address,
        coordination: Coordination,
        step_limit: int | None,
        start: Time,
    ) -> None:
        self.me = me
        times = setup.timing
        links: dict[Address, Role] = {}
        self.scatternet: Scatternet | None = None
        self.bluetooth: Bluetooth
        room: Broadcast | Relay
        if setup.size <= parameters.piconet_size:
            waits = (times.poll_timeout, times.repair)
            room = Broadcast(me, waits, parameters.poll_retries, parameters.acknowledge, self._tell)
            self.bluetooth = Bluetooth(me, setup.size, links, times, parameters, partial(_assemble, room), self._taken)
        else:
            room = Relay(me, (2 * times.repair, times.silence), links, self._tell, self._instruct)
            self.scatternet = Scatternet(me, setup.size, links, times, parameters, room, self._taken)
            self.bluetooth = self.scatternet
        self.application = Application(parameters, setup, me, coordination, step_limit, start, room, self._left_alone)
        self._silence = setup.timing.silence
        self._team: tuple[Address, ...] | None = None
        """The team that the Bluetooth room knows of."""
        self._start: Time | None = start
        self._set_up_due = False
        self._silent_at = start + self._silence

    @property
    def finished(self) -> bool:
        """Whether the task is done."""
        return self.application.finished

    # ------------------------------------------------------------ inputs

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a payload off the air; those of robots without a link to this one are not for it."""
        if reception.source in self.bluetooth.links:
            self._silent_at = now + self._silence
            self.application.broadcast.receive(data, reception, now)
        elif reception.source != self.me:
            self.application.broadcast.overhear(data, now)
        self._follow(now)

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take news about links."""
        if isinstance(event, Fate):
            self.application.broadcast.fate(event, now)
            self.bluetooth.fate(event, now)
        else:
            self._silent_at = now + self._silence
            held = isinstance(event, Lost) and event.peer in self.bluetooth.links
            self.bluetooth.link(event, now)
            if held and isinstance(event, Lost):
                self.application.lost(event.peer, now)
        self._follow(now)

    def observe(self, observation: Observation, now: Time) -> None:
        """Take what the robot senses."""
        self.application.observe(observation, now)
        self._set_up(now)
        self._follow(now)

    def wake(self, now: Time) -> None:
        """Act on the deadlines that have come."""
        if self._start is not None and now >= self._start:
            self._start = None
            self._set_up_due = True
        self._set_up(now)
        if self._watching() and now >= self._silent_at:
            self.application.break_up((), now)
        self.bluetooth.wake(now)
        self.application.wake(now)
        self._follow(now)

    def wake_at(self) -> Time | None:
        """Return the earliest deadline."""
        application = self.application
        deadlines = (
            self._start,
            self._silent_at if self._watching() else None,
            self.bluetooth.deadline,
            application.begin_at,
            application.rest_until,
            application.broadcast.deadline,
        )
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def _watching(self) -> bool:
        room = self.application.broadcast
        return room.polled and room.find_master() not in (None, self.me) and not self.finished

    def _set_up(self, now: Time) -> None:
        if not (self._set_up_due and self.application.placed):
            return
        self._set_up_due = False
        self.application.journal.call(0, "application", "initialise", f"robot {self.me}")
        self.bluetooth.start(now)

    def _tell(self, upcall: Upcall, now: Time) -> None:
        self.application.hear(upcall, now)

    def _instruct(self, packet: Assignment | Welcome, source: Address, now: Time) -> None:
        if self.scatternet is not None:
            self.scatternet.instruct(packet, source, now)

    def _taken(self, now: Time) -> None:
        self.application.stand_by(now)

    def _left_alone(self, dead: tuple[Address, ...], now: Time) -> None:
        self.bluetooth.reform(dead, now)

    def _follow(self, now: Time) -> None:
        """Let the Bluetooth room know what has become of the team."""
        if self.finished:
            self.bluetooth.leave()
            return
        room = self.application.broadcast
        if room.find_master() is None:
            self._team = None
        elif room.members is not self._team:
            self._team = room.members
            self.bluetooth.called_up(room.members)

    # ------------------------------------------------------------ outputs

    def outbox(self) -> list[Outgoing | LinkCommand]:
        """Drain what the two lower layers have for the device."""
        return drained(self.bluetooth.out) + drained(self.application.broadcast.out)

    def commands(self) -> list[Command]:
        """Drain where to drive."""
        return drained(self.application.steering.motion)

    def events(self) -> list[Event]:
        """Drain what there is to report."""
        return self.application.journal.drain()


def _assemble(room: Broadcast, slaves: tuple[Address, ...], hop: tuple[int, int], now: Time) -> None:
    """Call the team up: the piconet stands."""
    room.assemble(tuple(sorted((room.me, *slaves))), hop, now)
