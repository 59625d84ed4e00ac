"""Captures of Bluetooth as Debian's tshark reads them: the frames of a run, one by one, and nothing malformed."""

import shutil
import struct
import sys
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import pytest
import yaml

from cosim.channels.bluetooth.bits.codes import crc16
from cosim.channels.bluetooth.radio import Identity
from cosim.channels.clock import NativeClock
from cosim.cli import main
from cosim.export.baseband import LINK_TYPE, interface, packets
from cosim.export.pcapng import INBOUND, Interface, Packet, write_pcapng
from cosim.machine import Outgoing, RoleChanged, SwitchRole
from cosim.units import MS, US, S
from tests.channels.bluetooth.bluetooth_world import World
from tests.checkout import DATA
from tests.export.capture_reading import TYPES, blocks, experts, find_tshark, read_fields

GIAC = 0x9E8B33
MASTER, SLAVE, OTHER = 0, 1, 2
WORDS = (0x47A1B2C3, 0x00FFFFFE, 0xF3000001)
DEVICES = [
    Identity(MASTER, WORDS[MASTER], NativeClock(1_000_000_007, 20)),
    Identity(SLAVE, WORDS[SLAVE], NativeClock((1 << 28) * 312_500 - 5 * S, -20)),
    Identity(OTHER, WORDS[OTHER], NativeClock(0, 0)),
]
COLUMNS = ("time_ns", "source", "destination", "kind", "channel", "lt_addr", "length", "outcome", "part")


class Row(NamedTuple):
    """A row of the table of frames, and whose LAP its access code is made of; None if it is in no capture."""

    time_ns: int
    source: int
    destination: int
    kind: str
    channel: int
    lt_addr: int
    length: int
    outcome: str
    part: str
    lap: int | None


def row(time_us, ends, kind, lap_of, lt_addr=0, length=0, outcome="received", part=""):
    lap = WORDS[lap_of] & 0xFFFFFF if lap_of in (MASTER, SLAVE, OTHER) else lap_of
    return Row(time_us * US, *ends, kind, time_us % 79, lt_addr, length, outcome, part, lap)


DOWN, UP = (MASTER, SLAVE), (SLAVE, MASTER)
INQUIRED = [
    row(1000, DOWN, "ID", GIAC),  # a back-off follows
    row(4000, DOWN, "ID", GIAC),
    row(4625, UP, "FHS", GIAC),
    row(4800, (OTHER, MASTER), "FHS", None, outcome="busy"),
]
PAGED = [
    row(10_000, DOWN, "ID", SLAVE),
    row(10_625, UP, "ID", SLAVE),
    row(11_250, DOWN, "FHS", SLAVE, outcome="collided", part="payload"),
    row(12_500, DOWN, "FHS", SLAVE),
    row(13_125, UP, "ID", SLAVE),
    row(13_750, DOWN, "POLL", MASTER, 3),
    row(14_375, UP, "NULL", MASTER, 3),
]
FORSAKEN = [
    row(20_000, (MASTER, OTHER), "ID", OTHER),
    row(20_625, (OTHER, MASTER), "ID", OTHER),
    row(21_250, (MASTER, OTHER), "FHS", OTHER),
    row(4_000_000, (MASTER, OTHER), "POLL", MASTER, 5),  # of a later page
]
UNPAGED = [  # a link that was there from the beginning
    row(30_000, (OTHER, SLAVE), "DH1", OTHER, 1, 2, "bit_errors", "payload"),
    row(30_625, (SLAVE, OTHER), "DM1", OTHER, 1, 2),
]
TURNED = [row(8_000_000, UP, "POLL", SLAVE, 1), row(8_000_625, DOWN, "NULL", SLAVE, 1)]  # the slave has become master
TALKED = [
    row(5_000_000 + 10_000 * number, ends, kind, MASTER, 3, length)
    for number, (ends, kind, length) in enumerate(
        (ends, kind, length)
        for kind, capacity in {"DM1": 17, "DH1": 27, "DM3": 121, "DH3": 183, "DM5": 224, "DH5": 339}.items()
        for ends, length in ((DOWN, 0), (UP, 1), (DOWN, capacity))
    )
]
SPOILT = [
    row(6_000_000, DOWN, "DM3", MASTER, 3, 50, "bit_errors", "payload"),
    row(6_010_000, UP, "DH1", MASTER, 3, 5, "collided", "payload"),
    row(6_020_000, DOWN, "DM3", None, 3, 50, "bit_errors", "header"),
    row(6_030_000, DOWN, "DM3", None, 3, 50, "collided", "access_code"),
    row(6_040_000, DOWN, "POLL", None, 3, 0, "out_of_range"),
    row(6_050_000, DOWN, "POLL", None, 3, 0, "not_tuned"),
]
REFUSED = [row(6_060_000, DOWN, "DH1", MASTER, 3, 5, "refused")]
BROADCAST = [
    row(7_000_000, DOWN, "DM1", MASTER, 0, 13),
    row(7_000_000, (MASTER, OTHER), "DM1", MASTER, 0, 13),
]
ROWS = [
    *TALKED,
    *FORSAKEN,
    *TURNED,
    *UNPAGED,
    *PAGED,
    *INQUIRED,
    *SPOILT,
    *REFUSED,
    *BROADCAST,
]  # idle frames are recorded late, others when they end


