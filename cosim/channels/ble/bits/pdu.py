"""PDUs of the advertising and data channels as octets (Core v5.0, Vol 6 Part B, sections 2.3 and 2.4).

A PDU is a header of two octets, the second of which is the length of the payload, and the payload. Numbers go least
significant octet first. Bits that are reserved for future use are sent as 0 and not looked at in what comes; reserved
values, and lengths that contradict each other, raise WireError.

Extended advertising has one layout for all its PDUs: an extended header, whose flags tell which fields it has, and
data. Which of ADV_EXT_IND, AUX_ADV_IND, AUX_SCAN_RSP, AUX_SYNC_IND and AUX_CHAIN_IND it is, follows from when and where
it is heard. AUX_SCAN_REQ and AUX_CONNECT_REQ are a SCAN_REQ and a CONNECT_IND on a general-purpose channel.
"""

from enum import IntEnum
from struct import Struct
from typing import Final, NamedTuple, TypeAlias

from cosim.channels.ble.channels import DATA_CHANNELS
from cosim.channels.ble.connections.channel_map import ChannelMap, decode_channel_map
from cosim.channels.ble.connections.parameters import INTERVAL_UNIT, TIMEOUT_UNIT, ConnectionParameters, TransmitWindow
from cosim.channels.ble.phy import HEADER_OCTETS, MAX_PAYLOAD
from cosim.channels.ble.selection import HOP_INCREMENTS
from cosim.errors import UserError, WireError
from cosim.units import US, Time

MAX_ADVERTISING_DATA: Final = 31
"""Octets of data in a PDU of legacy advertising."""
CLOCK_ACCURACIES_PPM: Final = (500, 250, 150, 100, 75, 50, 30, 20)
"""Largest error of a sleep clock, by its code SCA."""
OFFSET_UNITS: Final[tuple[Time, Time]] = (30 * US, 300 * US)
"""Units of the offset to a packet, by the bit that tells the unit."""

_ADDRESS_OCTETS: Final = 6
_OFFSET_BITS: Final = 13
_LL_DATA: Final = Struct("<I3sBHHHH5sB")
_SYNC_INFO: Final = Struct("<HH5sI3sH")


class AdvertisingType(IntEnum):
    """PDU type of an advertising header."""

    ADV_IND = 0
    ADV_DIRECT_IND = 1
    ADV_NONCONN_IND = 2
    SCAN_REQ = 3
    SCAN_RSP = 4
    CONNECT_IND = 5
    ADV_SCAN_IND = 6
    EXTENDED = 7
    """ADV_EXT_IND and all auxiliary PDUs but requests and AUX_CONNECT_RSP."""
    AUX_CONNECT_RSP = 8


class AdvertisingMode(IntEnum):
    """AdvMode of an extended header: what may be sent to the advertiser."""

    NONE = 0
    CONNECTABLE = 1
    SCANNABLE = 2


class AuxiliaryPhy(IntEnum):
    """PHY of an auxiliary packet."""

    LE_1M = 0
    LE_2M = 1
    CODED = 2


class Llid(IntEnum):
    """What the payload of a data PDU is."""

    CONTINUATION = 1
    """A further fragment of an L2CAP message, or nothing."""
    START = 2
    """The first, or only, fragment of an L2CAP message."""
    CONTROL = 3


class DeviceAddress(NamedTuple):
    """The address of a device, 48 bits."""

    value: int
    random: bool = False
    """True if it is a random address, not a public one (TxAdd, RxAdd)."""


class Undirected(NamedTuple):
    """An ADV_IND, ADV_NONCONN_IND, ADV_SCAN_IND or SCAN_RSP."""

    type: AdvertisingType
    advertiser: DeviceAddress
    data: bytes = b""
    """At most 31 octets."""
    algorithm_2: bool = False
    """ChSel: True if an ADV_IND supports channel selection algorithm #2; in the others it means nothing."""


class Directed(NamedTuple):
    """An ADV_DIRECT_IND, from advertiser to initiator, or a SCAN_REQ, from scanner to advertiser."""

    type: AdvertisingType
    sender: DeviceAddress
    target: DeviceAddress
    algorithm_2: bool = False
    """ChSel, as in an ADV_IND; in a SCAN_REQ it means nothing."""


