"""The bits of packets against the specification's sample data (tests/data/bluetooth_bit_vectors.txt) and codes."""

import binascii
import re
from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.channels.bluetooth.bits.codes import (
    access_code,
    bits_to_bytes,
    bytes_to_bits,
    clock_seed,
    correct,
    crc16,
    from_bits,
    hec,
    protect,
    repeat,
    response_seed,
    sync_word,
    to_bits,
    vote,
    whitening,
)
from cosim.channels.bluetooth.bits.packet import FHS_BYTES, TYPE_CODES, Fhs, Header, decode, encode, fhs_of
from cosim.channels.bluetooth.packets import ACL, DH1, DM1, FHS, ID, NULL, PACKETS, POLL
from cosim.channels.bluetooth.radio import Part
from cosim.units import US
from tests.checkout import DATA

VECTORS = (DATA / "bluetooth_bit_vectors.txt").read_text()
ACCESS_CODES = re.findall(r"^([0-9a-f]{6})\s+([5a] [0-9a-f]{16} [5a])$", VECTORS, re.MULTILINE)
HEADERS = re.findall(r"^([0-9a-f]{2}) ([0-9a-f]{3}) ([0-9a-f]{2}) ([07 ]+)$", VECTORS, re.MULTILINE)
BLOCKS = re.findall(r"^0x([0-9a-f]{3})  ([01]{10}) ([01]{5})$", VECTORS, re.MULTILINE)
WHITENED = re.search(r"CLK byte (0x[0-9a-f]+);.*in  ([0-9A-F ]+) -> out ([0-9A-F ]+)", VECTORS)

laps = st.integers(0, 0xFFFFFF)
uaps = st.integers(0, 0xFF)
seeds = st.none() | st.integers(1, 0x7F)
headers = st.builds(Header, st.integers(0, 7), st.just(0), *[st.integers(0, 1)] * 3)


def text(bits):
    return "".join(map(str, bits))


def packet_vector(name, part):
    return re.search(rf"^{name} {part} +([01 ]+)$", VECTORS, re.MULTILINE)[1].replace(" ", "")


def flipped(bits, *places):
    return [bit ^ (place in places) for place, bit in enumerate(bits)]


# ---------------------------------------------------------------- sample data


def test_every_row_of_the_file_is_read():
    assert (len(ACCESS_CODES), len(HEADERS), len(BLOCKS)) == (35, 20, 10)


@pytest.mark.parametrize(("lap", "code"), ACCESS_CODES)
def test_access_codes(lap: str, code: str):
    assert text(access_code(int(lap, 16))) == f"{int(code.replace(' ', ''), 16):072b}"


@pytest.mark.parametrize(("uap", "data", "check", "triplets"), HEADERS)
def test_headers(uap: str, data: str, check: str, triplets: str):
    word = int(data, 16)
    assert hec(int(uap, 16), word) == int(check, 16)
    on_air = "".join({"0": "000", "7": "111"}[digit] for digit in triplets.replace(" ", ""))
    assert text(repeat(to_bits(word, 10) + to_bits(int(check, 16), 8))) == on_air


def test_crc():
    uap, data, sent = re.search(r"UAP 0x(..), data ([0-9a-f ]+) -> sent as bytes ([0-9a-f ]+)", VECTORS).groups()
    assert crc16(int(uap, 16), bytes.fromhex(data)).to_bytes(2, "little") == bytes.fromhex(sent)


@pytest.mark.parametrize(("data", "plain", "parity"), BLOCKS)
def test_blocks_of_the_two_thirds_code(data: str, plain: str, parity: str):
    assert text(protect(to_bits(int(data, 16), 10))) == plain + parity


def test_whitening_from_a_register_of_ones():
    sequence = re.search(r"^[01]{128}$", VECTORS, re.MULTILINE)[0]
    assert clock_seed(0b1111110) == 0b1111111
    assert text(whitening(clock_seed(0b1111110), 128)) == sequence


