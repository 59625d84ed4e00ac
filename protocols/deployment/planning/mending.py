"""Mends of an infeasible play: changes of the call, each of which is tried before it is offered."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from cosim.machine import Address
from cosim.units import S, Time, to_seconds
from protocols.deployment.planning.binding import Role
from protocols.deployment.planning.roles import Shortage, wanted
from protocols.deployment.tasks.constraints import in_seconds, sentence
from protocols.deployment.tasks.crew import Body
from protocols.deployment.tasks.plan import Between, Place, Task
from protocols.deployment.tasks.stn import Bound, Network

STEP: Time = S // 10
"""Resolution of relaxed times."""


MOST_MISSING: Final = 8
"""Greatest number of additional robots that a mend proposes."""


class Change(NamedTuple):
    """A change of a call, or of the team."""

    bodies: tuple[Body, ...] = ()
    """Additional robots, at the base."""
    everyone: bool = False
    """True if robots that the call has left out may take part."""
    uncast: bool = False
    """True if the planner chooses the robots of all roles, whatever the call says."""
    spans_s: tuple[tuple[str, float, float | None], ...] = ()
    """New limits of constraints, by their ``why``, and of time-outs, by their task's name."""
    dropped: tuple[str, ...] = ()
    """Constraints that are left out, by their ``why``."""
    moved_m: tuple[tuple[Place, Place], ...] = ()
    """Places, and the places that are taken instead of them."""
    before: tuple[tuple[str, str], ...] = ()
    """Pairs of tasks, of which the second is to start after the end of the first."""
    apart_m: float | None = None
    """Greatest distance between robots that gather; None: as the play says."""

    def with_(self, other: "Change") -> "Change":
        """Return both changes."""
        return Change(
            self.bodies + other.bodies,
            self.everyone or other.everyone,
            self.uncast or other.uncast,
            self.spans_s + other.spans_s,
            self.dropped + other.dropped,
            self.moved_m + other.moved_m,
            self.before + other.before,
            self.apart_m if other.apart_m is None else other.apart_m,
        )


class Mend(NamedTuple):
    """A change, in words."""

    text: str
    change: Change


class Infeasible(NamedTuple):
    """Why there is no plan, and what might mend it."""

    conflicts: tuple[str, ...]
    mends: tuple[Mend, ...] = ()


# ---------------------------------------------------------------- too few robots


def short_of_robots(
    shortage: Shortage,
    roles: Mapping[str, Role],
    template: Body,
    left_out: Sequence[Address],
    unheard_s: Mapping[Address, float],
) -> Infeasible:
    """Return why roles have too few robots, with mends; *template*: the smallest robot of the team.

    *unheard_s*: robots that could take part, but have not been heard for the given time.
    """
    count, fit = len(shortage.roles), len(shortage.robots)
    needs = sorted({wanted(roles[name].needs) for name in shortage.roles})
    detail = "" if needs == ["a robot"] else f" ({'; '.join(needs)})"
    wants = f"wants {needs[0]}" if count == 1 else f"want {count} robots{detail}"
    there = f"there are {fit}: {', '.join(map(str, shortage.robots))}" if fit else "there is none"
    conflicts = [f"role{'s' * (count > 1)} {', '.join(shortage.roles)} {wants}, and {there}"]
    conflicts += [f"robot {robot} has not been heard for {lost_s:.0f} s" for robot, lost_s in unheard_s.items()]
    mends = []
    if left_out:
        mends.append(Mend(f"robots {', '.join(map(str, left_out))} may take part", Change(everyone=True)))
    if any(role.fixed is not None for role in roles.values()):
        mends.append(Mend("the planner chooses the robots for all roles", Change(uncast=True)))
    if len(shortage.lacking) > MOST_MISSING:
        return Infeasible((*conflicts, *shortage.reasons), tuple(mends))
    bodies = tuple(_fitting(roles[name], template) for name in shortage.lacking)
    lacking = Counter(wanted(roles[name].needs) for name in shortage.lacking)
    mends.append(Mend(" and ".join(_more(what, number) for what, number in lacking.items()), Change(bodies=bodies)))
    return Infeasible((*conflicts, *shortage.reasons), tuple(mends))


