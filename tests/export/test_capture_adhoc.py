"""Captures of 802.11: frames to the octet, and as Debian's tshark reads them; its counts are those of the tables."""

import random
import shutil
import struct
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest
import yaml

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.routing.aodv_wire import Rerr, Rrep, RrepAck, Rreq, decode_message
from cosim.channels.adhoc.routing.ip import AODV_PORT, HEADER_OCTETS, OLSR_PORT, decode
from cosim.channels.adhoc.routing.olsr_wire import decode_packet
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.cli import main
from cosim.export.capture import write_capture
from cosim.export.ieee80211 import Sent, frame_octets, packets
from cosim.kernel import Kernel
from cosim.machine import BROADCAST, Address, LinkEvent, Outgoing, Reception
from cosim.randomness import Streams
from cosim.trace import FRAMES, TRANSMISSIONS, Trace
from cosim.units import MS, US, S, Time
from tests.checkout import DATA
from tests.export.capture_reading import SUBTYPES, blocks, experts, find_tshark, read_fields

KINDS = ("none", "flooding", "aodv", "olsr")
SIZES = (500, 700)
"""Of payloads: the longer ones are preceded by RTS."""
AODV_TYPES = {Rreq: 1, Rrep: 2, Rerr: 3, RrepAck: 4}


@pytest.fixture(scope="module")
def tshark() -> str:
    return find_tshark()


# ---------------------------------------------------------------- frames to the octet (IEEE 802.11-1999, clause 7)


def sent(kind: str, destination: Address, **others: Any) -> Sent:
    values = {"reserves": 0, "number": 0, "retry": False, "routed": False, "whole": True, "body": ""}
    return Sent(time=0, source=1, kind=kind, destination=destination, **(values | others))


@pytest.mark.parametrize(
    ("frame", "octets"),
    [
        (sent("ACK", 2), "d400 0000 020000000002"),
        (sent("CTS", 258, reserves=314 * US), "c400 3a01 020000000102"),
        (sent("RTS", 2, reserves=628 * US), "b400 7402 020000000002 020000000001"),
        (
            sent("DATA", 2, reserves=314 * US, number=5, body="c0ffee"),
            "0800 3a01 020000000002 020000000001 02636f736900 5000  aaaa03 000000 88b5 c0ffee",
        ),
        (
            sent("DATA", 2, reserves=314 * US, number=4095, retry=True, routed=True, body="45"),
            "0808 3a01 020000000002 020000000001 02636f736900 f0ff  aaaa03 000000 0800 45",
        ),
        (
            sent("DATA", BROADCAST, number=4097, body="00"),
            "0800 0000 ffffffffffff 020000000001 02636f736900 1000  aaaa03 000000 88b5 00",
        ),
    ],
    ids=["ack", "cts", "rts", "data", "repeated", "broadcast"],
)
def test_every_kind_of_frame_to_the_octet(frame: Sent, octets: str) -> None:
    assert frame_octets(frame).hex() == octets.replace(" ", "")


def test_a_second_radio_has_addresses_and_a_network_of_its_own() -> None:
    assert frame_octets(sent("RTS", 2), 1).hex() == "b4000000020000010002020000010001"
    assert frame_octets(sent("DATA", 2), 1)[16:22] == b"\x02cosi\x01"


@pytest.mark.parametrize(("reserves", "told"), [(1, 1), (1000, 1), (1001, 2), (32_766_001, 32767), (40 * MS, 32767)])
def test_silence_is_told_in_microseconds_rounded_up_and_at_most_32767(reserves: Time, told: int) -> None:
    assert struct.unpack_from("<H", frame_octets(sent("RTS", 2, reserves=reserves)), 2) == (told,)


def test_packets_are_in_order_outbound_for_one_or_all_and_marked_if_they_were_cut() -> None:
    rows = [
        sent("ACK", 2)._replace(time=9),
        sent("DATA", BROADCAST)._replace(time=5, source=3),
        sent("ACK", 0, whole=False)._replace(time=5, source=2),
    ]
    table = {
        field.name: list(column) for field, column in zip(TRANSMISSIONS.fields, zip(*rows, strict=True), strict=True)
    }
    found = [(packet.time, packet.interface, packet.flags) for packet in packets(table)]
    assert found == [(5, 2, 2 | 1 << 2 | 1 << 24), (5, 3, 2 | 3 << 2), (9, 1, 2 | 1 << 2)]


