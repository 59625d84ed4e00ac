"""Where robots start: places that are checked before anything moves."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from cosim.arrays import Floats
from cosim.errors import UserError
from cosim.geometry.grids import TOUCH_M
from cosim.geometry.segments import clearance
from cosim.world.floorplan import Floorplan

Point: TypeAlias = tuple[float, float]


def checked_starts(
    starts_m: Sequence[Point], radii_m: Sequence[float], floorplan: Floorplan, giver: str = "team.starts"
) -> Floats:
    """Return *starts_m*, which *giver* has given, as an array (n, 2) if bodies of *radii_m* fit there, all at once.

    Raise UserError that names the first start which is off the floor, in something solid, too near to a wall, or
    too near to an earlier start. To touch is allowed.
    """
    starts = np.array(starts_m, dtype=np.float64).reshape(-1, 2)
    for number, (x, y) in enumerate(starts.tolist()):
        place = f"{giver}[{number}]: ({x:g}, {y:g})"
        wrong = misfit((x, y), radii_m[number], floorplan)
        if wrong is not None:
            raise UserError(f"{place} {wrong}")
        _check_apart(starts, radii_m, number, place, giver)
    return starts


def misfit(place_m: Point, radius_m: float, floorplan: Floorplan) -> str | None:
    """Return what is wrong with *place_m* for a body of *radius_m*, if it does not fit there; to touch is allowed."""
    x, y = place_m
    x_min, y_min, x_max, y_max = floorplan.bounds_m
    if not (x_min <= x <= x_max and y_min <= y <= y_max):
        return f"is outside of the floor, expected {x_min:g}..{x_max:g} by {y_min:g}..{y_max:g} m"
    if floorplan.forbidden(np.array([place_m]))[0]:
        return "is inside a wall or unknown, expected free floor"
    room_m = float(clearance(floorplan.grid, [place_m], radius_m + 2 * TOUCH_M)[0])
    if room_m < radius_m - TOUCH_M:
        return f"is inside a wall: it is {room_m:.3g} m away, expected at least the radius {radius_m:g} m"
    return None


def _check_apart(starts: Floats, radii_m: Sequence[float], number: int, place: str, giver: str) -> None:
    for other in range(number):
        apart = float(np.hypot(*(starts[number] - starts[other])))
        least = radii_m[number] + radii_m[other]
        if apart < least - TOUCH_M:
            raise UserError(
                f"{place} is {apart:.3g} m from {giver}[{other}], expected at least {least:g} m: "
                "two robots in one place"
            )
