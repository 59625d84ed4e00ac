"""What becomes of a play that two hosts have led at once, after a partition of the team.

Each side has taken the other for lost, and has gone on without it: what has happened on one side means nothing in the
tree of tasks of the other. So when they hear of each other, the host that stays makes an end of both, and has all go
straight to the places where the play wanted robots in the end; before that they take the pictures of which that host
has not heard that they were taken. Strategies, waits, windows and what was left to explore are given up. A deployment
remains one, of those of its robots that were to end up there: so who is lost is replaced in it as in any other.
"""

from collections.abc import Collection
from typing import TypeAlias

from cosim.machine import Address
from protocols.deployment.plan import Deployment, Go, Photo, Place, Plan, Task
from protocols.deployment.standing import ends_m

SUFFIX = "reunited"

_Acts: TypeAlias = list[Go | Photo]


def reunited(plan: Plan, number: int, done: Collection[str] = ()) -> Plan | None:
    """Return the plan, with that *number*, by which what *plan* is for is done at once; None if nothing would be.

    *done*: names of tasks that need not be done again.
    """
    deployments = _deployments(plan.root)
    if not deployments:
        return None
    root = plan.root.name.removesuffix(f"/{SUFFIX}") + f"/{SUFFIX}"
    acts = _pictures(plan.root, done)
    photos = [_errand(f"{root}/pictures", robot, acts[robot]) for robot in sorted(acts)]
    places = [_deployed(f"{root}/places", number, act, len(deployments) > 1) for number, act in enumerate(deployments)]
    steps = tuple(
        Task(name=f"{root}/{label}", label=label, order="parallel", subtasks=tuple(tasks))
        for label, tasks in (("pictures", photos), ("places", places))
        if tasks
    )
    robots = set(acts).union(*(act.robots for act in deployments))
    task = Task(name=root, label=SUFFIX, subtasks=steps)
    return Plan(number=number, play=plan.play, robots=tuple(sorted(robots)), root=task)


def is_reunited(plan: Plan) -> bool:
    """Return whether a plan is one of :func:`reunited`: one in which who was lost has no task any more."""
    return plan.root.name.endswith(f"/{SUFFIX}")


def _deployments(root: Task) -> list[Deployment]:
    """Return by which deployments all robots come to where each is to be in the end: one that is to be alone, alone."""
    ends = ends_m(root)
    found = list[Deployment]()
    for act in reversed([task.act for task in root.walk()]):
        if isinstance(act, Deployment):
            pairs = zip(act.robots, act.places_m, strict=True)
            staying = {robot: ends.pop(robot) for robot, place_m in pairs if ends.get(robot) == place_m}
            found += [_direct(staying)] if staying else []
    return [*reversed(found), *(_direct({robot: place_m}) for robot, place_m in ends.items())]


def _direct(ends: dict[Address, Place]) -> Deployment:
    return Deployment(strategy="direct", robots=tuple(ends), places_m=tuple(ends.values()))


def _deployed(parent: str, at: int, act: Deployment, skip: bool) -> Task:
    label = f"part-{at + 1}"
    return Task(name=f"{parent}/{label}", label=label, act=act, on_failure="skip" if skip else "fail")


def _pictures(root: Task, done: Collection[str]) -> dict[Address, _Acts]:
    """Return for each robot that has pictures to take what it does for that: it drives to where it was to be then."""
    acts, places_m = dict[Address, _Acts](), dict[Address, Place]()
    for task in root.walk():
        match task.act:
            case Go(robot=robot, place_m=place_m):
                places_m[robot] = place_m
            case Deployment(robots=robots, places_m=posts_m):
                places_m |= dict(zip(robots, posts_m, strict=True))
            case Photo(robot=robot) as photo if task.name not in done:
                drive = [Go(robot=robot, place_m=places_m[robot], final=False)] if robot in places_m else []
                acts.setdefault(robot, []).extend([*drive, photo])
    return acts


def _errand(parent: str, robot: Address, acts: _Acts) -> Task:
    label = f"robot-{robot}"
    name = f"{parent}/{label}"
    steps = tuple(
        Task(name=f"{name}/{act.act}-{number}", label=f"{act.act}-{number}", act=act, on_failure="skip")
        for number, act in enumerate(acts, start=1)
    )
    return Task(name=name, label=label, subtasks=steps, on_failure="skip")
