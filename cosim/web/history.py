"""What a page is sent of a run: where everything is, and what has happened since the last message."""

from collections.abc import Collection, Hashable, Mapping, Sequence
from typing import Any, Final, NamedTuple

from cosim.units import Time, to_seconds
from cosim.web.activity import Activity
from cosim.web.air import Air
from cosim.web.beliefs import Beliefs
from cosim.web.messages import Plain
from cosim.web.rows import Row, Rows

MOST_EVENTS: Final = 200
"""Maximum number of events in a message: a page that is slow, or looks at a fast run, gets the newest only."""
MOST_OF_KIND: Final = 20
"""Maximum number of events of each type that are told besides these."""
TRAIL_TICKS: Final = 240
"""Number of ticks that the trails in a page's first message go back, before which they are coarse."""
TRAIL_POINTS: Final = 600
"""Maximum number of points, roughly, of the coarse part."""
DOWN: Final = frozenset({"Killed", "Crashed", "BatteryEmpty"})
"""Events after which a robot does nothing any more."""
UP: Final = frozenset({"Rebooted"})
"""Events after which a robot that was down acts again."""


class Cursor(NamedTuple):
    """What a page has been sent: of which run, the number of jumps in time, and of rows; what robots were doing."""

    jumps: int
    frames: int
    events: int
    shown: tuple[Any, ...]
    operator: int = 0
    ended: bool = False
    doing: Hashable = None
    run: int = 0
    believed: Plain | None = None


class Moment(NamedTuple):
    """A run at an instant."""

    time: Time
    state: str
    """playing, paused, ended or failed; or busy, while the simulation is slow to answer which of these it is."""
    speed: float
    robots: Sequence[Row]
    """Of each robot x and y (m), heading (rad), and whether it is down."""
    jumps: int = 0
    """Number of times that time has jumped: a page forgets what it was sent before a jump."""
    why: str = ""
    """Cause of the failure."""

    @property
    def shown(self) -> tuple[Any, ...]:
        """What a page shows of it besides rows: without a change of it, and new rows, no message is sent."""
        return self.time, self.state, self.speed, self.why


class History(NamedTuple):
    """What has happened, by kinds."""

    ticks: Rows
    """A row for each world tick: its time (s), and three numbers for each robot, x, y (m) and heading (rad)."""
    air: Air
    activity: Activity
    beliefs: Beliefs
    events: Rows
    """Rows of number, time (s), robot, event, its fields."""
    marks: Rows
    """The events that have a place among their fields."""
    kinds: Mapping[str, Rows]
    """The events of each type, by its name."""

    def now(self, moment: Moment, cursor: Cursor | None) -> tuple[Plain | None, Cursor]:
        """Return the message ``now`` for a page that has been sent all up to *cursor*, and the new cursor.

        The message is None if there is nothing new for the page. ``doing`` is in it if that differs from what was
        sent, and so are the parts of ``beliefs``.
        """
        events = self.events.until(moment.time)
        doing, intervals = self.activity.at(moment.time)
        fresh = cursor is None or cursor.jumps != moment.jumps
        known = cursor or Cursor(moment.jumps, 0, events, ())
        frames = self.air.until(moment.time)
        before = {} if fresh or known.believed is None else known.believed
        believed = self.beliefs.told(moment.time, before)
        new = known._replace(jumps=moment.jumps, frames=frames, events=events, shown=moment.shown, doing=doing)
        new = new._replace(believed=before | believed)
        if new == cursor:
            return None, new
        message: Plain = {
            "say": "now",
            "time_s": to_seconds(moment.time),
            "state": moment.state,
            "speed": moment.speed,
            "why": moment.why,
            "robots": moment.robots,
        }
        message |= self.air.at(moment.time, moment.speed)
        if fresh or doing != known.doing:
            message["doing"] = intervals()
        if believed:
            message["beliefs"] = believed
        if fresh:
            return message | self._from_before(moment.time, events), new
        message["events"] = self._between(known.events, events, moment.time)
        message["left_out"] = events - known.events - len(message["events"])
        return message, new

    def _between(self, first: int, end: int, time: Time, marks: Sequence[Row] = ()) -> list[Row]:
        """Return the events from *first* to before *end*, at *time*: the latest, also of each kind."""
        rows = [*marks, *self.events.between(max(first, end - MOST_EVENTS), end)]
        if end - first > MOST_EVENTS:
            for of_kind in self.kinds.values():
                count = of_kind.until(time)
                rows += of_kind.between(count - MOST_OF_KIND, count)
        by_number = {row[0]: row for row in rows if row[0] >= first}
        return [by_number[number] for number in sorted(by_number)]

    def _from_before(self, time: Time, events: int) -> Plain:
        """Return what a page that has just connected is sent of the past."""
        marks = self.marks.until(time)
        marked = self.marks.between(marks - MOST_EVENTS, marks)
        return {
            "fresh": True,
            "events": self._between(0, events, time, marked),
            "left_out": 0,
            "trails": self._trails(time),
        }

    def _trails(self, time: Time) -> list[list[Any]]:
        """Return rows of a time (s) and the place of each robot then: all of late, and fewer of long ago."""
        end = self.ticks.until(time)
        late = max(self.ticks.first, end - TRAIL_TICKS)
        step = max(1, (late - self.ticks.first) // TRAIL_POINTS)
        ticks = self.ticks.between(self.ticks.first, late, step) + self.ticks.between(late, end)
        return [[tick[0], *map(list, zip(tick[1::3], tick[2::3], strict=True))] for tick in ticks]


def places(names: Collection[str]) -> list[str]:
    """Return those of the fields *names* of an event that are the x of a place: ``x_m`` or ``goal_x_m``, with a y."""
    return [name for name in names if name.endswith("x_m") and f"{name[:-3]}y_m" in names]
