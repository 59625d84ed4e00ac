"""Parameters of exploration (Lau, paper 001); the paper names them in Table 1 and prints no values."""

from typing import Literal

from pydantic import Field, model_validator

from cosim.navigation.feature_slam import FeatureSlamParameters
from cosim.navigation.slam import SlamParameters
from cosim.settings import Count, Gain, Length, Metres, Period, Rate, Seconds, Settings, error_at
from protocols.mapping.sharing import SharingParameters


class SchemaParameters(Settings):
    """Ranges and gains of the schemas (Table 1): forces fall with the square of the distance."""

    frontier_m: Metres = Field(default=5.0, gt=0, description="m, d_frontier: how far frontiers attract")
    frontier_gain: Gain = Field(default=1.0, ge=0, description="Gain_frontier, of each frontier cell")
    obstacle_m: Metres = Field(
        default=0.6,
        gt=0,
        description="m, d_obstacle: how far obstacles repel; body, radius of its turns, and a cell more",
    )
    obstacle_gain: Gain = Field(
        default=1.0,
        ge=0,
        description="Gain_obstacle, of each occupied cell; by default a wall ahead outweighs a path to it where "
        "the robot must begin to turn: 2 sqrt(d_obstacle^2 - D^2) / (cell D d_obstacle) against 1 / (cell d_obstacle)",
    )
    robot_range_scale: Gain = Field(default=2.0, gt=0, description="d_robot over d_obstacle")
    robot_gain_scale: Gain = Field(default=6.0, ge=0, description="Gain_robot over Gain_obstacle")
    in_sight: bool = Field(default=False, description="only obstacles in line of sight repel (section 3.3)")
    information: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="share of a frontier's gain that grows with the unknown about it (section 5.1); 0: all draw alike",
    )

    @property
    def robot_m(self) -> float:
        """Distance as far as which robots repel: d_robot, metres."""
        return self.robot_range_scale * self.obstacle_m

    @property
    def robot_gain(self) -> float:
        """Gain_robot."""
        return self.robot_gain_scale * self.obstacle_gain

    @model_validator(mode="after")
    def _obstacles_leave_frontiers_alone(self) -> "SchemaParameters":
        if not self.obstacle_m < self.frontier_m:
            raise error_at(("obstacle_m",), self.obstacle_m, f"is not < {self.frontier_m}, frontier_m (paper 001, 3.3)")
        return self


class EscapeParameters(Settings):
    """When a robot counts as caught in a local minimum, and how it gets out (sections 3.5 to 3.7)."""

    enabled: bool = Field(default=True, description="without it the robot stalls")
    period_s: Period = Field(default=8.0, gt=0, le=3600, description="s, the time over which its movement is measured")
    box_m: Metres = Field(default=0.6, gt=0, description="m, it stalls if the box of its movement is smaller")
    patience_s: Seconds | None = Field(
        default=15.0,
        gt=0,
        description="s without a new cell, or progress along its path, after which it stalls as well: it may circle in "
        "a box that is large enough; null: only the box counts, as in the paper",
    )
    cost: Literal["octile", "printed"] = Field(
        default="octile", description='A*: true lengths, or "printed": every step costs 1, straight-line heuristic'
    )
    clearance_m: Metres = Field(default=0.6, ge=0, description="m from an obstacle within which cells cost more")
    clearance_cost: Gain = Field(default=5.0, ge=0, description="of a cell next to an obstacle, in steps")
    choice: Literal["nearest", "utility"] = Field(
        default="nearest", description="the frontier to go to: the nearest (3.6), or the most useful one (5.1)"
    )
    information: float = Field(
        default=0.5, ge=0, le=1, description="by utility: weight of the information; that of the way's cost is the rest"
    )


class SteeringParameters(Settings):
    """How a desired heading becomes motion (section 3.2), and who sets the speed (section 5)."""

    speed_mps: Rate = Field(default=0.3, gt=0, description="m/s, at most the body's limit")
    turn_gain: Gain = Field(default=2.0, gt=0, description="1/s, rate of turn over the error of the heading")
    turn_radps: Rate = Field(default=1.5, gt=0, description="rad/s, the greatest rate of turn")
    fast_mps: Rate | None = Field(
        default=None, gt=0, description="m/s, where no obstacle is near (section 5.2); by default never faster"
    )
    fast_m: Metres = Field(default=1.2, gt=0, description="m, what is near")
    margin_m: Metres | None = Field(
        default=0.05,
        ge=0,
        description="m from the body's edge, where the sensors themselves turn it away (section 5.1); null: never",
    )


class RivalParameters(Settings):
    """How the algorithms that the schemas are compared with choose frontiers."""

    least_cells: Count = Field(default=4, ge=1, description="smaller groups of cells are no frontiers: a robot's width")
    plan_s: Period = Field(default=2.0, gt=0, description="s for which a target is kept that is no longer a frontier")
    patience_s: Seconds = Field(
        default=6.0, gt=0, description="s without progress, after which a robot goes round others, or gives the goal up"
    )
    cost_weight: Gain = Field(default=1.0, ge=0, description="beta, of the cost of a way against its utility")


