"""The octets of AODV's messages (RFC 3561, section 5)."""

import pytest
from hypothesis import given

from cosim.channels.adhoc.routing.aodv_wire import Message, Rerr, Rrep, RrepAck, Rreq, decode_message, encode_message
from cosim.errors import WireError
from tests.channels.adhoc.aodv_cases import MESSAGES

GOLDEN = [
    # type, flags J R G D U and reserved (16 bits), hops; RREQ ID; destination, its number; originator, its number
    (Rreq(3, 0x01020304, 1, 0x11121314, 2, 0x21222324), "01 00 00 03 01020304 0a000002 11121314 0a000003 21222324"),
    (Rreq(0, 7, 1, None, 2, 9), "01 08 00 00 00000007 0a000002 00000000 0a000003 00000009"),
    (Rreq(0, 7, 1, 5, 2, 9, gratuitous=True), "01 20 00 00 00000007 0a000002 00000005 0a000003 00000009"),
    (Rreq(0, 7, 1, 5, 2, 9, destination_only=True), "01 10 00 00 00000007 0a000002 00000005 0a000003 00000009"),
    # type, flags R A, reserved and prefix size (16 bits), hops; destination, its number; originator; lifetime, 6000 ms
    (Rrep(4, 250, 0xFFFFFFFF, 0, 6000), "02 00 00 04 0a000101 ffffffff 0a000001 00001770"),
    (Rrep(4, 250, 1, 0, 6000, ack=True), "02 40 00 04 0a000101 00000001 0a000001 00001770"),
    # type, flag N and reserved (16 bits), count; then destinations and numbers
    (Rerr(((1, 2), (3, 4))), "03 00 00 02 0a000002 00000002 0a000004 00000004"),
    (Rerr(((1, 2),), no_delete=True), "03 80 00 01 0a000002 00000002"),
    (RrepAck(), "04 00"),
]


@pytest.mark.parametrize(("message", "octets"), GOLDEN)
def test_messages_have_the_octets_of_section_5(message: Message, octets: str) -> None:
    assert encode_message(message) == bytes.fromhex(octets)
    assert decode_message(bytes.fromhex(octets)) == message


def test_reserved_bits_and_those_of_multicast_are_ignored() -> None:
    request, reply = encode_message(Rreq(1, 2, 3, 4, 5, 6)), encode_message(Rrep(1, 2, 3, 4, 5))
    assert decode_message(request[:1] + b"\xc7\xff" + request[3:]) == Rreq(1, 2, 3, 4, 5, 6)
    assert decode_message(reply[:1] + b"\xbf\xe0" + reply[3:]) == Rrep(1, 2, 3, 4, 5)


@pytest.mark.parametrize(
    "octets",
    [
        "",
        "05 00",
        "04 00 00",
        "03 00 00 00",  # no destination
        "03 00 00 02 0a000002 00000002",  # fewer than it says
        "02 00 01 04 0a000101 00000001 0a000001 00001770",  # a subnet
        "02 00 00 04 ffffffff 00000001 0a000001 00001770",  # a route to all
        "02 00 00 04 0b000001 00000001 0a000001 00001770",  # nobody's address
    ],
)
def test_other_octets_are_no_message(octets: str) -> None:
    with pytest.raises(WireError):
        decode_message(bytes.fromhex(octets))


@given(MESSAGES)
def test_messages_survive_their_octets(message: Message) -> None:
    assert decode_message(encode_message(message)) == message
