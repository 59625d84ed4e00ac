"""What payloads say: every installed protocol takes any bytes, and tells of its own what its robots have sent."""

import json
import math
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.channels.adhoc.routing import aodv_wire, ip, olsr_wire
from cosim.decoding import Plain, decoded, packet_name, plain
from cosim.machine import BROADCAST
from cosim.scenario import Scenario, protocol_names
from cosim.simulation import Simulation
from cosim.trace import TRANSMISSIONS
from cosim.units import S
from protocols.deployment.messages.messages import YieldRequest
from protocols.deployment.messages.messages import encode as encode_letter
from protocols.deployment.messages.status import News
from protocols.deployment.messages.status import encode as encode_news
from protocols.mapping.frames import Piece, Stream, to_runs
from protocols.mapping.frames import encode as encode_map
from protocols.reflection.frames import Frame as ReflectionFrame
from protocols.reflection.frames import encode as encode_reflection
from protocols.transport.frames import ALL, Ack, Body, Frame, Part, Publication, encode
from protocols.transport.transport import BEAT
from protocols.wire import seal

NAMES = protocol_names()
NEWS = News(0, 1, 2, 0, 0, None, True, 1.0, 2.0, 0.5, 0.0, None, "go")


def scenario(name: str, size: int = 4, channel: Any = None, **parameters: Any) -> Scenario:
    if name == "reflection":
        parameters = {"rooms": [[2, 2], [9, 9]], **parameters}
    return Scenario.model_validate(
        {
            "duration_s": 20.0,
            "floorplan": {"map": "walls", "bounds_m": [0, 0, 12, 12]},
            "team": {"size": size},
            "channel": channel or {"kind": "ideal"},
            "protocol": {"use": name, "parameters": parameters},
        }
    )


SCENARIOS = {name: scenario(name) for name in NAMES}
WIDE = scenario("pseudonet", 9)


def sent(made: Scenario) -> list[tuple[int, Any]]:
    """Return of each payload, or routed packet, that a run has on the air its sender and what it says."""
    run = Simulation(made, 1, (TRANSMISSIONS,))
    run.run()
    columns = run.trace.columns("transmissions")
    rows = zip(*(columns[name] for name in ("source", "body", "routed", "kind")), strict=True)
    return [
        (source, decoded(made, bytes.fromhex(body), routed))
        for source, body, routed, kind in rows
        if kind in ("IDEAL", "DATA")
    ]


# ---------------------------------------------------------------- any bytes

BYTES = st.binary(max_size=120)
MAGICS = st.sampled_from([b"\x4c\x01", b"\x4c\x02", b"\x4c\x03", b"\x45\x01", b"\x45\x02", b"\x41", b"\x52", b"{", b""])
SEALED = st.builds(lambda magic, rest: seal(magic + rest), MAGICS, BYTES)
"""Bytes that get past the check of their CRC, and mostly past the first byte."""


def udp(port: int, data: bytes) -> bytes:
    return ip.encode(ip.Datagram(1, BROADCAST, 3, port, 7, data))


PACKETS = st.builds(udp, st.sampled_from([ip.PAYLOAD_PORT, ip.AODV_PORT, ip.OLSR_PORT, 9]), BYTES | SEALED)


@pytest.mark.parametrize("name", NAMES)
def test_every_installed_protocol_says_how_to_decode_its_payloads(name: str) -> None:
    assert SCENARIOS[name].protocol.spec.decode is not None


@pytest.mark.parametrize("made", [*SCENARIOS.values(), WIDE], ids=[*NAMES, "pseudonet_wide"])
@given(data=BYTES | SEALED | PACKETS, routed=st.booleans())
def test_any_bytes_give_data_or_a_sentence(made: Scenario, data: bytes, routed: bool) -> None:
    said = decoded(made, data, routed)
    assert isinstance(said, str | dict)
    assert said
    json.dumps(said, allow_nan=False)


@pytest.mark.parametrize("name", NAMES)
def test_bytes_that_are_none_give_a_sentence_that_says_so(name: str) -> None:
    assert str(decoded(SCENARIOS[name], b"\x00\x01")).startswith("no message: ")
    assert str(decoded(SCENARIOS[name], b"\x00\x01", routed=True)).startswith("no message: ")


# ---------------------------------------------------------------- what robots send


@pytest.mark.parametrize("name", sorted(set(NAMES) - {"agents", "exploration"}))  # which send nothing by themselves
def test_all_that_robots_send_is_understood_and_names_its_sender(name: str) -> None:
    found = sent(SCENARIOS[name])
    assert len(found) >= 10
    known: set[tuple[int, str]] = set()
    for source, said in found:
        assert isinstance(said, dict)
        text = json.dumps(said)
        assert "no message" not in text
        author = said.get("source", said.get("sender", said.get("author")))
        # frames of goal reflection do not name their sender; a master of Pseudonet sends on what it has received
        assert author == source or (name == "reflection" and author is None) or (author, text) in known
        known.add((source, text))


