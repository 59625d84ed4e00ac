"""What cosim knows of goal reflection: targets, frames, starts, the referee, and whole runs in the simulator."""

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cosim.errors import UserError
from cosim.machine import Connected, Discovered, Inquire, InquiryComplete, Page, Role
from cosim.observation import Observation, Seen, Sighting
from cosim.protocol import Death, Surroundings
from cosim.scenario import Scenario, build
from cosim.simulation import Outcome, simulate
from cosim.testing import check_machine
from cosim.units import MS, S
from protocols.reflection.machine import Reflection
from protocols.reflection.parameters import Parameters
from protocols.reflection.setup import drawn, into_frame
from protocols.reflection.spec import METRICS, SPEC, TargetReferee, place, prepare

ROOMS = ((2.0, 2.0), (8.0, 2.0), (2.0, 8.0), (8.0, 8.0))


def surroundings(starts: Sequence[tuple[float, float]], **more: object) -> Surroundings:
    size = len(starts)
    plain: dict[str, object] = {
        "starts_m": tuple(starts),
        "radius_m": 0.2,
        "speed_mps": 1.0,
        "acceleration_mps2": 1.0,
        "tick": 100 * MS,
        "walls_m": np.array([[0.0, 5.0, 10.0, 5.0]]),
        "bounds_m": (0.0, 0.0, 10.0, 10.0),
        "forbidden": lambda points: np.zeros(len(points), bool),
        "radii_m": (0.2,) * size,
        "speeds_mps": (1.0,) * size,
        "accelerations_mps2": (1.0,) * size,
    }
    return Surroundings(**(plain | more))  # type: ignore[arg-type]


@pytest.mark.parametrize(("links", "found"), [((), 7), ((None,), 7), ((12,), 12), ((2,), 2)])
def test_an_explorer_looks_for_others_until_its_radio_has_no_link_left(links: object, found: int) -> None:
    starts = [(1.0 + 0.5 * robot, 1.0) for robot in range(16)]
    parameters = Parameters.model_validate({"explorers": 1, "targets": [[[8, 8]]], "links": True})
    setup = prepare(parameters, surroundings(starts, links=links))
    machine = SPEC.make(parameters, setup, 0, np.random.default_rng(0), 0)
    others = range(1, 16)
    here = Observation(
        1.0, 1.0, 0.0, 0.0, True, False, Seen(tuple(others), tuple(Sighting(n, *starts[n]) for n in others))
    )
    machine.observe(here, 0)
    machine.link(InquiryComplete(()), S)
    for now, peer in enumerate(others, 1):
        machine.observe(here, now * 20 * S)
        if not any(isinstance(item, Inquire) for item in machine.outbox()):
            break
        machine.link(Discovered(peer), now * 20 * S)
        machine.link(InquiryComplete((peer,)), now * 20 * S)
        assert Page(peer) in machine.outbox()
        machine.link(Connected(peer, Role.MASTER), now * 20 * S + S)
    assert now - 1 == found


def test_targets_lie_in_rooms_and_never_twice_on_end_in_the_same() -> None:
    parameters = Parameters(rooms=ROOMS, target_count=400, target_spread_m=0.5)
    targets = drawn(parameters, 1, 0)
    rooms = [min(ROOMS, key=lambda room: math.dist(room, target)) for target in targets]
    assert all(abs(x - rx) <= 0.5 and abs(y - ry) <= 0.5 for (x, y), (rx, ry) in zip(targets, rooms, strict=True))
    assert all(one != other for one, other in pairwise(rooms))
    counts = [rooms.count(room) for room in ROOMS]
    assert min(counts) > 70  # 100 each expected, standard deviation below 9
    assert np.std([x - rx for (x, _), (rx, _) in zip(targets, rooms, strict=True)]) == pytest.approx(0.289, abs=0.03)


def test_targets_depend_on_set_and_explorer_only() -> None:
    few, many = (Parameters(rooms=ROOMS, target_count=count, explorers=count) for count in (5, 9))
    assert drawn(few, 3, 1) == drawn(many, 3, 1)[:5]
    assert len({drawn(few, target_set, explorer) for target_set in (1, 2) for explorer in (0, 1)}) == 4
    seeds = [prepare(Parameters(rooms=ROOMS), surroundings([(1.0, 1.0)], seed=seed)).targets_m for seed in (7, 7, 8)]
    assert seeds[0] == seeds[1] != seeds[2]


