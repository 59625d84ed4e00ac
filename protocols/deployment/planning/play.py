"""Plays as people write them: hierarchical task networks in YAML (paper 004, section 4).

"The playbook interface provides easy access to a set of pre-defined mission profiles", each parameterised by robots and
places. A play is a net of tasks, done one after the other or in parallel, under temporal constraints; or it holds other
plays, so that plays form a tree. This module is the model of the YAML; :mod:`protocols.deployment.planning.playbook`
holds the tree and checks names, and :mod:`protocols.deployment.planning.casting` makes tasks of a play::

    about: Two robots to two places, the one with a camera takes a picture of the second.
    parameters:
      guard: {kind: robot}
      scout: {kind: robot, needs: {camera: true}}
      near: {kind: place}
      far: {kind: place}
    tasks:
      - {kind: deploy, label: out, strategy: wave, robots: [guard, scout], places: [near, far], time_out_s: 300}
      - {kind: photo, robot: scout}
    constraints:
      - {kind: deadline, seconds: 400}
"""

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Final, Literal, Protocol, TypeAlias

from pydantic import Field, JsonValue

from cosim.machine import Address
from cosim.settings import Metres, Settings
from protocols.deployment.tasks.constraints import Constraint, Number, PlaceName, Quantity
from protocols.deployment.tasks.plan import Explore, Face, Go, Photo, Place, Strategy, Wait

Order: TypeAlias = Literal["serial", "parallel"]
LABEL: Final = r"^[a-z0-9][a-z0-9_-]*$"
Label: TypeAlias = Annotated[str, Field(pattern=LABEL)]
Names: TypeAlias = Annotated[tuple[str, ...], Field(min_length=1)]
"""Names of parameters that stand for one or several robots each."""
MOST_ROBOTS: Final = 256  # addresses are single bytes
"""Greatest number of robots, and of places, that a play can name."""


class Needs(Settings):
    """What a robot must have for its role."""

    camera: bool = False
    sensor: Literal["laser", "sonar"] | None = Field(default=None, description="None: either")
    passage_m: Metres | None = Field(
        default=None, gt=0, description="m, width of the narrowest passage that it must get through"
    )


# ---------------------------------------------------------------- parameters


class RobotParameter(Settings):
    """A single robot; the planner chooses it unless the call names it."""

    kind: Literal["robot"] = "robot"
    about: str = ""
    needs: Needs = Needs()


class RobotsParameter(Settings):
    """Several robots: a number, their addresses, or as many as there are places."""

    kind: Literal["robots"] = "robots"
    about: str = ""
    needs: Needs = Needs()
    as_many_as: str | None = Field(default=None, description="parameter that has as many places")
    default: int | None = Field(
        default=None, ge=1, le=MOST_ROBOTS, description="number of robots; None without as_many_as: the call must say"
    )


class PlaceParameter(Settings):
    """A place."""

    kind: Literal["place"] = "place"
    about: str = ""
    default: PlaceName | None = None


class PlacesParameter(Settings):
    """Several places."""

    kind: Literal["places"] = "places"
    about: str = ""
    default: tuple[PlaceName, ...] | None = None


class NumberParameter(Settings):
    """A number."""

    kind: Literal["number"] = "number"
    about: str = ""
    default: Number | None = None
    least: Number | None = None
    most: Number | None = None


class StrategyParameter(Settings):
    """One of the three deployments."""

    kind: Literal["strategy"] = "strategy"
    about: str = ""
    default: Strategy | None = None


Parameter: TypeAlias = Annotated[
    RobotParameter | RobotsParameter | PlaceParameter | PlacesParameter | NumberParameter | StrategyParameter,
    Field(discriminator="kind"),
]


# ---------------------------------------------------------------- tasks


class Cast(Protocol):
    """What the names in a task stand for; each method raises UserError for a name of something else."""

    def robot(self, name: str, needs: Needs | None = None) -> Address:
        """Return the one robot of that name, which is to have what the task *needs*."""

    def robots(self, names: Sequence[str]) -> tuple[Address, ...]:
        """Return the robots of those names, each once, one at least."""

    def place(self, name: PlaceName) -> Place:
        """Return the one place of that name."""

    def places(self, names: Sequence[PlaceName]) -> tuple[Place, ...]:
        """Return the places of those names, in order."""

    def number(self, quantity: Quantity, least: float = -math.inf) -> float:
        """Return the number, *least* or more, that a quantity is or stands for."""


class _Step(Settings):
    names_robots: ClassVar[tuple[str, ...]] = ()
    """Fields that name parameters which are robots; the next two: places, and numbers."""
    names_places: ClassVar[tuple[str, ...]] = ()
    names_numbers: ClassVar[tuple[str, ...]] = ()

    label: Label | None = Field(default=None, description="None: its kind, numbered if there are several")
    time_out_s: Quantity | None = Field(
        default=None, description="s, time after its start at which it fails if it has not ended"
    )
    on_failure: Literal["fail", "skip", "retry"] = "fail"
    ends_with: str | None = Field(default=None, description="task of the same net whose end terminates it")


