"""The board on which robots and their host note how the play stands, for the judge alone.

Who is under way, to where, and how fast it would be without the others is in no true position: so each member says it
here as it happens, and the referee reads it beside the truth. No machine reads the board: nothing on it is a message.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from cosim.machine import Address
from cosim.units import Time, to_seconds
from protocols.deployment.interference import Shortfall
from protocols.deployment.tasks.plan import Deployment, Go, Place, Plan, Task

ADDED: Final = "~"
"""In the names of tasks that the executive adds to a plan."""


def stage_of(task: str) -> str | None:
    """Return the name of the stage that a drive belongs to: the task above it (in a strategy ``.../stage-N``).

    None for a drive that the plan does not have: a robot that has made way comes back (its name holds ``ADDED``).
    """
    return None if ADDED in task else task.rpartition("/")[0]


def ends_m(root: Task) -> dict[Address, Place]:
    """Return where each robot is to be when all of a task net is done: the last place in it that is its own.

    Of a strategy that is expanded the subtasks count, not the act.
    """
    found: dict[Address, Place] = {}
    for act in (task.act for task in root.walk() if task.leaf):
        if isinstance(act, Go) and act.final:
            found[act.robot] = act.place_m
        elif isinstance(act, Deployment):
            found |= dict(zip(act.robots, act.places_m, strict=True))
    return found


@dataclass(frozen=True)
class Begun:
    """A plan whose execution has begun."""

    number: int
    at: Time
    robots: tuple[Address, ...]
    """All that it makes use of."""
    places_m: tuple[Place, ...]
    """Where robots are to be in the end."""


@dataclass
class Standing:
    """What is known of one robot."""

    shortfall: Shortfall
    task: str | None = None
    """The drive that it is at, by the name of its task."""
    waited_ticks: int = 0
    """Ticks in which it waited for its turn, as ordered (a staggered start)."""


@dataclass
class Board:
    """How the play stands."""

    tick: Time
    robots: list[Standing]
    begun: list[Begun] = field(default_factory=list)

    @classmethod
    def of(cls, size: int, tick: Time) -> "Board":
        """Return the empty board of a team of *size*."""
        return cls(tick, [Standing(Shortfall(tick)) for _ in range(size)])

    # ------------------------------------------------------------ what hosts write

    def begins(self, plan: Plan, now: Time) -> None:
        """Note that *plan* begins to be executed; again, by a successor of its host for example, changes nothing."""
        if all(each.number != plan.number for each in self.begun):
            self.begun.append(Begun(plan.number, now, plan.robots, tuple(ends_m(plan.root).values())))

    # ------------------------------------------------------------ what members write

    def drives(self, robot: Address, task: str, waits: bool, pace_mps: tuple[float, float] | None) -> None:
        """Note a tick in which *robot* is at an order to drive (a ``Go``), that of *task*.

        *waits*: it waits for its turn, as the order says. *pace_mps*: how fast it goes, and would go without the others
        (:class:`protocols.deployment.driving.double.Double`); None if it is not under way.
        """
        own = self.robots[robot]
        if waits:
            own.waited_ticks += 1
            return
        own.task = task
        if pace_mps is not None:
            own.shortfall.note(*pace_mps)

    def ends(self, robot: Address) -> None:
        """Note that *robot* is at no such order any more, however it ended."""
        self.robots[robot].task = None

    # ------------------------------------------------------------ what the referee reads

    def lost_s(self) -> float:
        """Return the robot-seconds that were lost to other robots."""
        return sum(each.shortfall.lost_s for each in self.robots)

    def hindered_s(self) -> float:
        """Return the robot-seconds in which robots were slower than they would have been without others."""
        return sum(each.shortfall.hindered_s for each in self.robots)

    def under_way_s(self) -> float:
        """Return the robot-seconds in which robots were under way to a goal."""
        return sum(each.shortfall.under_way_s for each in self.robots)

    def waited_s(self) -> float:
        """Return the robot-seconds in which robots waited for their turn."""
        return sum(each.waited_ticks for each in self.robots) * to_seconds(self.tick)

    def driving(self) -> Iterable[tuple[Address, str]]:
        """Yield the robots that are at an order to drive, each with the name of its task."""
        return ((robot, each.task) for robot, each in enumerate(self.robots) if each.task is not None)
