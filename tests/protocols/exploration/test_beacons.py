"""Beacon teams: who is kept in sight of whom, who stands and who moves, on maps drawn by hand and in whole runs."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from cosim.geometry.planning import Point
from cosim.navigation.frontier_fields import Vector
from cosim.observation import Observation, Seen
from cosim.units import MS, S
from protocols.exploration.beacons import Tethered, attraction, moves
from protocols.exploration.escaping import Escape
from protocols.exploration.parameters import BeaconParameters, EscapeParameters, Parameters
from protocols.exploration.terrain import Terrain
from protocols.mapping.belief import Belief
from tests.protocols.exploration.hand_map import at, drawn, observed

TICK = 100 * MS
HALL = """
    ??????????????????????????????
    ??????????????????????????????
    ??...........................?
    ??...........................?
    ??...........................?
    ??...........................?
    ??????????????????????????????
"""
KNOWN = HALL.replace("?", "#")
"""The same without a frontier."""
ROOMS = """
    #####################
    #.........#.........?
    #.........#.........?
    ?...................?
    #####################
"""


class Stub:
    """Explores to the right, and notes how it was asked."""

    def __init__(self) -> None:
        self.pull: Vector = (0.0, 0.0)
        self.done = False
        self.underway = False
        self.pulls: list[Vector] = []

    def lead(self, observation: Observation, gained: bool) -> float | None:
        self.pulls.append(self.pull)
        return 0.0


class Team:
    """One robot of a team, and what it is told of the others."""

    def __init__(self, me: int, size: int, picture: str = HALL, start_s: float = 0.0, **changes: Any) -> None:
        self.me = me
        self.belief: Belief = drawn(picture)
        self.stub = Stub()
        self.told: dict[int, Point] = {}
        own = BeaconParameters.model_validate({"pattern": "visibility", "keep_m": 4.0, "near_m": 2.0, **changes})
        start = round(start_s * S)
        escape = Escape(EscapeParameters(), Terrain(self.belief, EscapeParameters()), 0.0, 2.5)
        self.tethered = Tethered(own, self.stub, me, size, escape, self.told, start, TICK)

    def lead(self, here: Point, seen: Mapping[int, Point], gained: bool = True) -> float | None:
        plain = observed(here, *seen.values())
        sightings = tuple(each._replace(address=other) for each, other in zip(plain.sightings, seen, strict=True))
        return self.tethered.lead(plain._replace(picture=Seen(tuple(seen), sightings)), gained)


# ---------------------------------------------------------------- the schema, and whose turn it is


def test_beacons_attract_with_the_inverse_square_and_from_the_equilibrium_on() -> None:
    assert attraction((1.0, 1.0), [(4.0, 5.0)], 2.0, 50.0) == pytest.approx((2.0 * 0.6, 2.0 * 0.8))
    assert attraction((1.0, 1.0), [(1.0, 3.0)], 2.0, 50.0) == (0.0, 0.0)
    assert attraction((0.0, 0.0), [(3.0, 0.0), (0.0, 4.0), (1.0, 0.0)], 2.0, 9.0) == pytest.approx((1.0, 9 / 16))


def test_halves_move_in_turn_and_even_numbers_begin() -> None:
    assert [[moves(me, tick, 3) for tick in range(9)] for me in (0, 1, 2, 3)] == [
        [True] * 3 + [False] * 3 + [True] * 3,
        [False] * 3 + [True] * 3 + [False] * 3,
    ] * 2


@pytest.mark.parametrize(
    "wrong",
    [
        {"beacons": {"near_m": 5.0}},
        {"beacons": {"pattern": "visibility"}, "algorithm": "nearest"},
        {"beacons": {"pattern": "leapfrog"}, "positioning": {"kind": "slam"}},
    ],
)
def test_beacons_that_cannot_be_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match=r"near_m|pattern"):
        Parameters.model_validate(wrong)


# ---------------------------------------------------------------- visibility


def test_robot_0_explores_while_it_has_another_in_sight_and_in_reach_and_else_stands() -> None:
    team = Team(0, 3)
    assert team.lead(at(5, 2), {1: at(12, 2)}) == 0.0  # 3.5 m
    assert team.lead(at(5, 2), {1: at(14, 2)}) is None  # 4.5 m
    assert team.lead(at(5, 2), {}) is None
    assert team.lead(at(5, 2), {2: at(6, 2)}) == 0.0
    assert team.stub.pulls == [(0.0, 0.0)] * 2


def test_robot_0_returns_to_where_it_had_another_in_sight() -> None:
    team = Team(0, 2)
    assert team.lead(at(18, 2), {1: at(12, 2)}) == 0.0
    assert team.lead(at(20, 3), {}) == pytest.approx(math.atan2(-1, -2))
    assert team.lead(at(18.1, 2), {}) is None
    assert len(team.stub.pulls) == 1


@pytest.mark.parametrize("wanders_m", [0.4, 0.6])
def test_who_sees_its_guard_stand_comes_beside_it_once(wanders_m: float) -> None:
    team = Team(1, 2, patience_s=1000.0)
    guard, here = at(15, 2), at(18, 2)
    for tick in range(110):
        team.lead(here, {0: (guard[0] + wanders_m * (tick % 2), guard[1])})
    calls = len(team.stub.pulls)
    if wanders_m > 0.5:
        assert calls == 110
        return
    assert calls == 50
    heading = team.lead(here, {0: guard})
    assert heading is not None
    assert abs(heading) == pytest.approx(math.pi, abs=0.3)
    assert team.lead(at(16.8, 2), {0: guard}) == 0.0  # 0.9 m
    assert team.lead(here, {0: guard}) == 0.0
    assert len(team.stub.pulls) == calls + 2


def test_who_does_not_see_its_guard_from_where_it_should_is_led_nearer() -> None:
    team = Team(1, 2, patience_s=1000.0)
    team.told[0] = at(14, 2)
    here = at(11, 2)  # 1.5 m: near enough for the map
    found = [team.lead(here, {}) for _ in range(60)]
    assert found[:20] == [None] * 20
    assert found[-1] is not None
    assert found[-1] == pytest.approx(0.0, abs=0.5)


def test_robot_0_counts_as_many_as_it_is_told_to_keep() -> None:
    team = Team(0, 3, least=2)
    assert team.lead(at(5, 2), {1: at(6, 2)}) == 0.0  # of the other it has not heard yet
    team.told[2] = at(20, 2)
    assert team.lead(at(5, 2), {1: at(6, 2)}) is None
    assert team.lead(at(5, 2), {1: at(6, 2), 2: at(8, 2)}) == 0.0


def test_a_guarded_robot_explores_and_is_drawn_to_its_guard() -> None:
    team = Team(1, 2)
    assert team.lead(at(24, 2), {0: at(18, 2)}) == 0.0
    assert team.stub.pulls[-1] == pytest.approx((-100 / 9, 0.0))
    assert team.lead(at(21, 2), {0: at(18, 2)}) == 0.0
    assert team.stub.pulls[-1] == (0.0, 0.0)


def test_the_guards_are_the_nearest_with_lower_numbers() -> None:
    for least, expected in ((1, [2]), (2, [0, 2])):
        team = Team(3, 5, least=least)
        seen = {0: at(18, 2), 1: at(16, 2), 2: at(19, 2), 4: at(25, 2)}
        assert team.lead(at(24, 2), seen) == 0.0
        drawing = attraction(at(24, 2), [seen[guard] for guard in expected], 2.0, 100.0)
        assert team.stub.pulls[-1] == pytest.approx(drawing)


def test_who_has_lost_its_guard_drives_to_where_it_should_see_it() -> None:
    team = Team(1, 2, ROOMS)
    here, guard = at(4, 3), at(14, 3)
    assert team.lead(here, {0: at(5, 3)}) == 0.0
    team.told[0] = guard
    heading = team.lead(here, {})  # a wall between them, with a door below
    assert heading is not None
    assert -math.pi / 2 < heading < -0.1
    assert len(team.stub.pulls) == 1
    assert team.lead(here, {0: (here[0] + 4.5, here[1])}) is not None  # in sight, and too far
    assert len(team.stub.pulls) == 1


def test_who_rejoins_goes_on_until_its_guard_is_near() -> None:
    team = Team(1, 2)
    team.told[0] = at(20, 2)
    assert team.lead(at(4, 2), {}) == pytest.approx(0.0, abs=0.2)
    assert team.lead(at(13, 2), {0: at(20, 2)}) == pytest.approx(0.0, abs=0.2)  # 3.5 m
    assert team.stub.pulls == []
    team.lead(at(17, 2), {0: at(20, 2)})
    team.lead(at(13, 2), {0: at(20, 2)})
    assert len(team.stub.pulls) == 2


def test_a_lost_guard_is_looked_for_where_it_was_seen_last() -> None:
    team = Team(1, 2)
    team.lead(at(20, 2), {0: at(17, 2)})
    assert team.lead(at(27, 2), {}) == pytest.approx(math.pi, abs=0.3)


def test_without_a_frontier_about_its_guard_a_robot_stands_beside_it() -> None:
    team = Team(1, 2, KNOWN)
    assert team.lead(at(8, 2), {0: at(10, 2)}) is None
    heading = team.lead(at(5, 2), {0: at(11, 2)})  # in reach, and not near
    assert heading == pytest.approx(0.0, abs=0.3)
    assert team.stub.pulls == []


@pytest.mark.parametrize("me", [0, 1])
def test_who_waits_in_vain_does_without_the_others_for_a_time(me: int) -> None:
    team = Team(me, 2, KNOWN, patience_s=2.0)
    other = at(14, 2) if me == 0 else at(6, 2)
    found = [team.lead(at(5, 2), {1 - me: other}, gained=False) for _ in range(60)]
    assert found == [None] * 21 + [0.0] * 21 + [None] * 18


@pytest.mark.parametrize("progress", ["gained", "way"])
def test_patience_begins_anew_with_a_gain_or_the_guards_way(progress: str) -> None:
    team = Team(1, 2, KNOWN, patience_s=2.0)
    for tick in range(60):
        x, y = at(6, 2)
        guard = (x + 0.1 * tick, y) if progress == "way" else (x, y)
        found = team.lead((x - 0.5 + 0.1 * tick * (progress == "way"), y), {0: guard}, gained=progress == "gained")
        assert found is None


def test_who_is_alone_or_has_done_is_held_by_nobody() -> None:
    assert Team(0, 1).lead(at(5, 2), {}) == 0.0
    team = Team(1, 2)
    team.stub.done = True
    assert team.lead(at(5, 2), {0: at(20, 2)}) == 0.0
    assert len(team.stub.pulls) == 1
    assert team.tethered.done
    team.stub.underway = True
    assert team.tethered.underway


# ---------------------------------------------------------------- leapfrog


def leapfrog(me: int, size: int, picture: str = HALL, start_s: float = 0.0) -> Team:
    return Team(me, size, picture, start_s, pattern="leapfrog", slot_s=1.0)


@pytest.mark.parametrize("start_s", [0.0, 3.0])
def test_a_robot_moves_in_its_slots_and_stands_in_the_others(start_s: float) -> None:
    for me in (0, 1):
        team = leapfrog(me, 2, start_s=start_s)
        moving = [team.lead(at(20, 2), {1 - me: at(21, 2)}) is not None for _ in range(40)]
        assert moving == [moves(me, round(start_s * 10) + tick, 10) for tick in range(40)]


def test_the_beacons_are_of_the_other_half() -> None:
    team = leapfrog(0, 4)
    assert team.lead(at(20, 2), {2: at(21, 2)}) == 0.0  # of the others it has not heard yet
    team.told[1] = at(5, 2)
    assert team.lead(at(20, 2), {2: at(21, 2)}) is None
    assert team.lead(at(20, 2), {1: at(21, 2), 2: at(21, 3)}) == 0.0


def test_who_leads_returns_to_where_it_had_a_beacon_and_waits_there() -> None:
    team = leapfrog(0, 2)
    assert team.lead(at(18, 2), {1: at(12, 2)}) == 0.0
    assert team.lead(at(20, 3), {}) == pytest.approx(math.atan2(-1, -2))
    assert team.lead(at(18.1, 2), {}) is None
    assert len(team.stub.pulls) == 1


# ---------------------------------------------------------------- whole runs


def whole_run(pattern: str) -> Any:
    from experiments.exploration_extensions import watching

    office = {"width_m": 12, "depth_m": 9, "rooms": 4, "seed": 5}
    scenario = {
        "name": "beacons",
        "duration_s": 1500,
        "tick_s": 0.1,
        "floorplan": {"map": "office", "office": office},
        "team": {
            "size": 2,
            "senses": {"beams": 90, "beam_range_m": 2.5},
            "body": {"radius_m": 0.25, "speed_mps": 0.6, "drive": "differential"},
        },
        "channel": {"kind": "ideal"},
        "protocol": {
            "use": "protocols.exploration.spec:SPEC",
            "parameters": {"beacons": {"pattern": pattern}},
        },
    }
    return watching.measure({"scenario": scenario}, 3)


@pytest.mark.slow
def test_teams_with_beacons_see_more_of_each_other_and_explore_all_the_same() -> None:
    found = {pattern: whole_run(pattern) for pattern in ("free", "visibility", "leapfrog")}
    assert found["visibility"]["in_sight"] > found["free"]["in_sight"] + 0.1
    assert found["leapfrog"]["in_sight"] > found["free"]["in_sight"] + 0.1
    assert found["leapfrog"]["beacon_in_sight"] > 0.6 > found["free"]["beacon_in_sight"]
    assert found["leapfrog"]["standing"] > 0.45
    assert [found[pattern]["coverage"] for pattern in found] == pytest.approx([1.0] * 3, abs=0.05)
    assert not np.isnan(found["leapfrog"]["nearest_m"])
