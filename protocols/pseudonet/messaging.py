"""The messaging room: forms the message that fits a robot's state, and counts what was sent (paper 003, section III.A)."""

from cosim.geometry.grids import Cell
from cosim.machine import Address
from protocols.pseudonet.algorithms.base import UNJUDGED, Evaluation, Verdicts
from protocols.pseudonet.knowledge import Knowledge
from protocols.pseudonet.messages import Action, Kind, Message, Reply


class Messaging:
    """One robot's messages."""

    def __init__(self, me: Address, knowledge: Knowledge) -> None:
        self.sent: dict[Kind, int] = dict.fromkeys((Kind.STATE, Kind.HELP, Kind.ANSWER, Kind.TRAP, Kind.STOP), 0)
        self._me = me
        self._knowledge = knowledge

    def state(self, exchange: int, cell: Cell, evaluation: Evaluation) -> Message:
        """Return what *evaluation* asks for: a state message, or the help, trap or stop that takes its place."""
        return self._form(
            evaluation.kind, exchange, cell, evaluation.action, evaluation.verdicts, trail=evaluation.trail
        )

    def waiting(self, exchange: int, cell: Cell, busy: bool) -> Message:
        """Return a state message without intentions: of a robot that is driving, or at a roll call."""
        return self._form(Kind.STATE, exchange, cell, Action.STAY, UNJUDGED, busy=busy)

    def claim(self, exchange: int, cell: Cell, evaluation: Evaluation) -> Message:
        """Return the help message that claims the next cell, with the verdicts as the reasons."""
        return self._form(Kind.HELP, exchange, cell, evaluation.action, evaluation.verdicts)

    def agree(self, exchange: int, cell: Cell, evaluation: Evaluation, reply: Reply) -> Message:
        """Return the answer to all that accepts, or that admits to have changed the action."""
        return self._form(Kind.ANSWER, exchange, cell, evaluation.action, evaluation.verdicts, reply=reply)

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
            target=self._knowledge.place(target),
        )

    def _form(
        self,
        kind: Kind,
        exchange: int,
        cell: Cell,
        action: Action,
        verdicts: Verdicts,
        *,
        busy: bool = False,
        addressee: Address | None = None,
        reply: Reply = Reply.NONE,
        target: tuple[int, int] = (0, 0),
        trail: tuple[Action, ...] = (),
    ) -> Message:
        self.sent[kind] += 1
        x, y = self._knowledge.place(cell)
        return Message(self._me, kind, exchange, x, y, action, verdicts, busy, addressee, reply, target, trail)
