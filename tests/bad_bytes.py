"""What every decoder of the project is given when bytes are spoilt: its own frames, and what happens to them.

A frame is spoilt by flipped bits, other octets, a cut, an insertion, or the end of another frame. Half of the spoilt
ones are mended, so that lengths and checks are right again and what lies behind them is reached.
"""

import json
import struct
from collections import deque
from collections.abc import Callable, Sequence
from functools import cache, cached_property
from itertools import count, cycle
from random import Random
from typing import Any, NamedTuple

from cosim.channels.adhoc.routing import aodv_wire, ip, olsr_wire
from cosim.channels.adhoc.routing.aodv import Aodv
from cosim.channels.adhoc.routing.aodv_settings import AodvSettings
from cosim.channels.adhoc.routing.base import Queues
from cosim.channels.adhoc.routing.flooding import Flooding, FloodingSettings
from cosim.channels.adhoc.routing.olsr import Olsr, OlsrSettings
from cosim.channels.ble import dissection
from cosim.channels.ble.bits import control, l2cap, pdu
from cosim.channels.ble.bits.access import ADVERTISING_ADDRESS
from cosim.channels.ble.bits.mesh import bearer, lower_transport, network, upper_transport
from cosim.channels.ble.bits.mesh.upper_transport import LONGEST_PAYLOAD
from cosim.channels.ble.broadcasts import extended
from cosim.channels.ble.broadcasts.inbox import Inbox
from cosim.channels.ble.broadcasts.mesh import parts
from cosim.channels.ble.broadcasts.structures import piece_of, structure
from cosim.channels.ble.connections import channel_map
from cosim.channels.ble.connections.arq import Fragment
from cosim.channels.bluetooth.bits import codes, packet
from cosim.decoding import decoded, frame_said, packet_name
from cosim.errors import UserError, WireError
from cosim.machine import BROADCAST, OPERATOR, Machine, Outgoing, Reception
from cosim.randomness import Draws
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import TRANSMISSIONS
from cosim.units import MS, S
from cosim.web import messages as web_messages
from protocols import wire
from protocols.aggregation import frames as aggregation_frames
from protocols.deployment.messages import messages as letters
from protocols.deployment.messages import status
from protocols.deployment.operator import console
from protocols.mapping import frames as map_frames
from protocols.monitoring import heartbeats
from protocols.pseudonet import messages as pseudonet_messages
from protocols.pseudonet import wide
from protocols.pseudonet.topology import Directory, Piconet
from protocols.reflection import frames as reflection_frames
from protocols.transport import decoding as transport_decoding
from protocols.transport import frames as transport_frames
from protocols.transport.frames import Ack, Part, Publication
from tests.channels.ble.test_l2cap import GOLDEN as CONTROLS
from tests.channels.ble.test_pdu import GOLDEN as ADVERTISEMENTS
from tests.channels.ble.test_pdu import LL_DATA_OCTETS
from tests.export.test_capture_ble_soak import drawn_run
from tests.protocols.deployment.messages.test_messages import LETTERS
from tests.test_decoding import NEWS, SCENARIOS, WIDE, in_frame, scenario, udp

Frames = Sequence[bytes]
Refusal = type[Exception] | tuple[type[Exception], ...]
NONE: Refusal = ()


class Decoder(NamedTuple):
    """Something that takes bytes, and what it refuses them with."""

    take: Callable[[bytes], object]
    frames: Callable[[], Frames]
    """What it takes without complaint."""
    refuses: Refusal = WireError
    """What it raises, as its documentation says; nothing else may come of it."""
    mend: Callable[[bytes], bytes] = bytes


def spoilt(random: Random, frames: Frames) -> bytes:
    """Return one of *frames* after one to four accidents."""
    frame = bytearray(random.choice(frames))
    for _ in range(random.choice((1, 1, 2, 4))):
        at = random.randrange(len(frame) + 1)
        match random.randrange(6):
            case 0 | 1 if at < len(frame):
                frame[at] ^= 1 << random.randrange(8)
            case 2 if at < len(frame):
                frame[at] = random.choice((0, 1, 0x7F, 0x80, 0xFF, random.randrange(256)))
            case 3:
                del frame[at : at + random.choice((1, 1, 2, 4, len(frame)))]
            case 4:
                frame[at:at] = random.randbytes(random.choice((1, 1, 2, 4, 30)))
            case _:
                other = random.choice(frames)
                frame[at:] = other[random.choice((at, random.randrange(len(other) + 1))) :]
    return bytes(frame)


