"""What the tests of the page share: consoles that answer as a test says, and one server of the page."""

from collections.abc import Iterator
from typing import Any

import pytest

from cosim.scenario import Scenario
from cosim.simulation import simulate
from tests.protocols.deployment.operator.page.consoles import Consoles, Still
from tests.protocols.deployment.operator.page.hand import PAGE, ready
from tests.web.browser import Browser, tab
from tests.web.console import PLAIN
from tests.web.served import Served


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


@pytest.fixture(scope="session")
def server() -> Iterator[Served]:
    made = Served(Still(Consoles()), page=PAGE)
    yield made
    made.stop()


@pytest.fixture
def served(server: Served, still: Still) -> Served:
    """Return the server, which serves another session to each test."""
    server.wait_for(0)
    server.server.session = still
    return server


@pytest.fixture
def page(browser: Browser, served: Served) -> Iterator[Any]:
    """Open the page, which knows plays and team then."""
    with tab(browser, served) as page:
        ready(page)
        yield page
