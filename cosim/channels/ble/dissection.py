"""What a packet of LE says, in plain words, for who looks at one on the air: as a sniffer takes it apart.

A packet is access address, PDU and CRC. On the access address of advertising it is an advertising PDU, on all others
one of a connection. A payload for one robot is an ATT notification in an L2CAP message, in one packet or in several; a
payload for everyone is advertising data, in pieces, or a message of Bluetooth Mesh, whole or in segments.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice
from struct import Struct
from typing import Any, Final, NamedTuple

from cosim.channels.ble.bits.access import ADVERTISING_ADDRESS
from cosim.channels.ble.bits.control import (
    PHY_1M,
    PHY_2M,
    PHY_CODED,
    ChannelMapInd,
    ConnectionUpdateInd,
    Control,
    Lengths,
    Phys,
    PhyUpdateInd,
    TerminateInd,
    decode_control,
)
from cosim.channels.ble.bits.l2cap import ATTRIBUTES, Message, Reassembly
from cosim.channels.ble.bits.l2cap import HEADER_OCTETS as L2CAP_OCTETS
from cosim.channels.ble.bits.mesh.bearer import MESH_MESSAGE, decode_bearer
from cosim.channels.ble.bits.mesh.lower_transport import MOST_SEGMENTS, Segment, Whole, decode_lower
from cosim.channels.ble.bits.mesh.network import NetworkPdu, decode_network
from cosim.channels.ble.bits.mesh.upper_transport import decode_upper
from cosim.channels.ble.bits.pdu import (
    AdvertisingPdu,
    AdvertisingType,
    AuxPtr,
    ConnectInd,
    DataPdu,
    DeviceAddress,
    Directed,
    Extended,
    LLData,
    Llid,
    Undirected,
    decode_advertising,
    decode_data,
)
from cosim.channels.ble.broadcasts.structures import piece_of
from cosim.channels.ble.connections.arq import Fragment
from cosim.channels.ble.phy import CRC_OCTETS, HEADER_OCTETS
from cosim.channels.ble.session import NOTIFICATION
from cosim.errors import WireError
from cosim.ranges import ranges_of
from cosim.units import MS, US

Fields = dict[str, Any]
"""Fields of a packet by their names, as plain data."""
_ADDRESS_OCTETS: Final = 4
_L2CAP: Final = Struct("<HH")
_LLIDS: Final = {
    Llid.CONTINUATION: "1: goes on with a message",
    Llid.START: "2: begins a message",
    Llid.CONTROL: "3: control",
}
_EMPTY: Final = "1: empty"
_PHYS: Final = {PHY_1M: "1M", PHY_2M: "2M", PHY_CODED: "coded"}
_STRUCTURES: Final = {0x01: "flags", 0x08: "shortened_name", 0x09: "name", 0xFF: "manufacturer_data"}
"""Types of advertising data that have names here."""
_NAMES: Final = frozenset({"name", "shortened_name"})
_FOR_EVERYONE: Final = "ADV_NONCONN_IND"
_MESH_PACKETS: Final = 3 * 8 * MOST_SEGMENTS
"""Packets in which a node sends a message of a mesh at most: channels, times, segments."""


class Dissected(NamedTuple):
    """What a packet says."""

    fields: Fields
    payload: bytes | None
    """The user's payload that it carries; None if it carries none, or only a part of one."""


class Part(NamedTuple):
    """A packet that may carry a part of a payload."""

    packet: bytes
    again: bool
    """True if what it carries has been on the air before."""


PARTS: Final[Mapping[str, frozenset[str]]] = {
    "DATA": frozenset({"DATA"}),
    _FOR_EVERYONE: frozenset({_FOR_EVERYONE}),
    **dict.fromkeys(("AUX_ADV_IND", "AUX_CHAIN_IND"), frozenset({"AUX_ADV_IND", "AUX_CHAIN_IND"})),
}
"""Types of packets that may carry a part of a payload, with the types of those that may carry the others."""


