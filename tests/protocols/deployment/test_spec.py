"""What a deployment checks before it begins, where it puts a team, and what it knows."""

import math
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from cosim.errors import UserError
from cosim.randomness import Streams
from protocols.deployment.parameters import Parameters
from protocols.deployment.setup import setup_of
from protocols.deployment.spec import METRICS, SPEC, make, measure, place, prepare
from tests.protocols.deployment.crew_scene import STARTS_M, call, rows, run, surroundings
from tests.protocols.deployment.plays_scene import paths_of


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"host": 3}, r"protocol\.parameters\.host: 3 is not one of 0 to 2"),
        ({"cameras": [0, 7]}, r"protocol\.parameters\.cameras: 7 is not one of 0 to 2"),
        ({"sonars": [3]}, r"protocol\.parameters\.sonars: 3 is not one of 0 to 2"),
        ({"base_m": (12.0, 6.0)}, r"protocol\.parameters\.base_m: .* is no place for a robot of 0\.25 m"),
    ],
)
def test_parameters_that_do_not_fit_the_team_or_the_floor_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        prepare(Parameters.model_validate(changes), surroundings())


def test_more_robots_than_a_piconet_holds_are_refused() -> None:
    nine = tuple((1.0 + k, 1.0) for k in range(9))
    with pytest.raises(UserError, match=r"courier\.links: 9 robots, a piconet has at most 8"):
        prepare(Parameters.model_validate({"courier": {"links": {}}}), surroundings(nine))
    with pytest.raises(UserError, match=r"courier\.links: 9 robots, a piconet has at most 5"):
        prepare(Parameters.model_validate({"courier": {"links": {}}}), surroundings(nine)._replace(links=(4,)))
    prepare(Parameters.model_validate({"courier": {"links": {}}}), surroundings(nine)._replace(links=(8,)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"silence_s": 1.0, "news_s": 1.0}, "silence_s\n  is not >= 2.0, twice news_s"),
        ({"silence_s": 20.0, "alone_s": 10.0}, "alone_s\n  is not >= 20.0, silence_s"),
        ({"courier": {"octets": 120}}, "courier.octets\n  is not >= 1[0-9][0-9], the longest news"),
        ({"calls": [call() | {"at_s": 9}, call()]}, "calls\n  is not in the order of the times"),
        ({"member": {"near_m": 3.0, "away_m": 3.0}}, "member.near_m\n  is not < 3.0, away_m"),
        ({"calls": [{"call": {"play": "x", "plaices": []}}]}, "plaices"),
    ],
)
def test_parameters_that_contradict_each_other_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        Parameters.model_validate(changes)


def test_the_first_host_is_the_first_master_of_a_piconet() -> None:
    own = Parameters.model_validate({"host": 2, "courier": {"links": {"page_s": 7.0}}}).carried
    assert own.links is not None
    assert (own.links.first, own.links.page_s) == (2, 7.0)
    assert Parameters(host=2).carried.links is None


def test_bodies_are_those_of_the_team_with_the_sensors_of_the_parameters() -> None:
    around = surroundings(radii_m=(0.2, 0.3, 0.25), speeds_mps=(1.0, 0.5, 0.75), accelerations_mps2=(2.0, 1.0, 0.5))
    crew = setup_of(Parameters.model_validate({"cameras": [1], "sonars": [2]}), around).crew
    assert [body.radius_m for body in crew.bodies] == [0.2, 0.3, 0.25]
    assert [body.speed_mps for body in crew.bodies] == [1.0, 0.5, 0.75]
    assert [body.acceleration_mps2 for body in crew.bodies] == [2.0, 1.0, 0.5]
    assert [body.camera for body in crew.bodies] == [False, True, False]
    assert [body.sensor for body in crew.bodies] == ["laser", "laser", "sonar"]


def test_base_is_as_given_or_amid_the_starts_or_at_the_start_next_to_that() -> None:
    assert setup_of(Parameters(base_m=(5.0, 5.0)), surroundings()).crew.base_m == (5.0, 5.0)
    middle = setup_of(Parameters(), surroundings()).crew.base_m
    assert middle == pytest.approx((4.0 / 3.0, 4.0 / 3.0))
    wall = np.array([(3.0, 0.0, 3.0, 6.0)])
    apart = surroundings(((1.0, 1.0), (5.0, 1.0)), walls_m=wall)
    assert setup_of(Parameters(), apart).crew.base_m in ((1.0, 1.0), (5.0, 1.0))


