"""The topologies of scatternets: masters, slaves and bridges, for a coordinator that knows all robots.

After BTCP (Salonidis, Bhagwat, Tassiulas, LaMaire, "Distributed topology construction of Bluetooth personal area
networks", IEEE INFOCOM 2001): a coordinator that knows all nodes assigns the roles. BTCP joins every pair of piconets
by a bridge of its own; with piconets of eight that leaves little room for others, so three sparser shapes are offered:

- ``ring``: at least three piconets, in each of which the master of the one before is a slave, so that each master is a
  slave in one other piconet, as paper 003 (section VI) requires;
- ``tree``: each master but the root's is a slave in the piconet of its parent;
- ``bridged``: a chain of piconets, two neighbours of which share a slave.

A device is in one piconet at a time. Piconets are coloured so that two which share a device differ; each has its part
of a period, in which all its members are present: so a broadcast reaches them all. Trees, chains and even rings need
two colours, odd rings three.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal, TypeAlias

from cosim.machine import Address

Topology: TypeAlias = Literal["ring", "tree", "bridged"]
MOST_MASTERS: Final = 8
"""Largest number of piconets: the other masters are the coordinator's slaves while it informs them, seven at most."""

MOST_DEVICES: Final = 8
"""Largest size of one of several piconets: a robot has its place in it in three bits of its name."""


@dataclass(frozen=True, slots=True)
class Piconet:
    """A master and its slaves, bridges included."""

    master: Address
    slaves: tuple[Address, ...]


@dataclass(frozen=True)
class Directory:
    """The piconets of a team, by number; gives each robot its name, 8 x number of its piconet + place in it.

    Place 0 is the master's. A robot in several piconets has its name from its own, or from that of the lowest number.
    """

    piconets: tuple[Piconet | None, ...]
    """Piconets by number; None where one is missing."""

    @cached_property
    def names(self) -> dict[Address, int]:
        """Name of each robot."""
        names: dict[Address, int] = {}
        for number, piconet in enumerate(self.piconets):
            for place, slave in enumerate(piconet.slaves if piconet else (), 1):
                names.setdefault(slave, 8 * number + place)
        return names | {piconet.master: 8 * number for number, piconet in enumerate(self.piconets) if piconet}

    @cached_property
    def robots(self) -> dict[int, Address]:
        """Robot of each name."""
        return {name: robot for robot, name in self.names.items()}

    @cached_property
    def members(self) -> tuple[Address, ...]:
        """All robots, in increasing order."""
        return tuple(sorted(self.names))

    def is_plain(self, robot: Address) -> bool:
        """Return whether *robot* is a slave in one piconet only, so that no other robot depends on it."""
        piconets = [piconet for piconet in self.piconets if piconet]
        slave_in = sum(robot in piconet.slaves for piconet in piconets)
        return slave_in == 1 and all(piconet.master != robot for piconet in piconets)

    def without(self, gone: Sequence[Address]) -> "Directory":
        """Return the directory without plain slaves that are *gone*."""
        return Directory(
            tuple(
                piconet and Piconet(piconet.master, tuple(slave for slave in piconet.slaves if slave not in gone))
                for piconet in self.piconets
            )
        )


def piconets_needed(size: int, topology: Topology, most: int) -> int:
    """Return the number of piconets of at most *most* devices that a team of *size* needs."""
    if size <= most:
        return 1
    if topology == "ring":
        return max(3, -(-size // (most - 1)))
    # of the p (most - 1) places of slaves, p - 1 are taken by masters, or by bridges that have another one
    return -(-(size - 1) // (most - 1))


def parent(number: int, most: int) -> int:
    """Return the number of the piconet of a tree in which the master of piconet *number* > 0 is a slave."""
    return (number - 1) // (most - 1)


def colours(topology: Topology, count: int) -> int:
    """Return the number of colours that *count* piconets need."""
    if count == 1:
        return 1
    return 3 if topology == "ring" and count % 2 else 2


def colour(topology: Topology, number: int, count: int, most: int) -> int:
    """Return the colour of piconet *number* of *count*."""
    if topology == "ring":
        return 2 if count % 2 and number == count - 1 else number % 2
    if topology == "bridged":
        return number % 2
    depth = 0
    while number:
        number, depth = parent(number, most), depth + 1
    return depth % 2


def design(masters: Sequence[Address], others: Sequence[Address], topology: Topology, most: int) -> list[Piconet]:
    """Return the piconets of *masters*, the root's first, with *others* as slaves; robots without a place are left out.

    Masters and bridges come last among the slaves: they are the busiest while a scatternet is formed. With fewer than
    three masters a ring is a tree.
    """
    count = len(masters)
    shared: list[list[Address]] = [[] for _ in masters]
    plain = list(others)
    ring = topology == "ring" and count >= 3
    if topology == "bridged":
        for number in range(count - 1):
            if plain:
                bridge = plain.pop(0)
                shared[number].append(bridge)
                shared[number + 1].append(bridge)
    else:
        for number in range(1, count):
            shared[number if ring else parent(number, most)].append(masters[number - 1 if ring else number])
        if ring:
            shared[0].append(masters[-1])
    own: list[list[Address]] = [[] for _ in masters]
    for robot in plain:
        sizes = [len(own[number]) + len(shared[number]) for number in range(count)]
        number = min(range(count), key=lambda number: (sizes[number], number))
        if sizes[number] < most - 1:
            own[number].append(robot)
    return [Piconet(masters[number], tuple(own[number] + shared[number])) for number in range(count)]
