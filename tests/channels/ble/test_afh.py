"""Adaptive frequency hopping of links: bad channels are found and left out by both ends, and are tried again."""

from pathlib import Path

import pandas as pd
import pytest

from cosim.channels.ble.channels import rf_channel
from cosim.channels.ble.connections.channel_map import ALL_CHANNELS
from cosim.channels.jamming import CONSTANT, Jammer
from cosim.errors import UserError
from cosim.machine import Lost
from cosim.scenario import build
from cosim.simulation import Simulation
from cosim.trace import TRANSMISSIONS
from cosim.units import S
from tests.channels.ble.ble_field import Field

JAMMED = range(11)
"""Channel indices 0 to 10, RF channels 1 to 11."""
FREE = tuple(index for index in range(37) if index not in JAMMED)


def jammed_field(**connection: object) -> Field:
    """Return a link that a jammer has disturbed on JAMMED for 60 s, by then."""
    field = Field(2, tables=(TRANSMISSIONS,), connection={"afh": True, "afh_retry_s": 1000, **connection})
    field.link(0, 1)
    channels = tuple(2 * rf_channel(index) for index in JAMMED)  # Bluetooth's, of 1 MHz
    field.channel.jam(Jammer(0.0, 0.0, 30.0, channels, CONSTANT, 0, 0, 0, field.kernel.now, 61 * S))
    field.until(60 * S)
    return field


def sent(field: Field) -> pd.DataFrame:
    rows = pd.DataFrame(field.trace.columns(TRANSMISSIONS.name))
    return rows[rows["destination"] >= 0]  # of links


def test_the_channels_of_a_jammer_are_left_out_by_both_ends() -> None:
    field = jammed_field()
    link = field.channel.devices[0].links[1].link
    assert link.central.used.used == link.peripheral.used.used == FREE
    rows = sent(field)
    jammed = rows["channel"].isin([rf_channel(index) for index in JAMMED])
    assert jammed[rows["time_ns"] < 6 * S].any()
    assert not jammed[rows["time_ns"] > 40 * S].any()
    assert (rows[rows["kind"] == "CONTROL"]["time_ns"] > 2 * S).any()  # each map takes time on the air
    assert field.of(0, Lost) == []


def test_without_errors_or_without_being_asked_no_map_is_announced() -> None:
    clear = Field(2, tables=(TRANSMISSIONS,), connection={"afh": True})
    clear.link(0, 1)
    for _ in range(200):
        clear.send(0, 1, bytes(20))
        clear.until(clear.kernel.now + S // 10)
    assert not (sent(clear)["time_ns"][sent(clear)["kind"] == "CONTROL"] > 2 * S).any()
    for field in (clear, jammed_field(afh=False)):
        assert field.channel.devices[0].links[1].link.central.used == ALL_CHANNELS


def test_a_channel_that_is_good_again_comes_back() -> None:
    field = jammed_field(afh_retry_s=20)
    field.until(90 * S)  # the jammer has ended at 61 s; some payloads keep the link from resting
    for _ in range(20):
        field.send(0, 1, bytes(20))
        field.until(field.kernel.now + S)
    assert field.channel.devices[0].links[1].link.central.used == ALL_CHANNELS


def test_a_link_leaves_the_channels_of_a_network_of_80211_in_the_same_air() -> None:
    law = {"propagation": {"model": "free_space", "walls": False}}
    wifi = {"kind": "adhoc", "channel": 6, "rate_mbps": 11, "power_dbm": 20, **law}
    low_energy = {"kind": "ble", "connection": {"afh": True, "afh_retry_s": 1000}, **law}
    plain = {
        "duration_s": 40,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 20, 20]},
        "team": {"size": 1},
        "channel": {
            "kind": "radios",
            "air": "shared",
            "radios": [{"kind": "bluetooth", **law}, wifi, low_energy],
            "background": [
                {"radio": 1, "places_m": [[1, 1], [3, 1]], "payload_bytes": 1500, "interval_s": 0.001},
                {"radio": 2, "places_m": [[1, 2], [9, 2]], "payload_bytes": 20, "interval_s": 0.1},
            ],
        },
        "protocol": {"use": "agents"},
    }
    simulation = Simulation(build(plain, "both", Path()), 1, (TRANSMISSIONS,))
    simulation.run()
    rows = pd.DataFrame(simulation.trace.columns(TRANSMISSIONS.name)).query("radio == 2 and destination >= 0")
    in_band = (rows["channel"] + 2402 - 2437).abs() <= 8
    early, late = rows["time_ns"] < 3 * S, rows["time_ns"] > 30 * S
    assert 0.1 < in_band[early].mean() < 0.4  # 8 of 37
    assert late.sum() > 500
    assert not in_band[late].any()


def test_a_link_with_a_latency_is_not_assessed() -> None:
    with pytest.raises(UserError, match=r"connection.afh: True is not for links with a latency"):
        build(
            {
                "duration_s": 1,
                "channel": {"kind": "ble", "connection": {"afh": True, "latency": 3}},
                "protocol": {"use": "agents"},
            },
            "latency",
            Path(),
        )
