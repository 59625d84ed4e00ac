"""The network layer of Bluetooth Mesh (Mesh Profile 1.0, 3.4.4).

A network PDU is

    IVI 1 bit, NID 7 bits | CTL 1 bit, TTL 7 bits | SEQ 24 bits | SRC 16 bits | DST 16 bits | transport PDU | NetMIC

NetMIC has 32 bits, or 64 if CTL tells that this is a control message. On the air all but IVI and NID is encrypted or
obfuscated; here it is not, and NetMIC is 0 and not looked at.
"""

from struct import Struct
from typing import Final, NamedTuple

from cosim.channels.ble.bits.mesh.bearer import MOST_OCTETS
from cosim.errors import WireError

ALL_NODES: Final = 0xFFFF
"""The address of all nodes."""
MOST_TTL: Final = 127
SEQUENCES: Final = 1 << 24
"""Number of sequence numbers."""
_HEADER: Final = Struct(">BB3sHH")
_UNICAST: Final = range(1, 0x8000)
"""Addresses of elements, as all sources are."""


class NetworkPdu(NamedTuple):
    """A network PDU."""

    ttl: int
    sequence: int
    source: int
    destination: int
    transport: bytes
    """The lower transport PDU."""
    control: bool = False
    """CTL: True if it is a control message."""
    nid: int = 0
    """Tells the key that encrypts it."""
    ivi: int = 0
    """Least significant bit of the IV Index."""

    @property
    def mic_octets(self) -> int:
        """Octets of NetMIC."""
        return 8 if self.control else 4


def _fault(pdu: NetworkPdu) -> str | None:
    """Return why *pdu* is none, or None."""
    if pdu.source not in _UNICAST or not 0 < pdu.destination <= ALL_NODES:
        return f"a network PDU from {pdu.source:#06x} to {pdu.destination:#06x}"
    if not 1 <= len(pdu.transport) <= MOST_OCTETS - _HEADER.size - pdu.mic_octets:
        return f"a transport PDU of {len(pdu.transport)} octets"
    return None


def encode_network(pdu: NetworkPdu) -> bytes:
    """Return the octets of *pdu*; raise ValueError for what does not fit."""
    in_bounds = 0 <= pdu.ttl <= MOST_TTL and 0 <= pdu.sequence < SEQUENCES and 0 <= pdu.nid < 128 and pdu.ivi in (0, 1)
    fault = _fault(pdu) if in_bounds else f"a network PDU {pdu}"
    if fault:
        raise ValueError(fault)
    first, second = pdu.ivi << 7 | pdu.nid, pdu.control << 7 | pdu.ttl
    head = _HEADER.pack(first, second, pdu.sequence.to_bytes(3, "big"), pdu.source, pdu.destination)
    return head + pdu.transport + bytes(pdu.mic_octets)


def decode_network(octets: bytes) -> NetworkPdu:
    """Return the network PDU in *octets*; raise WireError, and nothing else, if they are none."""
    if not _HEADER.size <= len(octets) <= MOST_OCTETS:
        raise WireError(f"{len(octets)} octets are no network PDU")
    first, second, sequence, source, destination = _HEADER.unpack_from(octets)
    control = bool(second >> 7)
    transport = octets[_HEADER.size : -8 if control else -4]
    number = int.from_bytes(sequence, "big")
    pdu = NetworkPdu(second & 127, number, source, destination, transport, control, first & 127, first >> 7)
    if fault := _fault(pdu):
        raise WireError(fault)
    return pdu
