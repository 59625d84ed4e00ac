"""What payloads say, as their protocol understands them: for who looks at a frame of a run.

A protocol's spec decodes its own payloads (``ProtocolSpec.decode``); what a router has packed for the air is unpacked
here, and so are packets of Low Energy, which tables hold whole. Decoded messages become plain data, as JSON has it: who
shows them need know no protocol.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import partial
from typing import Any, Final, TypeAlias

from pydantic import BaseModel

from cosim.channels.adhoc.routing import aodv_wire, ip, olsr_wire
from cosim.channels.ble.dissection import PARTS, Part, dissect, put_together
from cosim.channels.ble.settings import BleSettings
from cosim.errors import WireError
from cosim.scenario import Scenario

Plain: TypeAlias = dict[str, Any] | list[Any] | str | int | float | bool | None
"""Data that JSON can hold."""
Row: TypeAlias = Mapping[str, Any]
"""A row of a table."""
Beside: TypeAlias = Callable[[Collection[str]], tuple[Iterator[Row], Iterator[Row]]]
"""(types of packets) -> the transmissions of these types before one and after it, from it on, of the same sender."""
TYPE: Final = "type"
"""Key of the name of a message's type, in front of its fields."""


def decoded(scenario: Scenario, payload: bytes, routed: bool = False) -> Plain:
    """Return what *payload*, the body of a robot's frame in a run of *scenario*, says; a sentence if it says nothing.

    A *routed* one is a router's IPv4 packet: what it carries stands below its headers.
    """
    return _body(partial(_payload, scenario), payload, routed)


def frame_said(scenario: Scenario, body: bytes, sent: Row | None, beside: Beside | None = None) -> Plain:
    """Return what *body* says, in a run of *scenario*: that of a transmission, or else a payload.

    *sent* is the row of the transmission; its radio tells what a body is. What is *beside* it to the same receiver may
    carry the rest of its payload.
    """
    if sent is None:
        return decoded(scenario, body)
    say = partial(_payload, scenario) if sent["source"] < scenario.team.size else _of_station
    radio = sent.get("radio", 0)
    if radio < len(scenario.radios) and isinstance(scenario.radios[radio], BleSettings):
        return _low_energy(say, body, sent, beside)
    return _body(say, body, bool(sent["routed"]))


def packet_name(packet: bytes) -> str:
    """Return what a router's IPv4 *packet* is called by what it carries: RREQ, RREP, ..., HELLO, TC, HELLO+TC.

    Nothing if that is a host's payload, or no message.
    """
    try:
        datagram = ip.decode(packet)
        if datagram.port == ip.AODV_PORT:
            return type(aodv_wire.decode_message(datagram.data)).__name__.upper()
        if datagram.port == ip.OLSR_PORT:
            messages = olsr_wire.decode_packet(datagram.data)[1]
            return "+".join(dict.fromkeys(_OLSR_NAMES.get(each.kind, "OLSR") for each in messages))
    except WireError:
        pass
    return ""


def plain(value: Any) -> Plain:
    """Return a decoded message, or a part of one, as plain data: bytes in hexadecimal, names of enumerations."""
    match value:
        case Enum():
            return value.name.lower()
        case None | bool() | int() | str():
            return value
        case float():
            return value if math.isfinite(value) else str(value)
        case bytes():
            return value.hex()
        case BaseModel():
            return {TYPE: type(value).__name__, **value.model_dump(mode="json", exclude_none=True)}
        case Mapping():
            return {str(key): plain(item) for key, item in value.items()}
        case tuple() if hasattr(value, "_fields"):
            return {TYPE: type(value).__name__, **plain_fields(value, value._fields)}
        case list() | tuple():
            return [plain(item) for item in value]
    if is_dataclass(value):
        return {TYPE: type(value).__name__, **plain_fields(value, [field.name for field in fields(value)])}
    return str(value)


def plain_fields(value: Any, names: Any) -> dict[str, Plain]:
    """Return the fields *names* of a message as plain data."""
    return {name: plain(getattr(value, name)) for name in names}


_Say: TypeAlias = Callable[[bytes], Any]
"""(payload of a host) -> what it says; it raises WireError for one that is no message."""


def _sentence_or(say: _Say, payload: bytes) -> Plain:
    try:
        return plain(say(payload))
    except WireError as error:
        return f"no message: {error}"


def _body(say: _Say, body: bytes, routed: bool) -> Plain:
    return _sentence_or(partial(_routed, say) if routed else say, body)


def _payload(scenario: Scenario, payload: bytes) -> Any:
    spec = scenario.protocol.spec
    if spec.decode is None:
        return f"protocol {spec.name} does not say how to decode its payloads"
    return spec.decode(scenario.protocol.parameters, scenario.team.size, payload)


def _of_station(payload: bytes) -> str:
    return "a payload of a station in the background, which says nothing"


def _low_energy(say: _Say, packet: bytes, sent: Row, beside: Beside | None) -> Plain:
    """Return what a *packet* of Low Energy says, and below it what the payload says of which it carries all or a part.

    That is left out if it carries none, or one that cannot be put together.
    """
    try:
        fields, payload = dissect(sent["kind"], packet)
    except WireError as error:
        return f"no packet: {error}"
    if payload is None and beside is not None and sent["kind"] in PARTS:
        before, after = (map(_part, rows) for rows in beside(PARTS[sent["kind"]]))
        payload = put_together(_part(sent), before, after)
    carried = {} if payload is None else {"payload": _sentence_or(say, payload)}
    return {"low_energy": fields} | carried


def _part(sent: Row) -> Part:
    return Part(bytes.fromhex(sent["body"]), bool(sent["retry"]))


def _routed(say: _Say, packet: bytes) -> Any:
    datagram = ip.decode(packet)
    headers = {"source": datagram.source, "destination": datagram.destination, "ttl": datagram.ttl}
    carries = _PORTS.get(datagram.port, _unknown)
    return {"ip": headers | {"number": datagram.number, "port": datagram.port}} | carries(say, datagram.data)


def _unknown(say: _Say, data: bytes) -> dict[str, Plain]:
    return {"data": data.hex()}


def _of_host(say: _Say, data: bytes) -> dict[str, Plain]:
    return {"payload": _sentence_or(say, data)}


def _of_aodv(say: _Say, data: bytes) -> dict[str, Plain]:
    return {"aodv": _sentence_or(aodv_wire.decode_message, data)}


def _of_olsr(say: _Say, data: bytes) -> dict[str, Plain]:
    return {"olsr": _sentence_or(_olsr, data)}


def _olsr(data: bytes) -> Any:
    number, messages = olsr_wire.decode_packet(data)
    bodies = (_OLSR.get(message.kind, bytes)(message.body) for message in messages)
    return {
        "number": number,
        "messages": [
            plain_fields(message, [name for name in message._fields if name != "body"]) | {"body": plain(body)}
            for message, body in zip(messages, bodies, strict=True)
        ],
    }


_PORTS: Final = {ip.PAYLOAD_PORT: _of_host, ip.AODV_PORT: _of_aodv, ip.OLSR_PORT: _of_olsr}
_OLSR_NAMES: Final = {olsr_wire.HELLO: "HELLO", olsr_wire.TC: "TC"}
_OLSR: Final[dict[int, Callable[[bytes], Any]]] = {
    olsr_wire.HELLO: olsr_wire.decode_hello,
    olsr_wire.TC: olsr_wire.decode_tc,
}
