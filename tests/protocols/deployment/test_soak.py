"""The soak: random deployments end deployed, and touch nothing, with robots killed and orders lost."""

from collections import Counter
from typing import Any

import numpy as np
import pytest

from cosim.randomness import Streams
from cosim.scenario import Scenario
from tests.protocols.deployment.soak_scene import Case, Floor, absent, box, deserted, drawn, failure, judged, touched
from tests.protocols.deployment.soak_wider import Party, widened
from tests.tiers import soak_count

RUNS = 300


OPEN = {
    # the host's radio fails before its plan is told: it plays alone, the others refuse the call, as that names robot 0,
    # and the run is over before that radio comes back
    268: ["1 places are held, 3 could be"],
}
"""What the protocol does not master yet, by seed: that complaint and no other, least of all that bodies touch."""


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(soak_count(RUNS)))
def test_a_random_deployment_ends_deployed_and_touches_nothing(seed: int, record_property: Any) -> None:
    case = drawn(seed)
    record_property("random deployments through the whole stack", 1)
    verdict = judged(case, seed)
    assert verdict.complaints == OPEN.get(seed, []), case.faults
    if seed in OPEN:
        pytest.xfail(f"{OPEN[seed][0]}: {case.faults}")


# ---------------------------------------------------------------- the judge is judged

DOOR = [(4.0, 0.0, 4.0, 1.5), (4.0, 2.5, 4.0, 4.0)]


def case(places: list[tuple[float, float]]) -> Case:
    floor = Floor("two rooms", [*box(0.0, 0.0, 8.0, 4.0), *DOOR], 8.0, 4.0)
    return Case(Scenario.model_construct(), floor, [0.3] * 3, places, "")


@pytest.mark.parametrize(
    ("moved", "complaints"),
    [
        ((1.0, 2.0), []),
        ((1.6001, 1.0), []),
        ((1.5999, 1.0), ["robots 0 and 1 touch at tick 1"]),
        ((0.2999, 2.0), ["robot 1 touches a wall at tick 1"]),
        ((3.7, 1.4), ["robot 1 touches a wall at tick 1"]),
    ],
)
def test_the_judge_sees_bodies_that_touch(moved: tuple[float, float], complaints: list[str]) -> None:
    ticks = [[(1.0, 1.0), (2.0, 2.0), (6.0, 2.0)], [(1.0, 1.0), moved, (6.0, 2.0)]]
    assert touched(case([]), np.array(ticks)) == complaints


@pytest.mark.parametrize(
    ("ends", "dead", "complaints"),
    [
        ([(1.0, 1.0), (2.0, 3.0), (6.0, 2.0)], set(), []),
        ([(1.0, 1.0), (2.0, 2.6), (6.0, 2.0)], set(), ["2 places are held, 3 could be"]),
        ([(1.0, 1.0), (2.0, 2.6), (6.0, 2.0)], {1}, []),
        ([(1.0, 1.0), (2.0, 2.0), (4.0, 2.0)], {2}, ["1 places are held, 2 could be"]),
        ([(1.0, 1.0), (5.0, 3.0), (4.0, 2.0)], {2}, []),  # in the other room, behind the dead one: its place is held
        ([(1.0, 1.0), (2.0, 3.0), (4.0, 2.0)], {2}, []),
    ],
)
def test_the_judge_excuses_what_the_dead_stand_in_front_of(
    ends: list[tuple[float, float]], dead: set[int], complaints: list[str]
) -> None:
    places = [(1.0, 1.0), (2.0, 3.0), (6.0, 2.0)] if ends[1] != (5.0, 3.0) else [(1.0, 1.0), (2.0, 3.0), (5.0, 3.0)]
    assert deserted(case(places), ends, dead) == complaints


@pytest.mark.parametrize(
    ("parties", "away", "complaints"),
    [
        ([Party((0, 1, 2), ((1.0, 1.0), (2.0, 3.0), (6.0, 2.0)))], set(), ["2 places are held, 3 could be"]),
        ([Party((0, 1), ((1.0, 1.0),)), Party((2,), ((6.0, 2.0),))], set(), []),
        ([Party((0,), ((1.0, 1.0), (2.0, 3.0))), Party((2,), ((6.0, 2.0),))], set(), []),
        (
            [Party((0,), ((1.0, 1.0),)), Party((1, 2), ((2.0, 3.0), (6.0, 2.0)))],
            set(),
            ["2 places are held, 3 could be"],
        ),
        ([Party((0,), ((1.0, 1.0),)), Party((1, 2), ((2.0, 3.0), (6.0, 2.0)))], {1}, []),
    ],
)
def test_the_judge_wants_of_each_party_what_it_could_hold(
    parties: list[Party], away: set[int], complaints: list[str]
) -> None:
    ends = [(1.0, 1.0), (2.0, 2.6), (6.0, 2.0)]
    judged_case = case([(1.0, 1.0), (2.0, 3.0), (6.0, 2.0)])._replace(parties=tuple(parties))
    assert deserted(judged_case, ends, set(), away) == complaints


