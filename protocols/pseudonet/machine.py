"""The machine of one robot: the application with its rooms, the Bluetooth room, and the deadlines of both."""

from cosim.machine import Address, Command, Event, Fate, LinkCommand, LinkEvent, Lost, Observation, Outgoing, Reception
from cosim.units import Time
from protocols.pseudonet.algorithms.base import Algorithm
from protocols.pseudonet.application import Application
from protocols.pseudonet.bluetooth import Bluetooth
from protocols.pseudonet.knowledge import Knowledge
from protocols.pseudonet.parameters import Parameters


class Pseudonet:
    """What cosim drives: bytes, news of links, observations and time in; payloads, link commands and motion out.

    The set-up begins at *start*, but not before the first observation tells the robot where it is. A robot that waits
    for a team, or is a slave in one, gives up when it has heard nothing for ``silence_s``: a host is not told that its
    own radio is dead.
    """

    def __init__(
        self,
        parameters: Parameters,
        knowledge: Knowledge,
        me: Address,
        algorithm: Algorithm,
        limits: tuple[int | None, int | None],
        start: Time,
    ) -> None:
        self.me = me
        self.application = Application(parameters, knowledge, me, algorithm, limits, start)
        inquiry = (knowledge.timing.inquiry, parameters.inquiries)
        self.bluetooth = Bluetooth(knowledge.size, inquiry, parameters.page_attempts, self.application.assemble)
        self._alone = knowledge.size == 1
        self._silence = knowledge.timing.silence
        self._start: Time | None = start
        self._set_up_due = False
        self._silent_at = start + self._silence

    @property
    def finished(self) -> bool:
        """Whether the task is done, or no team is left to do it with."""
        return self.application.finished

    # ------------------------------------------------------------ inputs

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Take a payload off the air."""
        if reception.source != self.me:
            self._silent_at = now + self._silence
        self.application.broadcast.receive(data, reception, now)

    def link(self, event: LinkEvent, now: Time) -> None:
        """Take news about links."""
        if isinstance(event, Fate):
            self.application.broadcast.fate(event, now)
            return
        self._silent_at = now + self._silence
        self.bluetooth.link(event, now)
        if isinstance(event, Lost):
            self.application.lost(event.peer, now)

    def observe(self, observation: Observation, now: Time) -> None:
        """Take what the robot senses."""
        self.application.observe(observation, now)
        self._set_up(now)

    def wake(self, now: Time) -> None:
        """Act on the deadlines that have come."""
        if self._start is not None and now >= self._start:
            self._start = None
            self._set_up_due = True
        self._set_up(now)
        if self._watching() and now >= self._silent_at:
            self.application.cut_off(now)
        self.application.wake(now)

    def wake_at(self) -> Time | None:
        """Return the earliest deadline."""
        application = self.application
        deadlines = (
            self._start,
            self._silent_at if self._watching() else None,
            application.begin_at,
            application.rest_until,
            application.broadcast.deadline,
        )
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def _watching(self) -> bool:
        return not self.finished and self.application.broadcast.find_master() != self.me

    def _set_up(self, now: Time) -> None:
        if not (self._set_up_due and self.application.placed):
            return
        self._set_up_due = False
        self.application.journal.call(0, "application", "initialise", f"robot {self.me}")
        if self._alone:
            self.application.assemble((), (0, 0), now)
        else:
            self.bluetooth.start(initiate=self.me == 0, now=now)

    # ------------------------------------------------------------ outputs

    def outbox(self) -> list[Outgoing | LinkCommand]:
        """Drain what the two lower rooms have for the device."""
        broadcast = self.application.broadcast
        if not self.bluetooth.out and not broadcast.out:
            return []
        out = self.bluetooth.out + broadcast.out
        self.bluetooth.out = []
        broadcast.out = []
        return out

    def commands(self) -> list[Command]:
        """Drain where to drive."""
        steering = self.application.steering
        motion, steering.motion = steering.motion, []
        return motion

    def events(self) -> list[Event]:
        """Drain the journal."""
        return self.application.journal.drain()
