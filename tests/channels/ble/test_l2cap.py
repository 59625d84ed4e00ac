"""L2CAP messages in fragments, and control PDUs, as octets."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.channels.ble.bits.control import (
    LAYOUTS,
    ChannelMapInd,
    ConnectionUpdateInd,
    Control,
    Lengths,
    Phys,
    PhyUpdateInd,
    TerminateInd,
    decode_control,
    encode_control,
)
from cosim.channels.ble.bits.l2cap import Message, Reassembly, fragments
from cosim.channels.ble.bits.pdu import Llid
from cosim.channels.ble.connections.arq import Fragment
from cosim.channels.ble.connections.channel_map import ChannelMap
from cosim.channels.ble.connections.parameters import ConnectionParameters, TransmitWindow
from cosim.errors import WireError

US, MS = 1_000, 1_000_000


def test_a_message_has_a_header_of_length_and_channel():
    assert fragments(Message(4, b"\x1b\x2a\x00hi"), 27, "it") == [
        Fragment(Llid.START, b"\x05\x00\x04\x00\x1b\x2a\x00hi", "it")
    ]


@pytest.mark.parametrize(
    ("octets", "lengths"), [(0, [4]), (23, [27]), (24, [27, 1]), (50, [27, 27]), (51, [27, 27, 1])]
)
def test_fragments_are_as_long_as_they_may_be(octets: int, lengths: list[int]):
    cut = fragments(Message(4, bytes(octets)), 27, "it")
    assert [len(fragment.payload) for fragment in cut] == lengths
    assert [fragment.llid for fragment in cut] == [Llid.START] + [Llid.CONTINUATION] * (len(cut) - 1)
    assert [fragment.token for fragment in cut] == [None] * (len(cut) - 1) + ["it"]


@given(st.binary(max_size=2_000), st.integers(0, 65_535), st.integers(27, 251))
def test_fragments_make_the_message_again(information: bytes, channel: int, longest: int):
    reassembly, message = Reassembly(), Message(channel, information)
    for _ in range(2):
        results = [reassembly.take(fragment) for fragment in fragments(message, longest)]
        assert results == [None] * (len(results) - 1) + [message]


def test_what_does_not_fit_is_misuse():
    assert len(fragments(Message(4, bytes(65_535)), 251)) == -(-65_539 // 251)
    for octets, longest in ((65_536, 251), (1, 26), (1, 252)):
        with pytest.raises(ValueError, match="octets"):
            fragments(Message(4, bytes(octets)), longest)


FIRST = Fragment(Llid.START, b"\x02\x00\x04\x00a")


@pytest.mark.parametrize(
    "bad",
    [
        [Fragment(Llid.CONTINUATION, b"a")],
        [FIRST, FIRST],
        [FIRST, Fragment(Llid.START, b"b")],
        [FIRST, Fragment(Llid.CONTINUATION, b"bc")],
        [Fragment(Llid.START, b"\x00\x00\x04\x00a")],
        [Fragment(Llid.CONTROL, b"\x02\x13")],
    ],
)
def test_fragments_that_do_not_belong_together_are_a_decoding_error(bad: list[Fragment]):
    reassembly = Reassembly()
    for fragment in bad[:-1]:
        assert reassembly.take(fragment) is None
    with pytest.raises(WireError):
        reassembly.take(bad[-1])
    with pytest.raises(WireError):
        reassembly.take(Fragment(Llid.CONTINUATION, b"b"))  # nothing of the old message is left
    assert reassembly.take(FIRST) is None
    assert reassembly.take(Fragment(Llid.CONTINUATION, b"b")) == Message(4, b"ab")


@given(st.lists(st.tuples(st.sampled_from(list(Llid)), st.binary(max_size=8))))
def test_any_fragments_raise_nothing_else(pieces: list[tuple[Llid, bytes]]):
    reassembly = Reassembly()
    for llid, payload in pieces:
        try:
            message = reassembly.take(Fragment(llid, payload))
        except WireError:
            continue
        assert message is None or isinstance(message, Message)


# ---------------------------------------------------------------- control PDUs

GOLDEN: list[tuple[str, Control]] = [
    # LL_CONNECTION_UPDATE_IND: WinSize, WinOffset, Interval, Latency, Timeout, Instant
    (
        "00 02 0400 1800 0300 c800 3412",
        ConnectionUpdateInd(TransmitWindow(2_500 * US, 5 * MS), ConnectionParameters(30 * MS, 3, 2_000 * MS), 0x1234),
    ),
    ("01 17 44 00 ff 05 ffff", ChannelMapInd(ChannelMap((0, 1, 2, 4, 10, 14, *range(24, 33), 34)), 65_535)),
    ("02 13", TerminateInd()),
    ("14 fb00 4808 1b00 4808", Lengths(False, 251, 2_120 * US, 27, 2_120 * US)),
    ("15 1b00 4801 fb00 9042", Lengths(True, 27, 328 * US, 251, 17_040 * US)),
    ("16 02 03", Phys(False, 2, 3)),
    ("17 04 01", Phys(True, 4, 1)),
    ("18 02 00 0001", PhyUpdateInd(2, 0, 256)),
]
"""The fields are those of Vol 6 Part B, 2.4.2; the map is a public test's, the first lengths a public decoder's."""


@pytest.mark.parametrize(("octets", "pdu"), GOLDEN)
def test_control_pdus_have_their_golden_octets(octets: str, pdu: Control):
    payload = bytes.fromhex(octets)
    assert encode_control(pdu) == Fragment(Llid.CONTROL, payload)
    assert decode_control(payload) == pdu
    for wrong in (payload[:-1], payload + b"\0"):
        with pytest.raises(WireError):
            decode_control(wrong)


def test_every_known_control_pdu_has_a_golden_one():
    assert {int(octets[:2], 16) for octets, _ in GOLDEN} == set(LAYOUTS)


@pytest.mark.parametrize(
    "octets",
    [
        "",
        "07 00",
        "00 02 0400 0500 0300 c800 3412",  # an interval of 6.25 ms
        "00 00 0400 1800 0300 c800 3412",  # no window
        "00 02 1900 1800 0300 c800 3412",  # an offset of more than an interval
        "00 02 0400 1800 f301 c800 3412",  # a timeout that the latency does not allow
        "01 01 00 00 00 00 0900",  # one channel
        "14 1a00 4808 1b00 4808",
        "14 fb00 4701 1b00 4808",
        "16 00 01",
        "16 08 01",  # reserved bits only
        "18 03 00 0001",
    ],
)
def test_bad_control_pdus_are_a_decoding_error(octets: str):
    with pytest.raises(WireError):
        decode_control(bytes.fromhex(octets))


@given(st.binary(max_size=14))
def test_any_control_octets_raise_nothing_else(payload: bytes):
    try:
        pdu = decode_control(payload)
    except WireError:
        return
    assert decode_control(encode_control(pdu).payload) == pdu


@pytest.mark.parametrize("pdu", [TerminateInd(256), PhyUpdateInd(1, 1, -1), ChannelMapInd(ChannelMap((1, 2)), 65_536)])
def test_values_that_do_not_fit_are_misuse(pdu: Control):
    with pytest.raises(ValueError, match="Ind"):
        encode_control(pdu)