def test_whitening_goes_on_from_the_header_to_the_payload():
    clock, plain, white = int(WHITENED[1], 16), *map(bytes.fromhex, WHITENED.groups()[1:])
    sequence = whitening(clock_seed(clock), 18 + 8 * (len(plain) - 3))
    bits = [bytes_to_bits(data)[:18] + bytes_to_bits(data[3:]) for data in (plain, white)]
    assert [bit ^ noise for bit, noise in zip(bits[0], sequence, strict=True)] == bits[1]


@pytest.mark.parametrize("kind", [DH1, DM1], ids=lambda kind: kind.name)
def test_whole_packets(kind):
    bits = encode(kind, 0, 0x47, Header(3, 0, flow=0, arqn=1), bytes([1, 2, 3, 4, 5]))
    assert text(bits[:72]) == f"{0x57E7041E34000000D5:072b}"
    assert text(bits[72:126]) == packet_vector(kind.name, "header")
    assert text(bits[126:]) == packet_vector(kind.name, "payload")


# ---------------------------------------------------------------- codes


@given(laps, laps)
def test_sync_words_differ_in_14_bits_at_least(one: int, other: int):
    apart = (from_bits(sync_word(one)) ^ from_bits(sync_word(other))).bit_count()
    assert apart >= 14 or one == other


@given(uaps, st.binary(max_size=40))
def test_crc_equals_that_of_binascii_with_all_bytes_mirrored(uap: int, data: bytes):
    mirrored = bytes(int(f"{byte:08b}"[::-1], 2) for byte in data)
    assert crc16(uap, data) == int(f"{binascii.crc_hqx(mirrored, uap):016b}"[::-1], 2)


@given(uaps, st.integers(0, 1023), st.integers(0, 17))
def test_hec_notices_one_wrong_bit(uap: int, word: int, wrong: int):
    received = (word | hec(uap, word) << 10) ^ 1 << wrong
    assert hec(uap, received & 1023) != received >> 10


def test_one_wrong_bit_of_a_block_is_corrected_and_two_are_noticed():
    for word in (0, 1, 0x155, 0x2AA, 0x3FF):
        block = protect(to_bits(word, 10))
        assert correct(block) == (to_bits(word, 10), 0, 0)
        for wrong in range(15):
            assert correct(flipped(block, wrong)) == (to_bits(word, 10), 1, 0)
        for pair in combinations(range(15), 2):
            assert correct(flipped(block, *pair))[1:] == (0, 1)


def test_two_copies_of_three_decide():
    assert vote([0, 0, 1, 1, 0, 1, 1, 1, 1, 0, 0, 0]) == ([0, 1, 1, 0], 2, 0)


def test_the_whitening_of_responses_starts_from_x():
    assert response_seed(0b10101) == 0b1110101
    assert response_seed(0b10010101) == 0b1110101


def test_wrong_sizes_are_value_errors():
    with pytest.raises(ValueError, match="LAP"):
        access_code(1 << 24)
    with pytest.raises(ValueError, match="UAP"):
        hec(256, 0)
    with pytest.raises(ValueError, match="register"):
        whitening(0, 3)
    with pytest.raises(ValueError, match="whole bytes"):
        bits_to_bytes([0] * 9)
    with pytest.raises(ValueError, match="blocks"):
        correct([0] * 14)


# ---------------------------------------------------------------- whole packets


@pytest.mark.parametrize("kind", PACKETS.values(), ids=lambda kind: kind.name)
def test_a_packet_has_as_many_bits_as_its_air_time_says(kind):
    for length in {0, kind.capacity // 2, kind.capacity}:
        body = bytes(FHS_BYTES) if kind is FHS else bytes(length)
        assert len(encode(kind, 0x123456, 0x9A, Header(1, 0), body)) * US == kind.air_time(length)


@pytest.mark.slow
@given(st.data(), st.sampled_from(sorted(PACKETS)), laps, uaps, headers, seeds, st.integers(0, 3))
def test_what_is_encoded_is_decoded(data, name, lap, uap, header, seed, llid):
    kind = PACKETS[name]
    least = FHS_BYTES if kind is FHS else 0
    body = data.draw(st.binary(min_size=least, max_size=max(least, kind.capacity)))
    found = decode(encode(kind, lap, uap, header, body, seed, llid), lap, uap, seed)
    wanted = None if kind is ID else header._replace(type=TYPE_CODES[name])
    assert found == (kind, wanted, body, llid if kind.header else 0, Part.NONE, 0)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [kind for kind in PACKETS.values() if kind.coded], ids=lambda kind: kind.name)
