"""What the trace of an exploration tells of its escapes, by a trace that is written by hand."""

import math
from typing import Any, ClassVar

import pytest

from cosim.units import S
from experiments.exploration.exploring import Partings, told

END_S = 60


class Written:
    """Two robots 1 m apart, of which one drives off at 0.1 m/s, and a third in between them and far away."""

    EVENTS: ClassVar = [
        ("Stalled", 0, 1, "no force"),
        ("PathLaid", 0, 1, None),
        ("PathLeft", 20, 1, "frontier in sight"),
        ("Stalled", 20, 2, "no way made"),
        ("PathLaid", 20, 2, None),
        ("PathLeft", 24, 2, "stalled"),
        ("PathLaid", 24, 2, None),
        ("PathLeft", 60, 2, "walked"),
    ]

    def columns(self, table: str) -> dict[str, list[Any]]:
        if table == "events":
            events, times, sources, whys = zip(*self.EVENTS, strict=True)
            return {"event": events, "time_ns": [t * S for t in times], "source": sources, "why": whys}  # type: ignore[dict-item]
        at = [(t, robot) for t in range(END_S + 1) for robot in range(3)]
        return {
            "time_ns": [t * S for t, _ in at],
            "source": [robot for _, robot in at],
            "x_m": [(0.0, 1.0 + 0.1 * t, 0.5)[robot] for t, robot in at],
            "y_m": [(0.0, 0.0, 100.0)[robot] for t, robot in at],
        }


def found(**asked: Any) -> dict[str, float]:
    return told(Written(), Partings(**asked))  # type: ignore[arg-type]


def test_paths_that_a_robot_stalled_on_have_not_led_on() -> None:
    assert found()["paths"] == 3
    assert found()["paths_led_on"] == pytest.approx(2 / 3)
    assert found()["stalls_no_force"] == 1


def far(t: float) -> float:
    """Return how far robot 2 is from the nearest of the others."""
    return min(math.hypot(0.5, 100.0), math.hypot(0.5 + 0.1 * t, 100.0))


def test_robots_part_from_a_path_laid_and_else() -> None:
    """Robot 1 from its path: 3 m in 30 s; robot 0 on none: 3 m twice; robot 1 from 30 s on: 3 m."""
    both = found()
    assert both["parted_by_escape_m"] == pytest.approx((3.0 + (far(50) - far(20)) + (far(54) - far(24))) / 3)
    assert both["parted_else_m"] == pytest.approx(3.0)


def test_the_time_and_how_near_another_was_are_parameters() -> None:
    assert found(near_m=2.0)["parted_by_escape_m"] == pytest.approx(3.0)
    assert found(near_m=0.9)["parted_by_escape_m"] != found(near_m=0.9)["parted_by_escape_m"]  # NaN: of nobody
    assert found(near_m=2.0, later_s=10)["parted_by_escape_m"] == pytest.approx(1.0)
    assert found(near_m=1.5, later_s=10)["parted_else_m"] == pytest.approx(1.0)