class Seen(NamedTuple):
    """What tshark prints of a packet."""

    time_ns: int
    interface: str
    channel: int
    lap: int
    reference_lap: int
    lt_addr: int | None
    kind: int | None
    length: int | None
    cast: int
    """1 for unicast, 3 for broadcast."""
    crc_error: bool
    hec_passed: bool
    malformed: str
    expert: str
    fhs: tuple[int, ...]


FIELDS = (
    "frame.time_epoch",
    "frame.interface_name",
    "btbredr_rf.rf_channel",
    "btbredr_rf.lower_address_part",
    "btbredr_rf.reference_lower_address_part",
    "btbredr_rf.packet_header.lt_addr",
    "btbredr_rf.packet_header.type",
    "btbredr_rf.payload_header.length",
    "frame.packet_flags_reception_type",
    "frame.packet_flags_crc_error",
    "btbredr_rf.flags.hec_pass",
    "_ws.malformed",
    "_ws.expert.message",
    *(f"btbredr_fhs.{name}" for name in ("lap", "uap", "nap", "ltaddr", "clk", "sr")),
)


@pytest.fixture(scope="module")
def tshark() -> str:
    return find_tshark()


def read(program: str, path: Path) -> list[Seen]:
    return [seen(words) for words in read_fields(program, path, FIELDS)]


def not_checked(count: int) -> list[str]:
    """Return what there is to say of the IDs of pages: they have no header."""
    return [f"Notes ({count})", f"{count} Protocol BT BR/EDR RF Packet Header with HEC is not checked"]


def seen(words: list[str]) -> Seen:
    numbers = [int(word, 0) if word else None for word in (*words[2:9], *words[13:])]
    time_ns = int(words[0].replace(".", ""))
    assert len(words[0].partition(".")[2]) == 9
    crc_error, hec_passed = (word in ("1", "True") for word in words[9:11])
    fhs = tuple(number for number in numbers[7:] if number is not None)
    return Seen(time_ns, words[1], *numbers[:7], crc_error, hec_passed, *words[11:13], fhs)  # type: ignore[arg-type]


def write_capture(path: Path, rows: dict[str, list[Any]]) -> int:
    interfaces = [interface(device, f"robot {device.address}") for device in DEVICES]
    return write_pcapng(path, interfaces, packets(rows, DEVICES))


def table(rows) -> dict[str, list[Any]]:
    return {name: [getattr(row, name) for row in rows] for name in COLUMNS}


