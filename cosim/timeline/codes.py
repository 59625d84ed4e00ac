"""The kinds and outcomes of boxes, by small numbers: what pages, exports and pictures call them."""

from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

from cosim.channels.background import called
from cosim.intervals import LINKED, STATES
from cosim.machine import Role
from cosim.timeline.sections import WHOLE, Section
from cosim.units import Time

FRAME: Final = "frame"
STATE: Final = "state"
MESSAGE: Final = "message"
WAKE: Final = "wake"
EVENT: Final = "event"
NO_KIND: Final = 0xFFFF
"""The code of a cell in which there is nothing."""
PACKETS: Final[dict[str, str]] = {
    "ID": "access code alone: an inquiry, a page, or the answer to one",
    "FHS": "a device's address and clock",
    "POLL": "the master has nothing to say, and wants an answer",
    "NULL": "nothing to say but whether the last packet came",
    "DM1": "data with forward error correction, 1 slot",
    "DM3": "data with forward error correction, 3 slots",
    "DM5": "data with forward error correction, 5 slots",
    "DH1": "data, 1 slot",
    "DH3": "data, 3 slots",
    "DH5": "data, 5 slots",
    "AUX1": "data without a check sum, 1 slot",
    "HV1": "voice, a third of it data",
    "HV2": "voice, two thirds of it data",
    "HV3": "voice",
    "DV": "voice and data",
    "DATA": "802.11: a payload; Bluetooth Low Energy: a part of one",
    "RTS": "802.11: request to send",
    "CTS": "802.11: clear to send",
    "ACK": "802.11: the last frame has come",
    "ADV_IND": "Bluetooth Low Energy: says who is there, and can be connected",
    "ADV_NONCONN_IND": "Bluetooth Low Energy: a payload for everyone, or a part of one",
    "ADV_EXT_IND": "Bluetooth Low Energy: says where a payload for everyone is",
    "AUX_ADV_IND": "Bluetooth Low Energy: a payload for everyone, or its beginning",
    "AUX_CHAIN_IND": "Bluetooth Low Energy: more of a payload for everyone",
    "SCAN_REQ": "Bluetooth Low Energy: asks for the name of who advertises",
    "SCAN_RSP": "Bluetooth Low Energy: says that name",
    "CONNECT_IND": "Bluetooth Low Energy: makes a link",
    "CONTROL": "Bluetooth Low Energy: the link layers agree on something",
    "EMPTY": "Bluetooth Low Energy: a poll, or an answer, with nothing to say",
    "IDEAL": "a payload of the ideal channel",
    "OPTICAL": "a payload of the optical channel",
}
"""Packet types, with their meanings."""
BUSY: Final = "busy"
NAV: Final = "NAV"
CARRIER_SENSE: Final[dict[str, str]] = {
    BUSY: "802.11: the station sends or hears something, and must wait",
    NAV: "802.11: a frame for another station has reserved the medium, by the network allocation vector",
}
"""States of 802.11 stations that follow from their frames, with their meanings."""
_GROUPS: Final = {
    FRAME: PACKETS,
    STATE: STATES | CARRIER_SENSE,
    MESSAGE: {MESSAGE: "a payload has arrived at a machine"},
    WAKE: {WAKE: "a deadline that a machine has set itself has come"},
    EVENT: dict[str, str](),
}
CHANNEL: Final = "channel"
PICONET: Final = "piconet"
RECEIVED: Final = "received"
CUT: Final = "cut"
"""The outcome of a transmission whose sender fell silent before its end."""
NOWHERE: Final = -1
"""The RF channel of lanes that are about none."""


class Outcome(NamedTuple):
    """What became of a frame."""

    name: str
    part: str
    """The part of it that failed first,"""
    begin: Time
    """and from when"""
    end: Time | None
    """to when that lasts, ns after its start; None: to its end."""


