"""Parameters of goal reflection, with places in the world's frame: ``spec`` turns them into the robots' own frames."""

from typing import Annotated, Literal

from pydantic import Field

from cosim.navigation.steering import AvoidPastParameters, PotentialFieldParameters
from cosim.settings import Count, Metres, Period, Seconds, Settings
from protocols.reflection.promises import Comparison, Renewal

Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]
Place = tuple[Coordinate, Coordinate]
Algorithm = Literal["potential_field", "avoid_past", "visbug", "straight"]
TroubleRule = Literal["reaches", "equals"]
ProgressMeasure = Literal["window", "nearest", "step", "motion"]
HiddenHelper = Literal["left", "followed"]


class Parameters(Settings):
    """Parameters of goal reflection: which robots look for what, how, and what they send each other."""

    algorithm: Algorithm = Field(
        default="potential_field",
        description='A, the local navigation algorithm; "straight" heads for the goal whatever is in the way',
    )
    potential_field: PotentialFieldParameters = PotentialFieldParameters()
    avoid_past: AvoidPastParameters = AvoidPastParameters()
    vision_m: Metres = Field(
        default=10.0, gt=0, description="VisBug's radius of vision: as far as the robots' sensors reach"
    )
    goals: Literal["place", "object"] = Field(
        default="place",
        description='"object": no robot knows where a goal is until it is seen, so A is random motion',
    )
    share_goals: bool = Field(default=True, description="robots send each other goals, and what they can promise")
    share_states: bool | None = Field(
        default=None,
        description="robots report whether they are in trouble, and then follow one that is not; by default only "
        "with the potential field, as in the paper",
    )

    explorers: Count = Field(default=1, ge=0, description="the first so many robots have targets; the others help")
    targets: tuple[tuple[Place, ...], ...] | None = Field(
        default=None, description="the targets of each explorer, in their order; by default they are drawn in rooms"
    )
    rooms: tuple[Place, ...] = Field(
        default=(), description="middles of rooms, where targets are drawn; by default those that the floor names"
    )
    target_count: Count = Field(default=200, gt=0, description="targets of each explorer, if they are drawn")
    target_set: Count | None = Field(
        default=None, ge=0, description="which of the random sets of targets; by default that of the run's seed"
    )
    target_spread_m: Metres = Field(
        default=0.0, ge=0, description="how far, along x and y, a drawn target may lie from the middle of its room"
    )
    patrols: tuple[tuple[Place, ...], ...] = Field(
        default=(),
        description="way points of the helpers, one list each and again from the first; by default what the floor "
        "names; without any they stand still",
    )
    patrol: Literal["shuttle", "cycle"] = Field(default="shuttle", description="there and back, or round and round")

    epsilon_m: Metres = Field(default=0.3, gt=0, description="distance below which a goal is reached")
    give_up_s: Seconds = Field(default=600.0, gt=0, description="time after which a robot gives up a goal")
    promise_life_s: Seconds = Field(
        default=120.0, gt=0, description="a promise is forgotten when no robot has seen its goal for so long"
    )
    renewal: Renewal = Field(
        default="stored",
        description="what a robot follows that has found a promise useless: only a way that is shorter than that was "
        'when it was taken ("stored", as in the paper), only one "shorter" than it is from here, or "any"',
    )
    comparison: Comparison = Field(
        default="remaining",
        description="what a promise has to beat while another is followed: what is left of its way from here "
        '("remaining"), or its length when it was promised ("stored", by the letter of section 4.2)',
    )
    patience_s: Seconds = Field(
        default=3.0, gt=0, description="time without progress after which a robot no longer heads straight for a place"
    )
    detour_s: Seconds = Field(
        default=5.0, gt=0, description="time for which it then leaves a goal in sight to the algorithm A"
    )
    hold_s: Seconds = Field(default=1.0, gt=0, description="time for which a robot that has made way stays aside")

    trouble_limit: Count = Field(default=30, gt=0, description="Cr, motion steps without progress that make a trouble")
    trouble_rule: TroubleRule = Field(
        default="reaches", description='in trouble from Pr >= Cr on, or as printed, when Pr "equals" Cr'
    )
    trouble_memory: Literal["goal", "run"] = Field(
        default="goal", description="Pr and Nt begin again with each goal, or never"
    )
    hidden_helper: HiddenHelper = Field(
        default="left",
        description="a helper that gets out of sight of a robot in trouble is left to itself, or followed to the place "
        "where it was seen last",
    )
    progress: ProgressMeasure = Field(default="window", description="what counts as progress, see trouble.Progress")
    progress_window: Count = Field(default=10, gt=0, description="motion steps that are looked back on")
    progress_share: float = Field(
        default=0.2, ge=0, le=1, description="share of the greatest possible progress that is progress"
    )

    links: bool = Field(
        default=False,
        description="look for the robots in sight by radio, and send over links: what Bluetooth needs",
    )
    inquiry_s: Seconds = Field(default=5.12, gt=0, description="longest inquiry on meeting a robot, if links are used")
    page_s: Seconds = Field(default=6.0, gt=0, description="time after which the host no longer waits for the device")
    period_s: Period | None = Field(default=None, gt=0, description="time between two frames; by default a tick")
    stale_s: Seconds = Field(
        default=0.5, gt=0, description="advice that is older on arrival than this is counted as stale"
    )

    @property
    def states_shared(self) -> bool:
        """True if robots share their states."""
        return self.algorithm == "potential_field" if self.share_states is None else self.share_states
