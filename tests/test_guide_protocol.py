"""What the guide to protocols promises of links holds; its blocks are executed in ``test_handbook.py``."""

import pytest

from cosim.scenario import load
from cosim.simulation import simulate
from tests.checkout import ROOT

ELECTION = ROOT / "examples" / "election"


@pytest.fixture(autouse=True)
def _where_its_author_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ELECTION))


def elected(kind: str, *sets: str) -> dict[str, float]:
    sets = (f"channel.kind={kind}", "faults=[]", "duration_s=40", *sets)
    outcome = simulate(load(ELECTION / "election.yaml", sets), 1)
    assert bool(outcome.notices) == (outcome.metrics["payloads_unsent"] > 0)
    return outcome.metrics


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ideal", "optical", "adhoc", "bluetooth"])
def test_a_transport_with_links_runs_over_all_channels(kind: str) -> None:
    metrics = elected(kind, "protocol.parameters.transport.links={}")
    assert metrics["leaders"] == 1
    assert metrics["payloads_unsent"] == 0


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "leaders"), [("ideal", 1), ("optical", 1), ("adhoc", 1), ("bluetooth", 5)])
def test_only_bluetooth_needs_the_links(kind: str, leaders: int) -> None:
    metrics = elected(kind)
    assert metrics["leaders"] == leaders
    assert (metrics["payloads_unsent"] > 0) == (kind == "bluetooth")