class SpeedControlParameters(Settings):
    """How a filter sets speed and rate of turn, by the spread of its particles (section 5.2, figure 5)."""

    enabled: bool = Field(default=True, description="without it the robot drives as fast as the steering says")
    slow_m: Metres = Field(default=0.05, ge=0, description="m of spread, up to which a robot has all of its speed")
    stop_m: Metres = Field(default=0.15, gt=0, description="m, from which it waits; between them speed falls linearly")
    resume_m: Metres = Field(default=0.1, ge=0, description="m, down to which it goes on waiting")
    creep: float = Field(default=0.2, gt=0, le=1, description="the least share of its speed that a moving robot has")
    wait_s: Seconds = Field(default=20.0, gt=0, description="s, the longest wait: there may be nothing to see")
    creep_s: Seconds = Field(default=10.0, gt=0, description="s for which it then goes on, whatever the spread")

    @model_validator(mode="after")
    def _in_order(self) -> "SpeedControlParameters":
        if not self.slow_m < self.stop_m:
            raise error_at(("slow_m",), self.slow_m, f"is not < {self.stop_m}, stop_m")
        if not self.resume_m <= self.stop_m:
            raise error_at(("resume_m",), self.resume_m, f"is not <= {self.stop_m}, stop_m")
        return self


class PositioningParameters(Settings):
    """How a robot knows where it is on its map (sections 4.3 and 5.2)."""

    kind: Literal["given", "slam", "features"] = Field(
        default="given",
        description="the pose as observed: true, as in the paper, or odometry if the senses drift; or that of a "
        "filter, of grid maps (slam) or of corners and walls (features: the paper's feature-based SLAM)",
    )
    filter: SlamParameters = Field(
        default=SlamParameters(), description="the filter; its range_m is not used: a beam reaches as the scanner does"
    )
    features: FeatureSlamParameters = Field(
        default=FeatureSlamParameters(), description="the filter of corners and walls; its range_m is not used either"
    )
    control: SpeedControlParameters = SpeedControlParameters()
    margin_m: Metres = Field(
        default=0.0,
        ge=0,
        description="m, by which maps reach beyond the floor: a robot that errs may draw over its edge",
    )


class BeaconParameters(Settings):
    """How robots stay in each other's sight, as beacons (section 5.2)."""

    pattern: Literal["free", "visibility", "leapfrog"] = Field(
        default="free",
        description="no beacons; each keeps others in sight while all move; or one half moves while the other stands",
    )
    least: Count = Field(default=1, ge=1, description="how many others a robot keeps in sight")
    keep_m: Metres = Field(default=5.0, gt=0, description="m, the farthest that those may be away")
    near_m: Metres = Field(default=2.5, gt=0, description="m, the distance from which on they attract")
    gain: Gain = Field(default=100.0, ge=0, description="attraction of each of them, over the distance's square")
    slot_s: Seconds = Field(default=10.0, gt=0, description="s, leapfrog: after so long the halves change their roles")
    patience_s: Seconds = Field(
        default=60.0, gt=0, description="s without progress, after which a robot does without the others for as long"
    )

    @model_validator(mode="after")
    def _attract_before_they_hold(self) -> "BeaconParameters":
        if not self.near_m < self.keep_m:
            raise error_at(("near_m",), self.near_m, f"is not < {self.keep_m}, keep_m")
        return self


class Parameters(Settings):
    """Parameters of exploration: algorithm, map, and what each robot does with them."""

    algorithm: Literal["schemas", "nearest", "utility", "assignment"] = Field(
        default="schemas",
        description="motor schemas (the paper), the nearest frontier (Yamauchi), utilities with discount (Burgard), or "
        "the assignment of least cost",
    )
    map: Literal["shared", "messages"] = Field(
        default="shared", description="one map in one memory, as in the paper, or one each, merged by messages"
    )
    cell_m: Length = Field(default=0.1, gt=0, description="m, cells of the map (section 4.1)")
    evidence: Literal["certain", "counted"] = Field(
        default="certain",
        description="whether one hit makes a cell occupied for good, as without false hits (section 4.3), or hits and "
        "passes are weighed against each other, for robots that err in places, or do not know where all bodies are",
    )
    false_returns: bool = Field(
        default=False,
        description="beams that no neighbour confirms are dropped, and evidence is counted; ends of walls that one "
        "beam alone meets are dropped with them",
    )
    schemas: SchemaParameters = SchemaParameters()
    escape: EscapeParameters = EscapeParameters()
    steering: SteeringParameters = SteeringParameters()
    rivals: RivalParameters = RivalParameters()
    sharing: SharingParameters = SharingParameters()
    beacons: BeaconParameters = BeaconParameters()
    positioning: PositioningParameters = PositioningParameters()

    @property
    def counted(self) -> bool:
        """True if evidence of cells is counted."""
        return self.evidence == "counted" or self.false_returns

    @model_validator(mode="after")
    def _beacons_fit(self) -> "Parameters":
        pattern = self.beacons.pattern
        if pattern != "free" and self.algorithm != "schemas":
            raise error_at(("beacons", "pattern"), pattern, f"is one of schemas, not of {self.algorithm}")
        if pattern == "leapfrog" and self.positioning.kind != "given":
            expected = "counts ticks, and a filter stops that: expected positioning.kind given"
            raise error_at(("beacons", "pattern"), pattern, expected)
        return self
