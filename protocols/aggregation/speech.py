"""A robot's radios: what it says is encoded, counted and queued; what it hears is counted and decoded."""

from typing import Final

from cosim.errors import WireError
from cosim.machine import BROADCAST, Address, Event, LinkCommand, Outgoing, Reception
from protocols.aggregation.counters import BROADCAST_J, HEAR_J, RECEIVE_J, SEND_J, Counters
from protocols.aggregation.frames import decode, encode
from protocols.aggregation.messages import Message
from protocols.wire import BadBytes

SHORT: Final = 0
"""The radio within a sub-team."""


class Speech:
    """What one robot sends and receives."""

    def __init__(self, me: Address, counters: Counters, events: list[Event]) -> None:
        self.me = me
        self.outbox: list[Outgoing | LinkCommand] = []
        self._counters = counters
        self._events = events

    def say(self, message: Message, destination: Address = BROADCAST, radio: int = SHORT) -> None:
        """Send *message* to one robot, or to all in reach."""
        data = encode(self.me, message)
        self._counters.frames += 1
        self._counters.payload_bytes += len(data)
        self._counters.spend(BROADCAST_J if destination == BROADCAST else SEND_J, len(data))
        self.outbox.append(Outgoing(destination, data, None, radio))

    def hear(self, data: bytes, reception: Reception) -> tuple[Address, Message] | None:
        """Return who has sent what; None, and an event, for bytes that are no message or the robot's own."""
        self._counters.spend(HEAR_J if reception.broadcast else RECEIVE_J, len(data))
        try:
            sender, message = decode(data)
        except WireError:
            self._events.append(BadBytes(reception.source, len(data)))
            return None
        return None if sender == self.me else (sender, message)

    def drain(self) -> list[Outgoing | LinkCommand]:
        """Return what is to be sent, once."""
        outbox, self.outbox = self.outbox, []
        return outbox
