"""CRC, whitening, channel numbers, access addresses and air times of Bluetooth Low Energy against published vectors."""

import random
from itertools import pairwise

import numpy as np
import pytest

from cosim.channels.ble.bits.access import ADVERTISING_ADDRESS, draw, is_valid
from cosim.channels.ble.bits.crc import ADVERTISING_INIT, crc24
from cosim.channels.ble.bits.whitening import whiten
from cosim.channels.ble.channels import ADVERTISING, CHANNELS, channel_index, frequency_mhz, rf_channel
from cosim.channels.ble.phy import CODED_S2, CODED_S8, LE_1M, LE_2M, PHYS, Phy
from cosim.randomness import Streams
from cosim.units import US

# ---------------------------------------------------------------- CRC and whitening


@pytest.mark.parametrize(
    ("pdu", "octets"),
    [
        # scapy, test/scapy/layers/bluetooth4LE.uts: two that it builds, and one that was on the air
        (bytes.fromhex("00 06 00 00 00 00 00 00"), "5a 39 60"),
        (bytes.fromhex("03 0c aa aa aa aa aa aa bb bb bb bb bb bb"), "07 b2 61"),
        (bytes.fromhex("40 14 4d 95 50 16 fe 76 02 01 1a 0a ff 4c 00 10 05 0b 1c 0e a8 36"), "5a f0 04"),
        (b"123456789", "56 5a c2"),  # 0xC25A56 of the catalogue's CRC-24/BLE
    ],
)
def test_crc_vectors(pdu: bytes, octets: str) -> None:
    assert crc24(pdu) == bytes.fromhex(octets)


def crc_bit_by_bit(pdu: bytes, init: int) -> bytes:
    """Return the CRC by the register of section 3.1.1, position 0 on the right, position 23 sent first."""
    register = init
    for octet in pdu:
        for i in range(8):
            feedback = register >> 23 ^ octet >> i & 1
            register = register << 1 & 0xFFFFFF
            if feedback:
                register ^= 1 << 10 | 1 << 9 | 1 << 6 | 1 << 4 | 1 << 3 | 1 << 1 | 1
    sent = [register >> 23 - i & 1 for i in range(24)]
    return bytes(sum(bit << i for i, bit in enumerate(sent[at : at + 8])) for at in (0, 8, 16))


def test_the_crc_is_that_of_the_register_and_leaves_nothing() -> None:
    chance = random.Random(1)
    for length in (0, 1, 2, 39, 257):
        pdu, init = chance.randbytes(length), chance.getrandbits(24)
        assert crc24(pdu, init) == crc_bit_by_bit(pdu, init)
        assert crc24(pdu + crc24(pdu, init), init) == bytes(3)


