"""Robots explore when they are ordered to, over whatever channel, and deploy by the map that they have made."""

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from cosim.errors import UserError
from cosim.geometry.segments import swept_clearance
from cosim.machine import Drive, Event
from cosim.observation import NOBODY, Observation
from cosim.robots.senses import SenseSettings
from cosim.simulation import Simulation
from cosim.testing import check_machine
from cosim.units import MS, S
from protocols.deployment.driving.exploring import FIRST_TOPIC, TOPICS, Exploring, explorable, ground_of
from protocols.deployment.driving.exploring_mover import ExploringMover
from protocols.deployment.driving.exploring_parameters import ExploringParameters
from protocols.deployment.driving.learned import LearnedFloor
from protocols.deployment.parameters import Parameters
from protocols.deployment.planning.planner import Refusal
from protocols.deployment.setup import setup_of
from protocols.deployment.tasks.crew import Body, Crew
from protocols.deployment.tasks.plan import Explore, Plan, Task
from protocols.motion.floor import Aim, Floor
from protocols.motion.parameters import DrivingParameters
from protocols.motion.traffic import Other
from protocols.wire import BadBytes
from tests.protocols.deployment.crew_scene import (
    PLACES_M,
    STARTS_M,
    TICK,
    WALLS,
    Box,
    call,
    maker,
    rows,
    run,
    scenario,
    surroundings,
)
from tests.protocols.deployment.driving_scene import Scene, body, box

EXPLORE = {"call": {"play": "explore", "parameters": {"robots": 3}}}
RETURN = {"call": {"play": "return", "parameters": {"robots": 3}}}
LEARNED: dict[str, Any] = {"map": "learned", "exploring": {"protocol": {"algorithm": "schemas"}}}
QUICK: dict[str, Any] = {"silence_s": 4.0, "alone_s": 12.0, "again_s": 2.0}
FLOOR_CELLS = 120 * 60
"""The small floor's, of 0.1 m; nothing stands on it."""
WALL_CELLS = 2 * 120 + 2 * 60


def explore(robots: Any = 3) -> dict[str, Any]:
    return {"call": {"play": "explore", "parameters": {"robots": robots}}}


def maps(outcome: Any) -> set[tuple[int, int]]:
    return {(row["empty"], row["occupied"]) for row in rows(outcome, "MapLearned")}


def results(outcome: Any) -> list[tuple[int, str]]:
    return [(row["plan"], row["result"]) for row in rows(outcome, "PlanEnded")]


# ---------------------------------------------------------------- whole runs


@pytest.mark.slow
@pytest.mark.parametrize("channel", ["lossy", "adhoc", "bluetooth"])
def test_over_every_channel_robots_explore_return_and_deploy_by_the_map_just_made(channel: str) -> None:
    outcome = run(channel, calls=[call(), EXPLORE, RETURN, call()], **LEARNED)
    (refused,) = rows(outcome, "PlanRefused")
    assert refused["play"] == "deploy/group"
    assert refused["why"].startswith("no robot can get to")
    assert refused["mend"].startswith("explore first")
    assert results(outcome) == [(1, "done"), (2, "done"), (3, "done")]
    assert maps(outcome) == {(FLOOR_CELLS, WALL_CELLS)}
    metrics = outcome.metrics
    assert metrics["deployed"] == metrics["places_held"] == 1.0
    assert metrics["collisions"] == metrics["wall_contacts"] == metrics["orders_failed"] == 0.0


@pytest.mark.slow
def test_robots_that_have_not_explored_have_the_map_too() -> None:
    """The host plans, and the team deploys, by what robot 2 alone has seen, and what others saw from where they are."""
    outcome = run("lossy", calls=[explore([2]), call()], **LEARNED)
    assert [row["source"] for row in rows(outcome, "MapLearned")] == [2]
    assert maps(outcome) == {(FLOOR_CELLS, WALL_CELLS)}
    assert results(outcome) == [(1, "done"), (2, "done")]
    assert outcome.metrics["deployed"] == outcome.metrics["places_held"] == 1.0


