"""What packets of LE say: golden octets written down by the layouts of the specification, and garbage."""

import json
import random
from typing import Any

import pytest

from cosim.channels.ble.bits.mesh.bearer import encode_bearer
from cosim.channels.ble.bits.mesh.network import encode_network
from cosim.channels.ble.bits.pdu import AdvertisingType, DeviceAddress, Undirected, encode_advertising
from cosim.channels.ble.broadcasts.extended import LONGEST_BROADCAST, pieces
from cosim.channels.ble.broadcasts.mesh import parts
from cosim.channels.ble.broadcasts.structures import piece_of
from cosim.channels.ble.dissection import Part, dissect, put_together
from cosim.errors import WireError
from cosim.machine import BROADCAST, Outgoing
from tests.channels.ble.test_pdu import LL_DATA_OCTETS

ADVERTISING = "d6 be 89 8e"
LINK = "41 56 65 50"
CRC = "01 02 03"
ANN = "66 55 44 33 22 11"
ON_ADVERTISING = {"access_address": "0x8e89bed6, of advertising", "crc": "010203"}
IN_THE_MESH = {"ivi": 0, "nid": 0x68, "ttl": 7, "sequence": 0x3129AB, "source": "0x0003", "destination": "0x1201"}
ON_LINK = {"access_address": "0x50655641", "crc": "010203"}


def packet(*parts: str) -> bytes:
    return bytes.fromhex("".join((*parts, CRC)))


