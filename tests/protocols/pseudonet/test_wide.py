"""Packets of more than eight robots: golden bytes of the wide form, round trips, what is refused."""

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.channels.bluetooth.packets import ACL
from cosim.errors import WireError
from protocols.pseudonet.messages import Acknowledgement, Action, Kind, Message, Missing, Reply, Verdict
from protocols.pseudonet.topology import Directory, Piconet
from protocols.pseudonet.wide import (
    Assignment,
    Census,
    Dissolution,
    Welcome,
    WidePacket,
    decode,
    encode,
)
from tests.protocols.pseudonet.test_messages import FREE, closed, messages

TEAM = Directory((Piconet(0, (5, 9, 12)), Piconet(12, (17, 31)), Piconet(20, (0, 21, 22, 23, 24, 25, 26))))
"""Robot 12 is called 1.0, 31 is 1.2, 26 is 2.7."""

# The head is the piconet of the source (5 bits), its place there (3), type (2), kind (3), exchange (8); what follows is
# that of the narrow form.
GOLDEN: dict[str, tuple[WidePacket, str]] = {
    # 00001 010 | 00 000 | 0000 0111 | 025 403 | 001 001 000 010 011 1 and three bits of padding
    "state": (
        Message(
            31,
            Kind.STATE,
            7,
            0x025,
            0x403,
            Action.EAST,
            (Verdict.WALL, Verdict.POSSIBLE, Verdict.COVERED, Verdict.ROBOT),
            busy=True,
        ),
        "00001010 00000 00000111 000000100101 010000000011 001 001 000 010 011 1",
    ),
    # 00000 001 | 00 010 | 1111 1111 | 000 000 | 100 100 101 000 000 0 | 0 00010 111 11 FFF 001
    "answer": (
        Message(
            5,
            Kind.ANSWER,
            255,
            0,
            0,
            Action.STAY,
            (Verdict.NEARER, Verdict.LOST, Verdict.POSSIBLE, Verdict.POSSIBLE),
            addressee=26,
            reply=Reply.DIRECT,
            target=(4095, 1),
        ),
        "00000001 00010 11111111 000000000000 000000000000 1001001010000000 0 00010111 11 111111111111 000000000001",
    ),
    # 00001 000 | 00 101 | 0000 0011 | 001 002 | 100 and thirteen zeros | DEADBEEF
    "roll": (
        Message(12, Kind.ROLL, 3, 1, 2, Action.STAY, FREE, digest=0xDEADBEEF),
        "00001000 00101 00000011 000000000001 000000000010 1000000000000000 11011110101011011011111011101111",
    ),
    # 00000 010 | 11 000 | 0000 1001 | robots 31, 9 and 0
    "missing": (
        Missing(9, 9, (0, 9, 31)),
        "00000010 11000 00001001 10000000000000000000001000000001",
    ),
    "acknowledgement": (Acknowledgement(0, 9), "00000000 10111 00001001"),
    "negative acknowledgement": (Acknowledgement(17, 9, negative=True), "00001001 11111 00001001"),
    # 00010 000 | 01 111 | 0 | 3 piconets, root 0, formation 6 | hop address and clock
    "welcome": (
        Welcome(2, 3, 0, 6, 0x2A96EF25, 0x0ABCDEF),
        "00010000 01111 00000000 00011 00000 00000110 00101010100101101110111100100101 0000101010111100110111101111",
    ),
    # 00001 000 | 01 000 | 0 | 3 piconets, root 0, formation 6 | 2 slaves, the second is 31, at 0x0ABCDEF
    "assignment": (
        Assignment(1, 3, 0, 6, 2, 2, 31, 0x0ABCDEF),
        "00001000 01000 00000000 00011 00000 00000110 010 010 11111 0000101010111100110111101111",
    ),
    # 00001 000 | 01 001 | 0 | 3 piconets, root 0, formation 6 | report 4 | 2 slaves of 12: 17, 31
    "report": (
        Census(False, 4, 0, 1, 3, 0, 6, Piconet(12, (17, 31))),
        "00001000 01001 00000000 00011 00000 00000110 00000100 010 01100 10001 11111" + " 00000" * 5,
    ),
    # 00001 000 | 01 010 | exchange 77 | ...
    "roll call": (
        Census(True, 4, 77, 1, 3, 0, 6, Piconet(12, (17, 31))),
        "00001000 01010 01001101 00011 00000 00000110 00000100 010 01100 10001 11111" + " 00000" * 5,
    ),
    # 00000 000 | 01 011 | 0 | robots 2 and 1
    "dissolution": (Dissolution((1, 2)), "00000000 01011 00000000 00000000000000000000000000000110"),
}