# ---------------------------------------------------------------- what stations put on the air


class Host:
    def receive(self, data: bytes, reception: Reception, now: Time) -> None:
        pass

    def link(self, event: LinkEvent, now: Time) -> None:
        pass

    def drain(self, now: Time) -> None:
        pass


class Field:
    def __init__(self, places_m: Sequence[tuple[float, float]], **settings: Any) -> None:
        self.kernel = Kernel()
        self.trace = Trace((FRAMES, TRANSMISSIONS))
        given = AdhocSettings(range_m=20.0, **settings)
        self.channel = AdhocChannel(given, self.kernel, self.trace, len(places_m), Streams(5))
        for address in range(len(places_m)):
            self.channel.attach(address, Host())
        self.channel.moved(np.array(places_m))

    def send_at(self, time: Time, source: Address, destination: Address, payload: bytes) -> None:
        self.kernel.at(time, lambda: self.channel.send(source, Outgoing(destination, payload)))

    def power_at(self, time: Time, address: Address, on: bool) -> None:
        self.kernel.at(time, lambda: self.channel.power(address, on))

    def capture(self, path: Path) -> int:
        self.channel.close(self.kernel.now)
        return write_capture(path, self.channel, self.trace, "")

    def rows(self, name: str, *columns: str) -> list[tuple[Any, ...]]:
        table = self.trace.columns(name)
        return list(zip(*(table[column] for column in columns), strict=True))


def octets(path: Path) -> list[bytes]:
    """Return the frames in a file."""
    bodies = [body for kind, body in blocks(path) if kind == 6]
    return [body[20 : 20 + struct.unpack_from("<I", body, 12)[0]] for body in bodies]


def test_an_exchange_with_rts_is_told_as_the_standard_has_it(tmp_path: Path) -> None:
    field = Field([(0, 0), (5, 0)], rts_threshold=0)
    field.send_at(1 * MS, 1, 0, b"hello")
    field.kernel.run(S)
    assert field.capture(tmp_path / "a.pcapng") == 4
    # 1 Mb/s: SIFS 10 us, CTS and ACK 192 + 14 * 8 us, DATA of 24 + 8 + 5 + 4 octets 192 + 41 * 8 us
    sifs, answer, data = 10, 304, 520
    durations = [3 * sifs + 2 * answer + data, 2 * sifs + data + answer, sifs + answer, 0]
    found = octets(tmp_path / "a.pcapng")
    assert [frame[0] for frame in found] == [0xB4, 0xC4, 0x08, 0xD4]
    assert [struct.unpack_from("<H", frame, 2)[0] for frame in found] == durations
    assert found[2][-5:] == b"hello"
    assert [len(frame) for frame in found] == [16, 10, 24 + 8 + 5, 10]


def test_a_frame_that_nobody_hears_is_captured_and_has_a_row(tmp_path: Path) -> None:
    field = Field([(0, 0), (100, 0), (5, 0)], short_retries=2)
    field.send_at(1 * MS, 0, 1, b"far")
    field.send_at(200 * MS, 1, BROADCAST, b"alone")
    field.kernel.run(S)
    assert field.capture(tmp_path / "a.pcapng") == 3
    assert [frame[32:] for frame in octets(tmp_path / "a.pcapng")] == [b"far", b"far", b"alone"]
    rows = field.rows("frames", "source", "destination", "outcome")
    assert rows == [(0, 1, "out_of_range")] * 2 + [(1, -1, "out_of_range")]


def test_a_frame_whose_sender_goes_off_is_marked(tmp_path: Path) -> None:
    field = Field([(0, 0), (5, 0)])
    field.send_at(1 * MS, 0, BROADCAST, bytes(100))
    field.send_at(100 * MS, 1, BROADCAST, bytes(100))
    field.power_at(1 * MS + 500 * US, 0, False)
    field.kernel.run(S)
    field.capture(tmp_path / "a.pcapng")
    flags = [
        struct.unpack_from("<I", body, len(body) - 8)[0] for kind, body in blocks(tmp_path / "a.pcapng") if kind == 6
    ]
    assert flags == [2 | 3 << 2 | 1 << 24, 2 | 3 << 2]


