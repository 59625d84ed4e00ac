"""The messaging layer: forms the message that fits a robot's state, and counts them (paper 003, section III.A)."""

from enum import Enum, auto
from typing import Any

from cosim.geometry.grids import Cell
from cosim.machine import Address
from protocols.pseudonet.algorithms.base import UNJUDGED, Evaluation, Verdicts
from protocols.pseudonet.messages import MESSAGE_KINDS, Action, Kind, Message, Reply
from protocols.pseudonet.setup import Setup


class Stance(Enum):
    """A robot's stance on its next action."""

    PROPOSE = auto()
    """For the first time in a step."""
    REPEAT = auto()
    """While others have not agreed."""
    CLAIM = auto()
    """To keep it, for these reasons."""
    YIELD = auto()
    """To have changed it."""
    ACCEPT = auto()
    """To find no robot in the way of another."""


class Messaging:
    """One robot's messages."""

    def __init__(self, me: Address, setup: Setup) -> None:
        self.sent: dict[Kind, int] = dict.fromkeys(MESSAGE_KINDS, 0)
        self._me = me
        self._setup = setup

    def speak(self, stance: Stance, exchange: int, cell: Cell, evaluation: Evaluation) -> Message:
        """Return the message of *stance* on *evaluation*.

        A proposal is a state message, or the help, trap or stop that takes its place; a claim is a help message with
        the verdicts as the reasons; to accept or to yield is an answer to all.
        """
        action, verdicts = evaluation.action, evaluation.verdicts
        match stance:
            case Stance.PROPOSE:
                return self._form(evaluation.kind, exchange, cell, action, verdicts, trail=evaluation.trail)
            case Stance.REPEAT:
                return self._form(Kind.STATE, exchange, cell, action, verdicts)
            case Stance.CLAIM:
                return self._form(Kind.HELP, exchange, cell, action, verdicts)
            case Stance.YIELD:
                return self._form(Kind.ANSWER, exchange, cell, action, verdicts, reply=Reply.YIELD)
            case Stance.ACCEPT:
                return self._form(Kind.ANSWER, exchange, cell, action, verdicts, reply=Reply.ACCEPT)

    def busy(self, exchange: int, cell: Cell, verdicts: Verdicts = UNJUDGED) -> Message:
        """Return a state message without intentions, of a robot that is driving."""
        return self._form(Kind.STATE, exchange, cell, Action.STAY, verdicts, busy=True)

    def roll(self, exchange: int, cell: Cell, verdicts: Verdicts, digest: int) -> Message:
        """Return the message of a robot that stands and waits for a plan."""
        return self._form(Kind.ROLL, exchange, cell, Action.STAY, verdicts, digest=digest)

    def map(self, exchange: int, cell: Cell, chunk: int, marks: bytes) -> Message:
        """Return the message that carries a piece of the map of covered cells."""
        return self._form(Kind.MAP, exchange, cell, Action.STAY, UNJUDGED, chunk=chunk, marks=marks)

    def direct(self, exchange: int, cell: Cell, to: Address, target: Cell) -> Message:
        """Return the answer that directs robot *to* to an uncovered cell."""
        return self._form(
            Kind.ANSWER,
            exchange,
            cell,
            Action.STAY,
            UNJUDGED,
            addressee=to,
            reply=Reply.DIRECT,
            target=self._setup.place(target),
        )

    def _form(
        self,
        kind: Kind,
        exchange: int,
        cell: Cell,
        action: Action,
        verdicts: Verdicts,
        **more: Any,
    ) -> Message:
        self.sent[kind] += 1
        x, y = self._setup.place(cell)
        return Message(self._me, kind, exchange, x, y, action, verdicts, **more)
