"""What the tests of the web share: all is compiled before a test waits for it, and a session that stands still."""

import pytest

from cosim.scenario import Scenario
from cosim.simulation import simulate
from tests.protocols.deployment.operator.page.consoles import Consoles, Still
from tests.web.console import PLAIN


@pytest.fixture(scope="session", autouse=True)
def compiled() -> None:
    """Make a run, so that no test's run waits for numba."""
    simulate(Scenario.model_validate(PLAIN), 1)


@pytest.fixture
def consoles() -> Consoles:
    return Consoles()


@pytest.fixture
def still(consoles: Consoles) -> Still:
    return Still(consoles)
