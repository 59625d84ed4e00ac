"""The temporal constraints of a plan while it is executed: when tasks may start and end.

The starts and ends of tasks are the points of a simple temporal network (``tasks.stn``), in which what has happened is
fixed and all else lies in the future; the hierarchy of tasks adds bounds that always hold. It says what is possible:

* the earliest an instant can be: an instant that waits for another's window is held back until then, so that a plan
  whose lengths are what it says is executed without violating it (the earliest times solve the network);
* the latest: as soon as an instant's earliest exceeds its latest, a window is certain to break. It is reported and
  dropped, so that the rest goes on.

"Certain" means: if nothing fails from now on. A task that never starts has no instants, so constraints on it are void.
Times are nanoseconds, and exact.
"""

from collections.abc import Iterator
from typing import NamedTuple

from cosim.units import Time, from_seconds
from protocols.deployment.tasks.plan import ORIGIN, Between, Edge, Instant, Plan, Task, Wait
from protocols.deployment.tasks.stn import (
    BEGINNING,
    Arc,
    Point,
    arcs_of,
    asked,
    conflict,
    earliest,
    hierarchy,
    latest,
)


class Breach(NamedTuple):
    """A window of the plan that has broken, or is certain to."""

    constraint: int
    """Index among the plan's constraints."""
    at: Time
    """Time at which that became certain, ns."""
    why: str
    """The constraint in words, and who asked for it."""


class Timetable:
    """The instants of a plan that have happened, and what its constraints allow for the others."""

    def __init__(self, plan: Plan, start: Time) -> None:
        self._constraints = plan.constraints
        self._happened: dict[Point, Time] = {BEGINNING: start}
        self._structure = [] if not plan.constraints else _structure(plan.root)
        # a limit of the time from an instant to itself either always holds, and says nothing, or never
        self._open: dict[tuple[int, bool], Arc] = {
            (number, side == 0): arc
            for number, between in enumerate(plan.constraints)
            for side, arc in enumerate(arcs_of(asked(between)))
            if arc.earlier != arc.later or arc.least > 0
        }
        """Limits that still count, by the constraint's index, and whether it is the lower one."""
        self._computed: tuple[Time, dict[Point, Time], dict[Point, Time], dict[Point, Time]] | None = None
        self._breaches: list[Breach] = []
        self._broken: set[int] = set()
        self._eased: set[tuple[int, bool]] = set()
        """Limits between instants that wait for each other and may be simultaneous: one of them goes first."""

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
            # a wait that was cut short has broken its own length, which would hide every other contradiction
            own = (name, "start"), (name, "end")
            self._structure = [arc for arc in self._structure if (arc.earlier, arc.later) != own]
        else:
            self._void(name)

    def _void(self, name: str) -> None:
        gone = [key for key, arc in self._open.items() if name in {arc.earlier[0], arc.later[0]}]
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
        at = now
        for key, arc in self._open.items():
            if arc.later != point:
                continue
            opens = self._opening(key, arc, now)
            if opens is None:
                return None
            at = max(at, opens)
        return at

    def _opening(self, key: tuple[int, bool], arc: Arc, now: Time) -> Time | None:
        at = self._happened.get(arc.earlier)
        if at is not None:
            return at + arc.least
        anyway, from_now, _ = self._times(now)
        if key[1] and arc.least >= 0:
            return max(anyway.get(arc.earlier, now), now) if key in self._eased else None
        if from_now.get(arc.earlier, now) + arc.least <= now:
            return now
        opens = anyway.get(arc.earlier, now) + arc.least
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
        for key, arc in self._open.items():
            if arc.later == point and self._opening(key, arc, now) is None:
                if key[1] and arc.least == 0:
                    self._eased.add(key)
                else:
                    self._give_up(key, now)
                return True
        return False

    def _give_up(self, key: tuple[int, bool], now: Time) -> None:
        """Report one limit of a constraint as broken, and drop it."""
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
        _, _, last = self._times(now)
        # at the latest instant itself a window is still kept
        return min((at + 1 for point, at in last.items() if point not in self._happened and at >= now), default=None)

    # ------------------------------------------------------------ the network

    def _arcs(self) -> list[Arc]:
        return [*self._structure, *self._open.values()]

    def _times(self, now: Time) -> tuple[dict[Point, Time], dict[Point, Time], dict[Point, Time]]:
        """Return the earliest of all instants, that with nothing new before *now*, and the latest of some."""
        if self._computed is None or self._computed[0] != now:
            arcs, happened = self._arcs(), self._happened
            self._computed = (
                now,
                earliest(arcs, happened, happened[BEGINNING]),
                earliest(arcs, happened, now),
                latest(arcs, happened),
            )
        return self._computed[1:]

    def _contradiction(self, now: Time) -> tuple[int, bool] | None:
        """Return the last upper limit on the way to a contradiction, or else its last constraint; None without one."""
        way = conflict(self._arcs(), self._happened, now)
        sides = [key for each in way for key, arc in self._open.items() if arc is each]
        return min(sides, key=lambda key: key[1], default=None)


def _words(between: Between) -> str:
    def name(instant: Instant) -> str:
        return f"the {instant.edge} of {instant.task}" if instant.task != ORIGIN else "the beginning"

    most = "" if between.at_most_s is None else f" and at most {between.at_most_s:g} s"
    window = f"{name(between.later)} is at least {between.at_least_s:g} s{most} after {name(between.earlier)}"
    return f"{between.why} ({window})" if between.why else window


def _structure(root: Task) -> list[Arc]:
    """Return what always holds between the instants of a plan: the hierarchy of its tasks, and how long waits last."""
    lasts = dict(_lasting(root, False))
    return [arc for bound in hierarchy(root, lasts) for arc in arcs_of(bound)]


def _lasting(task: Task, cut_short: bool) -> Iterator[tuple[str, Time]]:
    """Yield the waits in *task* and how long they last; none that may be terminated, as all are if *cut_short*."""
    cut_short = cut_short or task.ends_with is not None
    if isinstance(task.act, Wait) and not cut_short:
        yield task.name, from_seconds(task.act.seconds)
    for child in task.subtasks:
        yield from _lasting(child, cut_short)
