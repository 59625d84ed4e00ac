"""The temporal constraints of a plan while it is executed: when tasks may start and end.

The starts and ends of tasks are the nodes of a simple temporal network (Dechter, Meiri and Pearl 1991), in which what
has happened is fixed and all else lies in the future. A constraint "from a to b after" is two edges; the hierarchy of
tasks adds edges that always hold. Two passes give what is still possible:

* the earliest an instant can be: an instant that waits for another's window is held back until then, so that a plan
  whose lengths are what it says is executed without violating it (the earliest times solve the network);
* the latest: as soon as an instant's earliest exceeds its latest, a window is certain to break. It is reported and
  dropped, so that the rest goes on.

"Certain" means: if nothing fails from now on. A task that never starts has no instants, so constraints on it are void.
Times are nanoseconds, and exact.
"""

from collections.abc import Mapping
from typing import Final, NamedTuple, TypeAlias

from cosim.units import Time, from_seconds
from protocols.deployment.executing.tree import Edge
from protocols.deployment.tasks.plan import ORIGIN, Between, Instant, Plan, Task, Wait

Point: TypeAlias = tuple[str, Edge]

_START: Final[Point] = (ORIGIN, "start")


class Breach(NamedTuple):
    """A window of the plan that has broken, or is certain to."""

    constraint: int
    """Index among the plan's constraints."""
    at: Time
    """Time at which that became certain, ns."""
    why: str
    """The constraint in words, and who asked for it."""


class _Bound(NamedTuple):
    """A lower bound: *later* is at least *least* ns after *earlier*; *constraint* is None for the hierarchy's own."""

    earlier: Point
    later: Point
    least: Time
    constraint: int | None


