"""Where a robot believes that it is on its map, and how fast it may go (paper 001, section 5.2 and figure 5).

A filter, of grid maps (:mod:`cosim.navigation.slam`) or of features (:mod:`cosim.navigation.feature_slam`), runs on
odometry and scans and on a map of its own; the robot marks its map where the filter estimates it to be. The filter also
sets speed and rate of turn, while the schemas still set the direction: full speed up to one spread of the place,
falling linearly above it, and none from a second spread on ("commanded to wait in place to continually observe
surroundings"). Turning in place would show nothing new to a scanner that looks all around.

A robot that has nothing to see might wait for ever. So it waits for a limited time, then creeps on for a while whatever
the spread, and may wait again.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NamedTuple, Protocol, TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.machine import Event
from cosim.navigation.feature_slam import FeatureSlam
from cosim.navigation.localization.motion import Pose, turned_back
from cosim.navigation.slam import MapGrid, Slam, SlamEstimate, share_of_speed
from cosim.observation import Observation, Seen, Sighting
from cosim.protocol import PoseEstimate
from cosim.randomness import Draws
from cosim.units import S, Time
from protocols.exploration.parameters import PositioningParameters, SpeedControlParameters
from protocols.mapping.belief import Frame

_BODY_SLACK_M: Final = 0.1
"""Distance from the body of a robot in sight within which a beam counts as having met that robot."""
_REPORT_S: Final = 1.0
"""Interval between reports of the estimated pose in the trace."""

_WHY = {"meaning": "what has made the robot think so"}
_X_M = {"unit": "m", "meaning": "where it is"}
_Y_M = {"unit": "m", "meaning": "where it is"}
_HEADING = {"unit": "rad", "meaning": "where it heads"}
_SPREAD = {"unit": "m", "meaning": "root mean square error of its place as the filter has it"}
_SHARE = {"unit": "1", "meaning": "of its speed that it may drive with"}


@dataclass(frozen=True, slots=True)
class Localised:
    """Where a robot with a filter believes that it is, once a second."""

    x_m: float = field(metadata=_X_M)
    y_m: float = field(metadata=_Y_M)
    heading_rad: float = field(metadata=_HEADING)
    spread_m: float = field(metadata=_SPREAD)
    share: float = field(metadata=_SHARE)


@dataclass(frozen=True, slots=True)
class Waiting:
    """A robot waits in place, since it does not know well enough where it is."""

    spread_m: float = field(metadata=_SPREAD)


@dataclass(frozen=True, slots=True)
class Resumed:
    """A robot that has waited goes on."""

    spread_m: float = field(metadata=_SPREAD)
    why: str = field(metadata=_WHY)


EVENTS: Final = (Localised, Waiting, Resumed)
Report: TypeAlias = Callable[[Event], None]


class Position(NamedTuple):
    """What a robot senses, in the frame of its map."""

    observation: Observation
    """The observation, with pose and sightings in the map's frame."""
    turned_rad: float
    """Angle by which the map's frame is turned against that of beams and headings, counter-clockwise."""
    share: float
    """Share of its speed with which the robot may drive; 0 is to wait."""


class Positioning(Protocol):
    """What locates a robot on its map."""

    @property
    def estimate(self) -> PoseEstimate | None:
        """Where the robot has been found to be; None if that is what it senses."""

    def locate(self, observation: Observation, ranges_m: Floats, beams: Floats) -> Position:
        """Return what the robot knows of its place; to be called once a tick.

        *ranges_m* (n,), along the unit vectors *beams* (n, 2), are as the robot senses them.
        """


class Given:
    """The pose is that of the observation: the truth, as in the paper, or odometry if that errs."""

    estimate = None

    def locate(self, observation: Observation, ranges_m: Floats, beams: Floats) -> Position:
        """Return *observation* as it is."""
        return Position(observation, 0.0, 1.0)


class SpeedControl:
    """The share of its speed that one robot may have."""

    def __init__(self, parameters: SpeedControlParameters, tick: Time, report: Report) -> None:
        self._own = parameters
        self._wait_ticks = round(parameters.wait_s * S / tick)
        self._creep_ticks = round(parameters.creep_s * S / tick)
        self._report = report
        self._waited = 0
        """Ticks of waiting so far; 0 if it does not wait."""
        self._creeps = 0
        """Ticks for which it still creeps on, whatever the spread."""

    def share(self, spread_m: float) -> float:
        """Return the share of its speed for the next tick, given the spread of the last estimate."""
        own = self._own
        share = share_of_speed(spread_m, own.slow_m, own.stop_m)
        if self._creeps:
            self._creeps -= 1
            return max(share, own.creep)
        if spread_m >= (own.resume_m if self._waited else own.stop_m):
            return self._wait(spread_m)
        if self._waited:
            self._resume(spread_m, "localised")
        return max(share, own.creep)

    def _wait(self, spread_m: float) -> float:
        if not self._waited:
            self._report(Waiting(spread_m))
        self._waited += 1
        if self._waited <= self._wait_ticks:
            return 0.0
        self._resume(spread_m, "waited long enough")
        self._creeps = self._creep_ticks
        return self._own.creep

    def _resume(self, spread_m: float, why: str) -> None:
        self._waited = 0
        self._report(Resumed(spread_m, why))


