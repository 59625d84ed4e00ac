"""How robots follow their ways, and how they get past each other: the parameters."""

from pydantic import Field

from cosim.settings import Count, Metres, Seconds, Settings


class WalkingParameters(Settings):
    """How a robot follows its ways, and how it gets past others. Times are longer for robots that are slow."""

    arrival_m: Metres = Field(default=0.3, gt=0, description="m, a goal as near as this is reached")
    pass_m: Metres = Field(
        default=0.3, gt=0, description="m, from a way point as near as this a robot goes on to the next, if it sees it"
    )
    near_m: Metres = Field(default=1.5, gt=0, description="m, a robot ahead that is nearer than this is steered round")
    clear_ticks: Count = Field(
        default=10, ge=1, description="ticks for which the way is to be clear before VFH+ is done"
    )
    patience_s: Seconds = Field(default=4.0, gt=0, description="s without progress after which a robot is stuck")
    pause_s: Seconds = Field(
        default=2.0, gt=0, description="s for which it waits for another at first, doubled with attempts in vain"
    )
    off_way_m: Metres = Field(default=1.0, gt=0, description="m, a robot farther off its way than this plans anew")
    safety_m: Metres = Field(default=0.1, ge=0, le=100, description="m, distance that VFH+ keeps from walls and bodies")
    window_m: Metres = Field(default=1.5, gt=0, description="m, radius of the active window of VFH+")
    leg_m: Metres = Field(default=20.0, gt=0, description="m, longest straight piece of random motion")
    sight_m: Metres = Field(default=5.0, gt=0, description="m, how far members without a map see walls")
