"""PDUs of Bluetooth Low Energy as tshark reads them, field by field."""

import struct
from pathlib import Path

import pytest

from cosim.channels.ble.bits.access import ADVERTISING_ADDRESS
from cosim.channels.ble.bits.crc import crc24
from cosim.channels.ble.bits.pdu import (
    AdvertisingMode,
    AuxiliaryPhy,
    AuxPtr,
    ConnectInd,
    DataInfo,
    DeviceAddress,
    Extended,
    LLData,
    SyncInfo,
    encode_advertising,
)
from cosim.channels.ble.connections.channel_map import ALL_CHANNELS, ChannelMap
from cosim.units import MS, US
from tests.export.capture_reading import experts, find_tshark, read_fields

LINKTYPE = 256  # BLUETOOTH_LE_LL_WITH_PHDR
FLAGS = 0x1 | 0x2 | 0x10 | 0x20  # dewhitened; signal, reference address and offenses are valid; tshark checks the CRC
ANN = DeviceAddress(0x112233445566, random=True)
BOB = DeviceAddress(0xA0B0C0D0E0F0)


@pytest.fixture
def tshark() -> str:
    return find_tshark()


def capture(path: Path, pdu: bytes, *, auxiliary: bool) -> Path:
    """Write a pcap file with one packet."""
    flags = FLAGS | auxiliary << 7
    header = struct.pack("<BbbBIH", int(auxiliary), -60, 0, 0, ADVERTISING_ADDRESS, flags)
    packet = header + struct.pack("<I", ADVERTISING_ADDRESS) + pdu + crc24(pdu)
    file_header = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65_535, LINKTYPE)
    path.write_bytes(file_header + struct.pack("<IIII", 0, 0, len(packet), len(packet)) + packet)
    return path


def assert_read(tshark: str, path: Path, fields: dict[str, str]) -> None:
    """Assert that tshark reads these values, and has nothing to say but that it knows the access address."""
    assert read_fields(tshark, path, list(fields)) == [list(fields.values())]
    assert [line for line in experts(tshark, path) if "AccessAddress matched" not in line] == ["Notes (1)"]


@pytest.mark.slow
def test_tshark_reads_a_connect_ind(tshark: str, tmp_path: Path) -> None:
    used = ChannelMap((9, 10, 21, 22, 23, 33, 34, 35, 36))
    ll_data = LLData(0x50655641, 0x179A9C, 2_500 * US, 1_250 * US, 20 * MS, 3, 500 * MS, used, 5, 1)
    path = capture(tmp_path / "c.pcap", encode_advertising(ConnectInd(BOB, ANN, ll_data, True)), auxiliary=False)
    fields = {
        "advertising_header.pdu_type": "0x05",
        "advertising_header.ch_sel": "1",
        "advertising_header.randomized_tx": "0",
        "advertising_header.randomized_rx": "1",
        "initiator_address": "a0:b0:c0:d0:e0:f0",
        "advertising_address": "11:22:33:44:55:66",
        "link_layer_data.access_address": "0x50655641",
        "link_layer_data.crc_init": "0x179a9c",
        "link_layer_data.window_size": "2",
        "link_layer_data.window_offset": "1",
        "link_layer_data.interval": "16",
        "link_layer_data.latency": "3",
        "link_layer_data.timeout": "50",
        "link_layer_data.channel_map": "0006e0001e",
        "link_layer_data.hop": "5",
        "link_layer_data.sleep_clock_accuracy": "1",
    }
    assert_read(tshark, path, {f"btle.{name}": value for name, value in fields.items()})


@pytest.mark.slow
def test_tshark_reads_all_fields_of_an_extended_header(tshark: str, tmp_path: Path) -> None:
    pdu = Extended(
        mode=AdvertisingMode.SCANNABLE,
        advertiser=ANN,
        target=BOB,
        cte_info=0x14,
        data_info=DataInfo(0xABC, 0xD),
        aux=AuxPtr(36, 246 * MS, AuxiliaryPhy.CODED, accurate=True),
        sync=SyncInfo(8_191 * 300 * US, 7_500 * US, ALL_CHANNELS, 5, 0x50655641, 0x010203, 0xFFFE),
        tx_power_dbm=-20,
        data=bytes.fromhex("02 01 06"),
    )
    path = capture(tmp_path / "e.pcap", encode_advertising(pdu), auxiliary=True)
    header, aux, sync = (
        "extended_advertising_header",
        "extended_advertising_header.aux_pointer",
        "extended_advertising_header.sync_info",
    )
    fields = {
        "advertising_header.pdu_type": "0x07",
        f"{header}.mode": "0x02",
        "advertising_address": "11:22:33:44:55:66",
        "target_address": "a0:b0:c0:d0:e0:f0",
        f"{header}.cte_info": "0x14",
        "extended_advertising.advertising_data_info.did": "0x0abc",
        "extended_advertising.advertising_data_info.sid": "0x000d",
        f"{aux}.channel": "36",
        f"{aux}.ca": "1",
        f"{aux}.offset_units": "1",
        f"{aux}.aux_offset": "0x0334",  # 820
        f"{aux}.aux_phy": "2",
        f"{sync}.sync_offset": "0x1fff",
        f"{sync}.interval": "0x0006",
        f"{sync}.channel_map": "ffffffffbf",
        f"{sync}.sleep_clock_accuracy": "5",
        f"{sync}.access_address": "0x50655641",
        f"{sync}.crc_init": "0x010203",
        f"{sync}.event_counter": "65534",
        f"{header}.tx_power": "-20",
    }
    assert_read(tshark, path, {f"btle.{name}": value for name, value in fields.items()})
