"""Where a robot with goals of its own heads (paper 000, rule 5, and section 5, rule 3).

It heads straight for the goal itself when that is in sight; else for the place of the shortest promise; else, when it
is in trouble, for a robot that is not; else wherever the algorithm A leads. If it makes no progress on a straight way
(a body is wider than a line of sight), it first rounds what is in the way, then leaves the way: a promise is used up, a
goal in sight left to A.
"""

import math
from collections.abc import Mapping
from enum import IntEnum
from typing import Final

from cosim.machine import Address, Event
from cosim.navigation.steering import Navigator
from cosim.observation import Observation
from cosim.units import Time, from_seconds
from protocols.reflection.events import (
    Counters,
    GhostReached,
    GoalGivenUp,
    GoalReached,
    GoalSet,
    PromiseForgotten,
    PromiseTaken,
)
from protocols.reflection.guidance import LoopWalk
from protocols.reflection.parameters import Parameters
from protocols.reflection.promises import Way, Ways
from protocols.reflection.setup import Point, Setup
from protocols.reflection.straight import AHEAD_STEPS, Straight
from protocols.reflection.trouble import HelpState, Trouble
from protocols.reflection.yielding import Standoff

FOLLOW_CONTACTS = 2.5
"""Distance that a follower keeps from its helper, which has to turn round, in distances of two bodies that touch."""
# A decimetre beside a ghost, a door may hide the goal.
AT_M = 0.01
"""Distance from a ghost at which a robot is where its helper was."""
NOWHERE = (1e5, 1e5)
"""Goal for a navigator that has to find a goal whose place no robot knows."""


class Target(IntEnum):
    """The kinds of places that a robot heads for."""

    GOAL = 0
    PROMISE = 1
    HELPER = 2
    ALGORITHM = 3


GOAL: Final = Target.GOAL  # Python 3.11 finds a member in its class ten times slower than a name in its module
PROMISE: Final = Target.PROMISE
HELPER: Final = Target.HELPER
ALGORITHM: Final = Target.ALGORITHM


