"""Parameters of Pseudonet, and the times that follow from them."""

import math
from typing import Literal, NamedTuple

from pydantic import Field

from cosim.errors import UserError
from cosim.protocol import Surroundings
from cosim.settings import LONGEST_S, Count, Length, Seconds, Settings
from cosim.units import Time, from_seconds
from protocols.pseudonet.messages import BROAD
from protocols.pseudonet.topology import MOST_DEVICES, MOST_MASTERS, Topology, piconets_needed
from protocols.transport.links import most_links, most_robots


class TeamParameters(Settings):
    """Parameters of a team on Pseudonet's layers, for any task."""

    topology: Topology = Field(
        default="ring", description="shape of the scatternet of a team that does not fit into one piconet"
    )
    piconet_size: int | None = Field(
        default=None,
        ge=3,
        le=BROAD.robots,
        description="devices in a piconet, the master included; by default the master and all links that its radio can "
        "hold, or 8 if that has no limit; 8 at most if there are several piconets",
    )
    share_slots: Count = Field(
        default=32, ge=4, multiple_of=2, description="slots on end that a bridge spends in each of its piconets"
    )
    cell_m: Length = Field(default=0.5, gt=0, description="side of a cell of the grid, the footprint of a robot")
    step_limit: Count | None = Field(
        default=None,
        gt=0,
        description="steps after which the team ends; by default none for a task that ends by itself, and for OSCARD "
        "and random walk four times the number of cells that each robot would have to cover",
    )
    rounds: Count = Field(
        default=2, ge=0, description="how often a team tries the cells again that it could not enter, before it ends"
    )
    inquiry_s: Seconds = Field(default=10.24, gt=0, description="length of an inquiry, unless all are found before")
    inquiries: Count = Field(
        default=3, gt=0, description="most inquiries that are made, while robots are missing and the last found some"
    )
    page_attempts: Count = Field(default=2, gt=0, description="pages of a robot before the team gives it up")
    page_s: Seconds = Field(default=10.0, gt=0, description="time after which the host gives up a page by itself")
    settle_s: Seconds = Field(
        default=1.0,
        gt=0,
        description="time for all robots to notice that the team is gone, before one looks for them",
    )
    stagger_s: Seconds = Field(
        default=60.0,
        gt=0,
        description="time that a robot waits, for each robot of a lower number, to be found before it looks for "
        "others; and that a robot which was found waits to be called up",
    )
    poll_timeout_s: Seconds = Field(default=0.5, gt=0, description="time in which a poll must be answered")
    poll_retries: Count = Field(default=8, ge=0, description="empty answers to a poll before a robot counts as missing")
    repair_s: Seconds = Field(
        default=0.2, gt=0, description="time without new messages in an exchange after which missed ones are asked for"
    )
    silence_s: Seconds = Field(
        default=30.0, gt=0, description="time without a message, steps not counted, after which a team counts as lost"
    )
    map_bytes: int = Field(
        default=96, gt=0, le=512, description="bytes of coverage map in a message; DM1 packets carry 5"
    )
    acknowledge: bool = Field(
        default=True, description="the master of a single piconet acknowledges help and trap messages"
    )
    trace_calls: bool = Field(default=False, description="report the calls from layer to layer")


class Parameters(TeamParameters):
    """Parameters of Pseudonet and its coverage algorithms."""

    algorithm: Literal["oscard", "random_walk", "boustrophedon", "spanning_tree"] = Field(
        default="boustrophedon", description="how the robots divide the cells and choose the next"
    )
    stop_ratio: float = Field(
        default=1.0,
        gt=0,
        le=1,
        description="share of all cells that a robot of OSCARD or random walk covers itself before it stops",
    )
    departure: bool = Field(
        default=True,
        description="OSCARD and random walk: a robot that stops leaves the team for good, is neither polled nor asked "
        "(paper 003, III.A); else it stays a member that moves no more (V)",
    )
    patience: Count = Field(default=2, ge=0, description="OSCARD: steps on end that a robot is trapped before it asks")
    history: Count = Field(default=12, gt=0, description="OSCARD: cells that a robot remembers to notice revisits")
    revisits: Count = Field(
        default=3, gt=1, description="OSCARD: occurrences of a cell in the history that make a trap"
    )
    k_forced: Count = Field(default=4, gt=1, description="OSCARD: forced steps of a robot when no other answers")


class Timing(NamedTuple):
    """Durations that the machines keep to, in ns."""

    step: Time
    """Time of a step to the next cell, and of the two ticks until it begins and until its end is noticed."""
    retry: Time
    """Interval between two exchanges while robots are still driving."""
    poll_timeout: Time
    repair: Time
    inquiry: Time
    page: Time
    settle: Time
    stagger: Time
    silence: Time


def timing(parameters: TeamParameters, surroundings: Surroundings) -> Timing:
    """Return the durations; a step from rest to rest takes d/v + v/a, or 2 sqrt(d/a) if v is never reached.

    Raise UserError if it takes longer than any run.
    """
    distance, speed, acceleration = parameters.cell_m, surroundings.speed_mps, surroundings.acceleration_mps2
    if distance * acceleration >= speed * speed:
        travel_s = distance / speed + speed / acceleration
    else:
        travel_s = 2 * math.sqrt(distance / acceleration)
    if travel_s > LONGEST_S:
        raise UserError(f"team.body.speed_mps: at {speed:g} m/s a step of {distance:g} m takes {travel_s:g} s")
    tick = surroundings.tick
    step = -(-from_seconds(travel_s) // tick) * tick + 2 * tick
    return Timing(
        step=step,
        retry=tick,
        poll_timeout=from_seconds(parameters.poll_timeout_s),
        repair=from_seconds(parameters.repair_s),
        inquiry=from_seconds(parameters.inquiry_s),
        page=from_seconds(parameters.page_s),
        settle=from_seconds(parameters.settle_s),
        stagger=from_seconds(parameters.stagger_s),
        silence=from_seconds(parameters.silence_s) + 2 * step,
    )


def piconet_size(parameters: TeamParameters, surroundings: Surroundings) -> int:
    """Return how many devices a piconet has at most, the master included.

    Raise UserError for more than the master's radio has links for, and for a team that needs several piconets where
    that cannot be: they are too large or too many, or radios do not divide their time among them.
    """
    setting, size = "protocol.parameters.piconet_size", len(surroundings.starts_m)
    given, links = parameters.piconet_size, most_links(surroundings)
    if given is not None and links is not None and given > links + 1:
        raise UserError(f"{setting}: {given} is not <= {links + 1}, a master and the links that its radio holds")
    largest = given or most_robots(surroundings)
    if size <= largest:
        return largest
    if not all(surroundings.shares[:1]):
        raise UserError(
            f"{setting}: {size} robots need several piconets of {largest}, and radios of this channel do not divide "
            f"their time among them (Share), as topology: {parameters.topology} asks for; expected one piconet of all "
            f"{size} (of ble: channel.connection.links >= {size - 1}), or another channel"
        )
    if given is not None and given > MOST_DEVICES:
        raise UserError(f"{setting}: {given} is not <= {MOST_DEVICES}, as a team of {size} needs several piconets")
    several = min(largest, MOST_DEVICES)
    count = piconets_needed(size, parameters.topology, several)
    if count > MOST_MASTERS:
        raise UserError(
            f"{setting}: {several} makes {count} piconets of {size} robots, expected at most {MOST_MASTERS}"
        )
    return several
