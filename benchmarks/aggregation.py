"""What searches of ``experiments/aggregation_search`` cost: whole runs, their first ten minutes, a hundred robots."""

from collections.abc import Callable
from typing import Any

from benchmarks.workloads import FLOORS, Work
from cosim.documents import read_yaml
from cosim.scenario import Scenario
from cosim.simulation import Simulation

SWEEP = FLOORS.parent / "aggregation_search" / "sweep.yaml"
CROWD = (
    {"size": 20, "radios": [0, 1], "body": {"radius_m": 0.25, "speed_mps": 0.5, "drive": "differential"}},
    {"size": 80, "radios": [0], "body": {"radius_m": 0.25, "speed_mps": 1.0, "drive": "differential"}},
)
"""A hundred robots in sub-teams of five."""


def _scenario(**changes: Any) -> Scenario:
    plain = read_yaml(SWEEP)["scenario"] | changes
    return Scenario.model_validate(plain).placed(SWEEP.parent)


def searches(strategy: str, seconds: float | None = None) -> Callable[[int], Work]:
    """Return the work of one search with *strategy*, set-up included; of its first *seconds*, if they are given."""

    changes: dict[str, Any] = {} if seconds is None else {"duration_s": seconds}

    def prepare(seed: int) -> Work:
        parameters = {"hosts": 3, "strategy": strategy}
        return _run(_scenario(protocol={"use": "aggregation", "parameters": parameters}, **changes), seed)

    return prepare


def crowds(seed: int) -> Work:
    """A minute of a hundred robots that search."""
    parameters = {"hosts": 20, "strategy": "mi", "target_count": 10}
    team = {"sight_range_m": 20, "senses": {"camera_period_s": 1.0}, "groups": list(CROWD)}
    return _run(_scenario(duration_s=60, team=team, protocol={"use": "aggregation", "parameters": parameters}), seed)


def _run(scenario: Scenario, seed: int) -> Work:
    def work() -> float:
        Simulation(scenario, seed).run()
        return 1.0

    return work
