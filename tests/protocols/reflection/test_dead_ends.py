"""Dead ends for Avoid Past alone, by MissionLab's gains as they are, and by ours: who comes to its goal within an hour.

One room with a U across the way to the goal, and a closed room whose one door, 2 m wide, is on the side that is away
from the goal. MissionLab's numbers are those of GoTo_AvoidPast (reference algorithms 5.2). There the sphere is what
lies beyond the margin, and every reading of a scan repels by its own: with n beams its gain is ours divided by n / pi.
"""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from cosim.report.drawing import tracks
from cosim.scenario import Scenario, build
from cosim.simulation import Simulation, simulate
from cosim.trace import POSES
from tests.tiers import soak_count

HOUR_S = 3600.0
BEAMS = 24
FIRST_SEED = 900_001
"""The first of the seeds that no experiment uses."""
# a robot stands in each with its goal to the right, 3 m behind the wall that it heads for
SCENES: Mapping[str, Any] = {
    "a U in a room": [[4, 4, 8, 4], [8, 4, 8, 8], [8, 8, 4, 8]],
    "a room with a door of 2 m": [[4, 3, 10, 3], [10, 3, 10, 9], [10, 9, 4, 9], [4, 3, 4, 5], [4, 7, 4, 9]],
}
STARTS: Mapping[str, tuple[float, float]] = {"a U in a room": (6.0, 6.0), "a room with a door of 2 m": (7.0, 6.0)}
GOALS: Mapping[str, tuple[float, float]] = {"a U in a room": (12.0, 6.0), "a room with a door of 2 m": (13.0, 6.0)}
MISSIONLAB: Mapping[str, float] = {
    "goal_gain": 0.25,
    "avoid_gain": BEAMS / math.pi,
    "avoid_margin_m": 0.5,
    "avoid_sphere_m": 0.5 + 1.4,
    "noise_gain": 0.0,
    "past_gain": 1.0,
    "past_ceiling": 100.0,
    "horizon_m": 1.0,
    "mark_m": 1.0,
}
OURS: Mapping[str, float] = {}


def dead_end(scene: str, algorithm: str, frames: str = "own", **gains: float) -> Scenario:
    plain = {
        "duration_s": HOUR_S,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 16, 12], "walls": SCENES[scene]},
        "team": {
            "size": 1,
            "sight_range_m": 12,
            "body": {"radius_m": 0.2, "speed_mps": 1.0, "acceleration_mps2": 100, "drive": "omni"},
            "starts": [STARTS[scene]],
            "senses": {"frames": frames, "beams": BEAMS},
        },
        "channel": {"kind": "optical", "range_m": 12},
        "protocol": {
            "use": "reflection",
            "parameters": {
                "algorithm": algorithm,
                "targets": [[GOALS[scene]]],
                "give_up_s": HOUR_S - 1.0,
                algorithm: gains,
            },
        },
    }
    return build(plain, "dead end", Path())


def steps_out(scene: str, count: int, gains: Mapping[str, float]) -> list[float]:
    """Return how many motion steps the runs of *count* seeds took that came to the goal."""
    seeds = range(FIRST_SEED, FIRST_SEED + count)
    outcomes = [simulate(dead_end(scene, "avoid_past", **gains), seed).metrics for seed in seeds]
    return sorted(outcome["motion_steps"] for outcome in outcomes if outcome["targets_reached"] == 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
def test_the_potential_field_alone_does_not_get_out(scene: str) -> None:
    """Else there would be nothing to get out of; ten minutes, as it stands still for nearly all of them."""
    scenario = dead_end(scene, "potential_field")
    short = scenario.model_copy(update={"duration_s": 600.0})
    assert simulate(short, FIRST_SEED).metrics["targets_reached"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
def test_by_missionlab_s_gains_avoid_past_gets_out(scene: str) -> None:
    out = steps_out(scene, 3, MISSIONLAB)
    assert len(out) == 3
    assert out[0] > 60.0  # no way is shorter
    assert out[-1] < 1500.0


@pytest.mark.slow
def test_by_our_gains_avoid_past_gets_out() -> None:
    assert len(steps_out("a U in a room", 2, OURS)) == 2


@pytest.mark.slow
def test_without_noise_a_robot_on_the_axis_of_a_dead_end_has_no_reason_to_turn() -> None:
    """Why not every seed gets out if readings do not add up as MissionLab's do: goal, wall and past are symmetric.

    The robot steps to and fro on the wall's normal, and the push of its own marks has no sideways part. Noise has.
    """
    gains = {**MISSIONLAB, "avoid_gain": 1.0}
    still = dead_end("a U in a room", "avoid_past", "world", **gains).model_copy(update={"duration_s": 120.0})
    run = Simulation(still, FIRST_SEED, (POSES,))
    outcome = run.run()
    way = tracks(outcome.trace)[0]
    assert outcome.metrics["targets_reached"] == 0.0
    assert abs(way[:, 2] - 6.0).max() < 1e-9
    assert 7.0 < way[-600:, 1].min() < way[-600:, 1].max() < 8.0
    noisy = dead_end("a U in a room", "avoid_past", "world", **gains | {"noise_gain": 0.1})
    assert simulate(noisy, FIRST_SEED).metrics["targets_reached"] == 1.0


@pytest.mark.soak
@pytest.mark.parametrize("gains", ["MissionLab's", "ours"])
@pytest.mark.parametrize("scene", SCENES)
def test_avoid_past_gets_out_with_every_seed(
    scene: str, gains: str, record_property: Callable[[str, object], None]
) -> None:
    count = soak_count(100)
    out = steps_out(scene, count, MISSIONLAB if gains == "MissionLab's" else OURS)
    record_property(f"out of {scene} by {gains} gains, of {count}", len(out))
    record_property("motion steps in the middle, and at most", (out[len(out) // 2], out[-1]))
    assert len(out) == count