# ---------------------------------------------------------------- right lengths and checks


def counted(octets: bytes) -> bytes:
    """Return a PDU of Low Energy with its own length in its second octet."""
    return octets[:1] + bytes([min(255, len(octets) - 2)]) + octets[2:257] if len(octets) > 1 else octets


def counted_in_packet(octets: bytes) -> bytes:
    return octets[:4] + counted(octets[4:-3]) + octets[-3:] if len(octets) > 8 else octets


def counted_message(octets: bytes) -> bytes:
    """Return an L2CAP message with its own length."""
    return (len(octets) - 4).to_bytes(2, "little") + octets[2:] if len(octets) >= 4 else octets


def sealed(data: bytes) -> bytes:
    return wire.seal(data[:-2])


def summed(octets: bytes) -> bytes:
    """Return an IPv4 packet with a UDP header whose lengths and checksum are right."""
    if len(octets) < ip.HEADER_OCTETS:
        return octets
    head = bytearray(octets)
    struct.pack_into(">H", head, 2, len(octets) & 0xFFFF)
    struct.pack_into(">H", head, 24, (len(octets) - 20) & 0xFFFF)
    head[10:12] = b"\0\0"
    total = sum(struct.unpack_from(">10H", head))
    total = (total & 0xFFFF) + (total >> 16)
    struct.pack_into(">H", head, 10, ~((total & 0xFFFF) + (total >> 16)) & 0xFFFF)
    return bytes(head)


def olsr_counted(octets: bytes) -> bytes:
    """Return a packet of OLSR with its own length, and that of its first message if it is the only one."""
    rest = octets[2:6] + (len(octets) - 4).to_bytes(2, "big") + octets[8:] if len(octets) >= 16 else octets[2:]
    return len(octets).to_bytes(2, "big") + rest


def olsr_summed(octets: bytes) -> bytes:
    head = ip.HEADER_OCTETS
    return summed(octets[:head] + olsr_counted(octets[head:])) if len(octets) > head + 2 else octets


# ---------------------------------------------------------------- frames of Low Energy and of Bluetooth


@cache
def low_energy() -> tuple[Frames, dict[str, Frames]]:
    """Return packets of runs, and the PDUs in them by what they are of: advertising, data, control."""
    packets: set[bytes] = set()
    for number in (2, 4):
        packets |= {bytes.fromhex(body) for body in drawn_run(number).trace.columns(TRANSMISSIONS.name)["body"]}
    golden = {bytes.fromhex(octets) for _, octets in ADVERTISEMENTS}
    golden |= {made_nonconnectable(data) for data in data_for_all()}
    address = ADVERTISING_ADDRESS.to_bytes(4, "little")
    advertising = golden | {each[4:-3] for each in packets if each[:4] == address}
    data = {each[4:-3] for each in packets if each[:4] != address}
    controls = {bytes.fromhex(octets) for octets, _ in CONTROLS} | {each[2:] for each in data if each[0] & 3 == 3}
    packets |= {address + each + b"crc" for each in golden}
    parts = {"advertising": advertising, "data": data, "control": controls}
    return sorted(packets), {name: sorted(part) for name, part in parts.items()}


def messages_of_a_mesh() -> list[network.NetworkPdu]:
    """Return network PDUs with payloads whole and in segments, and a control message."""
    sizes = (0, 1, 8, 9, 100, LONGEST_PAYLOAD)
    made = [
        each.pdu
        for sequence, size in enumerate(sizes)
        for each in parts(size % 3, 7, 1_000 * sequence, Outgoing(BROADCAST, bytes(size)))
    ]
    return [*made, network.NetworkPdu(0, 1, 0x1201, 0xFFFD, bytes.fromhex("034b50057e400000010000"), True, 0x68)]


def network_pdus() -> Frames:
    return [network.encode_network(each) for each in messages_of_a_mesh()]


