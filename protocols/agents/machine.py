"""One robot's machine: it drives as it is ordered, publishes what it is to say, and keeps what it has heard.

An order is bytes from the console: linear and angular velocity as two big-endian doubles, then the message, if there is
one. Messages are publications of the shared transport: to all in reach, or to all in the piconet, unacknowledged; one
that has not left yet is replaced by the next.
"""

import math
from collections import deque
from struct import Struct
from typing import Final

from pydantic import Field, model_validator

from cosim.machine import OPERATOR, Address, Drains, Drive, LinkEvent, Reception, drained
from cosim.observation import Observation
from cosim.settings import Count, Settings, error_at
from cosim.units import Time
from protocols.transport.frames import PUBLICATION_OVERHEAD
from protocols.transport.parameters import TransportParameters
from protocols.transport.transport import Published, Transport
from protocols.wire import BadBytes

TOPIC: Final = 0
"""Topic of messages, the only one of this protocol."""
_DRIVE: Final = Struct(">dd")


class Parameters(Settings):
    """What a scenario can set."""

    message_octets: Count = Field(default=0, description="bytes of each message; 0: there are none")
    inbox: Count = Field(default=8, le=1000, description="messages that a robot keeps, the latest")
    transport: TransportParameters = Field(default=TransportParameters(), description="how messages are carried")

    @model_validator(mode="after")
    def _messages_fit(self) -> "Parameters":
        most = self.transport.octets - PUBLICATION_OVERHEAD
        if self.message_octets > most:
            raise error_at(("message_octets",), self.message_octets, f"is not <= {most}, as transport.octets allows")
        return self


class AgentMachine(Drains):
    """One robot's machine; it stands still and is silent until it is ordered otherwise, and never finishes."""

    finished = False

    def __init__(self, parameters: Parameters, size: int, me: Address, start: Time) -> None:
        super().__init__()
        self.observation: Observation | None = None
        """What it has observed at the last tick, if there was one."""
        self.observed_at: Time = start
        """When that was, by its clock."""
        self.heard: deque[Published] = deque(maxlen=parameters.inbox)
        """The latest messages, the last one last."""
        self.message_octets = parameters.message_octets
        self._alone = size == 1
        self._transport = Transport(me, size, parameters.transport, start)
        self._keeps_links = self._transport.links is not None

    @staticmethod
    def order(command: Drive, message: bytes = b"") -> bytes:
        """Encode an order: to drive so from now on, and to publish *message* unless it is empty."""
        return _DRIVE.pack(*command) + message

    @property
    def connected(self) -> bool:
        """True if others can hear it now, as far as it knows: it has a link, or its radio needs none."""
        links = self._transport.links
        return links is None or self._alone or links.audience is not None

    def receive(self, data: bytes, reception: Reception, now: Time) -> bool:
        """Take a frame, or an order from the console; return False if nothing is to be done about it."""
        if reception.source == OPERATOR:
            self._obey(data, now)
        elif not self._transport.receive(data, reception, now):
            self._listen()
            return bool(self._events)
        self._settle()
        return True

    def link(self, event: LinkEvent, now: Time) -> bool:
        """Take an event of a link, or the fate of a frame; return False if nothing is to be done about it."""
        if not self._transport.link(event, now):
            return False
        self._settle()
        return True

    def observe(self, observation: Observation, now: Time) -> bool:
        """Keep the observation, and the links; return False if nothing has come of it."""
        self.observation, self.observed_at = observation, now
        if not self._keeps_links:
            return False
        if not self._transport.tick(observation.visible, now):
            return False
        self._settle()
        return True

    def wake(self, now: Time) -> None:
        """Act on all deadlines up to *now*."""
        self._transport.wake(now)
        self._settle()

    def wake_at(self) -> Time | None:
        """Return when the transport is due; None if it is not."""
        return self._transport.wake_at()

    def _obey(self, order: bytes, now: Time) -> None:
        """Drive, and publish the message if there is one; an order that is none becomes an event."""
        message = order[_DRIVE.size :]
        velocities = _DRIVE.unpack_from(order) if len(order) >= _DRIVE.size else (math.nan,)
        if not all(map(math.isfinite, velocities)) or len(message) not in (0, self.message_octets):
            self._events.append(BadBytes(OPERATOR, len(order)))
            return
        self._commands.append(Drive(*velocities))
        if message:
            self._transport.publish(TOPIC, message, now)

    def _settle(self) -> None:
        """Take the messages that have arrived, and leave what is to be sent in the outbox."""
        self._listen()
        self._events += drained(self._transport.bad)
        self._outbox += self._transport.drain()

    def _listen(self) -> None:
        """Take the messages that have arrived."""
        for published in self._transport.published():
            if published.topic == TOPIC and len(published.payload) == self.message_octets:
                self.heard.append(published)
            else:
                self._events.append(BadBytes(published.source, len(published.payload)))
