"""PDUs of Bluetooth Low Energy: golden octets, what is refused, and garbage."""

import random
from collections import Counter

import pytest

from cosim.channels.ble.bits.pdu import (
    CLOCK_ACCURACIES_PPM,
    AdvertisingMode,
    AdvertisingType,
    AuxiliaryPhy,
    AuxPtr,
    ConnectInd,
    DataInfo,
    DataPdu,
    DeviceAddress,
    Directed,
    Extended,
    LLData,
    Llid,
    SyncInfo,
    Undirected,
    decode_advertising,
    decode_data,
    decode_ll_data,
    encode_advertising,
    encode_data,
    encode_ll_data,
)
from cosim.channels.ble.connections.channel_map import ALL_CHANNELS, ChannelMap
from cosim.errors import WireError
from cosim.units import MS, US, S
from tests.tiers import soak_count

ANN = DeviceAddress(0x112233445566, random=True)
BOB = DeviceAddress(0xA0B0C0D0E0F0)
ANN_OCTETS, BOB_OCTETS = "66 55 44 33 22 11", "f0 e0 d0 c0 b0 a0"

LL_DATA = LLData(
    access_address=0x50655641,
    crc_init=0x179A9C,
    window_size=2_500 * US,
    window_offset=1_250 * US,
    interval=20 * MS,
    latency=3,
    timeout=500 * MS,
    channel_map=ChannelMap((9, 10, 21, 22, 23, 33, 34, 35, 36)),
    hop=5,
    sca=1,
)
LL_DATA_OCTETS = (
    "41 56 65 50 9c 9a 17"  # access address, CRCInit
    "02 01 00 10 00 03 00 32 00"  # 2 and 1 times 1.25 ms, 16 times 1.25 ms, latency, 50 times 10 ms
    "00 06 e0 00 1e 25"  # channel map, 1 * 32 + 5
)
SYNC = SyncInfo(
    offset=8_191 * 300 * US,
    interval=7_500 * US,
    channel_map=ALL_CHANNELS,
    sca=5,
    access_address=0x8E89BED7,
    crc_init=0x010203,
    event=0xFFFE,
)
SYNC_OCTETS = "ff 3f 06 00 ff ff ff ff bf d7 be 89 8e 03 02 01 fe ff"
EVERYTHING = Extended(
    mode=AdvertisingMode.SCANNABLE,
    advertiser=ANN,
    target=BOB,
    cte_info=0x14,
    data_info=DataInfo(0xABC, 0xD),
    aux=AuxPtr(36, 245_760 * US + 240 * US, AuxiliaryPhy.CODED, accurate=True),
    sync=SYNC,
    tx_power_dbm=-20,
    additional=b"\x01\x28",
    data=b"data",
)
KINDS = AdvertisingType

GOLDEN = [
    # seen on the air: scapy, test/scapy/layers/bluetooth4LE.uts
    (
        Undirected(KINDS.ADV_IND, DeviceAddress(0x76FE1650954D, True), bytes.fromhex("02011a0aff4c0010050b1c0ea836")),
        "40 14 4d 95 50 16 fe 76 02 01 1a 0a ff 4c 00 10 05 0b 1c 0e a8 36",
    ),
    (Undirected(KINDS.ADV_IND, BOB, b"", True), "20 06" + BOB_OCTETS),
    (Undirected(KINDS.ADV_NONCONN_IND, ANN, bytes(31)), "42 25" + ANN_OCTETS + "00" * 31),
    (Undirected(KINDS.SCAN_RSP, BOB, b"x"), "04 07" + BOB_OCTETS + "78"),
    (Undirected(KINDS.ADV_SCAN_IND, BOB), "06 06" + BOB_OCTETS),
    (Directed(KINDS.ADV_DIRECT_IND, ANN, BOB, True), "61 0c" + ANN_OCTETS + BOB_OCTETS),
    (Directed(KINDS.SCAN_REQ, BOB, ANN), "83 0c" + BOB_OCTETS + ANN_OCTETS),
    (ConnectInd(BOB, ANN, LL_DATA, True), "a5 22" + BOB_OCTETS + ANN_OCTETS + LL_DATA_OCTETS),
    (ConnectInd(ANN, BOB, LL_DATA), "45 22" + ANN_OCTETS + BOB_OCTETS + LL_DATA_OCTETS),
    # extended: length of the extended header and AdvMode, flags, fields
    (Extended(), "07 01 00"),
    (Extended(data=b"ab"), "07 03 00 61 62"),
    (Extended(type=KINDS.AUX_CONNECT_RSP, advertiser=ANN, target=BOB), "48 0e 0d 03" + ANN_OCTETS + BOB_OCTETS),
    (
        Extended(AdvertisingMode.CONNECTABLE, data_info=DataInfo(1, 2), aux=AuxPtr(0, 300 * US, AuxiliaryPhy.LE_2M)),
        "07 07 46 18 01 20 00 0a 20",
    ),
    (Extended(additional=b"\x05"), "07 03 02 00 05"),
    (
        EVERYTHING,
        "47 2d a8 7f" + ANN_OCTETS + BOB_OCTETS + "14 bc da e4 34 43" + SYNC_OCTETS + "ec 01 28 64 61 74 61",
    ),
]