GOLDEN: list[tuple[str, bytes, dict[str, Any], bytes | None]] = [
    (
        "ADV_IND",  # ChSel and TxAdd set; flags, name, transmit power
        packet(ADVERTISING, "60 0e", ANN, "02 01 06 02 09 41 01 0a"),
        ON_ADVERTISING
        | {"pdu": "ADV_IND", "advertiser": "11:22:33:44:55:66, random", "channel_selection": "algorithm #2"}
        | {"flags": "06", "name": "A", "structure_0x0a": ""},
        None,
    ),
    (
        "CONNECT_IND",
        packet(ADVERTISING, "45 22", ANN, "f0 e0 d0 c0 b0 a0", LL_DATA_OCTETS),
        ON_ADVERTISING
        | {"pdu": "CONNECT_IND", "initiator": "11:22:33:44:55:66, random"}
        | {"advertiser": "a0:b0:c0:d0:e0:f0, public", "channel_selection": "algorithm #1"}
        | {
            "connection": {
                "access_address": "0x50655641",
                "crc_init": "0x179a9c",
                "window_size_ms": 2.5,
                "window_offset_ms": 1.25,
                "interval_ms": 20.0,
                "latency_events": 3,
                "supervision_timeout_ms": 500.0,
                "channels": "9-10,21-23,33-36",
                "hop": 5,
                "clock_accuracy": 1,
            }
        },
        None,
    ),
    (
        "ADV_EXT_IND",  # ADI and AuxPtr: channel 0, 10 times 30 us later, on 2M
        packet(ADVERTISING, "07 07 06 18 01 20 00 0a 20"),
        ON_ADVERTISING
        | {"pdu": "ADV_EXT_IND", "mode": "none", "advertising_set": 2, "data_id": 1}
        | {"continues": {"channel_index": 0, "after_us": 300.0, "phy": "LE_2M"}},
        None,
    ),
    (
        "AUX_ADV_IND",  # AdvA and ADI, then manufacturer data that is a whole payload
        packet(ADVERTISING, "47 11 09 09", ANN, "01 20 06 ff ff ff 61 62 63"),
        ON_ADVERTISING
        | {"pdu": "AUX_ADV_IND", "mode": "none", "advertiser": "11:22:33:44:55:66, random"}
        | {"advertising_set": 2, "data_id": 1, "data_octets": 7},
        b"abc",
    ),
    (
        "ADV_NONCONN_IND",  # manufacturer data that is a whole payload
        packet(ADVERTISING, "42 0d", ANN, "06 ff ff ff 61 62 63"),
        ON_ADVERTISING
        | {"pdu": "ADV_NONCONN_IND", "advertiser": "11:22:33:44:55:66, random"}
        | {"manufacturer_data": "ffff616263"},
        b"abc",
    ),
    (
        "ADV_NONCONN_IND",  # an unsegmented message of a mesh, to all nodes
        packet(ADVERTISING, "42 20", ANN, "19 2a 68 07 3129ab 0003 ffff 40 c0ffff 616263 00000000 00000000"),
        ON_ADVERTISING
        | {"pdu": "ADV_NONCONN_IND", "advertiser": "11:22:33:44:55:66, random"}
        | {"mesh": IN_THE_MESH | {"destination": "0xffff", "application_key": 0}},
        b"abc",
    ),
    (
        "ADV_NONCONN_IND",  # message #6 of the sample data, its first segment
        packet(ADVERTISING, "42 25", ANN, "1e 2a 68 07 3129ab 0003 1201 8026ac01ee9dddfd2169326d23f3afdf 00000000"),
        ON_ADVERTISING
        | {"pdu": "ADV_NONCONN_IND", "advertiser": "11:22:33:44:55:66, random"}
        | {"mesh": IN_THE_MESH | {"application_key": None, "seq_zero": 0x9AB, "segment": 0, "last_segment": 1}},
        None,
    ),
    (
        "ADV_NONCONN_IND",  # message #1 of the sample data, a control message
        packet(ADVERTISING, "42 24", ANN, "1d 2a 68 80 000001 1201 fffd 034b50057e400000010000 0000000000000000"),
        ON_ADVERTISING
        | {"pdu": "ADV_NONCONN_IND", "advertiser": "11:22:33:44:55:66, random"}
        | {
            "mesh": {"ivi": 0, "nid": 0x68, "ttl": 0, "sequence": 1, "source": "0x1201", "destination": "0xfffd"}
            | {"control": "034b50057e400000010000"}
        },
        None,
    ),
    (
        "AUX_CHAIN_IND",  # the last of a chain: a part of a payload
        packet(ADVERTISING, "07 0b 03 08 01 20 06 ff ff ff 61 62 63"),
        ON_ADVERTISING | {"pdu": "AUX_CHAIN_IND", "mode": "none", "advertising_set": 2, "data_id": 1, "data_octets": 7},
        None,
    ),
    (
        "EMPTY",  # LLID 1, NESN, MD
        packet(LINK, "15 00"),
        ON_LINK | {"llid": "1: empty", "sn": 0, "nesn": 1, "more_data": True, "octets": 0},
        None,
    ),
    (
        "DATA",  # LLID 2, SN: an L2CAP message of six octets to ATT: a notification of the handle 3
        packet(LINK, "0a 0a 06 00 04 00 1b 03 00 61 62 63"),
        ON_LINK
        | {"llid": "2: begins a message", "sn": 1, "nesn": 0, "more_data": False, "octets": 10}
        | {"l2cap_length": 6, "l2cap_channel": 4},
        b"abc",
    ),
    (
        "DATA",  # the same, but the message goes on
        packet(LINK, "0a 0a 07 00 04 00 1b 03 00 61 62 63"),
        ON_LINK
        | {"llid": "2: begins a message", "sn": 1, "nesn": 0, "more_data": False, "octets": 10}
        | {"l2cap_length": 7, "l2cap_channel": 4},
        None,
    ),
    (
        "DATA",  # how it goes on
        packet(LINK, "01 01 64"),
        ON_LINK | {"llid": "1: goes on with a message", "sn": 0, "nesn": 0, "more_data": False, "octets": 1},
        None,
    ),
    (
        "CONTROL",
        packet(LINK, "03 09 15 fb 00 48 08 1b 00 48 01"),
        ON_LINK
        | {"llid": "3: control", "sn": 0, "nesn": 0, "more_data": False, "octets": 9}
        | {"control": "0x15: LL_LENGTH_RSP", "rx_octets": 251, "rx_us": 2120.0, "tx_octets": 27, "tx_us": 328.0},
        None,
    ),
    (
        "CONTROL",
        packet(LINK, "03 03 16 07 04"),
        ON_LINK
        | {"llid": "3: control", "sn": 0, "nesn": 0, "more_data": False, "octets": 3}
        | {"control": "0x16: LL_PHY_REQ", "tx_phys": "1M, 2M, coded", "rx_phys": "coded"},
        None,
    ),
    (
        "CONTROL",
        packet(LINK, "03 05 18 02 00 09 01"),
        ON_LINK
        | {"llid": "3: control", "sn": 0, "nesn": 0, "more_data": False, "octets": 5}
        | {"control": "0x18: LL_PHY_UPDATE_IND", "central_to_peripheral": "2M"}
        | {"peripheral_to_central": "as it is", "instant": 265},
        None,
    ),
    (
        "CONTROL",
        packet(LINK, "03 02 02 13"),
        ON_LINK
        | {"llid": "3: control", "sn": 0, "nesn": 0, "more_data": False, "octets": 2}
        | {"control": "0x02: LL_TERMINATE_IND", "error": "0x13"},
        None,
    ),
    (
        "CONTROL",
        packet(LINK, "03 0c 00 01 04 00 18 00 00 00 64 00 07 00"),
        ON_LINK
        | {"llid": "3: control", "sn": 0, "nesn": 0, "more_data": False, "octets": 12}
        | {"control": "0x00: LL_CONNECTION_UPDATE_IND", "window_size_ms": 1.25, "window_offset_ms": 5.0}
        | {"interval_ms": 30.0, "supervision_timeout_ms": 1000.0, "latency_events": 0, "instant": 7},
        None,
    ),
    (
        "CONTROL",
        packet(LINK, "03 08 01 0f 00 00 00 10 07 00"),
        ON_LINK
        | {"llid": "3: control", "sn": 0, "nesn": 0, "more_data": False, "octets": 8}
        | {"control": "0x01: LL_CHANNEL_MAP_IND", "channels": "0-3,36", "instant": 7},
        None,
    ),
    (
        "SCAN_REQ",
        packet(ADVERTISING, "43 0c", ANN, "f0 e0 d0 c0 b0 a0"),
        ON_ADVERTISING
        | {"pdu": "SCAN_REQ", "sender": "11:22:33:44:55:66, random", "target": "a0:b0:c0:d0:e0:f0, public"},
        None,
    ),
]


