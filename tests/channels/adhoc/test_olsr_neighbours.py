"""What OLSR makes of HELLOs: links, neighbours, hysteresis; and which relays it chooses."""

import networkx as nx
import pytest

from cosim.channels.adhoc.routing.olsr_graph import RoutingEntry, routing_table, select_mprs
from cosim.channels.adhoc.routing.olsr_neighbours import Hysteresis, Neighbourhood
from cosim.channels.adhoc.routing.olsr_wire import (
    ASYM_LINK,
    LOST_LINK,
    MPR_NEIGH,
    NOT_NEIGH,
    SYM_LINK,
    SYM_NEIGH,
    Hello,
    link_code,
)
from cosim.units import S, Time

NOBODY = link_code(ASYM_LINK, NOT_NEIGH)
NEIGHBOUR = link_code(SYM_LINK, SYM_NEIGH)
RELAY = link_code(SYM_LINK, MPR_NEIGH)
LOST = link_code(LOST_LINK, NOT_NEIGH)


class Ear:
    """Robot 0's knowledge, and packets with nothing but a HELLO of 2 s."""

    def __init__(self, hysteresis: Hysteresis | None = None, coverage: int = 1) -> None:
        self.known = Neighbourhood(0, 6 * S, coverage, hysteresis)
        self.number = 0

    def hears(self, origin: int, now: Time, missing: int = 0, /, **links: list[int]) -> None:
        codes = {"nobody": NOBODY, "neighbour": NEIGHBOUR, "relay": RELAY, "lost": LOST}
        self.number += 1 + missing
        self.known.packet(origin, self.number, now)
        hello = Hello(2 * S, 3, {codes[name]: addresses for name, addresses in links.items()})
        self.known.hello(origin, hello, 6 * S, self.number, now)


def test_who_does_not_name_us_is_heard_but_no_neighbour() -> None:
    ear = Ear()
    ear.hears(1, 0, neighbour=[2])
    assert ear.known.links(0) == {NOBODY: [1]}
    assert ear.known.willingness == {}
    assert ear.known.reach == {}


@pytest.mark.parametrize("named", ["nobody", "neighbour", "relay"])
def test_who_names_us_is_a_neighbour(named: str) -> None:
    ear = Ear()
    ear.hears(1, 0, **{named: [0]})
    assert ear.known.links(0) == {NEIGHBOUR: [1]}
    assert ear.known.selectors == ({1} if named == "relay" else set())


def test_who_has_lost_us_is_no_neighbour_any_more() -> None:
    ear = Ear()
    ear.hears(1, 0, relay=[0], neighbour=[5])
    ear.hears(1, S, lost=[0], neighbour=[5])
    assert ear.known.links(S) == {NOBODY: [1]}
    assert (ear.known.selectors, ear.known.reach) == (frozenset(), {})


def test_a_silent_neighbour_is_lost_after_the_validity_and_forgotten_after_the_hold_time() -> None:
    ear = Ear()
    ear.hears(1, 0, relay=[0], neighbour=[5])
    assert ear.known.links(6 * S - 1) == {RELAY: [1]}
    assert ear.known.reach == {1: {5}}
    assert ear.known.links(6 * S) == {LOST: [1]}
    assert (ear.known.reach, ear.known.mprs, ear.known.selectors) == ({}, frozenset(), frozenset())
    assert ear.known.links(12 * S - 1) == {LOST: [1]}
    assert ear.known.links(12 * S) == {}


def test_a_neighbour_of_a_neighbour_goes_when_it_is_told_or_told_no_more() -> None:
    ear = Ear()
    ear.hears(1, 0, neighbour=[0, 5, 6])
    ear.hears(1, S, neighbour=[0, 6], lost=[5])
    assert ear.known.reach == {1: {6}}
    ear.hears(1, 5 * S, neighbour=[0])
    ear.known.advance(7 * S - 1)
    assert ear.known.reach == {1: {6}}
    ear.known.advance(7 * S)
    assert ear.known.reach == {1: set()}


