"""Where a robot takes itself to be: where it is told, or where Monte Carlo localisation on the known map has it.

The team of paper 004 localises itself "using Markov localization" on its map; so does a robot here whose frame is an
odometry that drifts (:mod:`cosim.navigation.localization`). It begins where it knows that it starts. What it senses is
then told in the map's frame: its pose, whom it sees, and how far its beams go; all by one shift of frames, so that what
it sees stays where it is seen from it. Corrections of the filter come little by little, but they are no motion: how
robots move is not read off places in that frame (:class:`protocols.motion.frames.Located`).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, Protocol, TypeAlias

import numpy as np

from cosim.arrays import Floats
from cosim.machine import Address, Event
from cosim.navigation.localization.likelihood import KnownMap
from cosim.navigation.localization.localizer import Localizer
from cosim.navigation.localization.motion import Pose
from cosim.observation import Observation, Sighting
from cosim.randomness import Draws
from cosim.units import S, Time, to_seconds
from protocols.deployment.localization.parameters import PositioningParameters
from protocols.deployment.localization.scan import Scan, Sensor
from protocols.deployment.parameters import Parameters
from protocols.deployment.setup import Setup
from protocols.motion.frames import Located, Shift

_TELL_S: Final = 1.0
"""So often a robot notes in the trace where it takes itself to be."""
_X_M = {"unit": "m", "meaning": "where it is"}
_Y_M = {"unit": "m", "meaning": "where it is"}
_HEADING = {"unit": "rad", "meaning": "where it heads"}
_SPREAD = {"unit": "m", "meaning": "root mean square distance of the particles from their mean"}
_SHARE = {"unit": "1", "meaning": "of all weight, what the particles have that are counted"}


@dataclass(frozen=True, slots=True)
class Positioned:
    """Where a robot with a filter takes itself to be, once a second."""

    x_m: float = field(metadata=_X_M)
    y_m: float = field(metadata=_Y_M)
    heading_rad: float = field(metadata=_HEADING)
    spread_m: float = field(metadata=_SPREAD)
    share: float = field(metadata=_SHARE)


EVENTS: Final = (Positioned,)
Tell: TypeAlias = Callable[[Event], None]


class Positioning(Protocol):
    """What tells a robot where it is."""

    @property
    def shift(self) -> Shift:
        """From the robot's own frame to that of the map, as it is taken to be now."""

    def resume(self, shift: Shift) -> None:
        """Begin with a shift that was kept where a crash of the robot's computer does not reach."""

    def locate(self, observation: Observation) -> Observation:
        """Return *observation* as told in the map's frame; to be asked once a tick."""


class Told:
    """What a sensor has seen, in the map's frame: the view of an observation."""

    def __init__(self, observation: Observation, scan: Scan, shift: Shift) -> None:
        self._observation, self._scan, self._shift = observation, scan, shift

    def sees(self, points_m: Any) -> list[bool]:
        """Return which points of the map's frame lie in the visibility region."""
        return self._observation.sees([self._shift.back(x, y) for x, y in points_m])

    def ranges_m(self) -> Floats:
        """Return how far beams go along the directions of the map's frame."""
        return self._scan.along_m(self._shift.turned_rad)


class Given:
    """The pose is what the robot is told: the truth, or odometry if that errs."""

    def __init__(self, sensor: Sensor, frame: Pose, stream: np.random.Generator | None = None) -> None:
        """Take the robot's own *frame*, as its pose in that of the map, and what its sensor draws noise from."""
        self._sensor, self.shift, self._stream = sensor, Shift(*frame), stream
        self._plain = sensor.whole and self.shift == Shift()

    def resume(self, shift: Shift) -> None:
        """Do nothing: what is given is known."""

    def locate(self, observation: Observation) -> Observation:
        """Return *observation* as it is, but for beams that the sensor has not got."""
        if self._plain:
            return observation
        return shifted(observation, self.shift, _scan(observation, self._sensor, self._stream))