@pytest.mark.parametrize(("pdu", "octets"), GOLDEN)
def test_an_advertising_pdu_has_these_octets(pdu, octets: str) -> None:
    assert encode_advertising(pdu).hex() == bytes.fromhex(octets).hex()
    assert decode_advertising(bytes.fromhex(octets)) == pdu


@pytest.mark.parametrize("kind", [KINDS.ADV_NONCONN_IND, KINDS.ADV_SCAN_IND, KINDS.SCAN_RSP])
def test_who_cannot_be_connected_to_tells_no_algorithm(kind: AdvertisingType) -> None:
    assert encode_advertising(Undirected(kind, BOB, algorithm_2=True)) == encode_advertising(Undirected(kind, BOB))


def test_all_types_of_pdu_are_among_the_golden_ones() -> None:
    assert {bytes.fromhex(octets)[0] & 15 for _, octets in GOLDEN} == set(AdvertisingType)


def test_ll_data_has_these_octets() -> None:
    assert encode_ll_data(LL_DATA) == bytes.fromhex(LL_DATA_OCTETS)
    assert decode_ll_data(bytes.fromhex(LL_DATA_OCTETS)) == LL_DATA
    assert CLOCK_ACCURACIES_PPM[LL_DATA.sca] == 250


@pytest.mark.parametrize(
    ("pdu", "octets"),
    [
        (DataPdu(Llid.CONTINUATION), "01 00"),
        (DataPdu(Llid.START, nesn=1, payload=b"abc"), "06 03 61 62 63"),
        (DataPdu(Llid.CONTROL, sn=1, payload=b"\x02\x13"), "0b 02 02 13"),
        (DataPdu(Llid.START, 1, 1, True, bytes(255)), "1e ff" + "00" * 255),
    ],
)
def test_a_data_pdu_has_these_octets(pdu: DataPdu, octets: str) -> None:
    assert encode_data(pdu) == bytes.fromhex(octets)
    assert decode_data(bytes.fromhex(octets)) == pdu


@pytest.mark.parametrize(
    ("octets", "same"),
    [
        ("36 06" + BOB_OCTETS, "06 06" + BOB_OCTETS),  # RFU, and ChSel where it means nothing
        ("a2 06" + BOB_OCTETS, "02 06" + BOB_OCTETS),  # RxAdd without a target
        ("f7 01 00", "07 01 00"),  # TxAdd and RxAdd without addresses
        ("07 03 02 80 05", "07 03 02 00 05"),  # the flag that is reserved
    ],
)
def test_reserved_bits_do_not_count(octets: str, same: str) -> None:
    assert encode_advertising(decode_advertising(bytes.fromhex(octets))) == bytes.fromhex(same)
    assert decode_data(b"\xe1\x00") == DataPdu(Llid.CONTINUATION)


@pytest.mark.parametrize(
    ("offset", "units", "unit"),
    [(0, 0, 30), (30 * US, 1, 30), (300 * US, 10, 30), (245_730 * US, 8191, 30), (246 * MS, 820, 300)],
)
def test_an_offset_is_told_in_the_shorter_unit_that_can(offset: int, units: int, unit: int) -> None:
    aux = AuxPtr(36, offset, AuxiliaryPhy.LE_1M)
    octets = encode_advertising(Extended(aux=aux))
    assert octets[4] == 36 | (unit == 300) << 7
    assert int.from_bytes(octets[5:7], "little") == units
    assert decode_advertising(octets) == Extended(aux=aux)