class Timetable:
    """The instants of a plan that have happened, and what its constraints allow for the others."""

    def __init__(self, plan: Plan, start: Time) -> None:
        self._constraints = plan.constraints
        self._happened: dict[Point, Time] = {_START: start, (ORIGIN, "end"): start}
        self._structure = [] if not plan.constraints else list(_hierarchy(plan.root, False))
        self._open: dict[tuple[int, bool], _Bound] = {}
        for number, between in enumerate(plan.constraints):
            self._add(number, between)
        self._computed: tuple[Time, dict[Point, Time], dict[Point, Time], dict[Point, Time]] | None = None
        self._breaches: list[Breach] = []
        self._broken: set[int] = set()
        self._eased: set[tuple[int, bool]] = set()
        """Bounds between instants that wait for each other and may be simultaneous: one of them goes first."""

    def _add(self, number: int, between: Between) -> None:
        earlier, later = _point(between.earlier), _point(between.later)
        loop = earlier == later
        if not (loop and between.at_least_s <= 0):
            self._open[number, True] = _Bound(earlier, later, from_seconds(between.at_least_s), number)
        if between.at_most_s is not None and not (loop and between.at_most_s >= 0):
            self._open[number, False] = _Bound(later, earlier, -from_seconds(between.at_most_s), number)

    # ------------------------------------------------------------ what happens

    def happened(self, name: str, edge: Edge, at: Time) -> None:
        """Fix an instant; a task that is done again keeps its first start."""
        if self._open and (edge == "end" or (name, edge) not in self._happened):
            self._happened[name, edge] = at
            self._computed = None

    def closed(self, name: str, at: Time) -> None:
        """Fix the end of a task; drop the constraints on one that has never started."""
        if (name, "start") in self._happened:
            self.happened(name, "end", at)
        else:
            self._void(name)

    def _void(self, name: str) -> None:
        gone = [key for key, bound in self._open.items() if name in {bound.earlier[0], bound.later[0]}]
        for key in gone:
            del self._open[key]
        if self._structure:
            self._structure = [each for each in self._structure if name not in {each.earlier[0], each.later[0]}]
        self._computed = None

    def breaches(self) -> list[Breach]:
        """Return the windows that have broken so far, in order."""
        return self._breaches

    # ------------------------------------------------------------ what is allowed

    def opens(self, name: str, edge: Edge, now: Time) -> Time | None:
        """Return when an instant may happen; None if that depends on something that has not happened.

        It may happen when all instants before it have happened, for long enough; and if another is to follow soon after
        it, not before that one can happen.
        """
        if not self._open:
            return now
        point = (name, edge)
        latest = now
        for key, bound in self._open.items():
            if bound.later != point:
                continue
            opens = self._opening(key, bound, now)
            if opens is None:
                return None
            latest = max(latest, opens)
        return latest

    def _opening(self, key: tuple[int, bool], bound: _Bound, now: Time) -> Time | None:
        at = self._happened.get(bound.earlier)
        if at is not None:
            return at + bound.least
        anyway, from_now, _ = self._times(now)
        if key[1] and bound.least >= 0:
            return max(anyway.get(bound.earlier, now), now) if key in self._eased else None
        if from_now.get(bound.earlier, now) + bound.least <= now:
            return now
        opens = anyway.get(bound.earlier, now) + bound.least
        return opens if opens > now else None

    def check(self, now: Time) -> None:
        """Note the windows that are certain to break, as things are at *now*."""
        while self._open and (broken := self._contradiction(now)) is not None:
            self._give_up(broken, now)

    def loosen(self, name: str, edge: Edge, now: Time) -> bool:
        """Let an instant happen that waits for one that waits for it in turn; return whether it does.

        If both may be simultaneous, it goes first, and the other may follow. Otherwise a window is broken.
        """
        point = (name, edge)
        for key, bound in self._open.items():
            if bound.later == point and self._opening(key, bound, now) is None:
                if key[1] and bound.least == 0:
                    self._eased.add(key)
                else:
                    self._give_up(key, now)
                return True
        return False

    def _give_up(self, key: tuple[int, bool], now: Time) -> None:
        """Report one side of a constraint as broken, and drop it."""
        number = key[0]
        del self._open[key]
        self._computed = None
        if number not in self._broken:
            self._broken.add(number)
            self._breaches.append(Breach(number, now, _words(self._constraints[number])))

    def wake_at(self, now: Time) -> Time | None:
        """Return when the next window is certain to break if nothing happens; None if none is."""
        if not self._open:
            return None
        _, _, latest = self._times(now)
        # at the latest instant itself a window is still kept
        return min((at + 1 for point, at in latest.items() if point not in self._happened and at >= now), default=None)

    # ------------------------------------------------------------ the network

    def _bounds(self) -> list[_Bound]:
        return [*self._structure, *self._open.values()]

    def _times(self, now: Time) -> tuple[dict[Point, Time], dict[Point, Time], dict[Point, Time]]:
        """Return the earliest of all instants, that with nothing new before *now*, and the latest of some."""
        if self._computed is None or self._computed[0] != now:
            bounds = self._bounds()
            self._computed = (
                now,
                self._earliest(bounds, self._happened[_START]),
                self._earliest(bounds, now),
                self._latest(bounds),
            )
        return self._computed[1:]

    def _earliest(self, bounds: list[_Bound], floor: Time) -> dict[Point, Time]:
        times = dict(self._happened)
        for _ in range(len(bounds) + 1):
            changed = False
            for earlier, later, least, _ in bounds:
                if later in self._happened:
                    continue
                at = max(times.get(earlier, floor) + least, floor)
                if at > times.get(later, floor - 1):
                    times[later] = at
                    changed = True
            if not changed:
                break
        return times

    def _latest(self, bounds: list[_Bound]) -> dict[Point, Time]:
        times = dict(self._happened)
        for _ in range(len(bounds) + 1):
            changed = False
            # backwards, as latest instants follow from later ones: fewer rounds
            for earlier, later, least, _ in reversed(bounds):
                if earlier in self._happened or later not in times:
                    continue
                at = times[later] - least
                if at < times.get(earlier, at + 1):
                    times[earlier] = at
                    changed = True
            if not changed:
                break
        return times

    def _contradiction(self, now: Time) -> tuple[int, bool] | None:
        """Return the side of a constraint that closes a contradiction; None if there is none.

        Bounds are followed from instants that have happened, or cannot happen before now, to instants that have
        happened. The first bound that demands more than the time there was, or than any schedule has, closes it.
        """
        bounds = self._bounds()
        times = dict(self._happened)
        by: dict[Point, _Bound] = {}
        for _ in range(len(bounds) + 1):
            changed = False
            for bound in bounds:
                at = times.get(bound.earlier, now) + bound.least
                if at <= times.get(bound.later, now):
                    continue
                if bound.later in self._happened:
                    return self._culprit(bound, by)
                times[bound.later], by[bound.later] = at, bound
                changed = True
            if not changed:
                return None
        return self._culprit(self._on_circle(by), by)

    @staticmethod
    def _on_circle(by: Mapping[Point, _Bound]) -> _Bound:
        """Return a bound on a circle that has no end, given by which bound each instant was moved last."""
        seen = dict[Point, _Bound]()
        for bound in by.values():
            way = set[Point]()
            while bound.later not in seen:
                if bound.later in way:
                    return bound
                way.add(bound.later)
                if bound.earlier not in by:
                    break
                bound = by[bound.earlier]
            seen |= dict.fromkeys(way, bound)
        raise AssertionError("times grew without end, but on no circle")

    def _culprit(self, bound: _Bound, by: Mapping[Point, _Bound]) -> tuple[int, bool] | None:
        """Return the last upper bound on the way to a contradiction, or else its last constraint."""
        way, seen = [bound], set[Point]()
        while (last := by.get(way[-1].earlier)) is not None and last.later not in seen:
            seen.add(last.later)
            way.append(last)
        asked = [key for each in way for key, one in self._open.items() if one is each]
        return min(asked, key=lambda key: key[1], default=None)


def _point(instant: Instant) -> Point:
    return instant.task, instant.edge if instant.task != ORIGIN else "start"


def _words(between: Between) -> str:
    def name(instant: Instant) -> str:
        return f"the {instant.edge} of {instant.task}" if instant.task != ORIGIN else "the beginning"

    most = "" if between.at_most_s is None else f" and at most {between.at_most_s:g} s"
    window = f"{name(between.later)} is at least {between.at_least_s:g} s{most} after {name(between.earlier)}"
    return f"{between.why} ({window})" if between.why else window


def _hierarchy(task: Task, cut_short: bool) -> list[_Bound]:
    """Return what holds between the instants of *task* and all below it; *cut_short*: it may be terminated."""
    start: Point = (task.name, "start")
    end: Point = (task.name, "end")
    cut_short = cut_short or task.ends_with is not None
    lasts = from_seconds(task.act.seconds) if isinstance(task.act, Wait) and not cut_short else 0
    bounds = [_Bound(start, end, lasts, None)]
    elder: Point | None = None
    for child in task.subtasks:
        bounds += _hierarchy(child, cut_short)
        bounds.append(_Bound(start, (child.name, "start"), 0, None))
        if elder is not None and task.order == "serial":
            bounds.append(_Bound(elder, (child.name, "start"), 0, None))
        bounds.append(_Bound((child.name, "end"), end, 0, None))
        elder = child.name, "end"
    return bounds
