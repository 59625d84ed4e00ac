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
CORNERS = [[14, 11, 14, 11.75], [14, 12.65, 14, 19], [16, 11, 16, 13.75], [16, 14.65, 16, 19],
           [2, 11, 14, 11], [16, 11, 28, 11], [2, 9, 14.55, 9], [15.45, 9, 28, 9]]  # fmt: skip
"""Through the door in x = 14 a robot sees what is behind it, but the end of the wall y = 11 keeps its body off."""
WING = [[0, 9, 0.55, 9], [1.45, 9, 10.55, 9], [11.45, 9, 14.55, 9], [15.45, 9, 18, 9], [6, 0, 6, 9], [12, 0, 12, 9],
        [0, 4.5, 4.55, 4.5], [5.45, 4.5, 6, 4.5], [12, 4.5, 12.55, 4.5], [13.45, 4.5, 18, 4.5]]  # fmt: skip
"""Rooms behind rooms, with doors of 0.9 m, south of a corridor."""


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


@pytest.mark.compiles
@pytest.mark.slow
def test_a_goal_that_a_corner_hides_again_from_a_body_on_its_way_is_not_left_to_the_algorithm(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else it goes back by VisBug, sees its goal, comes round the corner, sees it no more, and so on."""
    turned = []
    turn_to = Seeker._turn_to

    def noted(self: Seeker, target: Target, *rest: object) -> None:
        turned.append(target)
        turn_to(self, target, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(Seeker, "_turn_to", noted)
    for start in ([20.0, 9.6], [19.0, 9.9], [18.0, 10.2], [17.0, 10.6]):
        turned.clear()
        metrics = simulate(scene(CORNERS, [start], [[[10.5, 13.25]]], (2, 5, 28, 19)), 1).metrics
        assert metrics["targets_reached"] == 1.0
        assert set(turned) == {Target.GOAL}


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
    targets = [[[15.0, 2.25], [9.0, 4.5], [3.0, 6.75], [15.0, 6.75], [3.0, 2.25]]]
    steps = []
    for slack_m in (0.0005, 0.002, 0.02):
        monkeypatch.setattr(spec, "LOOPS_SLACK_M", slack_m)
        metrics = simulate(scene(WING, [[3.0, 2.25]], targets, (0, 0, 18, 11)), 1).metrics
        assert metrics["targets_reached"] == 5.0
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
