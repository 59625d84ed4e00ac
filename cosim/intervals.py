"""What radios and hosts are doing, as rows of the table ``intervals``: inquiry, back-off, a link, a crash.

A model that knows an interval only when it is over adds the whole row; one that knows its beginning opens it, so that
who watches a run under way sees it too. Rows come in the order in which intervals end, or later: a model that skips
ahead tells of what was in between when it comes to it. Nothing is kept, and nothing costs, unless the trace wants it.
"""

import re
from array import array
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, Final, NamedTuple

from cosim.machine import Address, Role
from cosim.trace import INTERVALS, Trace
from cosim.units import Time

HOST: Final = -1
"""The radio of an interval that is about the robot itself."""
JAMMER: Final[Address] = -1
"""The robot of an interval that is about none: about a jammer, or a wall of loss."""

STATES: Final[dict[str, str]] = {
    # of radios, over any channel
    "link": "over a channel that only plays links: it has one to the robot peer, in this role",
    "deferred": "a shared air with arbitration: it has asked for the air, and another radio of the robot, radio=, "
    "has it until the end",
    "off": "the radio is switched off",
    # of radios, Bluetooth
    "afh": "Bluetooth: the hop set of the piconet of this master leaves out channels=, given as ranges of RF channels",
    "away": "Bluetooth: belongs to the piconet of master=, itself perhaps, and is not in it: in another one, or busy "
    "with an inquiry or a page",
    "hold": "Bluetooth: a link is on hold; slave= at its master, master= at its slave",
    "inquiry": "Bluetooth: sends the IDs of one train of an inquiry, and listens in between; train= is A or B, and "
    "word=, phase_ns=, ppm= and estimate= are what their instants and channels follow from",
    "inquiry_backoff": "Bluetooth: listens to no inquiry for a random time, between an ID and an answer or after that",
    "inquiry_response": "Bluetooth: has heard the ID of an inquiry, and answers, or waits for another to answer",
    "inquiry_scan": "Bluetooth: listens to inquiries, a window a row; window= is 1 or 2 if it is interlaced",
    "master": "Bluetooth: has a link to slave=, whose logical transport address is lt_addr=",
    "page": "Bluetooth: sends the IDs of one train of a page to peer=, and listens in between; the rest as of inquiry",
    "page_response": "Bluetooth: has been answered by peer= (role=master), or heard its page (role=slave), and makes a "
    "link to it",
    "page_scan": "Bluetooth: listens to pages, a window a row; window= is 1 or 2 if it is interlaced",
    "park": "Bluetooth: a slave is parked; slave= at its master, master= at its slave",
    "part_time": "Bluetooth: is in the piconet of master=, itself perhaps, only for attempt_slots= from offset_slots= "
    "in every interval_slots=, on a clock that shows phase_ns= at time 0 and drifts by ppm=",
    "slave": "Bluetooth: has a link to its master=, as lt_addr=",
    "sniff": "Bluetooth: a link is in sniff mode, for attempt_slots= from offset_slots= in every interval_slots= on "
    "the master's clock; slave= at its master, master= at its slave",
    # of radios, Bluetooth Low Energy
    "central": "Bluetooth Low Energy: has a link to peer=, whose events it begins",
    "initiating": "Bluetooth Low Energy: listens for the advertising of peer=, to ask it for a link",
    "peripheral": "Bluetooth Low Energy: has a link to peer=, which begins its events",
    "scanning": "Bluetooth Low Energy: listens for the advertising of others, to find them",
    # of radios, 802.11
    "awaits_ack": "802.11: a frame has been sent, its acknowledgement is to come",
    "awaits_cts": "802.11: an RTS has been sent, the answer that allows the frame is to come",
    "backoff": "802.11: a back-off counts down: slots are left at the beginning, of those drawn from 0 to cw",
    "difs": "802.11: the medium is idle, and a frame or back-off waits for the interframe space to pass",
    "eifs": "802.11: the same after a frame that could not be read, when the space is longer (EIFS)",
    "route": "a router has a route to a robot: over which neighbour as next hop, and how many hops it takes",
    # of radios, optical
    "occluded": "a payload of the robot peer is on the air for it, and there is no line of sight",
    # of robots, radio -1
    "camera_off": "a fault keeps its camera off",
    "clock_stepped": "its clock is not the true time, but by_ns ahead of it",
    "crashed": "a fault has stopped its host, which boots again at the end",
    "frozen": "a fault keeps it from moving",
    "killed": "a fault has killed it; the end is that of the run",
    # of no robot, robot -1 and radio -1
    "jammer": "the jammer that is the scenario's fault number fault, from 0, is on the air for the nth time, from 0; "
    "channels as ranges of RF channels; radio names the radios that it is meant for, unless it is for all",
    "wall": "the wall of loss that is the scenario's fault number fault stands for the nth time; radio as for jammers",
}
"""All states, with their meanings, by what they are of."""