def test_every_robot_gets_its_task_in_its_own_frame() -> None:
    starts = [(1.0, 1.0), (3.0, 1.0), (5.0, 1.0)]
    frames = ((1.0, 1.0, math.pi / 2.0), (3.0, 1.0, 0.0), (0.0, 0.0, 0.0))
    parameters = Parameters(targets=(((2.0, 4.0),),), patrols=(((3.0, 2.0), (9.0, 2.0)), ((5.0, 1.0),)))
    setup = prepare(parameters, surroundings(starts, frames=frames))
    explorer, shuttle, post = setup.tasks
    assert explorer.goals_m[0] == pytest.approx((3.0, -1.0))  # 1 m right and 3 m up, seen with the x axis up
    assert explorer.patrol_m == ()
    assert shuttle.patrol_m == ((0.0, 1.0), (6.0, 1.0))
    assert (shuttle.goals_m, post.patrol_m) == ((), ((5.0, 1.0),))
    assert setup.steps_m == (0.1, 0.1, 0.1)
    assert explorer.objects_m == ()


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        ({"explorers": 3, "rooms": ROOMS}, "explorers"),
        ({"rooms": ROOMS[:1]}, "rooms"),
        ({"targets": ()}, "targets"),
    ],
)
def test_what_cannot_be_is_refused(parameters: dict[str, object], complaint: str) -> None:
    with pytest.raises(UserError, match=f"protocol.parameters.{complaint}"):
        prepare(Parameters.model_validate(parameters), surroundings([(1.0, 1.0), (2.0, 1.0)]))


def test_robots_start_in_rooms_at_way_points_or_anywhere_free_and_apart() -> None:
    parameters = Parameters(rooms=ROOMS, explorers=2, patrols=(((5.0, 1.0), (5.0, 4.0)),))
    starts = place(parameters, surroundings(()), 6, np.random.default_rng(1))
    assert starts[:4] == [(2.0, 2.0), (8.0, 2.0), (5.0, 1.0), (5.0, 4.0)]
    for robot, start in enumerate(starts):
        assert abs(start[1] - 5.0) > 0.2
        assert all(math.dist(start, other) > 0.4 for other in starts[:robot])
    crowded = surroundings((), forbidden=lambda points: np.ones(len(points), bool))
    with pytest.raises(UserError, match="no place"):
        place(Parameters(explorers=0), crowded, 1, np.random.default_rng(1))


def look(referee: TargetReferee, *places: tuple[float, float]) -> bool:
    x_m, y_m = np.array(places).T
    return referee.look(x_m, y_m, 0)


def test_the_referee_counts_steps_and_targets_in_their_order() -> None:
    parameters = Parameters(targets=(((1.0, 0.0), (0.0, 0.0)),), epsilon_m=0.3)
    around = surroundings([(0.0, 0.0)])
    referee = SPEC.referee(parameters, prepare(parameters, around), around)
    assert isinstance(referee, TargetReferee)
    assert not look(referee, (0.0, 0.0))  # the second target does not count before the first
    for x in (0.5, 0.7, 0.71):
        assert not look(referee, (x, 0.0))
    assert referee.verdict(0)["targets_reached"] == 1.0  # 0.71 is nearer than epsilon, 0.7 is not
    assert not look(referee, (0.31, 0.0))
    assert look(referee, (0.29, 0.0))
    assert referee.verdict(0) == {"motion_steps": 5.0, "targets_reached": 2.0, "steps_per_target": 2.5}


def test_the_referee_does_not_wait_for_the_dead() -> None:
    parameters = Parameters(targets=(((1.0, 0.0),), ((5.0, 0.0),)), explorers=2)
    around = surroundings([(0.0, 0.0), (4.0, 0.0)])
    referee = SPEC.referee(parameters, prepare(parameters, around), around)
    assert not look(referee, (1.0, 0.0), (4.0, 0.0))
    referee.died(Death(1, 0, 4.0, 0.0, 0.2))
    assert look(referee, (1.0, 0.0), (4.0, 0.0))
    assert math.isnan(
        TargetReferee(prepare(parameters, surroundings([(0, 0), (4, 0)])), 0.1).verdict(0)["steps_per_target"]
    )


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["potential_field", "avoid_past", "straight"])
@pytest.mark.parametrize(("period_s", "links"), [(None, False), (0.35, True)])
def test_the_machine_keeps_the_laws_of_machines(algorithm: str, period_s: float | None, links: bool) -> None:
    starts = ((0.0, 0.0), (1.0, 0.0), (2.0, 0.0))
    parameters = Parameters.model_validate(
        {
            "algorithm": algorithm,
            "explorers": 2,
            "targets": [[[3.0, 3.0], [0.0, 1.0]], [[0.0, 0.0]]],
            "patrols": [[[2.0, 0.0], [2.0, 2.0]]],
            "period_s": period_s,
            "links": links,
        }
    )
    setup = prepare(parameters, surroundings(starts))

    def make(me: int, start: int) -> Reflection:
        return SPEC.make(parameters, setup, me, np.random.default_rng(me), start)  # type: ignore[return-value]

    check_machine(make, starts)


