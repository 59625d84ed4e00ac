"""What the soak draws beside team, floor and strategy: plays made of plays, faults that end, and Bluetooth.

It is drawn from a stream of its own, and changes a scenario that is there: a seed of which nothing is drawn here means
what it would mean without this.
"""

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from protocols.deployment.tasks.plan import Place

LIBRARY: Final = Path(__file__).with_name("soak_plays.yaml")
MADE_OF_PLAYS: Final = 0.2
FAULTY: Final = 0.25
BLUETOOTH: Final = 0.07
APART_M: Final = 1.0
"""So far apart robots gather."""
LATER_S: Final = 20.0
"""When a play is called over Bluetooth: by then a piconet has been formed, and faults are as much later."""

Plain = dict[str, Any]
Draw = Callable[[int], list[Place]]
"""Draws so many places at which all robots of the team can stand at once."""


class Party(NamedTuple):
    """Robots that a play deploys to places; others it does not deploy there."""

    robots: tuple[int, ...]
    places_m: tuple[Place, ...]


def widened(plain: Plain, stream: np.random.Generator, draw: Draw) -> tuple[list[Party], list[str]]:
    """Change the scenario *plain*; return who is to end up where, and in words what was changed."""
    parameters = plain["protocol"]["parameters"]
    size = len(plain["team"]["starts"])
    parties = [Party(tuple(range(size)), tuple(parameters["calls"][0]["call"]["places"]))]
    words: list[str] = []
    if stream.random() < MADE_OF_PLAYS:
        parties = _made_of_plays(parameters, parties[0], stream, draw)
        words.append(str(parameters["calls"][0]["call"]["play"]))
    if stream.random() < FAULTY:
        faults = _outages(plain["faults"], size, stream)
        plain["faults"] = [*plain["faults"], *faults]
        words += [
            f"{each['kind']} {each['robot']} at {each['at_s']} for {each.get('for_s', 'ever')}" for each in faults
        ]
    if stream.random() < BLUETOOTH:
        _over_bluetooth(plain)
        words.append(f"bluetooth, all that {LATER_S:g} s later")
    return parties, words


def _made_of_plays(parameters: Plain, all_of: Party, stream: np.random.Generator, draw: Draw) -> list[Party]:
    """Call a play that is made of others, instead of the one that is called."""
    size, ends = len(all_of.robots), list(all_of.places_m)
    call = parameters["calls"][0]["call"]
    order = [int(each) for each in stream.permutation(size)]
    first = int(stream.integers(1, size))
    pause_s = round(float(stream.uniform(0.0, 10.0)), 1)
    kind = str(stream.choice(["wean", "wean/beyond", "twice", "apart"], p=[0.4, 0.1, 0.25, 0.25]))
    parties = [all_of]
    given: Plain = {}
    match kind:
        case "wean" | "wean/beyond":
            parties = _split(order, ends, first)
            (leapers, leap_places), (others, group_places) = parties
            given = {"leapers": leapers, "leap_places": leap_places, "others": others, "group_places": group_places}
            given |= {"crossing": _away(leap_places[0], size * APART_M, draw), "apart_m": APART_M, "ahead_s": pause_s}
        case "twice":
            strategy = str(stream.choice(["group", "wave", "leap_frog"]))
            given = {"robots": order, "before": draw(size), "places": ends, "pause": pause_s, "strategy": strategy}
        case "apart":
            parties = _split(order, ends, size - 1)
            (leapers, places), (scout, last) = parties
            given = {"leapers": leapers, "places": places, "scout": scout[0], "last": last[0]}
            given |= {"crossing": draw(1)[0], "pause": pause_s}
    parameters["calls"] = [
        {"call": {"play": kind, "parameters": json.loads(json.dumps(given)), "augmented": call["augmented"]}}
    ]
    parameters["library"] = str(LIBRARY)
    return parties


def _away(place: Place, least_m: float, draw: Draw) -> Place:
    """Return a place so far from another that a team can gather on the way there."""
    return next(found for (found,) in iter(lambda: draw(1), None) if math.dist(found, place) >= least_m)


def _split(order: Sequence[int], ends: Sequence[Place], first: int) -> list[Party]:
    return [Party(tuple(order[:first]), tuple(ends[:first])), Party(tuple(order[first:]), tuple(ends[first:]))]


def _outages(faults: Sequence[Plain], size: int, stream: np.random.Generator) -> list[Plain]:
    """Return one or two faults of robots that do not die: computers crash, radios are off, mostly not for ever."""
    living = [robot for robot in range(size) if robot not in {fault["robot"] for fault in faults}]
    found: list[Plain] = []
    for robot in stream.permutation(living)[: int(stream.integers(1, 3))]:
        kind = str(stream.choice(["crash", "radio_off"]))
        fault: Plain = {"kind": kind, "robot": int(robot), "at_s": round(float(stream.uniform(1.0, 60.0)), 1)}
        for_s = round(float(np.exp(stream.uniform(np.log(0.5), np.log(60.0)))), 1)
        if kind == "crash" or stream.random() < 0.8:
            fault["for_s"] = for_s
        found.append(fault)
    return found


def _over_bluetooth(plain: Plain) -> None:
    """Let the team talk over a piconet, as in the experiment ``deployment_channels``."""
    plain["channel"] = {"kind": "bluetooth", "range_m": 100, "supervision_s": 8}
    parameters = plain["protocol"]["parameters"]
    parameters |= {"courier": {"links": {}}, "silence_s": 15.0, "alone_s": 45.0}
    parameters["calls"][0]["at_s"] = LATER_S
    for each in [*plain["faults"], *parameters["switches"]]:
        each["at_s"] += LATER_S
