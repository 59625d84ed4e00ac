"""Where a robot can be put by hand: checked against the floor before the run, and drawn on it where none is given."""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from cosim.errors import UserError
from cosim.faults.settings import FaultSettings, MovedSettings
from cosim.robots.placement import Point, misfit
from cosim.world.floorplan import Floorplan

TRIES: Final = 1000
"""How many places are drawn before there is taken to be none."""


def check_places(faults: Sequence[FaultSettings], radii_m: Sequence[float], floorplan: Floorplan) -> None:
    """Raise UserError for a place to which a robot is to be moved where its body would not fit."""
    for number, fault in enumerate(faults):
        if isinstance(fault, MovedSettings) and fault.to_m is not None:
            wrong = misfit(fault.to_m, float(radii_m[fault.robot]), floorplan)
            if wrong is not None:
                x, y = fault.to_m
                raise UserError(f"faults[{number}].to_m: ({x:g}, {y:g}) {wrong}")


def drawn_places(radius_m: float, floorplan: Floorplan, stream: np.random.Generator) -> Iterator[Point]:
    """Yield places on the floor where a body of *radius_m* fits, drawn evenly from *stream*; none if it is full.

    Nobody asks whether a way leads out of them.
    """
    x_min, y_min, x_max, y_max = floorplan.bounds_m
    for _ in range(TRIES):
        place = float(stream.uniform(x_min, x_max)), float(stream.uniform(y_min, y_max))
        if misfit(place, radius_m, floorplan) is None:
            yield place
