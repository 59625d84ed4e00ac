"""From a play to the tasks of a plan: its net, with parameters bound and robots cast.

A play is cast twice: first with numbers for its roles, so that the planner sees what each role does; then with the
robots that the planner has chosen for them.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

from cosim.errors import UserError
from cosim.geometry.polylines import length_m
from cosim.machine import Address
from protocols.deployment.planning.binding import Binder, Binding, Role, Site, near
from protocols.deployment.planning.play import (
    ActStep,
    DeployStep,
    GatherStep,
    Needs,
    NetStep,
    Order,
    Play,
    PlayStep,
    ReturnStep,
    Step,
    labels,
)
from protocols.deployment.planning.playbook import Playbook, named_in
from protocols.deployment.tasks.constraints import Constraint, PlaceName, Quantity, between, quantities_of
from protocols.deployment.tasks.plan import Act, Between, Deployment, Go, Place, Task, actors

LEAST_S: Final = 0.1
"""Lower bound of time-outs."""
_OF_ROBOT: Final = "robot-"
"""Prefix of a robot's address in the label of its drive, where several robots drive."""


@dataclass
class Casting:
    """The tasks of a play, and what was found on the way."""

    root: Task
    roles: dict[str, Role] = field(default_factory=dict)
    """Roles that its tasks mention."""
    numbers: dict[Address, str] = field(default_factory=dict)
    """Role of each robot, or of the number that stands for it."""
    between: list[Between] = field(default_factory=list)
    faults: list[tuple[str, float | None]] = field(default_factory=list)
    """Gatherings that have no room, in words, and the distance (m) at which they would have."""
    unused: tuple[str, ...] = ()
    """Labels that lead from the root down to tasks that are not expanded yet."""
    binding: Binding | None = None
    """Values of the play's parameters."""


def cast(
    playbook: Playbook,
    path: str,
    inner: Sequence[str],
    given: Mapping[str, Any],
    site: Site,
    robots: Mapping[str, Address] | None = None,
    homes_m: Mapping[Address, Place] | None = None,
) -> Casting:
    """Return the play at *path*, or the task of it that the labels *inner* lead to, as tasks; raise UserError.

    *robots*: the robot of each role; None: each role is played by its own number, in the order of first mention, and
    the home of every robot is the base.
    """
    play = playbook.play(path)
    caster = _Caster(playbook, site, robots, homes_m or {})
    binding = caster.binder.bind(play, path, given, None, "")
    root, unused = caster.net(path.rpartition("/")[2], play, binding, tuple(inner))
    used = {robot for task in root.walk() for robot in actors(task.act)}
    roles = {name: role for name, role in caster.binder.roles.items() if caster.address(name) in used}
    numbers = {caster.address(name): name for name in roles}
    return Casting(root, roles, numbers, caster.between, caster.faults, unused, binding)


