"""Where a robot takes itself to be: at the given pose, or at the estimate of Monte Carlo localisation on the known map.

The team of paper 004 localises itself "using Markov localization" on its map, that of paper 002 by Monte Carlo
localisation (section VII.B). So does a robot here whose odometry drifts (:mod:`cosim.navigation.localization`),
beginning at its known start. Observations are then converted to the map's frame: pose, robots in sight and ranges, all
by one shift, so that they stay consistent. Orders go the other way. The filter's corrections are applied little by
little. Still they are no motion, so how robots move is not derived from places in that frame
(:class:`protocols.motion.frames.Located`).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, Literal, Protocol, TypeAlias

import numpy as np
from pydantic import Field

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.errors import UserError
from cosim.geometry.segments import clearance, segment_grid
from cosim.machine import Address, Command, Event
from cosim.navigation.localization.likelihood import KnownMap, known_map
from cosim.navigation.localization.localizer import LocalizationParameters, Localizer
from cosim.navigation.localization.motion import Pose
from cosim.observation import Marks, Observation, Seen, Sighting
from cosim.protocol import PoseEstimate, Surroundings
from cosim.randomness import Draws
from cosim.settings import Angle, Metres, Seconds, Settings
from cosim.units import S, Time, to_seconds
from protocols.localization.aiming import Aim
from protocols.localization.scan import Scan, Sensor
from protocols.motion.frames import Located, Shift

# ---------------------------------------------------------------- parameters
# Parameters of where a robot takes itself to be, and of a range sensor that is not a laser scanner.


def tracking() -> LocalizationParameters:
    """Return the filter's parameters for robots that know where they start.

    No particle is ever moved to a random place (Nav2's default), and odometry is taken to err by a tenth.
    """
    # No robot is ever moved by hand, and random particles would cost three times as much as all the rest. In a corridor
    # longer than the scanner's range only odometry says how far along it a robot is: with twice the noise the estimate
    # would be off by 0.4 m.
    return LocalizationParameters(
        recovery_slow=0.0, recovery_fast=0.0, alpha1=0.01, alpha2=0.01, alpha3=0.01, alpha4=0.01
    )


class PositioningParameters(Settings):
    """Where a robot takes its pose from: the given one, or Monte Carlo localisation on the known map."""

    kind: Literal["given", "mcl"] = Field(
        default="given", description="the given pose (odometry, where it drifts), or the estimate of the filter"
    )
    filter: LocalizationParameters = Field(
        default_factory=tracking, description="of the filter; its range is that of the robot's sensor"
    )
    start_m: Metres = Field(default=0.05, ge=0, description="m, standard deviation of the known start")
    start_rad: Angle = Field(default=0.02, ge=0, description="rad, standard deviation of the heading there")
    settle_s: Seconds = Field(
        default=0.3, ge=0, description="s, time constant of a correction (63 %), so that it is no jump for the driver"
    )
    jump_m: Metres = Field(default=0.5, gt=0, description="m, size from which on a correction is made at once")


class SonarParameters(Settings):
    """A ring of sonars; its beams are some of the range scanner's."""

    beams: int = Field(default=24, ge=4, le=720, description="number of sonars of a ring, about that of the beams used")
    range_m: Metres = Field(default=5.0, gt=0, description="m, range, if the scanner reaches as far")
    noise_m: Metres = Field(default=0.0, ge=0, description="m, standard deviation of the sonars' own noise")


# ---------------------------------------------------------------- maps
# The known floor as the maps of cells on which robots localise: one for each size of cells that a robot has.
#
# "Some robots have different map representations" (paper 004, section 7). A cell is occupied if its centre is at most
# half a cell off a wall; so a wall between two rows of cells is in both.


_HAIR: float = 1e-9
"""Tolerance for rounding, m."""


class KnownMaps:
    """The maps of a run's floor; each is made when it is asked for first, and shared by all robots with its cells."""

    def __init__(self, surroundings: Surroundings) -> None:
        self.surroundings = surroundings
        self._grid = segment_grid(surroundings.walls_m)
        self._bounds_m = surroundings.bounds_m
        self._forbidden = surroundings.forbidden
        self._known: dict[tuple[float, float], KnownMap] = {}

    def known(self, cell_m: float, radius_m: float) -> KnownMap:
        """Return the map with cells of *cell_m* for robots of *radius_m*; raise UserError if they can stand nowhere."""
        key = cell_m, radius_m
        if key not in self._known:
            self._known[key] = self._made(cell_m, radius_m)
        return self._known[key]

    def _made(self, cell_m: float, radius_m: float) -> KnownMap:
        x_min, y_min, x_max, y_max = self._bounds_m
        # one more cell all round, so that walls at the bounds have two sides
        origin_m = x_min - cell_m, y_min - cell_m
        nx, ny = (math.ceil(extent / cell_m - _HAIR) + 2 for extent in (x_max - x_min, y_max - y_min))
        xs, ys = origin_m[0] + (np.arange(nx) + 0.5) * cell_m, origin_m[1] + (np.arange(ny) + 0.5) * cell_m
        centres = np.stack([axis.ravel() for axis in np.meshgrid(xs, ys)], axis=1)
        inside = ((centres >= (x_min, y_min)) & (centres <= (x_max, y_max))).all(axis=1)
        occupied = clearance(self._grid, centres, cell_m) <= 0.5 * cell_m + _HAIR
        free = inside & ~np.asarray(self._forbidden(centres), np.bool_) & ~occupied
        try:
            return known_map(occupied.reshape(ny, nx), free.reshape(ny, nx), origin_m, cell_m, radius_m)
        except ValueError as error:
            raise UserError(f"floorplan: {error}, in cells of {cell_m} m") from None


_TELL_S: Final = 1.0
"""Interval between records of the pose in the trace."""
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
    """Locates a robot: converts its observations to the map's frame."""

    @property
    def shift(self) -> Shift:
        """Present estimate of the shift from the robot's own frame to that of the map."""

    @property
    def estimate(self) -> PoseEstimate | None:
        """Where the robot has been found to be on the map; None if no filter looks for it."""

    def resume(self, shift: Shift) -> None:
        """Begin with a shift that was kept on the robot's disk before it booted again."""

    def locate(self, observation: Observation) -> Observation:
        """Return *observation* in the map's frame; to be called once a tick."""

    def order(self, command: Command | None, observation: Observation) -> Command | None:
        """Return the order to the body, in the robot's own frame: for machines that send theirs to places.

        To be called once a tick with the *command* to be given, or None, and the located *observation*, both in the
        map's frame.
        """


class ShiftedView:
    """The view of an observation, in the map's frame."""

    def __init__(self, observation: Observation, scan: Scan, shift: Shift) -> None:
        self._observation, self._scan, self._shift = observation, scan, shift

    def sees(self, points_m: Any) -> list[bool]:
        """Return which points of the map's frame lie in the visibility region."""
        return self._observation.sees([self._shift.back(x, y) for x, y in points_m])

    def detects(self, marks_m: Marks, range_m: float) -> list[tuple[float, float] | None]:
        """Return where marks of the world appear in the map's frame; None for those that the robot does not see."""
        found = self._observation.detects(marks_m, range_m)
        return [None if place is None else self._shift.point(*place) for place in found]

    def ranges_m(self) -> Floats:
        """Return the ranges of beams along the directions of the map's frame."""
        return self._scan.along_m(self._shift.turned_rad)


class Given:
    """Takes the pose as given: the truth, or odometry if that errs."""

    estimate = None

    def __init__(
        self, sensor: Sensor, frame: Pose, stream: np.random.Generator | None = None, errs: bool = False
    ) -> None:
        """Take the robot's own *frame*, as a pose in that of the map, and the *stream* of its sensor's noise.

        *errs* is True if the pose is wrong now and then.
        """
        self._sensor, self.shift, self._stream = sensor, Shift(*frame), stream
        self._plain = sensor.whole and self.shift == Shift()
        self._aim = None if self._plain and not errs else Aim()

    def resume(self, shift: Shift) -> None:
        """Do nothing: the frame is known."""

    def locate(self, observation: Observation) -> Observation:
        """Return *observation* in the map's frame, with the beams that the sensor has."""
        if self._plain:
            return observation
        return shifted(observation, self.shift, _scan(observation, self._sensor, self._stream))

    def order(self, command: Command | None, observation: Observation) -> Command | None:
        """Return the order to the body, in the robot's own frame."""
        return command if self._aim is None else self._aim.order(command, observation, self.shift)


class Localised:
    """Takes the pose from a filter on the map, which begins where the robot starts."""

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
        """Take the robot's own *frame* (a pose in the map's), and the radii of all bodies."""
        own, self._stream = parameters, stream
        draws = Draws(int(stream.integers(2**62)), "mcl")
        self._localizer = Localizer(known, sensor.directions, draws, own.filter)
        self._own, self._sensor, self._radii_m, self._tell = own, sensor, radii_m, tell
        self.shift = Shift(*frame)
        self._aim = Aim()
        self._begun = False
        self._settled = 1.0 - elementary.exp(-to_seconds(tick) / own.settle_s) if own.settle_s > 0.0 else 1.0
        self._told_ticks = max(1, round(_TELL_S * S / tick))
        self._ticks = 0
        self._odometry: Pose | None = None
        self._covariance: tuple[int, tuple[float, float, float]] | None = None
        """That of the filter's particles, and after how many updates."""

    @property
    def estimate(self) -> PoseEstimate | None:
        """The pose that the robot goes by, and the covariance of the filter's particles; None before the first tick."""
        if self._odometry is None:
            return None
        updates = self._localizer.updates
        if self._covariance is None or self._covariance[0] != updates:
            self._covariance = updates, self._localizer.covariance()
        return PoseEstimate(*self.shift.pose(self._odometry), *self._covariance[1])

    def resume(self, shift: Shift) -> None:
        """Begin with a shift that was kept."""
        self.shift = shift

    def locate(self, observation: Observation) -> Observation:
        """Return *observation* in the frame of the map."""
        odometry = self._odometry = observation[:3]
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
        return Located.of(shifted(observation, self.shift, scan), odometry)

    def order(self, command: Command | None, observation: Observation) -> Command | None:
        """Return the order to the body, in the robot's own frame, by the present estimate."""
        return self._aim.order(command, observation, self.shift)

    def _settle(self, odometry: Pose, found: Pose) -> None:
        """Move the shift towards the one that takes the odometry's pose to the pose *found*."""
        x, y, heading = self.shift.pose(odometry)
        dx, dy, turn = found[0] - x, found[1] - y, math.remainder(found[2] - heading, math.tau)
        # a jump would look like motion to the driver, so small corrections are spread over time
        part = 1.0 if math.hypot(dx, dy) > self._own.jump_m else self._settled
        self.shift = Shift.between(odometry, (x + part * dx, y + part * dy, heading + part * turn))


def check_positioning(parameters: PositioningParameters, surroundings: Surroundings) -> None:
    """Raise UserError if the team has no sensor for what its positioning asks."""
    if parameters.kind == "mcl" and not surroundings.beams:
        raise UserError("protocol.parameters.positioning.kind: 'mcl' needs a range scanner")


def positioning_of(
    parameters: PositioningParameters,
    maps: KnownMaps,
    robot: Address,
    cell_m: float,
    sensor: Sensor,
    stream: np.random.Generator,
    tell: Tell = lambda event: None,
) -> Positioning:
    """Return what locates a robot, on the map with cells of *cell_m* if it localises.

    Only a filter and a noisy sensor draw from *stream*; *tell* takes the ``EVENTS`` of a filter. Raise UserError if the
    robot can stand nowhere on that map.
    """
    own, around = parameters, maps.surroundings
    frame = around.frames[robot] if around.frames else (0.0, 0.0, 0.0)
    if own.kind == "given":
        return Given(sensor, frame, stream, around.odometry_errs)
    radii_m = around.radii_m or (around.radius_m,) * len(around.starts_m)
    # the filter expects no more than the robot's own sensor can see
    reach = {"range_m": min(sensor.range_m, around.scan_range_m)}
    own = own.model_copy(update={"filter": own.filter.model_copy(update=reach)})
    return Localised(own, maps.known(cell_m, radii_m[robot]), sensor, frame, radii_m, around.tick, stream, tell)


def shifted(observation: Observation, shift: Shift, scan: Scan | None) -> Observation:
    """Return *observation*, with its *scan*, in another frame."""
    x_m, y_m, heading_rad = shift.pose(observation[:3])
    sightings = tuple(Sighting(other, *shift.point(x, y)) for other, x, y in observation.sightings)
    picture = Seen(observation.visible, sightings)
    view = None if scan is None else ShiftedView(observation, scan, shift)
    return observation._replace(x_m=x_m, y_m=y_m, heading_rad=heading_rad, picture=picture, view=view)


def _scan(observation: Observation, sensor: Sensor, stream: np.random.Generator | None) -> Scan | None:
    return None if observation.view is None else Scan(observation.view, sensor, stream)


class _Readings:
    """Ranges for a filter, computed only when it converts them to an array: at most ticks it does not."""

    def __init__(self, observation: Observation, scan: Scan, radii_m: tuple[float, ...]) -> None:
        self._observation, self._scan, self._radii_m = observation, scan, radii_m

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Floats:
        seen = self._observation
        return self._scan.of_walls_m((seen.x_m, seen.y_m), seen.sightings, self._radii_m)
