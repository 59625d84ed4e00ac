"""Teams of more than eight robots in one piconet, as radios with more links let them be: their packets and runs."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.channels.bluetooth.packets import ACL
from cosim.errors import UserError, WireError
from cosim.machine import Share
from cosim.node import Node
from cosim.simulation import Simulation
from cosim.testing import check_machine
from cosim.trace import FRAMES, POSES
from cosim.units import S, Time
from protocols.pseudonet import wide
from protocols.pseudonet.machine import Pseudonet
from protocols.pseudonet.messages import (
    BROAD,
    NARROW,
    Acknowledgement,
    Action,
    Kind,
    Message,
    Missing,
    Packet,
    Reply,
    Sync,
    Verdict,
    decode,
    encode,
    form_of,
    is_broad,
)
from protocols.pseudonet.parameters import Parameters, piconet_size
from protocols.pseudonet.spec import SPEC
from protocols.pseudonet.topology import Directory, Piconet
from tests.protocols.pseudonet.test_machine import surroundings
from tests.protocols.pseudonet.test_messages import FREE, closed, packets
from tests.protocols.pseudonet.test_runs import check_covered, run, scenario
from tests.tiers import each_value

# ---------------------------------------------------------------- packets

# The head is 111, source (5 bits), type (2), kind (3), exchange (8); the rest is that of the narrow form, but for
# addressees of 5 bits and robots of 32.
GOLDEN: dict[str, tuple[Packet, str]] = {
    "state": (
        Message(21, Kind.STATE, 7, 0x025, 0x403, Action.EAST, (Verdict.WALL, *FREE[:2], Verdict.ROBOT), busy=True),
        "111 10101 00 000 00000111 000000100101 010000000011 001 001 000 000 011 1",
    ),
    "answer": (
        Message(9, Kind.ANSWER, 255, 0, 0, Action.STAY, FREE, addressee=30, reply=Reply.DIRECT, target=(4095, 1)),
        "111 01001 00 010 11111111" + 24 * "0" + "100 000 000 000 000 0" + "0 11110 11 111111111111 000000000001",
    ),
    "map": (
        Message(31, Kind.MAP, 4, 0, 0, Action.NORTH, FREE, chunk=10, marks=b"\x5a"),
        "111 11111 00 110 00000100" + 40 * "0" + "000000001010 01011010",
    ),
    "synchronisation": (
        Sync(0, 1, (0, 2, 9, 31), True, 0x2A96EF25, 0x0ABCDEF),
        f"111 00000 01 111 00000001 1 {21 * '0'} 1 000000 101 1 {0x2A96EF25:032b} {0x0ABCDEF:028b}",
    ),
    "acknowledgement": (Acknowledgement(16, 9), "111 10000 10 111 00001001"),
    "missing": (Missing(6, 9, (0, 8)), f"111 00110 11 000 00001001 {23 * '0'}100000001"),
}


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_bits(name: str) -> None:
    packet, golden = GOLDEN[name]
    bits = golden.replace(" ", "")
    bits += "0" * (-len(bits) % 8)
    data = closed(int(bits, 2).to_bytes(len(bits) // 8, "big"))
    assert encode(packet, BROAD) == data
    assert decode(data, BROAD) == packet


def moved(packet: Packet, by: int) -> Packet:
    """Return *packet* with robots of other numbers, which only the broad form can hold."""
    if isinstance(packet, Message) and packet.addressee is not None:
        packet = replace(packet, addressee=packet.addressee + by)
    if isinstance(packet, Sync):
        packet = replace(packet, members=tuple(member + by for member in packet.members))
    if isinstance(packet, Missing):
        packet = replace(packet, robots=tuple(robot + by for robot in packet.robots))
    return replace(packet, source=packet.source + by)


@given(packets, st.integers(0, 24))
def test_what_was_encoded_is_decoded_to_the_same_in_one_dm1_packet_and_is_marked(packet: Packet, by: int) -> None:
    packet = moved(packet, by)
    data = encode(packet, BROAD)
    assert decode(data, BROAD) == packet
    assert len(data) <= ACL["DM1"].capacity
    assert is_broad(data)
    assert SPEC.decode is not None
    assert SPEC.decode(Parameters(), 10, data) == packet


@given(packets)
def test_small_teams_have_the_packets_of_the_paper(packet: Packet) -> None:
    assert SPEC.decode is not None
    assert SPEC.decode(Parameters(), 8, encode(packet)) == packet


@given(st.binary(min_size=1, max_size=18))
def test_bytes_with_a_right_crc_are_a_packet_or_are_refused(body: bytes) -> None:
    data = closed(body)
    try:
        packet = decode(data, BROAD)
    except WireError:
        return
    assert encode(packet, BROAD) == data


@pytest.mark.parametrize("mark", [0, 3, 6])
def test_a_packet_without_the_whole_mark_is_none(mark: int) -> None:
    data = encode(GOLDEN["state"][0], BROAD)
    with pytest.raises(WireError, match="nobody encodes so"):
        decode(closed(bytes([data[0] & 31 | mark << 5]) + data[1:-2]), BROAD)


def test_a_packet_of_several_piconets_is_never_taken_for_one_of_a_single_one() -> None:
    team = Directory(tuple(Piconet(4 * n, (4 * n + 1, 4 * n + 2, 4 * n + 3)) for n in range(8)))
    assert SPEC.decode is not None
    for robot in range(32):
        message = Message(robot, Kind.STATE, 1, 2, 3, Action.STAY, FREE)
        data = wide.encode(message, team)
        assert not is_broad(data)
        assert SPEC.decode(Parameters(), 32, data)["packet"].x == 2
    assert (form_of(8), form_of(9), form_of(32)) == (NARROW, BROAD, BROAD)


# ---------------------------------------------------------------- what is possible, and what is refused


def told(size: int, links: int | None, shares: bool = True) -> Any:
    return surroundings(size, (0.0, 0.0, float(size), 4.0))._replace(links=(links,), shares=(shares,))


@pytest.mark.parametrize(
    ("size", "links", "given", "found"),
    [
        (8, 7, None, 8),
        (9, 7, None, 8),
        (9, 7, 4, 4),
        (9, 7, 8, 8),
        (9, None, None, 8),
        (9, None, 9, 9),
        (9, None, 12, 12),
        (10, 9, None, 10),
        (10, 20, None, 21),
        (10, 20, 4, 4),
        (22, 20, None, 8),
        (3, 2, None, 3),
        (4, 2, None, 3),
    ],
)
def test_a_piconet_has_as_many_robots_as_the_radio_lets_it_have(
    size: int, links: int | None, given: int | None, found: int
) -> None:
    assert piconet_size(Parameters(piconet_size=given), told(size, links)) == found


@pytest.mark.parametrize(
    ("size", "links", "shares", "given", "error"),
    [
        (4, 7, True, 9, r"9 is not <= 8, a master and the links that its radio holds"),
        (10, 20, False, 22, r"22 is not <= 21, a master"),
        (10, None, True, 9, r"9 is not <= 8, as a team of 10 needs several piconets"),
        (20, None, True, 3, r"3 makes 10 piconets of 20 robots, expected at most 8"),
        (10, 8, False, None, r"10 robots need several piconets of 9, and .*topology: ring .*connection.links >= 9\)"),
        (10, 20, False, 4, r"10 robots need several piconets of 4, and .* one piconet of all 10 "),
        (10, None, False, None, r"10 robots need several piconets of 8, and .*\(Share\)"),
    ],
)
def test_piconets_that_cannot_be_are_refused_in_one_line(
    size: int, links: int | None, shares: bool, given: int | None, error: str
) -> None:
    with pytest.raises(UserError, match=rf"^protocol\.parameters\.piconet_size: {error}") as refused:
        SPEC.prepare(Parameters(cell_m=1.0, piconet_size=given), told(size, links, shares))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("use", ["pseudonet", "gathering"])
@pytest.mark.parametrize("parameters", [{}, {"piconet_size": 4, "topology": "tree"}])
def test_scatternets_over_low_energy_are_refused_before_the_run(use: str, parameters: dict[str, Any]) -> None:
    plain = scenario(size=10, channel="ble").model_dump()
    wrong = type(scenario()).model_validate(plain | {"protocol": {"use": use, "parameters": parameters}})
    with pytest.raises(UserError, match=r"do not divide their time among them \(Share\)"):
        Simulation(wrong, 1)


# ---------------------------------------------------------------- machines and runs


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["oscard", "spanning_tree"])
def test_robots_of_a_large_piconet_keep_the_laws(algorithm: str) -> None:
    parameters = Parameters(algorithm=algorithm, cell_m=1.0)  # type: ignore[arg-type]
    setup = SPEC.prepare(parameters, told(10, 9))

    def make(me: int, start: Time) -> Pseudonet:
        machine = SPEC.make(parameters, setup, me, np.random.default_rng(me), start)
        assert isinstance(machine, Pseudonet)
        assert machine.scatternet is None
        return machine

    check_machine(make, surroundings(10).starts_m, duration=5 * S)


LARGE = {"connection": {"links": 20, "interval_s": 0.03}}
ROOM: dict[str, Any] = {"map": "walls", "bounds_m": [0, 0, 8, 6]}


@pytest.mark.slow
@pytest.mark.parametrize(("algorithm", "size"), each_value(("boustrophedon", "spanning_tree"), (10, 21)))
def test_more_than_eight_cover_a_floor_as_one_piconet_over_low_energy(
    algorithm: str, size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared = noted(monkeypatch)
    made = scenario(algorithm, size, "ble", ROOM, radio=LARGE)
    simulation, outcome = run(made, tables=(POSES, FRAMES))
    check_covered(simulation, outcome)
    assert outcome.metrics["robots_dropped"] == outcome.metrics["teams_lost"] == 0
    assert shared == []
    assert set(simulation.machines[0].application.broadcast.members) == set(range(size))  # type: ignore[attr-defined]
    kinds = outcome.trace.columns("frames")
    asked = [to for to, kind in zip(kinds["destination"], kinds["kind"], strict=True) if kind == "CONNECT_IND"]
    assert sorted(asked) == list(range(1, size)), "robot 0 has a link to each other"


@pytest.mark.slow
def test_when_the_master_of_ten_dies_the_others_go_on_as_nine() -> None:
    plain = scenario("spanning_tree", 10, "ble", ROOM, radio=LARGE).model_dump()
    faults = {"faults": [{"kind": "kill", "robot": 0, "at_s": 12.0}]}
    simulation, outcome = run(type(scenario()).model_validate(plain | faults))
    assert outcome.metrics["coverage"] == 1.0
    assert outcome.metrics["teams_lost"] == 9
    teams = [set(machine.application.broadcast.members) for machine in simulation.machines[1:]]  # type: ignore[attr-defined]
    assert teams == [set(range(1, 10))] * 9


@pytest.mark.slow
def test_ten_are_one_piconet_over_any_channel_that_has_no_limit_if_they_are_to_be() -> None:
    check_covered(*run(scenario("spanning_tree", 10, "ideal", ROOM, piconet_size=10)))


def noted(monkeypatch: pytest.MonkeyPatch) -> list[Share]:
    """Return the list of all commands by which hosts divide their devices' time from now on."""
    shared: list[Share] = []
    drain: Callable[[Node, Time], None] = Node.drain

    def drained(node: Node, now: Time) -> None:
        command = node._channel.command

        def noting(source: int, given: Any) -> None:
            if isinstance(given, Share):
                shared.append(given)
            command(source, given)

        with monkeypatch.context() as patch:
            patch.setattr(node._channel, "command", noting)
            drain(node, now)

    monkeypatch.setattr(Node, "drain", drained)
    return shared