class _Caster:
    """One walk down a play and the plays in it."""

    def __init__(
        self, playbook: Playbook, site: Site, robots: Mapping[str, Address] | None, homes_m: Mapping[Address, Place]
    ) -> None:
        self.playbook, self.site = playbook, site
        self.binder = Binder(site)
        self.between: list[Between] = []
        self.faults: list[tuple[str, float | None]] = []
        self._robots, self._homes_m = robots, homes_m

    def address(self, role: str) -> Address:
        """Return the robot that plays *role*."""
        return list(self.binder.roles).index(role) if self._robots is None else self._robots.get(role, -1)

    def _addresses(self, binding: Binding, names: Sequence[str]) -> tuple[Address, ...]:
        return tuple(self.address(role) for role in binding.roles_of(names))

    def each_once(self, binding: Binding, names: Sequence[str]) -> tuple[Address, ...]:
        """Return the robots that *names* stand for, each once."""
        return tuple(dict.fromkeys(self._addresses(binding, names)))

    # ------------------------------------------------------------ nets

    def net(
        self, name: str, net: Play | NetStep, binding: Binding, inner: tuple[str, ...]
    ) -> tuple[Task, tuple[str, ...]]:
        """Return the task of a net; or the task to which *inner* labels lead, with the labels that are left."""
        steps = dict(zip(labels(net.tasks), net.tasks, strict=True))
        if not inner:
            binding.want(named_in(net))
        if inner:
            label, *rest = inner
            if label not in steps and len(steps) == 1:  # its only task may be left out
                label, rest = next(iter(steps)), list(inner)
            if label not in steps:
                raise UserError(f"{binding.source}: there is no task {label!r} in {name}{near(label, steps)}")
            return self.step(label, label, steps[label], binding, tuple(rest))
        subtasks = [self.step(f"{name}/{label}", label, step, binding)[0] for label, step in steps.items()]
        self._constrain(name, net.constraints, binding)
        return self._task(name, net.order, subtasks), ()

    def _task(self, name: str, order: Order, subtasks: Sequence[Task]) -> Task:
        return Task(name=name, label=name.rpartition("/")[2], order=order, subtasks=tuple(subtasks))

    def _constrain(self, name: str, constraints: Sequence[Constraint], binding: Binding) -> None:
        for constraint in constraints:
            numbers = {key: binding.number_of(value) for key, value in quantities_of(constraint).items()}
            self.between.append(between(constraint, name, numbers, binding.source))

    def step(
        self, name: str, label: str, step: Step, binding: Binding, inner: tuple[str, ...] = ()
    ) -> tuple[Task, tuple[str, ...]]:
        """Return the task of a *step*; or the task to which *inner* labels lead, with the labels that are left."""
        if not (inner and isinstance(step, NetStep)):
            binding.want(named_in(step))
        match step:
            case NetStep():
                task, left = self.net(name, step, binding, inner)
            case PlayStep():
                play = self.playbook.play(step.play)
                bound = self.binder.bind(play, step.play, step.given, binding, f"{name}/")
                task, left = self.net(name, play, bound, inner)
            case ReturnStep():
                task, left = self._picked(name, self._return(name, step, binding), inner)
            case GatherStep():
                task, left = self._picked(name, self._gather(name, step, binding), inner)
            case _:
                task, left = Task(name=name, label=label, act=self._act(step, binding)), inner
        if inner and isinstance(step, NetStep | PlayStep):
            return task, left
        time_out_s = None if step.time_out_s is None else binding.number_of(step.time_out_s, LEAST_S)
        ends_with = None if step.ends_with is None or "/" not in name else f"{name.rpartition('/')[0]}/{step.ends_with}"
        return task.model_copy(
            update={"label": label, "time_out_s": time_out_s, "on_failure": step.on_failure, "ends_with": ends_with}
        ), left

    def _picked(self, name: str, goes: Sequence[Task], inner: tuple[str, ...]) -> tuple[Task, tuple[str, ...]]:
        """Return parallel moves, and the *inner* labels: they are picked once the robots of the moves are known."""
        return self._task(name, "parallel", goes), inner

    # ------------------------------------------------------------ acts

    def _act(self, step: ActStep | DeployStep, binding: Binding) -> Act:
        return self._deployment(step, binding) if isinstance(step, DeployStep) else step.act(_Cast(self, binding))

    def _deployment(self, step: DeployStep, binding: Binding) -> Deployment:
        robots, places = self._addresses(binding, step.robots), binding.places_of(step.places)
        if not places:
            raise UserError(f"{binding.source}: {', '.join(map(str, step.places))} is no place, expected one at least")
        if len(robots) != len(places) or len(set(robots)) < len(robots):
            raise UserError(
                f"{binding.source}: {len(robots)} robots are to deploy to {len(places)} places, expected one place each"
            )
        if step.ordered == "nearest":
            places = tuple(sorted(places, key=self._far))
        strategy = binding.strategy_of(step.strategy)
        return Deployment(strategy=strategy, robots=robots, places_m=places, augmented=step.augmented)

    def _far(self, place: Place) -> float:
        length = self.site.ways.length_m(self.site.radius_m, self.site.base_m, place)
        return math.inf if length is None else length

    def _return(self, name: str, step: ReturnStep, binding: Binding) -> list[Task]:
        return [
            _go(name, Go(robot=robot, place_m=self._homes_m.get(robot, self.site.base_m)))
            for robot in self.each_once(binding, step.robots)
        ]

    def _gather(self, name: str, step: GatherStep, binding: Binding) -> list[Task]:
        robots, at = self.each_once(binding, step.robots), binding.place_of(step.at)
        apart_m, towards = binding.number_of(step.apart_m, 0.0), next(iter(binding.places_of(step.towards)), at)
        apart_m = min(apart_m, self.site.apart_m)
        way = self.site.ways.way(self.site.radius_m, at, towards)
        needed_m, there_m = apart_m * (len(robots) - 1), length_m(way or [at])
        if there_m < needed_m:
            there = f"there are {there_m:.1f} m" if way else "there is none"
            wanted = f"{len(robots)} robots {apart_m:g} m apart want {needed_m:g} m of way"
            wanted += f" from {shown(at)} to {shown(towards)}"
            most_m = math.floor(there_m / (len(robots) - 1) * 100.0) / 100.0
            self.faults.append((f"{name}: {wanted}, and {there}", most_m if way else None))
        goes = list[Task]()
        for number, robot in enumerate(robots):
            place = _along(way or [at], needed_m - number * apart_m)
            ahead = robots[number - 1] if number and step.staggered else None
            behind_m = apart_m if ahead is not None else 0.0
            goes.append(_go(name, Go(robot=robot, place_m=place, behind=ahead, behind_m=behind_m, final=False)))
        return goes


