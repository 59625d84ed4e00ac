"""The events of a Pseudonet machine, and the calls from layer to layer of Fig. 12."""

from dataclasses import dataclass, field

from cosim.machine import Call, Event, drained


@dataclass(frozen=True, slots=True)
class TeamFormed:
    """A robot has learned the members of its team: its piconet or scatternet is formed."""

    size: int = field(metadata={"meaning": "number of robots in the team"})
    piconets: int = field(default=1, metadata={"meaning": "number of piconets that the team is joined by"})


@dataclass(frozen=True, slots=True)
class TeamLost:
    """A robot has no team any more: its master is gone, or it was left out."""

    size: int = field(metadata={"meaning": "number of robots in the team"})


@dataclass(frozen=True, slots=True)
class Stepped:
    """The team has agreed on a step."""

    step: int = field(metadata={"meaning": "number of the step"})
    action: str = field(metadata={"meaning": "what the robot does in the step"})
    column: int = field(metadata={"meaning": "column of the cell that the step leads to"})
    row: int = field(metadata={"meaning": "row of the cell that the step leads to"})


@dataclass(frozen=True, slots=True)
class MessageSent:
    """A message was handed to the broadcast layer."""

    kind: str = field(metadata={"meaning": "message type"})


@dataclass(frozen=True, slots=True)
class RobotDropped:
    """A robot has missed its poll, or its link is gone."""

    robot: int = field(metadata={"meaning": "the robot that the team goes on without"})


@dataclass(frozen=True, slots=True)
class BadBytes:
    """Bytes were received that are no packet."""

    reason: str = field(metadata={"meaning": "what is wrong, or why it ended"})


@dataclass(frozen=True, slots=True)
class Finished:
    """A robot has ended."""

    reason: str = field(metadata={"meaning": "what is wrong, or why it ended"})


EVENTS = (TeamFormed, TeamLost, Stepped, MessageSent, RobotDropped, BadBytes, Finished)


class Events:
    """The events of one machine until they are drained."""

    def __init__(self, calls: bool) -> None:
        self.calls = calls
        """True if calls are wanted."""
        self._events: list[Event] = []

    def note(self, event: Event) -> None:
        """Add *event*."""
        self._events.append(event)

    def call(self, depth: int, layer: str, name: str, detail: object = "") -> None:
        """Add a call to *layer*, if calls are wanted."""
        if self.calls:
            self._events.append(Call(depth, layer, name, str(detail)))

    def drain(self) -> list[Event]:
        """Drain the events."""
        return drained(self._events) if self._events else []
