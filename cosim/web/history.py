"""What a page is sent of a run: where everything is, and what has happened since the last message."""

from collections.abc import Collection, Sequence
from typing import Any, Final, NamedTuple

from cosim.units import Time, to_seconds
from cosim.web.messages import Plain
from cosim.web.rows import Row, Rows

# a page that is slow, or looks at a fast run, gets the newest rows only
MOST_FRAMES: Final = 300
"""Maximum number of frames in a message."""
MOST_EVENTS: Final = 200
"""Maximum number of events in a message."""
TRAIL_TICKS: Final = 1200
"""Number of ticks that the trails in a page's first message go back."""
TRAIL_POINTS: Final = 240
"""Maximum number of points, roughly, of such a trail."""
DOWN: Final = frozenset({"Killed", "Crashed", "BatteryEmpty"})
"""Events after which a robot does nothing any more."""
UP: Final = frozenset({"Rebooted"})
"""Events after which a robot that was down acts again."""


class Cursor(NamedTuple):
    """What a page has been sent: the number of jumps in time, and of rows."""

    jumps: int
    frames: int
    events: int
    shown: tuple[Any, ...]
    operator: int = 0
    ended: bool = False


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
    """A row for each world tick, with three numbers for each robot: x, y (m) and heading (rad)."""
    frames: Rows
    """Rows of start (s), transmitter, receiver or -1, packet type, outcome, length (B)."""
    events: Rows
    """Rows of number, time (s), robot, event, its fields."""
    marks: Rows
    """The events that have a place among their fields."""

    def now(self, moment: Moment, cursor: Cursor | None) -> tuple[Plain | None, Cursor]:
        """Return the message ``now`` for a page that has been sent all up to *cursor*, and the new cursor.

        The message is None if there is nothing new for the page.
        """
        frames, events = self.frames.until(moment.time), self.events.until(moment.time)
        fresh = cursor is None or cursor.jumps != moment.jumps
        known = cursor or Cursor(moment.jumps, frames, events, ())
        new = known._replace(jumps=moment.jumps, frames=frames, events=events, shown=moment.shown)
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
        if fresh:
            return message | self._from_before(moment.time, events), new
        message["frames"] = self.frames.between(max(known.frames, frames - MOST_FRAMES), frames)
        message["events"] = self.events.between(max(known.events, events - MOST_EVENTS), events)
        message["left_out"] = max(0, events - MOST_EVENTS - known.events)
        return message, new

    def _from_before(self, time: Time, events: int) -> Plain:
        """Return what a page that has just connected is sent of the past."""
        marks = self.marks.until(time)
        before = self.marks.between(marks - MOST_EVENTS, marks) + self.events.between(events - MOST_EVENTS, events)
        by_number = {row[0]: row for row in before}
        end = self.ticks.until(time)
        first = max(self.ticks.first, end - TRAIL_TICKS)
        ticks = self.ticks.between(first, end, max(1, (end - first) // TRAIL_POINTS))
        return {
            "fresh": True,
            "frames": [],
            "events": [by_number[number] for number in sorted(by_number)],
            "left_out": 0,
            "trails": [list(map(list, zip(each[::3], each[1::3], strict=True))) for each in ticks],
        }


def places(names: Collection[str]) -> list[str]:
    """Return those of the fields *names* of an event that are the x of a place: ``x_m`` or ``goal_x_m``, with a y."""
    return [name for name in names if name.endswith("x_m") and f"{name[:-3]}y_m" in names]
