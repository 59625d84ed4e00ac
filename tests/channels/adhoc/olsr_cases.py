"""What the tests of OLSR share: networks of its routers whose hops take 1 ms, and what was sent there."""

import networkx as nx

from cosim.channels.adhoc.routing.ip import OLSR_PORT, Datagram, decode, encode
from cosim.channels.adhoc.routing.olsr import Olsr, OlsrSettings
from cosim.channels.adhoc.routing.olsr_wire import HELLO, Message, decode_packet, encode_packet
from cosim.machine import BROADCAST
from cosim.randomness import Draws
from cosim.units import MS, S, Time
from tests.channels.adhoc.lossless_hops import DELAY, LosslessHops

CONVERGED = 30 * S

JITTER = S // 2

GRAPHS = {
    "line": nx.path_graph(7),
    "ring": nx.cycle_graph(8),
    "star": nx.star_graph(5),
    "full": nx.complete_graph(5),
    "grid": nx.convert_node_labels_to_integers(nx.grid_2d_graph(3, 4)),
} | {f"random {seed}": nx.connected_watts_strogatz_graph(12, 4, 0.5, seed=seed) for seed in range(4)}


def olsr(address: int, **settings: object) -> Olsr:
    return Olsr(address, OlsrSettings.model_validate(settings), Draws(1, "olsr"))


def network(graph: nx.Graph, **settings: object) -> LosslessHops:
    return LosslessHops([olsr(address, **settings) for address in range(len(graph))], graph.edges)


def converged(name: str, **settings: object) -> LosslessHops:
    net = network(GRAPHS[name], **settings)
    net.run(CONVERGED)
    return net


def router(net: LosslessHops, address: int) -> Olsr:
    found = net.routers[address]
    assert isinstance(found, Olsr)
    return found


def messages(net: LosslessHops, address: int, kind: int) -> list[tuple[Time, Message]]:
    """Return all own messages of that kind that *address* has sent, and when."""
    return [
        (time, message)
        for time, sender, hop in net.sent
        if sender == address and (datagram := decode(hop.payload)).port == OLSR_PORT
        for message in decode_packet(datagram.data)[1]
        if message.kind == kind and message.origin == address
    ]


def gone_at(net: LosslessHops, address: int, destination: int, until: Time, step: Time = 10 * MS) -> Time:
    """Return when *address* has no route any more, to the step."""
    while destination in router(net, address).routes(net.now):
        assert net.now < until
        net.run(net.now + step)
    return net.now


def last_hello(net: LosslessHops, sender: int) -> Time:
    return max(time for time, _ in messages(net, sender, HELLO) if time + DELAY <= net.now) + DELAY


def packet(source: int, number: int, *sent: Message) -> bytes:
    return encode(Datagram(source, BROADCAST, 1, OLSR_PORT, number, encode_packet(number, sent)))
