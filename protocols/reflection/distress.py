"""State sharing from a seeker's side: its own trouble, and the robot that it follows out of it (section 5)."""

import math
from collections.abc import Mapping

from cosim.machine import Address, Event
from protocols.reflection.counters import Counters
from protocols.reflection.events import TroubleChanged
from protocols.reflection.parameters import Parameters
from protocols.reflection.setup import Point
from protocols.reflection.trouble import Progress, Trouble


class Distress:
    """One robot's trouble on its way, and its helper."""

    def __init__(self, parameters: Parameters, step_m: float, events: list[Event], counters: Counters) -> None:
        self._parameters = parameters
        self._events = events
        self._counters = counters
        self._progress = Progress(parameters.progress, parameters.progress_window, parameters.progress_share, step_m)
        self._helper: Address | None = None
        self.trouble = Trouble(parameters.trouble_limit, parameters.trouble_rule)

    def new_goal(self) -> None:
        """Begin anew, as the parameters have it."""
        self._progress.restart()
        if self._parameters.trouble_memory == "goal":
            if self.trouble.active:
                self._events.append(TroubleChanged(False, 1))
            self.trouble = Trouble(self._parameters.trouble_limit, self._parameters.trouble_rule)

    def turn(self) -> None:
        """Judge progress from here on: the robot heads for something else."""
        self._progress.restart()

    def helper(self, here: Point, sightings: Mapping[Address, Point], states: Mapping[Address, bool]) -> Point | None:
        """Return where a robot in trouble sees one that is not: always the same, as long as it sees that one."""
        helper = self._helper
        if not self.trouble.active:
            helper = None
        elif helper is None or helper not in sightings or states.get(helper) is not False:
            helpers = [peer for peer in sightings if states.get(peer) is False]
            helper = min(helpers, key=lambda peer: math.dist(sightings[peer], here), default=None)
        self._helper = helper
        return None if helper is None else sightings[helper]

    def judge(self, here: Point, place: Point, keeps_up: bool) -> None:
        """Count a motion step towards *place*; who *keeps_up* with its helper is getting on."""
        progress = self._progress.judge(*here, place) or keeps_up
        if self.trouble.step(progress):
            self._counters.troubles += self.trouble.active
            self._events.append(TroubleChanged(self.trouble.active, self.trouble.weight))