def _more(what: str, count: int) -> str:
    return f"1 more {what.removeprefix('a ')}" if count == 1 else f"{count} more {what.replace('a robot', 'robots', 1)}"


def _fitting(role: Role, template: Body) -> Body:
    """Return *template* with what *role* needs."""
    for need in role.needs:
        if need.camera:
            template = template._replace(camera=True)
        if need.sensor is not None:
            template = template._replace(sensor=need.sensor)
        if need.passage_m is not None:
            template = template._replace(radius_m=min(template.radius_m, need.passage_m / 2.0))
    return template


# ---------------------------------------------------------------- too little time


def out_of_time(
    network: Network, asked: Sequence[tuple[Bound, Between]], timed: Sequence[tuple[Bound, Task]]
) -> Infeasible:
    """Return the constraints of a temporal conflict: those that were asked for, then durations.

    *asked*: bounds of the plan's constraints; *timed*: those of time-outs. Bounds of the plan's shape are not named.
    """
    conflict = network.conflict
    soft = {bound for bound, _ in (*asked, *timed)}
    hard = [bound for bound in network.bounds if bound not in soft]
    mends = [
        _relaxing(between, least_s, most_s)
        for bound, between in asked
        if bound in conflict
        for least_s, most_s in _relaxed(network, hard, bound)
    ]
    mends += [
        Mend(f"{task.name}: times out after {in_seconds(most_s)} s", Change(spans_s=((task.name, 0.0, most_s),)))
        for bound, task in timed
        if bound in conflict
        for _, most_s in _relaxed(network, hard, bound)
        if most_s is not None
    ]
    first = [bound for bound, _ in (*asked, *timed) if bound in conflict]
    lasting = [bound for bound in conflict if bound not in soft and (bound.least or bound.most is not None)]
    return Infeasible(tuple(dict.fromkeys(bound.name for bound in (*first, *lasting))), tuple(mends))


def in_a_circle(constraints: Sequence[Between]) -> Infeasible:
    """Return the conflict of *constraints* by which a task waits for its own end."""
    without = (Mend(f"without: {each.why}", Change(dropped=(each.why,))) for each in constraints)
    return Infeasible(tuple(each.why for each in constraints), tuple(without))


def _relaxing(between: Between, least_s: float, most_s: float | None) -> Mend:
    """Return the mend that gives a constraint other limits, or leaves it out."""
    # with a negative lower limit nothing would be left of "after"
    if least_s < 0 <= between.at_least_s:
        return Mend(f"without: {between.why}", Change(dropped=(between.why,)))
    text = f"{_who(between)}{sentence(between.earlier, between.later, least_s, most_s)}"
    return Mend(text, Change(spans_s=((between.why, least_s, most_s),)))


def _who(between: Between) -> str:
    who, colon, _ = between.why.partition(": ")
    return f"{who}{colon}" if colon else ""


def _relaxed(network: Network, hard: Sequence[Bound], bound: Bound) -> Iterator[tuple[float, float | None]]:
    """Yield the limits (s), nearest to those of *bound*, that all other bounds allow, or at least the *hard* ones."""
    others = Network(each for each in network.bounds if each != bound)
    if not others.consistent:  # there are more conflicts, which other changes must mend
        others = Network(hard)
    least, most = others.least(bound.earlier, bound.later), others.most(bound.earlier, bound.later)
    if bound.most is not None and least is not None and least > bound.most:
        yield to_seconds(bound.least), to_seconds(-(-least // STEP) * STEP)
    elif most is not None and most < bound.least:
        down = most // STEP * STEP
        yield to_seconds(down), None if bound.most is None else to_seconds(bound.most)
