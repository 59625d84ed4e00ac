"""Hosts and searchers keep the laws of machines, with every strategy, from the start and after a reboot."""

from collections.abc import Callable
from typing import Any

import pytest

from cosim.machine import Address, Machine
from cosim.randomness import Streams
from cosim.testing import check_machine
from cosim.units import S, Time
from protocols.aggregation import spec
from protocols.aggregation.frames import bitmap, stamp
from protocols.aggregation.messages import (
    Assign,
    Confirm,
    Finding,
    Heartbeat,
    Hello,
    Join,
    Leave,
    Piece,
    Receipt,
    Report,
    Stop,
    Stopped,
)
from tests.protocols.aggregation.team_scene import STRATEGIES, Alone, prepared

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
    parameters, setup = prepared(STARTS_M, strategy, hosts, **{**HASTY, **changes})

    def make(me: Address, start: Time) -> Machine:
        return spec.SPEC.make(parameters, setup, me, Streams(1)("machine", me), start + later)

    return make


@pytest.fixture
def nobody_has_booted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have all machines begin the search, also those that start late: they would take themselves for booted."""
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
@pytest.mark.usefixtures("nobody_has_booted")
def test_a_team_whose_finds_wait_for_an_instant_keeps_the_laws() -> None:
    check_machine(maker("srp", report="appointed", integrate_s=1.0), STARTS_M, 2 * S)


@pytest.mark.slow
@pytest.mark.usefixtures("nobody_has_booted")
def test_a_team_whose_searchers_stream_keeps_the_laws() -> None:
    check_machine(maker("mi", stream_bytes_per_s=20_000.0), STARTS_M, 2 * S)


@pytest.mark.slow
@pytest.mark.usefixtures("nobody_has_booted")
def test_a_team_whose_robots_localise_keeps_the_laws() -> None:
    check_machine(maker("mi", beams=36, positioning={"kind": "mcl"}), STARTS_M, 2 * S)


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


def test_a_searcher_takes_no_orders_of_robots_that_lead_nobody() -> None:
    searcher = Alone(2, STARTS_M)
    beat = Heartbeat(1, stamp(0), 9.5, 9.0, 0, 1, 0, 0, True, False, False, ())
    for sender in (3, 4, 5, 255):
        for message in (beat, Stop(), Confirm(7), Leave(0), Assign(0, 1, (1,)), Receipt(1)):
            assert searcher.hears(sender, message) == []
    assert not searcher.machine.finished
    assert [type(each.message) for each in searcher.hears(0, beat)] == [Report, Hello]


def test_hosts_and_searchers_take_no_notice_of_what_is_meant_for_the_other_kind() -> None:
    searcher, host = Alone(2, STARTS_M), Alone(0, STARTS_M)
    for message in (Hello(0, 1.0, 1.0, 0, 0), Report(1, 0, (), b""), Join(9, 1.0, 1.0), Stopped(), Piece(b"x")):
        assert searcher.hears(0, message) == []
        assert host.hears(1, message) == []
    for message in (Stop(), Confirm(7), Assign(0, 1, (1,)), Receipt(1), Piece(b"x")):
        assert host.hears(2, message) == []
        assert host.hears(1, message) == []


def test_posts_and_targets_that_are_none_are_left_out() -> None:
    """A frame may name more of them than there are: that of another search, perhaps."""
    host, searcher = Alone(0, STARTS_M), Alone(2, STARTS_M)
    posts = len(host.setup.ground.posts_m)
    host.hears(2, Report(1, 0, (Finding(200, 1.0, 1.0), Finding(1, 17.0, 3.0)), bitmap([0, posts, posts + 40], 200)))
    assert host.machine.findings.targets.keys() == {1}
    assert host.machine.findings.visited == {0}
    searcher.passes(2.0)
    searcher.hears(0, Heartbeat(2, stamp(searcher.now), 9.5, 9.0, 0, 1, 0, 0, False, False, False, ()))
    searcher.hears(0, Assign(0, 1, (posts, posts + 5000)))
    searcher.passes(2.0)  # hosts have departed, and it would set out
    assert searcher.machine.state.value != "meet"  # it is in contact, and nothing is to be done
    assert set(searcher.orders) <= {STARTS_M[2]}


def test_robots_beyond_the_team_are_nobodys_members() -> None:
    host = Alone(0, STARTS_M)
    for stranger in (5, 77, 255):
        assert host.hears(stranger, Join(1, 0.0, 0.0)) == []
        assert host.hears(stranger, Hello(0, 0.0, 0.0, 0, 0)) == []
