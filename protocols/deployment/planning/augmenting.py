"""What the executive adds to a deployment so that its robots do not hinder each other (paper 004, section 5).

Group: "The robot that is supposed to end up at that location is sent directly to the location specified in the
deployList. The other robots are deployed along a line between that location and the next goal location, separated by a
fixed distance." The robot that goes farthest stands farthest along that line. Then no robot has to pass another, and
"each robot monitors the position of the next robot in the deployList and does not start moving until that robot is a
given distance ahead of it" can be kept from the beginning. A place on the line that is not free, or is on the other
side of a wall, slides along the way to the next goal, and on towards the goals after it.

Leap-frog: "the already-deployed robots monitor the position of the moving robot. When it starts approaching, the robots
move away (roughly perpendicular to the route of the moving robot), wait until the robot has passed, then move back into
position." A robot is in the way while the rest of the other's way passes its post so closely that the bodies would not
have room. So whether the other has passed is known from its way alone.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from pydantic import Field

import cosim.elementary as elementary
from cosim.geometry.polylines import length_m as polyline_m
from cosim.machine import Address
from cosim.settings import Count, Gain, Metres, Settings
from protocols.deployment.tasks.crew import Ways
from protocols.deployment.tasks.plan import Place

# ---------------------------------------------------------------- parameters
# What a scenario can say about the executive's augmentations and its re-planning.


class ExecutiveParameters(Settings):
    """Distances of the augmentations, which the paper leaves open (paper 004, section 5), and responses to losses."""

    spacing_m: Metres = Field(default=1.2, gt=0, description="m, between the robots of a group stage along their line")
    behind_m: Metres = Field(
        default=1.5, ge=0, description="m, how far the robot ahead is before the next one sets off"
    )
    near_m: Metres = Field(
        default=4.0, gt=0, description="m, distance within which a passing robot makes others step aside"
    )
    aside_m: Metres = Field(
        default=0.5,
        ge=0,
        description="m, gap to a passing robot's body below which a deployed robot steps aside",
    )
    gap_m: Metres = Field(default=0.2, ge=0, description="m, least gap between the bodies of robots that stand")
    detour: Gain = Field(
        default=1.5,
        ge=1,
        description="greatest way to a place on the line to the next goal, in straight distances",
    )
    tries: Count = Field(
        default=2, ge=1, description="attempts at a drive within a deployment before its robot is left behind"
    )
    rounds: Count = Field(
        default=2,
        ge=0,
        description="number of times that robots which are not at their places are sent there again at the end",
    )
    draft: bool = Field(default=True, description="true if robots that are not in the plan take over from lost ones")


_SLIDES: Final = 4
"""Number of places that are tried within one spacing along the way."""
_RINGS: Final = 6
"""Number of circles about a place on which others are tried where there is no room along the way."""
_AROUND: Final = 16
"""Number of places that are tried on each of them."""


class Standing(NamedTuple):
    """A robot that is to stand somewhere near a place."""

    robot: Address
    radius_m: float


def in_line(
    robots: Sequence[Standing], goals_m: Sequence[Place], holder_m: float, ways: Ways, parameters: ExecutiveParameters
) -> dict[Address, Place]:
    """Return where *robots* stand, the nearest to ``goals_m[0]`` first, on the line to the goals after it.

    *holder_m* is the radius of the robot at ``goals_m[0]`` itself. A robot for which there is no room gets that place
    too.
    """
    places = dict[Address, Place]()
    taken = [(goals_m[0], holder_m)]
    for number, robot in enumerate(robots, start=1):
        spots = _spots(number, robot.radius_m, goals_m, ways, parameters)
        place = next((spot for spot in spots if _fits(spot, robot.radius_m, goals_m[0], taken, ways, parameters)), None)
        places[robot.robot] = place or goals_m[0]
        if place is not None:
            taken.append((place, robot.radius_m))
    return places


def _spots(
    number: int, radius_m: float, goals_m: Sequence[Place], ways: Ways, parameters: ExecutiveParameters
) -> Iterator[Place]:
    """Yield candidates for the *number*-th place of a line, the best first."""
    here, away_m = goals_m[0], number * parameters.spacing_m
    following = [goal for goal in goals_m[1:] if goal != here]
    if following:
        length_m = math.dist(here, following[0])
        if away_m < length_m:
            yield _between(here, following[0], away_m / length_m)
        way = _way_over(radius_m, [here, *following], ways)
        left = round(_SLIDES * (polyline_m(way) - away_m) / parameters.spacing_m)
        for step in range(max(left, 0)):
            yield along(way, away_m + step * parameters.spacing_m / _SLIDES)
    for ring in range(1, _RINGS + 1):
        for turn in range(_AROUND):
            angle = 2.0 * math.pi * turn / _AROUND
            reach_m = ring * parameters.spacing_m
            yield here[0] + reach_m * elementary.cos(angle), here[1] + reach_m * elementary.sin(angle)


def _way_over(radius_m: float, goals_m: Sequence[Place], ways: Ways) -> list[Place]:
    way = [goals_m[0]]
    for a, b in pairwise(goals_m):
        leg = ways.way(radius_m, a, b)
        if leg is None:
            break
        way += leg[1:]
    return way


def _fits(
    spot: Place,
    radius_m: float,
    place_m: Place,
    taken: Sequence[tuple[Place, float]],
    ways: Ways,
    parameters: ExecutiveParameters,
) -> bool:
    """Return whether a disc has room at *spot* beside those that stand already, and can come there from the place."""
    room = all(math.dist(spot, other) >= radius_m + other_m + parameters.gap_m for other, other_m in taken)
    if not room or not ways.free(radius_m, spot):
        return False
    length_m = ways.length_m(radius_m, place_m, spot)
    return length_m is not None and length_m <= parameters.detour * math.dist(place_m, spot) + parameters.gap_m


def in_the_way(way: Sequence[Place], passing_m: float, post_m: Place, standing_m: float, aside_m: float) -> bool:
    """Return whether a robot at its post stands too near to the rest of another's *way*; *_m* are radii and a gap."""
    return off_m(post_m, way) < passing_m + standing_m + aside_m


# ---------------------------------------------------------------- lines


def _between(a: Place, b: Place, share: float) -> Place:
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])


def along(way: Sequence[Place], away_m: float) -> Place:
    """Return the point *away_m* along a way; its end if it is shorter."""
    for a, b in pairwise(way):
        length_m = math.dist(a, b)
        if away_m < length_m:
            return _between(a, b, away_m / length_m)
        away_m -= length_m
    return way[-1]


def off_m(point: Place, way: Sequence[Place]) -> float:
    """Return the distance of a point from a way."""
    return min((_off_leg_m(point, a, b) for a, b in pairwise(way)), default=math.dist(point, way[0]))


def _off_leg_m(point: Place, a: Place, b: Place) -> float:
    dx, dy = b[0] - a[0], b[1] - a[1]
    length_2 = dx * dx + dy * dy
    share = ((point[0] - a[0]) * dx + (point[1] - a[1]) * dy) / length_2 if length_2 else 0.0
    return math.dist(point, _between(a, b, min(max(share, 0.0), 1.0)))
