"""The payloads that radios hold, as rows of the table ``payloads``: when each was accepted, first on the air, and over.

A channel accepts a payload that it does not refuse at once. From then on its radio holds it until it is over: sent,
delivered, or given up for whatever reason. Nothing is kept, and nothing costs, unless the trace wants it: who has a
payload asks ``wanted`` first.
"""

from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from cosim.machine import Address
from cosim.trace import PAYLOADS, Trace
from cosim.units import Time

NEVER: Final[Time] = -1
"""What a row has where a payload has never been on the air."""
HELD: Final = "held"
"""Outcome of a payload that is not over yet."""
OFF: Final = "off"
"""Outcome of a payload whose radio is switched off."""

HeldRow: TypeAlias = tuple[Any, ...]
"""A row of the table."""


@dataclass(slots=True)
class _Held:
    payload: object
    """Keeps its identity from being taken by another."""
    robot: Address
    destination: Address
    length: int
    accepted: Time
    begun: Time = NEVER

    def row(self, end: Time, outcome: str) -> HeldRow:
        return self.accepted, self.robot, self.destination, self.length, self.begun, end, outcome


class Payloads:
    """The payloads that the radios of one channel hold, each known by the object that the channel makes for it."""

    def __init__(self, trace: Trace) -> None:
        self.wanted = trace.wants(PAYLOADS)
        """True if rows are kept."""
        self._trace = trace
        self._held: dict[int, _Held] = {}

    def accept(self, payload: object, robot: Address, destination: Address, length: int, now: Time) -> None:
        """Note that the radio of *robot* has accepted *payload*, of *length* B, *now*."""
        self._held[id(payload)] = _Held(payload, robot, destination, length, now)

    def begin(self, payload: object, at: Time) -> None:
        """Note that the first frame that carries *payload* begins *at* that instant."""
        held = self._held.get(id(payload))
        if held is not None:
            held.begun = at

    def end(self, payload: object, at: Time, outcome: str) -> None:
        """Write the row of *payload*, which was over *at* that instant, unless it is written."""
        held = self._held.pop(id(payload), None)
        if held is not None:
            self._trace.row(PAYLOADS, *held.row(at, outcome))

    def lose(self, robot: Address, now: Time, waiting: bool = False) -> None:
        """Write that all that the radio of *robot* holds is lost *now*, or only what is *waiting* for its first frame.

        The radio is switched off.
        """
        for held in list(self._held.values()):
            if held.robot == robot and not (waiting and held.begun != NEVER):
                self.end(held.payload, now, OFF)

    def under_way(self, now: Time) -> list[HeldRow]:
        """Return the rows of what is held *now*, as if it were over."""
        return [held.row(now, HELD) for held in self._held.values()]

    def close(self, now: Time) -> None:
        """Write what is held: the run is over."""
        for held in list(self._held.values()):
            self.end(held.payload, now, HELD)
