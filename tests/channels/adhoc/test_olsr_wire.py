"""OLSR's octets, times and numbers, as RFC 3626 lays them out."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cosim.channels.adhoc.routing.olsr_wire import (
    HELLO,
    TC,
    Hello,
    Message,
    Tc,
    decode_hello,
    decode_packet,
    decode_tc,
    decode_time,
    encode_hello,
    encode_packet,
    encode_tc,
    encode_time,
    link_code,
    link_types,
    newer,
)
from cosim.errors import WireError
from cosim.units import MS, S

HELLO_OCTETS = bytes.fromhex(
    "00 00 05 03"  # reserved, Htime 2 s, willingness 3
    "0a 00 00 08 0a 00 00 02"  # MPR_NEIGH (2) and SYM_LINK (2): 4 * 2 + 2; reserved; 8 octets; robot 1
    "01 00 00 0c 0a 00 00 03 0a 00 01 01"  # NOT_NEIGH and ASYM_LINK; 12 octets; robots 2 and 250
)
TC_OCTETS = bytes.fromhex("01 02 00 00 0a 00 00 02 0a 00 00 04")  # ANSN, reserved, robots 1 and 3
PACKET_OCTETS = bytes.fromhex(
    "00 40 00 07"  # 64 octets; number 7
    "01 86 00 24 0a 00 00 01 01 00 12 34" + HELLO_OCTETS.hex() +  # HELLO, 6 s, 36 octets, robot 0, ttl 1, 0 hops
    "02 e7 00 18 0a 00 00 05 fe 01 ff ff" + TC_OCTETS.hex()  # TC, 15 s, 24 octets, robot 4, ttl 254, 1 hop
)  # fmt: skip
A_HELLO = Hello(2 * S, 3, {10: [1], 1: [2, 250]})
A_TC = Tc(0x0102, [1, 3])
MESSAGES = [
    Message(HELLO, 6 * S, 0, 1, 0, 0x1234, HELLO_OCTETS),
    Message(TC, 15 * S, 4, 254, 1, 0xFFFF, TC_OCTETS),
]


def test_a_hello_has_these_octets() -> None:
    assert encode_hello(A_HELLO) == HELLO_OCTETS
    assert decode_hello(HELLO_OCTETS) == A_HELLO


def test_a_tc_has_these_octets() -> None:
    assert encode_tc(A_TC) == TC_OCTETS
    assert decode_tc(TC_OCTETS) == A_TC


def test_a_packet_has_these_octets() -> None:
    assert encode_packet(7, MESSAGES) == PACKET_OCTETS
    assert decode_packet(PACKET_OCTETS) == (7, MESSAGES)


@pytest.mark.parametrize(("seconds", "a", "b"), [(2, 0, 5), (6, 8, 6), (15, 14, 7), (30, 14, 8)])
def test_times_are_those_that_section_18_3_gives_as_examples(seconds: int, a: int, b: int) -> None:
    assert encode_time(seconds * S) == 16 * a + b
    assert decode_time(16 * a + b) == seconds * S


def test_every_octet_is_a_time_of_its_own_by_the_formula() -> None:
    for octet in range(256):
        assert decode_time(octet) == round(1e9 / 16 * (1 + (octet >> 4) / 16) * 2 ** (octet & 15))
        assert encode_time(decode_time(octet)) == octet


@example(2 * S - 1)
@given(st.integers(S // 16, 3968 * S))
def test_a_time_is_rounded_up_to_the_next_that_there_is(time: int) -> None:
    assert 0 <= encode_time(time) <= 255
    assert decode_time(encode_time(time)) == min(each for each in map(decode_time, range(256)) if each >= time)


@pytest.mark.parametrize("time", [62 * MS, 3969 * S])
def test_times_that_cannot_be_told_are_refused(time: int) -> None:
    with pytest.raises(ValueError, match="is not in"):
        encode_time(time)


def test_link_codes_that_are_unknown_or_contradict_themselves_are_ignored() -> None:
    known = {code: types for code in range(256) if (types := link_types(code)) is not None}
    assert len(known) == 11  # 4 links times 3 neighbours, but no symmetric link to who is no neighbour
    assert 2 not in known
    assert all(link_code(*types) == code for code, types in known.items())


@pytest.mark.parametrize(
    ("one", "other", "later"), [(2, 1, True), (1, 2, False), (1, 1, False), (0, 65535, True), (65535, 0, False)]
)
def test_numbers_wrap_around(one: int, other: int, later: bool) -> None:
    assert newer(one, other) is later


@pytest.mark.parametrize(
    ("octets", "why"),
    [
        ("00 04 00", "no OLSR packet"),
        ("00 05 00 01", "claims 5"),
        ("00 06 00 01 01 86", "cut off"),
        ("00 10 00 01 01 86 00 0b 0a 00 00 01 01 00 00 01", "11 octets at 4"),
        ("00 10 00 01 01 86 00 0d 0a 00 00 01 01 00 00 01", "13 octets at 4"),
        ("00 10 00 01 01 86 00 0c ff ff ff ff 01 00 00 01", "no node"),
    ],
)
def test_what_is_no_packet_is_refused(octets: str, why: str) -> None:
    with pytest.raises(WireError, match=why):
        decode_packet(bytes.fromhex(octets))


@pytest.mark.parametrize(
    ("octets", "why"),
    [
        ("00 00 05", "no HELLO"),
        ("00 00 05 08", "willingness 8"),
        ("00 00 05 03 0a 00 00", "cut off"),
        ("00 00 05 03 0a 00 00 03", "3 octets at 4"),
        ("00 00 05 03 0a 00 00 08", "8 octets at 4"),
        ("00 00 05 03 0a 00 00 06 0a 00", "no addresses"),
    ],
)
def test_what_is_no_hello_is_refused(octets: str, why: str) -> None:
    with pytest.raises(WireError, match=why):
        decode_hello(bytes.fromhex(octets))


@pytest.mark.parametrize(("octets", "why"), [("01 02 00", "no TC"), ("01 02 00 00 0a", "no addresses")])
def test_what_is_no_tc_is_refused(octets: str, why: str) -> None:
    with pytest.raises(WireError, match=why):
        decode_tc(bytes.fromhex(octets))


@given(st.binary(max_size=60))
def test_arbitrary_bytes_are_decoded_or_refused(data: bytes) -> None:
    length = (len(data) + 4).to_bytes(2, "big")
    for decode, octets in ((decode_packet, length + b"\0\0" + data), (decode_hello, data), (decode_tc, data)):
        try:
            decode(octets)
        except WireError:
            continue


@given(
    st.integers(0, 255),
    st.integers(0, 7),
    st.dictionaries(st.integers(0, 255), st.lists(st.integers(0, 60_000), max_size=4), max_size=4),
)
def test_a_hello_comes_back_as_it_was(interval: int, willingness: int, links: dict[int, list[int]]) -> None:
    hello = Hello(decode_time(interval), willingness, links)
    assert decode_hello(encode_hello(hello)) == hello