def test_heartbeats_are_numbered_from_0_by_each_robot() -> None:
    said = sent(SCENARIOS["monitoring"])
    for robot in range(4):
        assert [each["number"] for source, each in said if source == robot] == list(range(20))


@pytest.mark.parametrize("routing", ["aodv", "olsr", "flooding"])
def test_a_router_s_packet_is_taken_apart_down_to_the_payload(routing: str) -> None:
    found = sent(scenario("monitoring", channel={"kind": "adhoc", "routing": {"kind": routing}}))
    payloads = [said for _, said in found if "payload" in said]
    assert {"payload", "olsr"} >= {key for _, said in found for key in said if key != "ip"}
    assert any("olsr" in said for _, said in found) == (routing == "olsr")
    for said in payloads:  # relayed ones too: the author stands in both
        assert said["payload"]["source"] == said["ip"]["source"]
    by_number = {(said["ip"]["source"], said["payload"]["number"]) for said in payloads}
    assert by_number == {(robot, number) for robot in range(4) for number in range(20)}


def test_route_requests_and_topologies_are_taken_apart() -> None:
    asking = sent(scenario("aggregation", channel={"kind": "adhoc", "routing": {"kind": "aodv"}}))
    requests = [(source, said["aodv"]) for source, said in asking if "aodv" in said]
    assert len(requests) > 5
    for source, said in requests:
        assert said["type"] == "Rreq"
        assert said["hops"] > 0 or said["originator"] == source
    lost = aodv_wire.encode_message(aodv_wire.Rerr(((3, 17),), False))
    told = decoded(SCENARIOS["monitoring"], udp(ip.AODV_PORT, lost), routed=True)
    assert isinstance(told, dict)
    assert told["aodv"] == {"type": "Rerr", "unreachable": [[3, 17]], "no_delete": False}
    hello = olsr_wire.Hello(2 * S, 3, {olsr_wire.link_code(olsr_wire.SYM_LINK, olsr_wire.SYM_NEIGH): [4, 2]})
    bodies = [(1, olsr_wire.encode_hello(hello)), (2, olsr_wire.encode_tc(olsr_wire.Tc(5, [3]))), (77, b"\xab")]
    messages = [olsr_wire.Message(kind, 6 * S, 1, 1, 0, 9, body) for kind, body in bodies]
    said = decoded(SCENARIOS["monitoring"], udp(ip.OLSR_PORT, olsr_wire.encode_packet(8, messages)), routed=True)
    assert isinstance(said, dict)
    assert said["ip"] == {"source": 1, "destination": -1, "ttl": 3, "number": 7, "port": 698}
    assert said["olsr"]["number"] == 8
    assert [message["body"] for message in said["olsr"]["messages"]] == [
        {"type": "Hello", "interval": 2 * S, "willingness": 3, "links": {"6": [4, 2]}},
        {"type": "Tc", "ansn": 5, "neighbours": [3]},
        "ab",
    ]


@pytest.mark.parametrize(
    ("message", "name"),
    [
        (aodv_wire.Rreq(0, 1, 3, None, 1, 7), "RREQ"),
        (aodv_wire.Rrep(0, 3, 5, 1, 3000), "RREP"),
        (aodv_wire.Rerr(((3, 17),)), "RERR"),
        (aodv_wire.RrepAck(), "RREPACK"),
    ],
)
def test_a_router_s_packet_is_called_by_its_message(message: aodv_wire.Message, name: str) -> None:
    assert packet_name(udp(ip.AODV_PORT, aodv_wire.encode_message(message))) == name


def test_a_router_s_packet_is_called_by_its_messages_and_others_not_at_all() -> None:
    messages = [olsr_wire.Message(kind, 6 * S, 1, 1, 0, 9, b"abcd") for kind in (1, 2, 1, 77)]
    assert packet_name(udp(ip.OLSR_PORT, olsr_wire.encode_packet(8, messages))) == "HELLO+TC+OLSR"
    assert packet_name(udp(ip.OLSR_PORT, olsr_wire.encode_packet(8, messages[:1]))) == "HELLO"
    assert not packet_name(udp(ip.PAYLOAD_PORT, b"abc"))
    assert not packet_name(udp(ip.AODV_PORT, b"\x09"))
    assert not packet_name(b"\x45")


