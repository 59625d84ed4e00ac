"""The machines of a deployment keep the laws of machines, with either executive, as they deploy."""

import pytest

from cosim.machine import Drive
from cosim.observation import Observation
from cosim.testing import check_machine
from cosim.units import MS, S
from tests.protocols.deployment.crew_scene import STARTS_M, TICK, call, maker

QUICK = {"listen_s": 0.2, "news_s": 0.3}
"""For robots that are driven for a second: they call, plan, order, tell news three times, and drive, in that."""


@pytest.mark.slow
@pytest.mark.parametrize(("play", "executive"), [("deploy/group", "central"), ("deploy/leap-frog", "distributed")])
def test_robots_that_deploy_keep_the_laws(play: str, executive: str) -> None:
    check_machine(maker(calls=[call(play)], executive=executive, **QUICK), STARTS_M, S)


@pytest.mark.slow
def test_robots_over_links_and_without_any_sensors_keep_the_laws() -> None:
    check_machine(maker(wheels=False, calls=[call()], courier={"links": {}}, **QUICK), STARTS_M, 700 * MS)


def test_on_this_floor_they_drive_and_tell_each_other() -> None:
    """Else the laws would be kept by robots that do nothing."""
    make = maker(calls=[call()], **QUICK)
    host, others = make(0, 0), [make(robot, 0) for robot in (1, 2)]
    frames, ways = 0, []
    for tick in range(80):
        for machine in (host, *others):
            machine.observe(Observation(0.0, 0.0, 0.0, 0.0, True, False), tick * TICK)
        frames += len(host.outbox())
        ways += host.commands()
    assert frames > 10
    assert len({way.turn_radps for way in ways if isinstance(way, Drive) and way.speed_mps}) > 3
    assert host.counters.way_m > 1.0  # type: ignore[attr-defined]
