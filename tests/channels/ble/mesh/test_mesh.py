"""Payloads for everyone by legacy advertising and by flooding: who gets them, how often, and what is on the air."""

from collections import Counter
from itertools import pairwise
from typing import Any

import pytest
from pydantic import ValidationError

from cosim.channels.ble.bits.mesh.bearer import encode_bearer
from cosim.channels.ble.bits.mesh.lower_transport import Whole, encode_lower
from cosim.channels.ble.bits.mesh.network import ALL_NODES, NetworkPdu, decode_network, encode_network
from cosim.channels.ble.bits.mesh.upper_transport import encode_upper
from cosim.channels.ble.bits.pdu import (
    AdvertisingType,
    DeviceAddress,
    Undirected,
    encode_advertising,
)
from cosim.channels.ble.broadcasts.extended import LONGEST_BROADCAST
from cosim.channels.ble.broadcasts.mesh import parts
from cosim.channels.ble.packets import Sent
from cosim.channels.ble.phy import LE_1M
from cosim.channels.ble.settings import BleSettings
from cosim.channels.ble.spec import SPEC
from cosim.channels.energy import TRANSMIT
from cosim.machine import BROADCAST, Fate, Flush, Outcome, Outgoing, Scan
from cosim.protocol import PayloadBytes
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import FRAMES, PAYLOADS, TRANSMISSIONS
from cosim.units import MS, US, S
from tests.channels.ble.ble_field import Field

SPACING_M = 10.0
SLOWLY = {"interval_s": 10.24, "window_s": 10.24}
"""A scan that hardly ever changes its channel, in the middle of an event or else."""


def field_of(size: int, by: str, seed: int = 1, mesh: dict[str, Any] | None = None, **settings: Any) -> Field:
    """Return devices that nobody finds, all in reach of each other."""
    broadcast = settings.pop("broadcast", {}) | {"by": by} | ({} if mesh is None else {"mesh": mesh})
    tables = (TRANSMISSIONS, FRAMES, PAYLOADS)
    field = Field(size, seed, tables, broadcast=broadcast, **settings)
    for address in range(size):
        field.do(address, Scan(False))
    field.until(20 * MS)
    return field


def line_of(size: int, seed: int = 1, **settings: Any) -> Field:
    """Return a mesh in which each device is in reach of those beside it only, and nothing is lost."""
    settings = {"range_m": 1.05 * SPACING_M, "interference": "none", "listen": SLOWLY} | settings
    field = field_of(size, "mesh", seed, **settings)
    field.move([(SPACING_M * number, 0.0) for number in range(size)])
    return field


def sent_by(field: Field) -> Counter[int]:
    """Return how many packets each device has sent to everyone."""
    columns = field.trace.columns(TRANSMISSIONS.name)
    assert set(columns["kind"]) <= {"ADV_NONCONN_IND"}
    return Counter(columns["source"])


def bodies(field: Field) -> list[tuple[int, int, bytes]]:
    """Return (start, sender, advertising data) of all packets."""
    columns = field.trace.columns(TRANSMISSIONS.name)
    rows = zip(columns["time_ns"], columns["source"], columns["body"], strict=True)
    return [(time, source, bytes.fromhex(body)[4 + 2 + 6 : -3]) for time, source, body in rows]


# ---------------------------------------------------------------- what fits


@pytest.mark.parametrize(("by", "longest"), [("extended", LONGEST_BROADCAST), ("legacy", 27), ("mesh", 377)])
def test_the_longest_payload_arrives_and_a_longer_one_is_refused_and_counted(by: str, longest: int) -> None:
    settings = BleSettings(broadcast={"by": by})
    assert SPEC.payload_bytes(settings) == PayloadBytes(65_532, longest)
    field = field_of(3, by, interference="none")
    payload = bytes(at % 251 for at in range(longest))
    field.send(0, BROADCAST, payload + b"x", 1)
    field.until(1 * S)
    assert [each.what for each in field.of(0, Fate)] == [Fate(1, Outcome.TOO_LONG)]
    assert not field.trace.columns(TRANSMISSIONS.name)["kind"]
    assert dict(field.channel.unsent) == {(0, Outcome.TOO_LONG): 1}
    field.send(0, BROADCAST, payload, 2)
    field.send(2, BROADCAST, b"", 3)
    field.until(20 * S)
    assert field.arrived(1) in ([payload, b""], [b"", payload])
    assert (field.arrived(0), field.arrived(2)) == ([b""], [payload])