def test_every_single_and_double_error_of_a_short_pdu_is_noticed() -> None:
    whole = bytearray(b"\x00\x06abcdef" + crc24(b"\x00\x06abcdef"))
    for i in range(8 * len(whole)):
        whole[i // 8] ^= 1 << i % 8
        for j in range(i):
            whole[j // 8] ^= 1 << j % 8
            assert crc24(whole) != bytes(3)
            whole[j // 8] ^= 1 << j % 8
        assert crc24(whole) != bytes(3)
        whole[i // 8] ^= 1 << i % 8


@pytest.mark.parametrize(
    ("index", "sequence"),  # kgat96/ubermini, firmware/v2pro3_ble/ble.c
    [
        (37, "8d d2 57 a1 3d a7 66 b0"),
        (38, "d6 c5 44 20 59 de e1 8f"),
        (39, "1f 37 4a 5f 85 f6 9c 9a"),
        (0, "40 b2 bc c3 1f 37 4a 5f"),
    ],
)
def test_whitening_sequences(index: int, sequence: str) -> None:
    assert whiten(bytes(8), index) == bytes.fromhex(sequence)


def bits(octets: bytes) -> str:
    return "".join(f"{octet:08b}"[::-1] for octet in octets)


def test_all_channels_have_one_sequence_of_period_127_with_different_starts() -> None:
    longest = 260  # octets of the longest PDU with its CRC
    sequences = [bits(whiten(bytes(longest), index)) for index in range(CHANNELS)]
    period = sequences[0][:127]
    starts = [(2 * period).find(sequence[:127]) for sequence in sequences]
    assert len(set(starts)) == CHANNELS
    assert -1 not in starts
    for sequence in sequences:
        assert sequence[127:] == sequence[:-127]
    assert period.count("1") == 64  # a sequence of greatest length


def test_whitening_twice_is_nothing() -> None:
    data = random.Random(2).randbytes(260)
    for index in range(CHANNELS):
        assert whiten(data, index) != data
        assert whiten(whiten(data, index), index) == data


@pytest.mark.parametrize("index", [-1, 40])
def test_a_channel_that_does_not_exist_is_refused(index: int) -> None:
    for of in (rf_channel, channel_index, frequency_mhz):
        with pytest.raises(ValueError, match=f"{index} is no channel"):
            of(index)
    with pytest.raises(ValueError, match=f"{index} is no channel index"):
        whiten(b"", index)


def test_a_crc_init_of_more_than_24_bits_is_refused() -> None:
    with pytest.raises(ValueError, match="no CRCInit"):
        crc24(b"", 1 << 24)
    assert ADVERTISING_INIT == 0x555555


# ---------------------------------------------------------------- channels


def test_channel_numbers() -> None:
    assert [channel_index(k) for k in (0, 12, 39)] == list(ADVERTISING)
    assert [channel_index(k) for k in range(1, 12)] == list(range(11))
    assert [channel_index(k) for k in range(13, 39)] == list(range(11, 37))
    assert [rf_channel(channel_index(k)) for k in range(CHANNELS)] == list(range(CHANNELS))
    assert [frequency_mhz(rf_channel(index)) for index in (0, 10, 11, 36, *ADVERTISING)] == [
        *(2404, 2424, 2428, 2478),
        *(2402, 2426, 2480),
    ]


# ---------------------------------------------------------------- access addresses

GOOD = 0b10101100_11010010_01101001_01011011


@pytest.mark.parametrize(
    ("address", "valid"),
    [
        (GOOD, True),
        (ADVERTISING_ADDRESS, False),
        (ADVERTISING_ADDRESS ^ 1 << 9, False),
        (ADVERTISING_ADDRESS ^ 1 << 9 ^ 1 << 17, True),
        (0b10101100_11010011_11110001_01011011, True),  # six equal bits
        (0b10101100_11010011_11111001_01011011, False),  # seven
        (0b01010010_01000000_01011001_10100110, False),  # seven zeros
        (0x6B6B6B6B, False),  # equal octets
        (0b11110100_11010010_01101001_01011011, True),  # 111101: two transitions
        (0b11111000_11010010_01101001_01011011, False),  # 111110: one
        (1 << 32 | GOOD, False),
        (-1, False),
    ],
)
def test_addresses_that_a_connection_may_have(address: int, valid: bool) -> None:
    assert is_valid(address, coded=False) is valid


@pytest.mark.parametrize(
    ("address", "transitions"),
    [
        (0b10101010_10101010_10101010_00110000, 25),
        (0b10101010_10101010_10101010_00111111, 24),
    ],
)
def test_at_most_24_transitions(address: int, transitions: int) -> None:
    text = f"{address:032b}"
    assert sum(one != other for one, other in pairwise(text)) == transitions
    assert is_valid(address, coded=False) is (transitions <= 24)


@pytest.mark.parametrize(
    ("low", "valid"),
    [
        (0b01101001_00110001, True),  # three ones in the low octet
        (0b01101001_00100001, False),  # two
        (0b01010101_01001011, False),  # twelve transitions in the low 16 bits
        (0b01010101_01000111, True),  # ten
    ],
)
def test_le_coded_asks_for_more(low: int, valid: bool) -> None:
    address = 0b10101100_11010010 << 16 | low
    assert is_valid(address, coded=False)
    assert is_valid(address) is valid


def text_rules(address: int) -> bool:
    """Return what :func:`is_valid` says, read from the address as text."""
    text = f"{address:032b}"
    changes = [one != other for one, other in pairwise(text)]
    return (
        "0000000" not in text
        and "1111111" not in text
        and sum(changes) <= 24
        and sum(changes[:5]) >= 2
        and text != text[:8] * 4
        and sum(one != other for one, other in zip(text, f"{ADVERTISING_ADDRESS:032b}", strict=True)) > 1
        and text[24:].count("1") >= 3
        and sum(changes[16:]) <= 11
    )


def test_the_rules_are_those_of_the_text() -> None:
    chance = random.Random(3)
    addresses = [chance.getrandbits(32) for _ in range(5_000)]
    valid = [is_valid(address) for address in addresses]
    assert valid == [text_rules(address) for address in addresses]
    assert 1_000 < sum(valid) < 4_000


def test_drawn_addresses_are_valid_different_and_the_stream_s_own() -> None:
    stream = Streams(1)("access")
    drawn = [draw(stream) for _ in range(500)]
    assert all(map(text_rules, drawn))
    assert len(set(drawn)) == 500
    again = Streams(1)("access")
    assert [draw(again) for _ in range(500)] == drawn
    shares = np.mean([[address >> i & 1 for i in range(32)] for address in drawn], axis=0)
    assert shares.min() > 0.3  # no bit is fixed
    assert shares.max() < 0.7


# ---------------------------------------------------------------- air times


@pytest.mark.parametrize(
    ("phy", "air_us"),
    [
        (LE_1M, (80, 296, 2088, 2120)),
        (LE_2M, (44, 152, 1048, 1064)),
        (CODED_S2, (462, 894, 4478, 4542)),
        (CODED_S8, (720, 2448, 16784, 17040)),
    ],
)
def test_air_times_of_payloads_of_0_27_251_and_255_octets(phy: Phy, air_us: tuple[int, ...]) -> None:
    assert [phy.air_time(octets) for octets in (0, 27, 251, 255)] == [us * US for us in air_us]


def test_air_times_of_advertising_on_le_1m() -> None:
    assert [LE_1M.air_time(octets) // US for octets in (6 + 31, 12, 34)] == [376, 176, 352]


@pytest.mark.parametrize("octets", [-1, 256])
def test_payloads_that_no_header_can_tell_are_refused(octets: int) -> None:
    for phy in PHYS.values():
        with pytest.raises(ValueError, match=f"{octets} octets are no payload"):
            phy.air_time(octets)
