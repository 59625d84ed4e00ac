"""The rest of a deployment that is under way: the stages of Fig. 3, from wherever its robots have come to.

A robot has *reached* a place of the deployment (by its number, -1: none yet) and is to end up at another, its *post*.
With nothing reached and robot i's post i these are the stages of :func:`protocols.deployment.planning.methods.stages`
(except that a leap-frog deployment has a stage for each leap). With robots on their way, lost, found, or under another
strategy than before, the stages continue from there: no robot goes back, unless to its post.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple, TypeAlias

from cosim.machine import Address
from protocols.deployment.planning.augmenting import ExecutiveParameters, Standing, in_line
from protocols.deployment.tasks.crew import Crew, Ways
from protocols.deployment.tasks.plan import UNSTAGED, Go, Place, Staging, Task

Posts: TypeAlias = Mapping[Address, int]

NOWHERE: Final = -1
"""Stands for the number of a place: a robot has not reached any."""


class StageLeg(NamedTuple):
    """One robot's way to one place (by its number) within a stage."""

    robot: Address
    place: int


def remaining(strategy: Staging, posts: Posts, reached: Posts) -> list[list[StageLeg]]:
    """Return the legs of the stages that are left: parallel for group and wave, one after the other for leap-frog."""
    if strategy in UNSTAGED:
        away = [StageLeg(robot, post) for robot, post in posts.items() if reached[robot] != post]
        return [away] if away else []
    stages = {"group": _group, "wave": _wave, "leap_frog": _leap_frog}[strategy]
    return list(stages(posts, reached))


def _group(posts: Posts, reached: Posts) -> Iterator[list[StageLeg]]:
    """Yield the stages in which all robots whose posts lie farther go on together."""
    # a robot that stands at a place already takes part when others come there: it may stand at the post of one of them
    back = [StageLeg(robot, post) for robot, post in posts.items() if reached[robot] > post]
    for place in sorted(posts.values()):
        legs = [StageLeg(robot, place) for robot, post in posts.items() if reached[robot] <= place <= post]
        legs = [leg for leg in legs if not reached[leg.robot] == place == posts[leg.robot]]
        legs += [leg for leg in back if leg.place == place]
        if any(reached[leg.robot] != place for leg in legs):
            yield sorted(legs, key=lambda leg: (posts[leg.robot], leg.robot))


def _wave(posts: Posts, reached: Posts) -> Iterator[list[StageLeg]]:
    """Yield the stages in which every robot moves on by one place, as soon as that is left.

    Where no robot can move on (one stands at its post in the others' way, as after a leap-frog deployment), all robots
    with empty posts drive there directly.
    """
    stands = dict(reached)
    order = sorted(posts, key=lambda robot: -posts[robot])
    while any(stands[robot] != posts[robot] for robot in order):
        legs = list[StageLeg]()
        taken = {stands[robot] for robot in order if stands[robot] == posts[robot]}
        leaving = set[Address]()
        for robot in order:
            if (here := stands[robot]) == (post := posts[robot]):
                continue
            there = post if here > post else here + 1
            held = {stands[each] for each in order if each != robot and each not in leaving}
            if there not in taken and there not in held:
                legs.append(StageLeg(robot, there))
                taken.add(there)
                leaving.add(robot)
        if not legs:
            legs = _direct(posts, stands)
        stands |= dict(legs)
        yield sorted(legs, key=lambda leg: leg.place)


def _direct(posts: Posts, stands: Posts) -> list[StageLeg]:
    """Return the ways to empty posts; to all posts if none is empty."""
    away = [StageLeg(robot, post) for robot, post in posts.items() if stands[robot] != post]
    held = set(stands.values())
    return [leg for leg in away if leg.place not in held] or away


def _leap_frog(posts: Posts, reached: Posts) -> Iterator[list[StageLeg]]:
    """Yield a stage for each robot that is not at its post: over all places before the post, one after the other."""
    for robot, post in sorted(posts.items(), key=lambda item: item[1]):
        if reached[robot] > post:
            yield [StageLeg(robot, post)]
        elif reached[robot] < post:
            yield [StageLeg(robot, place) for place in range(reached[robot] + 1, post + 1)]


class Stager(NamedTuple):
    """Makes tasks of the stages of one deployment."""

    places_m: tuple[Place, ...]
    strategy: Staging
    augmented: bool
    crew: Crew
    ways: Ways
    parameters: ExecutiveParameters

    def tasks(self, name: str, posts: Posts, reached: Posts) -> list[Task]:
        """Return a task for each of the stages that are left, named ``NAME/stage-I/robot-R-to-P``."""
        return [
            self._stage(f"{name}/stage-{number}", f"stage-{number}", legs, posts)
            for number, legs in enumerate(remaining(self.strategy, posts, reached), start=1)
        ]

    def directly(self, name: str, posts: Posts, robots: Sequence[Address]) -> Task:
        """Return a last stage in which *robots* drive straight to their posts."""
        return self._replace(augmented=False)._stage(
            f"{name}/stage-1", "stage-1", [StageLeg(robot, posts[robot]) for robot in robots], posts
        )

    def _stage(self, name: str, label: str, legs: Sequence[StageLeg], posts: Posts) -> Task:
        goes = {
            f"robot-{leg.robot}-to-{leg.place + 1}": Go(
                robot=leg.robot, place_m=self.places_m[leg.place], final=posts[leg.robot] == leg.place
            )
            for leg in legs
        }
        goes = dict(zip(goes, self.staged(list(goes.values())), strict=True))
        subtasks = tuple(Task(name=f"{name}/{label}", label=label, act=go) for label, go in goes.items())
        return Task(
            name=name, label=label, order="serial" if self.strategy == "leap_frog" else "parallel", subtasks=subtasks
        )

    def staged(self, goes: Sequence[Go]) -> list[Go]:
        """Return the drives of one stage, augmented (section 5); *goes*: in the order of the robots' posts.

        Only a group stage is changed: it gets places along the line to the next goal, and staggered starts.
        """
        if not self.augmented or self.strategy != "group" or goes[0].place_m not in self.places_m:
            return list(goes)
        number = self.places_m.index(goes[0].place_m)
        waiting = [go for go in goes if not go.final]
        line = in_line(
            [Standing(go.robot, self.crew.radius_m(go.robot)) for go in waiting],
            self.places_m[number:],
            max((body.radius_m for body in self.crew.bodies), default=0.0),
            self.ways,
            self.parameters,
        )
        return [
            go.model_copy(
                update={
                    "place_m": line.get(go.robot, go.place_m),
                    "behind": ahead.robot if ahead is not None else None,
                    "behind_m": self.parameters.behind_m if ahead is not None else 0.0,
                }
            )
            for go, ahead in zip(goes, [*goes[1:], None], strict=True)
        ]