def test_every_single_bit_error_of_a_coded_payload_is_corrected(kind):
    body = bytes(range(FHS_BYTES if kind is FHS else min(kind.capacity, 40)))
    bits = encode(kind, 0x9E8B33, 0x47, Header(2, 0), body, clock_seed(0x1234))
    wanted = (kind, Header(2, TYPE_CODES[kind.name]), body)
    for wrong in range(126, len(bits)):
        found = decode(flipped(bits, wrong), 0x9E8B33, 0x47, clock_seed(0x1234))
        assert (found[:3], found.failed, found.corrected) == (wanted, Part.NONE, 1)


def test_one_error_in_every_block_is_corrected_and_two_in_one_are_not():
    body = bytes(range(17))
    bits = encode(DM1, 1, 2, Header(2, 0), body)
    one_each = [126 + 15 * block + block % 15 for block in range(16)]
    found = decode(flipped(bits, *one_each), 1, 2)
    assert (found.body, found.failed, found.corrected) == (body, Part.NONE, 16)
    for pair in ((130, 137), (137, 140)):  # the second pair hits parity bits only: the data are right, the block is not
        assert decode(flipped(bits, *pair), 1, 2)[2:5] == (b"", 0, Part.PAYLOAD)


def test_an_uncoded_payload_survives_no_error():
    bits = encode(DH1, 1, 2, Header(2, 0), b"hello")
    for wrong in range(126, len(bits)):
        found = decode(flipped(bits, wrong), 1, 2)
        assert (found.header, found.body, found.failed) == (Header(2, 4), b"", Part.PAYLOAD)


def test_one_wrong_copy_of_every_header_bit_is_corrected_and_two_of_one_are_not():
    bits = encode(POLL, 1, 2, Header(5, 0, seqn=1), seed=77)
    found = decode(flipped(bits, *range(73, 126, 3)), 1, 2, 77)
    assert found == (POLL, Header(5, 1, seqn=1), b"", 0, Part.NONE, 18)
    for first in range(72, 126, 3):
        assert decode(flipped(bits, first, first + 2), 1, 2, 77).failed == Part.HEADER


def test_an_access_code_with_more_than_seven_wrong_bits_is_not_noticed():
    for kind, bits in ((ID, encode(ID, 5, 0)), (NULL, encode(NULL, 5, 6, Header(1, 0)))):
        assert decode(flipped(bits, *range(10, 17)), 5, 6).kind is kind
        assert decode(flipped(bits, *range(10, 18)), 5, 6)[::4] == (None, Part.ACCESS_CODE)


def test_another_uap_or_clock_reads_nothing():
    bits = encode(DH1, 1, 2, Header(2, 0), b"hello", clock_seed(20))
    assert decode(bits, 1, 3, clock_seed(20)).failed == Part.HEADER
    assert decode(bits, 1, 2, clock_seed(22)).failed == Part.HEADER
    assert decode(bits, 1, 2, clock_seed(21)).body == b"hello"  # CLK0 does not count


def test_whitening_covers_header_and_payload_but_not_the_access_code():
    white, plain = (encode(DH1, 1, 2, Header(2, 0), b"hello", seed) for seed in (0x7F, None))
    sequence = [int(bit) for bit in re.search(r"^[01]{128}$", VECTORS, re.MULTILINE)[0]]
    noise = [one ^ other for one, other in zip(white, plain, strict=True)]
    assert noise[:72] == [0] * 72
    assert noise[72:126] == repeat(sequence[:18])
    assert noise[126:] == sequence[18 : 18 + len(noise) - 126]


