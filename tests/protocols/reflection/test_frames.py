"""Frames on the wire: golden bytes, there and back, and what is none."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import WireError
from protocols.reflection.frames import FAR_M, Frame, decode, encode

FRAME = Frame(
    in_trouble=True,
    objects=False,
    stamp_ms=12_345,
    bearings=((2, 0.5),),
    terms=((0, 8, 1.0, -2.0),),
    pledges=((3, 7, 3.0, 1000),),
)
BODY = (
    "52 01 00003039 01 01 01"  # magic, flags, stamp, counts
    "02 3f000000"  # robot 2 is seen at 0.5 rad
    "00 00000008 3f800000 c0000000"  # goal of robot 0, Id 8, at (1, -2)
    "03 00000007 40400000 000003e8"  # a way of 3 m to the goal of robot 3, Id 7, seen at 1000 ms
)


def crc_by_bits(data: bytes) -> int:
    """CRC-CCITT, polynomial 0x1021, initial value 0xFFFF, bit by bit."""
    value = 0xFFFF
    for byte in data:
        for bit in range(7, -1, -1):
            top = value >> 15 ^ byte >> bit & 1
            value = value << 1 & 0xFFFF ^ (0x1021 if top else 0)
    return value


def test_a_frame_has_its_golden_bytes() -> None:
    body = bytes.fromhex(BODY)
    assert encode(FRAME) == body + crc_by_bits(body).to_bytes(2, "big")
    assert decode(encode(FRAME)) == FRAME


singles = st.floats(-FAR_M, FAR_M, width=32)
addresses = st.integers(0, 255)
identifiers = st.integers(1, 2**32 - 1)
stamps = st.integers(0, 2**32 - 1)
frames = st.builds(
    Frame,
    st.booleans(),
    st.booleans(),
    stamps,
    st.lists(st.tuples(addresses, st.floats(-4.0, 4.0, width=32)), max_size=6).map(tuple),
    st.lists(st.tuples(addresses, identifiers, singles, singles), max_size=6).map(tuple),
    st.lists(st.tuples(addresses, identifiers, st.floats(0.0, FAR_M, width=32), stamps), max_size=6).map(tuple),
)


@given(frames)
def test_what_is_encoded_is_decoded(frame: Frame) -> None:
    assert decode(encode(frame)) == frame


@given(st.binary(max_size=80))
def test_bytes_that_are_no_frame_raise_wire_errors_only(data: bytes) -> None:
    try:
        frame = decode(data)
    except WireError:
        return
    assert encode(frame) == data


@given(frames, st.data())
def test_a_frame_with_one_flipped_bit_is_none(frame: Frame, data: st.DataObject) -> None:
    payload = bytearray(encode(frame))
    bit = data.draw(st.integers(0, 8 * len(payload) - 1))
    payload[bit // 8] ^= 1 << bit % 8
    with pytest.raises(WireError):
        decode(bytes(payload))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 2.0 * FAR_M])
@pytest.mark.parametrize("offset", [10, 19, 23, 32])
def test_a_number_that_no_robot_sends_makes_no_frame(bad: float, offset: int) -> None:
    body = bytearray(bytes.fromhex(BODY))
    assert struct.unpack_from(">f", body, offset)[0] in (0.5, 1.0, -2.0, 3.0)
    struct.pack_into(">f", body, offset, bad)
    with pytest.raises(WireError, match="no robot"):
        decode(bytes(body) + crc_by_bits(body).to_bytes(2, "big"))


def test_lengths_are_rounded_by_less_than_four_micrometres_up_to_128_m() -> None:
    worst = 0.0
    for length in (64.000001, 99.9999999, 100.123456789, 127.999999):
        frame = FRAME._replace(pledges=((3, 7, length, 0),))
        worst = max(worst, abs(decode(encode(frame)).pledges[0][2] - length))
    assert 1e-7 < worst <= 3.9e-6


@pytest.mark.parametrize("team", [2, 4, 8, 50])
def test_a_meeting_takes_bytes_linear_in_the_team(team: int) -> None:
    terms = tuple((owner, team, 1.0, 2.0) for owner in range(team))
    pledges = tuple((owner, team, 3.0, 4) for owner in range(team) if owner)
    bearings = tuple((other, 0.0) for other in range(1, team))
    size = len(encode(Frame(False, False, 0, bearings, terms, pledges)))
    assert size == 9 + 5 * (team - 1) + 13 * team + 13 * (team - 1) + 2
