"""Network PDUs of Bluetooth Mesh as advertising data: each is a structure of its own (Mesh Profile 1.0, 3.3.1)."""

from typing import Final

from cosim.errors import WireError

MESH_MESSAGE: Final = 0x2A
"""Type of the structure."""
MOST_OCTETS: Final = 29
"""Octets of the longest network PDU."""


def encode_bearer(pdu: bytes) -> bytes:
    """Return a network *pdu* as advertising data; raise ValueError if it is too long."""
    if len(pdu) > MOST_OCTETS:
        raise ValueError(f"a network PDU of {len(pdu)} octets")
    return bytes([1 + len(pdu), MESH_MESSAGE]) + pdu


def decode_bearer(data: bytes) -> bytes:
    """Return the network PDU that advertising *data* are; raise WireError, and nothing else, if they are none."""
    if not 2 <= len(data) <= 2 + MOST_OCTETS or data[0] != len(data) - 1 or data[1] != MESH_MESSAGE:
        raise WireError(f"{len(data)} octets are no mesh message")
    return data[2:]
