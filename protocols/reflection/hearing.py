"""What a robot takes from the frames of the robots that it sees: their goals, and ways to its own (rules 1 to 4)."""

import math

from cosim.machine import Address, Event
from cosim.units import MS, Time, from_seconds
from protocols.reflection.bearings import Point, from_peer, turn_between
from protocols.reflection.counters import Counters
from protocols.reflection.events import BadBytes
from protocols.reflection.frames import CLOCK_MS, Frame
from protocols.reflection.goals import NEW, GoalBook, goal_number
from protocols.reflection.parameters import Parameters
from protocols.reflection.promises import Ways
from protocols.reflection.setup import Setup


class Hearing:
    """One robot's ear: it puts down what others tell in its book of goals and its ways."""

    def __init__(
        self,
        parameters: Parameters,
        setup: Setup,
        book: GoalBook,
        ways: Ways,
        events: list[Event],
        counters: Counters,
        start: Time,
    ) -> None:
        """Report bad numbers in *events*, and count advice in *counters*."""
        self.me = book.me
        self._book = book
        self._ways = ways
        self._events = events
        self._counters = counters
        self._start = start
        self._size = setup.size
        self._stale = from_seconds(parameters.stale_s)
        self._objects_m = setup.tasks[self.me].objects_m if parameters.goals == "object" else None
        self._metres_per_ms = tuple(step_m * MS / setup.tick for step_m in setup.steps_m)
        self._here: Point = (0.0, 0.0)
        self._looked_ms = 0

    def looked(self, here_m: Point, now: Time) -> None:
        """Note where the robot is at the tick at which it sees the others where they are seen."""
        self._here = here_m
        self._looked_ms = (now - self._start) // MS

    def goals(self, frame: Frame, peer_m: Point) -> None:
        """Rules 1 and 2: put down the goals that a robot tells, which is seen at *peer_m* and sees this one."""
        identifiers, me, size = self._book.identifiers, self.me, self._size
        for owner, identifier, _, _ in frame.terms:  # most are no news: only for others the turn is computed
            if owner >= size or (owner != me and identifier >= identifiers[owner]):
                self._put_down(frame, peer_m)
                return

    def _put_down(self, frame: Frame, peer_m: Point) -> None:
        me, book = self.me, self._book
        for robot, angle in frame.bearings:
            if robot == me:
                bearing = angle
                break
        else:
            return
        here, turn = self._here, None
        for owner, identifier, along, across in frame.terms:
            if owner >= self._size:
                self._events.append(BadBytes(f"a goal of robot {owner} in a team of {self._size}"))
            elif owner != me and identifier >= book.identifiers[owner]:
                place: Point | None
                if self._objects_m is None:
                    if turn is None:
                        turn = turn_between(math.atan2(peer_m[1] - here[1], peer_m[0] - here[0]), bearing)
                    place = from_peer((along, across), peer_m, turn)
                else:
                    place = self._looks_like(owner, identifier)
                if place is not None and book.consider(owner, identifier, *place) is NEW:
                    self._ways.forget(owner)

    def promises(self, frame: Frame, peer: Address, peer_m: Point, now: Time) -> bool:
        """Rules 3 and 4: put down what *peer*, which is seen at *peer_m*, can promise.

        Return whether that is now the way to the own goal.
        """
        me, team, ways = self.me, self._size, self._ways
        identifiers, of = self._book.identifiers, ways.of
        arrival_ms = (now - self._start) // MS
        moved_m = 0.0 if frame.stamp_ms == self._looked_ms else self._moved_since(frame.stamp_ms, peer)
        own = False
        for owner, identifier, length, seen_ms in frame.pledges:
            if owner >= team:
                self._events.append(BadBytes(f"a promise for robot {owner} in a team of {team}"))
                continue
            known = identifiers[owner]
            same_goal = identifier == known or (known and (identifier - 1) // team == (known - 1) // team)
            if owner == me:
                late = (arrival_ms - frame.stamp_ms) % CLOCK_MS * MS > self._stale
                self._counters.count_advice(not same_goal, late)
            way = of[owner]
            if same_goal and not (way is not None and way.direct):  # no promise is shorter than what is in sight
                seen = now - (arrival_ms - seen_ms) % CLOCK_MS * MS
                taken = ways.offer(owner, peer_m, length + moved_m, seen, peer, self._here)
                own = own or (taken and owner == me)
        return own

    def _looks_like(self, owner: Address, identifier: int) -> Point | None:
        """Return where the object is that *identifier* means, for ``sees`` to answer whether it is in sight."""
        assert self._objects_m is not None
        objects = self._objects_m[owner]
        number = goal_number(identifier, self._size)
        return objects[number - 1] if number <= len(objects) else None

    def _moved_since(self, stamp_ms: int, peer: Address) -> float:
        """Return how far *peer* can have driven, metres, from when it told its promises to where it was seen last.

        A way leads to where the peer is seen, but was measured from where it stood then. In the paper both are one
        instant; a frame that takes longer than a tick would otherwise promise less than the straight line.
        """
        lag_ms = (self._looked_ms - stamp_ms) % CLOCK_MS
        return self._metres_per_ms[peer] * min(lag_ms, CLOCK_MS - lag_ms) if lag_ms else 0.0
