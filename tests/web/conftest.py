"""What the tests of the web share: everything is compiled before anybody waits for it."""

import pytest

from cosim.scenario import Scenario
from cosim.simulation import simulate
from tests.web.console import PLAIN


@pytest.fixture(scope="session", autouse=True)
def compiled() -> None:
    """Make a run, so that no test's run waits for numba."""
    simulate(Scenario.model_validate(PLAIN), 1)