class LinkState(NamedTuple):
    """What a state says of the link that a robot has while it is in it."""

    role: Role | None
    """What the robot is in its link; None where the detail tells, as role=."""
    other: str
    """The word of the detail that names the robot at the other end."""


LINKED: Final[Mapping[str, LinkState]] = {
    "link": LinkState(None, "peer"),
    "master": LinkState(Role.MASTER, "slave"),
    "slave": LinkState(Role.SLAVE, "master"),
    "central": LinkState(Role.MASTER, "peer"),
    "peripheral": LinkState(Role.SLAVE, "peer"),
    "peer": LinkState(Role.PEER, "peer"),  # of no row: what follows from news of links of equals
}
"""The states of robots that have a link, over whatever channel."""
MEMBER: Final[Mapping[str, str]] = {
    **dict.fromkeys(("slave", "hold", "sniff", "park", "away", "part_time"), "master"),
    "peripheral": "peer",
}
"""The states of members of piconets, each with the word of the detail that names the master (or central)."""
_PARTNERS: Final[Mapping[str, str]] = {state: linked.other for state, linked in LINKED.items()}


class Link(NamedTuple):
    """An end of a link."""

    role: str
    """What the robot is in it: master, slave or peer."""
    other: Address
    """The robot at the other end; -1 if that is not told."""


def link_of(state: str, detail: str) -> Link | None:
    """Return the end of a link that an interval in that *state* is; None if it is none."""
    linked = LINKED.get(state)
    if linked is None:
        return None
    role = linked.role.value if linked.role else said(detail, "role")
    return Link(role, robot_said(detail, linked.other))


def partner(state: str, detail: str) -> Address:
    """Return the robot at the other end of the link that an interval in that *state* is; -1 if it is none."""
    return robot_said(detail, _PARTNERS[state]) if state in _PARTNERS else -1


def master_of(state: str, detail: str) -> Address:
    """Return the master of the piconet to whose member an interval in that *state* belongs; -1 if it is none."""
    return robot_said(detail, MEMBER[state]) if state in MEMBER else -1


def said(detail: str, name: str) -> str:
    """Return what *detail* says of *name*, as name=value; nothing if it does not."""
    found = _word(name).search(detail)
    return found[1] if found else ""


def robot_said(detail: str, name: str) -> Address:
    """Return the robot that *detail* names as *name*; -1 if there is none."""
    value = said(detail, name)
    return int(value) if value.isdecimal() else -1


@cache
def _word(name: str) -> re.Pattern[str]:
    return re.compile(rf"(?<!\S){name}=(\S*)")


class Interval(NamedTuple):
    """A row of the table."""

    start: Time
    robot: Address
    end: Time
    radio: int
    state: str
    detail: str


class Intervals:
    """The intervals of one channel's radios, or of the robots themselves (*radio* HOST)."""

    def __init__(self, trace: Trace, radio: int = 0) -> None:
        self.wanted = trace.wants(INTERVALS)
        """True if rows are kept: nobody need find out what nobody wants."""
        self._trace = trace
        self._radio = radio
        self._open: dict[tuple[Address, str, str], Time] = {}

    def add(self, robot: Address, start: Time, end: Time, state: str, detail: str = "") -> None:
        """Add an interval that is known whole; one without length is none."""
        if self.wanted and end > start:
            self._trace.row(INTERVALS, start, robot, end, self._radio, state, detail)

    def add_many(self, starts: Any, robots: Any, ends: Any, states: Sequence[str], details: Sequence[str]) -> None:
        """Add intervals with a length, by column; times and robots are arrays of 64-bit integers."""
        if self.wanted:
            radios = array("q", (self._radio,)) * len(states)
            self._trace.rows(INTERVALS, starts, robots, ends, radios, states, details)

    def begin(self, robot: Address, state: str, now: Time, detail: str = "") -> None:
        """Open an interval, unless *robot* is in that *state* with that *detail*."""
        if self.wanted:
            self._open.setdefault((robot, state, detail), now)

    def end(self, robot: Address, state: str, now: Time, detail: str = "") -> None:
        """Close the interval that ``begin`` has opened with the same words, if there is one."""
        start = self._open.pop((robot, state, detail), None)
        if start is not None:
            self.add(robot, start, now, state, detail)

    def end_all(self, robot: Address, now: Time) -> None:
        """Close all intervals of *robot*."""
        for of, state, detail in list(self._open):
            if of == robot:
                self.end(of, state, now, detail)

    def under_way(self, now: Time) -> list[Interval]:
        """Return the intervals that are open *now*."""
        return [
            Interval(start, robot, now, self._radio, state, detail)
            for (robot, state, detail), start in self._open.items()
        ]

    def close(self, now: Time) -> None:
        """Close all intervals: the run is over."""
        for robot, state, detail in list(self._open):
            self.end(robot, state, now, detail)
