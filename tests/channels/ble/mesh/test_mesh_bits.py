"""What is in packets of Bluetooth Mesh: sample data of the specification (section 8.3), as far as they need no keys."""

from itertools import product
from typing import Final

import pytest

from cosim.channels.ble.bits.mesh.bearer import decode_bearer, encode_bearer
from cosim.channels.ble.bits.mesh.lower_transport import (
    LowerPdu,
    Segment,
    Whole,
    decode_lower,
    encode_lower,
    segments,
)
from cosim.channels.ble.bits.mesh.network import NetworkPdu, decode_network, encode_network
from cosim.channels.ble.bits.mesh.upper_transport import LONGEST_PAYLOAD, decode_upper, encode_upper
from cosim.channels.ble.broadcasts.inbox import Inbox
from cosim.channels.ble.broadcasts.mesh import parts
from cosim.errors import WireError
from cosim.machine import BROADCAST, Outgoing
from cosim.units import MS, S

MESSAGE_6: Final = "ee9dddfd2169326d23f3afdf cfdc18c52fdef772e0e17308"
"""The upper transport PDU of message #6, as segments: SEQ 3129ab, SRC 0003, DST 1201, TTL 4, NID 68."""
SAMPLES: Final[list[tuple[NetworkPdu, str, str]]] = [
    # message #1, a control message; its octets in the clear, by the fields that are printed there
    (
        NetworkPdu(0, 0x000001, 0x1201, 0xFFFD, bytes.fromhex("034b50057e400000010000"), True, 0x68),
        "68 80 000001 1201 fffd",
        "0000000000000000",
    ),
    (
        NetworkPdu(4, 0x3129AB, 0x0003, 0x1201, bytes.fromhex("8026ac01ee9dddfd2169326d23f3afdf"), nid=0x68),
        "68 04 3129ab 0003 1201",
        "00000000",
    ),
    # message #22, IV Index 12345677: IVI is set
    (
        NetworkPdu(3, 0x07080B, 0x1234, 0xB529, bytes.fromhex("663871b904d431526316ca48a0"), nid=0x68, ivi=1),
        "e8 03 07080b 1234 b529",
        "00000000",
    ),
]


@pytest.mark.parametrize(("pdu", "header", "mic"), SAMPLES)
def test_network_pdus_have_the_layout_of_the_sample_data(pdu: NetworkPdu, header: str, mic: str) -> None:
    octets = bytes.fromhex(header) + pdu.transport + bytes.fromhex(mic)
    assert encode_network(pdu) == octets
    assert decode_network(octets) == pdu
    assert decode_network(octets[:-1] + b"\x55") == pdu  # the check is not looked at
    assert decode_bearer(encode_bearer(octets)) == octets
    assert encode_bearer(octets)[:2] == bytes([1 + len(octets), 0x2A])


def test_segments_are_those_of_the_sample_data() -> None:
    """Message #6: its two lower transport PDUs, from its upper one and the sequence number."""
    upper = bytes.fromhex(MESSAGE_6)
    made = segments(upper, 0x3129AB)
    assert [encode_lower(each).hex() for each in made] == [
        "8026ac01ee9dddfd2169326d23f3afdf",
        "8026ac21cfdc18c52fdef772e0e17308",
    ]
    assert made == [Segment(0x9AB, 0, 1, upper[:12]), Segment(0x9AB, 1, 1, upper[12:])]


@pytest.mark.parametrize(
    ("octets", "pdu"),
    [
        ("663871b904d431526316ca48a0", Whole(bytes.fromhex("3871b904d431526316ca48a0"), 0x26)),  # message #22
        (  # message #24, its first segment: TransMIC has 64 bits
            "e6a03401c3c51d8e476b28e3aa5001f3",
            Segment(0x80D, 0, 1, bytes.fromhex("c3c51d8e476b28e3aa5001f3"), 0x26, True),
        ),
        ("00" + "11" * 5, Whole(b"\x11" * 5)),
        ("e6ffffffaa", Segment(0x1FFF, 31, 31, b"\xaa", 0x26, True)),
    ],
)
def test_lower_transport_pdus_have_the_layout_of_the_specification(octets: str, pdu: LowerPdu) -> None:
    assert decode_lower(bytes.fromhex(octets)) == pdu
    assert encode_lower(pdu).hex() == octets


