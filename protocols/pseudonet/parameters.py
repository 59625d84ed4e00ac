"""What a scenario can say about Pseudonet, and the times that follow from it."""

import math
from typing import Literal, NamedTuple

from pydantic import Field

from cosim.machine import Surroundings
from cosim.settings import Settings
from cosim.units import Time, from_seconds


class Parameters(Settings):
    """Parameters of Pseudonet and its coverage algorithms."""

    algorithm: Literal["oscard", "random_walk", "boustrophedon", "spanning_tree"] = "boustrophedon"
    cell_m: float = Field(default=0.5, gt=0, description="side of a coverage cell, the footprint of a robot")
    step_limit: int | None = Field(
        default=None,
        gt=0,
        description="steps after which the team ends; by default none for the complete algorithms, and for the "
        "others four times the number of cells that each robot would have to cover",
    )
    stop_ratio: float = Field(
        default=1.0,
        gt=0,
        le=1,
        description="share of all cells that a robot of OSCARD or random walk covers itself before it stops",
    )
    patience: int = Field(default=2, ge=0, description="OSCARD: steps on end that a robot is trapped before it asks")
    history: int = Field(default=12, gt=0, description="OSCARD: cells that a robot remembers to notice revisits")
    revisits: int = Field(default=3, gt=1, description="OSCARD: occurrences of a cell in the history that make a trap")
    k_forced: int = Field(default=4, gt=1, description="OSCARD: steps that a robot makes by force when nobody answers")
    inquiry_s: float = Field(default=10.24, gt=0, description="length of an inquiry, unless all are found before")
    inquiries: int = Field(default=3, gt=0, description="inquiries that are made while robots are missing")
    page_attempts: int = Field(default=2, gt=0, description="pages of a robot before the team does without it")
    poll_timeout_s: float = Field(default=0.05, gt=0, description="time in which a poll must be answered")
    poll_retries: int = Field(default=8, ge=0, description="empty answers to a poll before a robot counts as missing")
    silence_s: float = Field(
        default=120.0, gt=0, description="time without a frame after which a robot, unless it is the master, gives up"
    )
    acknowledge: bool = Field(default=True, description="the master acknowledges help and trap messages")
    trace_calls: bool = Field(default=False, description="report the calls from room to room")


class Timing(NamedTuple):
    """Durations that the machines keep to, in ns."""

    step: Time
    """A step to the next cell, and the two ticks until it begins and until its end is noticed."""
    retry: Time
    """Between two exchanges while robots are still driving."""
    poll_timeout: Time
    inquiry: Time
    silence: Time


def timing(parameters: Parameters, surroundings: Surroundings) -> Timing:
    """Return the durations: a step from rest to rest takes d/v + v/a, or 2 sqrt(d/a) if v is never reached."""
    distance, speed, acceleration = parameters.cell_m, surroundings.speed_mps, surroundings.acceleration_mps2
    if distance * acceleration >= speed * speed:
        travel_s = distance / speed + speed / acceleration
    else:
        travel_s = 2 * math.sqrt(distance / acceleration)
    tick = surroundings.tick
    return Timing(
        step=-(-from_seconds(travel_s) // tick) * tick + 2 * tick,
        retry=tick,
        poll_timeout=from_seconds(parameters.poll_timeout_s),
        inquiry=from_seconds(parameters.inquiry_s),
        silence=from_seconds(parameters.silence_s),
    )