def as_bytes(golden: str) -> bytes:
    """Return the bytes of the bits that are written in groups, filled up with zeros and closed by the CRC."""
    bits = golden.replace(" ", "")
    padded = bits + "0" * (-len(bits) % 8)
    return closed(int(padded, 2).to_bytes(len(padded) // 8, "big"))


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_bytes_of_the_wide_form(name: str) -> None:
    packet, golden = GOLDEN[name]
    assert encode(packet, TEAM) == as_bytes(golden)
    assert decode(as_bytes(golden), TEAM) == packet


_robots = st.sampled_from(TEAM.members)
_numbers = st.integers(0, 255)
_place = (st.integers(0, 31), st.integers(0, 31), st.integers(0, 31), _numbers)
_content = st.builds(Piconet, st.integers(0, 31), st.lists(st.integers(0, 31), max_size=7).map(tuple))


@st.composite
def wide_messages(draw: st.DrawFn) -> Message:
    message = replace(draw(messages()), source=draw(_robots))
    return message if message.addressee is None else replace(message, addressee=draw(_robots))


_masks = st.sets(st.integers(0, 31)).map(lambda robots: tuple(sorted(robots)))
_clocks = st.integers(0, 2**28 - 1)
packets: Any = (
    wide_messages()
    | st.builds(Missing, _robots, _numbers, _masks)
    | st.builds(Acknowledgement, _robots, _numbers, st.booleans())
    | st.builds(Welcome, *_place, st.integers(0, 2**32 - 1), _clocks)
    | st.builds(Assignment, *_place, st.integers(0, 7), st.integers(0, 7), st.integers(0, 31), _clocks)
    | st.builds(Census, st.booleans(), _numbers, _numbers, *_place, _content)
    | st.builds(Dissolution, _masks)
)


@given(packets)
def test_what_was_encoded_is_decoded_to_the_same(packet: WidePacket) -> None:
    assert decode(encode(packet, TEAM), TEAM) == packet


@given(packets)
def test_every_wide_packet_fits_one_dm1_packet(packet: WidePacket) -> None:
    assert len(encode(packet, TEAM)) <= ACL["DM1"].capacity == 17


@given(st.binary(max_size=40))
def test_arbitrary_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(WireError):
        decode(data, TEAM)


@given(st.binary(min_size=1, max_size=15))
def test_bytes_with_a_right_crc_are_a_packet_or_are_refused(body: bytes) -> None:
    data = closed(body)
    try:
        packet = decode(data, TEAM)
    except WireError:
        return
    assert encode(packet, TEAM) == data


@pytest.mark.parametrize(
    ("packet", "reason"),
    [
        (Message(1, Kind.STATE, 0, 0, 0, Action.STAY, FREE), "robot 1 has no name in this team"),
        (Missing(0, 0, (32,)), "does not fit"),
        (Welcome(32, 0, 0, 0), "does not fit"),
        (Census(True, 0, 0, 0, 1, 0, 0, Piconet(0, tuple(range(1, 9)))), "8 slaves in a piconet"),
    ],
)
def test_values_without_room_are_refused(packet: WidePacket, reason: str) -> None:
    with pytest.raises(WireError, match=reason):
        encode(packet, TEAM)


def test_a_name_that_nobody_has_is_refused() -> None:
    data = encode(Message(26, Kind.STATE, 0, 0, 0, Action.STAY, FREE), TEAM)
    with pytest.raises(WireError, match=r"nobody in this team is called 2\.7"):
        decode(data, Directory(TEAM.piconets[:2]))
