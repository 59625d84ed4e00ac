"""What planner and console share: a call is planned for the robots that live, from where they are."""

from collections.abc import Callable

from cosim.machine import Address
from cosim.units import Time
from protocols.deployment.knowledge import Knowledge
from protocols.deployment.member import Member
from protocols.deployment.parameters import Parameters
from protocols.deployment.plan import Place, Plan
from protocols.deployment.planner import Call, Planner, Refusal


class Planning:
    """The planner, as the host asks it."""

    def __init__(
        self, parameters: Parameters, knowledge: Knowledge, member: Member, silent: Callable[[Address, Time], bool]
    ) -> None:
        homes_m = dict(enumerate(knowledge.starts_m))
        places = knowledge.named_m, homes_m
        self._planner = Planner(knowledge.playbook, knowledge.crew, knowledge.floor, parameters.planner, *places)
        self._knowledge = knowledge
        self._member = member
        self._silent = silent

    def starts_m(self, now: Time) -> dict[Address, Place]:
        """Return where the robots are that live, as far as is known."""
        own = self._member
        starts = {own.me: own.here}
        for robot in range(self._knowledge.size):
            if robot != own.me and not self._silent(robot, now):
                starts[robot] = own.others.place_m(robot)
        return dict(sorted(starts.items()))

    def plan(self, call: Call, number: int, now: Time) -> Plan | Refusal:
        """Return a plan of that number for *call*, or why there is none; raise UserError for a call that is wrong."""
        return self._planner.call(call, self.starts_m(now), number)

    def expected_s(self, plan: Plan, now: Time) -> float:
        """Return when *plan* would be expected to have ended, s after it began; infinite if nothing can be said."""
        return self._planner.expected_s(plan, self.starts_m(now))
