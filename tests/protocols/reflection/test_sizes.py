"""What goal reflection costs: bytes that machines hand to a channel in a hall without walls, and what they remember."""

import math
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.machine import BROADCAST, Address, Outgoing
from cosim.scenario import Scenario, build
from cosim.simulation import Simulation
from protocols.reflection.frames import decode
from tests.protocols.reflection.stage import Stage

HEADER, BEARING, TERM, PLEDGE, CRC = 9, 5, 13, 13, 2
"""Bytes: magic, flags, time, three counts; (robot, angle); (owner, Id, x, y); (owner, Id, D, time); the check."""


def hall(team: int, channel: str) -> Scenario:
    """Robots in a ring; each is on its way to a place that all of them see."""
    spots = [(20.0 + 8.0 * math.cos(k), 20.0 + 8.0 * math.sin(k)) for k in 2.0 * math.pi * np.arange(team) / team]
    targets = [[[40.0 - x, 40.0 - y]] for x, y in spots]
    plain = {
        "duration_s": 1.0,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 40, 40]},
        "team": {
            "size": team,
            "body": {"drive": "omni", "speed_mps": 0.5},
            "starts": [list(spot) for spot in spots],
            "senses": {"frames": "own"},
        },
        "channel": {"kind": channel},
        "protocol": {"use": "reflection", "parameters": {"explorers": team, "targets": targets}},
    }
    return build(plain, "hall", Path())


def handed_over(team: int, channel: str) -> dict[int, list[bytes]]:
    """Return what the machines of a team hand to their channel, by time."""
    simulation = Simulation(hall(team, channel), 1)
    sent: dict[int, list[bytes]] = {}
    send = simulation.channel.send

    def count(source: Address, outgoing: Outgoing) -> None:
        assert outgoing.destination == BROADCAST
        sent.setdefault(simulation.kernel.now, []).append(outgoing.payload)
        send(source, outgoing)

    simulation.channel.send = count  # type: ignore[method-assign]
    simulation.run()
    return sent


@pytest.mark.slow
@pytest.mark.parametrize("channel", ["ideal", "optical"])
def test_a_meeting_of_m_robots_takes_bytes_linear_in_m_each_and_quadratic_in_all(channel: str) -> None:
    totals = []
    for team in range(2, 17):
        sent = handed_over(team, channel)
        assert all(len(payloads) == team for payloads in sent.values())
        for payload in (payload for payloads in sent.values() for payload in payloads):
            frame = decode(payload)
            assert len(frame.bearings) <= team - 1
            assert len(frame.terms) <= team
            assert len(frame.pledges) <= team
            assert len(payload) <= HEADER + BEARING * (team - 1) + (TERM + PLEDGE) * team + CRC
        totals.append(sum(map(len, sent[max(sent)])))
    # all know all goals and see them: nobody promises himself anything
    each = [HEADER + BEARING * (m - 1) + TERM * m + PLEDGE * (m - 1) + CRC for m in range(2, 17)]
    assert totals == [m * size for m, size in enumerate(each, start=2)]
    assert set(np.diff(totals, 2).tolist()) == {2 * (BEARING + TERM + PLEDGE)}


@pytest.mark.parametrize("team", [2, 9])
def test_two_robots_that_meet_exchange_at_most_m_terms_and_m_pairs_though_they_know_all(team: int) -> None:
    """All meet first; then two of them, who know everybody's goal and a way to it."""
    stage = ring(team)
    everybody = [[other for other in range(team) if other != robot] for robot in range(team)]
    for _ in range(4):
        stage.tick(everybody, [2**team - 1] * team, [True] * team, [0] * team)
    stage.tick([[1], [0], *([[]] * (team - 2))], [0] * team, [True] * team, [0] * team)
    for robot in (0, 1):
        frame = decode(stage.payloads[robot][-1])
        assert (len(frame.bearings), len(frame.terms), len(frame.pledges)) == (1, team, team - 1)
        assert len(stage.payloads[robot][-1]) == HEADER + BEARING + TERM * team + PLEDGE * (team - 1) + CRC


def ring(team: int) -> Stage:
    """Return a stage with *team* robots that have four goals each, for half a second."""
    angles = (2.0 * math.pi * np.arange(team) / team).tolist()
    places = [(10.0 * math.cos(angle), 10.0 * math.sin(angle)) for angle in angles]
    goals = [[(90.0 + k, float(robot)) for k in range(4)] for robot in range(team)]
    return Stage(places, [(0.0, 0.0, angle) for angle in angles], goals, give_up_s=0.5, promise_life_s=1.0)


def remembered(thing: Any, seen: set[int]) -> int:
    """Return how many numbers, keys and references *thing* holds, and all that it holds, without what is in *seen*."""
    if id(thing) in seen or isinstance(thing, (int, float, str, bytes, type(None), type)) or callable(thing):
        return 0
    seen.add(id(thing))
    if isinstance(thing, np.ndarray):
        return thing.size
    if isinstance(thing, dict):
        inside = [*thing.keys(), *thing.values()]
    elif isinstance(thing, (list, tuple, set, deque)):
        inside = list(thing)
    else:
        names = [name for kind in type(thing).__mro__ for name in getattr(kind, "__slots__", ())]
        inside = [*vars(thing).values()] if hasattr(thing, "__dict__") else [getattr(thing, name) for name in names]
    return len(inside) + sum(remembered(item, seen) for item in inside)


def memories(team: int, ticks: int) -> list[int]:
    """Return how much each machine remembers when all have seen each other and all goals for so many ticks.

    Shared settings do not count, nor the memory of the algorithm A, which knows no team.
    """
    stage = ring(team)
    everybody = [[other for other in range(team) if other != robot] for robot in range(team)]
    for tick in range(ticks):
        blind = tick % 10 == 5
        stage.tick(everybody, [0 if blind else 2**team - 1] * team, [not blind] * team, [0] * team)
    shared = {id(stage.parameters)}
    return [remembered(machine, set(shared)) for machine in stage.machines]


@pytest.mark.slow
def test_memory_is_linear_in_the_team_and_does_not_grow_with_time() -> None:
    sizes = {team: max(memories(team, 12)) for team in (4, 8, 16, 32)}
    steps = [sizes[2 * team] - sizes[team] for team in (4, 8, 16)]
    assert [step / steps[0] for step in steps] == pytest.approx([1.0, 2.0, 4.0], rel=0.02)
    assert steps[-1] / 16 < 60, "numbers and references for another robot"
    assert max(memories(8, 300)) <= sizes[8]
