"""What a page is told of a run: where everything is, and what has happened since it was told last."""

from collections.abc import Collection, Sequence
from typing import Any, Final, NamedTuple

from cosim.units import Time, to_seconds
from cosim.web.messages import Plain
from cosim.web.rows import Row, Rows

MOST_FRAMES: Final = 300
MOST_EVENTS: Final = 200
"""In one message: a page that is slow, or a run that is fast, gets the newest."""
TRAIL_TICKS: Final = 1200
TRAIL_POINTS: Final = 240
"""How far back trails go for a page that has just come, and of how many points they are."""
DOWN: Final = frozenset({"Killed", "Crashed", "BatteryEmpty"})
UP: Final = frozenset({"Rebooted"})
"""Events after which a robot does nothing, and after which it does something again."""


class Cursor(NamedTuple):
    """Up to where a page has been told: the jumps in time, and the numbers of rows."""

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
    """playing, paused, ended or failed; or busy: it is none of these yet, as far as is known."""
    speed: float
    robots: Sequence[Row]
    """Of each robot x and y (m), heading (rad), and whether it is down."""
    jumps: int = 0
    """How often time has jumped: what was told before a jump is to be forgotten."""
    why: str = ""
    """What it has failed of."""

    @property
    def shown(self) -> tuple[Any, ...]:
        """What a page shows of it beyond what happens: nothing new is to be told while it is the same."""
        return self.time, self.state, self.speed, self.why


class History(NamedTuple):
    """What has happened, by kinds."""

    ticks: Rows
    """Of each world tick a row, three numbers a robot: x, y (m) and heading (rad)."""
    frames: Rows
    """Start (s), transmitter, receiver or -1, packet type, what became of it, length (B)."""
    events: Rows
    """Number, time (s), robot, event, its fields."""
    marks: Rows
    """Those of the events that tell of a place."""

    def now(self, moment: Moment, cursor: Cursor | None) -> tuple[Plain | None, Cursor]:
        """Return the message ``now`` for a page that has been told up to *cursor*, and the new cursor.

        None instead of a message if the page has been told all that.
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
        """Return what a page must be told of the past that has not seen it."""
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
    """Return which of an event's fields begin a place on the floor: ``x_m`` or ``goal_x_m``, with its y beside it."""
    return [name for name in names if name.endswith("x_m") and f"{name[:-3]}y_m" in names]