def data_for_all() -> Frames:
    """Return advertising data of legacy advertising, and of a mesh."""
    return [structure(b""), structure(bytes(27)), *(bearer.encode_bearer(each) for each in network_pdus())]


def made_nonconnectable(data: bytes) -> bytes:
    kind, address = pdu.AdvertisingType.ADV_NONCONN_IND, pdu.DeviceAddress(0xC05100000001, True)
    return pdu.encode_advertising(pdu.Undirected(kind, address, data))


class Node:
    """A node of a mesh that takes network PDUs, a millisecond apart."""

    def __init__(self) -> None:
        self._inbox, self._times = Inbox(), count(0, MS)

    def take(self, octets: bytes) -> None:
        self._inbox.take(network.decode_network(octets), next(self._times))


def packets_of_low_energy() -> Frames:
    return low_energy()[0]


def pdus(part: str) -> Callable[[], Frames]:
    return lambda: low_energy()[1][part]


def pieces() -> Frames:
    return [*extended.pieces(b""), *extended.pieces(bytes(range(256)) * 2)]


class Defragmenter:
    """A link that puts together what comes, in one fragment or two."""

    def __init__(self) -> None:
        self._reassembly, self._turn = l2cap.Reassembly(), cycle((0, 0, 0, 3, 5))

    def take(self, octets: bytes) -> None:
        cut = next(self._turn) or len(octets)
        for llid, part in ((pdu.Llid.START, octets[:cut]), (pdu.Llid.CONTINUATION, octets[cut:])):
            if part or llid is pdu.Llid.START:
                self._reassembly.take(Fragment(llid, part))


def l2cap_messages() -> Frames:
    return [(3 + n).to_bytes(2, "little") + b"\x04\x00\x1b\x03\x00" + bytes(n) for n in (0, 1, 20, 240)]


WIDER = "pseudonet, several piconets"
ROUTED = {kind: {"kind": "adhoc", "routing": {"kind": kind}, "range_m": 6} for kind in ("aodv", "olsr", "flooding")}
TEAMS = {
    **SCENARIOS,
    WIDER: WIDE,
    **{kind: scenario("aggregation", channel=channel) for kind, channel in ROUTED.items()},
}
LOW_ENERGY = scenario("monitoring", channel={"kind": "ble"})


class Viewer:
    """Who looks at packets of Low Energy, each beside those before it."""

    def __init__(self) -> None:
        self._rows: deque[dict[str, Any]] = deque(maxlen=6)

    def take(self, octets: bytes) -> None:
        kind = ("DATA", "AUX_ADV_IND", "AUX_CHAIN_IND", "ADV_NONCONN_IND")[len(octets) % 4]
        row = {"source": 0, "kind": kind, "body": octets.hex(), "retry": len(octets) % 7 == 0, "routed": False}
        rows = list(self._rows)
        said = frame_said(LOW_ENERGY, octets, row, lambda _: (iter(rows[:3]), iter(rows[3:])))
        json.dumps(said, allow_nan=False)
        self._rows.append(row)


LAP, UAP = 0x9E8B33, 0x47


def bits_of_packets() -> Frames:
    """Return packets of Basic Rate, an octet a bit."""
    head = packet.Header(1, 0, seqn=1)
    bodies = {"FHS": bytes(18)} | {name: bytes(range(9)) for name in packet.TYPE_CODES if name[0] == "D"}
    made = [packet.encode(kind, LAP, UAP, head, bodies.get(kind.name, b"")) for kind in packet.KINDS.values()]
    return [bytes(each) for each in (*made, packet.encode(packet.ID, LAP, UAP))]


def take_bits(octets: bytes) -> None:
    packet.decode([octet & 1 for octet in octets], LAP, UAP)


def payloads_of_packets() -> Frames:
    """Return payloads of Basic Rate without CRC, each after an octet with its type."""
    sizes = {"DM1": 17, "DH1": 27, "DM3": 5, "DH3": 100, "DM5": 1, "DH5": 0}
    kinds = {packet.KINDS[packet.TYPE_CODES[name]]: size for name, size in sizes.items()}
    made = [bytes([packet.TYPE_CODES["FHS"]]) + bytes(18)]
    for kind, size in kinds.items():
        whole = packet.payload_bytes(kind, UAP, bytes(size))
        made.append(bytes([packet.TYPE_CODES[kind.name]]) + whole[:-2])
    return made


