"""A box canyon: the potential field alone stalls in it; a helper on patrol leads out, by state sharing only."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.scenario import Scenario, build
from cosim.simulation import simulate

DURATION_S = 300.0
CANYON = [[3, 5, 5, 5], [5, 5, 5, 3], [5, 3, 3, 3]]
"""Open to the left; the explorer starts in it, and its goal lies behind its end."""
ROUNDS = {
    "past the mouth and round the canyon": [[2, 4], [2, 6.5], [8, 6.5], [8, 1.5], [2, 1.5]],
    "to and fro past the mouth, and up beside it": [[2, 2], [2, 6.5], [6, 6.5]],
}


def canyon(rounds: str, **parameters: object) -> Scenario:
    plain = {
        "duration_s": DURATION_S,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 12, 8], "walls": CANYON},
        "team": {
            "size": 2,
            "body": {"drive": "omni", "speed_mps": 1.0},
            "starts": [[4.0, 4.0], ROUNDS[rounds][0]],
            "senses": {"frames": "own"},
        },
        "channel": {"kind": "optical"},
        "protocol": {
            "use": "reflection",
            "parameters": {"targets": [[[8.0, 4.0]]], "patrols": [ROUNDS[rounds]], "patrol": "cycle", **parameters},
        },
    }
    return build(plain, "canyon", Path())


def times(count: int, rounds: str, **parameters: object) -> list[float]:
    """Return how long the explorers of so many runs took that have reached their goal, in seconds."""
    outcomes = [simulate(canyon(rounds, **parameters), seed).metrics for seed in range(count)]
    return [outcome["simulated_s"] for outcome in outcomes if outcome["targets_reached"] == 1.0]


NOTHING: dict[str, Any] = {"share_goals": False, "share_states": False}


@pytest.mark.slow
@pytest.mark.parametrize("rounds", ROUNDS)
def test_the_potential_field_alone_stalls_and_with_state_sharing_it_gets_out(
    rounds: str, record_property: Callable[[str, object], None]
) -> None:
    """The helper drives by all the same; what it says is the difference."""
    assert times(5, rounds, **NOTHING) == []
    out = times(20, rounds, share_goals=False, share_states=True)
    record_property("robots out of a canyon by state sharing, of 40", len(out))
    record_property("seconds that they took, all together", round(sum(out)))
    assert len(out) >= 18
    assert 8.0 < np.median(out) < 100.0


@pytest.mark.slow
def test_with_avoid_past_it_gets_out_by_itself(record_property: Callable[[str, object], None]) -> None:
    (rounds, *_) = ROUNDS
    out = times(20, rounds, algorithm="avoid_past", **NOTHING)
    record_property("robots out of a canyon by Avoid Past, of 20", len(out))
    record_property("seconds that these took, all together", round(sum(out)))
    assert len(out) >= 18
    assert 8.0 < np.median(out) < 100.0
