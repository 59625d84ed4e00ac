"""The plays that a scenario has the host call without an operator, and the changes of strategy.

Any host does what is due and was not done before. It knows that by the plan and its facts; so a call whose plan has
reached no other robot before its host died is made again.
"""

from collections.abc import Callable

from cosim.errors import UserError
from cosim.machine import Event
from cosim.units import Time, from_seconds
from protocols.deployment.counters import Counters
from protocols.deployment.operator.planning import Planning
from protocols.deployment.parameters import Parameters
from protocols.deployment.tasks import events
from protocols.deployment.tasks.facts import Switched
from protocols.deployment.tasks.plan import Plan
from protocols.deployment.team.host import Host


class Calls:
    """The scenario's calls and switches that are left to one robot, if it is host."""

    def __init__(
        self,
        parameters: Parameters,
        planning: Planning,
        host: Host,
        note: Callable[[Event], None],
        counters: Counters,
        start: Time,
    ) -> None:
        self._calls = [(from_seconds(each.at_s), each.call) for each in parameters.calls]
        self._switches = [(from_seconds(each.at_s), each.strategy) for each in parameters.switches]
        self.start = start
        """Time from which the times of calls count; that of its first start if the robot has booted again."""
        self._planning = planning
        self._host = host
        self._note = note
        self._counters = counters
        # a robot that has booted again listens first: another may lead by now
        self._ready = start + from_seconds(parameters.listen_s)
        self._dealt = 0
        self._switched = 0

    @property
    def dealt(self) -> int:
        """Number of calls that have been dealt with, as far as is known here."""
        return max(self._dealt, self._host.calls)

    @property
    def over(self) -> bool:
        """True if there were calls, and all have been dealt with."""
        return bool(self._calls) and self.dealt >= len(self._calls)

    def tick(self, now: Time) -> None:
        """Make the call that is due, if this robot is host, and nothing is being played."""
        host = self._host
        if not host.leads or now < self._ready:
            return
        self._switch(now)
        at = self.dealt
        if at < len(self._calls) and now >= self.start + self._calls[at][0] and not host.busy:
            self._dealt = at + 1
            self._call(at, now)

    def _switch(self, now: Time) -> None:
        """Make the last switch that is due, unless it was made before, or another since, or the play began later."""
        play, due = self._host.play, self._switched
        if play is None and self._host.busy:
            return  # the plan that is being played will arrive
        while due < len(self._switches) and now >= self.start + self._switches[due][0]:
            due += 1
        if due > self._switched:
            after, strategy = self._switches[due - 1]
            self._switched = due
            if play is not None and not play.ledger.switched_since(self.start + after):
                self._host.say(Switched(strategy=strategy, at=now), now)

    def _call(self, at: int, now: Time) -> None:
        call, starts_m = self._calls[at][1], self._planning.starts_m(now)
        try:
            plan = self._planning.plan(call, self._host.newest + 1, now)
        except UserError as error:
            self._refused(call.play, str(error), "")
            return
        if isinstance(plan, Plan):
            self._host.execute(plan, starts_m, at + 1, now)
        else:
            self._refused(call.play, "; ".join(plan.conflicts), "; ".join(plan.mend))

    def _refused(self, play: str, why: str, mend: str) -> None:
        self._counters.refused += 1
        self._note(events.PlanRefused(play, why, mend))
