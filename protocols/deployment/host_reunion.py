"""What becomes of a play that two hosts have led at once, after a partition of the team.

Each side has taken the other for lost, and has gone on without it: what has happened on one side means nothing in the
tree of tasks of the other. So when they hear of each other, the host that stays makes an end of both, and has all go
straight to the places where the play wanted them in the end.
"""

from protocols.deployment.plan import Go, Plan, Task
from protocols.deployment.standing import ends_m

SUFFIX = "reunited"


def reunited(plan: Plan, number: int) -> Plan | None:
    """Return the plan, with that *number*, by which what *plan* is for is done at once; None if nothing would be."""
    ends = ends_m(plan.root)
    if not ends:
        return None
    root = plan.root.name.removesuffix(f"/{SUFFIX}") + f"/{SUFFIX}"
    drives = tuple(_drive(root, Go(robot=robot, place_m=place)) for robot, place in sorted(ends.items()))
    task = Task(name=root, label=SUFFIX, order="parallel", subtasks=drives)
    return Plan(number=number, play=plan.play, robots=tuple(sorted(ends)), root=task)


def _drive(root: str, act: Go) -> Task:
    label = f"robot-{act.robot}"
    return Task(name=f"{root}/{label}", label=label, act=act, on_failure="skip")