class _Cast:
    """What names stand for in one play, for the tasks of which each is one act."""

    def __init__(self, caster: _Caster, binding: Binding) -> None:
        self._caster, self._binding = caster, binding

    def robot(self, name: str, needs: Needs | None = None) -> Address:
        role = self._binding.role_of(name)
        if needs is not None:
            self._caster.binder.need(role, needs)
        return self._caster.address(role)

    def robots(self, names: Sequence[str]) -> tuple[Address, ...]:
        found = self._caster.each_once(self._binding, names)
        if not found:
            raise UserError(f"{self._binding.source}: {', '.join(names)} stands for no robot, expected one at least")
        return found

    def place(self, name: PlaceName) -> Place:
        return self._binding.place_of(name)

    def places(self, names: Sequence[PlaceName]) -> tuple[Place, ...]:
        return self._binding.places_of(names)

    def number(self, quantity: Quantity, least: float = -math.inf) -> float:
        return self._binding.number_of(quantity, least)


def _go(parent: str, act: Go) -> Task:
    label = f"{_OF_ROBOT}{act.robot}"
    return Task(name=f"{parent}/{label}", label=label, act=act)


def of_robot(name: str) -> bool:
    """Return whether the drive of that name is labelled by its robot."""
    return name.rpartition("/")[2].startswith(_OF_ROBOT)


def picked(task: Task, inner: Sequence[str]) -> Task:
    """Return the task below *task* to which the labels *inner* lead; raise UserError if there is none."""
    for label in inner:
        below = {each.name.rpartition("/")[2]: each for each in task.subtasks}
        if label not in below:
            raise UserError(f"there is no task {label!r} in {task.name}{near(label, below)}")
        task = below[label]
    return task


def shown(place: Place) -> str:
    """Return a place in words."""
    return f"({place[0]:g}, {place[1]:g})"


def _along(way: Sequence[Place], ahead_m: float) -> Place:
    """Return the place on *way* that is *ahead_m* from its beginning, or its end."""
    for a, b in pairwise(way):
        length = math.dist(a, b)
        if ahead_m <= length and length > 0:
            share = max(ahead_m, 0.0) / length
            return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
        ahead_m -= length
    return way[-1]
