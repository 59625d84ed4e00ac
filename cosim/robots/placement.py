"""Where robots start: places that are checked before anything moves."""

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from cosim.errors import UserError
from cosim.geometry.grids import TOUCH_M
from cosim.geometry.segments import clearance
from cosim.world.floorplan import Floorplan

Floats: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]
Point: TypeAlias = tuple[float, float]


def checked_starts(starts_m: Sequence[Point], radii_m: Sequence[float], floorplan: Floorplan) -> Floats:
    """Return *starts_m* as an array (n, 2) if bodies of *radii_m* fit there, all at once.

    Raise UserError that names the first start which is off the floor, in something solid, too near to a wall, or
    too near to an earlier start. To touch is allowed.
    """
    starts = np.array(starts_m, dtype=np.float64).reshape(-1, 2)
    room = clearance(floorplan.grid, starts, max(radii_m, default=0.0) + 2 * TOUCH_M)
    forbidden = floorplan.forbidden(starts)
    for number, (x, y) in enumerate(starts.tolist()):
        place = f"team.starts[{number}]: ({x:g}, {y:g})"
        x_min, y_min, x_max, y_max = floorplan.bounds_m
        if not (x_min <= x <= x_max and y_min <= y <= y_max):
            raise UserError(f"{place} is outside of the floor, expected {x_min:g}..{x_max:g} by {y_min:g}..{y_max:g} m")
        if forbidden[number]:
            raise UserError(f"{place} is inside a wall or unknown, expected free floor")
        if room[number] < radii_m[number] - TOUCH_M:
            raise UserError(
                f"{place} is inside a wall: it is {room[number]:.3g} m away, "
                f"expected at least the radius {radii_m[number]:g} m"
            )
        _check_apart(starts, radii_m, number, place)
    return starts


def _check_apart(starts: Floats, radii_m: Sequence[float], number: int, place: str) -> None:
    for other in range(number):
        apart = float(np.hypot(*(starts[number] - starts[other])))
        least = radii_m[number] + radii_m[other]
        if apart < least - TOUCH_M:
            raise UserError(
                f"{place} is {apart:.3g} m from team.starts[{other}], expected at least {least:g} m: "
                "two robots in one place"
            )