@pytest.fixture(scope="module")
def capture(tshark: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("capture") / "rows.pcapng"
    write_capture(path, table(ROWS))
    return path


@pytest.fixture(scope="module")
def captured(tshark: str, capture: Path) -> list[Seen]:
    return read(tshark, capture)


HEARD = sorted((row for row in ROWS if row.lap is not None), key=lambda row: row.time_ns)


# ---------------------------------------------------------------- rows as tshark reads them


@pytest.mark.slow
def test_the_frames_whose_headers_were_heard_are_captured_in_order(captured: list[Seen]):
    assert [packet[:5] for packet in captured] == [
        (row.time_ns, f"robot {row.destination}", row.channel, row.lap, row.lap) for row in HEARD
    ]


@pytest.mark.slow
def test_the_flags_say_what_was_for_all_and_what_was_checked(captured: list[Seen]):
    assert [(packet.cast, packet.hec_passed) for packet in captured] == [
        (3 if row in BROADCAST else 1, row.kind != "ID") for row in HEARD
    ]


@pytest.mark.slow
def test_lt_addr_and_type_are_those_of_the_table(captured: list[Seen]):
    assert [(packet.lt_addr, packet.kind) for packet in captured] == [
        (None, None) if row.kind == "ID" else (row.lt_addr, TYPES[row.kind]) for row in HEARD
    ]


@pytest.mark.slow
def test_payloads_have_their_lengths_and_crc(captured: list[Seen]):
    whole = {row: packet for row, packet in zip(HEARD, captured, strict=True) if row.kind[0] == "D" and not row.part}
    assert len(whole) == len(TALKED) + len(BROADCAST) + len(REFUSED) + 1
    assert all(packet.length == row.length and not packet.crc_error for row, packet in whole.items())


@pytest.mark.slow
def test_a_lost_payload_is_marked(captured: list[Seen]):
    spoilt = [packet for row, packet in zip(HEARD, captured, strict=True) if row.part]
    assert [(packet.crc_error, packet.length, packet.fhs) for packet in spoilt] == [(True, None, ())] * 4
    assert sum(packet.crc_error for packet in captured) == 4


@pytest.mark.slow
def test_tshark_finds_nothing_wrong(tshark: str, capture: Path, captured: list[Seen]):
    assert {(packet.malformed, packet.expert) for packet in captured} == {("", "")}
    assert experts(tshark, capture) == not_checked(5)


@pytest.mark.slow
def test_an_fhs_tells_address_and_clock_of_its_sender(captured: list[Seen]):
    found = [(row, packet.fhs) for row, packet in zip(HEARD, captured, strict=True) if packet.fhs]
    assert len(found) == 3
    for row, (lap, uap, nap, lt_addr, clk, repetition) in found:
        device = DEVICES[row.source]
        assert (uap << 24 | lap, nap, repetition) == (device.hop_address, 0, 1)
        assert lt_addr == (3 if (row.source, row.destination) == DOWN else 0)
        local = device.clock.phase + row.time_ns + row.time_ns * device.clock.ppm // 1_000_000
        assert clk == local // 1_250_000 % (1 << 26)


# ---------------------------------------------------------------- the file


def test_the_blocks_are_a_section_the_interfaces_and_the_packets(tmp_path: Path):
    path = tmp_path / "two.pcapng"
    packets = [Packet(5 << 32 | 7, 1, INBOUND, b"abcde"), Packet(9 << 32, 0, INBOUND, b"")]
    interfaces = [Interface(255, "robot 0", ""), Interface(105, "robot 10", "the tenth")]
    assert write_pcapng(path, interfaces, packets, comment="two") == 2
    assert [kind for kind, _ in blocks(path)] == [0x0A0D0D0A, 1, 1, 6, 6]
    section, first, second, packet, _ = (body for _, body in blocks(path))
    assert section.startswith(bytes.fromhex("4d3c2b1a 0100 0000 ffffffffffffffff 0100 0300") + b"two\0")
    assert first == bytes.fromhex("ff00 0000 00000000 0200 0700") + b"robot 0\0" + bytes.fromhex(
        "0900 0100 09000000 00000000"
    )
    assert second.startswith(bytes.fromhex("6900 0000 00000000 0200 0800") + b"robot 10" + bytes.fromhex("0300 0900"))
    fixed = struct.pack("<IIIII", 1, 5, 7, 5, 5)
    assert packet == fixed + b"abcde\0\0\0" + bytes.fromhex("0200 0400 01000000 00000000")


def test_the_crc_of_a_lost_payload_is_wrong(tmp_path: Path):
    spoilt = SPOILT[0]
    write_capture(tmp_path / "a.pcapng", table([PAGED[5], spoilt, spoilt._replace(outcome="received", part="")]))
    payloads = [body[20:][22 : 22 + 2 + 50 + 2] for _, body in blocks(tmp_path / "a.pcapng")[-2:]]
    assert [crc16(WORDS[MASTER] >> 24, payload) == 0 for payload in payloads] == [False, True]


def test_a_capture_that_fails_leaves_what_was_there(tmp_path: Path):
    path = tmp_path / "half.pcapng"
    path.write_bytes(b"old")

    def packets():
        yield Packet(0, 0, INBOUND, b"abc")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_pcapng(path, [Interface(LINK_TYPE, "robot 0", "")], packets())
    assert [(file, file.read_bytes()) for file in tmp_path.iterdir()] == [(path, b"old")]


def test_a_link_that_has_been_turned_round_has_the_access_code_of_its_new_master():
    """Who has so much to say that it never polls."""
    world = World(2)
    world.connect(1)
    now = world.kernel.now
    for number in range(60):
        world.at(now + number * 8 * MS, lambda: world.channel.send(1, Outgoing(0, b"x")))
    world.at(now + 240 * MS, lambda: world.command(0, SwitchRole(1)))
    world.kernel.run(now + 480 * MS)
    devices = [device.identity for device in world.channel.devices]
    frames = world.trace.columns("frames")
    laps = [(packet.time, *struct.unpack_from("<I", packet.data, 8)) for packet in packets(frames, devices)]
    old, new = (device.hop_address & 0xFFFFFF for device in devices)
    turned = world.hosts[1].when(RoleChanged)[0]
    assert {lap for time, lap in laps if now < time < turned} == {old}
    later = [lap for time, lap in laps if time >= turned]
    assert later == [new] * len(later)
    assert len(later) > 40
    assert "POLL" not in [kind for kind, time in zip(frames["kind"], frames["time_ns"], strict=True) if time >= turned]


def test_a_table_without_parts_is_read_too(tmp_path: Path):
    rows = table([row for row in ROWS if not row.part])
    del rows["part"]
    assert write_capture(tmp_path / "a.pcapng", rows) == len([row for row in HEARD if not row.part])


# ---------------------------------------------------------------- runs


SCENARIO = {
    "name": "three",
    "seed": 2,
    "duration_s": 20,
    "team": {"size": 3, "starts": [[1, 1], [3, 1], [1, 6]]},
    # so deaf that payloads and headers are lost on the longer link
    "channel": {
        "kind": "bluetooth",
        "idle_frames": True,
        "propagation": {},
        "power_class": 3,
        "sensitivity_dbm": -52.5,
    },
    "protocol": {"use": "chatter:SPEC"},
}


def run(*words: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["run", *words])
    return int(str(ended.value.code))


@pytest.fixture
def scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    for name in ("beacon", "chatter"):
        shutil.copy(DATA / f"{name}.py", tmp_path)
        monkeypatch.delitem(sys.modules, name, raising=False)
    Path("three.yaml").write_text(yaml.safe_dump(SCENARIO))
    return "three.yaml"


@pytest.mark.slow
def test_tshark_reads_the_frames_of_a_run(tshark: str, scenario: str, capsys: pytest.CaptureFixture[str]):
    assert run(scenario, "--pcapng", "captures/three.pcapng", "--trace", "tables") == 0
    frames = pd.read_parquet("tables/frames.parquet").sort_values("time_ns", kind="stable")
    heard = frames[(frames.outcome == "received") | (frames.part == "payload")]
    assert set(heard.kind) == {"ID", *TYPES}
    assert {"", "payload"} == set(heard.part) < set(frames.part)
    packets = read(tshark, Path("captures/three.pcapng"))
    assert f"{len(packets)} frames in captures/three.pcapng, " in capsys.readouterr().out
    assert [(packet.time_ns, packet.interface, packet.channel) for packet in packets] == [
        (row.time_ns, f"robot {row.destination}", row.channel) for row in heard.itertuples()
    ]
    assert [(packet.lt_addr, packet.kind) for packet in packets] == [
        (None, None) if row.kind == "ID" else (row.lt_addr, TYPES[row.kind]) for row in heard.itertuples()
    ]
    assert [packet.crc_error for packet in packets] == [part != "" for part in heard.part]
    assert {(packet.malformed, packet.expert) for packet in packets} == {("", "")}
    paged = [packet.lap for packet in packets if packet.kind is None and packet.lap != GIAC]
    assert experts(tshark, Path("captures/three.pcapng")) == not_checked(len(paged))
    # what devices tell of themselves in inquiry (no LT_ADDR) and page is what the others' access codes are made of
    told = {(packet.fhs[0], packet.fhs[3] > 0) for packet in packets if packet.fhs}
    assert {lap for lap, master in told if not master} == set(paged)
    assert len(set(paged)) == 2
    assert {lap for lap, master in told if master} == {packet.lap for packet in packets if packet.kind not in (None, 2)}


@pytest.mark.slow
def test_a_capture_needs_no_trace_and_changes_nothing(scenario: str, capsys: pytest.CaptureFixture[str]):
    assert run(scenario, "--json") == 0
    without = capsys.readouterr().out
    assert run(scenario, "--json", "--pcapng", "three.pcapng") == 0
    assert capsys.readouterr().out == without
    assert [kind for kind, _ in blocks(Path("three.pcapng"))][:5] == [0x0A0D0D0A, 1, 1, 1, 6]


def test_captures_are_of_radios_only(scenario: str, capsys: pytest.CaptureFixture[str]):
    assert run(scenario, "--set", "channel={kind: ideal}", "--pcapng", "new/three.pcapng") == 2
    told = capsys.readouterr()
    assert told.err == "--pcapng: channel.kind is 'ideal', captures are of 'bluetooth', 'adhoc', 'ble' only\n"
    assert told.out == ""
    assert not Path("new").exists()


def test_a_folder_is_no_capture(scenario: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert run(scenario, "--pcapng", str(tmp_path)) == 2
    assert capsys.readouterr().err.count("\n") == 1
