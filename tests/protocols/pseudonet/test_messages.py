"""Packets on the air: golden bytes, round trips, what is refused, and that each is one Bluetooth packet."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.channels.bluetooth.packets import ACL
from cosim.errors import WireError
from protocols.pseudonet.messages import (
    TRAIL_LIMIT,
    Acknowledgement,
    Action,
    Kind,
    Message,
    Missing,
    Packet,
    Reply,
    Sync,
    Verdict,
    decode,
    encode,
)

FREE = (Verdict.POSSIBLE,) * 4

# The head is source (3 bits), type (2), kind (3), exchange (8); a state goes on with x (12), y (12), action (3), four
# verdicts (3 each) and busy (1). The last two bytes are the CRC, from a bitwise division by x^16 + x^12 + x^5 + 1.
GOLDEN: dict[str, tuple[Packet, str]] = {
    # 101 00 000 | 07 | 025 403 | 001 001 000 010 011 1
    "state": (
        Message(
            5,
            Kind.STATE,
            7,
            0x025,
            0x403,
            Action.EAST,
            (Verdict.WALL, Verdict.POSSIBLE, Verdict.COVERED, Verdict.ROBOT),
            busy=True,
        ),
        "A0 07 025403 2427 C03E",
    ),
    # 000 00 001 | FF | 000 000 | 100 and thirteen zeros
    "help": (Message(0, Kind.HELP, 255, 0, 0, Action.STAY, FREE), "01 FF 000000 8000 0688"),
    # 010 00 010 | FF | 000 000 | 100 100 101 000 000 0 | 0 110 11 FFF 001 and two bits of padding
    "answer": (
        Message(
            2,
            Kind.ANSWER,
            255,
            0,
            0,
            Action.STAY,
            (Verdict.NEARER, Verdict.LOST, Verdict.POSSIBLE, Verdict.POSSIBLE),
            addressee=6,
            reply=Reply.DIRECT,
            target=(4095, 1),
        ),
        "42 FF 000000 9280 6FFFC004 2ED6",
    ),
    # 111 00 011 | 10 | 001 002 | 100 010 010 010 010 0 | 0011 000039 and four bits of padding; 39 is 11 10 01
    "trap": (
        Message(
            7,
            Kind.TRAP,
            16,
            1,
            2,
            Action.STAY,
            (Verdict.COVERED,) * 4,
            trail=(Action.EAST, Action.SOUTH, Action.WEST),
        ),
        "E3 10 001002 8924 30000390 E542",
    ),
    # 001 00 100 | 00 | 00C 022 | 100 and thirteen zeros
    "stop": (Message(1, Kind.STOP, 0, 12, 34, Action.STAY, FREE), "24 00 00C022 8000 1E64"),
    # 100 00 101 | 03 | 001 002 | 100 and thirteen zeros | DEADBEEF
    "roll": (Message(4, Kind.ROLL, 3, 1, 2, Action.STAY, FREE, digest=0xDEADBEEF), "85 03 001002 8000 DEADBEEF 2844"),
    # 011 00 110 | 04 | 001 002 | 100 and thirteen zeros | 00A 5A F0 and four bits of padding
    "map": (
        Message(3, Kind.MAP, 4, 1, 2, Action.STAY, FREE, chunk=10, marks=b"\x5a\xf0"),
        "66 04 001002 8000 00A5AF00 B43A",
    ),
    # 000 01 111 | 01 | 1000 0101 | 1, 2A96EF25, 0ABCDEF (28 bits) and three bits of padding
    "synchronisation": (
        Sync(0, 1, (0, 2, 7), True, 0x2A96EF25, 0x0ABCDEF),
        "0F 01 85 954B7792855E6F78 C9A2",
    ),
    # 000 10 111 | 09
    "acknowledgement": (Acknowledgement(0, 9), "17 09 16C2"),
    # 000 11 111 | 09
    "negative acknowledgement": (Acknowledgement(0, 9, negative=True), "1F 09 9F6B"),
    # 110 11 000 | 09 | 0010 0101
    "missing": (Missing(6, 9, (0, 2, 5)), "D8 09 25 CEF6"),
}


def closed(body: bytes) -> bytes:
    """Append the CRC, computed one bit at a time."""
    crc = 0xFFFF
    for byte in body:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 & 0xFFFF) ^ (0x1021 if crc >> 15 else 0)
    return body + crc.to_bytes(2, "big")


_actions = st.sampled_from(Action)
_verdicts = st.tuples(*[st.sampled_from(Verdict)] * 4)


@st.composite
def messages(draw: st.DrawFn) -> Message:
    """Any message that has only what its kind carries."""
    kind = draw(st.sampled_from([kind for kind in Kind if kind != Kind.NONE]))
    more: dict[str, Any] = {}
    if kind == Kind.ANSWER:
        addressee = draw(st.none() | st.integers(0, 7))
        target = draw(st.tuples(st.integers(0, 4095), st.integers(0, 4095)))
        more = {"addressee": addressee, "reply": draw(st.sampled_from(Reply)), "target": target}
    elif kind == Kind.TRAP:
        steps = st.sampled_from([action for action in Action if action != Action.STAY])
        more = {"trail": tuple(draw(st.lists(steps, max_size=TRAIL_LIMIT)))}
    elif kind == Kind.ROLL:
        more = {"digest": draw(st.integers(0, 2**32 - 1))}
    elif kind == Kind.MAP:
        more = {"chunk": draw(st.integers(0, 4095)), "marks": draw(st.binary(max_size=5))}
    return Message(
        draw(st.integers(0, 7)),
        kind,
        draw(st.integers(0, 255)),
        draw(st.integers(0, 4095)),
        draw(st.integers(0, 4095)),
        draw(_actions),
        draw(_verdicts),
        draw(st.booleans()),
        **more,
    )


_syncs = st.builds(
    Sync,
    st.integers(0, 7),
    st.integers(0, 255),
    st.sets(st.integers(0, 7)).map(lambda members: tuple(sorted(members))),
    st.booleans(),
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**28 - 1),
)
_acknowledgements = st.builds(Acknowledgement, st.integers(0, 7), st.integers(0, 255), st.booleans())
_missing = st.builds(
    Missing,
    st.integers(0, 7),
    st.integers(0, 255),
    st.sets(st.integers(0, 7)).map(lambda robots: tuple(sorted(robots))),
)
packets = messages() | _syncs | _acknowledgements | _missing


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_bytes(name: str) -> None:
    packet, golden = GOLDEN[name]
    assert encode(packet) == bytes.fromhex(golden)
    assert decode(bytes.fromhex(golden)) == packet


@given(packets)
def test_what_was_encoded_is_decoded_to_the_same(packet: Packet) -> None:
    assert decode(encode(packet)) == packet


@given(packets)
def test_every_packet_fits_one_dm1_packet(packet: Packet) -> None:
    assert len(encode(packet)) <= ACL["DM1"].capacity == 17


@given(st.binary(max_size=40))
def test_arbitrary_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(WireError):
        decode(data)


@given(st.binary(min_size=1, max_size=15))
def test_bytes_with_a_right_crc_are_a_packet_or_are_refused(body: bytes) -> None:
    data = closed(body)
    try:
        packet = decode(data)
    except WireError:
        return
    assert encode(packet) == data


@pytest.mark.parametrize(
    ("golden", "reason"),
    [
        ("05 00 000000 8000", "9 bytes where 13 were expected"),
        ("06 00 000000 8000", "9 bytes where at least 11 were expected"),
        ("07 00 000000 8000", "no packet has type 0 with message kind 7"),
        ("00 00 000000 A000", "5 is not a valid Action"),
        ("00 00 000000 9800", "6 is not a valid Verdict"),
        ("00 00 000000 80", "8 bytes where 9 were expected"),
        ("08 00 01 0000000000000000", "nobody encodes so"),
        ("11 00", "nobody encodes so"),
        ("03 00 000000 8000 D0000000", "nobody encodes so"),
    ],
    ids=[
        "no digest",
        "no map",
        "no message",
        "action",
        "verdict",
        "length",
        "sync with a kind",
        "ack with a kind",
        "long trail",
    ],
)
def test_what_nobody_encodes_is_refused(golden: str, reason: str) -> None:
    body = bytes.fromhex(golden)
    with pytest.raises(WireError, match=reason):
        decode(closed(body))


@pytest.mark.parametrize(
    "packet",
    [
        Message(8, Kind.STATE, 0, 0, 0, Action.STAY, FREE),
        Message(0, Kind.STATE, 256, 0, 0, Action.STAY, FREE),
        Message(0, Kind.STATE, 0, 4096, 0, Action.STAY, FREE),
        Message(0, Kind.TRAP, 0, 0, 0, Action.STAY, FREE, trail=(Action.NORTH,) * (TRAIL_LIMIT + 1)),
        Message(0, Kind.TRAP, 0, 0, 0, Action.STAY, FREE, trail=(Action.STAY,)),
        Sync(0, 0, (8,), False),
        Acknowledgement(0, -1),
    ],
)
def test_values_without_room_are_refused(packet: Packet) -> None:
    with pytest.raises(WireError):
        encode(packet)


def test_fewer_possible_actions_are_more_constricted() -> None:
    wall = (Verdict.WALL, Verdict.POSSIBLE, Verdict.COVERED, Verdict.NEARER)
    assert Message(0, Kind.HELP, 0, 0, 0, Action.EAST, wall).constricted() == 1
    assert Message(0, Kind.HELP, 0, 0, 0, Action.EAST, FREE).constricted() == 4


def test_a_message_says_in_words_what_it_carries() -> None:
    message = GOLDEN["state"][0]
    assert str(message) == "exchange 7, at (37, 1027), east, north: wall, south: covered, west: robot, busy"
