"""Parameters of monitoring."""

from pydantic import Field

from cosim.settings import Count, Seconds, Settings
from protocols.detection.chen import NfdESettings
from protocols.detection.detectors import DetectorSettings


class Parameters(Settings):
    """Parameters of monitoring: which robots send heartbeats, how often, and how they are judged."""

    period_s: Seconds = Field(default=1.0, ge=1e-6, description="s, eta, from one heartbeat of a robot to the next")
    senders: Count | None = Field(
        default=None, ge=1, description="number of robots that send heartbeats, the first ones; all if not given"
    )
    spread: bool = Field(
        default=True,
        description="robots that start together send evenly spread over the period, not all at one instant",
    )
    detector: DetectorSettings = Field(
        default_factory=NfdESettings, description="failure detector for each robot that is watched"
    )
