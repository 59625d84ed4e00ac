"""Planning of calls for the robots that are alive, from where they are; console and timed calls share it."""

from collections.abc import Callable, Mapping

from cosim.machine import Address
from cosim.units import Time, to_seconds
from protocols.deployment.driving.exploring import Exploring, Outlook, explorable
from protocols.deployment.driving.learned import explained
from protocols.deployment.member.member import Member
from protocols.deployment.parameters import Parameters
from protocols.deployment.planning.planner import Call, Planner, Refusal
from protocols.deployment.setup import Setup
from protocols.deployment.tasks.crew import Body
from protocols.deployment.tasks.plan import Place, Plan


class Planning:
    """The planner with what the host knows of the team."""

    def __init__(
        self,
        parameters: Parameters,
        setup: Setup,
        member: Member,
        exploring: Exploring,
        silent: Callable[[Address, Time], bool],
        heard: Callable[[Address], Time],
    ) -> None:
        """Take what the host knows: *silent*, whether a robot is taken for lost; *heard*, when it was heard last."""
        homes_m = dict(enumerate(setup.starts_m))
        places = setup.named_m, homes_m
        asked = setup.playbook, setup.crew, setup.floor, parameters.planner
        self._planner = Planner(*asked, *places, executing=parameters.executing, exploring=self._explored_s)
        least_share = parameters.planner.timing.least_share
        ground, named_m = setup.ground, setup.named_m
        self._outlook = Outlook(parameters.exploring, ground, setup.floor, named_m, least_share)
        self._exploring = exploring
        self._setup = setup
        self._member = member
        self._silent = silent
        self._heard = heard

    def starts_m(self, now: Time) -> dict[Address, Place]:
        """Return the known places of the robots that are alive."""
        own = self._member
        starts = {own.me: own.here}
        for robot in range(self._setup.size):
            if robot != own.me and not self._silent(robot, now):
                starts[robot] = own.others.place_m(robot)
        return dict(sorted(starts.items()))

    def plan(self, call: Call, number: int, now: Time) -> Plan | Refusal:
        """Return a plan for *call* with that number, or a refusal; raise UserError for a call that is wrong."""
        starts_m = self.starts_m(now)
        lost = [robot for robot in range(self._setup.size) if robot not in starts_m]
        unheard_s = {robot: to_seconds(now - self._heard(robot)) for robot in lost}
        found = explained(self._planner.call(call, starts_m, number, unheard_s), self._setup.floor)
        return explorable(found, self._setup.ground, self._setup.crew)

    def expected_s(self, plan: Plan, now: Time) -> float:
        """Return the expected end of *plan*, s after its begin; infinite if it is not known."""
        return self._planner.expected_s(plan, self.starts_m(now))

    def _explored_s(self, explorers: Mapping[Address, Body], places_m: Mapping[Address, Place]) -> float:
        """Return the least time of exploring, s; 0 if it is not known."""
        # once exploring has begun, others may have seen more than is known here
        return 0.0 if self._exploring.begun else self._outlook.least_s(explorers, places_m)

    def windows_s(self, plan: Plan, now: Time) -> dict[str, list[float | None]]:
        """Return the earliest and latest start and end of each task of *plan*, s after its begin; None: no limit."""
        windows: dict[str, list[float | None]] = {}
        for instant, span_s in self._planner.windows_s(plan, self.starts_m(now)).items():
            at = 0 if instant.edge == "start" else 2
            windows.setdefault(instant.task, [None] * 4)[at : at + 2] = span_s
        return windows