class Localised:
    """The pose is the estimate of a filter on the map, which begins where the robot starts."""

    def __init__(
        self,
        parameters: PositioningParameters,
        known: KnownMap,
        sensor: Sensor,
        frame: Pose,
        radii_m: tuple[float, ...],
        tick: Time,
        stream: np.random.Generator,
        tell: Tell,
    ) -> None:
        """Take the robot's own *frame* (its pose in the map's), and the radii of all bodies."""
        own, self._stream = parameters, stream
        draws = Draws(int(stream.integers(2**62)), "mcl")
        self._localizer = Localizer(known, sensor.directions, draws, own.filter)
        self._own, self._sensor, self._radii_m, self._tell = own, sensor, radii_m, tell
        self.shift = Shift(*frame)
        self._begun = False
        self._settled = 1.0 - math.exp(-to_seconds(tick) / own.settle_s) if own.settle_s > 0.0 else 1.0
        self._told_ticks = max(1, round(_TELL_S * S / tick))
        self._ticks = 0

    def resume(self, shift: Shift) -> None:
        """Begin with a shift that was kept."""
        self.shift = shift

    def locate(self, observation: Observation) -> Observation:
        """Return *observation* in the frame of the map."""
        odometry = observation[:3]
        if not self._begun:
            self._begun = True
            self._localizer.start_at(self.shift.pose(odometry), self._own.start_m, self._own.start_rad)
        scan = _scan(observation, self._sensor, self._stream)
        if scan is not None:
            found = self._localizer.observe(odometry, _Readings(observation, scan, self._radii_m))
            self._settle(odometry, found[:3])
            if self._ticks % self._told_ticks == 0:
                self._tell(Positioned(*self.shift.pose(odometry), found.spread_m, found.share))
        self._ticks += 1
        return Located.told(shifted(observation, self.shift, scan), odometry)

    def _settle(self, odometry: Pose, found: Pose) -> None:
        """Come nearer to the shift that makes the pose of odometry what was *found*."""
        x, y, heading = self.shift.pose(odometry)
        dx, dy, turn = found[0] - x, found[1] - y, math.remainder(found[2] - heading, math.tau)
        part = 1.0 if math.hypot(dx, dy) > self._own.jump_m else self._settled
        self.shift = Shift.between(odometry, (x + part * dx, y + part * dy, heading + part * turn))


def positioning_of(
    parameters: Parameters, setup: Setup, me: Address, stream: np.random.Generator, tell: Tell
) -> Positioning:
    """Return what tells robot *me* where it is; it draws from *stream*, if at all."""
    own, ring = parameters.positioning, parameters.sonar
    body, frame = setup.crew.bodies[me], setup.frames[me]
    sensor = Sensor(setup.beams)
    if body.sensor == "sonar":
        sensor = Sensor(setup.beams, max(1, round(setup.beams / ring.beams)), ring.range_m, ring.noise_m)
    if own.kind == "given":
        return Given(sensor, frame, stream)
    known = setup.charts.known(setup.floors[me].parameters.cell_m, body.radius_m)
    radii_m = tuple(each.radius_m for each in setup.crew.bodies)
    # the filter expects no more than the robot's own sensor can see
    reach = {"range_m": min(sensor.range_m, setup.scan_range_m)}
    own = own.model_copy(update={"filter": own.filter.model_copy(update=reach)})
    return Localised(own, known, sensor, frame, radii_m, setup.tick, stream, tell)


def shifted(observation: Observation, shift: Shift, scan: Scan | None) -> Observation:
    """Return *observation*, and what is scanned, in another frame."""
    x_m, y_m, heading_rad = shift.pose(observation[:3])
    sightings = tuple(Sighting(other, *shift.point(x, y)) for other, x, y in observation.sightings)
    view = None if scan is None else Told(observation, scan, shift)
    return observation._replace(x_m=x_m, y_m=y_m, heading_rad=heading_rad, sightings=sightings, view=view)


def _scan(observation: Observation, sensor: Sensor, stream: np.random.Generator | None) -> Scan | None:
    return None if observation.view is None else Scan(observation.view, sensor, stream)


class _Readings:
    """Ranges for a filter, which become an array only when it looks at them: most ticks it does not."""

    def __init__(self, observation: Observation, scan: Scan, radii_m: tuple[float, ...]) -> None:
        self._observation, self._scan, self._radii_m = observation, scan, radii_m

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Floats:
        seen = self._observation
        return self._scan.of_walls_m((seen.x_m, seen.y_m), seen.sightings, self._radii_m)
