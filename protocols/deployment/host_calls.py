"""The plays that a scenario has the host call, without an operator, and the changes of strategy."""

from collections.abc import Callable

from cosim.errors import UserError
from cosim.machine import Event
from cosim.units import Time, from_seconds
from protocols.deployment import journal
from protocols.deployment.console_planning import Planning
from protocols.deployment.host import Host
from protocols.deployment.parameters import Parameters
from protocols.deployment.plan import Plan
from protocols.deployment.records import Records


class Calls:
    """What is left of them for one robot, if it is host; times count from its start."""

    def __init__(
        self,
        parameters: Parameters,
        planning: Planning,
        host: Host,
        note: Callable[[Event], None],
        records: Records,
        start: Time,
    ) -> None:
        self._calls = [(start + from_seconds(each.at_s), each.call) for each in parameters.calls]
        self._switches = [(start + from_seconds(each.at_s), each.strategy) for each in parameters.switches]
        self._planning = planning
        self._host = host
        self._note = note
        self._records = records
        self._ready = start + from_seconds(parameters.listen_s)
        self._dealt = 0
        self._switched = 0

    @property
    def dealt(self) -> int:
        """How many calls have been dealt with, as far as is known here."""
        return max(self._dealt, self._host.calls)

    @property
    def over(self) -> bool:
        """Whether there were calls, and all have been dealt with."""
        return bool(self._calls) and self.dealt >= len(self._calls)

    def hear(self, dealt: int) -> None:
        """Take how many calls have been dealt with, by another's news."""
        self._dealt = max(self._dealt, min(dealt, len(self._calls)))

    def tick(self, now: Time) -> None:
        """Call what is due, if this robot is host, and nothing is being played."""
        host = self._host
        if not host.leads or now < self._ready:
            return
        while self._switched < len(self._switches) and now >= self._switches[self._switched][0]:
            host.switch(self._switches[self._switched][1], now)
            self._switched += 1
        at = self.dealt
        if at < len(self._calls) and now >= self._calls[at][0] and not host.busy:
            self._dealt = at + 1
            self._call(at, now)

    def _call(self, at: int, now: Time) -> None:
        call, starts_m = self._calls[at][1], self._planning.starts_m(now)
        try:
            plan = self._planning.plan(call, self._host.number + 1, now)
        except UserError as error:
            self._refused(call.play, str(error), "")
            return
        if isinstance(plan, Plan):
            self._host.execute(plan, starts_m, at + 1, now)
        else:
            self._refused(call.play, "; ".join(plan.conflicts), "; ".join(plan.mend))

    def _refused(self, play: str, why: str, mend: str) -> None:
        self._records.refused += 1
        self._note(journal.PlanRefused(play, why, mend))