class Filtered:
    """The pose is the estimate of a filter, which begins at the first pose observed: that is certain.

    The filter of features draws nothing, and so needs no stream.
    """

    def __init__(
        self,
        parameters: PositioningParameters,
        frame: Frame,
        range_m: float,
        radii_m: tuple[float, ...],
        tick: Time,
        stream: np.random.Generator,
        report: Report,
    ) -> None:
        """Localise on maps with the cells of *frame*, by scans that reach *range_m*."""
        self._own = parameters
        self._range_m = range_m
        self._frame = frame
        self._radii_m = radii_m
        self._draws = Draws(int(stream.integers(2**62)), "slam")
        self._report = report
        self._control = SpeedControl(parameters.control, tick, report) if parameters.control.enabled else None
        self._report_ticks = max(1, round(_REPORT_S * S / tick))
        self._ticks = 0
        self._slam: Slam | FeatureSlam | None = None
        self._found: SlamEstimate | None = None

    @property
    def estimate(self) -> PoseEstimate | None:
        """The filter's mean, and its covariance; None before the first scan."""
        if self._slam is None or self._found is None:
            return None
        return PoseEstimate(*self._found[:3], *self._slam.place_covariance)

    def locate(self, observation: Observation, ranges_m: Floats, beams: Floats) -> Position:
        """Return *observation* in the frame of the map; *ranges_m* (n,) along *beams* (n, 2) as they are sensed."""
        sensed = observation.x_m, observation.y_m, observation.heading_rad
        if len(ranges_m) != len(beams):  # a robot without a scanner
            return Position(observation, 0.0, 1.0)
        if self._slam is None:
            self._slam = self._begun(sensed, beams)
        found = self._found = self._slam.observe(sensed, self._without_bodies(observation, ranges_m, beams))
        share = 1.0 if self._control is None else self._control.share(found.spread_m)
        if self._ticks % self._report_ticks == 0:
            self._report(Localised(found.x_m, found.y_m, found.heading_rad, found.spread_m, share))
        self._ticks += 1
        return Position(_moved(observation, found), math.remainder(found.heading_rad - sensed[2], math.tau), share)

    def _begun(self, start: Pose, beams: Floats) -> Slam | FeatureSlam:
        reach = {"range_m": self._range_m}
        if self._own.kind == "features":
            own = self._own.features
            return FeatureSlam(start, beams, own.model_copy(update={"features": own.features.model_copy(update=reach)}))
        frame = self._frame
        grid = MapGrid((frame.ny, frame.nx), frame.origin_m, frame.cell_m)
        return Slam(grid, start, beams, self._draws, self._own.filter.model_copy(update=reach))

    def _without_bodies(self, observation: Observation, ranges_m: Floats, beams: Floats) -> Floats:
        """Return the ranges; NaN where a beam has met a robot that is in sight.

        A robot of which only an edge shows may not be in sight, and is taken for a wall meanwhile.
        """
        if not observation.sightings:
            return ranges_m
        met = np.zeros(len(ranges_m), np.bool_)
        for other, x, y in observation.sightings:
            dx, dy = x - observation.x_m, y - observation.y_m
            along = beams[:, 0] * dx + beams[:, 1] * dy
            aside = np.abs(beams[:, 1] * dx - beams[:, 0] * dy)
            reach = self._radii_m[other] + _BODY_SLACK_M
            met |= (aside < reach) & (np.abs(ranges_m - along) < reach)
        return np.where(met, np.nan, ranges_m)


def turned(directions: Floats, angle_rad: float) -> Floats:
    """Return unit vectors (n, 2) turned counter-clockwise."""
    return turned_back(directions, -angle_rad)


def _moved(observation: Observation, found: SlamEstimate) -> Observation:
    """Return *observation* in the frame in which the robot is where the filter has *found* it."""
    turned = found.heading_rad - observation.heading_rad
    cos, sin = elementary.cos(turned), elementary.sin(turned)
    sightings = []
    for other, x, y in observation.sightings:
        dx, dy = x - observation.x_m, y - observation.y_m
        sightings.append(Sighting(other, found.x_m + cos * dx - sin * dy, found.y_m + sin * dx + cos * dy))
    picture = Seen(observation.visible, tuple(sightings))
    return observation._replace(x_m=found.x_m, y_m=found.y_m, heading_rad=found.heading_rad, picture=picture)
