"""Parameters of exploration (Lau, paper 001); the paper names them in Table 1 and prints no values."""

from typing import Literal

from pydantic import Field, model_validator

from cosim.settings import Settings


class SchemaParameters(Settings):
    """Ranges and gains of the schemas (Table 1): forces fall with the square of the distance."""

    frontier_m: float = Field(default=5.0, gt=0, description="m, d_frontier: how far frontiers attract")
    frontier_gain: float = Field(default=1.0, ge=0, description="Gain_frontier, of each frontier cell")
    obstacle_m: float = Field(default=0.5, gt=0, description="m, d_obstacle: how far obstacles repel")
    obstacle_gain: float = Field(default=0.3, ge=0, description="Gain_obstacle, of each occupied cell")
    robot_range_scale: float = Field(default=2.5, gt=0, description="d_robot over d_obstacle")
    robot_gain_scale: float = Field(default=20.0, ge=0, description="Gain_robot over Gain_obstacle")
    in_sight: bool = Field(default=False, description="only obstacles in line of sight repel (section 3.3)")

    @property
    def robot_m(self) -> float:
        """How far robots repel: d_robot, metres."""
        return self.robot_range_scale * self.obstacle_m

    @property
    def robot_gain(self) -> float:
        """Gain_robot."""
        return self.robot_gain_scale * self.obstacle_gain

    @model_validator(mode="after")
    def _obstacles_leave_frontiers_alone(self) -> "SchemaParameters":
        if not self.obstacle_m < self.frontier_m:
            raise ValueError(f"obstacle_m {self.obstacle_m} is not < frontier_m {self.frontier_m} (paper 001, 3.3)")
        return self


class EscapeParameters(Settings):
    """When a robot takes itself to be caught in a local minimum, and how it gets out (sections 3.5 to 3.7)."""

    enabled: bool = Field(default=True, description="without it the robot stalls")
    period_s: float = Field(default=8.0, gt=0, description="s, the time for which its movement is looked at")
    box_m: float = Field(default=0.6, gt=0, description="m, it stalls if the box of its movement is smaller")
    patience_s: float | None = Field(
        default=15.0,
        gt=0,
        description="s without a new cell, or one of its path walked, after which it stalls as well: it may circle in "
        "a box that is large enough; null: only the box counts, as in the paper",
    )
    cost: Literal["octile", "printed"] = Field(
        default="octile", description='A*: true lengths, or "printed": every step costs 1, straight-line heuristic'
    )
    clearance_m: float = Field(default=0.6, ge=0, description="m, from an obstacle, nearer cells cost more")
    clearance_cost: float = Field(default=5.0, ge=0, description="of a cell next to an obstacle, in steps")


class SteeringParameters(Settings):
    """How a desired heading becomes motion (section 3.2), and who sets the speed (section 5)."""

    speed_mps: float = Field(default=0.3, gt=0, description="m/s, at most the body's limit")
    turn_gain: float = Field(default=2.0, gt=0, description="1/s, rate of turn over the error of the heading")
    turn_radps: float = Field(default=1.5, gt=0, description="rad/s, the greatest rate of turn")
    fast_mps: float | None = Field(
        default=None, gt=0, description="m/s, where no obstacle is near (section 5.2); by default never faster"
    )
    fast_m: float = Field(default=1.2, gt=0, description="m, what is near")
    margin_m: float | None = Field(
        default=0.05,
        ge=0,
        description="m from the body's edge, where the sensors themselves turn it away (section 5.1); null: never",
    )


class RivalParameters(Settings):
    """How algorithms choose frontiers that the schemas are compared with."""

    least_cells: int = Field(default=4, ge=1, description="smaller groups of cells are no frontiers: a robot's width")
    plan_s: float = Field(default=2.0, gt=0, description="s, from one choice to the next")
    cost_weight: float = Field(default=1.0, ge=0, description="beta, of the cost of a way against its utility")


class SharingParameters(Settings):
    """How maps are merged by messages."""

    period_s: float = Field(default=1.0, gt=0, description="s, from one telling to the next")
    octets: int = Field(default=200, ge=21, le=65535, description="bytes, the longest frame")
    again: int = Field(default=4, ge=1, description="pieces that are told again in answer to one summary")


class Parameters(Settings):
    """What all robots of a run have been told."""

    algorithm: Literal["schemas", "nearest", "utility", "assignment"] = Field(
        default="schemas",
        description="motor schemas (the paper), the nearest frontier (Yamauchi), utilities with discount (Burgard), or "
        "the assignment of least cost",
    )
    map: Literal["shared", "messages"] = Field(
        default="shared", description="one map in one memory, as in the paper, or one each, merged by messages"
    )
    cell_m: float = Field(default=0.1, gt=0, description="m, cells of the map (section 4.1)")
    false_returns: bool = Field(
        default=False, description="one hit does not make a cell occupied for good: evidence is counted"
    )
    schemas: SchemaParameters = SchemaParameters()
    escape: EscapeParameters = EscapeParameters()
    steering: SteeringParameters = SteeringParameters()
    rivals: RivalParameters = RivalParameters()
    sharing: SharingParameters = SharingParameters()