@pytest.mark.slow
def test_who_boots_again_is_told_the_map_again() -> None:
    crash = {"kind": "crash", "robot": 1, "at_s": 60.0, "for_s": 2.0}
    calls = [explore(), call() | {"at_s": 90.0}]
    outcome = run("ideal", [crash], calls=calls, **LEARNED)
    assert all(row["time_ns"] < 60 * S for row in rows(outcome, "MapLearned"))
    drives = [row for row in rows(outcome, "TaskEnded") if row["plan"] == 2 and row["source"] == 1]
    assert drives
    assert {row["result"] for row in drives} == {"done"}
    assert outcome.metrics["places_held"] == 1.0


@pytest.mark.slow
def test_a_team_whose_host_dies_while_it_explores_goes_on_exploring_and_deploys() -> None:
    kill = {"kind": "kill", "robot": 0, "at_s": 12.0}
    outcome = run("ideal", [kill], calls=[EXPLORE, call(places=PLACES_M[:2])], **LEARNED, **QUICK)
    assert {row["host"] for row in rows(outcome, "HostChanged")} == {1}
    assert {row["source"] for row in rows(outcome, "MapLearned")} == {1, 2}
    assert [result for _, result in results(outcome)] == ["done", "done"]
    assert outcome.metrics["places_held"] == outcome.metrics["deployed"] == 1.0


@pytest.mark.slow
def test_on_a_given_map_robots_explore_all_the_same_and_plan_by_what_was_given() -> None:
    outcome = run("ideal", calls=[explore([1, 2]), call()], exploring=LEARNED["exploring"])
    assert maps(outcome) == {(FLOOR_CELLS, WALL_CELLS)}
    assert outcome.metrics["refused"] == 0.0
    assert outcome.metrics["deployed"] == 1.0


@pytest.mark.slow
def test_exploring_ends_in_time_whatever_is_left() -> None:
    own = LEARNED["exploring"] | {"most_s": 5.0}
    outcome = run("ideal", calls=[EXPLORE], map="learned", exploring=own)
    ends = rows(outcome, "TaskEnded")
    assert [(row["result"], row["why"]) for row in ends] == [("done", "stopped after 5 s")] * 3
    begun = {row["source"]: row["time_ns"] for row in rows(outcome, "TaskStarted")}
    assert all(row["time_ns"] - begun[row["source"]] == pytest.approx(5 * S, abs=2 * TICK) for row in ends)
    assert all(cells < FLOOR_CELLS for cells, _ in maps(outcome))


@pytest.mark.slow
def test_the_same_exploration_has_the_same_digest() -> None:
    one, other = (run("lossy", seed=3, duration_s=15.0, calls=[EXPLORE], **LEARNED) for _ in range(2))
    assert one.digest == other.digest


@pytest.mark.slow
def test_robots_that_explore_keep_the_laws() -> None:
    quick: dict[str, Any] = {"listen_s": 0.2, "news_s": 0.3}
    check_machine(maker(calls=[EXPLORE], **LEARNED, **quick), STARTS_M, 900 * MS)


@pytest.mark.slow
def test_who_has_nothing_to_do_makes_way_for_explorers() -> None:
    """Robot 1 stands in the only door."""
    plain = scenario(starts=[(1.0, 1.0), (4.0, 2.9)], calls=[explore([0])], map="learned")
    door = ((4.0, 0.0, 4.0, 2.45), (4.0, 3.35, 4.0, 6.0))
    floorplan = plain.floorplan.model_copy(update={"walls": (*WALLS, *door)})
    outcome = Simulation(plain.model_copy(update={"floorplan": floorplan}), 1).run()
    assert [(row["source"], row["robot"]) for row in rows(outcome, "SteppedAside")][:1] == [(1, 0)]
    assert results(outcome) == [(1, "done")]
    ((empty, _),) = maps(outcome)
    assert empty > 0.95 * FLOOR_CELLS
    assert outcome.metrics["collisions"] == outcome.metrics["wall_contacts"] == 0.0


# ---------------------------------------------------------------- one robot's part


