"""State sharing: when a robot is in trouble, and which robot helps it out (paper 000, section 5).

A robot counts Pr up by Nt at each step without progress towards its goal, and down by 1 at each step with progress. It
is in trouble, Tr, from Pr = Cr on, until Pr = 0; then Nt, which begins at 1, grows by one, so that the next trouble
comes sooner and lasts longer: Pr is bounded by Nt Cr.

As printed the rule is inconsistent: steps of Nt can jump over Pr = Cr, and with the equality Tr would be set again on
the way down, whenever Pr passes Cr. Ours sets Tr at Pr >= Cr; the printed rule is the other choice.
"""

import math
from collections import deque
from collections.abc import Mapping

from cosim.machine import Address, Event
from protocols.reflection.events import Counters, TroubleChanged
from protocols.reflection.parameters import Parameters, ProgressMeasure, TroubleRule
from protocols.reflection.setup import Point


class Trouble:
    """The variables Tr, Pr and Nt of one robot; Cr is a parameter."""

    def __init__(self, limit: int, rule: TroubleRule = "reaches") -> None:
        self.limit = limit
        """Cr: motion steps without progress that make the first trouble."""
        self.active = False
        """True if the robot is in trouble, Tr."""
        self.level = 0
        """Pr, from 0 to Nt Cr."""
        self.weight = 1
        """Nt: one more than the times that the robot has got out of trouble."""
        self._rule = rule

    def step(self, progress: bool) -> bool:
        """Count a motion step; return whether Tr has changed."""
        before = self.active
        if progress:
            self.level -= self.level > 0
        else:
            self.level = min(self.level + self.weight, self.weight * self.limit)
        if self.level >= self.limit if self._rule == "reaches" else self.level == self.limit:
            self.active = True
        if before and self.level == 0:
            self.active = False
            self.weight += 1
        return self.active != before


class Progress:
    """A measure of whether a motion step has brought progress: an open choice in the paper.

    - ``window``: the robot is nearer to its target than *window* steps ago, by *share* of what it could be;
    - ``nearest``: it is nearer to its target than ever since it has that target, by *share* of a step;
    - ``step``: it is nearer than before the last step, by *share* of a step;
    - ``motion``: it has moved away from where it was *window* steps ago, by *share* of what it could have.

    As long as there are fewer than *window* steps to look back on, those count.
    """

    def __init__(self, measure: ProgressMeasure, window: int, share: float, step_m: float) -> None:
        self._measure = measure
        self._gain_m = share * step_m
        self._past: deque[tuple[float, float, float]] = deque(maxlen=window if measure in ("window", "motion") else 1)
        self._nearest_m = math.inf

    def restart(self) -> None:
        """Begin again, as the target is another one."""
        self._past.clear()
        self._nearest_m = math.inf

    def judge(self, x_m: float, y_m: float, target_m: tuple[float, float]) -> bool:
        """Return whether the step that has ended at (x, y) has brought progress towards *target_m*; call it once."""
        distance = math.hypot(target_m[0] - x_m, target_m[1] - y_m)
        past = self._past
        if not past:
            past.append((x_m, y_m, distance))
            self._nearest_m = distance
            return True
        then_x, then_y, then = past[0]
        gain = self._gain_m * len(past)
        past.append((x_m, y_m, distance))
        match self._measure:
            case "motion":
                return math.hypot(x_m - then_x, y_m - then_y) >= gain
            case "nearest":
                better = self._nearest_m - distance >= self._gain_m
                self._nearest_m = min(self._nearest_m, distance) if better else self._nearest_m
                return better
            case _:
                return then - distance >= gain


class HelpState:
    """One seeker's trouble, and the robot that it follows out of it."""

    def __init__(self, parameters: Parameters, step_m: float, events: list[Event], counters: Counters) -> None:
        self._parameters = parameters
        self._events = events
        self._counters = counters
        self._progress = Progress(parameters.progress, parameters.progress_window, parameters.progress_share, step_m)
        self._helper: Address | None = None
        self._follows_hidden = parameters.hidden_helper == "followed"
        self._near_m = step_m
        self._last_m: Point | None = None
        self.hidden = False
        """True if the helper is out of sight, and where it was seen last is what ``helper`` has returned."""
        self.trouble = Trouble(parameters.trouble_limit, parameters.trouble_rule)

    def new_goal(self) -> None:
        """Begin again with a new goal, as the parameters say."""
        self._progress.restart()
        if self._parameters.trouble_memory == "goal":
            if self.trouble.active:
                self._events.append(TroubleChanged(False, 1))
            self.trouble = Trouble(self._parameters.trouble_limit, self._parameters.trouble_rule)

    def turn(self) -> None:
        """Judge progress from here on, as the robot heads for something else."""
        self._progress.restart()

    def lose(self) -> None:
        """Forget where the helper was seen last."""
        self._last_m = None

    def helper(self, here: Point, sightings: Mapping[Address, Point], states: Mapping[Address, bool]) -> Point | None:
        """Return where a robot in trouble sees one that is not: the same one as long as that is in sight.

        If it sees none, and follows hidden helpers, that is where it saw its helper last, until it is there.
        """
        before = helper = self._helper
        if not self.trouble.active:
            helper = None
        elif helper is None or helper not in sightings or states.get(helper) is not False:
            helpers = [peer for peer in sightings if states.get(peer) is False]
            helper = min(helpers, key=lambda peer: math.dist(sightings[peer], here), default=None)
        self._helper = helper
        if helper is not None:
            self._last_m = sightings[helper]
        elif before in sightings or not self.trouble.active or not self._follows_hidden or self._at_last(here):
            self._last_m = None
        self.hidden = helper is None and self._last_m is not None
        return self._last_m

    def _at_last(self, here: Point) -> bool:
        """Return whether the robot is where it saw its helper last."""
        return self._last_m is not None and math.dist(here, self._last_m) < self._near_m

    def judge(self, here: Point, place: Point, keeps_up: bool) -> None:
        """Count a motion step towards *place*; a robot that *keeps_up* with its helper makes progress."""
        progress = self._progress.judge(*here, place) or keeps_up
        if self.trouble.step(progress):
            self._counters.troubles += self.trouble.active
            self._events.append(TroubleChanged(self.trouble.active, self.trouble.weight))
