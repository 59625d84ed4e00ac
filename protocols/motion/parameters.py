"""Parameters of driving: what a floor's cells cost, what DWA prefers, and how long a robot puts up with being held."""

from pydantic import Field

from cosim.settings import Gain, Length, Metres, Rate, Seconds, Settings


class DrivingParameters(Settings):
    """How robots of a team drive; what differs from body to body (radius, speed, acceleration) comes with the body."""

    cell_m: Length = Field(default=0.1, gt=0, description="m, side of the cells in which ways are planned")
    margin_m: Metres = Field(default=0.03, ge=0, description="m off walls and bodies in plans; half is always kept")
    comfort_m: Metres = Field(
        default=0.3, gt=0, description="m from a wall, beside the margin, within which cells cost"
    )
    comfort_price: Gain = Field(
        default=3.0, ge=1, description="of a cell at the margin, times the length; falls to 1 at comfort_m"
    )
    turn_radps: Rate = Field(default=2.0, gt=0, description="rad/s, greatest angular speed of the bodies")
    turn_acceleration_radps2: Rate = Field(default=4.0, gt=0, description="rad/s2, greatest change of it")
    look_ahead_m: Metres = Field(default=1.0, gt=0, description="m along the way at which a robot aims")
    heading_weight: Gain = Field(default=2.0, ge=0, description="of facing the aim (Fox et al. 1997: 2.0)")
    clearance_weight: Gain = Field(default=0.2, ge=0, description="of being clear of obstacles (Fox et al.: 0.2)")
    speed_weight: Gain = Field(default=0.2, ge=0, description="of progress to the aim (Fox et al.: 0.2)")
    clear_m: Metres = Field(default=0.3, gt=0, description="m, obstacles farther from the body do not matter")
    stray_m: Metres = Field(
        default=0.03, gt=0, description="m, by which a robot may stray, in what it takes to stop, from its direction"
    )
    arrive_m: Metres = Field(default=0.1, gt=0, description="m, a goal as near as this is reached")
    via_m: Metres = Field(default=0.4, gt=0, description="m, a way point as near as this is passed")
    known_m: Metres = Field(
        default=0.15, ge=0, description="m, what the scanner meets so near to a wall of the map is that wall"
    )
    still_s: Seconds = Field(default=1.0, gt=0, description="s, who has not moved for so long is gone round")
    yield_s: Seconds = Field(
        default=1.0, gt=0, description="s held by one who goes first, after which a robot makes way"
    )
    patience_s: Seconds = Field(default=10.0, gt=0, description="s without progress after which a robot is stuck")
    blind_corners: bool = Field(
        default=True, description="slower where somebody who is not in sight, but may be near, could come round"
    )