def test_no_wrong_settings_are_taken() -> None:
    for broadcast, told in (
        ({"by": "legacy", "phy": "2M"}, "phy"),
        ({"by": "mesh", "phy": "coded"}, "phy"),
        ({"by": "mesh", "mesh": {"ttl": 1}}, "is not 0, or from 2 to 127"),
        ({"by": "mesh", "mesh": {"ttl": 128}}, "ttl"),
        ({"by": "mesh", "mesh": {"network_interval_s": 0.025}}, "multiple of 10 ms from 10 to 320"),
        ({"by": "mesh", "mesh": {"relay_interval_s": 0.33}}, "multiple of 10 ms from 10 to 320"),
        ({"by": "mesh", "mesh": {"relay_transmits": 9}}, "relay_transmits"),
        ({"by": "mesh", "mesh": {"network_transmits": 0}}, "network_transmits"),
        ({"by": "mesh", "mesh": {"cache": 1}}, "cache"),
        ({"by": "mesh", "mesh": {"relay_buffers": 0}}, "relay_buffers"),
        ({"by": "flood"}, "by"),
        ({"by": "mesh", "events": 4}, "is not for mesh, which has network_transmits and network_interval_s"),
        ({"by": "mesh", "interval_s": 0.03}, "is not for mesh, which has network_transmits and network_interval_s"),
    ):
        with pytest.raises(ValidationError, match=told):
            BleSettings(broadcast=broadcast)
    assert BleSettings().broadcast.by == "extended"


# ---------------------------------------------------------------- legacy advertising


def test_a_legacy_event_is_three_packets_with_the_payload() -> None:
    field = field_of(3, "legacy", listen=SLOWLY, broadcast={"events": 4, "interval_s": 0.05})
    payload = bytes(range(27))
    field.send(1, BROADCAST, payload, 1)
    field.until(1 * S)
    rows, columns = bodies(field), field.trace.columns(TRANSMISSIONS.name)
    assert {data for *_, data in rows} == {bytes.fromhex("1effffff") + payload}
    assert columns["duration_ns"] == [376_000] * 12  # 8 + 32 + 8 x (2 + 6 + 31 + 3) us
    assert columns["channel"] == [0, 24, 78] * 4
    assert (columns["length"], columns["retry"]) == ([27] * 12, [False] * 3 + [True] * 9)
    starts = [time for time, *_ in rows]
    assert all(starts[at + 1] - starts[at] == 526_000 for at in range(12) if at % 3 < 2)
    gaps = [starts[at + 3] - starts[at] for at in (0, 3, 6)]
    assert all(50 * MS <= gap <= 60 * MS for gap in gaps)
    assert len(set(gaps)) == 3
    assert [each.what for each in field.of(1, Fate)] == [Fate(1, Outcome.SENT)]
    assert field.of(1, Fate)[0].time == starts[-1] + 376_000
    assert (field.arrived(0), field.arrived(2)) == ([payload], [payload])
    assert field.trace.columns(PAYLOADS.name)["begun_ns"] == [starts[0]]
    heard = field.trace.columns(FRAMES.name)
    assert heard["outcome"] == ["received"] * 8  # both hear one packet of each event


@pytest.mark.parametrize("by", ["legacy", "mesh"])
def test_who_listens_seldom_hears_as_seldom(by: str) -> None:
    """One event of three packets within 1.5 ms meets a window of the interval's hundredth, on one of its channels."""
    once: dict[str, Any] = {"legacy": {"events": 1}, "mesh": {"mesh": {"network_transmits": 1, "relay": False}}}
    field = Field(
        2,
        listen={"interval_s": 0.5, "window_s": 0.005},
        broadcast={"by": by, **once[by]},
        advertise={"interval_s": 10},
    )
    count = 2_000
    for turn in range(count):
        field.send(0, BROADCAST, turn.to_bytes(2, "little"))
        field.until(field.kernel.now + 73_077_301)
    heard = len(field.arrived(1))
    octets = 6 + 4 + 2 if by == "legacy" else 6 + 2 + 9 + 1 + 3 + 2 + 4 + 4
    share = (5_000 - (80 + 8 * octets)) / 500_000  # all of the packet lies in the window
    assert abs(heard - count * share) < 4 * (count * share) ** 0.5


