"""Where robots start: places that are checked before anything moves."""

from collections.abc import Collection, Sequence
from typing import TypeAlias

import numpy as np

import cosim.elementary as elementary
from cosim.arrays import Bools, Floats
from cosim.errors import UserError
from cosim.geometry.grids import TOUCH_M
from cosim.geometry.segments import clearance
from cosim.world.floorplan import Floorplan

Point: TypeAlias = tuple[float, float]


def checked_starts(
    starts_m: Sequence[Point],
    radii_m: Sequence[float],
    floorplan: Floorplan,
    giver: str = "team.starts",
    guided: Collection[int] = (),
) -> Floats:
    """Return *starts_m*, which *giver* has given, as an array (n, 2) if bodies of *radii_m* fit there, all at once.

    Raise UserError that names the first start which is off the floor, in something solid, too near to a wall, or
    too near to an earlier start. To touch is allowed. *guided* robots may be anywhere: they follow paths.
    """
    starts = np.array(starts_m, dtype=np.float64).reshape(-1, 2)
    radii = np.array(radii_m, dtype=np.float64)[: len(starts)]
    suspects = _suspects(starts, radii, floorplan)
    for number, (x, y) in enumerate(starts.tolist()):
        if number in guided:
            continue
        place = f"{giver}[{number}]: ({x:g}, {y:g})"
        wrong = misfit((x, y), radii_m[number], floorplan) if suspects[number] else None
        if wrong is not None:
            raise UserError(f"{place} {wrong}")
        _check_apart(starts, radii, number, place, giver)
    return starts


def _suspects(starts: Floats, radii: Floats, floorplan: Floorplan) -> Bools:
    """Return which of the *starts*, (n, 2), may not fit; all are asked at once, as one alone takes a millisecond."""
    suspects = floorplan.forbidden(starts)
    for radius_m in set(radii.tolist()):
        of_radius = np.flatnonzero((radii == radius_m) & ~suspects)
        room = clearance(floorplan.grid, starts[of_radius], radius_m + 2 * TOUCH_M)
        suspects[of_radius] = room < radius_m
    return suspects


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


def _check_apart(starts: Floats, radii: Floats, number: int, place: str, giver: str) -> None:
    apart = elementary.hypots(*(starts[number] - starts[:number]).T)
    least = radii[number] + radii[:number]
    near = np.flatnonzero(apart < least - TOUCH_M)
    if len(near):
        raise UserError(
            f"{place} is {apart[near[0]]:.3g} m from {giver}[{near[0]}], expected at least {least[near[0]]:g} m: "
            "two robots in one place"
        )
