"""The serialised plan, which the planner sends to the executive, and the executive to the robots.

After the Plan Representation Language (paper 004, section 5): "PRL defines each task in terms of parameters, subtasks,
and temporal constraints between subtasks", and the whole hierarchy is sent, not only its leaves. So an executive can
report on any task, end a whole subtree by one command, and expand the deployments that the planner has left as a
strategy (:class:`Deployment`). ``Plan.model_json_schema()`` is the schema.
"""

from collections.abc import Iterator
from typing import Annotated, Final, Literal, Self, TypeAlias, get_args

from pydantic import Field, model_validator

from cosim.machine import Address
from cosim.settings import Angle, Count, Metres, Settings

MOST: Final = 1e9
"""Upper bound of coordinates (m) and times (s) in a play or a plan; messages have no room for more."""
Coordinate: TypeAlias = Annotated[float, Field(ge=-MOST, le=MOST)]
Place: TypeAlias = tuple[Coordinate, Coordinate]
Strategy: TypeAlias = Literal["group", "wave", "leap_frog"]
Unstaged: TypeAlias = Literal["direct", "fixed"]
"""Kinds of deployment without stages: all drive to their places at once, from wherever they are."""
Staging: TypeAlias = Strategy | Unstaged

UNSTAGED: Final = get_args(Unstaged)

Edge: TypeAlias = Literal["start", "end"]
"""Which of the two instants of a task."""
ORIGIN: Final = ""
"""Stands for a task's name: the instant at which the plan begins to be executed."""


class Go(Settings):
    """One robot drives to a place, and stays there.

    Fields for the executive's augmentations are None or empty in a plan that was not augmented (section 5).
    """

    act: Literal["go"] = "go"
    robot: Count = Field(ge=0)
    place_m: Place
    via_m: tuple[Place, ...] = Field(default=(), description="m, waypoints, in their order")
    behind: Count | None = Field(default=None, description="robot that must be ahead before this one sets off")
    behind_m: Metres = Field(default=0.0, ge=0, description="m, how far it must be ahead, if it lives and moves")
    final: bool = Field(default=True, description="true if the robot is to end up there, false if it passes a stage")

    @model_validator(mode="after")
    def _behind_another(self) -> Self:
        if self.behind == self.robot:
            raise ValueError(f"robot {self.robot} is to set off behind itself")
        return self


class Photo(Settings):
    """One robot takes a picture of what is in front of it, or in a direction, where it stands. Needs a camera."""

    act: Literal["photo"] = "photo"
    robot: Count = Field(ge=0)
    heading_rad: Angle | None = None

    @property
    def turns(self) -> bool:
        """True if the robot may have to turn."""
        return self.heading_rad is not None


class Face(Settings):
    """One robot turns towards a place, where it stands, as to "monitor for intruders" (paper 004, section 2)."""

    act: Literal["face"] = "face"
    robot: Count = Field(ge=0)
    towards_m: Place

    @property
    def turns(self) -> bool:
        """True if the robot may have to turn."""
        return True


class Wait(Settings):
    """Time passes."""

    act: Literal["wait"] = "wait"
    seconds: float = Field(ge=0, le=MOST)


class Explore(Settings):
    """Robots explore the floor by the exploration protocol, until nothing is left to see."""

    act: Literal["explore"] = "explore"
    robots: tuple[Count, ...] = Field(min_length=1)


class Deployment(Settings):
    """Robots deploy to as many places by one of the strategies of Fig. 3: ``robots[i]`` ends up at ``places_m[i]``.

    ``direct`` is for teams that are under way already, in no order: the assignment to the places is that of least cost.
    With ``fixed`` each robot goes to its own place, and none to that of a lost robot. A deployment stands for the
    subtasks that the executive makes of it, unless the planner has expanded it.
    """

    act: Literal["deploy"] = "deploy"
    strategy: Staging
    robots: tuple[Count, ...] = Field(min_length=1)
    places_m: tuple[Place, ...] = Field(min_length=1)
    augmented: bool = Field(default=True, description="offsets, staggered starts, stepping aside (section 5)")

    @model_validator(mode="after")
    def _one_place_each(self) -> Self:
        if len(self.robots) != len(self.places_m) or len(set(self.robots)) < len(self.robots):
            raise ValueError(f"{len(self.robots)} robots, {len(self.places_m)} places: each robot needs one of its own")
        return self


