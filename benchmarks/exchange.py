"""A small protocol for measurements: every robot tells all others its state once a second, by way of the master.

Robot 0 inquires, pages the others and is their master. A slave sends its state to the master, the master broadcasts its
own and every state that it gets. The robots drive to and fro, each in a room of its own on the storey.
"""

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

from cosim.machine import (
    BROADCAST,
    Address,
    Command,
    Connected,
    Event,
    GoTo,
    Inquire,
    InquiryComplete,
    LinkCommand,
    LinkEvent,
    Outgoing,
    Page,
    Reception,
)
from cosim.observation import Observation
from cosim.protocol import Metric, ProtocolSpec, Surroundings
from cosim.settings import Settings
from cosim.units import MS, S, Time

STATE = struct.Struct("<BIfff")
"""Robot, number of the state, x, y, heading: 17 bytes."""
MASTER: Address = 0
LANES = (
    ((2.0, 12.5), (2.0, 17.0)),
    ((6.0, 12.5), (6.0, 17.0)),
    ((9.75, 12.5), (9.75, 17.0)),
    ((13.25, 12.5), (13.25, 17.0)),
    ((17.25, 12.5), (17.25, 17.0)),
    ((21.5, 12.5), (21.5, 17.0)),
    ((26.75, 12.5), (26.75, 17.0)),
    ((2.0, 1.5), (2.0, 6.0)),
)
"""Where each robot drives to and fro on the storey, in metres: 4.5 m without a wall, in a room of its own."""


class Exchange:
    """One robot's endpoint."""

    finished = False

    def __init__(self, parameters: Settings, setup: None, me: Address, stream: Any, start: Time) -> None:
        self.linked = 0
        self.received = 0
        """Payloads, those included that come back to their author."""
        self.states: dict[Address, tuple[Any, ...]] = {}
        self._me = me
        self._number = 0
        self._next = start + S + me * 125 * MS
        self._at: Observation | None = None
        self._end = 0
        self._outbox: list[Outgoing | LinkCommand] = [Inquire(10 * S + 240 * MS, 7)] if me == MASTER else []
        self._motion: list[Command] = []

    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        """Note a state; the master passes it on."""
        self.received += 1
        if len(data) != STATE.size:
            return
        robot, *state = STATE.unpack(data)
        self.states[robot] = tuple(state)
        if self._me == MASTER:
            self._outbox.append(Outgoing(BROADCAST, data))

    def link(self, event: LinkEvent, now: Time) -> None:
        """Page whom the inquiry has found; count the links."""
        if isinstance(event, InquiryComplete):
            self._outbox += [Page(peer) for peer in event.found]
        elif isinstance(event, Connected):
            self.linked += 1

    def observe(self, observation: Observation, now: Time) -> None:
        """Turn back at the end of the lane."""
        self._at = observation
        if observation.arrived:
            self._end = 1 - self._end
            self._motion.append(GoTo(*LANES[self._me][self._end]))

    def wake(self, now: Time) -> None:
        """Tell one's state, if there is a link."""
        if now < self._next:
            return
        self._next += S
        if self.linked and self._at is not None:
            self._number += 1
            at = self._at
            state = STATE.pack(self._me, self._number, at.x_m, at.y_m, at.heading_rad)
            self._outbox.append(Outgoing(BROADCAST if self._me == MASTER else MASTER, state))

    def wake_at(self) -> Time | None:
        """Return when the next state is due."""
        return self._next

    def outbox(self) -> list[Outgoing | LinkCommand]:
        """Drain payloads and commands."""
        self._outbox, drained = [], self._outbox
        return drained

    def commands(self) -> list[Command]:
        """Drain motion."""
        self._motion, drained = [], self._motion
        return drained

    def events(self) -> list[Event]:
        """Return nothing: this protocol reports nothing."""
        return []


class Nobody:
    """The judge: ends nothing."""

    def look(self, x_m: Any, y_m: Any, now: Time) -> bool:
        """Let the run go on."""
        return False

    def died(self, death: Any) -> None:
        """Take note of nothing."""

    def verdict(self, now: Time) -> dict[str, float]:
        """Return no metric."""
        return {}


def place(
    parameters: Settings, surroundings: Surroundings, size: int, stream: np.random.Generator
) -> Sequence[tuple[float, float]]:
    """Return the beginnings of the lanes."""
    return [begin for begin, _ in LANES[:size]]


SPEC = ProtocolSpec(
    name="exchange",
    parameters=Settings,
    place=place,
    prepare=lambda parameters, surroundings: None,
    make=Exchange,
    referee=lambda parameters, setup, surroundings: Nobody(),
    metrics=(Metric("received", "1", "payloads that machines have received"),),
    measure=lambda machines: {"received": float(sum(machine.received for machine in machines))},
    events=(),
    team_limit=8,
)