def exploring(me: int = 0, octets: int = 150, floor: Floor | None = None) -> tuple[Exploring, list[Event]]:
    events: list[Event] = []
    own, scene = ExploringParameters(), surroundings()
    floor = floor or Floor.of(scene)
    return Exploring(own, ground_of(own, scene), me, octets, floor, True, events.append), events


def seen(x: float, y: float) -> Observation:
    return Observation(x, y, 0.0, 0.0, True, False, NOBODY, Box(x, y))


def test_pieces_of_maps_fit_into_news_and_go_by_topics_of_their_own() -> None:
    one, _ = exploring(octets=60)
    one.begin(0)
    told = []
    for tick in range(40):
        one.step(seen(1.0 + 0.05 * tick, 1.0), tick * TICK)
        told += one.frames()
    topics = [topic for topic, _ in told]
    assert len(told) > TOPICS // 4
    assert max(len(payload) for _, payload in told) <= 60
    assert topics == [FIRST_TOPIC + at % TOPICS for at in range(len(told))]
    assert one.frames() == []


def test_who_hears_of_a_map_asks_for_what_it_lacks_and_comes_to_have_it() -> None:
    (one, _), (other, _) = exploring(0), exploring(1)
    one.begin(0)
    for tick in range(600):
        now = tick * TICK
        one.step(seen(3.0, 3.0), now)
        other.listen(seen(9.0, 3.0), now)
        if tick >= 100:  # all that was told before is lost
            for _, payload in one.frames():
                other.receive(0, payload, now)
        one.frames()
        for _, payload in other.frames():
            one.receive(1, payload, now)
    assert one._explorer is not None
    assert other._explorer is not None
    both = [each._explorer.belief.evidence for each in (one, other)]  # type: ignore[union-attr]
    assert np.array_equal(np.sign(both[0]), np.sign(both[1]))
    assert np.count_nonzero(both[1] < 0) > FLOOR_CELLS // 2


def test_who_stands_and_does_not_explore_looks_about_where_it_stands() -> None:
    """Others cannot see the floor that is under it."""
    one, _ = exploring(0)
    other, _ = exploring(1)
    other.begin(0)
    for tick in range(30):
        other.step(seen(9.0, 3.0), tick * TICK)
        for _, payload in other.frames():
            one.receive(1, payload, tick * TICK)
        one.listen(seen(2.0, 3.0), tick * TICK)
    assert one._explorer is not None
    belief = one._explorer.belief
    assert belief.evidence.flat[belief.frame.cell_at((2.0, 3.0))] < 0


def at_a_door(lost: int, *starts_m: tuple[float, float]) -> tuple[Scene, ExploringMover]:
    """Return robots at a door that the first one's map has wider than it is, by *lost* cells on either side."""
    parameters = DrivingParameters(turn_radps=1.571, turn_acceleration_radps2=1.05)
    evidence = np.full((62, 82), -5, np.int8)  # a cell more than 8 m x 6 m on all sides
    evidence[[0, -1], :] = evidence[:, [0, -1]] = 9
    evidence[1 : 25 - lost, 41] = evidence[37 + lost : 61, 41] = 9
    floor = LearnedFloor((0.0, 0.0, 8.0, 6.0), parameters)
    floor.learn(evidence, (-0.1, -0.1), 0.1)
    pioneer = body(radius_m=0.33, speed_mps=0.5, acceleration_mps2=0.3, turn_radps=1.571, turn_acceleration_radps2=1.05)
    walls = [*box(8.0, 6.0), (4, 0, 4, 2.4), (4, 3.6, 4, 6)]
    scans = SenseSettings(beams=180, beam_range_m=8)
    bodies = [pioneer] * len(starts_m)
    scene = Scene(walls, starts_m, bodies, parameters, headings=math.pi, senses=scans, floor=floor)
    mover = ExploringMover(exploring()[0], floor, 0, 0.33, 0.5, 0.3, parameters, TICK)
    scene.movers[0] = mover
    return scene, mover