def test_a_team_of_several_piconets_tells_names_and_packets() -> None:
    found = [said for _, said in sent(WIDE)]
    assert all(isinstance(said, dict) for said in found)
    named = [said for said in found if said["names"]]
    assert len(named) >= 10
    for said in named:
        piconet, place = map(int, said["names"]["source"].split("."))
        assert (8 * piconet + place) == said["packet"]["source"]
        assert piconet < 3
        assert place < 8
    assert {said["packet"]["type"] for said in found} >= {"Message", "Census"}


# ---------------------------------------------------------------- what frames carry


def in_frame(body: Body, destination: int = 2) -> bytes:
    return encode(Frame(1, ALL if isinstance(body, Publication) else destination, 33, body))


def content(name: str, body: Body) -> Plain:
    said = decoded(SCENARIOS[name], in_frame(body))
    assert isinstance(said, dict)
    assert (said["author"], said["incarnation"]) == (1, 33)
    assert said["body"]["type"] == type(body).__name__
    content: Plain = said["content"]
    return content


def test_a_transport_s_frame_is_decoded_with_the_letter_or_map_in_it() -> None:
    letter = YieldRequest(robot=1, from_m=(1.5, 2.0), way_m=((3.0, 2.0),))
    asked = {"type": "YieldRequest", "say": "aside", "robot": 1, "from_m": [1.5, 2.0], "way_m": [[3.0, 2.0]]}
    payload = encode_letter(letter)
    assert content("deployment", Part(4, 4, 0, 1, payload)) == asked
    assert content("deployment", Part(5, 4, 1, 3, payload)) == "part 2 of the 3 of a message"
    assert content("deployment", Ack(7, 3, 0b101)) is None
    told = content("deployment", Publication(0, 1, encode_news(NEWS)))
    assert told == {"type": "News", **NEWS._asdict()}
    assert content("deployment", Publication(BEAT, 1, bytes([3, 0]))) == {
        "heartbeat": "of the transport",
        "without_master": [3, 0],
    }
    piece = encode_map(3, Piece(Stream(3, 8), 2, 9, to_runs([5, 6, 7, 20], [True, True, True, False])))
    told = content("deployment", Publication(1, 1, piece))
    assert isinstance(told, dict)
    assert told["sender"] == 3
    assert told["piece"]["runs"] == [
        {"type": "Run", "first": 5, "cells": 3, "occupied": True},
        {"type": "Run", "first": 20, "cells": 1, "occupied": False},
    ]
    assert decoded(SCENARIOS["exploration"], piece) == told


@pytest.mark.parametrize(
    "body",
    [
        Publication(0, 1, b"no status"),
        Publication(200, 1, encode_news(NEWS)),  # of no topic of theirs
        Part(4, 4, 0, 1, b"{}"),
        Part(4, 4, 0, 1, encode_letter(YieldRequest(robot=4, from_m=(0, 0), way_m=()))),  # of a team of 4
    ],
)
def test_a_frame_whose_payload_says_nothing_is_told_with_a_sentence_in_it(body: Body) -> None:
    assert str(content("deployment", body)).startswith("no message: ")


def test_agents_tell_messages_of_the_length_that_is_set() -> None:
    made = scenario("agents", message_octets=2)
    said = decoded(made, in_frame(Publication(0, 1, b"\x0a\xff")))
    assert isinstance(said, dict)
    assert said["content"] == {"message": "0aff"}
    assert str(content("agents", Publication(0, 1, b"\x0a\xff"))).startswith("no message: ")


def test_goal_reflection_tells_bearings_terms_and_pledges() -> None:
    frame = ReflectionFrame(True, False, 77, [(2, 0.5)], [(1, 3, -1.5, 2.0)], [(0, 9, 4.5, 60)])
    assert decoded(SCENARIOS["reflection"], encode_reflection(frame)) == {
        "type": "Frame",
        "in_trouble": True,
        "objects": False,
        "stamp_ms": 77,
        "bearings": [[2, 0.5]],
        "terms": [[1, 3, -1.5, 2.0]],
        "pledges": [[0, 9, 4.5, 60]],
    }


def test_messages_become_plain_data() -> None:
    class Colour(IntEnum):
        LIGHT_RED = 1

    class Pair(NamedTuple):
        one: Any
        other: Any

    assert plain(Pair(Colour.LIGHT_RED, (b"\x01\xfe", None, True, 2.5))) == {
        "type": "Pair",
        "one": "light_red",
        "other": ["01fe", None, True, 2.5],
    }
    assert plain({3: [math.nan, -math.inf], "x": np.float32(0.5)}) == {"3": ["nan", "-inf"], "x": "0.5"}
