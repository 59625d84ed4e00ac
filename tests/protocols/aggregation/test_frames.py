"""Frames of a search team: golden bytes, there and back, and what is none; stamps and bitmaps."""

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from cosim.errors import LocalProtocolError, WireError
from cosim.units import MS, US
from protocols.aggregation.frames import CLOCK_MS, FAR_M, bitmap, decode, encode, instant, posts_in, stamp
from protocols.aggregation.messages import (
    Assign,
    Confirm,
    Finding,
    Heartbeat,
    Hello,
    Join,
    Leave,
    Message,
    Piece,
    Plan,
    Plans,
    Receipt,
    Report,
    Status,
    Stop,
    Stopped,
)

PLAN = Plan(host=1, version=2, departed_ms=3000, speed_mps=0.5, way_m=((1.0, -2.0), (3.0, 4.0)))
PLAN_BYTES = "01 0002 00000bb8 3f000000 02 3f800000 c0000000 40400000 40800000"
STANDING = Plan(host=0, version=9, departed_ms=0, speed_mps=0.0, way_m=((0.5, 8.0),))
STANDING_BYTES = "00 0009 00000000 00000000 01 3f000000 41000000"
FOUND = (Finding(7, 1.0, -2.0), Finding(8, 3.0, 4.0))
FOUND_BYTES = "07 3f800000 c0000000 08 40400000 40800000"

GOLDEN: list[tuple[Message, str]] = [
    (
        Heartbeat(
            number=258,
            stamp_ms=12_345,
            x_m=1.0,
            y_m=-2.0,
            round=3,
            plan=4,
            found=5,
            visited=260,
            over=True,
            syncing=False,
            astray=True,
            silent=(1, 2),
        ),
        "41 01 06 00000102 00003039 3f800000 c0000000 0003 0004 05 0104 05 02 01 02",
    ),
    (Plans((PLAN, STANDING)), f"41 02 06 02 {PLAN_BYTES} {STANDING_BYTES}"),
    (
        Status(FOUND, b"\x05\x80\x00", ((3, 258), (4, 1)), PLAN),
        f"41 03 06 02 {FOUND_BYTES} 0003 058000 02 03 0102 04 0001 {PLAN_BYTES}",
    ),
    (Hello(epoch=1, x_m=1.0, y_m=-2.0, assignment=258, plan=4), "41 04 06 0001 3f800000 c0000000 0102 0004"),
    (Report(258, 3, FOUND, b"\x05\x80"), f"41 05 06 0102 0003 02 {FOUND_BYTES} 0002 0580"),
    (Receipt(258), "41 06 06 0102"),
    (Assign(epoch=1, number=2, posts=(258, 0, 65_535)), "41 07 06 0001 0002 0003 0102 0000 ffff"),
    (Join(epoch=258, x_m=1.0, y_m=-2.0), "41 08 06 0102 3f800000 c0000000"),
    (Confirm(258), "41 09 06 0102"),
    (Leave(258), "41 0a 06 0102"),
    (Stop(), "41 0b 06"),
    (Stopped(), "41 0c 06"),
    (Piece(b"\x05\x80"), "41 0d 06 0002 0580"),
]
KINDS = [type(message).__name__ for message, _ in GOLDEN]


def crc_by_bits(data: bytes) -> int:
    """CRC-CCITT, polynomial 0x1021, initial value 0xFFFF, bit by bit."""
    value = 0xFFFF
    for byte in data:
        for bit in range(7, -1, -1):
            top = value >> 15 ^ byte >> bit & 1
            value = value << 1 & 0xFFFF ^ (0x1021 if top else 0)
    return value


def sealed(body: bytes) -> bytes:
    return body + crc_by_bits(body).to_bytes(2, "big")


# ---------------------------------------------------------------- golden bytes, there and back