def dissect(kind: str, packet: bytes) -> Dissected:
    """Return what *packet*, of the type *kind* by its sender, says; raise WireError, and nothing else, if it is none.

    Whether the CRC fits is not looked at: where it begins is known to the ends of a connection only.
    """
    if len(packet) < _ADDRESS_OCTETS + HEADER_OCTETS + CRC_OCTETS:
        raise WireError(f"{len(packet)} octets are no packet of LE")
    address, pdu = int.from_bytes(packet[:_ADDRESS_OCTETS], "little"), packet[_ADDRESS_OCTETS:-CRC_OCTETS]
    of_advertising = address == ADVERTISING_ADDRESS
    fields, payload = _advertising(kind, decode_advertising(pdu)) if of_advertising else _of_connection(pdu)
    head: Fields = {"access_address": f"{address:#010x}" + (", of advertising" if of_advertising else "")}
    return Dissected(head | fields | {"crc": packet[-CRC_OCTETS:].hex()}, payload)


def put_together(here: Part, before: Iterable[Part], after: Iterable[Part]) -> bytes | None:
    """Return the user's payload of which *here* carries a part; None if not all of it is there.

    *before* and *after* are what the same sender has sent to the same receiver, both from *here* on.
    """
    of_advertising = here.packet[:_ADDRESS_OCTETS] == ADVERTISING_ADDRESS.to_bytes(_ADDRESS_OCTETS, "little")
    try:
        if not of_advertising:
            return _continued(here, before, after)
        flooded = isinstance(decode_advertising(_pdu(here)), Undirected)
        return (_flooded if flooded else _chained)(here, before, after)
    except WireError:
        return None


def _pdu(part: Part) -> bytes:
    return part.packet[_ADDRESS_OCTETS:-CRC_OCTETS]


# ---------------------------------------------------------------- advertising


def _advertising(kind: str, pdu: AdvertisingPdu) -> tuple[Fields, bytes | None]:
    match pdu:
        case Undirected(of_type, advertiser, data):
            fields = {"pdu": of_type.name, "advertiser": _device(advertiser)}
            fields |= {"channel_selection": _algorithm(pdu.algorithm_2)} if of_type is AdvertisingType.ADV_IND else {}
            if kind == _FOR_EVERYONE and data[1:2] == bytes([MESH_MESSAGE]):
                mesh, payload = _mesh(decode_network(decode_bearer(data)))
                return fields | {"mesh": mesh}, payload
            return fields | _structures(data), piece_of(data) if kind == _FOR_EVERYONE else None
        case Directed(of_type, sender, target):
            return {"pdu": of_type.name, "sender": _device(sender), "target": _device(target)}, None
        case ConnectInd(initiator, advertiser, ll_data, algorithm_2):
            ends = {"initiator": _device(initiator), "advertiser": _device(advertiser)}
            fields = {"pdu": "CONNECT_IND", **ends, "channel_selection": _algorithm(algorithm_2)}
            return fields | {"connection": _ll_data(ll_data)}, None
        case Extended():
            return _extended(kind, pdu)


def _extended(kind: str, pdu: Extended) -> tuple[Fields, bytes | None]:
    """Return what an ADV_EXT_IND, AUX_ADV_IND or AUX_CHAIN_IND says, which the PDU itself does not tell apart."""
    fields: Fields = {"pdu": kind, "mode": pdu.mode.name.lower()}
    for name, address in (("advertiser", pdu.advertiser), ("target", pdu.target)):
        fields |= {} if address is None else {name: _device(address)}
    if pdu.data_info is not None:
        fields |= {"advertising_set": pdu.data_info.set_id, "data_id": pdu.data_info.data_id}
    if pdu.aux is not None:
        fields |= {"continues": _aux(pdu.aux)}
    if not pdu.data:
        return fields, None
    fields |= {"data_octets": len(pdu.data)}
    whole = kind == "AUX_ADV_IND" and pdu.aux is None
    return fields, piece_of(pdu.data) if whole else None


def _chained(here: Part, before: Iterable[Part], after: Iterable[Part]) -> bytes | None:
    """Return the payload of the chain in which *here* is: from the PDU with an advertiser to that without a pointer."""
    chain = [_extended_pdu(here)]
    for part in before:
        if chain[0].advertiser is not None:
            break
        chain.insert(0, _extended_pdu(part))
    for part in after:
        if chain[-1].aux is None:
            break
        chain.append(_extended_pdu(part))
    first, *others = chain
    whole = first.advertiser is not None and chain[-1].aux is None
    alike = all(each.advertiser is None and each.data_info == first.data_info for each in others)
    pieces = [piece_of(pdu.data) for pdu in chain]
    return b"".join(piece or b"" for piece in pieces) if whole and alike and None not in pieces else None


