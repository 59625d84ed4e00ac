"""What is noted of a robot that drives among others is what it took longer than alone on the same floor."""

import pytest

from protocols.deployment.driving_parameters import DrivingParameters
from tests.deployment.driving_scene import body, box, line
from tests.deployment.hindrance_scene import Hindered

CORRIDOR = box(30.0, 2.4)
BEND = [*box(14.0, 14.0), *line((2.4, 14.0), (2.4, 2.4), (14.0, 2.4))]
ROOMS = [*box(12.0, 6.0), *line((6.0, 0.0), (6.0, 2.4)), *line((6.0, 3.6), (6.0, 6.0))]
OPEN_EYES = DrivingParameters(blind_corners=False)
ALONE = [
    pytest.param(CORRIDOR, (1.2, 1.2), (28.0, 1.2), id="corridor"),
    pytest.param(BEND, (1.2, 12.0), (12.0, 1.2), id="bend"),
    pytest.param(ROOMS, (2.0, 1.0), (10.0, 5.0), id="door"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("walls", "start", "goal"), ALONE)
@pytest.mark.parametrize("heading_rad", [0.0, 2.5])
def test_a_robot_alone_orders_what_its_double_does(walls, start, goal, heading_rad) -> None:  # type: ignore[no-untyped-def]
    scene = Hindered(walls, [start], headings=heading_rad)
    scene.time_to(0, goal)
    mover = scene.movers[0]
    assert len(mover.orders) > 50
    assert all(abs(speed - free) < 1e-12 for speed, free in mover.orders)
    assert mover.shortfall.lost_s < 1e-9


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