# ---------------------------------------------------------------- runs as tshark reads them


class Seen(NamedTuple):
    """What tshark prints of a packet."""

    time_ns: int
    robot: int
    kind: str
    retry: bool
    receiver: int
    """-1 for all."""
    transmitter: int | None
    number: int | None
    length: int
    """Of what follows the headers of DATA, in octets."""
    ether_type: str
    messages: list[str]
    """Of AODV or OLSR, by number of type; one that is empty if there are none."""
    malformed: str


NAMES = (
    *("frame.time_epoch", "frame.interface_name", "wlan.fc.type_subtype", "wlan.fc.retry", "wlan.ra", "wlan.ta"),
    *("wlan.seq", "frame.len", "llc.type", "aodv.type", "olsr.message_type", "_ws.malformed"),
)


def robot_of(address: str) -> int | None:
    if address in ("", "ff:ff:ff:ff:ff:ff"):
        return BROADCAST if address else None
    assert address.startswith("02:00:00:00:")
    return int(address[12:].replace(":", ""), 16)


def seen(words: Sequence[str]) -> Seen:
    time, interface, subtype, retry, receiver, transmitter, number, length, llc, aodv, olsr, malformed = words
    kind = SUBTYPES[subtype]
    body = int(length) - 32 if kind == "DATA" else 0
    who = robot_of(receiver)
    assert who is not None
    robot, repeated = int(interface.removeprefix("robot ")), retry in ("1", "True")
    sequence = int(number) if number else None
    read = [f"AODV {aodv}"] if aodv else [f"OLSR {kind}" if kind else "" for kind in olsr.split(",")]
    ends = who, robot_of(transmitter), sequence
    return Seen(int(time.replace(".", "")), robot, kind, repeated, *ends, body, llc, read, malformed)


class Captured(NamedTuple):
    """A run, and what tshark makes of its capture."""

    kind: str
    """Of the routers."""
    field: Field
    packets: list[Seen]
    remarks: list[str]


