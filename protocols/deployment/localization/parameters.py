"""Parameters of where a robot takes itself to be, and of a range sensor that is not a laser scanner."""

from typing import Literal

from pydantic import Field

from cosim.navigation.localization.localizer import LocalizationParameters
from cosim.settings import Angle, Metres, Seconds, Settings


def tracking() -> LocalizationParameters:
    """Return the filter's parameters for robots that know where they start.

    No particle is ever moved to a random place (Nav2's default), and odometry is taken to err by a tenth.
    """
    # No robot is ever moved by hand, and random particles would cost three times as much as all the rest. In a corridor
    # longer than the scanner's range only odometry says how far along it a robot is: with twice the noise the estimate
    # would be off by 0.4 m.
    return LocalizationParameters(
        recovery_slow=0.0, recovery_fast=0.0, alpha1=0.01, alpha2=0.01, alpha3=0.01, alpha4=0.01
    )


class PositioningParameters(Settings):
    """Where a robot takes its pose from: the given one, or Monte Carlo localisation on the known map."""

    kind: Literal["given", "mcl"] = Field(
        default="given", description="the given pose (odometry, where it drifts), or the estimate of the filter"
    )
    filter: LocalizationParameters = Field(
        default_factory=tracking, description="of the filter; its range is that of the robot's sensor"
    )
    start_m: Metres = Field(default=0.05, ge=0, description="m, standard deviation of the known start")
    start_rad: Angle = Field(default=0.02, ge=0, description="rad, standard deviation of the heading there")
    settle_s: Seconds = Field(
        default=0.3, ge=0, description="s, time constant of a correction (63 %), so that it is no jump for the driver"
    )
    jump_m: Metres = Field(default=0.5, gt=0, description="m, size from which on a correction is made at once")


class SonarParameters(Settings):
    """A ring of sonars; its beams are some of the range scanner's."""

    beams: int = Field(default=24, ge=4, le=720, description="number of sonars of a ring, about that of the beams used")
    range_m: Metres = Field(default=5.0, gt=0, description="m, range, if the scanner reaches as far")
    noise_m: Metres = Field(default=0.0, ge=0, description="m, standard deviation of the sonars' own noise")
