"""Parameters of where a robot takes itself to be, and of a range sensor that is not a laser scanner."""

from typing import Literal

from pydantic import Field

from cosim.navigation.localization.localizer import LocalizationParameters
from cosim.settings import Angle, Metres, Seconds, Settings


def tracking() -> LocalizationParameters:
    """Return the filter's parameters for robots that know where they start.

    Nobody is kidnapped, so no particle is ever thrown to a random place (Nav2's default), which would cost as much as
    all the rest three times. And odometry is taken to err by a tenth: in a corridor longer than the scanner reaches
    nothing but odometry says how far along it a robot is, and with twice the noise it is lost by 0.4 m.
    """
    return LocalizationParameters(
        recovery_slow=0.0, recovery_fast=0.0, alpha1=0.01, alpha2=0.01, alpha3=0.01, alpha4=0.01
    )


class PositioningParameters(Settings):
    """Whether a robot takes the pose that it is told, or that of Monte Carlo localisation on the known map."""

    kind: Literal["given", "mcl"] = Field(
        default="given", description="the pose that is told (odometry, where it drifts), or that of the filter"
    )
    filter: LocalizationParameters = Field(
        default_factory=tracking, description="of the filter; its range is that of the robot's sensor"
    )
    start_m: Metres = Field(default=0.05, ge=0, description="m, standard deviation of what is known of the start")
    start_rad: Angle = Field(default=0.02, ge=0, description="rad, standard deviation of the heading there")
    settle_s: Seconds = Field(
        default=0.3, ge=0, description="s in which a correction is made by 63 %, so that it is no jump for who drives"
    )
    jump_m: Metres = Field(default=0.5, gt=0, description="m, a greater correction is made at once")


class SonarParameters(Settings):
    """What a ring of sonars tells; the beams are some of the range scanner's."""

    beams: int = Field(default=24, ge=4, le=720, description="sonars of a ring; about so many beams are used")
    range_m: Metres = Field(default=5.0, gt=0, description="m, how far they reach, if the scanner reaches as far")
    noise_m: Metres = Field(default=0.0, ge=0, description="m, standard deviation of a range, of their own")