# ---------------------------------------------------------------- flooding


def test_a_full_network_pdu_takes_376_us_and_is_what_the_specification_lays_down() -> None:
    field = line_of(2, mesh={"relay": False})
    payload = bytes(range(29))  # with opcode and TransMIC 36 octets: three full segments
    field.send(0, BROADCAST, payload)
    field.until(2 * S)
    rows, columns = bodies(field), field.trace.columns(TRANSMISSIONS.name)
    assert columns["duration_ns"] == [376_000] * 27
    upper = b"\xc0\xff\xff" + payload + bytes(4)
    for turn in range(3):
        head = bytes.fromhex(f"1e2a 00 07 {turn:06x} 0001 ffff c0")
        segment = (turn << 5 | 2).to_bytes(3, "big") + upper[12 * turn : 12 * turn + 12]
        assert {data for *_, data in rows[9 * turn : 9 * turn + 9]} == {head + segment + bytes(4)}
    assert columns["length"] == [9] * 9 + [12] * 9 + [8] * 9
    assert columns["retry"] == ([False] * 3 + [True] * 6) * 3
    assert field.trace.columns(PAYLOADS.name)["begun_ns"] == [rows[0][0]]
    assert field.arrived(1) == [payload]


@pytest.mark.parametrize(("size", "times", "repeats"), [(5, 63, 27), (8, 45, 27), (9, 54, 45)])
def test_times_are_those_of_the_octets_to_the_ns(size: int, times: int, repeats: int) -> None:
    """5 octets and 8 are unsegmented; 9 are two segments, of 12 and 4."""
    field = line_of(2, mesh={"network_transmits": 1, "relay": False})
    field.send(0, BROADCAST, bytes(size))
    field.until(1 * S)
    upper = 3 + size + 4
    lower = [1 + upper] if upper <= 15 else [4 + 12, 4 + upper - 12]
    expected = [(80 + 8 * (6 + 2 + 9 + octets + 4)) * US for octets in lower]
    assert field.trace.columns(TRANSMISSIONS.name)["duration_ns"] == [each for each in expected for _ in range(3)]


@pytest.mark.parametrize("ttl", [0, 2, 3, 4, 5, 6, 7, 127])
@pytest.mark.parametrize(("own", "of_others"), [(1, 1), (3, 2), (2, 8)])
def test_on_a_line_ttl_hops_are_reached_and_each_node_sends_as_often_as_it_is_to(
    ttl: int, own: int, of_others: int
) -> None:
    hops = 6
    field = line_of(hops + 1, mesh={"ttl": ttl, "network_transmits": own, "relay_transmits": of_others})
    field.send(0, BROADCAST, b"flood")
    field.until(5 * S)
    reached = min(max(ttl, 1), hops)
    assert [len(field.arrived(address)) for address in range(hops + 1)] == [0] + [1] * reached + [0] * (hops - reached)
    assert {each.what[1].source for each in field.news if isinstance(each.what, tuple)} == {0}
    repeating = range(1, 1 + min(max(ttl - 1, 0), hops))  # those that hear it with TTL 2 or more
    assert sent_by(field) == {0: 3 * own} | dict.fromkeys(repeating, 3 * of_others)
    for _, sender, data in bodies(field):
        assert decode_network(data[2:]).ttl == ttl - sender
    columns = field.trace.columns(TRANSMISSIONS.name)
    again = [retry for retry, sender in zip(columns["retry"], columns["source"], strict=True) if sender == 0]
    assert again == [False] * 3 + [True] * 3 * (own - 1)
    assert sum(columns["retry"]) == len(columns["retry"]) - 3  # relays send what has been on the air


def test_a_line_without_relays_has_one_hop() -> None:
    field = line_of(4, mesh={"relay": False})
    field.send(1, BROADCAST, b"flood")
    field.until(2 * S)
    assert [len(field.arrived(address)) for address in range(4)] == [1, 0, 1, 0]
    assert sent_by(field) == {1: 9}


