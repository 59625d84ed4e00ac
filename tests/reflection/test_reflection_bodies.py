"""Bodies in the simulator, where a command acts a tick late: corners, VisBug's walls, doors that two want to pass."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from cosim.observation import Observation
from cosim.scenario import Scenario, build
from cosim.simulation import simulate
from protocols.reflection import spec
from protocols.reflection.seeking import Seeker, Target

Places = Sequence[Sequence[float]]
CORNERS = [[14, 11, 14, 11.75], [14, 12.65, 14, 19], [16, 11, 16, 19], [8, 11, 14, 11], [16, 11, 22, 11]]
"""Through the door in x = 14 a robot sees what is behind it, but the end of the wall y = 11 keeps its body off."""
ROOMS = [[0, 4, 2.5, 4], [3.5, 4, 8, 4], [4, 0, 4, 3], [4, 3, 5, 3], [4, 4, 4, 6.4], [4, 7.6, 4, 9]]


def scene(
    walls: Places, starts: Places, targets: Sequence[Places], bounds: Sequence[float], **parameters: object
) -> Scenario:
    plain = {
        "duration_s": 400.0,
        "floorplan": {"map": "walls", "bounds_m": list(bounds), "walls": [list(wall) for wall in walls]},
        "team": {
            "size": len(starts),
            "sight_range_m": 12,
            "body": {"radius_m": 0.2, "drive": "omni", "speed_mps": 1.0, "acceleration_mps2": 100},
            "starts": [list(start) for start in starts],
            "senses": {"frames": "own", "beams": 24},
        },
        "channel": {"kind": "optical"},
        "protocol": {
            "use": "protocols.reflection.spec:SPEC",
            "parameters": {"algorithm": "visbug", "explorers": len(targets), "targets": targets, **parameters},
        },
    }
    return build(plain, "scene", Path())


@pytest.mark.slow
def test_a_goal_seen_through_a_gap_that_is_narrower_for_a_body_is_not_come_back_to_for_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It saw its goal, went round the corner, saw it no more, went back by VisBug, saw it, and so on."""
    turned = []
    turn_to = Seeker._turn_to

    def noted(self: Seeker, target: Target, *rest: object) -> None:
        turned.append(target)
        turn_to(self, target, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(Seeker, "_turn_to", noted)
    for start in ([17.5, 9.9], [18.5, 10.2], [19.5, 9.5], [20.5, 10.4]):
        turned.clear()
        metrics = simulate(scene(CORNERS, [start], [[[10.5, 13.25]]], (8, 9, 22, 19)), 1).metrics
        assert metrics["targets_reached"] == 1.0
        assert metrics["motion_steps"] < 200.0
        assert turned.count(Target.GOAL) <= 3


@pytest.mark.slow
def test_visbug_does_not_hang_on_how_far_it_keeps_from_walls(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is asked from where the robot will be when the answer takes effect: no wall is touched, no corner missed."""
    blocked = steps_on_end = 0
    choose = Seeker.choose

    def noted(self: Seeker, observation: Observation, *rest: object) -> object:
        nonlocal blocked, steps_on_end
        steps_on_end = steps_on_end + 1 if self.target is Target.ALGORITHM else 0
        blocked += observation.blocked and steps_on_end > 2  # by no command from before
        return choose(self, observation, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(Seeker, "choose", noted)
    targets = [[[7.0, 1.0], [1.0, 8.0], [7.0, 8.0], [1.0, 1.0]]]
    steps = []
    for slack_m in (0.0005, 0.002, 0.02):
        monkeypatch.setattr(spec, "LOOPS_SLACK_M", slack_m)
        metrics = simulate(scene(ROOMS, [[1.0, 1.0]], targets, (0, 0, 8, 9)), 1).metrics
        assert metrics["targets_reached"] == 4.0
        assert metrics["steps_to_algorithm"] > 100.0
        steps.append(metrics["motion_steps"])
    assert blocked == 0
    assert max(steps) - min(steps) <= 0.02 * min(steps)


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["visbug", "avoid_past", "potential_field"])
def test_two_explorers_that_want_to_pass_a_door_do_not_block_each_other(algorithm: str) -> None:
    """The door is 0.6 m wide, a body 0.4 m; each has to pass it five times."""
    left, right = [1.0, 3.0], [9.0, 3.0]
    door = [[5, 0, 5, 2.7], [5, 3.3, 5, 6]]
    targets = [[right, left] * 2 + [right], [left, right] * 2 + [left]]
    scenario = scene(door, [left, right], targets, (0, 0, 10, 6), algorithm=algorithm, give_up_s=60.0)
    metrics = simulate(scenario, 1).metrics
    assert metrics["goals_reached"] == 10.0
    assert metrics["targets_given_up"] == 0.0


@pytest.mark.slow
def test_goals_after_one_that_was_given_up_are_reached_too() -> None:
    """The referee waits for the first target for ever; the robot goes on."""
    scenario = scene([], [[1.0, 1.0]], [[[30.0, 1.0], [5.0, 1.0]]], (0, 0, 10, 6), algorithm="straight", give_up_s=15.0)
    metrics = simulate(scenario, 1).metrics
    assert (metrics["targets_reached"], metrics["goals_reached"], metrics["targets_given_up"]) == (0.0, 1.0, 1.0)
