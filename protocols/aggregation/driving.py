"""How a host keeps to the way that it has told: it heads for where its plan has it a little later.

Its body may be faster than its plan: then it is there too early, and waits; so it is never far from where it should be,
and catches up when it has been held up.
"""

from typing import Final

from cosim.machine import Command
from cosim.observation import Observation
from cosim.units import S, Time
from protocols.aggregation.course import Course
from protocols.aggregation.touring import Feet

AHEAD: Final[Time] = 4 * S
"""So far ahead of the plan's place it looks, and at most so often."""


class Driver:
    """Takes a host along its course; it catches up when it has been held up."""

    def __init__(self, feet: Feet) -> None:
        self._feet = feet
        self._course: Course | None = None
        self._next: Time = 0

    def step(self, course: Course, observation: Observation, now: Time) -> Command | None:
        """Return the next order along *course*, if there is a new one."""
        if course is not self._course or (now >= self._next and self._feet.arrived):
            self._course, self._next = course, now + AHEAD
            self._feet.head_for(course.place(now + AHEAD))
        return self._feet.step(observation)
