"""The machine of one robot: the application with its layers, the Bluetooth layer, and the deadlines of both."""

from functools import partial

import numpy as np

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
from cosim.protocol import Belief, CellMap
from cosim.units import Time
from protocols.pseudonet.application import Application
from protocols.pseudonet.bluetooth import Bluetooth
from protocols.pseudonet.broadcast import Broadcast
from protocols.pseudonet.coordination import Coordination
from protocols.pseudonet.messages import form_of
from protocols.pseudonet.parameters import TeamParameters
from protocols.pseudonet.relay import Relay
from protocols.pseudonet.scatternet import Scatternet
from protocols.pseudonet.setup import Setup
from protocols.pseudonet.upcalls import Upcall
from protocols.pseudonet.wide import Assignment, Welcome


class Pseudonet:
    """What cosim drives: bytes, link events, observations and time in; payloads, link commands and motion out.

    The set-up begins at *start*, but not before the first observation gives the robot its place. A slave that has
    received nothing for long gives its team up: a host does not learn that its own radio is dead, and a master's radio
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
        layer: Broadcast | Relay
        if setup.size <= setup.piconet_size:
            waits, form = (times.poll_timeout, times.repair), form_of(setup.size)
            layer = Broadcast(me, waits, parameters.poll_retries, parameters.acknowledge, self._take_upcall, form)
            self.bluetooth = Bluetooth(me, setup.size, links, times, parameters, partial(_assemble, layer), self._taken)
        else:
            layer = Relay(me, (2 * times.repair, times.silence), links, self._take_upcall, self._instruct)
            team = setup.size, setup.piconet_size
            self.scatternet = Scatternet(me, team, links, times, parameters, layer, self._taken)
            self.bluetooth = self.scatternet
        self.application = Application(parameters, setup, me, coordination, step_limit, start, layer, self._left_alone)
        self._silence = setup.timing.silence
        self._team: tuple[Address, ...] | None = None
        """Team that the Bluetooth layer knows of."""
        self._start: Time | None = start
        self._set_up_due = False
        self._silent_at = start + self._silence

    @property
    def finished(self) -> bool:
        """True if the task is done."""
        return self.application.finished

    def believed(self) -> Belief:
        """Return which cells it knows as covered and which as obstructed, and to which it drives, for who looks on."""
        view, goal = self.application.coordination.view, self.application.steering.goal_m
        grid, known = view.setup.grid, len(view.covered) + len(view.obstacles)
        cells = np.zeros((grid.ny, grid.nx), np.int8)
        cells.flat[list(view.covered)] = -1
        cells.flat[list(view.obstacles)] = 1
        covered = CellMap(cells, grid.origin_m, grid.cell_m, known) if known else None
        return Belief(covered, () if goal is None else (goal,), goal)

    # ------------------------------------------------------------ inputs

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        """Process a payload; those of robots without a link to this one are not for it."""
        if reception.source in self.bluetooth.links:
            self._silent_at = now + self._silence
            if not self.application.broadcast.receive(data, reception, now):
                return False
        elif reception.source != self.me:
            self.application.broadcast.overhear(data, now)
        self._follow(now)
        return True

    def link(self, event: LinkEvent, now: Time) -> None:
        """Process a link event."""
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

    def observe(self, observation: Observation, now: Time) -> bool:
        """Process what the robot senses; return whether that changed anything."""
        changed = self.application.observe(observation, now)
        if changed or self._set_up_due:
            self._set_up(now)
            self._follow(now)
        return changed

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
        earliest = self._silent_at if self._watching() else None
        for deadline in (
            self._start,
            self.bluetooth.deadline,
            application.begin_at,
            application.rest_until,
            application.broadcast.deadline,
        ):
            if deadline is not None and (earliest is None or deadline < earliest):
                earliest = deadline
        return earliest

    def _watching(self) -> bool:
        application = self.application
        layer = application.broadcast
        return layer.polled and layer.find_master() not in (None, self.me) and not application.finished

    def _set_up(self, now: Time) -> None:
        if not (self._set_up_due and self.application.placed):
            return
        self._set_up_due = False
        self.application.events.call(0, "application", "initialise", f"robot {self.me}")
        self.bluetooth.start(now)

    def _take_upcall(self, upcall: Upcall, now: Time) -> None:
        self.application.take_upcall(upcall, now)

    def _instruct(self, packet: Assignment | Welcome, source: Address, now: Time) -> None:
        if self.scatternet is not None:
            self.scatternet.instruct(packet, source, now)

    def _taken(self, now: Time) -> None:
        self.application.stand_by(now)

    def _left_alone(self, dead: tuple[Address, ...], now: Time) -> None:
        self.bluetooth.reform(dead, now)

    def _follow(self, now: Time) -> None:
        """Pass changes of the team on to the Bluetooth layer."""
        application = self.application
        if application.finished:
            self.bluetooth.leave()
            return
        layer = application.broadcast
        if layer.find_master() is None:
            self._team = None
        elif layer.members is not self._team:
            self._team = layer.members
            self.bluetooth.called_up(layer.members)

    # ------------------------------------------------------------ outputs

    def outbox(self) -> list[Outgoing | LinkCommand]:
        """Drain payloads and link commands of the two lower layers."""
        lower, upper = self.bluetooth.out, self.application.broadcast.out
        return drained(lower) + drained(upper) if lower or upper else []

    def commands(self) -> list[Command]:
        """Drain motion commands."""
        motion = self.application.steering.motion
        return drained(motion) if motion else []

    def events(self) -> list[Event]:
        """Drain rows for the trace."""
        return self.application.events.drain()


def _assemble(layer: Broadcast, slaves: tuple[Address, ...], hop: tuple[int, int], now: Time) -> None:
    """Call the team up, as the piconet is formed."""
    layer.assemble(tuple(sorted((layer.me, *slaves))), hop, now)
