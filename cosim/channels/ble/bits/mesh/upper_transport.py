"""The upper transport layer of Bluetooth Mesh, and the access layer in it (Mesh Profile 1.0, 3.6.2 and 3.7.3).

An upper transport PDU is an access payload and TransMIC, which has 32 bits, is 0, and is not looked at. The access
payload is an opcode and its parameters: here that of a vendor, 3 octets, who is none, and a payload of a user.
"""

from typing import Final

from cosim.channels.ble.bits.mesh.lower_transport import MOST_SEGMENTS, SEGMENT_OCTETS
from cosim.errors import WireError

OPCODE: Final = bytes.fromhex("c0ffff")
"""The first opcode of a vendor, and the vendor's company identifier."""
_MIC_OCTETS: Final = 4
LONGEST_PAYLOAD: Final = MOST_SEGMENTS * SEGMENT_OCTETS - _MIC_OCTETS - len(OPCODE)
"""Octets of a user's longest payload."""


def encode_upper(payload: bytes) -> bytes:
    """Return the upper transport PDU with a user's *payload*; raise ValueError if that is too long."""
    if len(payload) > LONGEST_PAYLOAD:
        raise ValueError(f"a payload of {len(payload)} octets")
    return OPCODE + payload + bytes(_MIC_OCTETS)


def decode_upper(octets: bytes) -> bytes:
    """Return the user's payload in an upper transport PDU; raise WireError, and nothing else, if there is none."""
    if not octets[:-_MIC_OCTETS].startswith(OPCODE):
        raise WireError(f"{len(octets)} octets without a user's payload")
    return octets[len(OPCODE) : -_MIC_OCTETS]
