"""What the executive's augmentations and its re-planning can be told."""

from pydantic import Field

from cosim.settings import Count, Gain, Metres, Settings


class ExecutiveParameters(Settings):
    """Distances of the augmentations, which the paper leaves open (paper 004, section 5), and what losses mean."""

    spacing_m: Metres = Field(default=1.2, gt=0, description="m, between the robots of a group stage along their line")
    behind_m: Metres = Field(
        default=1.5, ge=0, description="m, how far the robot ahead is before the next one sets off"
    )
    near_m: Metres = Field(default=4.0, gt=0, description="m, nearer than this a passing robot makes others step aside")
    aside_m: Metres = Field(
        default=0.5,
        ge=0,
        description="m, that a passing robot's way must keep from a deployed one's body beside its own",
    )
    gap_m: Metres = Field(default=0.2, ge=0, description="m, least room between the bodies of robots that stand")
    detour: Gain = Field(
        default=1.5,
        ge=1,
        description="a place is on the line to the next goal if its way is no longer than so many times",
    )
    tries: Count = Field(default=2, ge=1, description="of a drive within a deployment, before its robot is left behind")
    rounds: Count = Field(
        default=2, ge=0, description="how often those who have not come to their places are sent again in the end"
    )
    draft: bool = Field(default=True, description="whether robots that are not in the plan take over for lost ones")
