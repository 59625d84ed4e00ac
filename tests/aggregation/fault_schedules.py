"""Random searches in which hosts crash or are cut off, and a judge of them who looks from outside.

A schedule is a small search and 1 to 6 faults, the first of which kills or crashes a host, or cuts one off from the
others. After its last fault, or that one's end, it goes on for ``AFTER_S``. There is always a target that no camera can
see, unless a schedule is *open*: so no search ends before its time.

The judge knows where robots are, whose radios reach whom, whose process runs, what has arrived at hosts byte by byte,
and what machines hold (lists of members, findings). It asks no machine for a verdict.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from cosim.scenario import Scenario
from cosim.randomness import Streams
from cosim.simulation import Simulation
from cosim.trace import MESSAGES
from cosim.units import MS, S, Time, from_seconds, to_seconds
from protocols.aggregation.frames import decode
from protocols.aggregation.messages import Report

Plain = dict[str, Any]
Point = tuple[float, float]
USE = "protocols.aggregation.spec:SPEC"
SEED = 5
STRATEGIES = ("srp", "mrp", "mi", "mito", "random")
HIDDEN_M: Point = (-500.0, -500.0)
"""Where no camera sees a target."""
FLOORS = 12
CLEAR_M = 1.0
"""Robots are put so far from walls."""
AFTER_S = 42.0
JUDGED_S = 30.0
"""So long after the last fault everybody is to be in a sub-team."""
STEP: Time = 500 * MS
"""From one look of the judge to the next."""
SETTLED_S = 5.0
"""A membership that is younger is being told about: such a searcher is judged when it is so old."""
REACH_S = 4.0
"""Who has been in reach of a host for so long has heard of it: some heartbeats, few of which are lost."""
TOLD_S = 10.0
"""Hosts that have been in reach of each other for so long know of each other what they need."""


class Schedule(NamedTuple):
    """A search and its faults."""

    number: int
    scenario: Scenario
    quiet_s: float
    """When the last fault has happened, or is over."""


# ---------------------------------------------------------------- what is drawn


class Dice:
    """Draws of one schedule."""

    def __init__(self, stream: np.random.Generator) -> None:
        self._stream = stream

    def between(self, low: float, high: float) -> float:
        return round(float(self._stream.uniform(low, high)), 2)

    def whole(self, low: int, high: int) -> int:
        """Return an integer in [low, high]."""
        return int(self._stream.integers(low, high + 1))

    def one(self, *items: Any) -> Any:
        return items[int(self._stream.integers(len(items)))]

    def chance(self, share: float) -> bool:
        return bool(self._stream.random() < share)


@cache
def floor(number: int) -> Plain:
    """Draw a floor of 30 m to 60 m a side: two or three walls across it, each with two doors of 4 m."""
    dice = Dice(Streams(SEED)("floor", number))
    width, height = float(dice.whole(30, 60)), float(dice.whole(30, 60))
    walls: list[list[float]] = []
    for share in (0.3, 0.7) if dice.chance(0.5) else (0.4,):
        walls += _wall(dice, round(share * width, 1), height, upright=True)
    if dice.chance(0.7):
        walls += _wall(dice, round(dice.between(0.3, 0.7) * height, 1), width, upright=False)
    return {"map": "walls", "bounds_m": [0.0, 0.0, width, height], "walls": walls}


def _wall(dice: Dice, at_m: float, length_m: float, upright: bool) -> list[list[float]]:
    """Return the pieces of a wall with a door in each half."""
    doors = dice.between(2.0, length_m / 2 - 6.0), dice.between(length_m / 2 + 2.0, length_m - 6.0)
    ends = [0.0, doors[0], doors[0] + 4.0, doors[1], doors[1] + 4.0, length_m]
    pieces = zip(ends[::2], ends[1::2], strict=True)
    return [[at_m, low, at_m, high] if upright else [low, at_m, high, at_m] for low, high in pieces]


def schedule(number: int, open_: bool = False) -> Schedule:
    """Draw the schedule of this number; *open_*: all targets can be found, so that the search can end."""
    dice = Dice(Streams(SEED)("schedule", number))
    drawn = floor(dice.whole(0, FLOORS - 1))
    hosts, searchers = dice.whole(2, 4), dice.whole(2, 6)
    reach_m = dice.between(8.0, 18.0), dice.one(dice.between(25.0, 40.0), 100.0)
    kind = dice.one("adhoc", "adhoc", "adhoc", "ideal", "fading")
    faults = _faults(dice, hosts, searchers, drawn, kind == "fading")
    quiet_s = max(map(_over_s, faults))
    targets = [_anywhere(dice, drawn) for _ in range(dice.whole(1, 5))]
    plain = {
        "name": f"schedule {number}",
        "duration_s": quiet_s + AFTER_S,
        "tick_s": dice.one(0.1, 0.2),
        "floorplan": drawn,
        "team": {"groups": _groups(dice, hosts, searchers)},
        "channel": {"kind": "radios", "radios": [_radio(kind, each_m, dice) for each_m in reach_m]},
        "faults": faults,
        "protocol": {
            "use": USE,
            "parameters": {
                "strategy": dice.one(*STRATEGIES),
                "hosts": hosts,
                "targets": targets if open_ else [*targets, HIDDEN_M],
                **_parameters(dice, reach_m),
            },
        },
    }
    return Schedule(number, Scenario.model_validate(plain), quiet_s)


def _groups(dice: Dice, hosts: int, searchers: int) -> list[Plain]:
    body = {"radius_m": 0.2, "acceleration_mps2": 2.0}
    return [
        {"size": hosts, "body": {**body, "speed_mps": dice.between(0.5, 2.0)}, "radios": [0, 1]},
        {"size": searchers, "body": {**body, "speed_mps": dice.between(1.0, 3.0)}, "radios": [0]},
    ]


def _radio(kind: str, reach_m: float, dice: Dice) -> Plain:
    """Return a channel of about this reach: exactly so far, or where a frame is just strong enough to be followed."""
    if kind == "ideal":
        return {"kind": "ideal", "range_m": reach_m, "loss": dice.one(0.0, 0.05)}
    if kind == "adhoc":
        return {"kind": "adhoc", "range_m": reach_m, "host_jitter_s": dice.one(0.0, 0.002)}
    fading = {"model": "log_distance", "exponent": 3.0, "walls": False}
    power_dbm = -82.0 + 40.2 + 30.0 * math.log10(reach_m)
    return {"kind": "adhoc", "propagation": fading, "power_dbm": power_dbm, "host_jitter_s": 0.002}


def _parameters(dice: Dice, reach_m: Point) -> Plain:
    return {
        "camera_m": dice.between(5.0, 8.0),
        "vision_m": dice.one(0.0, 20.0),
        "short_m": reach_m[0],
        "long_m": reach_m[1],
        "host_speed_mps": 1.0,
        "reconvene_s": dice.between(15.0, 40.0),
        "sync_s": dice.between(10.0, 40.0),
        "timeout_s_per_m2": dice.between(0.01, 0.05),
        "report": dice.one("first", "area"),
        "suspect_s": dice.between(4.0, 10.0),
        "strays": dice.one((), (), (0,)),
        "detector": dice.one({"kind": "fixed", "timeout_s": 5.0}, {"kind": "nfd_e"}, {"kind": "phi_akka"}),
    }


def _anywhere(dice: Dice, drawn: Plain) -> Point:
    """Return a place on free floor."""
    width, height = drawn["bounds_m"][2:]
    while True:
        x_m, y_m = dice.between(CLEAR_M, width - CLEAR_M), dice.between(CLEAR_M, height - CLEAR_M)
        if not any(a - CLEAR_M < x_m < c + CLEAR_M and b - CLEAR_M < y_m < d + CLEAR_M for a, b, c, d in drawn["walls"]):
            return x_m, y_m


# ---------------------------------------------------------------- faults


def _faults(dice: Dice, hosts: int, searchers: int, drawn: Plain, fading: bool) -> list[Plain]:
    """Draw faults, the first of which takes a host away or cuts it off; at least one host is never killed."""
    kinds = ["kill", "crash", "radio_off", "moved", *(["wall"] if fading else [])]
    faults = [_grave(dice, dice.one(*kinds), hosts, drawn)]
    kinds = ["kill", "crash", "radio_off", "camera_off", "frozen", "moved", "clock_step", "battery"]
    kinds += ["wall", "jammer"] if fading else []
    for _ in range(dice.whole(0, 5)):
        robot = dice.whole(0, hosts + searchers - 1)
        fault = _fault(dice, dice.one(*kinds), robot, hosts, drawn)
        if _possible(fault, faults):
            faults.append(fault)
    return faults


def _possible(fault: Plain, faults: list[Plain]) -> bool:
    """Return whether host 0 survives, nobody dies twice, and batteries run down steadily, up to a known time."""
    robot, deadly = fault.get("robot"), ("kill", "battery")
    if fault["kind"] in deadly and robot == 0:
        return False
    others = [each["kind"] for each in faults if each.get("robot") == robot and robot is not None]
    if fault["kind"] == "battery" and any(kind in (*deadly, "crash", "radio_off") for kind in others):
        return False
    return not (any(kind in deadly for kind in others) and fault["kind"] in (*deadly, "crash", "radio_off"))


def _grave(dice: Dice, kind: str, hosts: int, drawn: Plain) -> Plain:
    """Return a crash, a death or a partition of a host."""
    host, at_s = dice.whole(1, hosts - 1), dice.between(5.0, 60.0)
    width, height = drawn["bounds_m"][2:]
    match kind:
        case "radio_off":
            fault = {"kind": kind, "robot": host, "at_s": at_s, "radio": dice.one(None, 1, 1)}
            return fault if dice.chance(0.2) else {**fault, "for_s": dice.between(8.0, 60.0)}
        case "moved":
            corner = dice.one(2.0, width - 2.0), dice.one(2.0, height - 2.0)
            return {"kind": kind, "robot": host, "at_s": at_s, "to_m": corner}
        case "wall":
            x_m = dice.between(0.2, 0.8) * width
            line = {"from_m": (x_m, -1.0), "to_m": (x_m, height + 1.0)}
            return {"kind": kind, **line, "loss_db": 60.0, "at_s": at_s, "for_s": dice.between(8.0, 60.0)}
    return _fault(dice, kind, host, hosts, drawn)


def _fault(dice: Dice, kind: str, robot: int, hosts: int, drawn: Plain) -> Plain:
    """Return a fault of this kind."""
    at_s = dice.between(2.0, 80.0)
    once: Plain = {"kind": kind, "robot": robot, "at_s": at_s}
    lasting = {**once, "for_s": dice.between(1.0, 40.0)}
    match kind:
        case "kill":
            return once
        case "radio_off":
            radio = dice.one(None, *((0, 1) if robot < hosts else ()))
            return {**(once if dice.chance(0.1) else lasting), "radio": radio}
        case "camera_off" | "frozen":
            return once if dice.chance(0.2) else lasting
        case "moved":
            return once if dice.chance(0.5) else {**once, "to_m": _anywhere(dice, drawn)}
        case "clock_step":
            return {**once, "by_s": dice.one(-1, 1) * dice.between(0.01, 2.0)}
        case "battery":
            return {"kind": kind, "robot": robot, "capacity_j": 2.0 * at_s, "idle_w": 2.0}
        case "wall":
            ends = {"from_m": _anywhere(dice, drawn), "to_m": _anywhere(dice, drawn)}
            return {"kind": kind, **ends, "loss_db": 60.0, "at_s": at_s, "for_s": dice.between(1.0, 40.0)}
        case "jammer":
            x_m, y_m = _anywhere(dice, drawn)
            noise = {"x_m": x_m, "y_m": y_m, "power_dbm": 0.0, "mode": dice.one("constant", "sweeping", "pulsed")}
            return {"kind": kind, **noise, "at_s": at_s, "for_s": dice.between(1.0, 20.0)}
    return lasting


def _over_s(fault: Plain) -> float:
    """Return when a fault has happened, or is over."""
    if fault["kind"] == "battery":
        return float(fault["capacity_j"] / fault["idle_w"])
    return float(fault["at_s"] + fault.get("for_s", 0.0))


# ---------------------------------------------------------------- what is seen


class Look(NamedTuple):
    """What the judge sees at one instant."""

    at_s: float
    up: frozenset[int]
    """Robots whose process runs."""
    heard: tuple[tuple[frozenset[int], ...], ...]
    """By radio and robot: who would hear it."""
    claims: dict[int, tuple[int | None, int]]
    """Searcher -> the host that it names, and the epoch."""
    lists: dict[int, dict[int, int]]
    """Host -> its members and their epochs."""
    found: dict[int, frozenset[int]]
    """Host -> the targets that it knows."""

    def mutual(self, radio: int, one: int, other: int) -> bool:
        """Return whether two robots can hear each other."""
        return other in self.heard[radio][one] and one in self.heard[radio][other]


class Watched:
    """A schedule that has been run, and what was seen at its end."""

    def __init__(self, what: Schedule) -> None:
        self.schedule = what
        self.simulation = Simulation(what.scenario, what.number, (MESSAGES,))
        self.looks: list[Look] = []
        self.hosts: int = what.scenario.protocol.parameters.hosts  # type: ignore[attr-defined]
        self.size = what.scenario.team.size
        self._run()

    def _run(self) -> None:
        kernel, end = self.simulation.kernel, self.schedule.scenario.duration
        self.simulation.begin()
        at = from_seconds(self.schedule.quiet_s + JUDGED_S - TOLD_S)
        while at < end:
            kernel.run(at)
            if kernel.now < at:  # all have stopped
                break
            self.looks.append(self._look())
            at += STEP
        else:
            kernel.run(end)
        self.ended_s = to_seconds(kernel.now)
        self.whole = kernel.now == end
        """Whether the search has not ended before its time."""

    def _look(self) -> Look:
        simulation, robots = self.simulation, range(self.size)
        machines: list[Any] = list(simulation.machines)
        hosts, searchers = range(self.hosts), range(self.hosts, self.size)
        return Look(
            to_seconds(simulation.kernel.now),
            frozenset(robot for robot in robots if simulation.nodes[robot].alive),
            tuple(tuple(frozenset(part.in_reach(robot)) for robot in robots) for part in simulation.channel.parts),
            {each: (machines[each].membership.host, machines[each].membership.epoch) for each in searchers},
            {host: {each: m.epoch for each, m in machines[host].team.roll.members.items()} for host in hosts},
            {host: frozenset(machines[host].findings.targets) for host in hosts},
        )

    def found_now(self, host: int) -> set[int]:
        """Return the targets that a host knows in the end."""
        machine: Any = self.simulation.machines[host]
        return set(machine.findings.targets)

    @property
    def survivors(self) -> list[int]:
        """The hosts that have never been down."""
        columns = self.simulation.trace.columns("events")
        down = {
            source
            for source, event in zip(columns["source"], columns["event"], strict=True)
            if event in ("Killed", "Crashed")
        }
        return [host for host in range(self.hosts) if host not in down]

    def reported(self) -> list[tuple[int, int]]:
        """Return the (host, target) of all reports that have arrived at a host, byte by byte."""
        columns = self.simulation.trace.columns("messages")
        pairs: set[tuple[int, int]] = set()
        for receiver, payload in zip(columns["source"], columns["payload"], strict=True):
            if receiver < self.hosts:
                message = decode(bytes.fromhex(payload))[1]
                if isinstance(message, Report):
                    pairs |= {(receiver, finding.number) for finding in message.targets}
        return sorted(pairs)


# ---------------------------------------------------------------- the verdict


def lost_reports(run: Watched) -> list[str]:
    """Return where a report was lost.

    A target in a report that arrived at a host which never went down must be among that host's findings in the end. What
    such a host knew ``TOLD_S`` before the end, all hosts must know that could exchange frames with it all that time.
    """
    survivors = run.survivors
    wrong = [
        f"target {target} was reported to host {host}, which does not know it"
        for host, target in run.reported()
        if host in survivors and target not in run.found_now(host)
    ]
    last = [look for look in run.looks if look.at_s >= run.ended_s - TOLD_S]
    if not (run.whole and last):
        return wrong
    for host in survivors:
        for other in range(run.hosts):
            together = all(other in look.up and host != other and look.mutual(1, host, other) for look in last)
            missing = last[0].found[host] - run.found_now(other)
            if together and missing:
                wrong.append(f"host {other} has not been told of {sorted(missing)} by host {host}")
    return wrong


def outsiders(run: Watched) -> list[str]:
    """Return who is not in exactly one sub-team, 30 s after the last fault.

    Who is asked: each searcher whose process runs and that could exchange frames, all through the last ``REACH_S``,
    with one and the same host whose process ran. It is in exactly one sub-team if it names a host whose process runs,
    that host has it in its list with the epoch that the searcher counts, and no other host whose process runs has it,
    which that host could exchange frames with over the last ``TOLD_S``: who cannot be told does not count.

    A searcher that has changed its membership in the last ``SETTLED_S`` is asked again when it has not for so long;
    until the end of the run, then it is one that finds no rest.
    """
    return [wrong for each in range(run.hosts, run.size) if (wrong := _outside(run, each)) is not None]


def _outside(run: Watched, searcher: int) -> str | None:
    due = run.schedule.quiet_s + JUDGED_S
    for now in (look for look in run.looks if look.at_s >= due):
        before = [look for look in run.looks if look.at_s <= now.at_s]
        if not _in_reach(before, searcher, run.hosts):
            return None
        if all(look.claims[searcher] == now.claims[searcher] for look in _last(before, SETTLED_S)):
            return _wrong(before, searcher, run.hosts)
    return f"searcher {searcher} joins on and on"


def _last(looks: list[Look], seconds: float) -> list[Look]:
    return [look for look in looks if look.at_s >= looks[-1].at_s - seconds]


def _in_reach(looks: list[Look], searcher: int, hosts: int) -> bool:
    """Return whether the searcher could exchange frames with one living host all the time of late."""
    late = _last(looks, REACH_S)
    return any(
        all(searcher in look.up and host in look.up and look.mutual(0, host, searcher) for look in late)
        for host in range(hosts)
    )


def _wrong(looks: list[Look], searcher: int, hosts: int) -> str | None:
    """Return what is wrong with a searcher's membership at the last look."""
    now = looks[-1]
    host, epoch = now.claims[searcher]
    if host is None or host not in now.up:
        return f"searcher {searcher} is in the sub-team of {host}, which does not live"
    if now.lists[host].get(searcher) != epoch:
        return f"searcher {searcher}, {epoch}: host {host} has it with {now.lists[host].get(searcher)}"
    late = _last(looks, TOLD_S)
    for other in range(hosts):
        told = all(other in look.up and host in look.up and look.mutual(1, host, other) for look in late)
        if other != host and told and searcher in now.lists[other]:
            return f"searcher {searcher} of host {host} is in the list of host {other}, too"
    return None
