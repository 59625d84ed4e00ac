"""What the tests of AODV share: networks of its routers whose hops take 1 ms, and what was sent there."""

from collections.abc import Iterable
from itertools import pairwise

import networkx as nx
from hypothesis import strategies as st

from cosim.channels.adhoc.mac import Packet
from cosim.channels.adhoc.routing.aodv import Aodv, AodvSettings
from cosim.channels.adhoc.routing.aodv_wire import Message, Rerr, Rrep, RrepAck, Rreq, decode_message
from cosim.channels.adhoc.routing.ip import AODV_PORT, decode
from cosim.machine import Address
from cosim.randomness import Draws
from cosim.units import Time
from tests.channels.adhoc.lossless_hops import LosslessHops

QUIET = {"use_hello": False, "broadcast_jitter_s": 0.0}


def network(size: int, links: Iterable[tuple[Address, Address]], **said: object) -> LosslessHops:
    chosen = AodvSettings.model_validate(QUIET | said)
    return LosslessHops([Aodv(address, chosen, Draws(1, "aodv")) for address in range(size)], links)


def line(size: int) -> list[tuple[Address, Address]]:
    return list(pairwise(range(size)))


def router(net: LosslessHops, address: Address) -> Aodv:
    found = net.routers[address]
    assert isinstance(found, Aodv)
    return found


def messages(net: LosslessHops, kind: type[Message]) -> list[tuple[Time, Address, Packet, Message]]:
    """Return all messages of a kind that were sent: when, by whom, the hop, the message."""
    found = []
    for time, sender, hop in net.sent:
        datagram = decode(hop.payload)
        if datagram.port == AODV_PORT:
            message = decode_message(datagram.data)
            if isinstance(message, kind):
                found.append((time, sender, hop, message))
    return found


def way(net: LosslessHops, source: Address, destination: Address) -> list[Address]:
    """Follow next hops as far as they lead; fail on a loop."""
    at, passed = source, [source]
    while at != destination:
        after = router(net, at).next_hop(destination, net.now)
        if after is None:
            break
        assert after not in passed, f"{passed} and on to {after} is a loop on the way to {destination}"
        passed.append(after)
        at = after
    return passed


NEAR = st.integers(0, 5)

NUMBER = st.integers(0, 0xFFFFFFFF)

MESSAGES: st.SearchStrategy[Message] = st.one_of(
    st.builds(Rreq, st.integers(0, 255), NUMBER, NEAR, st.none() | NUMBER, NEAR, NUMBER, st.booleans(), st.booleans()),
    st.builds(Rrep, st.integers(0, 255), NEAR, NUMBER, NEAR, NUMBER, st.booleans()),
    st.builds(Rerr, st.lists(st.tuples(NEAR, NUMBER), min_size=1, max_size=3).map(tuple), st.booleans()),
    st.builds(RrepAck),
)

GRAPHS = {
    "line": nx.path_graph(9),
    "ring": nx.cycle_graph(11),
    "random 1": nx.connected_watts_strogatz_graph(16, 4, 0.4, seed=1),
    "random 2": nx.random_labeled_tree(14, seed=2),
    "random 3": nx.gnp_random_graph(14, 0.3, seed=3),
}