# ---------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("octets", "why"),
    [
        ("", "0 octets are no PDU"),
        ("00", "1 octets are no PDU"),
        ("00 07" + BOB_OCTETS, "8 octets are no PDU"),
        ("00 05" + BOB_OCTETS, "8 octets are no PDU"),
        ("09 00", "PDU type 9 is reserved"),
        ("0f 00", "PDU type 15 is reserved"),
        ("00 05" + BOB_OCTETS[:-2], "ADV_IND with a payload of 5 octets"),
        ("00 26" + BOB_OCTETS + "00" * 32, "ADV_IND with a payload of 38 octets"),
        ("01 0b" + BOB_OCTETS + "00" * 5, "ADV_DIRECT_IND with a payload of 11 octets"),
        ("03 0d" + BOB_OCTETS + "00" * 7, "SCAN_REQ with a payload of 13 octets"),
        ("05 21" + BOB_OCTETS + ANN_OCTETS + LL_DATA_OCTETS[:-2], "CONNECT_IND with a payload of 33 octets"),
        ("07 00", "cut off"),
        ("07 01 01", "cut off"),
        ("07 02 02 00", "cut off"),
        ("07 01 c0", "AdvMode 3"),
        ("07 02 01 01", "1 octets with the flags 0x01"),
        ("07 07 06 01" + BOB_OCTETS[:-3], "6 octets with the flags 0x01"),
        ("07 05 04 10 25 0a 20", "channel 37"),
        ("07 05 04 10 00 0a 60", "PHY 3"),
        ("07 14 13 20" + SYNC_OCTETS.replace("06 00", "05 00"), "periodic interval of 6250000 ns"),
        ("07 14 13 20" + SYNC_OCTETS.replace("ff ff ff ff bf", "00 00 00 00 b0"), "1 used channels"),
    ],
)
def test_what_is_no_advertising_pdu_is_refused(octets: str, why: str) -> None:
    with pytest.raises(WireError, match=why):
        decode_advertising(bytes.fromhex(octets))


@pytest.mark.parametrize(("octets", "why"), [("", "no PDU"), ("01 01", "no PDU"), ("1c 00", "LLID 0 is reserved")])
def test_what_is_no_data_pdu_is_refused(octets: str, why: str) -> None:
    with pytest.raises(WireError, match=why):
        decode_data(bytes.fromhex(octets))


LONGEST = LL_DATA._replace(interval=4 * S, latency=0, timeout=32 * S)
IMPOSSIBLE = [
    (LL_DATA._replace(interval=6_250 * US), "connection interval: 6.25 ms is not a multiple"),
    (LONGEST._replace(interval=4 * S + 1_250 * US), "connection interval: 4001.25 ms is not a multiple"),
    (LL_DATA._replace(latency=500), "latency: 500 events is not from 0 to 499"),
    (LL_DATA._replace(timeout=90 * MS, latency=0), "supervision timeout: 90 ms is not"),
    (LL_DATA._replace(timeout=160 * MS), "supervision timeout: 160 ms is not"),  # 2 * (1 + 3) * 20 ms
    (LONGEST._replace(timeout=32_010 * MS), "supervision timeout: 32010 ms is not"),
    (LL_DATA._replace(window_size=0), "transmit window: 0 ms is not a multiple"),
    (LL_DATA._replace(window_size=11_250 * US), "transmit window: 11.25 ms is not a multiple"),
    (LL_DATA._replace(interval=7_500 * US, window_size=7_500 * US), "transmit window: 7.5 ms is not a multiple"),
    (LL_DATA._replace(window_offset=21_250 * US), "transmit window offset: 21.25 ms is not a multiple"),
    (LL_DATA._replace(hop=4), "a hop increment of 4"),
    (LL_DATA._replace(hop=17), "a hop increment of 17"),
]