class LLData(NamedTuple):
    """The parameters of a connection that a CONNECT_IND proposes; times in ns."""

    access_address: int
    crc_init: int
    window_size: Time
    window_offset: Time
    interval: Time
    latency: int
    """Events in a row that a peripheral with nothing to send may sleep through."""
    timeout: Time
    """Supervision timeout."""
    channel_map: ChannelMap
    hop: int
    """hopIncrement."""
    sca: int
    """Code of the central's sleep clock accuracy, 0 to 7."""


class ConnectInd(NamedTuple):
    """A CONNECT_IND."""

    initiator: DeviceAddress
    advertiser: DeviceAddress
    ll_data: LLData
    algorithm_2: bool = False
    """ChSel."""


class DataInfo(NamedTuple):
    """AdvDataInfo (ADI)."""

    data_id: int
    """12 bits, another one whenever the data of the set change."""
    set_id: int
    """4 bits, of the advertising set."""


class AuxPtr(NamedTuple):
    """Where and when the auxiliary packet is."""

    channel: int
    """Channel index, 0 to 36."""
    offset: Time
    """Time from the start of this packet to the earliest start of the other, which is within one unit after that."""
    phy: AuxiliaryPhy
    accurate: bool = False
    """True if the advertiser's clock is within 50 ppm, not 500."""


class SyncInfo(NamedTuple):
    """Where, when and how the packets of a periodic train are."""

    offset: Time
    """Time from the start of this packet to the next AUX_SYNC_IND; 0 if it cannot be told."""
    interval: Time
    channel_map: ChannelMap
    sca: int
    access_address: int
    crc_init: int
    event: int
    """Counter of the event to which *offset* points."""


class Extended(NamedTuple):
    """A PDU of extended advertising; what is None is not in it."""

    mode: AdvertisingMode = AdvertisingMode.NONE
    advertiser: DeviceAddress | None = None
    target: DeviceAddress | None = None
    cte_info: int | None = None
    data_info: DataInfo | None = None
    aux: AuxPtr | None = None
    sync: SyncInfo | None = None
    tx_power_dbm: int | None = None
    additional: bytes = b""
    """Additional controller advertising data (ACAD), at the end of the extended header."""
    data: bytes = b""
    type: AdvertisingType = AdvertisingType.EXTENDED
    """EXTENDED or AUX_CONNECT_RSP."""


class DataPdu(NamedTuple):
    """A PDU of a connection."""

    llid: Llid
    nesn: int = 0
    sn: int = 0
    more: bool = False
    """MD: True if the sender has more data for this event."""
    payload: bytes = b""


AdvertisingPdu: TypeAlias = Undirected | Directed | ConnectInd | Extended

_UNDIRECTED: Final = {
    AdvertisingType.ADV_IND,
    AdvertisingType.ADV_NONCONN_IND,
    AdvertisingType.SCAN_RSP,
    AdvertisingType.ADV_SCAN_IND,
}
_DIRECTED: Final = {AdvertisingType.ADV_DIRECT_IND, AdvertisingType.SCAN_REQ}
_EXTENDED: Final = {AdvertisingType.EXTENDED, AdvertisingType.AUX_CONNECT_RSP}
_TELL_ALGORITHM: Final = {AdvertisingType.ADV_IND, AdvertisingType.ADV_DIRECT_IND, AdvertisingType.CONNECT_IND}


# ---------------------------------------------------------------- fields


def _in_bits(value: int, bits: int, what: str) -> int:
    if not 0 <= value < 1 << bits:
        raise ValueError(f"{what} {value:#x} has not {bits} bits")
    return value


