"""What a robot says next: where it stands with the team, put into the words of the messaging room."""

from collections.abc import Callable, Mapping

from cosim.geometry.grids import Cell
from cosim.machine import Address
from protocols.pseudonet.coordination import Coordination
from protocols.pseudonet.messages import Message
from protocols.pseudonet.messaging import Messaging, Stance
from protocols.pseudonet.reconciliation import Equality, Reconciliation
from protocols.pseudonet.steering import Steering


class Speech:
    """One robot's next message, which is formed when the number of its exchange is known."""

    def __init__(
        self, messaging: Messaging, coordination: Coordination, reconciliation: Reconciliation, steering: Steering
    ) -> None:
        self._messaging = messaging
        self._coordination = coordination
        self._reconciliation = reconciliation
        self._steering = steering
        self._form: Callable[[int], Message] = self._waiting

    def next(self, exchange: int) -> Message:
        """Return the message of *exchange*; a robot that drives has nothing else to say."""
        return (self._waiting if self._steering.under_way else self._form)(exchange)

    def busy(self, exchange: int) -> Message:
        """Return the message of a robot that is not ready."""
        return self._messaging.busy(exchange, self._cell())

    def wait(self) -> None:
        """Wait for a plan."""
        self._form = self._waiting

    def say(self, stance: Stance) -> None:
        """Speak with this *stance* about the present evaluation from now on."""
        evaluation = self._coordination.evaluation
        self._form = lambda exchange: self._messaging.speak(stance, exchange, self._cell(), evaluation)

    def reconciled(self, messages: Mapping[Address, Message]) -> bool:
        """Return whether all know the same, so that a plan is due; or else say next what is wanted for that."""
        match self._reconciliation.take(self._coordination.view, messages):
            case Equality.EQUAL:
                return True
            case Equality.ROLL_WANTED:
                self._form = self._waiting
            case Equality.MAP_WANTED:
                self._form = self._map
        return False

    def _cell(self) -> Cell:
        return self._coordination.view.cells[self._coordination.view.me]

    def _waiting(self, exchange: int) -> Message:
        verdicts = self._coordination.obstruction()
        if self._steering.under_way:
            return self._messaging.busy(exchange, self._cell(), verdicts)
        digest = self._reconciliation.digest(self._coordination.view)
        return self._messaging.roll(exchange, self._cell(), verdicts, digest)

    def _map(self, exchange: int) -> Message:
        marks = self._reconciliation.marks(self._coordination.view)
        return self._messaging.map(exchange, self._cell(), self._reconciliation.chunk, marks)
