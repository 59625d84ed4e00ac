"""What a router's packet is called in a picture: a frame with one is DATA to the radios, whatever it carries."""

from typing import Final

from cosim.channels.adhoc.routing import ip
from cosim.channels.adhoc.routing.aodv_wire import decode_message
from cosim.channels.adhoc.routing.olsr_wire import HELLO, TC, decode_packet
from cosim.errors import WireError

_OLSR: Final = {HELLO: "HELLO", TC: "TC"}


def packet_name(body: str) -> str:
    """Return what the packet *body*, hexadecimal, is: RREQ, RREP, ..., HELLO, TC; nothing for a host's payload."""
    try:
        datagram = ip.decode(bytes.fromhex(body))
        if datagram.port == ip.AODV_PORT:
            return type(decode_message(datagram.data)).__name__.upper()
        if datagram.port == ip.OLSR_PORT:
            return "+".join(dict.fromkeys(_OLSR.get(each.kind, "OLSR") for each in decode_packet(datagram.data)[1]))
    except WireError:
        pass
    return ""
