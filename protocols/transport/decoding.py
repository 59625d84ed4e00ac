"""What a frame of a transport says, with what it carries: for who looks at a run."""

import struct
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

from cosim.errors import WireError
from cosim.machine import Address
from protocols.transport.frames import Ack, Part, Publication, decode
from protocols.transport.transport import BEAT

Decoder: TypeAlias = Callable[[Part | Publication], Any]
"""(a publication, or a part that is a whole message) -> what its payload says; WireError or struct.error if nothing."""


class TransportFrame(NamedTuple):
    """A frame, decoded to the bottom."""

    author: Address
    destination: Address
    """``frames.ALL`` for publications."""
    incarnation: int
    body: Ack | Part | Publication
    """The frame's body; a payload of other than whole messages stays as it is."""
    content: Any
    """What its payload says; a sentence if that is not for the author's protocol, or nothing."""


def decode_all(data: bytes, content: Decoder) -> TransportFrame:
    """Return the frame that *data* is, what it carries decoded by *content*; raise WireError if it is no frame."""
    frame = decode(data)
    return TransportFrame(*frame, _content(frame.body, content))


def _content(body: Ack | Part | Publication, content: Decoder) -> Any:
    match body:
        case Ack():
            return None
        case Publication(topic=topic, payload=payload) if topic == BEAT:
            return {"heartbeat": "of the transport", "without_master": list(payload)}
        case Part(place=place, parts=parts) if parts > 1:
            return f"part {place + 1} of the {parts} of a message"
    try:
        return content(body)
    except (WireError, struct.error) as error:
        return f"no message: {error}"
