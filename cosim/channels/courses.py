"""What scanners and procedures do, phase by phase, as rows of the table ``intervals``.

A device that skips ahead knows at one instant all that it does until something comes between: back off, then listen in
windows. That is its course. It is written as far as it has come true when it changes, when the run is over, and when
somebody looks: there is no event for a window or a train.
"""

from collections.abc import Callable, Iterable
from typing import Final, NamedTuple, TypeAlias

from cosim.intervals import Interval, Intervals
from cosim.machine import Address
from cosim.trace import Trace
from cosim.units import Time

Stretch: TypeAlias = tuple[Time, Time, str]
"""(start, end, detail)"""
Listen: TypeAlias = Callable[[Address, Time, Time, str], None]
"""Called with (robot, start, end, state)."""
NOTHING: Final = ""
"""The state of a phase of which nothing is written."""


class Phase(NamedTuple):
    """A part of a course, from *since* until the next one."""

    since: Time
    state: str = NOTHING
    detail: str = ""
    parts: Callable[[Time, Time], Iterable[Stretch]] | None = None
    """Returns the rows that lie in [start, end); without it that is one, with *detail*."""


class Course:
    """What one side of the device *robot* does, or a procedure of it."""

    def __init__(self, intervals: Intervals, robot: Address, listen: Listen | None = None) -> None:
        self._intervals = intervals
        self._robot = robot
        self._listen = listen
        self._phases: list[Phase] = []
        self._told: Time = 0
        """Instant up to which it is written, but for the last row."""
        self._last: tuple[Time, Time, str, str] | None = None
        """(start, end, state, detail) of the last row, which may go on."""

    def plan(self, now: Time, *phases: Phase) -> None:
        """Do *phases* from *now* on, in the order of their beginnings, instead of what was planned; at last nothing."""
        self.tell(now)
        self._phases = [*phases]

    def tell(self, now: Time) -> None:
        """Write what has come true before *now*."""
        ends = [*(phase.since for phase in self._phases[1:]), now]
        for phase, end in zip(self._phases, ends, strict=False):
            start, end = max(phase.since, self._told), min(end, now)
            if phase.state == NOTHING or end <= start:
                continue
            rows = [(start, end, phase.detail)] if phase.parts is None else phase.parts(start, end)
            for begin, over, detail in rows:
                self._add(begin, over, phase.state, detail)
        self._told = max(self._told, now)

    def _add(self, start: Time, end: Time, state: str, detail: str) -> None:
        if self._listen is not None:
            self._listen(self._robot, start, end, state)
        if self._last is not None and self._last[1:] == (start, state, detail):
            start = self._last[0]
        else:
            self._write_last()
        self._last = start, end, state, detail

    def _write_last(self) -> None:
        if self._last is not None:
            self._intervals.add(self._robot, *self._last)
            self._last = None

    def under_way(self, now: Time) -> Interval | None:
        """Write what is over by *now*, and return what is not."""
        self.tell(now)
        if self._last is None:
            return None
        start, end, state, detail = self._last
        if end == now:
            return Interval(start, self._robot, now, 0, state, detail)
        self._write_last()
        return None

    def close(self, now: Time) -> None:
        """Write all of it: it ends *now*."""
        self.plan(now)
        self._write_last()


class Courses:
    """All courses of the devices on one air, and their other *intervals*.

    *listen*, if given, is called with what has come true, piece by piece.
    """

    def __init__(self, intervals: Intervals | None = None, listen: Listen | None = None) -> None:
        self.intervals = Intervals(Trace()) if intervals is None else intervals
        self.wanted = self.intervals.wanted or listen is not None
        """True if rows are kept, or told: else nobody need plan anything."""
        self._listen = listen
        self._courses: dict[Course, None] = {}  # in the order in which they began

    def begin(self, robot: Address) -> Course:
        """Return a new course of the device *robot*."""
        course = Course(self.intervals, robot, self._listen)
        if self.wanted:
            self._courses[course] = None
        return course

    def end(self, course: Course, now: Time) -> None:
        """Write *course*, which ends *now*, and forget it; nothing happens if it has ended before."""
        if course in self._courses:
            del self._courses[course]
            course.close(now)

    def tell(self, now: Time) -> None:
        """Write what has come true of all of them before *now*."""
        for course in self._courses:
            course.tell(now)

    def under_way(self, now: Time) -> list[Interval]:
        """Return what all of them are in *now*."""
        rows = (course.under_way(now) for course in self._courses)
        return [row for row in rows if row is not None]

    def close(self, now: Time) -> None:
        """Write all of them: the run is over."""
        for course in list(self._courses):
            self.end(course, now)
