"""IPv4 and UDP of routed networks: golden bytes, and what is refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.channels.adhoc.routing import ip
from cosim.channels.adhoc.routing.ip import Datagram, checksum, decode, encode, ip_of, robot_of
from cosim.errors import WireError
from cosim.machine import BROADCAST


def test_the_checksum_is_that_of_a_header_whose_sum_is_known() -> None:
    # the worked example of Wikipedia's article on the IPv4 header checksum: 0xb861
    assert checksum(0x45000073000040004011_0000_C0A80001C0A800C7) == 0xB861
    assert checksum(0x45000073000040004011_B861_C0A80001C0A800C7) == 0


def test_a_datagram_has_these_octets() -> None:
    # version 4, 5 words; 31 octets; id 7; ttl 35; UDP; sum by hand 4500+1f+7+2311+a00+1+ffff+ffff, folded: 7238
    packet = encode(Datagram(0, BROADCAST, 35, 654, 7, b"abc"))
    assert packet.hex(" ") == (
        "45 00 00 1f 00 07 00 00 23 11 8d c7 0a 00 00 01 ff ff ff ff 02 8e 02 8e 00 0b 00 00 61 62 63"
    )


@pytest.mark.parametrize(
    ("robot", "ip"), [(0, 0x0A000001), (249, 0x0A0000FA), (250, 0x0A000101), (BROADCAST, 0xFFFFFFFF)]
)
def test_robots_have_these_addresses(robot: int, ip: int) -> None:
    assert ip_of(robot) == ip
    assert robot_of(ip) == robot


DATAGRAMS = st.builds(
    Datagram,
    st.integers(0, 1000),
    st.integers(-1, 1000),
    st.integers(0, 255),
    st.integers(0, 65535),
    st.integers(0, 65535),
    st.binary(max_size=60),
)


@given(DATAGRAMS)
def test_what_is_encoded_is_decoded(datagram: Datagram) -> None:
    packet = encode(datagram)
    assert decode(packet) == datagram, "as it is remembered"
    ip._known.clear()
    assert decode(packet) == datagram, "as it is on the air"


@given(DATAGRAMS, st.integers(0, 19), st.integers(0, 7))
def test_a_wrong_bit_in_the_header_is_noticed(datagram: Datagram, place: int, bit: int) -> None:
    packet = bytearray(encode(datagram))
    packet[place] ^= 1 << bit
    with pytest.raises(WireError):
        decode(bytes(packet))


def test_only_the_last_packets_are_remembered() -> None:
    for number in range(2 * ip._KNOWN):
        decode(encode(Datagram(0, 1, 64, 654, number, b"")))
        assert len(ip._known) <= ip._KNOWN


@given(st.binary(max_size=60))
def test_other_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(WireError):
        decode(data)