def test_a_type_that_the_codec_does_not_know_is_told_by_its_number():
    header = Header(1, 5)  # HV1
    bits = [*access_code(1), *repeat(to_bits(header.checked(2), 18)), *[0] * 240]
    assert decode(bits, 1, 2) == (None, header, b"", 0, Part.PAYLOAD, 0)


@pytest.mark.parametrize(("length", "sent"), [(28, 28), (5, 0), (0, 1)])
def test_a_payload_header_must_tell_the_length_that_was_sent(length: int, sent: int):
    data = bytes([2 | length << 3]) + bytes(sent)
    payload = bytes_to_bits(data + crc16(2, data).to_bytes(2, "little"))
    bits = [*access_code(1), *repeat(to_bits(Header(1, TYPE_CODES["DH1"]).checked(2), 18)), *payload]
    assert decode(bits, 1, 2).failed == Part.PAYLOAD


def test_a_packet_without_payload_ends_with_its_header():
    assert decode([*encode(NULL, 1, 2, Header(1, 0)), 0], 1, 2).failed == Part.PAYLOAD


@pytest.mark.slow
@given(st.lists(st.integers(0, 1), max_size=400), st.sampled_from(sorted(TYPE_CODES)), seeds, st.integers(0, 2))
def test_bad_bits_never_raise(noise, name, seed, kept):
    start = encode(NULL, 1, 2, Header(1, 0))[:72]
    whole = [*start, *repeat(to_bits(Header(1, TYPE_CODES[name]).checked(2), 18))]
    assert decode([[], start, whole][kept] + noise, 1, 2, seed).failed in Part


def test_what_does_not_fit_is_a_value_error():
    with pytest.raises(ValueError, match=r"28 bytes do not fit into DH1 \(27 bytes\)"):
        encode(DH1, 0, 0, Header(1, 0), bytes(28))
    with pytest.raises(ValueError, match="1 bytes do not fit into POLL"):
        encode(POLL, 0, 0, Header(1, 0), b"x")
    with pytest.raises(ValueError, match="18 bytes, not 17"):
        encode(FHS, 0, 0, Header(0, 0), bytes(17))
    with pytest.raises(ValueError, match="DM1 has a header"):
        encode(DM1, 0, 0)


# ---------------------------------------------------------------- FHS


fhs_packets = st.builds(
    Fhs, laps, uaps, *(st.integers(0, (1 << width) - 1) for width in (16, 24, 3, 26)), st.integers(0, 2)
)


@given(fhs_packets)
def test_the_contents_of_an_fhs_come_back(fhs: Fhs):
    assert fhs_of(fhs.to_bytes()) == fhs


def test_an_fhs_begins_with_the_parity_bits_of_its_sender():
    _, code = ACCESS_CODES[2]
    parity = f"{int(code.split()[1], 16):064b}"[:34]
    assert text(bytes_to_bits(Fhs(0x9E8B33, 0, 0, 0, 0, 0).to_bytes()))[:34] == parity


@pytest.mark.parametrize(
    ("field", "first", "width"),
    [
        ("lap", 34, 24),
        ("scan_repetition", 60, 2),
        ("uap", 64, 8),
        ("nap", 72, 16),
        ("device_class", 88, 24),
        ("lt_addr", 112, 3),
        ("clk_27_2", 115, 26),
    ],
)
def test_the_fields_of_an_fhs_stand_where_figure_6_9_has_them(field: str, first: int, width: int):
    plain = Fhs(0, 0, 0, 0, 0, 0, 0)
    full = plain._replace(**{field: (1 << width) - 1})
    changed = int.from_bytes(plain.to_bytes(), "little") ^ int.from_bytes(full.to_bytes(), "little")
    assert changed >> 34 << 34 == ((1 << width) - 1) << first  # the LAP changes the parity bits below, too


def test_no_packet_that_carries_data_lacks_a_type_code():
    assert TYPE_CODES.keys() == PACKETS.keys() - {"ID"}
    assert ACL.keys() <= TYPE_CODES.keys()