class Seeker:
    """One robot on its way from goal to goal."""

    def __init__(
        self,
        parameters: Parameters,
        setup: Setup,
        ways: Ways,
        navigator: Navigator,
        straight: Straight,
        events: list[Event],
        counters: Counters,
        start: Time,
    ) -> None:
        """Begin with the first goal; report in *events* and *counters*."""
        self.me = ways.me
        self.finished = False
        self.target = ALGORITHM
        self._parameters = parameters
        self._follow_m = FOLLOW_CONTACTS * 2.0 * setup.radius_m
        self._step_m = setup.steps_m[self.me]
        self._goals_m = setup.tasks[self.me].goals_m
        self._objects = parameters.goals == "object"
        self._epsilon_m = parameters.epsilon_m
        self._book = ways.book
        self._ways = ways
        self._navigator = navigator
        self._straight = straight
        self._events = events
        self._counters = counters
        self._states_shared = parameters.states_shared
        self._help = HelpState(parameters, self._step_m, events, counters)
        self._standoff = Standoff(self.me, setup.radius_m, from_seconds(parameters.patience_s))
        self._detour = from_seconds(parameters.detour_s)
        self._give_up = from_seconds(parameters.give_up_s)
        self._walk = (
            LoopWalk(navigator, straight, self._step_m, self._follow_m)
            if parameters.algorithm == "visbug" and not self._objects
            else None
        )
        self._followed: Way | None = None
        self._going: Point | None = None
        self._hidden = False
        """True if it heads for where its helper was seen last."""
        self._place: Point = (0.0, 0.0)
        self._number = 0
        self._detours = 0
        self._reflected = False
        self._left_until = start
        """Time until which a goal in sight is left to the algorithm A."""
        self._next(start)

    @property
    def number(self) -> int:
        """Number of the present goal, from 1."""
        return self._number

    @property
    def trouble(self) -> Trouble:
        """The robot's trouble."""
        return self._help.trouble

    @property
    def goal_m(self) -> Point:
        """The present goal in the own frame, metres."""
        return self._goals_m[self._number - 1]

    @property
    def place_m(self) -> Point | None:
        """The place that it heads straight for, in the own frame; None where the algorithm A leads it."""
        return None if self.target is ALGORITHM else self._place

    def arrive(self, x_m: float, y_m: float, now: Time) -> None:
        """Turn to the next goal if this one is reached or has taken too long; to be called first at a tick."""
        if self.finished:
            return
        goal_x, goal_y = self._goals_m[self._number - 1]
        if math.hypot(goal_x - x_m, goal_y - y_m) < self._epsilon_m and (not self._objects or self._sees_goal()):
            self._counters.reached += 1
            self._events.append(GoalReached(self._number))
            self._next(now)
        elif now - self._since >= self._give_up:
            self.give_up("time", now)

    def give_up(self, reason: str, now: Time) -> None:
        """Give up the present goal."""
        self._counters.given_up += 1
        self._events.append(GoalGivenUp(self._number, reason))
        self._next(now)

    def displaced(self, now: Time) -> None:
        """Begin again from where the robot was moved to."""
        self._followed = self._going = None
        self._navigator.restart()
        self._help.turn()
        self._help.lose()
        self._straight.begin(now)

    def promised(self, now: Time) -> None:
        """Note that the best way to the own goal is now a new promise."""
        self._counters.promises += 1
        if not self._reflected:
            self._reflected = True
            self._counters.reflected += 1
            self._counters.waited += now - self._since

    def choose(
        self,
        observation: Observation,
        sightings: Mapping[Address, Point],
        states: Mapping[Address, bool],
        now: Time,
    ) -> Point:
        """Return where to go from here, a place in the own frame; to be called once a tick."""
        here = observation.x_m, observation.y_m
        aside = self._standoff.evade(observation, sightings, now) if sightings else None
        if aside is not None:
            self._counters.steps[ALGORITHM] += 1
            self._going = aside
            return aside
        way: Way | None
        if self._followed is not None and self._straight.rounding:  # it goes on, though it may see nothing from here
            target, place, way = self.target, self._place, self._followed
        else:
            way = self._followable(here, now)
            target, place = self._pick(way, here, sightings, states)
        self._place = place
        if target is not self.target or way is not self._followed:
            self._turn_to(target, way, here, now)
        self._counters.steps[target] += 1
        if target is ALGORITHM:
            going = self._by_algorithm(observation, sightings, place, now)
        elif target is HELPER:
            going = self._to_helper(observation, place, now)
        else:
            assert way is not None
            length = way.length(*here) if target is PROMISE else math.dist(here, place)
            going = self._straight.towards(place, length, observation, now)
            if self._straight.stalled(now):
                self._leave(way, now)
        if self._states_shared and not self.finished:
            keeps_up = self.target is HELPER and not self._help.hidden and math.dist(here, place) < self._follow_m
            self._help.judge(here, place, keeps_up)
        self._going = going
        return going

    # ------------------------------------------------------------ goals

    def _sees_goal(self) -> bool:
        way = self._ways.of[self.me]
        return way is not None and way.direct

    def _next(self, now: Time) -> None:
        self._number += 1
        self._since = now
        self._reflected = False
        self._followed = None
        self._ways.new_goal()
        self._straight.begin(now)
        if self._number > len(self._goals_m):
            self.finished = True
            self._book.clear_own()
            return
        self._book.set_own(self._number, *self.goal_m)
        self._navigator.restart()
        self._help.new_goal()
        self._left_until = now
        self._detours = 0
        self._events.append(GoalSet(self._number))

    # ------------------------------------------------------------ what to head for

    def _followable(self, here: Point, now: Time) -> Way | None:
        """Return the way to follow straight now, if any; report how the way that was followed has ended."""
        way = self._ways.of[self.me]
        followed = self._followed
        if way is None:
            if followed is not None:
                self._events.append(PromiseForgotten(followed.via, "out of sight, or too old"))
            return None
        if way.used_up:
            return None
        if way.via == self.me:
            if now >= self._left_until and (way.direct or self.target is GOAL):
                return way
            if not way.direct:  # its own ghost: it learns nothing where it has been
                self._ways.forget(self.me)
            return None
        if math.hypot(way.x_m - here[0], way.y_m - here[1]) > AT_M:
            return way
        self._counters.ghosts += 1
        self._events.append(GhostReached(way.via))
        self._ways.useless(way, self._parameters.renewal)
        return None

    def _pick(
        self, way: Way | None, here: Point, sightings: Mapping[Address, Point], states: Mapping[Address, bool]
    ) -> tuple[Target, Point]:
        if way is not None:
            self._help.lose()
            if way.via != self.me:
                return PROMISE, (way.x_m, way.y_m)
            return GOAL, (way.x_m, way.y_m) if way.direct else self._place
        helper = self._help.helper(here, sightings, states) if self._states_shared else None
        if helper is not None:
            return HELPER, helper
        if self._objects:  # no robot knows where it is: random motion has no use for a place
            return ALGORITHM, NOWHERE
        return ALGORITHM, self.goal_m

    def _turn_to(self, target: Target, way: Way | None, here: Point, now: Time) -> None:
        """Begin to head for something else than before."""
        followed = self._followed
        self._help.turn()
        if target is not self.target:
            self._straight.begin(now)
        if target is PROMISE and way is not None and (followed is None or followed.via != way.via):
            self._events.append(PromiseTaken(way.via, way.length(*here)))
        self.target = target
        self._followed = way

    def _leave(self, way: Way, now: Time) -> None:
        """Stop trying to go straight to where *way* leads."""
        self._straight.begin(now)
        if way.via == self.me:
            self._left_until = now + (self._detour << self._detours)
            self._detours += 1
        else:
            self._ways.useless(way, self._parameters.renewal)
            self._followed = None
            self._events.append(PromiseForgotten(way.via, "no progress"))

    # ------------------------------------------------------------ how to get there

    def _by_algorithm(
        self, observation: Observation, sightings: Mapping[Address, Point], place: Point, now: Time
    ) -> Point:
        x, y = observation.x_m, observation.y_m
        if self._walk is not None:
            going = self._walk.choose(observation, sightings, place, self._going, now)
            if going is None:
                self.give_up("unreachable", now)
            return going or (x, y)
        steer = self._navigator.steer(x, y, place, observation.ranges_m, list(sightings.values()), self._step_m)
        ahead = AHEAD_STEPS * self._step_m
        return x + ahead * steer.dx, y + ahead * steer.dy

    def _to_helper(self, observation: Observation, place: Point, now: Time) -> Point:
        x, y = observation.x_m, observation.y_m
        distance = math.dist((x, y), place)
        if self._help.hidden is not self._hidden:
            self._hidden = self._help.hidden
            if self._hidden:  # a place that is not come nearer to is left; one that moves away may be far for long
                self._straight.begin(now)
        if not self._hidden and distance < self._follow_m:
            return x, y
        if self._hidden and self._straight.stalled(now):
            self._help.lose()
        return self._straight.towards(place, distance, observation, now)