@pytest.mark.parametrize(
    ("octets", "why"),
    [
        ("", "0 octets are no network PDU"),
        ("68 04 3129ab 0003 1201 00000000", "a transport PDU of 0 octets"),
        ("68 80 3129ab 0003 1201 ff 00000000000000", "a transport PDU of 0 octets"),
        ("68 04 3129ab 0000 1201 ff 00000000", "from 0x0000"),
        ("68 04 3129ab 8000 1201 ff 00000000", "from 0x8000"),
        ("68 04 3129ab 0003 0000 ff 00000000", "to 0x0000"),
        ("68 04 3129ab 0003 1201" + "00" * 21, "30 octets"),
        ("68 80 3129ab 0003 1201" + "00" * 21, "30 octets"),
    ],
)
def test_what_is_no_network_pdu_is_refused(octets: str, why: str) -> None:
    with pytest.raises(WireError, match=why):
        decode_network(bytes.fromhex(octets))


@pytest.mark.parametrize(
    "octets", ["", "00 11223344", "00" * 17, "80 00ac", "80 26ac01", "80 26ac01 00", "80 26ac20" + "00" * 12]
)
def test_what_is_no_lower_transport_pdu_is_refused(octets: str) -> None:
    with pytest.raises(WireError):
        decode_lower(bytes.fromhex(octets))


@pytest.mark.parametrize("data", ["", "00", "01 2a", "02 2a", "03 2a 00", "02 2b 00", "1f 2a" + "00" * 31])
def test_what_is_no_structure_of_a_mesh_message_is_refused(data: str) -> None:
    if data == "01 2a":
        assert decode_bearer(bytes.fromhex(data)) == b""
        return
    with pytest.raises(WireError):
        decode_bearer(bytes.fromhex(data))


@pytest.mark.parametrize(
    "pdu",
    [
        SAMPLES[1][0]._replace(**change)
        for change in (
            *({"ttl": ttl} for ttl in (-1, 128)),
            *({"sequence": sequence} for sequence in (-1, 1 << 24)),
            *({"source": source} for source in (0, 0x8000)),
            *({"transport": bytes(size)} for size in (0, 17)),
            {"transport": bytes(13), "control": True},
            {"nid": 128},
            {"ivi": 2},
            {"destination": 0x10000},
        )
    ],
)
def test_what_does_not_fit_is_not_encoded(pdu: NetworkPdu) -> None:
    with pytest.raises(ValueError, match="PDU"):
        encode_network(pdu)


