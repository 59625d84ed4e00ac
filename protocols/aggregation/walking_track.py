"""A track: what is left of a way, and how far a robot is along it and off it."""

from cosim.geometry.planning import Point
from cosim.geometry.polylines import length_m, off_m


class Track:
    """Way points that a robot goes straight to, one after the other; there is at least one."""

    def __init__(self, here: Point, points_m: list[Point]) -> None:
        self._points = points_m
        self._begin = here

    @property
    def place(self) -> Point:
        """Where the robot goes straight to now."""
        return self._points[0]

    @property
    def following(self) -> Point | None:
        """The way point after that, if there is one."""
        return self._points[1] if len(self._points) > 1 else None

    @property
    def end(self) -> Point:
        """The last way point."""
        return self._points[-1]

    @property
    def points_m(self) -> list[Point]:
        """All way points that are left; not to be changed."""
        return self._points

    def go_on(self, here: Point) -> None:
        """Head for the following way point from *here*."""
        del self._points[0]
        self._begin = here

    def restart(self, here: Point) -> None:
        """Head for the same way point from *here*."""
        self._begin = here

    def left_m(self, here: Point) -> float:
        """Return how long the way is that is left, from *here*."""
        return length_m((here, *self._points))

    def off_m(self, here: Point) -> float:
        """Return how far *here* is off the straight piece that the robot follows."""
        return off_m(here, self._begin, self._points[0])