def office(channel: dict[str, object] | None = None, faults: Sequence[object] = (), **parameters: object) -> Scenario:
    """Two rooms at a corridor, each with a door; a helper patrols the corridor."""
    walls = [[0, 2, 1.4, 2], [2.6, 2, 5.4, 2], [6.6, 2, 8, 2], [4, 2, 4, 6]]
    plain = {
        "duration_s": 120.0,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 8, 6], "walls": walls},
        "team": {
            "size": 2,
            "body": {"drive": "omni", "speed_mps": 1.0},
            "starts": [[2.0, 4.5], [4.0, 1.0]],
            "senses": {"frames": "own"},
        },
        "faults": list(faults),
        "channel": channel or {"kind": "optical"},
        "protocol": {
            "use": "protocols.reflection.spec:SPEC",
            "parameters": {
                "targets": [[[6.0, 4.5], [2.0, 4.5], [6.0, 4.5]]],
                "patrols": [[[1.0, 1.0], [7.0, 1.0]]],
                **parameters,
            },
        },
    }
    return build(plain, "office", Path())


def names(outcome: Outcome) -> set[str]:
    return set(outcome.metrics)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ideal", "optical"])
def test_a_run_in_the_simulator_reaches_its_targets(kind: str) -> None:
    outcome = simulate(office({"kind": kind}), 1)
    assert outcome.metrics["targets_reached"] == 3.0
    assert outcome.metrics["motion_steps"] == pytest.approx(outcome.simulated_s * 10.0)
    assert outcome.metrics["targets_given_up"] == 0.0
    assert names(outcome) >= {metric.name for metric in METRICS}
    assert simulate(office({"kind": kind}), 1).digest == outcome.digest


@pytest.mark.slow
def test_a_helper_saves_steps_and_silence_does_not() -> None:
    """The helper's share of the truth: the same run with the sharing switched off."""
    steps = {
        share: sum(
            simulate(office(share_goals=share, share_states=share), seed).metrics["motion_steps"] for seed in (1, 2)
        )
        for share in (True, False)
    }
    assert steps[True] < 0.8 * steps[False]
    silent = simulate(office(share_goals=False, share_states=False), 1).metrics
    assert (silent["frames"], silent["promises_taken"], silent["advice"]) == (0.0, 0.0, 0.0)


@pytest.mark.slow
def test_over_bluetooth_robots_talk_when_they_have_met() -> None:
    metrics = simulate(office({"kind": "bluetooth"}, links=True, algorithm="avoid_past"), 1).metrics
    assert metrics["advice"] > 0.0
    assert metrics["targets_reached"] == 3.0
    without = simulate(office({"kind": "bluetooth"}, algorithm="avoid_past"), 1).metrics
    assert without["advice"] == 0.0


@pytest.mark.slow
def test_visbug_finds_its_targets_with_steps_that_end_at_corners_and_round_bodies() -> None:
    """A body stands in the corridor, near the way."""
    alone = office(algorithm="visbug", share_goals=False, patrols=[[[4.0, 1.0]]])
    metrics = simulate(alone, 1).metrics
    assert metrics["targets_reached"] == 3.0
    assert metrics["steps_to_algorithm"] > 50.0
    assert metrics["motion_steps"] < 400.0


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["avoid_past", "visbug"])
def test_a_robot_that_dies_leaves_the_others_to_their_tasks(algorithm: str) -> None:
    """Its body stays, in the corridor, beside the way of the other."""
    targets = [[[7.0, 1.0], [5.0, 1.0]], [[2.0, 1.0], [7.0, 1.0]]]
    kill = {"kind": "kill", "robot": 1, "at_s": 1.0}
    outcome = simulate(office(faults=[kill], explorers=2, targets=targets, algorithm=algorithm), 3)
    assert outcome.metrics["robots_killed"] == 1.0
    assert outcome.metrics["targets_reached"] == 2.0
    assert outcome.simulated_s < 120.0


def test_frames_turn_places_and_back() -> None:
    assert into_frame((1.0, 0.0), (0.0, 0.0, math.pi / 2.0)) == pytest.approx((0.0, -1.0))