def row(event: str, at_s: float = 0.0, source: int = 0, **more: Any) -> dict[str, Any]:
    return {"event": event, "time_ns": round(at_s * 1e9), "source": source, **more}


@pytest.mark.parametrize(
    ("rows", "reasons"),
    [
        ([row("PlanEnded", result="failed"), row("PlanEnded", result="done")], []),
        ([], ["no reason is told"]),
        ([row("PlanEnded", result="failed")], ["no reason is told"]),
        ([row("TaskEnded", result="failed", why=""), row("PlanEnded", result="failed")], ["no reason is told"]),
        (
            [row("TaskEnded", result="done", why="it is there"), row("PlanEnded", result="failed")],
            ["no reason is told"],
        ),
        (
            [row("TaskEnded", result="failed", why="stuck at (1, 2)"), row("PlanEnded", result="failed")],
            ["stuck at (1, 2)"],
        ),
        ([row("RobotLost", robot=2), row("PlanEnded", result="failed")], ["robot 2 was lost"]),
        ([row("PlanRefused", 2.0, why="one robot too few")], ["no reason is told"]),
        ([row("Killed", 1.0), row("PlanRefused", 2.0, why="one robot too few")], ["one robot too few"]),
        ([row("PlanRefused", 2.0, why="one robot too few"), row("Killed", 3.0)], ["no reason is told"]),
    ],
)
def test_the_judge_wants_to_be_told_why_a_play_has_failed(rows: list[dict[str, Any]], reasons: list[str]) -> None:
    assert failure(rows) == reasons


@pytest.mark.parametrize(
    ("rows", "away"),
    [
        ([], set()),
        ([row("Crashed", 5.0, 1), row("Rebooted", 20.0, 1)], set()),
        ([row("Crashed", 5.0, 1), row("Rebooted", 90.0, 1)], {1}),
        ([row("RadioOff", 5.0, 2)], {2}),
        ([row("RadioOff", 101.0, 2)], set()),
        ([row("Crashed", 5.0, 1), row("RadioOff", 6.0, 1), row("Rebooted", 20.0, 1), row("RadioOn", 99.0, 1)], {1}),
        ([row("RadioOff", 5.0, 2), row("RadioOn", 20.0, 2), row("RadioOff", 99.0, 2)], {2}),
        ([row("Crashed", 101.0, 1), row("Rebooted", 120.0, 1)], set()),
    ],
)
def test_the_judge_excuses_who_was_not_there_as_the_play_ended(rows: list[dict[str, Any]], away: set[int]) -> None:
    ended = row("PlanEnded", 100.0, result="done")
    assert absent([row("PlanEnded", 40.0, result="failed"), *rows, ended]) == away


def test_plays_of_plays_and_outages_and_bluetooth_are_drawn_and_leave_the_rest_as_it_was() -> None:
    places = [(1.0, 1.0), (2.0, 3.0), (6.0, 2.0)]
    counts = Counter[str]()
    for seed in range(RUNS):
        plain: dict[str, Any] = {
            "team": {"starts": places},
            "channel": {"kind": "ideal"},
            "faults": [{"kind": "kill", "robot": 1, "at_s": 5.0}],
            "protocol": {"parameters": {"calls": [{"call": {"play": "p", "places": places, "augmented": True}}]}},
        }
        plain["protocol"]["parameters"]["switches"] = []
        before = repr(plain)
        parties, words = widened(plain, Streams(seed)("wider"), lambda wanted: [(9.0, 9.0)] * wanted)
        assert sorted(robot for party in parties for robot in party.robots) == [0, 1, 2]
        assert sorted(place for party in parties for place in party.places_m) == sorted(places)
        assert words or repr(plain) == before
        counts.update([plain["channel"]["kind"], plain["protocol"]["parameters"]["calls"][0]["call"]["play"]])
        counts.update(fault["kind"] for fault in plain["faults"])
        assert [fault["robot"] for fault in plain["faults"]].count(1) == 1  # who dies has no other fault
    assert set(counts) == {
        *("ideal", "bluetooth", "p", "wean", "wean/beyond", "twice", "apart", "kill", "crash", "radio_off")
    }
    assert min(counts.values()) >= 3
    assert counts["p"] > RUNS / 2
