"""The specification of deployments for cosim: the entry point ``deployment`` names ``SPEC``."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from cosim.errors import UserError, WireError
from cosim.machine import Address
from cosim.protocol import Metric, ProtocolSpec, Surroundings
from cosim.units import Time, to_seconds
from protocols.deployment.driving.exploring import EVENTS as EXPLORING_EVENTS
from protocols.deployment.messages import messages, status
from protocols.deployment.operator.page import PAGE
from protocols.deployment.parameters import Parameters
from protocols.deployment.referee import REFEREE_METRICS, DeploymentReferee
from protocols.deployment.runner import MAP_TOPICS, Runner
from protocols.deployment.setup import Setup, setup_of
from protocols.deployment.tasks.events import EVENTS, PlanRefused
from protocols.deployment.tasks.plan import Place
from protocols.localization import positioning
from protocols.mapping import frames
from protocols.motion.floor import Floor
from protocols.transport.decoding import TransportFrame, decode_all
from protocols.transport.frames import Part, Publication
from protocols.transport.links import check_piconet

TEAM_LIMIT: Final = 64  # frames hold addresses in a byte, and the page has been tried with no more
"""Greatest number of robots."""
APART: Final = 3.0
"""Distance of starts about base from each other, centre to centre, in radii."""

METRICS: Final = (
    Metric("plans_ended", "1", "plays that were played to their end, however that was"),
    Metric("plans_done", "1", "plays that were played, and done"),
    Metric("played_s", "s", "when the last of them ended, as it was first announced; NaN if none did"),
    Metric("refused", "1", "plays that were called, and refused"),
    Metric("orders", "1", "orders that executives gave"),
    Metric("orders_failed", "1", "orders that robots could not carry out"),
    Metric("breaches", "1", "temporal constraints that were not kept"),
    Metric("asides", "1", "times that robots stepped aside, ordered or asked"),
    Metric("robots_lost", "1", "times that a host took a robot for lost"),
    Metric("successions", "1", "times that a robot became host in another's place"),
    Metric("letters", "1", "letters that robots have posted"),
    Metric("letter_bytes", "B", "bytes in these letters"),
    Metric("letters_returned", "1", "letters that were given up"),
    Metric("frames", "1", "frames that robots have sent, copies and acknowledgements included"),
    Metric("frame_bytes", "B", "bytes in these frames"),
    Metric("pictures", "1", "pictures that robots have taken"),
    Metric("blocked_ticks", "1", "ticks in which a wall or a body held a robot up"),
    *REFEREE_METRICS,
)


def place(parameters: Parameters, surroundings: Surroundings, size: int, stream: np.random.Generator) -> list[Place]:
    """Place the robots at the floor's ``starts``, or close together about base; raise UserError without room.

    Base is as given, or the floor's place ``base``, or the middle of the floor.
    """
    named = surroundings.places_m.get("starts", ())
    if len(named) >= size:
        return list(named[:size])
    x_min, y_min, x_max, y_max = surroundings.bounds_m
    middle = (x_min + x_max) / 2.0, (y_min + y_max) / 2.0
    base = parameters.base_m or surroundings.places_m.get("base", (middle,))[0]
    floor = Floor.of(surroundings, parameters.driving)
    step_m = APART * surroundings.radius_m
    reach = math.ceil(max(x_max - x_min, y_max - y_min) / step_m)
    offsets = [step_m * k for k in range(-reach, reach + 1)]
    lattice = [(base[0] + dx, base[1] + dy) for dx in offsets for dy in offsets]
    starts: list[Place] = []
    for point in sorted(lattice, key=lambda point: (math.dist(point, base), point)):
        radius_m = surroundings.radius_m
        if floor.free(radius_m, point) and (not starts or floor.length_m(radius_m, point, starts[0]) is not None):
            starts.append(point)
            if len(starts) == size:
                return starts
    raise UserError(f"team.starts: found places for {len(starts)} of {size} robots near {base}; give starts")


def prepare(parameters: Parameters, surroundings: Surroundings) -> Setup:
    """Return the setup of a run; raise UserError for parameters that do not fit the team."""
    if parameters.courier.links is not None:
        check_piconet(surroundings, "protocol.parameters.courier.links")
    positioning.check_positioning(parameters.positioning, surroundings)
    return setup_of(parameters, surroundings)


def make(parameters: Parameters, setup: Setup, me: Address, stream: np.random.Generator, start: Time) -> Runner:
    """Return the machine of robot *me*; only its localisation and the noise of a sonar draw from *stream*."""
    return Runner(parameters, setup, me, start, stream)


def succeed(before: Runner, after: Runner, now: Time) -> None:
    """Hand over to a machine that boots again what its robot's disk has kept: the shift of odometry, and the agenda.

    The counters go on too: they are those of the run, not of the last incarnation.
    """
    after.positioning.resume(before.positioning.shift)
    after.calls.start = before.calls.start
    after.counters.carry(before.counters)
    after.transport.counts.frames += before.transport.counts.frames
    after.transport.counts.octets += before.transport.counts.octets


def referee(parameters: Parameters, setup: Setup, surroundings: Surroundings) -> DeploymentReferee:
    """Return the referee."""
    return DeploymentReferee(parameters.interference, surroundings)


def measure(machines: Sequence[Runner]) -> dict[str, float]:
    """Return the metrics that the machines have counted."""
    counters = [machine.counters for machine in machines]
    announced = [
        end for each in counters for end in each.ended
    ]  # a successor, or a host after a reboot, announces an end again
    ends = {number: (result, at) for number, result, at in sorted(announced, key=lambda end: end[2], reverse=True)}
    return {
        "plans_ended": float(len(ends)),
        "plans_done": float(sum(result == "done" for result, _ in ends.values())),
        "played_s": to_seconds(max(at for _, at in ends.values())) if ends else math.nan,
        "refused": float(sum(each.refused for each in counters)),
        "orders": float(sum(each.ordered for each in counters)),
        "orders_failed": float(sum(each.failed for each in counters)),
        "breaches": float(sum(each.breaches for each in counters)),
        "asides": float(sum(each.asides for each in counters)),
        "robots_lost": float(sum(each.lost for each in counters)),
        "successions": float(sum(each.successions for each in counters)),
        "letters": float(sum(each.letters for each in counters)),
        "letter_bytes": float(sum(each.letter_bytes for each in counters)),
        "letters_returned": float(sum(each.returned for each in counters)),
        "frames": float(sum(each.frames for each in counters)),
        "frame_bytes": float(sum(each.frame_bytes for each in counters)),
        "pictures": float(sum(each.pictures for each in counters)),
        "blocked_ticks": float(sum(each.blocked for each in counters)),
    }


def decode(parameters: Parameters, size: int, data: bytes) -> TransportFrame:
    """Return the frame that *data* is in a team of *size*, with the letter, status or map in it.

    Raise WireError if it is none.
    """

    def content(body: Part | Publication) -> object:
        if isinstance(body, Part):
            return messages.decode(body.payload, size)
        if body.topic in MAP_TOPICS:
            return frames.decode_all(body.payload)
        if body.topic != status.TOPIC:
            raise WireError(f"news of topic {body.topic}")
        return status.decode(body.payload, size)

    return decode_all(data, content)


SPEC = ProtocolSpec(
    name="deployment",
    about="A person calls plays: a planner tailors them, and robots of different kinds take up places in turns.",
    parameters=Parameters,
    place=place,
    prepare=prepare,
    make=make,
    referee=referee,
    metrics=METRICS,
    measure=measure,
    over_time=("places_held", "way_m", "waited_s", "collisions", "wall_contacts", "nearest_m"),
    events=(*EVENTS, *positioning.EVENTS, *EXPLORING_EVENTS),
    decode=decode,
    notices=(PlanRefused,),
    team_limit=TEAM_LIMIT,
    succeed=succeed,
    believes=Runner.believed,
    needs_sight=True,
    needs_view=True,
    rehearsal=lambda machines: machines[0].rehearsal(),
    page=PAGE,
)
"""Specification of the protocol."""