def test_a_payload_has_as_many_segments_as_its_octets_need() -> None:
    """Opcode and TransMIC, 3 and 4 octets, go with it; 15 fit unsegmented, then there are 12 in each of 32 segments."""
    for size in range(LONGEST_PAYLOAD + 1):
        payload = bytes(at % 251 for at in range(size))
        made = segments(encode_upper(payload), 5)
        total = 3 + size + 4
        assert len(made) == (1 if total <= 15 else -(-total // 12))
        data = b"".join(each.upper if isinstance(each, Whole) else each.data for each in made)
        assert decode_upper(data) == payload
        queued = list(parts(2, 7, 5, Outgoing(BROADCAST, payload)))
        assert sum(each.length for each in queued) == size
        assert all(0 <= each.length <= 12 for each in queued)
        assert [each.pdu.sequence for each in queued] == list(range(5, 5 + len(made)))
        assert {(each.pdu.source, each.pdu.destination, each.pdu.ttl) for each in queued} == {(3, 0xFFFF, 7)}
        assert max(len(encode_network(each.pdu)) for each in queued) <= 29
    assert (LONGEST_PAYLOAD, len(made)) == (32 * 12 - 4 - 3, 32)
    with pytest.raises(ValueError, match="378"):
        encode_upper(bytes(LONGEST_PAYLOAD + 1))


# ---------------------------------------------------------------- what a node makes of them


def pdus(number: int, payload: bytes, source: int = 0) -> list[NetworkPdu]:
    return [each.pdu for each in parts(source, 7, number, Outgoing(BROADCAST, payload))]


def test_segments_in_any_order_make_a_payload_once() -> None:
    payload = bytes(range(60))
    made = pdus(8_190, payload)  # SeqZero wraps within it
    assert len(made) == 6
    for order in (made, made[::-1], made[3:] + made[:3], [each for each in made for _ in range(3)]):
        inbox = Inbox()
        taken = [inbox.take(each, turn) for turn, each in enumerate((*order, *order))]
        assert [each for each in taken if each is not None] == [payload]


def test_a_segment_that_is_sent_anew_with_another_sequence_number_is_of_the_same_message() -> None:
    inbox, (first, second, third) = Inbox(), pdus(8_190, bytes(20))
    assert [inbox.take(each, 0) for each in (third, first)] == [None, None]
    assert inbox.take(second._replace(sequence=8_190 + 700), 0) == bytes(20)


@pytest.mark.parametrize("missing", range(6))
def test_a_payload_of_which_a_segment_is_missing_never_comes(missing: int) -> None:
    inbox, made = Inbox(), pdus(0, bytes(60))
    assert {inbox.take(each, 0) for at, each in enumerate(made) if at != missing} == {None}
    assert inbox.take(made[missing], 1) == bytes(60)


@pytest.mark.parametrize(("late", "comes"), [(10 * S - 1, True), (10 * S, False)])
def test_what_is_not_whole_is_forgotten_ten_seconds_after_its_last_new_segment(late: int, comes: bool) -> None:
    inbox, (first, second, third) = Inbox(), pdus(0, bytes(20))
    inbox.take(first, 0)
    inbox.take(second, 7 * S)
    inbox.take(second, 8 * S)  # nothing new
    assert (inbox.take(third, 7 * S + late) is not None) == comes


def test_a_message_that_another_has_overtaken_is_lost_and_other_sources_do_not_matter() -> None:
    inbox = Inbox()
    (old,), segmented, (new,) = pdus(0, b"old"), pdus(1, bytes(20)), pdus(4, b"new")
    assert [inbox.take(each, 0) for each in segmented[:2]] == [None, None]
    assert inbox.take(pdus(0, b"other", source=1)[0], 0) == b"other"
    assert inbox.take(new, 0) == b"new"
    assert [inbox.take(each, 0) for each in (new, old, segmented[2])] == [None, None, None]


def test_a_newer_message_in_segments_takes_the_place_of_one_that_is_not_whole() -> None:
    inbox, old, new = Inbox(), pdus(0, bytes(20)), pdus(3, bytes(range(20)))
    order = (old[0], old[1], new[0], old[2], new[1], new[2])
    assert [inbox.take(each, 0) for each in order] == [None] * 5 + [bytes(range(20))]


def test_control_messages_are_no_payloads_and_strange_ones_are_refused() -> None:
    inbox = Inbox()
    assert inbox.take(SAMPLES[0][0], MS) is None
    for sample in SAMPLES[2:]:
        with pytest.raises(WireError):
            inbox.take(sample[0], MS)


def test_every_segment_has_its_place_in_the_header() -> None:
    for seq_zero, last in product((0, 1, 0x1555, 0x1FFF), (0, 1, 21, 31)):
        for number in range(last + 1):
            segment = Segment(seq_zero, number, last, bytes(12))
            word = int.from_bytes(encode_lower(segment)[1:4], "big")
            assert word == seq_zero * 1024 + number * 32 + last
            assert decode_lower(encode_lower(segment)) == segment
