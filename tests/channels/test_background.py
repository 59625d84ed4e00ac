"""Pairs of stations in the background: what they carry, what they do to robots' radios, and what is refused."""

from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from cosim.errors import UserError
from cosim.scenario import Scenario, build
from cosim.simulation import Simulation
from cosim.trace import FRAMES, TRANSMISSIONS

LAW = {"propagation": {"model": "free_space", "walls": False}}
BLUETOOTH = {"kind": "bluetooth", **LAW}
WIFI = {"kind": "adhoc", "channel": 6, "rate_mbps": 11, **LAW}
LE = {"kind": "ble", **LAW}
WIFI_PAIR = {"radio": 1, "places_m": [[1, 1], [4, 1]], "payload_bytes": 1500, "interval_s": 0.005}


def scene(radios: list[dict[str, Any]], pairs: list[dict[str, Any]], **more: Any) -> Scenario:
    plain = {
        "duration_s": 10,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 12, 8]},
        "team": {"size": 3, "body": {"radius_m": 0.2, "drive": "grid"}},
        "channel": {"kind": "radios", "air": "shared", "radios": radios, "background": pairs},
        "protocol": {"use": "pseudonet", "parameters": {"algorithm": "boustrophedon"}},
        **more,
    }
    return build(plain, "scene", Path())


def frames(simulation: Simulation) -> pd.DataFrame:
    return pd.DataFrame(simulation.trace.columns(FRAMES.name))


def test_a_pair_sends_as_often_as_it_is_told_to() -> None:
    metrics = Simulation(scene([BLUETOOTH, WIFI], [WIFI_PAIR]), 3).run().metrics
    expected = 10 / 0.005
    assert abs(metrics["radio_1_background_sent"] - expected) < 4 * expected**0.5  # of Poisson's distribution
    assert metrics["radio_1_background_sent"] - 5 < metrics["radio_1_background_received"]
    assert metrics["radio_1_frames_sent"] >= 2 * metrics["radio_1_background_received"]  # each is acknowledged


@pytest.mark.parametrize("radio", [BLUETOOTH, LE], ids=["bluetooth", "ble"])
def test_pairs_of_radios_with_links_make_them_first(radio: dict[str, Any]) -> None:
    pair = {"radio": 1, "places_m": [[1, 1], [4, 1]], "payload_bytes": 200, "interval_s": 0.1}
    silent = {"use": "agents", "parameters": {}}
    scenario = scene([WIFI, radio], [pair], protocol=silent)
    metrics = Simulation(scenario, 3).run().metrics
    assert 30 < metrics["radio_1_background_received"] <= metrics["radio_1_background_sent"] < 150


def test_robots_are_disturbed_in_a_shared_air_only() -> None:
    shared = scene([BLUETOOTH, WIFI], [WIFI_PAIR])
    collided = {}
    for air in ("shared", "apart"):
        plain = shared.model_dump(mode="json")
        plain["channel"]["air"] = air
        simulation = Simulation(build(plain, air, Path()), 3, (FRAMES,))
        simulation.run()
        of_robots = frames(simulation).query("radio == 0")
        collided[air] = (of_robots["outcome"] == "collided").sum()
        assert len(of_robots) > 100
        assert set(of_robots["source"]) | set(of_robots["destination"]) <= {-1, 0, 1, 2}  # no robot hears a station
    assert collided["apart"] == 0
    assert collided["shared"] > 10


def test_in_an_air_apart_robots_do_as_they_would_without_stations() -> None:
    events = []
    for pairs in ([], [WIFI_PAIR]):
        plain = scene([BLUETOOTH, WIFI], pairs).model_dump(mode="json")
        plain["channel"]["air"] = "apart"
        simulation = Simulation(build(plain, "apart", Path()), 3)
        metrics = simulation.run().metrics
        events.append((simulation.trace.digest(["events"]), metrics["frames_sent"], metrics["payloads_unsent"]))
    assert events[0] == events[1]


def test_what_stations_do_not_send_is_not_counted_among_the_robots_payloads() -> None:
    scenario = scene([BLUETOOTH, WIFI | {"queue_payloads": 1}], [WIFI_PAIR | {"interval_s": 0.001}], duration_s=2)
    metrics = Simulation(scenario, 3).run().metrics
    assert metrics["payloads_unsent"] == 0
    assert metrics["radio_1_background_received"] < 0.9 * metrics["radio_1_background_sent"]


def test_a_pair_makes_its_link_again() -> None:
    pair = {"radio": 1, "places_m": [[1, 1], [4, 1]], "payload_bytes": 200, "interval_s": 0.1}
    jammer = {"kind": "jammer", "radio": 1, "x_m": 4, "y_m": 2, "power_dbm": 30, "at_s": 10, "until_s": 20}
    radio = BLUETOOTH | {"supervision_s": 2}
    scenario = scene(
        [WIFI, radio], [pair], protocol={"use": "agents", "parameters": {}}, faults=[jammer], duration_s=40
    )
    simulation = Simulation(scenario, 3, (TRANSMISSIONS,))
    simulation.run()
    sent = (
        pd.DataFrame(simulation.trace.columns(TRANSMISSIONS.name)).query("radio == 1 and length == 200")["time_ns"]
        / 1e9
    )
    assert (sent < 10).sum() > 30
    assert ((sent > 13) & (sent < 20)).sum() == 0
    assert (sent > 20).sum() > 30


def test_what_cannot_be_is_refused_in_a_line() -> None:
    def refused(expected: str, radios: list[dict[str, Any]], **changes: Any) -> None:
        with pytest.raises(UserError, match=expected) as raised:
            scene(radios, [WIFI_PAIR | changes])
        assert "\n" not in str(raised.value)

    refused(r"channel.background\[0\].radio: 2 is none of the channel's radios 0 to 1", [BLUETOOTH, WIFI], radio=2)
    refused(r"channel.background\[0\].radio: 0 is a radio of robots", [BLUETOOTH, WIFI], radio=0, payload_bytes=20)
    refused(r"payload_bytes: 1500 is more than the 339 bytes that radio 1 carries", [WIFI, BLUETOOTH])
    refused(r"channel.background\[0\].interval_s: 0", [BLUETOOTH, WIFI], interval_s=0.0)