class Codes:
    """Names by number, in the order in which they were first met."""

    def __init__(self, kinds: Iterable[Sequence[str]] = (), outcomes: Iterable[Sequence[Any]] = ()) -> None:
        self._kinds: dict[tuple[str, str], int] = {}
        self._outcomes: dict[Outcome, int] = {}
        for group, name in kinds:
            self.kind(group, name)
        for outcome in outcomes or [("", "", *WHOLE)]:
            self._code(Outcome(*outcome))

    def kind(self, group: str, name: str) -> int:
        """Return the code of the kind *name* of *group*."""
        return self._kinds.setdefault((group, name), min(len(self._kinds), NO_KIND - 1))

    def outcome(self, name: str, part: str = "", section: Section = WHOLE) -> int:
        """Return the code of the outcome *name* of a frame whose *part*, which is that *section*, failed first."""
        return self._code(Outcome(name, part, *section))

    def _code(self, outcome: Outcome) -> int:
        return self._outcomes.setdefault(outcome, min(len(self._outcomes), 0xFF))

    def code_of(self, group: str, name: str) -> int | None:
        """Return the code of the kind *name* of *group*; None if there was none of it."""
        return self._kinds.get((group, name))

    @property
    def slaves(self) -> list[int]:
        """The codes of the states of robots that are the slave of a link, or its peripheral."""
        return [code for code, kind in enumerate(self._kinds) if _role_of(*kind) == Role.SLAVE.value]

    @property
    def kinds(self) -> list[tuple[str, str]]:
        """Groups and names, by code."""
        return list(self._kinds)

    @property
    def outcomes(self) -> list[Outcome]:
        """All outcomes, by code."""
        return list(self._outcomes)

    @property
    def lost(self) -> list[bool]:
        """Whether a frame of that outcome is lost, by code."""
        return [is_lost(outcome.name) for outcome in self._outcomes]

    @property
    def plain(self) -> dict[str, Any]:
        """Both tables as plain data."""
        kinds = [
            {"code": code, "name": name, "group": group, "meaning": _GROUPS[group].get(name, "")}
            | {"role": _role_of(group, name)}
            for code, (group, name) in enumerate(self._kinds)
        ]
        outcomes = [
            {"code": code, "name": name, "part": part, "lost": is_lost(name), "lost_ns": [begin, end]}
            for code, (name, part, begin, end) in enumerate(self._outcomes)
        ]
        return {"kinds": kinds, "outcomes": outcomes}


def _role_of(group: str, name: str) -> str:
    """Return what a robot is in the link that it has while in the state *name*; nothing if that tells of none."""
    linked = LINKED.get(name) if group == STATE else None
    return linked.role.value if linked and linked.role else ""


def is_lost(outcome: str) -> bool:
    """Return whether a frame with that *outcome* did not do what it was sent for."""
    return outcome not in ("", RECEIVED)


class Named(NamedTuple):
    """Of what a lane is, and where it stands."""

    robot: int
    """Its address, if it is a station in the background; -1 for jammers and walls of loss, and where it is about an RF
    channel."""
    radio: int
    """-1 for the robot itself."""
    what: str
    """states, busy, NAV, sent, received, broadcasts, messages, wakes, events, piconet or channel"""
    row: int = 0
    """Which of several of one kind, whose boxes would overlap in one; of a piconet, whose master is the robot: the
    member that it is about."""
    several: bool = False
    """Whether robots have several radios."""
    channel: int = NOWHERE
    """RF channel k, 2402 + k MHz, of whose frames it is."""

    def called(self, robots: int) -> str:
        """Return what people call it where there are so many *robots*, and after them stations, of one radio each."""
        if self.channel != NOWHERE:
            return f"channel {self.channel}" + (f", radio {self.radio}" if self.several else "")
        if self.what == PICONET:
            radio = f", radio {self.radio}" if self.several else ""
            return f"piconet of {called(self.robot, robots)}{radio}: {called(self.row, robots)}"
        if self.robot < 0:
            return "jammers and walls" + (f" {self.row + 1}" if self.row else "")
        who = called(self.robot, robots)
        radio = f", radio {self.radio}" if self.several and self.radio >= 0 and self.robot < robots else ""
        what = "host" if self.radio < 0 and self.what == "states" else self.what
        return f"{who}{radio}: {what}" + (f" {self.row + 1}" if self.row else "")

    @property
    def place(self) -> tuple[int, bool, bool, int, int, int, int]:
        """Its place from top to bottom: robots in order, hosts first, then jammers, piconets and channels."""
        of_robot = self.robot, self.radio, ORDER.index(self.what), self.row
        return self.channel, self.what == PICONET, self.robot < 0, *of_robot


ORDER: Final = ("states", BUSY, NAV, "sent", "received", "broadcasts", "messages", "wakes", "events", PICONET, CHANNEL)
"""What lanes there are, from top to bottom."""