def take_payload(octets: bytes) -> None:
    """Decode a packet with this payload: its type is in the first octet, its checks are right."""
    kind = packet.KINDS.get(octets[0] & 15) if octets else None
    if kind is None:
        return
    body = octets[1:] + codes.crc16(UAP, octets[1:]).to_bytes(2, "little")
    bits = codes.bytes_to_bits(body)
    header = packet.Header(1, packet.TYPE_CODES[kind.name]).checked(UAP)
    whole = [*codes.access_code(LAP), *codes.repeat(codes.to_bits(header, 18))]
    packet.decode([*whole, *(codes.protect(bits) if kind.coded else bits)], LAP, UAP)


# ---------------------------------------------------------------- frames of routers


AODV = [
    aodv_wire.Rreq(0, 1, 3, None, 1, 7),
    aodv_wire.Rreq(3, 2, 2, 9, 0, 7, True, True),
    aodv_wire.Rrep(0, 3, 5, 1, 3000),
    aodv_wire.Rrep(2, 1, 5, 0, 100, True),
    aodv_wire.Rerr(((3, 17), (2, 1))),
    aodv_wire.RrepAck(),
]
HELLOS = [
    olsr_wire.Hello(2 * S, 3, {}),
    olsr_wire.Hello(2 * S, 7, {olsr_wire.link_code(olsr_wire.SYM_LINK, olsr_wire.SYM_NEIGH): [0, 2], 9: [3]}),
]
TCS = [olsr_wire.Tc(5, [3, 0]), olsr_wire.Tc(65_535, [])]


def aodv_messages() -> Frames:
    return [aodv_wire.encode_message(message) for message in AODV]


def hellos() -> Frames:
    return [olsr_wire.encode_hello(hello) for hello in HELLOS]


def tcs() -> Frames:
    return [olsr_wire.encode_tc(tc) for tc in TCS]


def olsr_packets() -> Frames:
    bodies = [*((1, body) for body in hellos()), *((2, body) for body in tcs()), (77, b"\xab")]
    messages = [olsr_wire.Message(kind, 6 * S, 1, 4, 0, 9 + n, body) for n, (kind, body) in enumerate(bodies)]
    return [olsr_wire.encode_packet(8, each) for each in ([], *([message] for message in messages), messages)]


def ip_packets() -> Frames:
    control = [udp(ip.AODV_PORT, each) for each in aodv_messages()]
    control += [udp(ip.OLSR_PORT, each) for each in olsr_packets()]
    payloads = [ip.encode(ip.Datagram(1, to, 3, ip.PAYLOAD_PORT, to + 2, bytes(9))) for to in (BROADCAST, 0, 2)]
    return [*control, *payloads, *(frame for kind in ROUTED for frame in on_air(kind)[:40])]


class Routing:
    """A router of robot 0, to which neighbours send one packet after the other."""

    def __init__(self, router: Queues) -> None:
        self._router, self._times = router, count(0, 7 * MS)

    def take(self, octets: bytes) -> None:
        now, router = next(self._times), self._router
        router.receive(octets, 1 + len(octets) % 3, now)
        due = router.wake_at()
        if due is not None and due <= now:
            router.wake(now)
        for drain in (router.hops, router.deliveries, router.fates):
            drain()


# ---------------------------------------------------------------- frames of protocols


@cache
def on_air(team: str) -> Frames:
    """Return the payloads, or routed packets, that a run of a team has on the air."""
    run = Simulation(TEAMS[team], 1, (TRANSMISSIONS,))
    run.run()
    columns = run.trace.columns(TRANSMISSIONS.name)
    bodies = {body for body, kind in zip(columns["body"], columns["kind"], strict=True) if kind in ("IDEAL", "DATA")}
    return sorted(bytes.fromhex(body) for body in bodies)


