"""Frames of transports: golden bytes, there and back, and what is none."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import LocalProtocolError, WireError
from protocols.transport.frames import (
    ALL,
    LEAST_OCTETS,
    PART_OVERHEAD,
    PUBLICATION_OVERHEAD,
    Ack,
    Body,
    Frame,
    Part,
    Publication,
    decode,
    encode,
    incarnation_of,
)


def crc_by_bits(data: bytes) -> int:
    """CRC-CCITT, polynomial 0x1021, initial value 0xFFFF, bit by bit."""
    value = 0xFFFF
    for byte in data:
        for bit in range(7, -1, -1):
            top = value >> 15 ^ byte >> bit & 1
            value = value << 1 & 0xFFFF ^ (0x1021 if top else 0)
    return value


def sealed(body: str) -> bytes:
    data = bytes.fromhex(body)
    return data + crc_by_bits(data).to_bytes(2, "big")


GOLDEN: list[tuple[Frame, str]] = [
    (Frame(3, 6, 70_000, Part(258, 256, 2, 7, b"\x01\x02")), "4c 01 03 06 00011170 00000102 00000100 0002 0007 0102"),
    (Frame(0, 1, 0, Part(0, 0, 0, 1, b"")), "4c 01 00 01 00000000 00000000 00000000 0000 0001"),
    (Frame(6, 3, 1, Ack(70_000, 259, 0x80000001)), "4c 02 06 03 00000001 00011170 00000103 80000001"),
    (Frame(2, ALL, 70_000, Publication(5, 65_536, b"here")), "4c 03 02 ff 00011170 05 00010000 68657265"),
]


@pytest.mark.parametrize(("frame", "body"), GOLDEN)
def test_each_frame_has_its_bytes(frame: Frame, body: str) -> None:
    assert encode(frame) == sealed(body)
    assert decode(sealed(body)) == frame


WORD = st.integers(0, 2**32 - 1)
SHORT = st.integers(0, 2**16 - 1)
ADDRESS = st.integers(0, 254)


@st.composite
def parts(draw: st.DrawFn) -> Part:
    place = draw(st.integers(0, 2**16 - 2))
    number = draw(st.integers(place, 2**32 - 1))
    oldest = draw(st.integers(0, number))
    return Part(number, oldest, place, draw(st.integers(place + 1, 2**16 - 1)), draw(st.binary(max_size=300)))


ANY = st.one_of(
    parts(), st.builds(Ack, WORD, WORD, WORD), st.builds(Publication, st.integers(0, 255), WORD, st.binary())
)


@given(st.lists(ADDRESS, min_size=2, max_size=2, unique=True), WORD, ANY)
def test_frames_decode_to_equal_frames(pair: list[int], incarnation: int, body: Body) -> None:
    frame = Frame(pair[0], ALL if isinstance(body, Publication) else pair[1], incarnation, body)
    assert decode(encode(frame)) == frame


@given(st.binary(max_size=40), st.booleans())
def test_bytes_that_are_no_frame_are_refused_with_a_wire_error(junk: bytes, seal: bool) -> None:
    """Whatever decodes, on the other hand, is just what is encoded."""
    data = junk + crc_by_bits(junk).to_bytes(2, "big") if seal else junk
    try:
        frame = decode(data)
    except WireError:
        return
    assert encode(frame) == data


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ("4c", "too short"),
        ("45 01 00 01 00000000 00000000 00000000 0000 0001", "magic 0x45"),
        ("4c 04 00 01 00000000 00000000", "kind 4"),
        ("4c 01 00 01 00000000 00000000 00000000 0000 00", "11 bytes in a frame of kind 1"),
        ("4c 02 00 01 00000000 00000000 00000000 00000000 00", "13 bytes in a frame of kind 2"),
        ("4c 03 00 ff 00000000 00 000000", "4 bytes in a frame of kind 3"),
        ("4c 01 00 01 00000000 00000000 00000000 0000 0000", "means nothing"),  # no parts
        ("4c 01 00 01 00000000 00000001 00000000 0002 0003", "means nothing"),  # begins before the first
        ("4c 01 00 01 00000000 00000001 00000002 0000 0001", "means nothing"),  # nobody stands by it
        ("4c 01 01 01 00000000 00000000 00000000 0000 0001", "means nothing"),  # to itself
        ("4c 01 00 ff 00000000 00000000 00000000 0000 0001", "means nothing"),  # a message to all
        ("4c 02 ff 00 00000000 00000000 00000000 00000000", "means nothing"),  # from all
        ("4c 03 00 01 00000000 00 00000000", "means nothing"),  # news to one
        ("4c 03 ff ff 00000000 00 00000000", "means nothing"),
    ],
)
def test_what_means_nothing_is_refused(body: str, why: str) -> None:
    with pytest.raises(WireError, match=why):
        decode(sealed(body))


@pytest.mark.parametrize(
    "frame",
    [
        Frame(256, 0, 0, Ack(0, 0, 0)),
        Frame(0, 1, 2**32, Ack(0, 0, 0)),
        Frame(0, 1, 0, Part(0, 0, 0, 65_536, b"")),
        Frame(0, 1, 0, Publication(0, 0, b"")),
        Frame(0, 0, 0, Part(0, 0, 0, 1, b"")),
    ],
)
def test_what_no_frame_can_say_is_our_own_mistake(frame: Frame) -> None:
    with pytest.raises(LocalProtocolError):
        encode(frame)


def test_any_changed_bit_is_noticed() -> None:
    data = encode(GOLDEN[0][0])
    for bit in range(8 * len(data)):
        wrong = bytearray(data)
        wrong[bit // 8] ^= 1 << bit % 8
        with pytest.raises(WireError):
            decode(bytes(wrong))


def test_overheads_are_what_frames_have_beyond_their_payloads() -> None:
    assert len(encode(Frame(0, 1, 0, Part(0, 0, 0, 1, b"")))) == PART_OVERHEAD
    assert len(encode(Frame(0, ALL, 0, Publication(0, 0, b"")))) == PUBLICATION_OVERHEAD
    assert len(encode(Frame(0, 1, 0, Ack(0, 0, 0)))) <= LEAST_OCTETS


def test_incarnations_are_milliseconds_of_the_clock() -> None:
    assert incarnation_of(1_999_999) == 1
    assert incarnation_of((2**32 + 5) * 1_000_000) == 5
