"""A sub-team over radios that carry nothing without a link."""

from pathlib import Path
from typing import Any

import pytest

from cosim.errors import UserError
from cosim.scenario import Scenario, build
from cosim.simulation import simulate

ROOMS = Path(__file__).parents[3] / "experiments" / "floors" / "rooms_50.yaml"


def search(channel: dict[str, Any], searchers: int = 2, **parameters: Any) -> Scenario:
    plain = {
        "duration_s": 400,
        "floorplan": {"map": str(ROOMS)},
        "team": {
            "sight_range_m": 20,
            "senses": {"camera_period_s": 1.0},
            "groups": [
                {"size": 1, "body": {"radius_m": 0.25, "speed_mps": 0.5, "drive": "differential"}},
                {"size": searchers, "body": {"radius_m": 0.25, "speed_mps": 1.0, "drive": "differential"}},
            ],
        },
        "channel": channel,
        "protocol": {"use": "aggregation", "parameters": {"long_radio": 0, "links": {}} | parameters},
    }
    return build(plain, "search", Path())


@pytest.mark.parametrize("kind", ["bluetooth", "ble"])
def test_a_search_over_links_ends_as_it_does_without(kind: str) -> None:
    at_once = simulate(search({"kind": "ideal", "range_m": 20}, links=None), 1).metrics
    metrics = simulate(search({"kind": kind, "range_m": 20}), 1).metrics
    assert metrics["completed"] == at_once["completed"] == 1
    assert metrics["payloads_unsent"] == 0
    assert abs(metrics["search_time_min"] - at_once["search_time_min"]) < 1 / 60
    assert metrics["frames"] > 100


def test_searchers_out_of_reach_are_paged_again() -> None:
    metrics = simulate(search({"kind": "bluetooth", "range_m": 12, "supervision_s": 2}), 1).metrics
    assert metrics["completed"] == 1
    assert metrics["contacts"] > 0  # they were away, and have met their host again


def test_more_hosts_or_robots_than_a_piconet_has_are_refused() -> None:
    with pytest.raises(UserError, match=r"parameters.hosts: 2 is not 1, and links are"):
        search({"kind": "bluetooth"}, searchers=4, hosts=2)
    with pytest.raises(UserError, match=r"^protocol.parameters.links: 9 robots, a piconet has at most 8$"):
        simulate(search({"kind": "bluetooth"}, searchers=8), 1)
