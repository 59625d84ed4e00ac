"""Captures of Bluetooth Low Energy: packets to the octet, and as Debian's tshark reads them."""

from collections import Counter
from pathlib import Path

import pytest
import yaml

from cosim.channels.ble.bits.mesh.upper_transport import LONGEST_PAYLOAD
from cosim.channels.ble.broadcasts.extended import LONGEST_BROADCAST
from cosim.channels.ble.broadcasts.legacy import LONGEST_LEGACY
from cosim.cli import main
from cosim.export.capture import write_capture
from cosim.export.low_energy import packets
from cosim.machine import BROADCAST, Disconnect, Flush, Inquire
from cosim.trace import TRANSMISSIONS
from cosim.units import MS, S
from tests.channels.ble.ble_field import Field
from tests.checkout import ROOT
from tests.export.capture_reading import experts, find_tshark, read_fields

WORDS = {
    "ADV_IND": "ADV_IND",
    "ADV_EXT_IND": "ADV_EXT_IND",
    "AUX_ADV_IND": "AUX_ADV_IND",
    "AUX_CHAIN_IND": "AUX_CHAIN_IND",
    "CONNECT_IND": "CONNECT_IND",
    "SCAN_REQ": "SCAN_REQ",
    "SCAN_RSP": "SCAN_RSP",
    "EMPTY": "Empty PDU",
}
"""What tshark calls packets of a kind."""


@pytest.fixture(scope="module")
def tshark() -> str:
    return find_tshark()


def busy_field(phy: str) -> Field:
    """Two links, payloads short and long, one flushed, one for everyone with a chain, an inquiry, the end of a link."""
    settings = {"connection": {"phy": phy}, "broadcast": {"phy": phy, "events": 2}, "scan": {"active": True}}
    field = Field(4, tables=(TRANSMISSIONS,), idle_frames=True, interference="none", **settings)
    field.link(0, 1, 2)
    for token, length in enumerate((0, 20, 244, 3_000)):
        field.send(0, 1, bytes([token]) * length, token)
        field.send(2, 0, bytes([token]) * length, token)
    field.until(field.kernel.now + 40 * MS)
    field.do(0, Flush(1))
    field.do(3, Inquire(S, 3))
    field.send(3, BROADCAST, bytes(range(256)) * 6)
    field.send(1, BROADCAST, bytes(LONGEST_BROADCAST))
    field.until(field.kernel.now + 5 * S)
    field.do(2, Disconnect(0))
    field.until(field.kernel.now + 1 * S)
    return field


def test_a_packet_to_the_octet() -> None:
    """The ADV_IND of the reference, which tshark 4.0 reads, on channel 37: RF channel 0."""
    row = {field.name: [0] for field in TRANSMISSIONS.fields}
    row |= {"kind": ["ADV_IND"], "destination": [-1], "whole": [True], "channel": [0], "duration_ns": [128_000]}
    row |= {"body": ["d6be898e" + "0006000000000000" + "5a3960"]}
    (packet,) = packets(row)
    head = "00 00 00 00 d6be898e 310c"  # RF channel, signal, noise, offences, address, flags 0x0c31
    assert packet.data.hex() == head.replace(" ", "") + row["body"][0]
    row |= {"whole": [False], "channel": [78], "kind": ["AUX_CHAIN_IND"]}
    (packet,) = packets(row)
    assert packet.data[:10].hex() == "27000000d6be898eb114"  # RF channel 39, auxiliary, a chain, CRC wrong


