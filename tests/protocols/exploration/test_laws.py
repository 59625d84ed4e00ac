"""Explorers keep the laws of machines: with one map and with messages, with every algorithm, on a floor that they see.

``check_machine`` has no walls and knows no Drive; so each machine here brings its own floor and its own wheels.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cosim.arrays import Floats
from cosim.machine import Address, Command, Drive, Machine
from cosim.navigation.schemas import beam_directions
from cosim.observation import NOBODY, Observation
from cosim.protocol import Surroundings
from cosim.testing import LawError, check_machine
from cosim.units import MS, S, Time
from protocols.exploration.explorer import Explorer
from protocols.exploration.parameters import Parameters
from protocols.exploration.setup import prepare
from protocols.exploration.spec import SPEC

STARTS_M = ((0.6, 0.6), (1.4, 0.6), (0.6, 1.4))
WALLS_M = np.array(
    [(0, 0, 5, 0), (5, 0, 5, 3), (5, 3, 0, 3), (0, 3, 0, 0), (2.5, 0, 2.5, 1.2), (2.5, 2, 2.5, 3)], np.float64
)
BEAMS, RANGE_M = 60, 1.5
DIRECTIONS = beam_directions(BEAMS)


class Scan:
    """What the beams of a robot meet at a place: the nearest of the walls."""

    def __init__(self, place_m: tuple[float, float]) -> None:
        self._place = np.array(place_m)

    def sees(self, points_m: Any) -> list[bool]:
        return [False] * len(points_m)

    def ranges_m(self) -> Floats:
        start, along = WALLS_M[:, :2] - self._place, WALLS_M[:, 2:] - WALLS_M[:, :2]
        across = np.subtract(*np.multiply(DIRECTIONS[:, None], along[None, :, ::-1]).T).T  # beam x wall
        with np.errstate(divide="ignore", invalid="ignore"):
            range_m = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / across
            share = (start[:, 0] * DIRECTIONS[:, 1:] - start[:, 1] * DIRECTIONS[:, :1]) / across
        meets = (range_m > 0) & (share >= 0) & (share <= 1)
        nearest = np.where(meets, range_m, math.inf).min(axis=1)
        return np.where(nearest < RANGE_M, nearest, math.inf)


class OnWheels:
    """An explorer that looks about on the floor, and that is where its own orders have brought it."""

    def __init__(self, explorer: Explorer, place_m: tuple[float, float]) -> None:
        self._explorer = explorer
        self._pose = (*place_m, 0.0)
        self._drive = Drive(0.0, 0.0)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._explorer, name)

    def observe(self, observation: Observation, now: Time) -> None:
        x, y, heading = self._pose
        heading += 0.1 * self._drive.turn_radps
        x += 0.1 * self._drive.speed_mps * math.cos(heading)
        y += 0.1 * self._drive.speed_mps * math.sin(heading)
        self._pose = x, y, heading
        seen = Observation(x, y, heading, self._drive.speed_mps, True, observation.blocked, NOBODY, Scan((x, y)))
        self._explorer.observe(seen, now)

    def commands(self) -> list[Command]:
        commands = self._explorer.commands()
        self._drive = next((each for each in commands if isinstance(each, Drive)), self._drive)
        return commands


def maker(wheels: bool = True, **changes: Any) -> Callable[[Address, Time], Machine]:
    """Return what makes the machines of teams: each team, which begins with robot 0, has its own map."""
    parameters = Parameters.model_validate({"escape": {"period_s": 0.5}, **changes})
    setup: list[Any] = []

    def make(me: Address, start: Time) -> Machine:
        if me == 0:
            floor = (0.0, 0.0, 5.0, 3.0)
            none = np.zeros(0, np.bool_)
            told = Surroundings(STARTS_M, 0.2, 0.3, 1.0, 100 * MS, WALLS_M, floor, lambda points: none)
            setup[:] = [prepare(parameters, told._replace(scan_range_m=RANGE_M, beams=BEAMS))]
        explorer = SPEC.make(parameters, setup[0], me, None, start)
        return OnWheels(explorer, STARTS_M[me]) if wheels else explorer  # type: ignore[arg-type, return-value]

    return make


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["schemas", "nearest", "utility", "assignment"])
@pytest.mark.parametrize("way", ["shared", "messages"])
def test_explorers_keep_the_laws(way: str, algorithm: str) -> None:
    check_machine(maker(map=way, algorithm=algorithm), STARTS_M, 2500 * MS)


@pytest.mark.parametrize("way", ["shared", "messages"])
def test_explorers_without_any_sensors_keep_the_laws(way: str) -> None:
    check_machine(maker(wheels=False, map=way), STARTS_M, S)


def test_on_this_floor_they_drive_and_tell_each_other() -> None:
    """Else the laws would be kept by robots that do nothing."""
    make = maker(map="messages")
    machine = make(0, 0)
    sent, ways = 0, []
    for tick in range(60):
        machine.observe(Observation(0.0, 0.0, 0.0, 0.0, True, False), tick * 100 * MS)
        sent += len(machine.outbox())
        ways += machine.commands()
    assert sent > 5
    assert len({way.turn_radps for way in ways if isinstance(way, Drive) and way.speed_mps}) > 10
    assert machine.counters.way_m > 1.0  # type: ignore[attr-defined]


def test_a_robot_that_has_a_map_and_loses_its_scanner_raises_nothing() -> None:
    machine = maker()(0, 0)
    machine.observe(Observation(0.0, 0.0, 0.0, 0.0, True, False), 0)
    machine.commands()
    machine._explorer.observe(Observation(*STARTS_M[0], 0.0, 0.0, True, False), 100 * MS)  # type: ignore[attr-defined]
    assert [type(order) for order in machine.commands()] == [Drive]


def test_a_team_that_keeps_its_map_for_the_next_run_is_found_out() -> None:
    make, first = maker(), []

    def keeps(me: Address, start: Time) -> Machine:
        first.append(make(me, start)) if len(first) < len(STARTS_M) else None
        return first[me]

    with pytest.raises(LawError):
        check_machine(keeps, STARTS_M, S)
