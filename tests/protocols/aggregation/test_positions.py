"""Searches by robots that do not know where they are: by odometry that errs, or by a filter on the known map."""

import math
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from cosim.errors import UserError
from cosim.machine import GoTo
from cosim.observation import Observation
from cosim.randomness import Streams
from cosim.scenario import changed
from cosim.units import S
from protocols.aggregation.spec import SPEC
from protocols.localization.positioning import Given, Localised
from protocols.localization.scan import Sensor
from protocols.motion.frames import Shift
from tests.protocols.aggregation.team_scene import TARGETS_M, TICK, Point, Run, prepared, scenario

CAMERA_M = 4.0
DRIFT = {"odometry_slip": 0.03, "odometry_turn_rad": 0.06}
KINDS: dict[str, dict[str, Any]] = {
    "true": {},
    "odometry": {"team.senses": {"beams": 90, "beam_range_m": 8.0, **DRIFT}},
    "mcl": {
        "team.senses": {"beams": 90, "beam_range_m": 8.0, **DRIFT},
        "protocol.parameters.positioning.kind": "mcl",
    },
}
STARTS_M = [(9.5, 9.0), (10.5, 9.0), (9.5, 10.4), (10.0, 10.4), (10.5, 10.4)]
MCL: dict[str, Any] = {"positioning": {"kind": "mcl"}}


@cache
def search(positions: str) -> Run:
    """Return a search by two hosts and three searchers."""
    plain = scenario("mi", camera_m=CAMERA_M, duration_s=300.0)
    return Run(changed(plain, KINDS[positions], positions, Path()))


def finds(run: Run) -> list[tuple[Point, Point, Point]]:
    """Return of each find where the target is, where its finder was, and where it is told to be."""
    rows = run.told("TargetFound")
    return [(TARGETS_M[row["target"]], run.place_m(row["source"], row["s"]), (row["x_m"], row["y_m"])) for row in rows]


@pytest.mark.parametrize("positions", KINDS)
def test_a_search_ends_by_any_positions(positions: str) -> None:
    assert search(positions).ended


@pytest.mark.parametrize("positions", KINDS)
def test_what_is_found_is_in_range_of_the_body_that_finds_it(positions: str) -> None:
    found = finds(search(positions))
    assert {target for target, _, _ in found} == set(TARGETS_M)
    assert all(math.dist(target, finder) <= CAMERA_M for target, finder, _ in found)


def test_a_target_is_told_where_its_finder_believes_it_to_be() -> None:
    off_m = {each: [math.dist(target, told) for target, _, told in finds(search(each))] for each in KINDS}
    assert max(off_m["true"]) == 0.0
    assert min(off_m["odometry"]) > 0.0
    assert max(off_m["odometry"]) > 0.5
    assert max(off_m["mcl"]) < 0.4


def test_a_robot_that_localises_is_where_it_takes_itself_to_be_and_one_by_odometry_is_not() -> None:
    worst_m = {}
    for positions in KINDS:
        run = search(positions)
        places = zip(run.machines, run.places_m[-1], strict=True)
        worst_m[positions] = max(math.dist(machine._here, place) for machine, place in places)
    assert worst_m["true"] == 0.0
    assert worst_m["mcl"] < 0.3
    assert worst_m["odometry"] > 0.5


def test_the_pose_of_a_filter_is_told_to_who_looks_on() -> None:
    host, *_, searcher = search("mcl").machines
    for machine in (host, searcher):
        believed = machine.believed()
        assert believed.frame == "world"
        assert (believed.estimate.x_m, believed.estimate.y_m) == pytest.approx(machine._here)
    assert search("odometry").machines[0].believed().estimate is None


def made(me: int, start_s: int = 0, **changes: Any) -> Any:
    parameters, setup = prepared(STARTS_M, beams=36, **changes)
    return SPEC.make(parameters, setup, me, Streams(1)("machine", me), start_s * S)


class Elsewhere(Given):
    """Finds the robot 3 m farther along x than it is given, and sends it back by as much."""

    def __init__(self) -> None:
        super().__init__(Sensor(0), (3.0, 0.0, 0.0))


@pytest.mark.parametrize("me", [0, 2])
def test_a_machine_goes_by_where_it_is_located_and_its_body_by_its_own_frame(me: int) -> None:
    machine = made(me)
    machine.positioning = Elsewhere()
    goals = []
    for tick in range(100):
        machine.observe(Observation(6.0, 9.0, 0.0, 0.0, True, False), tick * TICK)
        goals += [command for command in machine.commands() if isinstance(command, GoTo)]
    assert machine._here == (9.0, 9.0)
    walker = machine._itinerary._mover if me == 0 else machine._motion._mover
    assert goals[-1] == pytest.approx((walker.ahead_m[0][0] - 3.0, walker.ahead_m[0][1]))


@pytest.mark.parametrize("me", [0, 2])
def test_who_boots_again_keeps_the_shift_of_its_frame(me: int) -> None:
    before, after = made(me, **MCL), made(me, 9, **MCL)
    before.positioning.shift = Shift(0.4, -0.2, 0.1)
    assert SPEC.succeed is not None
    SPEC.succeed(before, after, 9 * S)
    assert after.positioning.shift == Shift(0.4, -0.2, 0.1)


def test_a_person_has_no_filter() -> None:
    assert isinstance(made(2, humans=(2,), **MCL).positioning, Given)
    assert isinstance(made(3, humans=(2,), **MCL).positioning, Localised)


def test_robots_without_a_scanner_cannot_localise() -> None:
    with pytest.raises(UserError, match=r"positioning\.kind: 'mcl' needs a range scanner"):
        prepared(STARTS_M, **MCL)