def maps() -> Frames:
    stream = map_frames.Stream(1, 8)
    piece = map_frames.Piece(stream, 0, 9, map_frames.to_runs([5, 6, 7, 20], [True, True, True, False]))
    entries = (map_frames.Entry(stream, 3, 1), map_frames.Entry(map_frames.Stream(2, 1), 0, 0))
    told = (piece, piece._replace(number=1, runs=piece.runs[:0]), map_frames.Summary(1.0, 2.0, entries))
    return [map_frames.encode(1, message) for message in told]


def written() -> Frames:
    return [letters.encode(letter) for letter in LETTERS]


def news() -> Frames:
    return [status.encode(each) for each in (NEWS, NEWS._replace(serial=4, goal_m=(1.0, 2.0), over=True))]


def transported() -> Frames:
    """Return frames of a transport that carry letters, news and maps, and some that carry nothing of that kind."""
    bodies = [*(Part(n, 0, 0, 1, each) for n, each in enumerate(written())), Part(9, 4, 1, 3, b"abc"), Ack(7, 3, 5)]
    bodies += [Publication(status.TOPIC, n, each) for n, each in enumerate(news())]
    bodies += [Publication(1, n, each) for n, each in enumerate(maps())]
    return [in_frame(body, destination) for body in bodies for destination in (0, 2)]


DIRECTORY = Directory(tuple(Piconet(first, tuple(range(first + 1, first + 8))) for first in range(0, 32, 8)))
"""A team in which every name is somebody's."""
MORE: dict[str, Callable[[], Frames]] = {
    "agents": lambda: [in_frame(Publication(0, 1, b"")), in_frame(Ack(33, 1, 0), 0)],
    "exploration": maps,
    "deployment": transported,
}
"""What the runs here do not put on the air of their own."""


def sent_by(team: str) -> Callable[[], Frames]:
    return lambda: [*on_air(team), *MORE.get(team, list)()]


def requests() -> Frames:
    """Return requests at the console of a deployment's host."""
    return [
        b'{"say": "plays", "request": 1}',
        b'{"say": "call", "request": 2, "call": {"play": "x", "parameters": {"a": [1, 2.5]}}, "execute": true}',
        b'{"say": "execute", "request": 3, "plan": 1}',
        b'{"say": "switch", "request": 4, "strategy": "wave"}',
        b'{"say": "terminate", "request": 5, "task": "a/b"}',
        b'{"say": "map", "request": 6}',
        b'{"say": "route", "request": 7, "robot": 1, "to": [3.0, 4]}',
        b'{"say": "picture", "request": 8, "robot": 2}',
        b'{"say": "state", "request": 9}',
    ]


def wishes() -> Frames:
    """Return what pages send to a server."""
    return [
        *(b'{"say": "play"}', b'{"say": "pause"}', b'{"say": "speed", "speed": 2.5}', b'{"say": "again"}'),
        b'{"say": "step", "by": "tick", "count": -1}',
        b'{"say": "seek", "time_s": 12.0}',
        b'{"say": "reach", "robot": 0, "x_m": 1.0, "y_m": 2.0}',
        *(b'{"say": "map", "robot": -1}', b'{"say": "scan", "robot": 0}'),
        b'{"say": "operator", "robot": 0, "data": {"say": "call", "list": [1, null, {"a": true}]}}',
    ]


def orders() -> Frames:
    return [struct.pack(">dd", 0.5, -0.25), struct.pack(">dd", 0.0, 0.0)]


class Team:
    """Machines of a run that has gone on for some time; what comes seems to be from the next robot, or a person."""

    def __init__(self, made: Scenario, typed: bool = False) -> None:
        self._made, self._typed = made, typed
        self._times = count(3 * S, 10 * MS)

    @cached_property
    def machines(self) -> list[Machine]:
        """The machines, three seconds after their start."""
        simulation = Simulation(self._made, 1)
        simulation.begin()
        simulation.advance(3 * S)
        return simulation.machines

    def take(self, data: bytes) -> None:
        now, size = next(self._times), len(self.machines)
        robot = 0 if self._typed else now // (10 * MS) % size
        source = OPERATOR if self._typed else (robot + 1) % size
        machine = self.machines[robot]
        machine.receive(data, Reception(source, not self._typed and len(data) % 2 == 0), now)
        due = machine.wake_at()
        if due is not None and due <= now:
            machine.wake(now)
        for drain in (machine.outbox, machine.commands, machine.events):
            drain()