@pytest.mark.parametrize("lost", [0, 2, 4])
@pytest.mark.parametrize(
    ("start_m", "goal_m"), [((6.5, 3.2), (3.2, 0.8)), ((5.0, 1.0), (3.0, 1.0)), ((6.5, 4.2), (3.4, 0.5))]
)
def test_a_robot_gets_round_the_end_of_a_wall_that_its_map_has_lost(
    lost: int, start_m: tuple[float, float], goal_m: tuple[float, float]
) -> None:
    scene, mover = at_a_door(lost, start_m)
    mover.go(goal_m)
    assert scene.run(60.0, lambda: mover.state in ("arrived", "stuck")) < 30.0
    assert mover.state == "arrived"
    assert math.dist(scene.place(0), goal_m) < 0.11
    assert scene.least_room_m > 0.0
    assert not scene.touched


@pytest.mark.parametrize("lost", [0, 4])
def test_who_stands_in_a_door_is_named_also_where_the_map_has_lost_its_frame(lost: int) -> None:
    """No way leads round that robot, whatever else is in the way."""
    scene, mover = at_a_door(lost, (5.2, 2.2), (4.0, 3.0))
    scene.dead.add(1)
    mover.go((3.0, 1.0))
    scene.run(30.0, lambda: mover.state == "stuck")
    assert (mover.state, mover.blocked_by) == ("stuck", 1)
    assert bool(mover._noted) is bool(lost)
    corners = np.array([scene.place(0), *mover.way_m])  # past that robot, but round the wall
    assert swept_clearance(scene.grid, corners[:-1], corners[1:], 2.0).min() > 0.33
    mover.go((6.5, 4.0))
    assert not mover._noted
    scene.run(30.0, lambda: mover.state == "arrived")
    assert (mover.state, mover.blocked_by) == ("arrived", None)


@pytest.mark.parametrize("told", ["halt", "go", "retreat"])
def test_whatever_else_a_robot_is_told_ends_exploring(told: str) -> None:
    one, _ = exploring()
    floor = Floor.of(surroundings())
    mover = ExploringMover(one, floor, 0, 0.25, 0.5, 0.5, floor.parameters, TICK)
    mover.explore(0)
    speeds_mps, turns = [], []
    for tick in range(30):
        drive = mover.step(seen(6.0, 3.0), (), tick * TICK)
        assert (one.on, mover.state, mover.explored) == (True, "driving", None)
        if drive is not None:
            speeds_mps.append(drive.speed_mps)
            turns.append(drive.turn_radps)
    assert max(speeds_mps) <= one.speed_mps == 0.3
    assert any(speeds_mps) or any(turns)
    match told:
        case "halt":
            mover.halt()
        case "go":
            mover.go((9.0, 3.0))
        case "retreat":
            mover.retreat((5.0, 3.0), [(9.0, 3.0)])
    assert not one.on
    assert mover.state == ("idle" if told == "halt" else "driving")
    if told == "halt":
        assert mover.step(seen(6.0, 3.0), (), 30 * TICK) == Drive(0.0, 0.0)
    assert mover.explored is None


@pytest.mark.parametrize(
    ("at_m", "idle", "moves", "asked"),
    [
        ((6.6, 3.0), True, False, True),
        ((6.6, 3.0), False, False, False),
        ((8.5, 3.0), True, False, False),
        ((6.6, 3.0), True, True, False),
    ],
)
def test_an_explorer_that_does_not_get_on_says_who_stands_near_and_has_nothing_to_do(
    at_m: tuple[float, float], idle: bool, moves: bool, asked: bool
) -> None:
    one, _ = exploring()
    floor = Floor.of(surroundings())
    mover = ExploringMover(one, floor, 0, 0.25, 0.5, 0.5, floor.parameters, TICK)
    other = Other(1, *at_m, 0.25, idle=idle)
    mover.explore(0)
    named = [False] * 40
    for tick in range(40):
        mover.step(seen(6.0 + 0.02 * moves * tick, 3.0), (other,), tick * TICK)
        named[tick] = mover.blocked_by == 1
    assert not any(named[:30])
    assert any(named[30:]) is asked
    assert mover.wants_m is not None
    assert math.dist(mover.wants_m, (6.0 + 0.78 * moves, 3.0)) == pytest.approx(3.0)
    mover.step(seen(7.0, 3.0), (other,), 40 * TICK)
    assert mover.blocked_by is None
    mover.halt()
    assert mover.wants_m is None