@pytest.mark.parametrize(("message", "golden"), GOLDEN, ids=KINDS)
def test_every_kind_has_its_golden_bytes(message: Message, golden: str) -> None:
    data = sealed(bytes.fromhex(golden))
    assert encode(6, message) == data
    assert decode(data) == (6, message)
    assert type(decode(data)[1]) is type(message)


def test_every_kind_of_message_is_among_the_golden_ones() -> None:
    assert {type(message) for message, _ in GOLDEN} == set(Message.__args__)


singles = st.floats(-FAR_M, FAR_M, width=32)
octets = st.integers(0, 255)
words = st.integers(0, 2**16 - 1)
stamps = st.integers(0, 2**32 - 1)
points = st.tuples(singles, singles)
findings = st.lists(st.builds(Finding, octets, singles, singles), max_size=4).map(tuple)
speeds = st.floats(0.0, FAR_M, width=32)
plans = st.builds(Plan, octets, words, stamps, speeds, st.lists(points, min_size=1, max_size=5).map(tuple))
members = st.lists(st.tuples(octets, words), max_size=4).map(tuple)
silent = st.lists(octets, max_size=4).map(tuple)
flags = st.booleans()
bitmaps = st.binary(max_size=6)
messages: st.SearchStrategy[Any] = st.one_of(
    st.builds(Heartbeat, stamps, stamps, singles, singles, words, words, octets, words, flags, flags, flags, silent),
    st.builds(Plans, st.lists(plans, min_size=1, max_size=3).map(tuple)),
    st.builds(Status, findings, bitmaps, members, plans),
    st.builds(Hello, words, singles, singles, words, words),
    st.builds(Report, words, words, findings, bitmaps),
    st.builds(Receipt, words),
    st.builds(Assign, words, words, st.lists(words, max_size=5).map(tuple)),
    st.builds(Join, words, singles, singles),
    st.builds(Confirm, words),
    st.builds(Leave, words),
    st.builds(Stop),
    st.builds(Stopped),
    st.builds(Piece, bitmaps),
)


@given(octets, messages)
def test_what_is_encoded_is_decoded(sender: int, message: Message) -> None:
    again = decode(encode(sender, message))
    assert again == (sender, message)
    assert type(again[1]) is type(message)


def test_the_longest_lists_are_decoded() -> None:
    way_m = tuple((float(x), -float(x)) for x in range(255))
    longest = Plan(255, 65_535, 2**32 - 1, FAR_M, way_m)
    found = tuple(Finding(number, FAR_M, -FAR_M) for number in range(255))
    everybody = tuple((member, 65_535) for member in range(255))
    for message in (
        Status(found, bytes(65_535), everybody, longest),
        Plans((longest,) * 255),
        Assign(0, 0, tuple(range(65_535))),
        Report(0, 0, found, bytes(65_535)),
    ):
        assert decode(encode(0, message)) == (0, message)


def test_a_frame_is_decoded_once_for_all_that_hear_it() -> None:
    data = encode(6, GOLDEN[0][0])
    assert decode(data) is decode(bytes(bytearray(data)))


def test_coordinates_are_rounded_by_less_than_eight_micrometres_up_to_256_m() -> None:
    worst = 0.0
    for place in (128.000007, 149.9999999, 200.123456789, 255.99999):
        _, message = decode(encode(6, Join(0, place, 0.0)))
        assert isinstance(message, Join)
        worst = max(worst, abs(message.x_m - place))
    assert 1e-6 < worst <= 7.7e-6


# ---------------------------------------------------------------- what is no frame


def wire_error_or_same(data: bytes) -> None:
    try:
        sender, message = decode(data)
    except WireError:
        return
    assert encode(sender, message) == data


@given(st.binary(max_size=80))
def test_bytes_that_are_no_frame_raise_wire_errors_only(data: bytes) -> None:
    wire_error_or_same(data)