@pytest.fixture(scope="module", params=KINDS)
def captured(request: pytest.FixtureRequest, tshark: str, tmp_path_factory: pytest.TempPathFactory) -> Captured:
    routing = None if request.param == "none" else {"kind": request.param}
    places = [(15.0 * robot, 0.0) for robot in range(5)] + [(30.0, 10.0)]
    field = Field(places, rts_threshold=600, routing=routing)
    stream = random.Random(3)
    for number in range(300):
        source = stream.randrange(6)
        other = stream.choice([robot for robot in range(BROADCAST, 6) if robot != source])
        at = (5 + number // 10) * S + stream.randrange(40) * 25 * MS
        field.send_at(at, source, other, bytes(stream.choice(SIZES)))
    for at, robot, on in ((20, 2, False), (27, 2, True), (28, 5, False)):
        field.power_at(at * S, robot, on)
    field.kernel.run(40 * S)
    path = tmp_path_factory.mktemp("capture") / f"{request.param}.pcapng"
    count = field.capture(path)
    found = [seen(words) for words in read_fields(tshark, path, NAMES)]
    assert len(found) == count
    return Captured(request.param, field, found, experts(tshark, path))


@pytest.mark.slow
def test_every_frame_of_the_table_is_captured_once(captured: Captured) -> None:
    columns = ("time_ns", "source", "kind", "length")
    table = {(time, source): rest for time, source, *rest in captured.field.rows("frames", *columns)}
    assert [(packet.time_ns, packet.robot) for packet in captured.packets] == sorted(table)
    assert {(packet.time_ns, packet.robot): [packet.kind, packet.length] for packet in captured.packets} == table
    assert len(captured.packets) == captured.field.channel.summary()["frames_sent"]


@pytest.mark.slow
def test_receivers_and_transmitters_are_those_of_the_table(captured: Captured) -> None:
    receivers: dict[tuple[Time, Address], set[Address]] = {}
    for time, source, destination in captured.field.rows("frames", "time_ns", "source", "destination"):
        receivers.setdefault((time, source), set()).add(destination)
    for packet in captured.packets:
        meant_for = receivers[packet.time_ns, packet.robot]
        assert packet.receiver == BROADCAST or meant_for == {packet.receiver}
        assert packet.receiver != BROADCAST or packet.robot not in meant_for
        assert packet.transmitter == (packet.robot if packet.kind in ("DATA", "RTS") else None)


@pytest.mark.slow
def test_the_frames_that_say_so_are_those_that_were_sent_before(captured: Captured) -> None:
    before: set[tuple[int, int | None]] = set()
    for packet in captured.packets:
        if packet.kind == "DATA":
            assert packet.retry == ((packet.robot, packet.number) in before), packet
            before.add((packet.robot, packet.number))
        else:
            assert (packet.retry, packet.number) == (False, None)
    if captured.field.channel.summary()["payloads_dropped"]:
        assert any(packet.retry for packet in captured.packets)


@pytest.mark.slow
def test_messages_of_routers_are_as_many_as_in_the_table(captured: Captured) -> None:
    """As far as the lengths in it tell them apart: payloads are long, and only route requests have 24 octets."""
    columns = ("time_ns", "source", "kind", "length")
    data = {row[:2]: row[3] for row in captured.field.rows("frames", *columns) if row[2] == "DATA"}
    short = [length - HEADER_OCTETS for length in data.values() if length < min(SIZES)]
    assert bool(short) == (captured.kind in ("aodv", "olsr"))
    assert [sum(packet.messages[0].startswith(name) for packet in captured.packets) for name in ("AODV", "OLSR")] == [
        len(short) if captured.kind == router else 0 for router in ("aodv", "olsr")
    ]
    requests = sum(packet.messages == ["AODV 1"] for packet in captured.packets)
    assert requests == (short.count(24) if captured.kind == "aodv" else 0)
    if short:
        firsts = [packet for packet in captured.packets if packet.messages != [""] and not packet.retry]
        assert len(firsts) == captured.field.channel.summary()["control_packets"]


@pytest.mark.slow
def test_messages_of_routers_are_those_that_our_decoders_find(captured: Captured) -> None:
    rows = captured.field.rows("transmissions", "time_ns", "source", "routed", "body")
    ours = {row[:2]: messages(bytes.fromhex(row[3]) if row[2] else b"") for row in rows}
    assert {(packet.time_ns, packet.robot): packet.messages for packet in captured.packets} == ours
    kinds = {name for packet in captured.packets for name in packet.messages}
    assert kinds == {""} | {"aodv": {"AODV 1", "AODV 2", "AODV 3"}, "olsr": {"OLSR 1", "OLSR 2"}}.get(
        captured.kind, set()
    )


@pytest.mark.slow
def test_hellos_of_aodv_are_replies_to_all(captured: Captured) -> None:
    rows = captured.field.rows("transmissions", "destination", "routed", "body")
    told = [(row[0], messages(bytes.fromhex(row[2]))) for row in rows if row[1]]
    hellos = sum(packet.receiver == BROADCAST and packet.messages == ["AODV 2"] for packet in captured.packets)
    assert hellos == told.count((BROADCAST, ["AODV 2"]))
    assert bool(hellos) == (captured.kind == "aodv")


def messages(packet: bytes) -> list[str]:
    """Return what our own decoders find in an IPv4 packet."""
    datagram = decode(packet) if packet else None
    if datagram is not None and datagram.port == AODV_PORT:
        return [f"AODV {AODV_TYPES[type(decode_message(datagram.data))]}"]
    if datagram is not None and datagram.port == OLSR_PORT:
        return [f"OLSR {message.kind}" for message in decode_packet(datagram.data)[1]]
    return [""]


@pytest.mark.slow
def test_tshark_finds_nothing_malformed_and_has_notes_only(captured: Captured) -> None:
    assert {packet.malformed for packet in captured.packets} == {""}
    assert not [remark for remark in captured.remarks if remark.startswith(("Errors", "Warns"))], captured.remarks


@pytest.mark.slow
def test_bodies_have_the_ether_type_of_what_they_are(captured: Captured) -> None:
    wanted = "0x88b5" if captured.kind == "none" else "0x0800"
    assert {packet.ether_type for packet in captured.packets if packet.kind == "DATA"} == {wanted}


# ---------------------------------------------------------------- runs of the command line


SCENARIO = {
    "name": "five",
    "seed": 4,
    "duration_s": 12,
    "team": {"size": 5, "starts": [[1.0 + 3 * robot, 1.0] for robot in range(5)]},
    "channel": {"kind": "adhoc", "range_m": 4.0, "routing": {"kind": "olsr"}},
    "protocol": {"use": "chatter:SPEC"},
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    for name in ("beacon", "chatter"):
        shutil.copy(DATA / f"{name}.py", tmp_path)
        monkeypatch.delitem(sys.modules, name, raising=False)
    return tmp_path


def run(scenario: dict[str, Any], *words: str) -> None:
    Path("run.yaml").write_text(yaml.safe_dump(scenario))
    with pytest.raises(SystemExit) as ended:
        main(["run", "run.yaml", *words])
    assert ended.value.code == 0


@pytest.mark.slow
def test_the_capture_of_a_run_has_the_frames_of_its_table(tshark: str, folder: Path) -> None:
    run(SCENARIO, "--pcapng", "a.pcapng", "--trace", "tables")
    frames = pd.read_parquet(folder / "tables" / "frames.parquet").drop_duplicates(["time_ns", "source"])
    found = [seen(words) for words in read_fields(tshark, folder / "a.pcapng", NAMES)]
    assert Counter(packet.kind for packet in found) == Counter(frames.kind)
    assert {"DATA", "ACK"} <= set(frames.kind)
    ordered = frames.sort_values(["time_ns", "source"])
    assert [(packet.time_ns, packet.robot) for packet in found] == list(
        zip(ordered.time_ns, ordered.source, strict=True)
    )
    assert {"OLSR 1", "OLSR 2"} <= {name for packet in found for name in packet.messages}


@pytest.mark.slow
def test_radios_of_several_kinds_stand_in_one_file(tshark: str, folder: Path) -> None:
    groups = [{"size": 2, "radios": [0, 1, 2]}, {"size": 1, "radios": [0, 2, 3]}]
    team = {"groups": groups, "starts": [[1, 1], [3, 1], [2, 3]]}
    adhoc = SCENARIO["channel"]
    channel = {"kind": "radios", "radios": [{"kind": "bluetooth"}, adhoc, {"kind": "ideal"}, adhoc]}
    run(SCENARIO | {"team": team, "channel": channel}, "--pcapng", "a.pcapng", "--trace", "tables")
    names = ("frame.time_epoch", "frame.interface_name", "frame.protocols", "wlan.bssid")
    found = read_fields(tshark, folder / "a.pcapng", names)
    radios = {(name, "wlan" in protocols, "btbredr" in protocols, network) for _, name, protocols, network in found}
    assert radios == {
        *((f"robot {robot} radio 0", False, True, "") for robot in range(3)),
        *((f"robot {robot} radio 1", True, False, "02:63:6f:73:69:01") for robot in range(2)),
        ("robot 2 radio 3", True, False, "02:63:6f:73:69:03"),
    }
    times = [int(words[0].replace(".", "")) for words in found]
    assert times == sorted(times)
    frames = pd.read_parquet(folder / "tables" / "frames.parquet")
    heard = frames[(frames.radio == 0) & (frames.outcome == "received")]
    others = frames[frames.radio > 0].drop_duplicates(["time_ns", "source", "radio"])
    assert Counter(name[-1] for _, name, *_ in found) == Counter(pd.concat([heard, others]).radio.astype(str))


@pytest.mark.slow
def test_a_capture_changes_nothing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(SCENARIO, "--json")
    without = capsys.readouterr().out
    run(SCENARIO, "--json", "--pcapng", "a.pcapng")
    assert capsys.readouterr().out == without
