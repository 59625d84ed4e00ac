"""Ways to goals: what a robot can promise, and what it has been promised (paper 000, sections 3.2, 4.2 and 4.3).

For each owner a robot remembers at most one way to the owner's goal: a place, and the length of the way from that place
on. All cases that the paper distinguishes are such ways:

- a robot that sees the goal has the goal itself as the place, and nothing is left from there: D = dist(R, G);
- a robot that loses sight of it has, as its own *ghost*, the last place from which it was seen (section 4.3, Fig. 8),
  and once that is out of sight too, the last place from which that was seen, and so on;
- a robot that is promised a way of D by another has the place of the other at that time (section 4.2, Fig. 7), where a
  ghost remains when the other leaves: D' = dist(R, ghost) + D.

The present length, dist(R, place) + rest, is sent to others, and another promise has to beat it; only shorter promises
count, also from the same robot. Every length is that of a polyline from the robot to the goal, so by the triangle
inequality it never falls below the straight line (to the goal's place as it was when it was seen).

A seeker that has reached a ghost and does not see its goal, or cannot get there, has found the promise *useless*, and
no longer follows it. The parameter ``renewal`` chooses which promises count then, by three readings of section 4.2:

- ``stored``, the literal one: "R1 stores in its memory D11(t1) = dist(R1(t1), R2(t1)) + D12(t1)", and compares with
  this number, which only another goal resets. So only promises count that are shorter than the useless one was when it
  was taken; each promise taken is shorter than all before it, and there are finitely many for a goal;
- ``shorter``: the way by the useless place stays the one to beat, its length computed again wherever the robot is. A
  robot that walks away from that place accepts ever longer promises, and may be called back as long as helpers pass;
- ``any``: everything counts again.

While a promise is followed, the parameter ``comparison`` chooses what another has to beat, in all three:

- ``remaining``: what is left of its way, from where the robot is now. Both ways are then measured from one place;
- ``stored``, the literal one: the number D11(t1) again, until another promise is taken. A robot that has come near the
  place of its promise may turn to one that leads farther round.

For ways that no other robot promised (the goal is in sight, or an own ghost) it is the present length, as in section
4.3.
"""

import math
from collections.abc import Sequence
from typing import Final, Literal

from cosim.machine import Address
from cosim.units import Time
from protocols.reflection.goals import GoalBook

Point = tuple[float, float]
Renewal = Literal["stored", "shorter", "any"]
Comparison = Literal["remaining", "stored"]

GAIN_M: Final = 1e-3
"""Least difference by which a way counts as shorter: more than the wire's rounding."""


class Way:
    """The way to one goal: a place in the own frame, and what is left of the way from there, metres."""

    __slots__ = ("direct", "promised_m", "rest_m", "seen", "used_up", "via", "x_m", "y_m")

    def __init__(self, x_m: float, y_m: float, rest_m: float, seen: Time, via: Address, direct: bool) -> None:
        self.x_m = x_m
        self.y_m = y_m
        self.rest_m = rest_m
        self.seen = seen
        """When a robot saw the goal last, at the other end of the way; passed on unchanged."""
        self.via = via
        """The robot that promised it; this robot itself, if it has seen the goal."""
        self.direct = direct
        """True if the goal is in sight, and the place is the goal's."""
        self.used_up = False
        """True if the promise was found useless, and is kept as one that others have to beat."""
        self.promised_m = math.inf
        """Length of the way, from where the robot was when it was promised; infinite if no other robot did."""

    def length(self, x_m: float, y_m: float) -> float:
        """Return the length of the way from (x, y) on, metres."""
        return self.rest_m + math.hypot(self.x_m - x_m, self.y_m - y_m)


class Ways:
    """One robot's ways to the goals of all robots, at most one for each."""

    def __init__(self, book: GoalBook, life: Time | None, comparison: Comparison = "remaining") -> None:
        """Know the goals of *book*; forget ways whose goal no robot has seen for *life* ns, if that is not None."""
        self.book = book
        self.me = book.me
        self.of: list[Way | None] = [None] * book.team
        self.bound_m = math.inf
        """Length that promises for the own goal have to beat."""
        self._life = life
        self._stored = comparison == "stored"
        self._last: Point | None = None

    def points(self) -> list[Point]:
        """Return the places whose visibility ``look`` needs to know, in its order."""
        points: list[Point] = []
        book, ways = self.book, self.of
        xs, ys = book.x_m, book.y_m
        for owner in book.known:
            points.append((xs[owner], ys[owner]))
            way = ways[owner]
            if way is not None and not way.direct and owner != self.me:
                points.append((way.x_m, way.y_m))
        return points

    def look(self, visible: Sequence[bool], x_m: float, y_m: float, now: Time) -> None:
        """Note what is in sight from (x, y): *visible* answers all ``points``."""
        at, ways = 0, self.of
        for owner in self.book.known:
            way = ways[owner]
            ghost = 0 if way is None or way.direct or owner == self.me else 1  # its answer follows the goal's
            if visible[at]:
                self._seen(owner, way, now)
            elif way is not None:
                self._unseen(owner, way, visible[at + 1] if ghost else not way.direct, now)
            at += 1 + ghost
        self._last = x_m, y_m

    def offer(self, owner: Address, place_m: Point, rest_m: float, seen: Time, via: Address, here_m: Point) -> bool:
        """Take the promise of *via*, seen at *place_m*, if its way from *here_m* is shorter; return whether it is."""
        x, y = here_m
        length = rest_m + math.hypot(place_m[0] - x, place_m[1] - y)
        way = self.of[owner]
        if way is not None:
            if way.direct:
                return False
            to_beat = way.rest_m + math.hypot(way.x_m - x, way.y_m - y)  # its length, in line
            if self._stored and way.promised_m < math.inf and not way.used_up:
                to_beat = way.promised_m
            if length > to_beat - GAIN_M:
                return False
        if owner == self.me and length > self.bound_m - GAIN_M:
            return False
        way = self.of[owner] = Way(place_m[0], place_m[1], rest_m, seen, via, False)
        way.promised_m = length
        return True

    def forget(self, owner: Address) -> None:
        """Forget the way to *owner*'s goal."""
        self.of[owner] = None

    def useless(self, way: Way, renewal: Renewal) -> None:
        """Stop following *way*, the promise for the own goal."""
        if renewal == "shorter":
            way.used_up = True
            return
        self.of[self.me] = None
        if renewal == "stored":
            self.bound_m = way.promised_m

    def new_goal(self) -> None:
        """Accept all promises again, as the own goal is another one."""
        self.of[self.me] = None
        self.bound_m = math.inf

    def displaced(self) -> None:
        """Forget all that depends on the way that the robot has come, as it was moved."""
        self.of = [None] * len(self.of)
        self.bound_m = math.inf
        self._last = None

    def _seen(self, owner: Address, way: Way | None, now: Time) -> None:
        book = self.book
        if way is None or not way.direct:
            self.of[owner] = Way(book.x_m[owner], book.y_m[owner], 0.0, now, self.me, True)
        else:
            way.x_m, way.y_m, way.seen = book.x_m[owner], book.y_m[owner], now

    def _unseen(self, owner: Address, way: Way, ghost_visible: bool, now: Time) -> None:
        """Update the way to a goal out of sight: if its ghost is out of sight too, the last place becomes the ghost."""
        if self._life is not None and now - way.seen > self._life:
            self.of[owner] = None
        elif not ghost_visible and self._last is not None:
            way.rest_m = way.length(*self._last)
            way.x_m, way.y_m = self._last
            way.direct = False
            way.promised_m = math.inf