@pytest.mark.parametrize("size", [2, 5, 12])
def test_where_all_hear_all_each_repeats_once_and_has_the_payload_once(size: int) -> None:
    field = field_of(size, "mesh", interference="none")
    payload = bytes(range(20))  # three segments
    for sender in (0, 1):
        field.send(sender, BROADCAST, payload + bytes([sender]), sender)
    field.until(10 * S)
    assert sent_by(field) == dict.fromkeys(range(size), 2 * 3 * 9)
    for address in range(size):
        assert sorted(field.arrived(address)) == [payload + bytes([each]) for each in (0, 1) if each != address]
    assert [field.of(sender, Fate)[0].what for sender in (0, 1)] == [Fate(0, Outcome.SENT), Fate(1, Outcome.SENT)]


def test_payloads_of_one_source_arrive_in_order() -> None:
    field = line_of(5)
    payloads = [bytes([number]) * (1 + number) for number in range(12)]
    for payload in payloads:
        field.send(0, BROADCAST, payload)
    field.until(30 * S)
    assert all(field.arrived(address) == payloads for address in range(1, 5))


@pytest.mark.parametrize("segment", [0, 1, 2])
def test_a_payload_of_which_one_segment_is_lost_does_not_arrive(segment: int) -> None:
    """The receiver is out of range while that segment is on the air: once, for the three channels."""
    for lost in (False, True):
        field = line_of(2, mesh={"network_transmits": 1, "relay": False})
        field.send(0, BROADCAST, bytes(20))
        while len(field.trace.columns(TRANSMISSIONS.name)["kind"]) < 3 * segment:
            field.until(field.kernel.now + 100 * US)
        field.move([(0.0, 0.0), (99.0 if lost else 1.0, 0.0)])
        while len(field.trace.columns(TRANSMISSIONS.name)["kind"]) < 3 * segment + 3:
            field.until(field.kernel.now + 100 * US)
        field.move([(0.0, 0.0), (1.0, 0.0)])
        field.send(0, BROADCAST, b"next")
        field.until(5 * S)
        assert field.arrived(1) == ([b"next"] if lost else [bytes(20), b"next"])


# ---------------------------------------------------------------- a node by itself


def heard(field: Field, address: int, pdu: NetworkPdu) -> None:
    """Have the node at *address* hear *pdu*."""
    kind, sender = AdvertisingType.ADV_NONCONN_IND, DeviceAddress(1)
    octets = encode_advertising(Undirected(kind, sender, encode_bearer(encode_network(pdu))))
    now = field.kernel.now
    packet = Sent(now, 9, BROADCAST, kind.name, 37, LE_1M, len(octets) - 2, 5, pdu=octets)
    field.channel.devices[address].station.take(packet, -50.0)


def from_another(sequence: int, source: int = 40) -> NetworkPdu:
    return NetworkPdu(5, sequence, source, ALL_NODES, encode_lower(Whole(encode_upper(b"other"), 0)))


@pytest.mark.parametrize("cache", [2, 3, 10])
def test_a_cache_holds_as_many_pdus_as_it_has_room_for_and_the_oldest_goes_first(cache: int) -> None:
    field = field_of(1, "mesh", mesh={"cache": cache, "relay_transmits": 1})
    for sequence in range(cache):
        heard(field, 0, from_another(sequence))
    for sequence in range(cache):
        heard(field, 0, from_another(sequence))  # all known
    field.until(5 * S)
    assert sent_by(field)[0] == 3 * cache
    heard(field, 0, from_another(cache))  # the first is forgotten
    for sequence in range(cache, 0, -1):
        heard(field, 0, from_another(sequence))
    field.until(10 * S)
    assert sent_by(field)[0] == 3 * (cache + 1)
    heard(field, 0, from_another(0))
    field.until(15 * S)
    assert sent_by(field)[0] == 3 * (cache + 2)
    assert field.arrived(0) == [b"other"] * (cache + 1)  # the host gets what it has had no more


def test_a_node_repeats_no_more_than_it_has_buffers_for_but_takes_all() -> None:
    field = field_of(1, "mesh", mesh={"relay_buffers": 3, "relay_transmits": 2})
    for source in range(40, 45):
        heard(field, 0, from_another(7, source))
    field.send(0, BROADCAST, b"own", 1)
    field.until(3 * S)
    sources = [decode_network(data[2:]).source for *_, data in bodies(field)]
    assert sources == [40] * 6 + [41] * 6 + [42] * 6 + [1] * 9
    assert field.arrived(0) == [b"other"] * 5
    for source in (44, 45, 46, 47):  # the first is known
        heard(field, 0, from_another(7, source))
    field.until(6 * S)
    assert sent_by(field)[0] == 3 * (6 * 2 + 3)