@given(st.integers(0, 14), st.binary(max_size=80))
def test_random_bodies_in_sound_frames_raise_wire_errors_only(kind: int, body: bytes) -> None:
    wire_error_or_same(sealed(bytes((0x41, kind)) + body))


@given(octets, messages, st.data())
def test_a_sound_frame_with_other_bytes_inside_says_just_these_bytes(
    sender: int, message: Message, data: st.DataObject
) -> None:
    body = bytearray(encode(sender, message)[:-2])
    body[data.draw(st.integers(0, len(body) - 1))] = data.draw(octets)
    wire_error_or_same(sealed(bytes(body)))


@given(octets, messages, st.data())
def test_a_frame_with_one_flipped_bit_is_none(sender: int, message: Message, data: st.DataObject) -> None:
    payload = bytearray(encode(sender, message))
    bit = data.draw(st.integers(0, 8 * len(payload) - 1))
    payload[bit // 8] ^= 1 << bit % 8
    with pytest.raises(WireError):
        decode(bytes(payload))


@pytest.mark.parametrize(("message", "golden"), GOLDEN, ids=KINDS)
def test_a_frame_that_is_cut_short_or_followed_by_more_is_none(message: Message, golden: str) -> None:
    body = bytes.fromhex(golden)
    for keep in range(len(body)):
        with pytest.raises(WireError):
            decode(sealed(body[:keep]))
    for tail in (b"\x00", b"\x00\x00", b"\xff\xff\xff"):
        with pytest.raises(WireError, match="were expected"):
            decode(sealed(body + tail))


@given(octets, messages, st.binary(min_size=1, max_size=9))
def test_a_sound_frame_with_a_tail_is_none(sender: int, message: Message, tail: bytes) -> None:
    with pytest.raises(WireError):
        decode(sealed(encode(sender, message)[:-2] + tail))


COORDINATES = [
    ("Heartbeat", 11, 1.0),
    ("Heartbeat", 15, -2.0),
    ("Plans", 16, 1.0),
    ("Plans", 28, 4.0),
    ("Status", 5, 1.0),
    ("Status", 18, 4.0),
    ("Status", 46, 1.0),
    ("Hello", 5, 1.0),
    ("Hello", 9, -2.0),
    ("Report", 9, 1.0),
    ("Report", 22, 4.0),
    ("Join", 5, 1.0),
    ("Join", 9, -2.0),
]
SPEEDS = [("Plans", 11, 0.5), ("Status", 41, 0.5)]


def with_single(kind: str, offset: int, is_now: float, value: float) -> bytes:
    """Return the golden frame of *kind* with *value* instead of the single at *offset*."""
    body = bytearray(bytes.fromhex(GOLDEN[KINDS.index(kind)][1]))
    assert struct.unpack_from(">f", body, offset)[0] == is_now
    struct.pack_into(">f", body, offset, value)
    return sealed(bytes(body))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1_000_001.0, -1_000_001.0])
@pytest.mark.parametrize(("kind", "offset", "is_now"), COORDINATES)
def test_a_place_where_no_robot_is_makes_no_frame(kind: str, offset: int, is_now: float, bad: float) -> None:
    with pytest.raises(WireError, match="no robot"):
        decode(with_single(kind, offset, is_now, bad))
    decode(with_single(kind, offset, is_now, math.copysign(FAR_M, bad)))


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1_000_001.0, -0.5])
@pytest.mark.parametrize(("kind", "offset", "is_now"), SPEEDS)
def test_a_speed_that_no_host_has_makes_no_frame(kind: str, offset: int, is_now: float, bad: float) -> None:
    with pytest.raises(WireError, match="no host goes"):
        decode(with_single(kind, offset, is_now, bad))


@pytest.mark.parametrize("kind", [0, 14, 255])
def test_an_unknown_kind_or_another_magic_makes_no_frame(kind: int) -> None:
    with pytest.raises(WireError, match="not a frame"):
        decode(sealed(bytes((0x41, kind, 6))))
    with pytest.raises(WireError, match="not a frame"):
        decode(sealed(bytes((0x52, 12, 6))))