class GoStep(_Step):
    """A robot drives to a place."""

    names_robots = ("robot",)
    names_places = ("to", "via")

    kind: Literal["go"] = "go"
    robot: str
    to: PlaceName
    via: tuple[PlaceName, ...] = ()

    def act(self, cast: Cast) -> Go:
        """Return what the robot is to do."""
        return Go(robot=cast.robot(self.robot), place_m=cast.place(self.to), via_m=cast.places(self.via))


class PhotoStep(_Step):
    """A robot with a camera takes a picture."""

    names_robots = ("robot",)
    names_numbers = ("heading_rad",)

    kind: Literal["photo"] = "photo"
    robot: str
    heading_rad: Quantity | None = None

    def act(self, cast: Cast) -> Photo:
        """Return what the robot is to do."""
        heading_rad = None if self.heading_rad is None else cast.number(self.heading_rad)
        return Photo(robot=cast.robot(self.robot, Needs(camera=True)), heading_rad=heading_rad)


class FaceStep(_Step):
    """A robot turns towards a place."""

    names_robots = ("robot",)
    names_places = ("towards",)

    kind: Literal["face"] = "face"
    robot: str
    towards: PlaceName

    def act(self, cast: Cast) -> Face:
        """Return what the robot is to do."""
        return Face(robot=cast.robot(self.robot), towards_m=cast.place(self.towards))


class WaitStep(_Step):
    """Time passes."""

    names_numbers = ("seconds",)

    kind: Literal["wait"] = "wait"
    seconds: Quantity

    def act(self, cast: Cast) -> Wait:
        """Return how long nothing is to be done."""
        return Wait(seconds=cast.number(self.seconds, 0.0))


class ExploreStep(_Step):
    """Robots explore the floor."""

    names_robots = ("robots",)

    kind: Literal["explore"] = "explore"
    robots: Names

    def act(self, cast: Cast) -> Explore:
        """Return what the robots are to do."""
        return Explore(robots=cast.robots(self.robots))


class DeployStep(_Step):
    """Robots deploy to as many places by one of the strategies of Fig. 3."""

    names_robots = ("robots",)
    names_places = ("places",)

    kind: Literal["deploy"] = "deploy"
    strategy: Strategy | str = "group"
    robots: Names
    places: tuple[PlaceName, ...] = Field(min_length=1)
    ordered: Literal["nearest", "given"] = Field(
        default="given", description="nearest: the place nearest to base first"
    )
    augmented: bool = True


class GatherStep(_Step):
    """Robots drive in parallel to one place, as in a stage of a group deployment; the first named stands in front.

    They end up along the way from there to another place (the first, of several), to which they go next.
    """

    names_robots = ("robots",)
    names_places = ("at", "towards")
    names_numbers = ("apart_m",)

    kind: Literal["gather"] = "gather"
    robots: Names
    at: PlaceName
    towards: PlaceName
    apart_m: Quantity = 1.5
    staggered: bool = Field(default=True, description="true if each sets off when the one in front is apart_m away")


class ReturnStep(_Step):
    """Robots drive back to their own places at base "in a concurrent, but uncoordinated, fashion" (section 7)."""

    names_robots = ("robots",)

    kind: Literal["return"] = "return"
    robots: Names


class PlayStep(_Step):
    """Another play, by its path in the tree."""

    kind: Literal["play"] = "play"
    play: str
    given: dict[str, JsonValue] = Field(
        default_factory=dict, description="its parameters: values, or parameters of this play"
    )


class NetStep(_Step):
    """Tasks one after the other, or in parallel."""

    kind: Literal["net"] = "net"
    order: Order = "serial"
    tasks: tuple["Step", ...] = Field(min_length=1)
    constraints: tuple[Constraint, ...] = ()


ActStep: TypeAlias = GoStep | PhotoStep | FaceStep | WaitStep | ExploreStep
"""Tasks that are one act, by their names."""
Step: TypeAlias = Annotated[
    ActStep | DeployStep | GatherStep | ReturnStep | PlayStep | NetStep,
    Field(discriminator="kind"),
]


class Play(Settings):
    """A net of tasks with parameters, or a folder of plays; a call of a folder means the quickest play in it."""

    about: str = ""
    plays: dict[Label, "Play"] = Field(default_factory=dict, description="of a folder")
    parameters: dict[Label, Parameter] = Field(default_factory=dict)
    order: Order = "serial"
    tasks: tuple[Step, ...] = ()
    constraints: tuple[Constraint, ...] = ()


def labels(tasks: Sequence[Step]) -> list[str]:
    """Return the labels of *tasks*: their own, or their kinds, numbered from 1 if there are several of a kind."""
    unnamed = [task.kind for task in tasks if task.label is None]
    names, counts = list[str](), dict[str, int]()
    for task in tasks:
        counts[task.kind] = counts.get(task.kind, 0) + (task.label is None)
        numbered = f"{task.kind}-{counts[task.kind]}" if unnamed.count(task.kind) > 1 else task.kind
        names.append(task.label or numbered)
    return names
