"""Parameters of driving: the costs of a floor's cells, the weights of DWA, and how long a held robot waits."""

from typing import Literal

from pydantic import Field

from cosim.settings import Gain, Length, Metres, Rate, Seconds, Settings


class DrivingParameters(Settings):
    """How robots of a team drive; what differs between bodies (radius, speed, acceleration) comes with the body."""

    cell_m: Length = Field(default=0.1, gt=0, description="m, side of the cells in which ways are planned")
    margin_m: Metres = Field(
        default=0.03, ge=0, description="m, distance from walls and bodies in plans; half of it is always kept"
    )
    comfort_m: Metres = Field(
        default=0.3, gt=0, description="m from a wall, beside the margin, within which cells cost"
    )
    comfort_price: Gain = Field(
        default=3.0, ge=1, description="of a cell at the margin, times the length; falls to 1 at comfort_m"
    )
    turn_radps: Rate = Field(default=2.0, gt=0, description="rad/s, greatest angular speed of the bodies")
    turn_acceleration_radps2: Rate = Field(default=4.0, gt=0, description="rad/s2, greatest change of it")
    look_ahead_m: Metres = Field(default=1.0, gt=0, description="m along the way at which a robot aims")
    kind: Literal["progress", "fox"] = Field(
        default="progress",
        description="soft constraints of DWA: facing the aim, being clear all around, and progress to the aim; or the "
        "terms of Fox, Burgard and Thrun 1997: facing it from where it will have braked, the way along the arc, speed",
    )
    heading_weight: Gain = Field(default=2.0, ge=0, description="of facing the aim")
    clearance_weight: Gain = Field(default=0.2, ge=0, description="of being clear of obstacles; fox: ahead")
    speed_weight: Gain = Field(default=0.2, ge=0, description="of progress to the aim; fox: of speed")
    clear_m: Metres = Field(default=0.3, gt=0, description="m, obstacles farther from the body do not matter")
    arc_m: Metres = Field(
        default=1.0, gt=0, description="m, fox: way along an arc beyond which obstacles do not matter"
    )
    stray_m: Metres = Field(
        default=0.03, gt=0, description="m, by which a robot that stops may stray from its direction"
    )
    arrive_m: Metres = Field(default=0.1, gt=0, description="m, distance within which a goal is reached")
    via_m: Metres = Field(default=0.4, gt=0, description="m, distance within which a way point is passed")
    known_m: Metres = Field(
        default=0.15, ge=0, description="m, distance from a wall of the map within which scanned points belong to it"
    )
    still_s: Seconds = Field(
        default=1.0, gt=0, description="s, time without motion after which a robot is driven round"
    )
    yield_s: Seconds = Field(
        default=1.0, gt=0, description="s, time for which a robot is held by one that goes first before it makes way"
    )
    patience_s: Seconds = Field(default=10.0, gt=0, description="s, time without progress after which a robot is stuck")
    blind_corners: bool = Field(
        default=True,
        description="slow down where a robot that may be near, but is not in sight, could come round a corner",
    )
