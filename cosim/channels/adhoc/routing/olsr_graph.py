"""The algorithms of OLSR: multipoint relays and the routing table (RFC 3626, sections 8.3.1, 16.2, 10).

A robot's multipoint relays (MPRs) are neighbours over which it reaches all robots that are exactly two hops away. If
only relays of the last hop repeat a message, it still reaches all robots.
"""

from collections.abc import Iterable, Mapping, Set
from typing import NamedTuple

from cosim.channels.adhoc.routing.olsr_wire import WILL_ALWAYS, WILL_NEVER
from cosim.machine import Address


class RoutingEntry(NamedTuple):
    """An entry of the routing table (section 10): the route to one robot."""

    next_hop: Address
    hops: int


def select_mprs(
    willingness: Mapping[Address, int], reach: Mapping[Address, Set[Address]], coverage: int = 1
) -> frozenset[Address]:
    """Return which of the symmetric neighbours become relays, by the heuristic of sections 8.3.1 and 16.2.

    *willingness* is that of all symmetric neighbours; *reach* are the symmetric neighbours of each of them, without
    the robot that computes. Every robot two hops away is reached over *coverage* relays, or over all
    willing neighbours that it has in common with us. Ties that the RFC leaves open go to the lowest address.
    """
    strict = {y: frozenset(reach.get(y, ())) - willingness.keys() for y in willingness}
    degree = {y: len(strict[y]) for y in willingness}  # D(y)
    willing = sorted(y for y in willingness if willingness[y] != WILL_NEVER)
    covers: dict[Address, set[Address]] = {}
    for y in willing:
        for far in strict[y]:
            covers.setdefault(far, set()).add(y)
    need = {far: min(coverage, len(near)) for far, near in covers.items()}
    relays = {y for y in willing if willingness[y] == WILL_ALWAYS}
    for near in covers.values():
        if len(near) <= coverage:
            relays |= near
    while uncovered := {far for far, near in covers.items() if len(near & relays) < need[far]}:
        relays.add(
            max(
                (y for y in willing if y not in relays and strict[y] & uncovered),
                key=lambda y: (willingness[y], len(strict[y] & uncovered), degree[y], -y),
            )
        )
    for y in sorted(relays, key=lambda y: (willingness[y], y)):  # drop relays that are superfluous
        others = relays - {y}
        if willingness[y] < WILL_ALWAYS and all(len(covers[far] & others) >= need[far] for far in strict[y]):
            relays = others
    return frozenset(relays)


def routing_table(
    address: Address,
    willingness: Mapping[Address, int],
    reach: Mapping[Address, Set[Address]],
    selectors: Set[Address],
    topology: Iterable[tuple[Address, Address]],
) -> dict[Address, RoutingEntry]:
    """Return the routes of *address* with the fewest hops, to all robots that it knows a route to (section 10).

    *willingness* and *reach* are as in :func:`select_mprs`; *selectors* have chosen us as a relay; *topology* are
    pairs (origin of a TC, robot that it reaches).
    """
    table = {neighbour: RoutingEntry(neighbour, 1) for neighbour in willingness}
    # next hops are preferred that want to forward, and that forward for us anyway (step 3.2)
    for neighbour in sorted(willingness, key=lambda y: (-willingness[y], y not in selectors, y)):
        if willingness[neighbour] != WILL_NEVER:
            for far in reach.get(neighbour, ()):
                if far != address:
                    table.setdefault(far, RoutingEntry(neighbour, 2))
    onwards: dict[Address, list[Address]] = {}
    for last, destination in sorted(topology):
        onwards.setdefault(last, []).append(destination)
    frontier = sorted(far for far, route in table.items() if route.hops == 2)
    hops = 2
    while frontier:
        hops += 1
        reached = []
        for last in frontier:
            for destination in onwards.get(last, ()):
                if destination != address and destination not in table:
                    table[destination] = RoutingEntry(table[last].next_hop, hops)
                    reached.append(destination)
        frontier = sorted(reached)
    return table
