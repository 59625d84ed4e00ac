"""Hosts and searchers keep the laws of machines, with every strategy, from the start and after a reboot."""

from collections.abc import Callable
from typing import Any

import pytest

from cosim.machine import Address, LinkEvent, Machine, Outgoing, Reception, Role
from cosim.machine import Connected, Lost
from cosim.randomness import Streams
from cosim.testing import check_machine
from cosim.units import S, Time
from protocols.aggregation import spec
from protocols.aggregation.frames import encode
from protocols.aggregation.journal import BadBytes
from protocols.aggregation.messages import Confirm, Hello
from tests.aggregation.team_scene import STRATEGIES, Alone, prepared

STARTS_M = [(9.5, 9.0), (10.5, 9.0), (9.5, 10.4), (10.0, 10.4), (10.5, 10.4)]
"""Two hosts, three searchers, close together."""
HASTY: dict[str, Any] = {
    "long_radio": 0,
    "muster_s": 0.3,
    "heartbeat_s": 0.4,
    "fresh_s": 0.9,
    "reconvene_s": 0.8,
    "sync_s": 0.8,
    "suspect_s": 0.5,
    "timeout_s_per_m2": 0.004,
}
"""A search that goes through its stages within seconds; who checks the laws knows of no second radio."""


def maker(strategy: str, hosts: int = 2, later: Time = 0, **changes: Any) -> Callable[[Address, Time], Machine]:
    """Return what makes the machines of a team, *later* than it is asked to."""
    parameters, knowledge = prepared(STARTS_M, strategy, hosts, **{**HASTY, **changes})

    def make(me: Address, start: Time) -> Machine:
        return spec.SPEC.make(parameters, knowledge, me, Streams(1)("machine", me), start + later)

    return make


@pytest.fixture
def nobody_has_booted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have all machines begin the search, whenever they start: those who start late would take themselves for booted."""
    for kind in (spec.Host, spec.Searcher):
        monkeypatch.setattr(spec, kind.__name__, lambda *given, kind=kind: kind(*given[:-1], False))


@pytest.mark.slow
@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.usefixtures("nobody_has_booted")
def test_a_team_that_begins_keeps_the_laws(strategy: str) -> None:
    check_machine(maker(strategy), STARTS_M, 4 * S)


@pytest.mark.slow
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_a_team_of_machines_that_have_booted_keeps_the_laws(strategy: str) -> None:
    check_machine(maker(strategy, later=S), STARTS_M, 4 * S)


@pytest.mark.slow
@pytest.mark.parametrize("detector", ["nfd_s", "nfd_e", "phi_akka", "phi_normal"])
@pytest.mark.usefixtures("nobody_has_booted")
def test_teams_keep_the_laws_with_every_detector(detector: str) -> None:
    check_machine(maker("mi", detector={"kind": detector}), STARTS_M, 3 * S)


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["srp", "random"])
@pytest.mark.usefixtures("nobody_has_booted")
def test_a_single_host_with_a_person_in_its_team_keeps_the_laws(strategy: str) -> None:
    check_machine(maker(strategy, hosts=1, humans=(3,)), STARTS_M, 4 * S)


# ---------------------------------------------------------------- what machines make of strange inputs


def test_a_searcher_takes_no_orders_of_another_searcher_nor_of_a_host_that_is_not_there() -> None:
    searcher = Alone(2, STARTS_M)
    beat = spec.SPEC.make(*prepared(STARTS_M), 0, Streams(1)("machine", 0), 0)
    beat.wake(S)
    heartbeats = [item.payload for item in beat.outbox() if isinstance(item, Outgoing)]
    for sender in (3, 4, 5, 255):
        forged = bytes([*heartbeats[0][:2], sender, *heartbeats[0][3:-2]])
        assert searcher.hears(sender, Confirm(7)) == []
        searcher.machine.receive(forged, Reception(sender, True), searcher.now)
    assert searcher.machine.membership.host == 0
    assert searcher.machine.outbox() == []
