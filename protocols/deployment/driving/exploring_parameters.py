"""What a scenario can say about how robots of a deployment explore."""

from typing import Literal, Self

from pydantic import Field, model_validator

from cosim.settings import Seconds, Settings, error_at
from protocols.exploration.parameters import Parameters


class ProtocolParameters(Parameters):
    """Parameters of the exploration protocol with other defaults: maps are sent, and frontiers chosen by utilities.

    Paper 004 leaves exploring to its references [5] and [19], which choose frontiers so.
    """

    algorithm: Literal["schemas", "nearest", "utility", "assignment"] = Field(
        default="utility", description="how frontiers are chosen (see the exploration protocol)"
    )
    map: Literal["shared", "messages"] = Field(default="messages", description="one map each: expected messages")
    evidence: Literal["certain", "counted"] = Field(
        default="counted", description="hits and passes are weighed: robots do not always know where all bodies are"
    )


class ExploringParameters(Settings):
    """How robots explore when they are ordered to, and how they use what they have seen."""

    protocol: ProtocolParameters = Field(
        default=ProtocolParameters(),
        description="of the exploration protocol; frontiers are seen as far as scans reach",
    )
    most_s: Seconds = Field(default=3600.0, gt=0, description="s, after which a robot has explored enough in any case")
    renew_s: Seconds = Field(
        default=5.0, gt=0, description="s between looks at what was learned, by which ways are planned again"
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        own = self.protocol
        for name, value, expected in (
            ("map", own.map, "messages"),
            ("positioning.kind", own.positioning.kind, "given"),
            ("beacons.pattern", own.beacons.pattern, "free"),
            ("sharing.links", own.sharing.links, None),
        ):
            if value != expected:
                place = ("protocol", *name.split("."))
                raise error_at(place, value, f"is not {expected}, the only one that goes with deployments")
        return self
