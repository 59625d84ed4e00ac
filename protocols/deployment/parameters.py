"""The parameters of a deployment in a scenario."""

from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from cosim.settings import Count, Length, Metres, Period, Rate, Seconds, Settings, error_at
from protocols.deployment.driving.exploring_parameters import ExploringParameters
from protocols.deployment.localization.parameters import PositioningParameters, SonarParameters
from protocols.deployment.messages.status import MOST_BYTES
from protocols.deployment.planning.augmenting import ExecutiveParameters
from protocols.deployment.planning.planner import Call, PlannerParameters
from protocols.deployment.tasks.plan import Place, Strategy
from protocols.motion.parameters import DrivingParameters
from protocols.transport.frames import PUBLICATION_OVERHEAD
from protocols.transport.parameters import TransportParameters

MOST_CALLS: Final = 255
"""News count them in a byte."""


class MemberParameters(Settings):
    """How a robot carries out its orders."""

    behind_s: Seconds = Field(
        default=3.0, ge=0, description="s, who is to set off behind another waits so long for it to begin to drive"
    )
    behind_most_s: Seconds = Field(
        default=60.0, ge=0, description="s, and so long at most for one that has begun, but does not get on"
    )
    near_m: Metres = Field(default=2.0, gt=0, description="m, who has come as near to the post has come to pass it")
    away_m: Metres = Field(default=3.0, gt=0, description="m, and has passed once it is so far from it again")
    aside_s: Seconds = Field(default=45.0, gt=0, description="s, after which who stepped aside comes back in any case")
    taken_m: Metres = Field(
        default=0.8, gt=0, description="m, who comes back leaves its post to one who stands so near"
    )
    taken_s: Seconds = Field(default=15.0, ge=0, description="s, and has nothing to do but to stand there")
    ask_m: Metres = Field(default=3.0, gt=0, description="m, nobody is asked to step aside who is farther off")
    ask_s: Seconds = Field(default=3.0, gt=0, description="s from one request to step aside to the next")
    crowd_s: Seconds = Field(
        default=3.0, gt=0, description="s, who passes a place and comes no nearer, for bodies about it, has come to it"
    )
    stuck_s: Seconds = Field(
        default=90.0,
        gt=0,
        description="s in which a robot gets no nearer to its goal, or to facing what it photographs, until that fails",
    )
    view_deg: float = Field(default=60.0, gt=0, le=360, description="degrees, how wide a picture is")
    look_radps: Rate = Field(default=0.5, gt=0, description="rad/s, how fast a robot turns to what it photographs")

    @model_validator(mode="after")
    def _passes(self) -> Self:
        if not self.near_m < self.away_m:
            raise error_at(("near_m",), self.near_m, f"is not < {self.away_m}, away_m")
        return self


class TimedCall(Settings):
    """A play that the host calls without an operator."""

    at_s: Seconds = Field(default=0.0, ge=0, description="s after the start; later if another play is not over by then")
    call: Call


class TimedSwitch(Settings):
    """The host switches the strategy of the play that is being played, without an operator."""

    at_s: Seconds = Field(ge=0, description="s after the start")
    strategy: Strategy


class Parameters(Settings):
    """What all robots of a run have been told."""

    host: Count = Field(default=0, ge=0, description="the robot at whose machine planner and executive begin")
    executive: Literal["central", "distributed"] = Field(
        default="central", description="whether the host orders all, or each robot runs the plan and orders itself"
    )
    map: Literal["given", "learned"] = Field(
        default="given", description="by which ways are planned: the floor's, or what robots have explored so far"
    )
    calls: tuple[TimedCall, ...] = Field(
        default=(), max_length=MOST_CALLS, description="plays to be played, in the order of their times"
    )
    switches: tuple[TimedSwitch, ...] = Field(default=(), description="changes of strategy, in that order")
    library: str | None = Field(default=None, description="path of a playbook (YAML) of the user's own")
    base_m: Place | None = Field(default=None, description="m, where base is; the middle of the starts if not given")
    cameras: tuple[Count, ...] | None = Field(default=None, description="who has a camera; all if not given")
    sonars: tuple[Count, ...] = Field(default=(), description="who has sonar, not a laser scanner")
    cells_m: tuple[Annotated[Length, Field(gt=0)], ...] | None = Field(
        default=None, description="m, side of the cells of each robot's own map; driving.cell_m if not given"
    )
    news_s: Period = Field(default=1.0, gt=0, description="s from one telling of whereabouts to the next")
    listen_s: Seconds = Field(default=2.0, ge=0, description="s, who has booted listens so long before it leads others")
    silence_s: Seconds = Field(
        default=15.0, gt=0, description="s, nothing heard for so long: a robot is taken for lost"
    )
    alone_s: Seconds = Field(
        default=45.0, gt=0, description="s, nothing heard of anybody for so long: a robot goes on alone"
    )
    again_s: Seconds = Field(
        default=5.0, gt=0, description="s, what another's news say that it lacks it is told once in so long"
    )
    interference: bool = Field(
        default=False,
        description="measure interference_s and hindered_s: compute what each robot would do without the others",
    )
    member: MemberParameters = MemberParameters()
    driving: DrivingParameters = DrivingParameters()
    positioning: PositioningParameters = PositioningParameters()
    sonar: SonarParameters = SonarParameters()
    courier: TransportParameters = TransportParameters()
    planner: PlannerParameters = PlannerParameters()
    executing: ExecutiveParameters = ExecutiveParameters()
    exploring: ExploringParameters = ExploringParameters()

    @property
    def carried(self) -> TransportParameters:
        """Parameters of the transport: where radios need links, the host is the first master of their piconet."""
        links = self.courier.links
        if links is None:
            return self.courier
        return self.courier.model_copy(update={"links": links.model_copy(update={"first": self.host})})

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> Self:
        if not 2.0 * self.news_s <= self.silence_s:
            raise error_at(("silence_s",), self.silence_s, f"is not >= {2.0 * self.news_s}, twice news_s")
        if not self.silence_s <= self.alone_s:
            raise error_at(("alone_s",), self.alone_s, f"is not >= {self.silence_s}, silence_s")
        if self.map == "learned" and self.executive != "central":
            expected = "does not go with map learned: each has its own, and one plans for all: expected central"
            raise error_at(("executive",), self.executive, expected)
        if self.map == "learned" and self.positioning.kind != "given":
            expected = "does not go with map learned: there is nothing to localise on: expected given"
            raise error_at(("positioning", "kind"), self.positioning.kind, expected)
        if not self.courier.octets >= PUBLICATION_OVERHEAD + MOST_BYTES:
            expected = f"is not >= {PUBLICATION_OVERHEAD + MOST_BYTES}, the longest news"
            raise error_at(("courier", "octets"), self.courier.octets, expected)
        times = [call.at_s for call in self.calls]
        if times != sorted(times):
            raise error_at(("calls",), times, "is not in the order of the times at_s")
        return self
