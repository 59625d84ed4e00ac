"""What aggregation refuses before a run, and where it puts robots."""

import math
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from cosim.errors import UserError
from cosim.protocol import Surroundings
from cosim.scenario import build
from cosim.simulation import Simulation
from cosim.units import MS
from protocols.aggregation.parameters import Parameters
from protocols.aggregation.spec import SPEC, _around


@pytest.mark.parametrize(("hosts", "radios", "fits"), [(2, (0,), False), (2, (0, 1), True), (1, (0,), True)])
def test_several_hosts_need_the_radio_between_them(hosts: int, radios: tuple[int, ...], fits: bool) -> None:
    plain = {"strategy": "mi", "hosts": hosts, "targets": [[5, 5]]}
    around = Surroundings(
        starts_m=((2.0, 2.0), (4.0, 2.0), (6.0, 2.0)),
        radius_m=0.25,
        speed_mps=1.0,
        acceleration_mps2=1.0,
        tick=100 * MS,
        walls_m=np.zeros((0, 4)),
        bounds_m=(0.0, 0.0, 10.0, 10.0),
        forbidden=lambda points: np.zeros(len(points), bool),
        radios=(radios,) * 3,
    )
    told = (
        nullcontext() if fits else pytest.raises(UserError, match=r"long_radio: 1 is none of the radios of host 0: 0$")
    )
    with told:
        SPEC.prepare(Parameters.model_validate(plain), around)


def test_a_floor_of_too_many_cells_is_refused_before_it_is_divided() -> None:
    wide = {"map": "walls", "bounds_m": [0, 0, 1e6, 10]}
    with pytest.raises(
        UserError, match=r"^protocol\.parameters\.cell_m: 0\.5 makes 2000000 x 20 cells of this floor, exp"
    ):
        Simulation(build({"duration_s": 1, "floorplan": wide, "protocol": {"use": "aggregation"}}, "wide", Path()), 1)


def test_places_about_a_middle_come_nearest_first() -> None:
    points = list(_around((1.0, 2.0), 0.5, 30))
    assert len(points) == len(set(points)) == 61 * 61
    assert points == sorted(points, key=lambda point: (math.dist(point, (1.0, 2.0)), point))