def test_a_users_own_plays_stand_beside_ours_and_a_wrong_one_is_named(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("plays: {look: {parameters: {who: {kind: robot}}, tasks: [{kind: photo, robot: who}]}}\n")
    paths = paths_of(setup_of(Parameters(library=str(file)), surroundings()).playbook)
    assert {"look", "deploy/group", "wean"} <= set(paths)
    file.write_text("plays: {look: {tasks: [{kind: photo, robot: who}]}}\n")
    with pytest.raises(UserError, match=r"mine\.yaml.*'who' is no parameter that is a robot"):
        setup_of(Parameters(library=str(file)), surroundings())
    with pytest.raises(UserError, match=r"none\.yaml"):
        setup_of(Parameters(library=str(tmp_path / "none.yaml")), surroundings())


# ---------------------------------------------------------------- places


def placed(size: int, parameters: Parameters | None = None, **more: Any) -> list[tuple[float, float]]:
    return place(parameters or Parameters(), surroundings((), **more), size, Streams(1)("placement"))


def test_robots_start_where_the_floor_says() -> None:
    named = ((1.0, 1.0), (2.0, 2.0), (3.0, 3.0))
    assert placed(2, places_m={"starts": named}) == list(named[:2])


@pytest.mark.parametrize("size", [1, 5, 8])
def test_robots_start_close_together_about_base_with_room_between_them(size: int) -> None:
    starts = placed(size, places_m={"base": ((3.0, 3.0),)})
    assert starts[0] == (3.0, 3.0)
    assert len(starts) == size
    gaps = [math.dist(a, b) for k, a in enumerate(starts) for b in starts[:k]]
    assert min(gaps, default=1.0) >= 3.0 * 0.25 - 1e-9
    assert max(math.dist(start, (3.0, 3.0)) for start in starts) < 1.7


def test_nobody_starts_behind_a_wall_or_where_there_is_no_room() -> None:
    wall = np.array([(3.5, 0.0, 3.5, 6.0)])
    starts = placed(8, Parameters(base_m=(3.0, 3.0)), walls_m=wall)
    assert all(x < 3.5 - 0.25 for x, _ in starts)
    with pytest.raises(UserError, match="found places for"):
        placed(64, walls_m=np.array([(0.0, 1.0, 12.0, 1.0), (0.0, 5.0, 12.0, 5.0), (5.0, 0.0, 5.0, 6.0), (7, 0, 7, 6)]))


# ---------------------------------------------------------------- metrics


def test_all_metrics_are_told_and_no_others() -> None:
    setup = prepare(Parameters(), surroundings())
    machines = [make(Parameters(), setup, robot, Streams(1)("m"), 0) for robot in range(len(STARTS_M))]
    told = measure(machines) | SPEC.referee(Parameters(), setup, surroundings()).verdict(0)
    names = [metric.name for metric in METRICS]
    assert sorted(told) == sorted(names)
    assert len(set(names)) == len(names)


def test_what_machines_have_counted_is_summed_and_a_plan_that_two_have_ended_counts_once() -> None:
    setup = prepare(Parameters(), surroundings())
    machines = [make(Parameters(), setup, robot, Streams(1)("m"), 0) for robot in range(2)]
    machines[0].counters.ended = [(1, "failed", 5 * 10**9), (2, "done", 9 * 10**9)]
    machines[1].counters.ended = [(1, "done", 7 * 10**9)]
    machines[0].counters.ordered, machines[1].counters.ordered = 3, 4
    told = measure(machines)
    assert (told["plans_ended"], told["plans_done"], told["played_s"], told["orders"]) == (2.0, 1.0, 9.0, 7.0)


def test_a_plan_that_a_successor_announces_again_has_ended_when_it_was_announced_first() -> None:
    setup = prepare(Parameters(), surroundings())
    machines = [make(Parameters(), setup, robot, Streams(1)("m"), 0) for robot in range(2)]
    machines[1].counters.ended = [(1, "done", 33 * 10**9)]
    machines[0].counters.ended = [(1, "terminated", 74 * 10**9), (1, "done", 80 * 10**9)]
    told = measure(machines)
    assert (told["plans_ended"], told["plans_done"], told["played_s"]) == (1.0, 1.0, 33.0)


def test_what_a_robot_has_counted_outlives_its_machine() -> None:
    setup = prepare(Parameters(), surroundings())
    before, after = (make(Parameters(), setup, 0, Streams(1)("m"), 0) for _ in range(2))
    for each in fields(before.counters):
        if each.name != "ended":
            setattr(before.counters, each.name, 3)
    before.counters.ended = [(1, "done", 5)]
    before.transport.counts.frames, before.transport.counts.octets = 40, 900
    after.counters.letters = 2  # it has begun to count
    after.transport.counts.frames = 1
    own = after.counters
    assert SPEC.succeed is not None
    SPEC.succeed(before, after, 0)
    after.wake(1)  # which takes the transport's counts
    assert after.counters is own
    assert (own.ordered, own.letters, own.ended) == (3, 5, [(1, "done", 5)])
    assert own.frames >= 41
    assert own.frame_bytes >= 900
    assert all(getattr(own, each.name) >= 3 for each in fields(own) if each.name != "ended")


@pytest.mark.slow
@pytest.mark.parametrize("executive", ["central", "distributed"])
def test_counts_of_a_run_in_which_the_host_boots_again_are_those_of_the_trace(executive: str) -> None:
    crash = {"kind": "crash", "robot": 0, "at_s": 12.0, "for_s": 2.0}
    outcome = run("ideal", [crash], executive=executive, calls=[call("deploy/group")], silence_s=4.0, alone_s=12.0)
    before = [row for row in rows(outcome, "Ordered") if row["source"] == 0 and row["time_ns"] < 12e9]
    assert before  # which its former machine gave
    counted = {"orders": "Ordered", "asides": "SteppedAside", "robots_lost": "RobotLost"}
    assert {name: outcome.metrics[name] for name in counted} == {
        name: len(rows(outcome, event)) for name, event in counted.items()
    }
    ended = rows(outcome, "PlanEnded")
    assert outcome.metrics["plans_ended"] == len({row["plan"] for row in ended}) == 1
    assert outcome.metrics["played_s"] == min(row["time_ns"] for row in ended) / 1e9
