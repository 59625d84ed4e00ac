"""The soak: random deployments end deployed, and touch nothing, with robots killed and orders lost."""

import os
from typing import Any

import pytest

from tests.deployment.soak_scene import drawn, judged

RUNS = 300
SHARE = float(os.environ.get("SOAK_SHARE", "1"))


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(max(1, round(RUNS * SHARE))))
def test_a_random_deployment_ends_deployed_and_touches_nothing(seed: int, record_property: Any) -> None:
    case = drawn(seed)
    record_property("random deployments through the whole stack", 1)
    verdict = judged(case, seed)
    assert verdict.complaints == [], case.faults
