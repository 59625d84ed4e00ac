"""What becomes of a play that two hosts have led at once, after a partition of the team.

Each side has taken the other for lost, and has gone on without it: what has happened on one side means nothing in the
tree of tasks of the other. So when they hear of each other, the host that stays makes an end of both, and has all go
straight to the places where the play wanted them in the end; on their way they take the pictures of which that host
has not heard that they were taken. Strategies, waits, windows and what was left to explore are given up.
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
    ends = ends_m(plan.root)
    if not ends:
        return None
    root = plan.root.name.removesuffix(f"/{SUFFIX}") + f"/{SUFFIX}"
    acts = _pictures(plan.root, done)
    for robot, place_m in ends.items():
        acts.setdefault(robot, []).append(Go(robot=robot, place_m=place_m))
    errands = tuple(_errand(root, robot, acts[robot]) for robot in sorted(acts))
    task = Task(name=root, label=SUFFIX, order="parallel", subtasks=errands)
    return Plan(number=number, play=plan.play, robots=tuple(sorted(acts)), root=task)


def is_reunited(plan: Plan) -> bool:
    """Return whether a plan is one of :func:`reunited`: one in which who was lost has no task any more."""
    return plan.root.name.endswith(f"/{SUFFIX}")


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


def _errand(root: str, robot: Address, acts: _Acts) -> Task:
    label = f"robot-{robot}"
    name = f"{root}/{label}"
    if len(acts) == 1:
        return Task(name=name, label=label, act=acts[0], on_failure="skip")
    steps = tuple(
        Task(name=f"{name}/{act.act}-{number}", label=f"{act.act}-{number}", act=act, on_failure="skip")
        for number, act in enumerate(acts, start=1)
    )
    return Task(name=name, label=label, subtasks=steps, on_failure="skip")
