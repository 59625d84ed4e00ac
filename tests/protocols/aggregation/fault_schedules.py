"""Random searches in which hosts crash or are cut off; ``fault_judge`` judges them.

A schedule is a small search and 1 to 6 faults, the first of which kills or crashes a host, or takes its radios, or puts
it elsewhere, or (where signals fade) puts a wall between one part of the floor and the other. After its last fault, or
that one's end, it goes on for ``AFTER_S``. There is a target that no camera can see, unless a schedule is *open*: so no
search ends before its time.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from cosim.randomness import Streams
from cosim.scenario import Scenario

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
"""More than the judge needs."""


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
        {"size": searchers, "body": {**body, "speed_mps": dice.between(0.4, 3.0)}, "radios": [0]},
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
        "camera_m": dice.between(4.0, 8.0),
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
        "lost_s": dice.one(900.0, 900.0, 45.0),
    }


def _anywhere(dice: Dice, drawn: Plain) -> Point:
    """Return a place on free floor."""
    width, height = drawn["bounds_m"][2:]
    while True:
        x_m, y_m = dice.between(CLEAR_M, width - CLEAR_M), dice.between(CLEAR_M, height - CLEAR_M)
        if not any(
            a - CLEAR_M < x_m < c + CLEAR_M and b - CLEAR_M < y_m < d + CLEAR_M for a, b, c, d in drawn["walls"]
        ):
            return x_m, y_m


# ---------------------------------------------------------------- faults


def _faults(dice: Dice, hosts: int, searchers: int, drawn: Plain, fading: bool) -> list[Plain]:
    """Draw faults, the first of which takes a host away or cuts it off; at least one host is never killed."""
    kinds = ["kill", "crash", "radio_off", "moved", *(["wall"] if fading else [])]
    faults = [_grave(dice, dice.one(*kinds), hosts, drawn)]
    kinds = ["kill", "crash", "radio_off", "camera_off", "frozen", "moved", "clock_step", "battery"]
    kinds += ["wall", "jammer"] if fading else []
    for _ in range(dice.whole(0, 5)):
        robot = dice.whole(0, hosts - 1 if dice.chance(0.4) else hosts + searchers - 1)
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