def test_a_node_repeats_nothing_of_its_own_and_takes_no_control_message() -> None:
    field = field_of(1, "mesh")
    heard(field, 0, from_another(0, source=1))
    heard(field, 0, NetworkPdu(0, 1, 0x1201, 0xFFFD, bytes.fromhex("034b50057e400000010000"), True))
    field.until(1 * S)
    assert not sent_by(field)
    assert not field.arrived(0)


def test_pdus_are_sent_one_after_the_other() -> None:
    """A node's events of one PDU are over before those of the next begin: intervals and delays as of the settings."""
    field = field_of(1, "mesh", mesh={"network_transmits": 2, "network_interval_s": 0.03, "relay_transmits": 1})
    field.send(0, BROADCAST, bytes(20))
    heard(field, 0, from_another(0))
    field.until(5 * S)
    starts = [time for at, (time, *_) in enumerate(bodies(field)) if at % 3 == 0]
    gaps = [later - earlier for earlier, later in pairwise(starts)]
    assert len(starts) == 7
    assert all(30 * MS <= gap <= 40 * MS for gap in gaps[::2])
    assert all(1_428 * US - 8 * 8 * 3 * US <= gap <= 12 * MS for gap in gaps[1::2])


def test_a_flush_takes_out_what_has_not_been_on_the_air_and_only_that() -> None:
    field = line_of(2, queue_payloads=3)
    for token, payload in enumerate((bytes(20), bytes(30), b"z")):
        field.send(0, BROADCAST, payload, token)
    heard(field, 0, from_another(7))
    field.until(60 * MS)
    field.do(0, Flush(BROADCAST))
    field.send(0, BROADCAST, b"after", 3)
    field.until(5 * S)
    fates = {each.what.token: each.what.outcome for each in field.of(0, Fate)}
    assert fates == {0: Outcome.SENT, 1: Outcome.FLUSHED, 2: Outcome.FLUSHED, 3: Outcome.SENT}
    assert field.arrived(1) == [bytes(20), b"other", b"after"]


def test_no_more_payloads_are_held_than_there_is_room_for() -> None:
    field = field_of(2, "mesh", queue_payloads=2)
    for token in range(3):
        field.send(0, BROADCAST, bytes(20), token)
    heard(field, 0, from_another(7))  # another's takes no room
    field.until(3 * S)
    field.send(0, BROADCAST, bytes(20), 3)
    field.until(5 * S)
    fates = [(each.what.token, each.what.outcome) for each in field.of(0, Fate)]
    assert fates == [(2, Outcome.QUEUE_FULL), (0, Outcome.SENT), (1, Outcome.SENT), (3, Outcome.SENT)]


def test_who_is_switched_off_forgets_what_it_had_to_send_but_no_sequence_number() -> None:
    field = line_of(3)
    field.send(0, BROADCAST, bytes(100))
    field.until(200 * MS)
    field.channel.power(0, False)
    field.channel.power(1, False)
    field.until(2 * S)
    before = sent_by(field)
    field.until(5 * S)
    assert sent_by(field) == before
    field.channel.power(0, True)
    field.channel.power(1, True)
    field.do(0, Scan(False))
    field.do(1, Scan(False))
    field.send(0, BROADCAST, b"again")
    field.until(9 * S)
    assert (field.arrived(1), field.arrived(2)) == ([b"again"], [b"again"])


def test_who_is_switched_off_forgets_what_is_not_whole() -> None:
    for off in (False, True):
        field = field_of(1, "mesh")
        first, *others = (each.pdu for each in parts(39, 7, 0, Outgoing(BROADCAST, bytes(20))))
        heard(field, 0, first)
        if off:
            field.channel.power(0, False)
            field.channel.power(0, True)
        for each in others:
            heard(field, 0, each)
        field.until(1 * S)
        assert field.arrived(0) == ([] if off else [bytes(20)])