def test_the_link_layers_word_counts_for_the_hold_time_whatever_hellos_say() -> None:
    ear = Ear()
    ear.hears(1, 0, neighbour=[0])
    ear.known.broken(1, S)
    for now in (2 * S, 4 * S, 6 * S):
        ear.hears(1, now, neighbour=[0])
        assert ear.known.links(now) == {LOST: [1]}
    assert ear.known.links(7 * S) == {NEIGHBOUR: [1]}


# ---------------------------------------------------------------- hysteresis, by the numbers of section 14.3

HYSTERESIS = Hysteresis(0.8, 0.3, 0.5)


def test_a_link_proves_itself_with_three_hellos() -> None:
    ear = Ear(HYSTERESIS)  # quality 0.5, 0.75, 0.875
    for now in (0, 2 * S):
        ear.hears(1, now, neighbour=[0])
        assert ear.known.links(now) == {}
        assert ear.known.willingness == {}
    ear.hears(1, 4 * S, neighbour=[0])
    assert ear.known.links(4 * S) == {NEIGHBOUR: [1]}


def test_two_lost_packets_end_it_and_two_that_arrive_bring_it_back() -> None:
    ear = Ear(HYSTERESIS)
    for now in range(0, 12, 2):
        ear.hears(1, now * S, neighbour=[0])
    ear.hears(1, 11 * S, 1, neighbour=[0])  # 0.98 -> 0.49 -> 0.75
    assert ear.known.links(11 * S) == {NEIGHBOUR: [1]}
    ear.hears(1, 12 * S, 2, neighbour=[0])  # 0.37, 0.19: lost -> 0.59
    assert ear.known.links(12 * S) == {LOST: [1]}
    ear.hears(1, 13 * S, neighbour=[0])  # 0.80, and a little less
    assert ear.known.links(13 * S) == {LOST: [1]}
    ear.hears(1, 14 * S, neighbour=[0])
    assert ear.known.links(14 * S) == {NEIGHBOUR: [1]}


def test_the_lower_threshold_is_that_of_the_settings() -> None:
    for missing, kind in ((2, NEIGHBOUR), (3, LOST)):  # 0.87 -> 0.52, 0.31 and then 0.19; the packet itself adds 0.4
        ear = Ear(Hysteresis(0.8, 0.3, 0.4))
        for now in range(0, 8, 2):
            ear.hears(1, now * S, neighbour=[0])
        assert ear.known.links(6 * S) == {NEIGHBOUR: [1]}
        ear.hears(1, 7 * S, missing, neighbour=[0])
        assert ear.known.links(7 * S) == {kind: [1]}


def test_with_hysteresis_the_next_packet_takes_back_the_link_layers_word() -> None:
    ear = Ear(HYSTERESIS)
    for now in range(0, 12, 2):
        ear.hears(1, now * S, neighbour=[0])
    assert ear.known.broken(1, 11 * S)
    assert ear.known.links(11 * S) == {LOST: [1]}
    ear.hears(1, 12 * S, neighbour=[0])
    assert ear.known.links(12 * S) == {NEIGHBOUR: [1]}


def test_a_packet_lost_in_silence_is_not_lost_a_second_time() -> None:
    ear = Ear(HYSTERESIS)
    for now in range(0, 12, 2):
        ear.hears(1, now * S, neighbour=[0])
    ear.hears(1, 13 * S, 1, neighbour=[0])  # silent at 12 s: 0.49 -> 0.75, not 0.25 -> 0.62
    assert ear.known.links(13 * S) == {NEIGHBOUR: [1]}


def test_a_neighbour_that_counts_from_anew_has_lost_nothing() -> None:
    ear = Ear(HYSTERESIS)
    for now in range(0, 12, 2):
        ear.hears(1, now * S, neighbour=[0])
    ear.number -= 5
    ear.hears(1, 11 * S, neighbour=[0])
    assert ear.known.links(11 * S) == {NEIGHBOUR: [1]}


# ---------------------------------------------------------------- relays


def alike(*neighbours: int) -> dict[int, int]:
    return dict.fromkeys(neighbours, 3)


