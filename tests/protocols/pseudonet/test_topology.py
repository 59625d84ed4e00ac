"""Shapes of scatternets: everybody is in, the bounds of Bluetooth are kept, broadcasts can reach everybody."""

from itertools import product

import networkx as nx
import pytest

from protocols.pseudonet.topology import (
    MOST_MASTERS,
    Directory,
    Piconet,
    colour,
    colours,
    design,
    piconets_needed,
)

TOPOLOGIES = ("ring", "tree", "bridged")
CASES = [
    (topology, most, size)
    for topology, most, size in product(TOPOLOGIES, range(3, 9), range(2, 33))
    if size > most and piconets_needed(size, topology, most) <= MOST_MASTERS  # type: ignore[arg-type]
]


def made(topology: str, most: int, size: int) -> list[Piconet]:
    count = piconets_needed(size, topology, most)  # type: ignore[arg-type]
    robots = [(7 * robot + 3) % 37 for robot in range(size)]  # in no order
    return design(robots[:count], robots[count:], topology, most)  # type: ignore[arg-type]


def test_there_are_cases_of_all_sizes() -> None:
    assert {(topology, size) for topology, most, size in CASES if most == 8} == set(product(TOPOLOGIES, range(9, 33)))


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_everybody_is_in_and_no_piconet_is_too_large_or_empty(topology: str) -> None:
    for _, most, size in [case for case in CASES if case[0] == topology]:
        piconets = made(topology, most, size)
        assert set(Directory(tuple(piconets)).members) == {(7 * robot + 3) % 37 for robot in range(size)}
        for piconet in piconets:
            assert 1 <= len(piconet.slaves) <= most - 1
            assert len(set(piconet.slaves)) == len(piconet.slaves)
            assert piconet.master not in piconet.slaves


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_a_message_gets_from_everybody_to_everybody(topology: str) -> None:
    for _, most, size in [case for case in CASES if case[0] == topology]:
        graph = nx.Graph()
        for piconet in made(topology, most, size):
            graph.add_edges_from((piconet.master, slave) for slave in piconet.slaves)
        assert nx.is_connected(graph)
        assert len(graph) == size


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_piconets_that_share_a_device_have_different_colours(topology: str) -> None:
    for _, most, size in [case for case in CASES if case[0] == topology]:
        piconets = made(topology, most, size)
        count = len(piconets)
        devices = [{piconet.master, *piconet.slaves} for piconet in piconets]
        used = [colour(topology, number, count, most) for number in range(count)]  # type: ignore[arg-type]
        assert set(used) <= set(range(colours(topology, count)))  # type: ignore[arg-type]
        for a, b in product(range(count), repeat=2):
            if a != b and devices[a] & devices[b]:
                assert used[a] != used[b]


def slave_in(piconets: list[Piconet], robot: int) -> int:
    return sum(robot in piconet.slaves for piconet in piconets)


@pytest.mark.parametrize("size", range(9, 33))
def test_on_a_ring_each_master_is_a_slave_in_one_other_piconet_as_the_paper_wants(size: int) -> None:
    piconets = made("ring", 8, size)
    assert len(piconets) >= 3
    assert [slave_in(piconets, piconet.master) for piconet in piconets] == [1] * len(piconets)


@pytest.mark.parametrize("size", range(9, 33))
def test_on_a_tree_each_master_but_the_root_is_a_slave_in_one_other_piconet(size: int) -> None:
    piconets = made("tree", 8, size)
    assert [slave_in(piconets, piconet.master) for piconet in piconets] == [0] + [1] * (len(piconets) - 1)


@pytest.mark.parametrize("size", range(9, 33))
def test_a_chain_is_bridged_by_slaves(size: int) -> None:
    piconets = made("bridged", 8, size)
    assert [slave_in(piconets, piconet.master) for piconet in piconets] == [0] * len(piconets)
    robots = Directory(tuple(piconets)).members
    assert sum(slave_in(piconets, robot) == 2 for robot in robots) == len(piconets) - 1


def test_names_are_the_piconet_and_the_place_in_it_own_piconets_first() -> None:
    directory = Directory((Piconet(4, (9, 7)), Piconet(7, (9, 2, 30))))
    assert directory.names == {4: 0, 9: 1, 7: 8, 2: 10, 30: 11}
    assert all(directory.robots[name] == robot for robot, name in directory.names.items())
    assert [robot for robot in directory.members if directory.is_plain(robot)] == [2, 30]
    assert directory.without((2,)) == Directory((Piconet(4, (9, 7)), Piconet(7, (9, 30))))


@pytest.mark.parametrize(
    ("size", "topology", "most", "count"),
    [
        *((8, "ring", 8, 1), (9, "ring", 8, 3), (21, "ring", 8, 3), (22, "ring", 8, 4), (32, "ring", 8, 5)),
        *((9, "tree", 8, 2), (15, "tree", 8, 2), (16, "tree", 8, 3), (32, "tree", 8, 5)),
        *((9, "bridged", 8, 2), (15, "bridged", 8, 2), (32, "bridged", 8, 5)),
    ],
)
def test_as_few_piconets_as_will_do(size: int, topology: str, most: int, count: int) -> None:
    assert piconets_needed(size, topology, most) == count  # type: ignore[arg-type]