@pytest.mark.parametrize(("kind", "octets", "fields", "payload"), GOLDEN)
def test_a_packet_says_what_the_specification_lays_down(
    kind: str, octets: bytes, fields: dict[str, Any], payload: bytes | None
) -> None:
    assert dissect(kind, octets) == (fields, payload)


def test_only_a_notification_is_a_payload() -> None:
    other = packet(LINK, "0a 0a 06 00 05 00 1b 03 00 61 62 63")  # signalling, not ATT
    read = packet(LINK, "0a 0a 06 00 04 00 0a 03 00 61 62 63")  # another ATT PDU
    assert [dissect("DATA", each).payload for each in (other, read)] == [None, None]


@pytest.mark.parametrize("octets", [b"", b"abc", packet(LINK, "02 05 61"), packet(LINK, "00 00")])
def test_what_is_no_packet_is_refused(octets: bytes) -> None:
    with pytest.raises(WireError):
        dissect("DATA", octets)


def test_garbage_says_something_or_is_refused() -> None:
    chance = random.Random(5)
    said = 0
    for _ in range(3000):
        body = chance.randbytes(chance.randrange(60))
        header = bytes([chance.randrange(256), len(body)])
        octets = bytes.fromhex(chance.choice((ADVERTISING, LINK))) + header + body + b"crc"
        try:
            fields, _ = dissect(chance.choice(("DATA", "AUX_ADV_IND")), octets)
        except WireError:
            continue
        json.dumps(fields, allow_nan=False)
        said += 1
    assert said > 100


def flooded(address: int, sequence: int, payload: bytes) -> list[Part]:
    """Return the packets in which a node sends *payload*, twice on each of three channels."""
    made = []
    for each in parts(address, 7, sequence, Outgoing(BROADCAST, payload)):
        octets = encode_bearer(encode_network(each.pdu))
        pdu = encode_advertising(Undirected(AdvertisingType.ADV_NONCONN_IND, DeviceAddress(address, True), octets))
        made += [Part(bytes.fromhex("d6be898e") + pdu + b"crc", time > 2) for time in range(6)]
    return made


def test_segments_of_a_mesh_are_put_together_again() -> None:
    """What a relay sends, of two sources whose messages have the same sequence numbers."""
    chance = random.Random(1)
    one, other = chance.randbytes(60), chance.randbytes(50)
    turns = [flooded(0, 8_190, one), flooded(1, 8_190, other), flooded(0, 8_196, b"whole"), flooded(0, 8_197, other)]
    turns.append(flooded(0, 8_190 + 8_192, one[::-1]))
    sent = [part for at in range(0, 36, 6) for turn in turns for part in turn[at : at + 6]]
    wanted = [one, other, None, other, one[::-1]]
    for at, here in enumerate(sent):
        which = next(number for number, turn in enumerate(turns) if here in turn)
        found = put_together(here, reversed(sent[:at]), iter(sent[at + 1 :]))
        assert found == wanted[which], at
        last = turns[which][-6:]  # a segment that is missing
        assert here in last or put_together(here, iter(()), iter([part for part in sent if part not in last])) is None


@pytest.mark.parametrize("size", [0, 1, 237, 238, 239, 1000, LONGEST_BROADCAST])
def test_pieces_are_put_together_again(size: int) -> None:
    payload = random.Random(size).randbytes(size)
    parts = [piece_of(each) for each in pieces(payload)]
    assert b"".join(part for part in parts if part is not None) == payload
    assert [piece_of(each) for each in (b"", b"\x03\xff\xff\xff", b"\x04\xff\xff\xffa", b"\x05\xff\xff\xffa")] == [
        None,
        b"",
        b"a",
        None,
    ]