def _in_units(time: Time, unit: Time, bits: int, what: str) -> int:
    if time % unit:
        raise ValueError(f"{what} of {time} ns is not a multiple of {unit}")
    return _in_bits(time // unit, bits, what)


def _encode_address(address: DeviceAddress) -> bytes:
    return _in_bits(address.value, 8 * _ADDRESS_OCTETS, "device address").to_bytes(_ADDRESS_OCTETS, "little")


def _decode_address(octets: bytes, random: int) -> DeviceAddress:
    return DeviceAddress(int.from_bytes(octets, "little"), bool(random))


def _encode_crc_init(crc_init: int) -> bytes:
    return _in_bits(crc_init, 24, "CRCInit").to_bytes(3, "little")


def _encode_offset(offset: Time, what: str) -> int:
    """Return 13 bits of *offset* and the bit of its unit, the shorter one where it can tell the offset."""
    long = offset % OFFSET_UNITS[0] != 0 or offset >= OFFSET_UNITS[0] << _OFFSET_BITS
    return _in_units(offset, OFFSET_UNITS[long], _OFFSET_BITS, what) | long << _OFFSET_BITS


# ---------------------------------------------------------------- LLData


def _ll_data_fault(ll_data: LLData) -> str | None:
    """Return why there is no connection with *ll_data*, or None."""
    try:
        ConnectionParameters(ll_data.interval, ll_data.latency, ll_data.timeout)
        TransmitWindow(ll_data.window_size, ll_data.window_offset).check(ll_data.interval)
    except UserError as error:
        return str(error)
    if ll_data.hop not in HOP_INCREMENTS:
        return f"a hop increment of {ll_data.hop}"
    return None


def encode_ll_data(ll_data: LLData) -> bytes:
    """Return the 22 octets of *ll_data*; raise ValueError if no connection can have them."""
    if fault := _ll_data_fault(ll_data):
        raise ValueError(fault)
    return _LL_DATA.pack(
        _in_bits(ll_data.access_address, 32, "access address"),
        _encode_crc_init(ll_data.crc_init),
        _in_units(ll_data.window_size, INTERVAL_UNIT, 8, "transmit window"),
        _in_units(ll_data.window_offset, INTERVAL_UNIT, 16, "transmit window offset"),
        _in_units(ll_data.interval, INTERVAL_UNIT, 16, "connection interval"),
        ll_data.latency,
        _in_units(ll_data.timeout, TIMEOUT_UNIT, 16, "supervision timeout"),
        ll_data.channel_map.encode(),
        ll_data.hop | _in_bits(ll_data.sca, 3, "SCA") << 5,
    )


def decode_ll_data(octets: bytes) -> LLData:
    """Return the parameters in *octets*; raise WireError if no connection can have them."""
    if len(octets) != _LL_DATA.size:
        raise WireError(f"LLData of {len(octets)} octets")
    address, crc_init, size, offset, interval, latency, timeout, channels, last = _LL_DATA.unpack(octets)
    ll_data = LLData(
        access_address=address,
        crc_init=int.from_bytes(crc_init, "little"),
        window_size=size * INTERVAL_UNIT,
        window_offset=offset * INTERVAL_UNIT,
        interval=interval * INTERVAL_UNIT,
        latency=latency,
        timeout=timeout * TIMEOUT_UNIT,
        channel_map=decode_channel_map(channels),
        hop=last & 31,
        sca=last >> 5,
    )
    if fault := _ll_data_fault(ll_data):
        raise WireError(fault)
    return ll_data


# ---------------------------------------------------------------- the extended header


def _encode_aux(aux: AuxPtr) -> bytes:
    if not 0 <= aux.channel < DATA_CHANNELS:
        raise ValueError(f"an auxiliary packet on channel {aux.channel}")
    offset = _encode_offset(aux.offset, "auxiliary offset")
    first = aux.channel | aux.accurate << 6 | offset >> _OFFSET_BITS << 7
    return (first | (offset & (1 << _OFFSET_BITS) - 1) << 8 | aux.phy << 21).to_bytes(3, "little")


def _decode_aux(octets: bytes) -> AuxPtr:
    word = int.from_bytes(octets, "little")
    channel, phy = word & 63, word >> 21
    if channel >= DATA_CHANNELS or phy not in set(AuxiliaryPhy):
        raise WireError(f"an auxiliary packet on channel {channel}, PHY {phy}")
    offset = (word >> 8 & (1 << _OFFSET_BITS) - 1) * OFFSET_UNITS[word >> 7 & 1]
    return AuxPtr(channel, offset, AuxiliaryPhy(phy), bool(word >> 6 & 1))


def _encode_sync(sync: SyncInfo) -> bytes:
    if sync.interval < 6 * INTERVAL_UNIT:
        raise ValueError(f"a periodic interval of {sync.interval} ns")
    channels = bytearray(sync.channel_map.encode())
    channels[-1] |= _in_bits(sync.sca, 3, "SCA") << 5
    return _SYNC_INFO.pack(
        _encode_offset(sync.offset, "offset of a train"),
        _in_units(sync.interval, INTERVAL_UNIT, 16, "periodic interval"),
        bytes(channels),
        _in_bits(sync.access_address, 32, "access address"),
        _encode_crc_init(sync.crc_init),
        _in_bits(sync.event, 16, "event counter"),
    )


def _decode_sync(octets: bytes) -> SyncInfo:
    offset, interval, channels, address, crc_init, event = _SYNC_INFO.unpack(octets)
    if interval < 6:
        raise WireError(f"a periodic interval of {interval * INTERVAL_UNIT} ns")
    return SyncInfo(
        offset=(offset & (1 << _OFFSET_BITS) - 1) * OFFSET_UNITS[offset >> _OFFSET_BITS & 1],
        interval=interval * INTERVAL_UNIT,
        channel_map=decode_channel_map(channels),
        sca=channels[-1] >> 5,
        access_address=address,
        crc_init=int.from_bytes(crc_init, "little"),
        event=event,
    )


def _encode_extended(pdu: Extended) -> bytes:
    """Return the payload of *pdu*."""
    fields = (  # in the order of their flags, and of their octets
        b"" if pdu.advertiser is None else _encode_address(pdu.advertiser),
        b"" if pdu.target is None else _encode_address(pdu.target),
        b"" if pdu.cte_info is None else _in_bits(pdu.cte_info, 8, "CTEInfo").to_bytes(1, "little"),
        b"" if pdu.data_info is None else _encode_data_info(pdu.data_info),
        b"" if pdu.aux is None else _encode_aux(pdu.aux),
        b"" if pdu.sync is None else _encode_sync(pdu.sync),
        b"" if pdu.tx_power_dbm is None else _encode_power(pdu.tx_power_dbm),
    )
    header = b"".join(fields) + pdu.additional
    if header:
        header = bytes([sum(1 << flag for flag, field in enumerate(fields) if field)]) + header
    return bytes([_in_bits(len(header), 6, "length of the extended header") | pdu.mode << 6]) + header + pdu.data


def _encode_data_info(info: DataInfo) -> bytes:
    return (_in_bits(info.data_id, 12, "DID") | _in_bits(info.set_id, 4, "SID") << 12).to_bytes(2, "little")


def _encode_power(power_dbm: int) -> bytes:
    if not -128 <= power_dbm <= 127:
        raise ValueError(f"a transmit power of {power_dbm} dBm")
    return power_dbm.to_bytes(1, "little", signed=True)


def _decode_extended(kind: AdvertisingType, tx_random: int, rx_random: int, payload: bytes) -> Extended:
    if not payload or 1 + (payload[0] & 63) > len(payload):
        raise WireError("an extended header that is cut off")
    length, mode = payload[0] & 63, payload[0] >> 6
    if mode not in set(AdvertisingMode):
        raise WireError(f"AdvMode {mode} is reserved")
    header, data = payload[1 : 1 + length], payload[1 + length :]
    flags, at = header[0] if header else 0, 1

    def field(flag: int, size: int) -> bytes | None:
        nonlocal at
        if not flags >> flag & 1:
            return None
        if at + size > length:
            raise WireError(f"an extended header of {length} octets with the flags {flags:#04x}")
        at += size
        return header[at - size : at]

    advertiser, target = field(0, _ADDRESS_OCTETS), field(1, _ADDRESS_OCTETS)
    cte_info, info, aux = field(2, 1), field(3, 2), field(4, 3)
    sync, power = field(5, _SYNC_INFO.size), field(6, 1)
    return Extended(
        mode=AdvertisingMode(mode),
        advertiser=None if advertiser is None else _decode_address(advertiser, tx_random),
        target=None if target is None else _decode_address(target, rx_random),
        cte_info=None if cte_info is None else cte_info[0],
        data_info=None if info is None else DataInfo(info[0] | (info[1] & 15) << 8, info[1] >> 4),
        aux=None if aux is None else _decode_aux(aux),
        sync=None if sync is None else _decode_sync(sync),
        tx_power_dbm=None if power is None else int.from_bytes(power, "little", signed=True),
        additional=header[at:],
        data=data,
        type=kind,
    )


# ---------------------------------------------------------------- whole PDUs


def encode_advertising(pdu: AdvertisingPdu) -> bytes:
    """Return the octets of *pdu*; raise ValueError for what does not fit or does not belong into it."""
    match pdu:
        case Undirected(kind, sender, data):
            if kind not in _UNDIRECTED or len(data) > MAX_ADVERTISING_DATA:
                raise ValueError(f"{kind.name} of {len(data)} octets of data")
            target, payload = None, _encode_address(sender) + data
        case Directed(kind, sender, target):
            if kind not in _DIRECTED:
                raise ValueError(f"{kind.name} is not sent to one device")
            payload = _encode_address(sender) + _encode_address(target)
        case ConnectInd(sender, target, ll_data):
            kind = AdvertisingType.CONNECT_IND
            payload = _encode_address(sender) + _encode_address(target) + encode_ll_data(ll_data)
        case Extended():
            return _encode_extended_pdu(pdu)
    algorithm_2 = pdu.algorithm_2 and kind in _TELL_ALGORITHM
    return bytes([_first_octet(kind, sender, target) | algorithm_2 << 5, len(payload)]) + payload


def _encode_extended_pdu(pdu: Extended) -> bytes:
    payload = _encode_extended(pdu)
    if pdu.type not in _EXTENDED or len(payload) > MAX_PAYLOAD:
        raise ValueError(f"{pdu.type.name} with a payload of {len(payload)} octets")
    return bytes([_first_octet(pdu.type, pdu.advertiser, pdu.target), len(payload)]) + payload


def _first_octet(kind: AdvertisingType, sender: DeviceAddress | None, target: DeviceAddress | None) -> int:
    tx_random, rx_random = (address is not None and address.random for address in (sender, target))
    return kind | tx_random << 6 | rx_random << 7


def decode_advertising(octets: bytes) -> AdvertisingPdu:
    """Return the PDU of an advertising channel in *octets*, without CRC; raise WireError, and nothing else, if none."""
    first, payload = _divided(octets)
    if first & 15 not in set(AdvertisingType):
        raise WireError(f"PDU type {first & 15} is reserved")
    kind, algorithm_2 = AdvertisingType(first & 15), bool(first >> 5 & 1)
    tx_random, rx_random = first >> 6 & 1, first >> 7
    if kind in _EXTENDED:
        return _decode_extended(kind, tx_random, rx_random, payload)
    sizes = _payload_sizes(kind)
    if len(payload) not in sizes:
        raise WireError(f"{kind.name} with a payload of {len(payload)} octets")
    sender = _decode_address(payload[:_ADDRESS_OCTETS], tx_random)
    algorithm_2 = algorithm_2 and kind in _TELL_ALGORITHM
    if kind in _UNDIRECTED:
        return Undirected(kind, sender, payload[_ADDRESS_OCTETS:], algorithm_2)
    target = _decode_address(payload[_ADDRESS_OCTETS : 2 * _ADDRESS_OCTETS], rx_random)
    if kind in _DIRECTED:
        return Directed(kind, sender, target, algorithm_2)
    return ConnectInd(sender, target, decode_ll_data(payload[2 * _ADDRESS_OCTETS :]), algorithm_2)


def _payload_sizes(kind: AdvertisingType) -> range:
    """Return the lengths that the payload of a legacy PDU may have."""
    if kind in _UNDIRECTED:
        return range(_ADDRESS_OCTETS, _ADDRESS_OCTETS + MAX_ADVERTISING_DATA + 1)
    size = 2 * _ADDRESS_OCTETS + (0 if kind in _DIRECTED else _LL_DATA.size)
    return range(size, size + 1)


def encode_data(pdu: DataPdu) -> bytes:
    """Return the octets of *pdu*; raise ValueError if its payload is too long."""
    if len(pdu.payload) > MAX_PAYLOAD:
        raise ValueError(f"{len(pdu.payload)} octets are no payload (0 to {MAX_PAYLOAD})")
    first = pdu.llid | _in_bits(pdu.nesn, 1, "NESN") << 2 | _in_bits(pdu.sn, 1, "SN") << 3 | pdu.more << 4
    return bytes([first, len(pdu.payload)]) + pdu.payload


def decode_data(octets: bytes) -> DataPdu:
    """Return the PDU of a connection in *octets*, without CRC; raise WireError, and nothing else, if it is none."""
    first, payload = _divided(octets)
    if not first & 3:
        raise WireError("LLID 0 is reserved")
    return DataPdu(Llid(first & 3), first >> 2 & 1, first >> 3 & 1, bool(first >> 4 & 1), payload)


def _divided(octets: bytes) -> tuple[int, bytes]:
    """Return the first octet and the payload of a PDU."""
    if len(octets) < HEADER_OCTETS or len(octets) != HEADER_OCTETS + octets[1]:
        raise WireError(f"{len(octets)} octets are no PDU")
    return octets[0], octets[HEADER_OCTETS:]