def raw_ll_data(ll_data: LLData) -> bytes:
    """Return the octets, whether or not there is such a connection."""
    numbers = [
        (ll_data.access_address, 4),
        (ll_data.crc_init, 3),
        (ll_data.window_size // (1_250 * US), 1),
        (ll_data.window_offset // (1_250 * US), 2),
        (ll_data.interval // (1_250 * US), 2),
        (ll_data.latency, 2),
        (ll_data.timeout // (10 * MS), 2),
    ]
    fields = b"".join(number.to_bytes(size, "little") for number, size in numbers)
    return fields + ll_data.channel_map.encode() + bytes([ll_data.hop | ll_data.sca << 5])


@pytest.mark.parametrize(("ll_data", "why"), IMPOSSIBLE)
def test_a_connection_that_cannot_be_is_refused_on_both_sides(ll_data: LLData, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        encode_ll_data(ll_data)
    with pytest.raises(WireError, match=why):
        decode_ll_data(raw_ll_data(ll_data))


@pytest.mark.parametrize(
    "ll_data",
    [
        LL_DATA,
        LL_DATA._replace(interval=7_500 * US, window_size=6_250 * US, timeout=100 * MS),
        LL_DATA._replace(timeout=170 * MS, window_size=10 * MS, window_offset=20 * MS, hop=16, sca=7),
        LONGEST,
        LL_DATA._replace(interval=31_250 * US, latency=499, timeout=32 * S, window_offset=0, channel_map=ALL_CHANNELS),
    ],
)
def test_the_extremes_of_a_connection_are_allowed(ll_data: LLData) -> None:
    assert encode_ll_data(ll_data) == raw_ll_data(ll_data)
    assert decode_ll_data(raw_ll_data(ll_data)) == ll_data


def test_ll_data_of_another_length_or_without_channels_is_refused() -> None:
    octets = bytes.fromhex(LL_DATA_OCTETS)
    with pytest.raises(WireError, match="21 octets"):
        decode_ll_data(octets[:-1])
    with pytest.raises(WireError, match="0 used channels"):
        decode_ll_data(octets[:16] + bytes(5) + octets[21:])


@pytest.mark.parametrize(
    ("pdu", "why"),
    [
        (Undirected(KINDS.ADV_IND, ANN, bytes(32)), "32 octets"),
        (Undirected(KINDS.SCAN_REQ, ANN), "SCAN_REQ"),
        (Undirected(KINDS.ADV_IND, DeviceAddress(1 << 48)), "has not 48 bits"),
        (Directed(KINDS.ADV_IND, ANN, BOB), "ADV_IND"),
        (Directed(KINDS.SCAN_REQ, ANN, DeviceAddress(-1)), "has not 48 bits"),
        (ConnectInd(ANN, BOB, LL_DATA._replace(access_address=1 << 32)), "access address"),
        (ConnectInd(ANN, BOB, LL_DATA._replace(crc_init=1 << 24)), "CRCInit"),
        (ConnectInd(ANN, BOB, LL_DATA._replace(sca=8)), "SCA"),
        (ConnectInd(ANN, BOB, LL_DATA._replace(interval=20 * MS + 1)), "not a multiple of 1.25 ms"),
        (Extended(type=KINDS.ADV_IND), "ADV_IND"),
        (Extended(data=bytes(255)), "256 octets"),
        (Extended(additional=bytes(63)), "length of the extended header"),
        (Extended(cte_info=256), "CTEInfo"),
        (Extended(data_info=DataInfo(1 << 12, 0)), "DID"),
        (Extended(data_info=DataInfo(0, 16)), "SID"),
        (Extended(aux=AuxPtr(37, 0, AuxiliaryPhy.LE_1M)), "channel 37"),
        (Extended(aux=AuxPtr(0, 31 * US, AuxiliaryPhy.LE_1M)), "not a multiple of 300000"),
        (Extended(aux=AuxPtr(0, 8192 * 300 * US, AuxiliaryPhy.LE_1M)), "has not 13 bits"),
        (Extended(sync=SYNC._replace(interval=6_250 * US)), "periodic interval"),
        (Extended(sync=SYNC._replace(interval=65_536 * 1_250 * US)), "has not 16 bits"),
        (Extended(sync=SYNC._replace(event=1 << 16)), "event counter"),
        (Extended(sync=SYNC._replace(sca=8)), "SCA"),
        (Extended(sync=SYNC._replace(access_address=-1)), "access address"),
        (Extended(tx_power_dbm=128), "128 dBm"),
    ],
)
def test_what_cannot_be_encoded_is_refused(pdu, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        encode_advertising(pdu)


def test_a_data_pdu_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="256 octets are no payload"):
        encode_data(DataPdu(Llid.START, payload=bytes(256)))
    with pytest.raises(ValueError, match="SN"):
        encode_data(DataPdu(Llid.START, sn=2))


# ---------------------------------------------------------------- garbage


def mutated(chance: random.Random) -> bytes:
    """Return a frame with flipped bits, other octets, a cut or a growth; its length field is mostly put right again."""
    frame = bytearray(bytes.fromhex(chance.choice(GOLDEN)[1]))
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(frame) + 1)
        match chance.randrange(4):
            case 0 if at < len(frame):
                frame[at] ^= 1 << chance.randrange(8)
            case 1 if at < len(frame):
                frame[at] = chance.randrange(256)
            case 2:
                del frame[at : at + chance.randint(1, 3)]
            case 3:
                frame[at:at] = chance.randbytes(chance.randint(1, 3))
    if len(frame) >= 2 and chance.random() < 0.9:
        frame[1] = min(255, len(frame) - 2)
    return bytes(frame)


def look_at(frames: int, seed: int) -> Counter[str]:
    """Decode so many mutated frames; what is accepted has octets that mean the same."""
    chance, outcomes = random.Random(seed), Counter[str]()
    for _ in range(frames):
        frame = mutated(chance)
        for decode, encode in ((decode_advertising, encode_advertising), (decode_data, encode_data)):
            try:
                pdu = decode(frame)
            except WireError:
                outcomes["refused"] += 1
                continue
            outcomes[type(pdu).__name__] += 1
            assert decode(encode(pdu)) == pdu
    return outcomes


@pytest.mark.slow
def test_mutated_frames_are_decoded_or_refused() -> None:
    outcomes = look_at(20_000, seed=1)
    assert set(outcomes) == {"refused", "Undirected", "Directed", "ConnectInd", "Extended", "DataPdu"}
    assert min(outcomes.values()) > 200


@pytest.mark.soak
def test_many_mutated_frames_are_decoded_or_refused() -> None:
    look_at(soak_count(100_000), seed=2)
