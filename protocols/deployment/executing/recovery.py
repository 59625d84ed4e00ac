"""Recovery from the loss of robots: others get their posts in a deployment, and their roles in the rest of a plan.

A deployment that has lost robots occupies as many places as it has robots left, the first ones in the play's order.
The assignment is that of least cost in all, by the routes from where the robots were known to be last ("chooses the
lowest-cost robot-to-destination assignment", paper 004, section 4). A wave keeps its order: a robot ahead stays ahead.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final, TypeAlias

import numpy as np
from scipy.optimize import linear_sum_assignment

from cosim.machine import Address
from protocols.deployment.tasks.crew import Crew, Ways
from protocols.deployment.tasks.plan import Go, Photo, Place, Staging, Task

Length: TypeAlias = Callable[[Address, Place, Place], float]
"""Returns the length of a robot's route, m; inf if there is none."""

_NO_WAY_M: Final = 1e9  # an assignment cannot add infinities
"""Cost of a route that does not exist."""
_ORDER_M: Final = 1e-6  # decides among assignments of the same cost
"""Cost of a change of order by one place."""


def lengths(crew: Crew, ways: Ways) -> Length:
    """Return a function that looks up a robot's route once for each pair of places."""
    known = dict[tuple[float, Place, Place], float]()

    def length(robot: Address, a: Place, b: Place) -> float:
        key = crew.radius_m(robot), a, b
        if key not in known:
            length_m = ways.length_m(*key)
            known[key] = math.inf if length_m is None else length_m
        return known[key]

    return length


def reassigned(
    strategy: Staging,
    robots: Sequence[Address],
    reached: Mapping[Address, int],
    stands_m: Mapping[Address, Place],
    places_m: Sequence[Place],
    length: Length,
    covered: Callable[[Address, Place], bool] = lambda robot, place_m: False,
) -> dict[Address, int]:
    """Return which of the first places each of *robots* ends up at; the robots come in the order of their old posts.

    Places that are *covered* by a lost robot's body, so that no robot can stand there, are occupied last.
    """
    size = min(len(robots), len(places_m))
    open_first = sorted(
        range(len(places_m)), key=lambda post: (all(covered(robot, places_m[post]) for robot in robots), post)
    )
    posts = sorted(open_first[:size])
    if strategy == "wave":
        order = sorted(range(len(robots)), key=lambda at: (reached[robots[at]], at))
        return {robots[at]: post for post, at in zip(posts, order, strict=False)}
    # where all drive at once, squares of ways are added: then no robot has to pass another in a corridor
    power = 2.0 if strategy == "direct" else 1.0
    costs = np.array(
        [
            [
                min(length(robot, stands_m[robot], places_m[post]) ** power, _NO_WAY_M)
                + _NO_WAY_M * covered(robot, places_m[post])
                + _ORDER_M * (at - number) ** 2
                for number, post in enumerate(posts)
            ]
            for at, robot in enumerate(robots)
        ]
    ).reshape(len(robots), size)
    rows, columns = linear_sum_assignment(costs)
    return {robots[row]: posts[column] for row, column in zip(rows.tolist(), columns.tolist(), strict=True)}


def substitute(
    tasks: Iterable[Task], spares: Iterable[Address], stands_m: Mapping[Address, Place], crew: Crew, length: Length
) -> Address | None:
    """Return the spare robot that can do *tasks*, leaves of a lost one in order, and has the shortest way to them.

    It has a camera if a picture is to be taken, and a way to every place; None if no spare robot has these.
    """
    acts = [task.act for task in tasks]
    pictures = any(isinstance(act, Photo) for act in acts)
    places = [act.place_m for act in acts if isinstance(act, Go)]
    best: tuple[float, Address] | None = None
    for spare in sorted(spares):
        if pictures and not crew.has_camera(spare):
            continue
        legs = [length(spare, a, b) for a, b in zip([stands_m[spare], *places], places, strict=False)]
        if all(math.isfinite(leg) for leg in legs) and (best is None or (math.fsum(legs), spare) < best):
            best = math.fsum(legs), spare
    return None if best is None else best[1]