def _extended_pdu(part: Part) -> Extended:
    pdu = decode_advertising(_pdu(part))
    if not isinstance(pdu, Extended):
        raise WireError("no PDU of extended advertising")
    return pdu


def _aux(aux: AuxPtr) -> Fields:
    return {"channel_index": aux.channel, "after_us": aux.offset / US, "phy": aux.phy.name}


def _mesh(pdu: NetworkPdu) -> tuple[Fields, bytes | None]:
    """Return what a network *pdu* of a mesh says, and the user's payload, if that is all in it."""
    fields: Fields = {"ivi": pdu.ivi, "nid": pdu.nid, "ttl": pdu.ttl, "sequence": pdu.sequence}
    fields |= {"source": f"{pdu.source:#06x}", "destination": f"{pdu.destination:#06x}"}
    if pdu.control:
        return fields | {"control": pdu.transport.hex()}, None
    part = decode_lower(pdu.transport)
    fields |= {"application_key": part.key}
    if isinstance(part, Whole):
        return fields, decode_upper(part.upper)
    return fields | {"seq_zero": part.seq_zero, "segment": part.number, "last_segment": part.last}, None


def _flooded(here: Part, before: Iterable[Part], after: Iterable[Part]) -> bytes | None:
    """Return the payload of the message of a mesh of which *here* has a segment."""
    pdu, segment = _segment(here)
    segments: dict[int, bytes] = {}
    for part in (here, *islice(before, _MESH_PACKETS), *islice(after, _MESH_PACKETS)):
        try:
            other, another = _segment(part)
        except WireError:
            continue  # of another message, that is whole
        near = abs(other.sequence - pdu.sequence) < MOST_SEGMENTS
        if near and other.source == pdu.source and another.seq_zero == segment.seq_zero:
            segments[another.number] = another.data
        if len(segments) > segment.last:
            return decode_upper(b"".join(segments[at] for at in sorted(segments)))
    return None


def _segment(part: Part) -> tuple[NetworkPdu, Segment]:
    """Return the network PDU, and the segment in it, that a packet carries; raise WireError if there is none."""
    advertisement = decode_advertising(_pdu(part))
    data = advertisement.data if isinstance(advertisement, Undirected) else b""
    pdu = decode_network(decode_bearer(data))
    segment = decode_lower(pdu.transport)
    if pdu.control or not isinstance(segment, Segment):
        raise WireError("no segment of a message")
    return pdu, segment


def _structures(data: bytes) -> Fields:
    """Return the structures of advertising *data*: each is a length, a type, and what it says."""
    fields: Fields = {}
    while len(data) > 1 and data[0]:
        of_type, content, data = data[1], data[2 : 1 + data[0]], data[1 + data[0] :]
        name = _STRUCTURES.get(of_type, f"structure_{of_type:#04x}")
        fields[name] = content.decode(errors="replace") if name in _NAMES else content.hex()
    return fields


def _ll_data(ll_data: LLData) -> Fields:
    return {
        "access_address": f"{ll_data.access_address:#010x}",
        "crc_init": f"{ll_data.crc_init:#08x}",
        "window_size_ms": ll_data.window_size / MS,
        "window_offset_ms": ll_data.window_offset / MS,
        "interval_ms": ll_data.interval / MS,
        "latency_events": ll_data.latency,
        "supervision_timeout_ms": ll_data.timeout / MS,
        "channels": ranges_of(ll_data.channel_map.used),
        "hop": ll_data.hop,
        "clock_accuracy": ll_data.sca,
    }


def _device(address: DeviceAddress) -> str:
    octets = address.value.to_bytes(6, "big").hex(":")
    return f"{octets}, {'random' if address.random else 'public'}"


def _algorithm(second: bool) -> str:
    return f"algorithm #{1 + second}"


# ---------------------------------------------------------------- connections