def test_unknown_flags_a_way_without_points_and_plans_without_a_plan_make_no_frame() -> None:
    heartbeat = bytearray(bytes.fromhex(GOLDEN[0][1]))
    heartbeat[26] |= 8
    with pytest.raises(WireError, match="flags"):
        decode(sealed(bytes(heartbeat)))
    with pytest.raises(WireError, match="no host goes"):
        decode(sealed(bytes.fromhex("41 02 06 01 01 0002 00000bb8 3f000000 00")))
    with pytest.raises(WireError, match="no plan"):
        decode(sealed(bytes.fromhex("41 02 06 00")))


@pytest.mark.parametrize(
    "message",
    [
        Receipt(65_536),
        Receipt(-1),
        Join(0, math.nan, 0.0),
        Join(0, 0.0, 1e39),
        Hello(0, 0.0, math.inf, 0, 0),
        Plans(()),
        Plans((PLAN._replace(way_m=()),)),
        Plans((PLAN._replace(way_m=((0.0, 0.0),) * 256),)),
        Plans((PLAN._replace(way_m=((0.0, math.nan),)),)),
        Plans((PLAN._replace(speed_mps=-0.1),)),
        Plans((PLAN._replace(speed_mps=math.nan),)),
        Plans((PLAN,) * 256),
        Report(0, 0, (Finding(0, 0.0, 2e6),), b""),
        Report(0, 0, FOUND * 128, b""),
        Report(0, 0, (), bytes(65_536)),
        Status((), b"", ((256, 0),), PLAN),
        Assign(0, 0, (65_536,)),
        GOLDEN[0][0]._replace(silent=(256,)),  # type: ignore[call-arg]
        GOLDEN[0][0]._replace(y_m=math.nan),  # type: ignore[call-arg]
    ],
    ids=repr,
)
def test_what_no_frame_can_hold_is_our_own_fault(message: Message) -> None:
    with pytest.raises(LocalProtocolError, match=type(message).__name__):
        encode(6, message)


# ---------------------------------------------------------------- stamps and bitmaps


@given(st.integers(0, 10**18), st.integers(-(2**31) + 1, 2**31 - 1))
def test_a_stamp_means_the_instant_nearest_to_now(now_us: int, apart_ms: int) -> None:
    now = now_us * US
    at = now + apart_ms * MS
    seen = instant(stamp(at), now)
    assert at - MS < seen <= at
    assert seen % MS == 0


def test_stamps_wrap_after_2_to_the_32_ms() -> None:
    assert stamp(CLOCK_MS * MS - 1) == 2**32 - 1
    assert stamp(CLOCK_MS * MS) == 0
    assert instant(2**32 - 1, CLOCK_MS * MS) == CLOCK_MS * MS - MS
    assert instant(0, CLOCK_MS * MS - 1) == CLOCK_MS * MS


@given(st.lists(st.booleans(), max_size=70))
def test_a_bitmap_is_what_numpy_packs_least_significant_bit_first(visited: list[bool]) -> None:
    posts = [post for post, is_visited in enumerate(visited) if is_visited]
    data = bitmap(posts, len(visited))
    assert data == np.packbits(np.array(visited, dtype=bool), bitorder="little").tobytes()
    assert posts_in(data) == frozenset(posts)


def test_post_ten_is_bit_two_of_the_second_byte() -> None:
    assert bitmap([10], 20) == b"\x00\x04\x00"
    assert posts_in(b"\x00\x04\x80") == {10, 23}


@given(st.integers(0, 20), st.integers(-5, 30))
def test_a_bitmap_has_no_room_for_other_posts(count: int, post: int) -> None:
    assume(not 0 <= post < count)
    with pytest.raises(LocalProtocolError, match="no post"):
        bitmap([post], count)
