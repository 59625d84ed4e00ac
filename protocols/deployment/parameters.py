"""The parameters of a deployment in a scenario."""

from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from cosim.settings import Count, Length, Metres, Period, Rate, Seconds, Settings, error_at
from protocols.deployment.driving.exploring_parameters import ExploringParameters
from protocols.deployment.messages.status import MOST_BYTES
from protocols.deployment.planning.augmenting import ExecutiveParameters
from protocols.deployment.planning.planner import Call, PlannerParameters
from protocols.deployment.tasks.plan import Place, Strategy
from protocols.localization.positioning import PositioningParameters, SonarParameters
from protocols.motion.parameters import DrivingParameters
from protocols.transport.frames import PUBLICATION_OVERHEAD
from protocols.transport.parameters import TransportParameters

MOST_CALLS: Final = 255  # a status counts them in a byte
"""Greatest number of calls."""


class MemberParameters(Settings):
    """How a robot carries out its orders."""

    behind_s: Seconds = Field(
        default=3.0,
        ge=0,
        description="s, time for which a robot that is to set off behind another waits for that to drive",
    )
    behind_most_s: Seconds = Field(
        default=60.0, ge=0, description="s, greatest such time if the other has set off, but does not move"
    )
    near_m: Metres = Field(
        default=2.0, gt=0, description="m, distance from the post within which another robot is about to pass it"
    )
    away_m: Metres = Field(default=3.0, gt=0, description="m, distance from the post beyond which it has passed")
    aside_s: Seconds = Field(
        default=45.0, gt=0, description="s, time after which a robot that stepped aside comes back in any case"
    )
    taken_m: Metres = Field(
        default=0.8, gt=0, description="m, distance from the post within which an idle robot takes it"
    )
    taken_s: Seconds = Field(default=15.0, ge=0, description="s, time for which that robot must stand there")
    ask_m: Metres = Field(default=3.0, gt=0, description="m, distance within which a robot is asked to step aside")
    ask_s: Seconds = Field(default=3.0, gt=0, description="s, interval between two such requests to one robot")
    crowd_s: Seconds = Field(
        default=3.0,
        gt=0,
        description="s, time without progress after which a place that is only passed is reached, in a crowd",
    )
    stuck_s: Seconds = Field(
        default=90.0,
        gt=0,
        description="s, time without progress to a goal, or in turning to what is photographed, until that fails",
    )
    view_deg: float = Field(default=60.0, gt=0, le=360, description="degrees, width of a picture")
    look_radps: Rate = Field(default=0.5, gt=0, description="rad/s, at which a robot turns to what it photographs")

    @model_validator(mode="after")
    def _passes(self) -> Self:
        if not self.near_m < self.away_m:
            raise error_at(("near_m",), self.near_m, f"is not < {self.away_m}, away_m")
        return self


class TimedCall(Settings):
    """A play that the host calls without an operator."""

    at_s: Seconds = Field(
        default=0.0, ge=0, description="s after the start; later if another play has not ended by then"
    )
    call: Call


class TimedSwitch(Settings):
    """A change of the strategy of the present play, which the host makes without an operator."""

    at_s: Seconds = Field(ge=0, description="s after the start")
    strategy: Strategy = Field(description="the strategy from then on")


class Parameters(Settings):
    """The parameters that all robots of a run know."""

    host: Count = Field(default=0, ge=0, description="the robot at whose machine planner and executive begin")
    executive: Literal["central", "distributed"] = Field(
        default="central",
        description="central: the host orders all robots; distributed: each runs the plan and orders itself",
    )
    map: Literal["given", "learned"] = Field(
        default="given", description="map by which ways are planned: the floor's, or what robots have explored so far"
    )
    calls: tuple[TimedCall, ...] = Field(
        default=(), max_length=MOST_CALLS, description="plays to be played, in the order of their times"
    )
    switches: tuple[TimedSwitch, ...] = Field(default=(), description="changes of strategy, in that order")
    library: str | None = Field(default=None, description="path of the user's own playbook (YAML)")
    base_m: Place | None = Field(default=None, description="m, place of base; the middle of the starts if not given")
    cameras: tuple[Count, ...] | None = Field(default=None, description="robots that have a camera; all if not given")
    sonars: tuple[Count, ...] = Field(default=(), description="robots that have sonar, not a laser scanner")
    cells_m: tuple[Annotated[Length, Field(gt=0)], ...] | None = Field(
        default=None, description="m, side of the cells of each robot's own map; driving.cell_m if not given"
    )
    news_s: Period = Field(default=1.0, gt=0, description="s, interval between status broadcasts")
    listen_s: Seconds = Field(
        default=2.0, ge=0, description="s, time for which a robot that has booted listens before it leads others"
    )
    silence_s: Seconds = Field(default=15.0, gt=0, description="s, silence after which a robot is taken for lost")
    alone_s: Seconds = Field(
        default=45.0, gt=0, description="s, silence of all others after which a robot goes on alone"
    )
    again_s: Seconds = Field(
        default=5.0, gt=0, description="s, interval at which another robot is sent what it lacks by its status"
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
