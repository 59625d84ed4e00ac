"""The control PDUs of a connection that this model knows, as octets (Core v5.0, Vol 6 Part B, 2.4.2).

A control PDU is an opcode and its parameters, least significant octet first. It is sent as the payload of a data PDU
with LLID 3, so that it takes air time and is acknowledged as any other.
"""

import struct
from struct import Struct
from typing import Any, Final, NamedTuple, TypeAlias

from cosim.channels.ble.bits.l2cap import LEAST_OCTETS, LEAST_TIME
from cosim.channels.ble.bits.pdu import Llid
from cosim.channels.ble.connections.arq import Fragment
from cosim.channels.ble.connections.channel_map import MAP_OCTETS, ChannelMap, decode_channel_map
from cosim.channels.ble.connections.parameters import INTERVAL_UNIT, TIMEOUT_UNIT, ConnectionParameters, TransmitWindow
from cosim.errors import UserError, WireError
from cosim.units import US, Time

USER_TERMINATED: Final = 0x13
"""Error code: the remote user has terminated the connection (Vol 1 Part F, 2)."""
PHY_1M, PHY_2M, PHY_CODED = 1, 2, 4
"""Bits of PHYs."""
_PHY_BITS: Final = PHY_1M | PHY_2M | PHY_CODED


class ConnectionUpdateInd(NamedTuple):
    """New parameters from the event *instant* on, which begins in *window*."""

    window: TransmitWindow
    parameters: ConnectionParameters
    instant: int


class ChannelMapInd(NamedTuple):
    """A new channel map from the event *instant* on."""

    used: ChannelMap
    instant: int


class TerminateInd(NamedTuple):
    """The end of the connection, once it has been acknowledged."""

    error: int = USER_TERMINATED


class Lengths(NamedTuple):
    """A LENGTH_REQ, or the LENGTH_RSP to one: the longest PDUs that the sender can receive, and that it will send."""

    response: bool
    rx_octets: int
    rx_time: Time
    tx_octets: int
    tx_time: Time


class Phys(NamedTuple):
    """A PHY_REQ, or the PHY_RSP to one: PHYs, as bits, that the sender would like to send and to receive on."""

    response: bool
    tx: int
    rx: int


class PhyUpdateInd(NamedTuple):
    """The PHYs from the event *instant* on, each one bit, or 0 if it stays the same."""

    central_to_peripheral: int
    peripheral_to_central: int
    instant: int


Control: TypeAlias = ConnectionUpdateInd | ChannelMapInd | TerminateInd | Lengths | Phys | PhyUpdateInd

LAYOUTS: Final[dict[int, Struct]] = {
    0x00: Struct("<BHHHHH"),  # LL_CONNECTION_UPDATE_IND
    0x01: Struct(f"<{MAP_OCTETS}sH"),  # LL_CHANNEL_MAP_IND
    0x02: Struct("<B"),  # LL_TERMINATE_IND
    0x14: Struct("<HHHH"),  # LL_LENGTH_REQ
    0x15: Struct("<HHHH"),  # LL_LENGTH_RSP
    0x16: Struct("<BB"),  # LL_PHY_REQ
    0x17: Struct("<BB"),  # LL_PHY_RSP
    0x18: Struct("<BBH"),  # LL_PHY_UPDATE_IND
}
"""Parameters by opcode."""


def encode_control(pdu: Control) -> Fragment:
    """Return what carries *pdu*; raise ValueError for a value that does not fit into its field."""
    opcode, values = _fields(pdu)
    try:
        return Fragment(Llid.CONTROL, bytes([opcode]) + LAYOUTS[opcode].pack(*values))
    except struct.error as fault:
        raise ValueError(f"{pdu}: {fault}") from None


def _fields(pdu: Control) -> tuple[int, tuple[Any, ...]]:
    """Return the opcode and the values of the fields of *pdu*."""
    match pdu:
        case ConnectionUpdateInd(window, parameters, instant):
            size, offset, interval = (t // INTERVAL_UNIT for t in (window.size, window.offset, parameters.interval))
            return 0x00, (size, offset, interval, parameters.latency, parameters.timeout // TIMEOUT_UNIT, instant)
        case ChannelMapInd(used, instant):
            return 0x01, (used.encode(), instant)
        case TerminateInd(error):
            return 0x02, (error,)
        case Lengths(response, rx_octets, rx_time, tx_octets, tx_time):
            return 0x14 + response, (rx_octets, rx_time // US, tx_octets, tx_time // US)
        case Phys(response, tx, rx):
            return 0x16 + response, (tx, rx)
        case PhyUpdateInd(down, up, instant):
            return 0x18, (down, up, instant)


def decode_control(payload: bytes) -> Control:
    """Return the control PDU that *payload* is; raise WireError, and nothing else, if it is none that is known here."""
    opcode = payload[0] if payload else -1
    layout = LAYOUTS.get(opcode)
    if layout is None or len(payload) != 1 + layout.size:
        raise WireError(f"a control PDU of {len(payload)} octets with opcode {opcode}")
    values = layout.unpack(payload[1:])
    if opcode == 0x00:
        return _connection_update(*values)
    if opcode == 0x01:
        return ChannelMapInd(decode_channel_map(values[0]), values[1])
    if opcode == 0x02:
        return TerminateInd(values[0])
    if opcode in (0x14, 0x15):
        rx_octets, rx_time, tx_octets, tx_time = values
        if min(rx_octets, tx_octets) < LEAST_OCTETS or min(rx_time, tx_time) * US < LEAST_TIME:
            raise WireError(f"lengths of {rx_octets} and {tx_octets} octets, {rx_time} and {tx_time} us")
        return Lengths(opcode == 0x15, rx_octets, rx_time * US, tx_octets, tx_time * US)
    return _phys(opcode, *(value & _PHY_BITS for value in values[:2]), *values[2:])


def _connection_update(size: int, offset: int, interval: int, latency: int, timeout: int, instant: int) -> Control:
    window = TransmitWindow(size * INTERVAL_UNIT, offset * INTERVAL_UNIT)
    try:
        parameters = ConnectionParameters(interval * INTERVAL_UNIT, latency, timeout * TIMEOUT_UNIT)
        window.check(parameters.interval)
    except UserError as error:
        raise WireError(str(error)) from None
    return ConnectionUpdateInd(window, parameters, instant)


def _phys(opcode: int, first: int, second: int, instant: int = 0) -> Control:
    if opcode == 0x18:
        if max(first.bit_count(), second.bit_count()) > 1:
            raise WireError(f"an update to PHYs {first:#x} and {second:#x}")
        return PhyUpdateInd(first, second, instant)
    if not first or not second:
        raise WireError("a request for no PHY")
    return Phys(opcode == 0x17, first, second)