Standing: TypeAlias = Photo | Face
"""What one robot does where it stands."""
RobotAct: TypeAlias = Go | Standing | Explore
"""What robots are ordered to do."""
Act: TypeAlias = Annotated[RobotAct | Wait | Deployment, Field(discriminator="act")]


def actors(act: Act | None) -> tuple[Address, ...]:
    """Return the robots that do an act, in the order in which it names them."""
    if act is None or isinstance(act, Wait):
        return ()
    return act.robots if isinstance(act, Explore | Deployment) else (act.robot,)


class Task(Settings):
    """A node of the plan: an act, or subtasks, or (a :class:`Deployment` that has been expanded) both."""

    name: str = Field(min_length=1, description="unique in its plan: the path of labels, as in deploy/stage-2/robot-1")
    label: str = Field(default="", description="its name in the play")
    act: Act | None = None
    order: Literal["serial", "parallel"] = Field(default="serial", description="of the subtasks")
    subtasks: tuple["Task", ...] = ()
    time_out_s: float | None = Field(
        default=None, gt=0, le=MOST, description="s after its start: fails if it has not ended"
    )
    on_failure: Literal["fail", "skip", "retry"] = Field(
        default="fail", description="what its failure means to its parent; retry: fail if it fails twice"
    )
    ends_with: str | None = Field(default=None, description="task whose end, however it ends, terminates this one")

    @property
    def leaf(self) -> bool:
        """True if it has no subtasks."""
        return not self.subtasks

    def walk(self) -> Iterator["Task"]:
        """Yield this task and all below it, parents first."""
        yield self
        for task in self.subtasks:
            yield from task.walk()


class Instant(Settings):
    """The start or the end of a task, or of the plan itself by the name ``ORIGIN``."""

    task: str = ORIGIN
    edge: Edge = "start"


class Between(Settings):
    """A temporal constraint: *later* is from *at_least_s* to *at_most_s* after *earlier* (section 5)."""

    earlier: Instant = Field(default_factory=Instant)
    later: Instant
    at_least_s: float = Field(default=0.0, ge=-MOST, le=MOST)
    at_most_s: float | None = Field(default=None, ge=-MOST, le=MOST, description="s; None: any time later")
    why: str = Field(default="", description="in words, for a person, with who asked for it")


class Plan(Settings):
    """A whole task net."""

    number: Count = Field(ge=0, description="of the plan; a plan of a higher number replaces one of a lower")
    play: str = Field(description="path of the play in its library")
    robots: tuple[Count, ...] = Field(description="all robots that it uses")
    root: Task
    constraints: tuple[Between, ...] = ()

    @model_validator(mode="after")
    def _names_agree(self) -> Self:
        names = [task.name for task in self.root.walk()]
        if len(set(names)) < len(names):
            raise ValueError(f"two tasks are called {next(name for name in names if names.count(name) > 1)!r}")
        wanted = {each.task for between in self.constraints for each in (between.earlier, between.later)} - {ORIGIN}
        wanted |= {task.ends_with for task in self.root.walk() if task.ends_with is not None}
        for name in sorted(wanted - set(names)):
            raise ValueError(f"names {name!r}, which is no task of it")
        return self

    @property
    def tasks(self) -> dict[str, Task]:
        """All tasks by their names, parents first."""
        return {task.name: task for task in self.root.walk()}


def ends_m(root: Task) -> dict[Address, Place]:
    """Return where each robot is to be when a task net is done: the last of its own places there.

    For a deployment that is expanded the subtasks count, not the act.
    """
    found: dict[Address, Place] = {}
    for act in (task.act for task in root.walk() if task.leaf):
        if isinstance(act, Go) and act.final:
            found[act.robot] = act.place_m
        elif isinstance(act, Deployment):
            found |= dict(zip(act.robots, act.places_m, strict=True))
    return found
