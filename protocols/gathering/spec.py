"""The protocol gathering as cosim needs it: the entry point ``gathering`` names ``SPEC``.

All layers but the coordination layer are Pseudonet's: the packets, the exchanges, the set-up and its repair.
"""

from typing import Final

import numpy as np

from cosim.machine import Address
from cosim.protocol import Metric, ProtocolSpec, Surroundings
from cosim.units import Time
from protocols.gathering.gathering import GatheringCoordination
from protocols.gathering.referee import GatheringReferee
from protocols.pseudonet import spec as pseudonet
from protocols.pseudonet.events import EVENTS
from protocols.pseudonet.machine import Pseudonet
from protocols.pseudonet.parameters import TeamParameters
from protocols.pseudonet.setup import Setup

OF_COVERAGE: Final = {"coverage", "time_to_cover_s", "overlap_ratio"}
"""Metrics of Pseudonet without a meaning for a team that gathers."""

METRICS: Final = (
    Metric("gathered", "1", "share of the living robots that stand together at the end, each beside another"),
    Metric("time_to_gather_s", "s", "since when all of them do; NaN if they do not"),
    Metric("spread_m", "m", "distance of the living robots from their common centre at the end, root mean square"),
    *(metric for metric in pseudonet.METRICS if metric.name not in OF_COVERAGE),
)


class Parameters(TeamParameters):
    """Parameters of gathering, in which a team comes together round its most central robot."""


def make(parameters: Parameters, setup: Setup, me: Address, stream: np.random.Generator, start: Time) -> Pseudonet:
    """Return the machine of robot *me*: Pseudonet's, with another coordination layer."""
    coordination = GatheringCoordination(setup, me, parameters.rounds)
    return Pseudonet(parameters, setup, me, coordination, parameters.step_limit, start)


def referee(parameters: Parameters, setup: Setup, surroundings: Surroundings) -> GatheringReferee:
    """Return the judge of gathering."""
    return GatheringReferee(setup)


SPEC = ProtocolSpec(
    name="gathering",
    about="A team comes together round its most central robot, step by step, by Pseudonet's messages.",
    parameters=Parameters,
    place=pseudonet.place,
    prepare=pseudonet.prepare,
    make=make,
    referee=referee,
    metrics=METRICS,
    measure=pseudonet.measure,
    events=EVENTS,
    team_limit=pseudonet.TEAM_LIMIT,
)
