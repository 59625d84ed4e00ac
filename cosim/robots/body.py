"""The body of a robot: a disc with a drive."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from cosim.settings import Bounded, Length, Rate, Settings

Acceleration: TypeAlias = Annotated[float, Bounded(1e-3, 1e6)]
"""An acceleration; bounded below, since a body that hardly brakes takes for ever to stop."""


class BodySettings(Settings):
    """A robot's body and the limits of its drive."""

    radius_m: Length = Field(default=0.2, gt=0, description="radius of the disc that holds the body")
    speed_mps: Rate = Field(default=0.5, gt=0, description="greatest speed")
    acceleration_mps2: Acceleration = Field(default=1.0, gt=0, description="greatest change of speed, both ways")
    turn_radps: Rate = Field(default=2.0, gt=0, description="greatest angular speed")
    turn_acceleration_radps2: Acceleration = Field(default=4.0, gt=0, description="greatest change of angular speed")
    drive: Literal["differential", "grid", "omni"] = Field(
        default="grid",
        description='"differential" turns on the spot before it drives to a point; "grid" stops, but needs no time to'
        ' turn; "omni" goes any way at once',
    )
