"""What cosim must know of agents."""

from typing import Any

from cosim.arrays import Floats
from cosim.errors import WireError
from cosim.machine import Address
from cosim.protocol import ProtocolSpec, Referee, Surroundings, anywhere
from cosim.units import Time
from protocols.agents.machine import TOPIC, AgentMachine, Parameters
from protocols.transport.decoding import TransportFrame, decode_all
from protocols.transport.frames import Part, Publication
from protocols.transport.links import check_piconet
from protocols.wire import BadBytes


class Bystander(Referee):
    """A referee that lets every run go on until its time is over."""

    def look(self, x_m: Floats, y_m: Floats, now: Time) -> bool:
        """Let the run go on."""
        return False

    def verdict(self, now: Time) -> dict[str, float]:
        """Judge nothing."""
        return {}


def prepare(parameters: Parameters, surroundings: Surroundings) -> int:
    """Return the team's size, all that robots know beforehand; raise UserError for more than a piconet can have."""
    if parameters.transport.links is not None:
        check_piconet(surroundings, "protocol.parameters.transport.links")
    return len(surroundings.starts_m)


def make(parameters: Parameters, size: int, me: Address, stream: Any, start: Time) -> AgentMachine:
    """Return the machine of robot *me*, which draws nothing."""
    return AgentMachine(parameters, size, me, start)


def decode(parameters: Parameters, size: int, data: bytes) -> TransportFrame:
    """Return the frame that *data* is, with the message in it; raise WireError if it is none."""

    def message(body: Part | Publication) -> dict[str, str]:
        octets = parameters.message_octets
        if not isinstance(body, Publication) or body.topic != TOPIC or len(body.payload) != octets:
            raise WireError(f"agents publish {octets} bytes of topic {TOPIC}")
        return {"message": body.payload.hex()}

    return decode_all(data, message)


SPEC = ProtocolSpec(
    name="agents",
    about="Robots do what a policy outside orders at every step: cosim.env makes an environment of them.",
    parameters=Parameters,
    place=anywhere,
    prepare=prepare,
    make=make,
    referee=lambda parameters, size, surroundings: Bystander(),
    metrics=(),
    measure=lambda machines: {},
    events=(BadBytes,),
    decode=decode,
    needs_view=True,
)