def test_the_only_way_to_somebody_becomes_a_relay() -> None:
    assert select_mprs(alike(1, 2, 3), {1: {10}, 2: {10, 11}, 3: {12}}) == {2, 3}


def test_neighbours_and_their_links_among_each_other_need_no_relay() -> None:
    assert select_mprs(alike(1, 2), {1: {2}, 2: {1}}) == frozenset()


def test_the_more_willing_is_preferred_to_who_reaches_more() -> None:
    reach = {1: {10, 11, 12}, 2: {10, 11}, 3: {12}, 4: {11, 12}}
    assert select_mprs(alike(1, 2, 3, 4), reach) == {1}
    assert select_mprs({1: 3, 2: 4, 3: 4, 4: 2}, reach) == {2, 3}


def test_who_reaches_as_many_but_has_more_neighbours_is_preferred() -> None:
    # 1 is the only way to 10 and 11 comes with it; 12 is reached over 2 and 3, 3 also reaches 11
    reach = {1: {10, 11}, 2: {12}, 3: {11, 12}}
    assert select_mprs(alike(1, 2, 3), reach) == {1, 3}


def test_who_is_the_only_way_to_somebody_is_chosen_before_who_reaches_most() -> None:
    """Section 8.3.1, step 3 before 4: the other way round 2, which reaches most, and 3 would be relays too."""
    reach = {1: {10, 11, 12}, 2: {11, 12, 13, 14}, 3: {15, 11, 12}, 4: {13, 14, 15}}
    assert select_mprs(alike(1, 2, 3, 4), reach) == {1, 4}


def test_who_never_forwards_is_no_relay_and_who_always_does_is() -> None:
    assert select_mprs({1: 0, 2: 3, 3: 7}, {1: {10, 11}, 2: {10}, 3: set()}) == {2, 3}


def test_a_relay_that_others_have_made_superfluous_is_taken_back() -> None:
    # by reach 1 comes first (4), then 2 and 3 for what is left; together they reach all that 1 reaches
    reach = {1: {10, 11, 12, 13}, 2: {10, 11, 14}, 3: {12, 13, 15}, 4: {14}, 5: {15}}
    assert select_mprs(alike(1, 2, 3, 4, 5), reach) == {2, 3}


@pytest.mark.parametrize("coverage", [1, 2, 3])
@pytest.mark.parametrize("seed", range(20))
def test_everybody_two_hops_away_is_reached_as_often_as_asked_for_and_no_relay_is_spare(
    seed: int, coverage: int
) -> None:
    graph = nx.gnp_random_graph(16, 0.25, seed=seed)
    for address in graph:
        near = set(graph[address])
        chosen = select_mprs(alike(*near), {y: set(graph[y]) - {address} for y in near}, coverage)
        far = {each for y in near for each in graph[y]} - near - {address}

        def enough(relays: frozenset[int], near: set[int] = near, far: set[int] = far) -> bool:
            return all(len(relays & set(graph[each])) >= min(coverage, len(near & set(graph[each]))) for each in far)

        assert chosen <= near
        assert enough(chosen)
        assert not any(enough(chosen - {relay}) for relay in chosen)


# ---------------------------------------------------------------- ways of two hops


def test_nobody_is_reached_over_who_never_forwards() -> None:
    assert routing_table(0, {1: 0}, {1: {2}}, set(), []) == {1: RoutingEntry(1, 1)}


@pytest.mark.parametrize(
    ("willingness", "selectors", "over"), [((3, 7), set(), 2), ((3, 3), {2}, 2), ((3, 3), set(), 1)]
)
def test_two_hops_lead_over_the_more_willing_or_else_over_whom_one_is_a_relay_of(
    willingness: tuple[int, int], selectors: set[int], over: int
) -> None:
    table = routing_table(0, dict(zip((1, 2), willingness, strict=True)), {1: {0, 3}, 2: {0, 3}}, selectors, [])
    assert table == {1: RoutingEntry(1, 1), 2: RoutingEntry(2, 1), 3: RoutingEntry(over, 2)}