# ---------------------------------------------------------------- all of them


def spec_decoder(made: Scenario) -> Callable[[bytes], object]:
    decode, parameters = made.protocol.spec.decode, made.protocol.parameters
    assert decode is not None
    return lambda data: decode(parameters, made.team.size, data)


def telling(made: Scenario, routed: bool = False) -> Callable[[bytes], object]:
    return lambda data: json.dumps(decoded(made, data, routed), allow_nan=False)


def _of_low_energy() -> dict[str, Decoder]:
    bits, ble = "cosim.channels.ble.bits", "cosim.channels.ble"
    kinds = cycle(("DATA", "CONTROL", "AUX_ADV_IND", "AUX_CHAIN_IND", "ADV_IND", "ADV_NONCONN_IND"))
    parameters = [bytes.fromhex(LL_DATA_OCTETS)]
    return {
        f"{bits}.pdu.decode_advertising": Decoder(pdu.decode_advertising, pdus("advertising"), mend=counted),
        f"{bits}.pdu.decode_data": Decoder(pdu.decode_data, pdus("data"), mend=counted),
        f"{bits}.pdu.decode_ll_data": Decoder(pdu.decode_ll_data, lambda: parameters),
        f"{bits}.control.decode_control": Decoder(control.decode_control, pdus("control")),
        f"{ble}.connections.channel_map.decode_channel_map": Decoder(
            channel_map.decode_channel_map, lambda: [bytes.fromhex("0006e0001e"), bytes.fromhex("ffffffffff")]
        ),
        f"{ble}.dissection.dissect": Decoder(
            lambda octets: dissection.dissect(next(kinds), octets), packets_of_low_energy, mend=counted_in_packet
        ),
        f"{bits}.mesh.bearer.decode_bearer": Decoder(bearer.decode_bearer, lambda: data_for_all()[2:]),
        f"{bits}.mesh.network.decode_network": Decoder(network.decode_network, network_pdus),
        f"{bits}.mesh.lower_transport.decode_lower": Decoder(
            lower_transport.decode_lower, lambda: [each.transport for each in messages_of_a_mesh() if not each.control]
        ),
        f"{bits}.mesh.upper_transport.decode_upper": Decoder(
            upper_transport.decode_upper, lambda: [upper_transport.encode_upper(bytes(size)) for size in (0, 1, 100)]
        ),
        "a node of a mesh": Decoder(Node().take, network_pdus),
        "pieces of payloads for everyone": Decoder(piece_of, pieces, NONE),
        "L2CAP messages in fragments": Decoder(Defragmenter().take, l2cap_messages, mend=counted_message),
        "a viewer of Low Energy": Decoder(Viewer().take, packets_of_low_energy, NONE, counted_in_packet),
    }


def _of_bluetooth() -> dict[str, Decoder]:
    fhs = packet.Fhs(LAP, UAP, 0x1234, 0, 1, 5).to_bytes()
    return {
        "bits of Basic Rate": Decoder(take_bits, bits_of_packets, NONE),
        "payloads of Basic Rate": Decoder(take_payload, payloads_of_packets, NONE),
        "FHS": Decoder(packet.fhs_of, lambda: [fhs], ValueError),
    }


def _of_routers() -> dict[str, Decoder]:
    routing, draws = "cosim.channels.adhoc.routing", Draws(1, "routers")
    return {
        f"{routing}.ip.decode": Decoder(ip.decode, ip_packets, mend=summed),
        f"{routing}.aodv_wire.decode_message": Decoder(aodv_wire.decode_message, aodv_messages),
        f"{routing}.olsr_wire.decode_packet": Decoder(olsr_wire.decode_packet, olsr_packets, mend=olsr_counted),
        f"{routing}.olsr_wire.decode_hello": Decoder(olsr_wire.decode_hello, hellos),
        f"{routing}.olsr_wire.decode_tc": Decoder(olsr_wire.decode_tc, tcs),
        "names of routers' packets": Decoder(packet_name, ip_packets, NONE, summed),
        "router: aodv": Decoder(Routing(Aodv(0, AodvSettings(), draws)).take, ip_packets, NONE, summed),
        "router: olsr": Decoder(Routing(Olsr(0, OlsrSettings(), draws)).take, ip_packets, NONE, olsr_summed),
        "router: flooding": Decoder(Routing(Flooding(0, FloodingSettings(), draws)).take, ip_packets, NONE, summed),
    }


