"""Parameters of aggregation (Meng, Nickerson and Gan, paper 002); what the paper leaves open is chosen, and said so."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, ValidationInfo, field_validator, model_validator

from cosim.settings import FARTHEST_M, Bounded, Count, Length, Metres, Period, Rate, Seconds, Settings, error_at
from protocols.detection.detectors import DetectorSettings, FixedTimeoutSettings
from protocols.localization.positioning import PositioningParameters
from protocols.transport.parameters import PagingParameters

Reach: TypeAlias = Annotated[float, Bounded(0.1, FARTHEST_M)]
"""Range within which a camera recognises something: the floor is divided into what is seen from its posts."""
StrategyName: TypeAlias = Literal["srp", "mrp", "mi", "mito", "random"]


class WalkingParameters(Settings):
    """How a robot follows its ways, and how it gets past others. Times are longer for robots that are slow."""

    arrival_m: Metres = Field(default=0.3, gt=0, description="m, a goal as near as this is reached")
    pass_m: Metres = Field(
        default=0.3, gt=0, description="m, from a way point as near as this a robot goes on to the next, if it sees it"
    )
    near_m: Metres = Field(default=1.5, gt=0, description="m, a robot ahead that is nearer than this is steered round")
    clear_ticks: Count = Field(default=10, ge=1, description="ticks for which the way must be clear before VFH+ ends")
    patience_s: Seconds = Field(default=4.0, gt=0, description="s without progress after which a robot is stuck")
    pause_s: Seconds = Field(
        default=2.0, gt=0, description="s for which it waits for another at first; doubled with failed attempts"
    )
    off_way_m: Metres = Field(default=1.0, gt=0, description="m, a robot farther off its way than this plans again")
    safety_m: Metres = Field(default=0.1, ge=0, le=100, description="m, distance that VFH+ keeps from walls and bodies")
    window_m: Metres = Field(default=1.5, gt=0, description="m, radius of the active window of VFH+")
    leg_m: Metres = Field(default=20.0, gt=0, description="m, longest straight piece of random motion")
    sight_m: Metres = Field(default=5.0, gt=0, description="m, how far members without a map see walls")


class Parameters(Settings):
    """What all robots of a run have in common: the hosts, how they aggregate, and when they suspect each other.

    The first *hosts* robots are hosts, the others searchers: searcher k begins in the sub-team of host k mod hosts.
    """

    strategy: StrategyName = Field(
        default="mi", description="static or mobile rally point, mobile integrator without or with time-out, or random"
    )
    hosts: Count = Field(default=1, ge=1, description="the first so many robots lead a sub-team each")
    humans: tuple[Count, ...] = Field(
        default=(), description="searchers that are people: they have no planner and go by what they see"
    )
    strays: tuple[Count, ...] = Field(
        default=(), description="hosts whose way is not kept within reach of the others (the paper's second case)"
    )

    target_count: int = Field(default=3, ge=1, le=255, description="targets, if they are drawn")
    targets: tuple[tuple[Metres, Metres], ...] | None = Field(
        default=None, min_length=1, max_length=255, description="m, where they are; drawn in rooms if not given"
    )
    target_place: str | None = Field(
        default=None, description="the name under which the floor lists the targets' places, if it does"
    )

    camera_m: Reach = Field(default=8.0, gt=0, description="m, how far a camera recognises a target")
    vision_m: Metres = Field(default=20.0, ge=0, description="m, how far it recognises a host; 0: radio only")
    human_camera_m: Reach | None = Field(
        default=None, gt=0, description="m, how far a person recognises a target; as a camera does if not given"
    )
    human_vision_m: Metres | None = Field(
        default=None, ge=0, description="m, how far a person recognises a host; as robots do if not given"
    )
    short_m: Metres = Field(default=20.0, gt=0, description="m, nominal reach of the radio within a sub-team")
    long_m: Metres = Field(default=100.0, gt=0, description="m, nominal reach of the radio between hosts")
    long_radio: int = Field(
        default=1, ge=0, le=1, description="the radio between hosts: 1, or 0 where robots have only one"
    )
    links: PagingParameters | None = Field(
        default=None,
        description="send over the links of a piconet whose master is the host, the only one: what Bluetooth needs; by "
        "default to all in reach",
    )
    host_speed_mps: Rate = Field(default=0.5, gt=0, description="the hosts' speed under way; at most their bodies'")
    cell_m: Length = Field(
        default=0.5, gt=0, description="m, cells of the planner's grid; doors are wider than two radii and 2.42 cells"
    )
    planner: Literal["roadmap", "wavefront"] = Field(
        default="roadmap",
        description="what finds ways over the grid: a wavefront, as in the paper, or a roadmap of the corners of its "
        "free cells: its ways are as short, at a hundredth of the cost",
    )
    walking: WalkingParameters = WalkingParameters()
    positioning: PositioningParameters = PositioningParameters()

    muster_s: Seconds = Field(default=3.0, gt=0, description="s, for announcing the first plan before hosts depart")
    reconvene_s: Seconds = Field(default=150.0, gt=0, description="s, MRP: from a host's departure until it stops")
    rounds: Count = Field(default=4, ge=1, description="MRP: reconvening points on a host's way to the far end")
    way_out: Literal["far", "exit"] = Field(
        default="far", description="MRP: a host's way leads to the far end of its region, or to the floor's exit"
    )
    sync_s: Seconds = Field(default=150.0, gt=0, description="s, MRP: longest wait for the sub-team at such a point")
    report: Literal["first", "area", "appointed"] = Field(
        default="first",
        description='SRP: go to the rally point with the "first" find or a finished area, whichever comes first '
        '(section III.A), or only when the "area" is done, or keep finds back until the "appointed" time, integrate_s '
        "(section VII.B, read in two ways)",
    )
    integrate_s: Seconds | None = Field(
        default=None,
        gt=0,
        description="s from the start, SRP's static integration time, for the appointed report; if not given, muster_s "
        "and the longest that any searcher takes for its first tour and from there to the rally point",
    )
    timeout_s_per_m2: Rate = Field(
        default=0.04,
        gt=0,
        description="MITO: time-out, s a square metre of floor over the number of targets; ways there and back fit in",
    )
    timeout_armed: Literal["always", "find"] = Field(
        default="always",
        description='MITO: the time-out holds for all searchers "always", predefined as in section III.D, or for one '
        'only after its own first "find", as in the case for which that section proposes it',
    )
    interception_rounds: Count = Field(
        default=1, ge=0, description="rounds of predicting where to meet a moving host; 0: go where it is now"
    )

    heartbeat_s: Period = Field(default=1.0, gt=0, description="s, from one heartbeat of a host to the next")
    fresh_s: Seconds = Field(default=2.5, gt=0, description="s, so long after its heartbeat a host is in contact")
    stream_bytes_per_s: Rate = Field(
        default=0.0,
        ge=0,
        description="B/s that each searcher in contact sends its host beside messages: of its map, pictures or video",
    )
    detector: DetectorSettings = Field(
        default=FixedTimeoutSettings(timeout_s=5.0), description="how hosts detect that another has failed"
    )
    suspect_s: Seconds = Field(
        default=10.0,
        gt=0,
        description="s without a heartbeat, close to the host's place, after which a searcher suspects its host",
    )
    meet_s: Seconds = Field(
        default=300.0, gt=0, description="s without a heartbeat on the way to it, after which it suspects it as well"
    )
    close_share: float = Field(
        default=0.5, gt=0, le=1, description="share of short_m within which a searcher is close to a host's place"
    )
    lost_s: Seconds = Field(default=900.0, gt=0, description="s of silence after which a host removes a searcher")

    motion_j_per_m: Rate = Field(default=20.0, ge=0, description="J, energy of driving a metre")

    @model_validator(mode="after")
    def _heartbeats_keep_contact(self) -> "Parameters":
        if not self.fresh_s > self.heartbeat_s:
            raise error_at(
                ("fresh_s",), self.fresh_s, f"is not > {self.heartbeat_s}, heartbeat_s: contact would not last"
            )
        return self

    @model_validator(mode="after")
    def _one_piconet(self) -> "Parameters":
        if self.links is not None and self.hosts > 1:
            raise error_at(("hosts",), self.hosts, "is not 1, and links are those of one piconet with one master")
        return self

    @field_validator("human_camera_m", "human_vision_m")
    @classmethod
    def _sight_is_of_people(cls, sight_m: float | None, info: ValidationInfo) -> float | None:
        if sight_m is not None and info.data.get("humans") == ():  # it is missing if it is wrong itself
            raise ValueError("is nobody's, expected a searcher in humans")
        return sight_m

    @property
    def least_camera_m(self) -> float:
        """Range within which all members recognise a target, metres."""
        return min(self.camera_m, self.human_camera_m or self.camera_m)

    def of(self, robot: int) -> "Parameters":
        """Return the parameters of one robot.

        A person has the ``camera_m`` and ``vision_m`` of people, and no filter, only the given pose.
        """
        if robot not in self.humans:
            return self
        sight = {"camera_m": self.human_camera_m, "vision_m": self.human_vision_m}
        own = {name: reach_m for name, reach_m in sight.items() if reach_m is not None}
        return self.model_copy(update={"positioning": PositioningParameters(), **own})
