"""What is noted of a robot that drives among others is what it took longer than alone on the same floor."""

from typing import Any

import numpy as np
import pytest

from cosim.robots.senses import SenseSettings
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from protocols.motion.floor import Floor
from protocols.motion.parameters import DrivingParameters
from tests.protocols.deployment.crew_scene import STARTS_M, call, scenario
from tests.protocols.deployment.driving_scene import body, box, line
from tests.protocols.deployment.hindrance_scene import Hindered, Watched

CORRIDOR = box(30.0, 2.4)
BEND = [*box(14.0, 14.0), *line((2.4, 14.0), (2.4, 2.4), (14.0, 2.4))]
ROOMS = [*box(12.0, 6.0), *line((6.0, 0.0), (6.0, 2.4)), *line((6.0, 3.6), (6.0, 6.0))]
ALONE = [
    pytest.param(CORRIDOR, (1.2, 1.2), (28.0, 1.2), (), 0.0, id="corridor"),
    pytest.param(BEND, (1.2, 12.0), (12.0, 1.2), (), 2.5, id="bend"),
    pytest.param(ROOMS, (2.0, 1.0), (10.0, 5.0), (), 2.5, id="door"),
    pytest.param(ROOMS, (2.0, 1.0), (10.0, 5.0), ((4.5, 5.0), (1.5, 5.0)), 0.0, id="way points"),
    pytest.param(ROOMS, (2.0, 1.0), (1.8, 1.3), (), 0.0, id="a goal near by, behind it"),
    pytest.param(ROOMS, (0.28, 1.0), (10.0, 5.0), (), 3.1, id="from too near to a wall"),
    pytest.param(ROOMS, (5.65, 1.0), (6.35, 1.0), (), 0.0, id="round the end of a wall"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("walls", "start", "goal", "via", "heading_rad"), ALONE)
def test_a_robot_alone_orders_what_its_double_does(walls, start, goal, via, heading_rad) -> None:  # type: ignore[no-untyped-def]
    scene = Hindered(walls, [start], [body(radius_m=0.26)], headings=heading_rad)
    scene.time_to(0, goal, via_m=via)
    goes_as_its_double(scene.movers[0])


@pytest.mark.slow
def test_what_is_not_on_the_map_and_no_robot_is_in_the_doubles_way_too() -> None:
    parameters = DrivingParameters()
    known = Floor(np.array(box(12.0, 6.0), np.float64), (0.0, 0.0, 12.0, 6.0), None, parameters)
    pillar = line((5.0, 3.15), (5.5, 3.15), (5.5, 4.0), (5.0, 4.0), (5.0, 3.15))
    senses = SenseSettings(beams=90, beam_range_m=5.0)
    scene = Hindered([*box(12.0, 6.0), *pillar], [(1.0, 3.0)], parameters=parameters, senses=senses, floor=known)
    scene.movers[0].go((10.0, 3.0))
    scene.run(20.0)
    assert scene.movers[0].state == "stuck"
    goes_as_its_double(scene.movers[0])


def goes_as_its_double(mover: Watched) -> None:
    assert len(mover.orders) > 20
    assert any(speed > 0.0 for speed, _ in mover.orders)
    assert all(speed == free for speed, free in mover.orders)
    assert mover.shortfall.lost_s == mover.shortfall.hindered_s == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("senses", "own"),
    [({}, {}), ({"odometry_slip": 0.05, "odometry_turn_rad": 0.1}, {"positioning": {"kind": "mcl"}})],
    ids=["told where it is", "localised"],
)
def test_a_robot_alone_in_a_run_loses_nothing(senses: dict[str, float], own: dict[str, Any]) -> None:
    """Also where its heading is corrected now and then, and its scanner meets what it takes for no wall."""
    told = scenario(starts=STARTS_M[:1], calls=[call(places=[(9.0, 4.5)])], interference=True, **own).model_dump()
    told["team"]["senses"] |= {"beams": 180, **senses}
    metrics = Simulation(Scenario.model_validate(told), 1).run().metrics
    assert metrics["deployed"] == 1.0
    assert metrics["under_way_s"] > 10.0
    assert metrics["interference_s"] == metrics["hindered_s"] == 0.0


@pytest.mark.slow
def test_who_follows_a_slower_one_loses_what_it_takes_longer() -> None:
    bodies = [body(speed_mps=0.2, acceleration_mps2=0.5), body(speed_mps=0.6, acceleration_mps2=0.5)]
    alone = Hindered(CORRIDOR, [(1.2, 1.2)], [bodies[1]]).time_to(0, (24.0, 1.2))
    scene = Hindered(box(30.0, 0.9), [(2.2, 0.45), (1.2, 0.45)], bodies)
    scene.movers[0].go((28.0, 0.45))
    together = scene.time_to(1, (24.0, 0.45))
    assert together > 2.5 * alone
    assert scene.movers[1].shortfall.lost_s == pytest.approx(together - alone, abs=0.05 * (together - alone))
    gone_m = float(scene.fleet.positions_m[0, 0]) - 2.2
    free_s = gone_m / 0.2 + 0.2 / (2 * 0.5)
    late_s = scene.now / 1e9 - free_s  # who is followed closely brakes for its follower, now and then
    assert 0.0 < late_s < 0.2 * free_s
    assert scene.movers[0].shortfall.lost_s == pytest.approx(late_s, abs=0.3)


@pytest.mark.slow
def test_who_is_stopped_for_a_while_loses_that_while() -> None:
    """A body that does not react stands in a corridor that is too narrow to pass; then it drives on."""
    alone = Hindered(box(20.0, 0.9), [(1.2, 0.45)]).time_to(0, (16.0, 0.45))
    scene = Hindered(box(20.0, 0.9), [(8.0, 0.45), (1.2, 0.45)])
    scene.dead = {0}
    scene.movers[1].go((16.0, 0.45))
    scene.run(40.0)
    assert scene.fleet.positions_m[1, 0] < 8.0 - 0.4
    scene.dead = set()
    scene.movers[0].go((18.5, 0.45))
    scene.run(120.0, scene.all_there)
    assert scene.all_there()
    together = len(scene.movers[1].orders) * 0.1
    assert together > alone + 20.0
    assert scene.movers[1].shortfall.lost_s == pytest.approx(together - alone, rel=0.05)