def _of_frames() -> dict[str, Decoder]:
    """Return the decoders of what protocols share, or have below what their specs name."""
    pseudonet, layout = "protocols.pseudonet", heartbeats.LAYOUT
    of_deployment = "protocols.deployment.messages"
    told = {name: sent_by(name) for name in SCENARIOS}

    def anything(body: Part | Publication) -> object:
        return letters.decode(body.payload, 4)

    return {
        "protocols.wire.check": Decoder(wire.check, told["monitoring"], mend=sealed),
        "protocols.wire.open": Decoder(wire.open, told["monitoring"], mend=sealed),
        "protocols.wire.unpack": Decoder(lambda data: wire.unpack(layout, data), told["monitoring"], mend=sealed),
        "protocols.monitoring.heartbeats.decode": Decoder(heartbeats.decode, told["monitoring"], mend=sealed),
        "protocols.reflection.frames.decode": Decoder(reflection_frames.decode, told["reflection"], mend=sealed),
        "protocols.aggregation.frames.decode": Decoder(aggregation_frames.decode, told["aggregation"], mend=sealed),
        f"{pseudonet}.messages.decode": Decoder(pseudonet_messages.decode, told["pseudonet"], mend=sealed),
        f"{pseudonet}.messages.marks_in": Decoder(
            lambda data: pseudonet_messages.marks_in(data, layout), told["monitoring"]
        ),
        f"{pseudonet}.wide.decode": Decoder(lambda data: wide.decode(data, DIRECTORY), sent_by(WIDER), mend=sealed),
        f"{pseudonet}.wide.decode_anonymous": Decoder(wide.decode_anonymous, sent_by(WIDER), mend=sealed),
        "protocols.mapping.frames.decode": Decoder(map_frames.decode, maps, mend=sealed),
        "protocols.mapping.frames.decode_all": Decoder(map_frames.decode_all, maps, mend=sealed),
        "protocols.transport.frames.decode": Decoder(transport_frames.decode, transported, mend=sealed),
        "protocols.transport.decoding.decode_all": Decoder(
            lambda data: transport_decoding.decode_all(data, anything), transported, mend=sealed
        ),
        f"{of_deployment}.messages.decode": Decoder(lambda data: letters.decode(data, 4), written),
        f"{of_deployment}.status.decode": Decoder(lambda data: status.decode(data, 4), news),
        "protocols.deployment.operator.console.read": Decoder(console.read, requests),
        "numbers of requests": Decoder(console.number_of, requests, NONE),
        "cosim.web.messages.parsed": Decoder(web_messages.parsed, wishes, UserError),
    }


def _of_protocols() -> dict[str, Decoder]:
    """Return the decoders that specs name, machines of their teams, and who looks at their payloads."""
    made: dict[str, Decoder] = {}
    for name in (*SCENARIOS, WIDER):
        team, frames = TEAMS[name], sent_by(name)
        own = f"protocols.{name}.spec.decode" if name in ("agents", "deployment", "pseudonet") else f"payloads: {name}"
        made[own] = Decoder(spec_decoder(team), frames, mend=sealed)
        made[f"a viewer of payloads: {name}"] = Decoder(telling(team), frames, NONE, sealed)
        made[f"machines: {name}"] = Decoder(Team(team).take, frames, NONE, sealed)
    for name, typed in {"agents": orders, "deployment": requests}.items():
        made[f"console: {name}"] = Decoder(Team(SCENARIOS[name], True).take, typed, NONE)
    made["a viewer of routed packets"] = Decoder(telling(SCENARIOS["aggregation"], True), ip_packets, NONE, summed)
    return made


def decoders() -> dict[str, Decoder]:
    """Return all, as new, by their names; functions that raise WireError by where they are."""
    return {**_of_low_energy(), **_of_bluetooth(), **_of_routers(), **_of_frames(), **_of_protocols()}