def _of_connection(octets: bytes) -> tuple[Fields, bytes | None]:
    pdu = decode_data(octets)
    empty = pdu.llid is Llid.CONTINUATION and not pdu.payload
    fields: Fields = {"llid": _EMPTY if empty else _LLIDS[pdu.llid]}
    fields |= {"sn": pdu.sn, "nesn": pdu.nesn, "more_data": pdu.more, "octets": len(pdu.payload)}
    if pdu.llid is Llid.CONTROL:
        return fields | _control(decode_control(pdu.payload), pdu.payload[0]), None
    if pdu.llid is not Llid.START:
        return fields, None
    if len(pdu.payload) >= L2CAP_OCTETS:
        length, channel = _L2CAP.unpack_from(pdu.payload)
        fields |= {"l2cap_length": length, "l2cap_channel": channel}
    return fields, _alone(pdu)


def _alone(pdu: DataPdu) -> bytes | None:
    """Return the user's payload of the message that *pdu* begins, if it is all of it."""
    message = Reassembly().take(Fragment(pdu.llid, pdu.payload))
    return None if message is None else _notified(message)


def _continued(here: Part, before: Iterable[Part], after: Iterable[Part]) -> bytes | None:
    """Return the payload of the message in which *here* is, from the PDU that begins it on."""
    link = here.packet[:_ADDRESS_OCTETS]
    pdus = [] if here.again else [decode_data(_pdu(here))]
    for part in _new(before, link):
        if pdus and pdus[0].llid is Llid.START:
            break
        pdus.insert(0, decode_data(_pdu(part)))
    reassembly, message = Reassembly(), None
    for pdu in pdus:  # if it is over before the last, that is refused: it continues nothing
        message = reassembly.take(Fragment(pdu.llid, pdu.payload))
    for part in _new(after, link):
        if message is not None:
            break
        pdu = decode_data(_pdu(part))
        message = reassembly.take(Fragment(pdu.llid, pdu.payload))
    return None if message is None else _notified(message)


def _new(parts: Iterable[Part], link: bytes) -> Iterator[Part]:
    """Yield those of the link of that access address that are no copies."""
    return (part for part in parts if part.packet[:_ADDRESS_OCTETS] == link and not part.again)


def _notified(message: Message) -> bytes | None:
    of_user = message.channel == ATTRIBUTES and message.information.startswith(NOTIFICATION)
    return message.information[len(NOTIFICATION) :] if of_user else None


def _control(pdu: Control, opcode: int) -> Fields:
    name, values = _CONTROLS[type(pdu)](pdu)
    return {"control": f"{opcode:#04x}: {name}"} | values


def _connection_update(pdu: ConnectionUpdateInd) -> tuple[str, Fields]:
    window, parameters, instant = pdu
    times = {"window_size_ms": window.size / MS, "window_offset_ms": window.offset / MS}
    times |= {"interval_ms": parameters.interval / MS, "supervision_timeout_ms": parameters.timeout / MS}
    return "LL_CONNECTION_UPDATE_IND", times | {"latency_events": parameters.latency, "instant": instant}


def _lengths(pdu: Lengths) -> tuple[str, Fields]:
    octets = {"rx_octets": pdu.rx_octets, "rx_us": pdu.rx_time / US, "tx_octets": pdu.tx_octets}
    return f"LL_LENGTH_{_asked(pdu.response)}", octets | {"tx_us": pdu.tx_time / US}


def _phys(pdu: Phys) -> tuple[str, Fields]:
    return f"LL_PHY_{_asked(pdu.response)}", {"tx_phys": _phy_names(pdu.tx), "rx_phys": _phy_names(pdu.rx)}


def _phy_update(pdu: PhyUpdateInd) -> tuple[str, Fields]:
    down, up = (_phy_names(each) or "as it is" for each in pdu[:2])
    return "LL_PHY_UPDATE_IND", {"central_to_peripheral": down, "peripheral_to_central": up, "instant": pdu.instant}


_CONTROLS: Final[dict[type[Any], Callable[[Any], tuple[str, Fields]]]] = {
    ConnectionUpdateInd: _connection_update,
    ChannelMapInd: lambda pdu: (
        "LL_CHANNEL_MAP_IND",
        {"channels": ranges_of(pdu.used.used), "instant": pdu.instant},
    ),
    TerminateInd: lambda pdu: ("LL_TERMINATE_IND", {"error": f"{pdu.error:#04x}"}),
    Lengths: _lengths,
    Phys: _phys,
    PhyUpdateInd: _phy_update,
}


def _asked(response: bool) -> str:
    return "RSP" if response else "REQ"


def _phy_names(bits: int) -> str:
    return ", ".join(name for bit, name in _PHYS.items() if bits & bit)