@pytest.mark.parametrize("phy", ["1M", "2M", "coded"])
def test_tshark_reads_all_of_a_run_without_complaint(phy: str, tshark: str, tmp_path: Path) -> None:
    field = busy_field(phy)
    path = tmp_path / "ble.pcapng"
    count = write_capture(path, field.channel, field.trace, "")
    columns = field.trace.columns(TRANSMISSIONS.name)
    assert count == len(columns["kind"]) > 500
    told = [line for line in experts(tshark, path) if "ATT_MTU" not in line]  # a longer one is not agreed on, but used
    assert not [line for line in told if "Malformed" in line or "Error" in line], told
    names = ["_ws.col.Info", "btle_rf.channel", "btle_rf.phy"]
    rows = read_fields(tshark, path, names)
    infos = Counter(row[0] for row in rows)
    kinds = Counter(columns["kind"])
    for kind, word in WORDS.items():
        assert infos[word] == kinds[kind] > 0, kind
    assert sum(count for info, count in infos.items() if "Control Opcode" in info) == kinds["CONTROL"] > 0
    order = sorted(range(count), key=lambda row: (columns["time_ns"][row], columns["source"][row]))
    assert [int(row[1]) for row in rows] == [columns["channel"][at] // 2 for at in order]
    assert {int(row[2], 0) for row in rows} == {"1M": {0}, "2M": {0, 1}, "coded": {0, 2}}[phy]


@pytest.mark.parametrize(("by", "longest"), [("legacy", LONGEST_LEGACY), ("mesh", LONGEST_PAYLOAD)])
def test_tshark_reads_what_is_for_everyone_without_complaint(
    by: str, longest: int, tshark: str, tmp_path: Path
) -> None:
    field = Field(3, tables=(TRANSMISSIONS,), broadcast={"by": by})
    payloads = [bytes(range(size % 256)) + bytes(size - size % 256) for size in (0, 1, 8, 9, 20, 27, longest)]
    for payload in payloads:
        field.send(0, BROADCAST, payload)
    field.until(10 * S)
    assert field.arrived(1) == field.arrived(2)
    assert sorted(map(len, field.arrived(1))) == sorted(map(len, payloads))
    path = tmp_path / "ble.pcapng"
    count = write_capture(path, field.channel, field.trace, "")
    assert not [line for line in experts(tshark, path) if "Malformed" in line or "Error" in line]
    names = ["_ws.col.Info", "_ws.malformed", "btcommon.eir_ad.entry.type", "btcommon.eir_ad.entry.company_id"]
    rows = read_fields(tshark, path, [*names, "btle.advertising_header.pdu_type", "frame.protocols"])
    assert count == len(rows) > 50
    sent = [row for row in rows if "ADV_NONCONN_IND" in row[0]]
    assert len(sent) == field.trace.columns(TRANSMISSIONS.name)["kind"].count("ADV_NONCONN_IND") > 60
    assert not any(row[1] for row in rows)
    assert {int(row[4], 0) for row in sent} == {2}
    types = {(int(row[2], 0), row[3], row[5].split(":")[-1]) for row in sent}
    assert types == {(0xFF, "0xffff", "btcommon") if by == "legacy" else (0x2A, "", "btmesh")}


def check_of(pdu: bytes, init: int) -> bytes:
    """Return the CRC of *pdu*, bit by bit, by the polynomial of the reference (section 2)."""
    register = [init >> place & 1 for place in range(24)]
    for bit in (octet >> place & 1 for octet in pdu for place in range(8)):
        back = bit ^ register[23]
        register = [back, *register[:23]]
        for tap in (1, 3, 4, 6, 9, 10):
            register[tap] ^= back
    return sum(bit << place for place, bit in enumerate(reversed(register))).to_bytes(3, "little")


def test_every_crc_is_right() -> None:
    """Tshark believes what the header says of it, so it is told from the octets here."""
    assert check_of(bytes.fromhex("0006000000000000"), 0x555555) == bytes.fromhex("5a3960")
    field = busy_field("1M")
    columns = field.trace.columns(TRANSMISSIONS.name)
    bodies = [bytes.fromhex(body) for body in columns["body"]]
    inits = {b"\xd6\xbe\x89\x8e": 0x555555}
    for kind, body in zip(columns["kind"], bodies, strict=True):
        if kind == "CONNECT_IND":
            inits[body[18:22]] = int.from_bytes(body[22:25], "little")
    assert len(inits) == 3
    assert all(check_of(body[4:-3], inits[body[:4]]) == body[-3:] for body in bodies)


def test_payloads_are_att_notifications_put_together_again(tshark: str, tmp_path: Path) -> None:
    field = busy_field("1M")
    path = tmp_path / "ble.pcapng"
    write_capture(path, field.channel, field.trace, "")
    values = read_fields(tshark, path, ["btatt.value"], "-Y", "btatt.opcode == 0x1b")
    found = sorted(len(value.replace(":", "")) // 2 for (value,) in values)
    arrived = sorted(len(payload) for address in (0, 1) for payload in field.arrived(address) if len(payload) < 3_001)
    broadcasts = {1_536, LONGEST_BROADCAST}
    assert found == [length for length in arrived if length not in broadcasts]


def test_a_run_is_captured_beside_its_metrics(tmp_path: Path, capsys: pytest.CaptureFixture[str], tshark: str) -> None:
    path, scenario = tmp_path / "ble.pcapng", tmp_path / "team.yaml"
    plain = yaml.safe_load((ROOT / "examples" / "2_bluetooth.yaml").read_text(encoding="utf-8"))
    scenario.write_text(yaml.safe_dump(plain | {"duration_s": 5, "channel": {"kind": "ble"}}), encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        main(["run", str(scenario), "--pcapng", str(path)])
    assert ended.value.code == 0
    assert f"frames in {path}" in capsys.readouterr().out
    assert len(read_fields(tshark, path, ["frame.number"])) > 50
