"""What becomes of a play that two hosts have led at once, after a partition of the team, or one without a robot.

Each side has taken the other for lost, and has gone on without it: what has happened on one side means nothing in the
tree of tasks of the other. So when they hear of each other, the host that stays makes an end of both, and has all go
straight to the places where the play wanted robots in the end; before that they do what was left to be done where they
stood (pictures), as far as that host has heard. Strategies, waits, windows, what was left to explore and what an
operator has ended are given up. A deployment remains one, of those of its robots that were to end up there: so who is
lost is replaced in it as in any other.

Whom a place takes out of reach is lost again, and the others would go and fill its place, hear of it, and be reunited
again, without end. So from the second time on each has the place that it had in the play, whoever is lost, and
whichever host says so.
"""

from collections.abc import Collection, Mapping
from typing import NamedTuple, TypeAlias

from cosim.machine import Address
from protocols.deployment.tasks.plan import Deployment, Go, Place, Plan, Staging, Standing, Task, ends_m

_ONCE = "/reunited"
_AGAIN = "/reunited-again"

_Acts: TypeAlias = list[Go | Standing]
_Cast: TypeAlias = dict[Address, Place]


class Past(NamedTuple):
    """What is known to have happened to a plan."""

    done: Collection[str] = ()
    """Names of tasks that need not be done again."""
    given_up: Collection[str] = ()
    """Names of tasks that an operator has ended."""
    casts: Mapping[str, tuple[Address, ...]] = {}
    """Who is to end up at each place of a deployment now, by the name of its task, where that has begun."""
    roles: Mapping[Address, Address] = {}
    """Who plays the part of a robot now, outside deployments."""


def reunited(plan: Plan, number: int, past: Past) -> Plan | None:
    """Return the plan, with that *number*, by which what *plan* is for is done at once; None if nothing would be."""
    whole = _without(plan.root, past.given_up)
    ends = [] if whole is None else _ends(whole, past)
    if whole is None or not ends:
        return None
    staging: Staging = "fixed" if is_reunited(plan) else "direct"
    suffix = _AGAIN if is_reunited(plan) else _ONCE
    root = plan.root.name.removesuffix(_AGAIN).removesuffix(_ONCE) + suffix
    acts = _stops(whole, past)
    stops = [_errand(f"{root}/stops", robot, acts[robot]) for robot in sorted(acts)]
    places = [
        Task(
            name=f"{root}/places/part-{at}",
            label=f"part-{at}",
            act=Deployment(strategy=staging, robots=tuple(part), places_m=tuple(part.values())),
            on_failure="skip" if len(ends) > 1 else "fail",
        )
        for at, part in enumerate(ends, start=1)
    ]
    steps = tuple(
        Task(name=f"{root}/{label}", label=label, order="parallel", subtasks=tuple(tasks))
        for label, tasks in (("stops", stops), ("places", places))
        if tasks
    )
    robots = set(acts).union(*ends)
    task = Task(name=root, label=suffix[1:], subtasks=steps)
    return Plan(number=number, play=plan.play, robots=tuple(sorted(robots)), root=task)


def is_reunited(plan: Plan) -> bool:
    """Return whether a plan is one of :func:`reunited`."""
    return plan.root.name.endswith((_ONCE, _AGAIN))


def _without(task: Task, names: Collection[str]) -> Task | None:
    """Return *task* without what is called so in it; None if nothing is left of it."""
    if task.name in names:
        return None
    if not task.subtasks:
        return task
    left = tuple(kept for each in task.subtasks if (kept := _without(each, names)) is not None)
    return task.model_copy(update={"subtasks": left}) if left else None


def _ends(root: Task, past: Past) -> list[_Cast]:
    """Return who is to be where in the end: for each deployment, and for each who is to be somewhere without one."""
    ends = ends_m(root)
    found = list[_Cast]()
    for task in reversed(list(root.walk())):
        if isinstance(task.act, Deployment):
            cast = past.casts.get(task.name, task.act.robots)
            trios = zip(task.act.robots, task.act.places_m, cast, strict=True)
            found.append({now: ends.pop(robot) for robot, place_m, now in trios if ends.get(robot) == place_m})
    return [part for part in reversed(found) if part] + [
        {past.roles.get(robot, robot): place_m} for robot, place_m in ends.items()
    ]


def _stops(root: Task, past: Past) -> dict[Address, _Acts]:
    """Return what is left for each robot to do where it stands, each after a drive to where it was to be then."""
    acts, places_m = dict[Address, _Acts](), dict[Address, Place]()
    for task in root.walk():
        match task.act:
            case Go(robot=robot, place_m=place_m):
                places_m[robot] = place_m
            case Deployment(robots=robots, places_m=posts_m):
                places_m |= dict(zip(robots, posts_m, strict=True))
            case act if isinstance(act, Standing) and task.name not in past.done:
                robot = act.robot
                now = past.roles.get(robot, robot)
                drive = [Go(robot=now, place_m=places_m[robot], final=False)] if robot in places_m else []
                acts.setdefault(now, []).extend([*drive, act.model_copy(update={"robot": now})])
    return acts


def _errand(parent: str, robot: Address, acts: _Acts) -> Task:
    label = f"robot-{robot}"
    name = f"{parent}/{label}"
    steps = tuple(
        Task(name=f"{name}/{act.act}-{number}", label=f"{act.act}-{number}", act=act, on_failure="skip")
        for number, act in enumerate(acts, start=1)
    )
    return Task(name=name, label=label, subtasks=steps, on_failure="skip")
