"""Facts about a plan under way, each with the instant at which it became true.

What has happened to a plan is a function of the set of its facts, whatever the order in which they were received, and
however often. So robots that have received the same facts agree, and a successor of a dead host goes on where it was.
"""

from bisect import insort
from enum import IntEnum
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from cosim.machine import Address
from cosim.settings import Count, Int64, Settings
from cosim.units import Time
from protocols.deployment.tasks.orders import Report, Result
from protocols.deployment.tasks.plan import Place, Plan, Strategy


class _Rank(IntEnum):
    """Order of facts of one instant."""

    REPORT = 0
    FOUND = 1
    LOST = 2
    SWITCH = 3
    TERMINATE = 4


class Ended(Settings):
    """A robot has ended an order."""

    fact: Literal["ended"] = "ended"
    task: str
    robot: Count = Field(ge=0)
    result: Result
    why: str = ""
    at: Int64

    @property
    def rank(self) -> int:
        """Among facts of one instant."""
        return _Rank.REPORT

    @property
    def surer(self) -> tuple[bool, bool, Time]:
        """Rank among reports about one order, of which the smallest counts."""
        # what was done stays done, whatever another report says
        return self.result is not Result.DONE, self.result is not Result.FAILED, self.at


class Heard(Settings):
    """A robot has fallen silent, or was heard again."""

    fact: Literal["heard"] = "heard"
    robot: Count = Field(ge=0)
    again: bool
    place_m: Place | None = Field(default=None, description="m, last known place of a robot that fell silent")
    at: Int64

    @property
    def rank(self) -> int:
        """Among facts of one instant."""
        return _Rank.FOUND if self.again else _Rank.LOST


class Switched(Settings):
    """Deployments are to go on by another strategy."""

    fact: Literal["switched"] = "switched"
    strategy: Strategy
    at: Int64

    @property
    def rank(self) -> int:
        """Among facts of one instant."""
        return _Rank.SWITCH


class Terminated(Settings):
    """A task is to end, with all below it."""

    fact: Literal["terminated"] = "terminated"
    task: str
    at: Int64

    @property
    def rank(self) -> int:
        """Among facts of one instant."""
        return _Rank.TERMINATE


Fact: TypeAlias = Annotated[Ended | Heard | Switched | Terminated, Field(discriminator="fact")]


def order(fact: Fact) -> tuple[Time, int, str]:
    """Return the key by which facts are ordered."""
    return fact.at, fact.rank, fact.model_dump_json()


def ended(report: Report) -> Ended:
    """Return a robot's report as a fact."""
    return Ended(task=report.task, robot=report.robot, result=report.result, why=report.why, at=report.at)


class Record(Settings):
    """Everything that is needed to go on with a plan; a host sends it to all, so that any of them can succeed it."""

    plan: Plan
    start: Int64
    starts_m: dict[Count, Place] = Field(default_factory=dict, description="m, where robots stood; else at base")
    facts: tuple[Fact, ...] = ()
    serials: dict[Count, Count] = Field(default_factory=dict, description="next serial number, by robot")


class Book:
    """A set of facts, in their order."""

    def __init__(self) -> None:
        self.facts: list[Fact] = []
        self._ends: dict[tuple[str, Address], Ended] = {}

    def lost(self, robot: Address) -> bool:
        """Return whether a robot is lost, by the last fact about that."""
        return any(not fact.again for fact in self._heard(robot)[-1:])

    def _heard(self, robot: Address) -> list[Heard]:
        return [fact for fact in self.facts if isinstance(fact, Heard) and fact.robot == robot]

    def knows_of(self, fact: Fact) -> bool:
        """Return whether there is a report already about what *fact* reports."""
        return isinstance(fact, Ended) and (fact.task, fact.robot) in self._ends

    def keep(self, fact: Fact) -> bool:
        """Add a fact; return whether it is new. Of two reports about one order the surer one is kept."""
        if isinstance(fact, Ended):
            known = self._ends.get((fact.task, fact.robot))
            if known is not None:
                if known.surer <= fact.surer:
                    return False
                self.facts.remove(known)
            self._ends[fact.task, fact.robot] = fact
        elif fact in self.facts:
            return False
        insort(self.facts, fact, key=order)
        return True