def test_a_relay_pays_for_what_it_sends() -> None:
    field = line_of(3, energy="states", mesh={"network_transmits": 2, "relay_transmits": 4})
    field.send(0, BROADCAST, b"12345")
    field.until(2 * S)
    air = (80 + 8 * (6 + 2 + 9 + 1 + 3 + 5 + 4 + 4)) * US
    accounts = field.channel.accounts
    assert accounts is not None
    used = [
        sum(time for use, time in accounts.uses(address, field.kernel.now).items() if use.state == TRANSMIT)
        for address in range(3)
    ]
    assert used == [3 * 2 * air, 3 * 4 * air, 3 * 4 * air]


def test_links_go_before_a_mesh() -> None:
    """A central with links floods beside them: nothing is lost on the links, and the payloads come to all."""
    field = Field(4, broadcast={"by": "mesh"}, interference="none")
    field.link(0, 1, 2)
    for token in range(10):
        field.send(0, BROADCAST, bytes([token]) * 20)
        field.send(0, 1, bytes(200), token)
        field.until(field.kernel.now + 300 * MS)
    field.until(field.kernel.now + 2 * S)
    assert [each.what.outcome for each in field.of(0, Fate)] == [Outcome.DELIVERED] * 10
    assert len(field.arrived(3)) == 10
    assert len(field.arrived(1)) >= 10 + 8


@pytest.mark.slow
def test_a_hop_takes_the_random_delay_and_the_event_up_to_the_channel_that_is_listened_to() -> None:
    """Delays are uniform from 0 to 10 ms; a node repeats what it has heard no sooner."""
    hops, count, air = 4, 150, (80 + 8 * (6 + 2 + 9 + 1 + 3 + 1 + 4 + 4)) * US
    field = line_of(hops + 1, mesh={"network_transmits": 1, "relay_transmits": 1})
    delays = []
    for turn in range(count):
        begun, asked = len(field.trace.columns(TRANSMISSIONS.name)["kind"]), field.kernel.now
        field.news.clear()
        field.send(0, BROADCAST, bytes([turn % 256]))
        field.until(asked + 100 * MS)
        sent = {(at, sender): time for at, (time, sender, _) in enumerate(bodies(field)[begun:])}
        for hop in range(1, hops + 1):
            starts = sorted(time for (_, sender), time in sent.items() if sender == hop - 1)
            assert [later - earlier for earlier, later in pairwise(starts)] == [air + 150 * US] * 2
            (news,) = field.of(hop, tuple)
            assert news.time - air in starts
            delays.append(starts[0] - asked)
            asked = news.time
    assert min(delays) >= 0
    assert max(delays) <= 10 * MS
    assert abs(sum(delays) / len(delays) - 5 * MS) < 4 * 10 * MS / 12**0.5 / len(delays) ** 0.5


@pytest.mark.slow
def test_in_a_shared_air_802_11_ruins_what_is_on_its_channel() -> None:
    """A network on 2427 MHz, 22 MHz wide, is on that of channel 38, 2426 MHz, and neither on 2402 nor on 2480 MHz."""
    law = {"propagation": {"model": "free_space"}}
    mesh = {"kind": "ble", "broadcast": {"by": "mesh", "mesh": {"relay": False}}, **law}
    wifi = {"kind": "adhoc", "channel": 4, "phy": "dsss", "rate_mbps": 11, **law}
    pair = {"radio": 1, "places_m": [[20, 6], [24, 6]], "payload_bytes": 1500, "interval_s": 0.004}
    plain = {
        "name": "beside",
        "duration_s": 10,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 45, 10]},
        "team": {"size": 2, "starts": [[2, 2], [42, 2]]},
        "protocol": {"use": "monitoring", "parameters": {"senders": 1}},
    }
    lost = Counter[tuple[bool, int]]()
    for beside in (False, True):
        radios = {"radios": [mesh, wifi], "background": [pair]} if beside else {"radios": [mesh]}
        scenario = Scenario.model_validate(plain | {"channel": {"kind": "radios", "air": "shared", **radios}})
        simulation = Simulation(scenario, 1, [FRAMES])
        simulation.run()
        frames = simulation.trace.columns(FRAMES.name)
        for kind, channel, outcome in zip(frames["kind"], frames["channel"], frames["outcome"], strict=True):
            if kind == "ADV_NONCONN_IND":
                lost[beside, channel] += outcome != "received"
    assert {key for key, count in lost.items() if count} == {(True, 24)}
    assert set(lost) == {(beside, channel) for beside in (False, True) for channel in (0, 24, 78)}
