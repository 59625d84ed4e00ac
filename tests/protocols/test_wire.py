"""Bit-exact encodings: fields, padding and CRC, and what is refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import WireError
from protocols import wire

LAYOUT = (("kind", 3), ("flag", 1), ("place", 6))
"""10 bits: two bytes with 6 bits of padding, and the CRC."""


def bitwise_crc(data: bytes) -> int:
    """CRC-CCITT one bit at a time, as its polynomial says."""
    register = 0xFFFF
    for byte in data:
        for bit in range(7, -1, -1):
            out = register >> 15 ^ byte >> bit & 1
            register = (register << 1 & 0xFFFF) ^ (0x1021 if out else 0)
    return register


def test_the_crc_has_the_published_check_value() -> None:
    wire.check(b"123456789" + bytes.fromhex("29B1"))
    with pytest.raises(WireError, match="the CRC does not fit"):
        wire.check(b"123456789" + bytes.fromhex("29B0"))


def test_fields_are_packed_most_significant_bit_first() -> None:
    # 101 0 101111 and six bits of padding: 1010 1011 1100 0000
    assert wire.pack(LAYOUT, {"kind": 5, "flag": 0, "place": 47}) == bytes.fromhex("ABC0 05C7")
    assert wire.size(LAYOUT) == 4


@given(st.integers(0, 7), st.integers(0, 1), st.integers(0, 63))
def test_what_was_packed_is_unpacked(kind: int, flag: int, place: int) -> None:
    values = {"kind": kind, "flag": flag, "place": place}
    data = wire.pack(LAYOUT, values)
    assert wire.unpack(LAYOUT, data) == values
    assert int.from_bytes(data[-2:], "big") == bitwise_crc(data[:-2])


@pytest.mark.parametrize("value", [-1, 8])
def test_a_value_that_its_field_cannot_hold_is_refused(value: int) -> None:
    with pytest.raises(WireError, match=f"kind = {value} does not fit into 3 bits"):
        wire.pack(LAYOUT, {"kind": value, "flag": 0, "place": 0})


def test_padding_that_is_not_zero_is_refused() -> None:
    body = bytes.fromhex("ABC1")
    with pytest.raises(WireError, match="padding that is not zero"):
        wire.unpack(LAYOUT, body + bitwise_crc(body).to_bytes(2, "big"))


@pytest.mark.parametrize("length", [0, 1, 2, 3, 5])
def test_another_length_is_refused(length: int) -> None:
    with pytest.raises(WireError, match=f"{length} bytes where 4 were expected"):
        wire.unpack(LAYOUT, bytes(length))


@given(st.integers(0, 31))
def test_every_single_bit_error_is_noticed(bit: int) -> None:
    data = wire.pack(LAYOUT, {"kind": 5, "flag": 1, "place": 47})
    damaged = (int.from_bytes(data, "big") ^ 1 << bit).to_bytes(len(data), "big")
    with pytest.raises(WireError):
        wire.unpack(LAYOUT, damaged)


@pytest.mark.parametrize("data", [b"", b"\x00", b"\xff\xff", b"\x1d\x0f"])
def test_a_crc_alone_is_no_packet(data: bytes) -> None:
    with pytest.raises(WireError):
        wire.check(data)


@given(st.binary(min_size=1, max_size=40))
def test_what_was_sealed_is_opened(data: bytes) -> None:
    sealed = wire.seal(data)
    assert sealed[-2:] == bitwise_crc(data).to_bytes(2, "big")
    assert wire.open(sealed) == data


@given(st.binary(min_size=1, max_size=40), st.integers(0, 10_000))
def test_a_bit_that_was_changed_is_noticed(data: bytes, at: int) -> None:
    sealed = bytearray(wire.seal(data))
    sealed[at // 8 % len(sealed)] ^= 1 << at % 8
    with pytest.raises(WireError, match="the CRC does not fit"):
        wire.open(bytes(sealed))


@pytest.mark.parametrize("data", [b"", b"\xff", b"\xff\xff"])
def test_a_seal_on_nothing_is_none(data: bytes) -> None:
    with pytest.raises(WireError, match="the CRC does not fit"):
        wire.open(data)
