"""The walk in CONTRIBUTING through an example shows its lines, and what it promises of links and of laws holds."""

import re
from textwrap import indent

import pytest

from cosim.scenario import load
from cosim.simulation import simulate
from tests.checkout import ROOT

CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
ELECTION = ROOT / "examples" / "election"
*SHOWN, CHECK = re.findall(r"```python\n(.*?)```", CONTRIBUTING, re.DOTALL)


@pytest.fixture(autouse=True)
def _where_its_author_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ELECTION))


def test_the_walk_shows_the_lines_of_the_example_in_their_order() -> None:
    source = (ELECTION / "leader_election.py").read_text(encoding="utf-8")
    places = [max(source.find(lines), source.find(indent(lines, "    "))) for lines in SHOWN]
    assert min(places) > 0
    assert places == sorted(places)
    assert len(places) >= 5
    assert all(len(lines.splitlines()) <= 20 for lines in SHOWN)


@pytest.mark.slow
def test_the_lines_that_check_the_machine_do_so() -> None:
    assert "check_machine(" in CHECK
    exec(CHECK, {})  # our own page


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
