"""What exploration checks before it begins, where it puts a team, and what it tells the machines."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import shapely

from cosim.errors import UserError
from cosim.navigation.frontier_fields import sum_of_frontiers, sum_of_obstacles
from cosim.protocol import Surroundings
from cosim.units import MS
from protocols.exploration import spec
from protocols.exploration.events import Counters
from protocols.exploration.parameters import Parameters
from protocols.exploration.setup import prepare
from protocols.exploration.spec import SPEC, place


@dataclass
class Counted:
    """A machine that has counted."""

    counters: Counters


WALL = [[4.0, 0.0, 4.0, 3.0]]


def around(*starts: tuple[float, float], **more: Any) -> Surroundings:
    plain = {
        "starts_m": starts,
        "radius_m": 0.2,
        "speed_mps": 0.3,
        "acceleration_mps2": 1.0,
        "tick": 100 * MS,
        "walls_m": np.array(WALL),
        "bounds_m": (0.0, 0.0, 8.0, 4.0),
        "forbidden": lambda points: ~shapely.contains_xy(shapely.box(0.0, 0.0, 8.0, 4.0), points),
        "scan_range_m": 2.5,
        "beams": 90,
    }
    return Surroundings(**(plain | more))


def test_machines_are_told_what_their_range_scanners_are_like() -> None:
    setup = prepare(Parameters(), around((1.0, 1.0), scan_range_m=3.5, beams=120))
    assert (setup.range_m, setup.beams) == (3.5, 120)


@pytest.mark.parametrize(
    ("range_m", "message"),
    [
        (0.6, r"protocol\.parameters\.schemas\.obstacle_m: 0\.6 is not < 0\.6, team\.senses\.beam_range_m"),
        (5.0, r"protocol\.parameters\.schemas\.frontier_m: 5\.0 is not > 5\.0, team\.senses\.beam_range_m"),
    ],
)
def test_obstacles_repel_within_the_scanners_range_and_frontiers_attract_beyond_it(
    range_m: float, message: str
) -> None:
    with pytest.raises(UserError, match=message):
        prepare(Parameters(), around((1.0, 1.0), scan_range_m=range_m))
    prepare(Parameters(), around((1.0, 1.0), scan_range_m=0.61))
    prepare(Parameters(), around((1.0, 1.0), scan_range_m=4.99))


def test_a_floor_of_too_many_cells_is_refused() -> None:
    with pytest.raises(UserError, match=r"protocol\.parameters\.cell_m: 4002 x 2002 cells, at most"):
        prepare(Parameters(cell_m=0.002), around((1.0, 1.0)))


def test_robots_share_one_map_or_have_one_each() -> None:
    for way, same in (("shared", True), ("messages", False)):
        parameters = Parameters.model_validate({"map": way})
        setup = prepare(parameters, around((1.0, 1.0), (2.0, 1.0)))
        first, second = (SPEC.make(parameters, setup, robot, None, 0) for robot in range(2))
        assert (first.belief is second.belief) == same  # type: ignore[attr-defined]


@pytest.mark.parametrize("seed", range(10))
def test_a_team_is_put_where_it_has_room_on_one_side_of_walls(seed: int) -> None:
    starts = place(Parameters(), around(), 5, np.random.default_rng(seed))
    bodies = shapely.buffer(shapely.points(starts), 0.2 * 1.2)
    wall = shapely.LineString([(4.0, 0.0), (4.0, 3.0)])
    assert len(starts) == 5
    assert shapely.contains(shapely.box(0.0, 0.0, 8.0, 4.0), bodies).all()
    assert not shapely.intersects(bodies, wall).any()
    assert not any(shapely.LineString([starts[0], other]).intersects(wall) for other in starts)
    apart = np.array(starts)[:, None] - np.array(starts)[None]
    assert np.sort(np.hypot(*apart.T).reshape(-1))[5:].min() > 2 * 0.2


def test_a_floor_without_room_for_the_team_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spec, "ATTEMPTS", 100)
    tiny = around(
        bounds_m=(0.0, 0.0, 1.3, 1.3),
        forbidden=lambda points: ~shapely.contains_xy(shapely.box(0, 0, 1.3, 1.3), points),
    )
    with pytest.raises(UserError, match=r"team\.starts: found no place"):
        place(Parameters(), tiny, 4, np.random.default_rng(1))


def test_the_strongest_schemas_are_counted_as_shares_of_the_steps_in_which_any_led() -> None:
    first, second = Counters(), Counters()
    for frontiers, obstacles, robots in ((3.0, 1.0, 2.0), (1.0, 1.0, 0.5), (1.0, 2.0, 2.0)):
        first.drawn(frontiers, obstacles, robots)
    second.drawn(0.1, 0.2, 0.3)
    shares = [Counted(counters) for counters in (first, second)]
    measured = SPEC.measure(shares)
    found = [measured[f"share_{schema}"] for schema in ("frontier", "obstacle", "robot")]
    assert found == [0.5, 0.25, 0.25]
    assert math.isnan(SPEC.measure([Counted(Counters())])["share_frontier"])


def test_the_default_gain_turns_a_robot_away_from_a_wall_ahead_that_a_path_leads_to() -> None:
    """A line of path cells from d_obstacle on, straight through a wall, against that wall where it must begin to turn.

    Then its turn, of a radius of speed over rate, ends beside the wall: both from the fields as they are computed.
    """
    parameters, cell, radius = Parameters(), 0.1, 0.25
    schemas, steering = parameters.schemas, parameters.steering
    away = radius + steering.speed_mps / steering.turn_radps + steering.speed_mps * 0.1
    n = 120
    x, y = 0.5 * n * cell, 0.5 * n * cell + 0.5 * cell
    column = round((x + away) / cell)  # the wall's near edge
    x = column * cell - away
    evidence, path = np.zeros((n, n), np.int8), np.zeros((n, n), np.uint8)
    evidence[:, column] = 127
    centres = (np.arange(n) + 0.5) * cell
    path[n // 2, (centres >= x + schemas.obstacle_m) & (centres <= x + schemas.frontier_m)] = 1
    drawn = schemas.frontier_gain * sum_of_frontiers(path, 0.0, 0.0, cell, x, y, schemas.frontier_m)[0]
    repelled = schemas.obstacle_gain * sum_of_obstacles(evidence, 0.0, 0.0, cell, x, y, schemas.obstacle_m, False)[0]
    assert 0.0 < drawn < repelled
    assert drawn == pytest.approx(1.0 / (cell * schemas.obstacle_m), rel=0.2)