@pytest.mark.parametrize(("at_m", "back"), [((6.6, 3.0), True), ((8.5, 3.0), False)])
def test_an_explorer_that_is_held_for_long_goes_back_a_while_from_who_is_nearest(
    at_m: tuple[float, float], back: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, _ = exploring()
    floor = Floor.of(surroundings())
    mover = ExploringMover(one, floor, 0, 0.25, 0.5, 0.5, floor.parameters, TICK)
    drive, aims = mover._led.to, list[tuple[float, float]]()

    def noted(aim: Aim, *more: Any) -> Any:
        aims.append(aim.place_m)
        return drive(aim, *more)

    monkeypatch.setattr(mover._led, "to", noted)
    mover.explore(0)
    for tick in range(200):
        mover.step(seen(6.0, 3.0), (Other(1, *at_m, 0.25),), tick * TICK)
    went = [number for number, aim in enumerate(aims) if math.dist(aim, (5.0, 3.0)) < 1e-9]
    assert len(aims) > 150, "it wants to go somewhere nearly all the time"
    first = round(floor.parameters.patience_s * S / TICK)
    assert went == (list(range(first, first + 40)) if back else [])


def test_what_is_no_piece_of_a_map_is_traced() -> None:
    one, events = exploring()
    one.receive(2, b"\x45junk", 0)
    assert events == [BadBytes(2, 5)]


def test_nobody_can_explore_without_a_scanner() -> None:
    ground = ground_of(ExploringParameters(), surroundings(beams=0, scan_range_m=math.inf))
    assert ground.known is None
    plan = Plan(number=1, play="explore", robots=(0,), root=Task(name="explore", act=Explore(robots=(0,))))
    found = explorable(plan, ground, Crew((Body(),)))
    assert isinstance(found, Refusal)
    assert "range scanner" in found.conflicts[0]
    with pytest.raises(UserError, match="learned"):
        setup_of(Parameters(map="learned"), surroundings(beams=0, scan_range_m=math.inf))


def test_robots_with_sonar_are_not_sent_to_explore() -> None:
    ground = ground_of(ExploringParameters(), surroundings())
    crew = Crew((Body(), Body(sensor="sonar"), Body()))
    plans = [
        Plan(number=1, play="explore", robots=robots, root=Task(name="explore", act=Explore(robots=robots)))
        for robots in ((0, 2), (0, 1))
    ]
    assert explorable(plans[0], ground, crew) is plans[0]
    found = explorable(plans[1], ground, crew)
    assert isinstance(found, Refusal)
    assert found.conflicts == ("robot 1 has sonar, and cannot explore",)
    assert found.mend == ("exploring by some of the robots [0, 2]",)


@pytest.mark.parametrize(
    "protocol",
    [
        {"map": "shared"},
        {"positioning": {"kind": "slam"}},
        {"beacons": {"pattern": "visibility"}, "algorithm": "schemas"},
        {"sharing": {"links": {}}},
    ],
)
def test_what_does_not_go_with_deployments_is_refused(protocol: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match="the only one that goes with deployments"):
        ExploringParameters.model_validate({"protocol": protocol})


@pytest.mark.parametrize("wrong", [{"executive": "distributed"}, {"positioning": {"kind": "mcl"}}])
def test_a_learned_map_goes_with_one_planner_and_given_positions(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match="map learned"):
        Parameters.model_validate({"map": "learned"} | wrong)


def test_frontiers_attract_from_beyond_the_reach_of_scans() -> None:
    scene = surroundings(scan_range_m=8.0)
    ground = ground_of(ExploringParameters(), scene)
    assert ground.known is not None
    assert ground.parameters.schemas.frontier_m > 8.0


def test_places_are_still_held_after_exploring() -> None:
    """The places of the tests are on the floor that is explored."""
    assert all(0 < x < 12 and 0 < y < 6 for x, y in PLACES_M)
