"""Times by state and energy of radios in runs: columns, the table, batteries; and that to count changes nothing."""

import math
from typing import Any

import pytest

from cosim.channels.energy import NRF52840, PARTS, TRANSMIT, Accounts, Use
from cosim.errors import UserError
from cosim.simulation import Simulation
from cosim.trace import ENERGY, FRAMES
from cosim.units import S
from tests.faults.fault_scene import executed, kill, radio_off, rows, scenario

BLE = {"kind": "ble"}
ADHOC = {"kind": "adhoc"}
CLASSIC = {"kind": "bluetooth"}
RADIOS = {"kind": "radios", "radios": [BLE, ADHOC]}
LAW = {"propagation": {"model": "log_distance"}}
SHARED = {"kind": "radios", "air": "shared", "radios": [{**BLE, **LAW}, {**ADHOC, **LAW}]}
CLASSIC_SHARED = {"kind": "radios", "air": "shared", "radios": [{**CLASSIC, **LAW}, {**ADHOC, **LAW}]}
TEAM = {"groups": [{"size": 1, "radios": [0, 1]}, {"size": 1, "radios": [0]}]}


def battery(robot: int, capacity_j: float, **more: Any) -> dict[str, Any]:
    return {"kind": "battery", "robot": robot, "capacity_j": capacity_j, **more}


CRASH = {"kind": "crash", "robot": 0, "at_s": 1.0, "until_s": 2.0}
FAULTS = (CRASH, radio_off(1, 2.05, 3.0), kill(1, 4.0))
CHANNELS = pytest.mark.parametrize(
    "channel",
    [BLE, ADHOC, CLASSIC, RADIOS, SHARED, CLASSIC_SHARED],
    ids=["ble", "adhoc", "bluetooth", "radios", "shared", "bluetooth shared"],
)


def counting(channel: dict[str, Any], part: str = "nrf52840") -> dict[str, Any]:
    """Return *channel* with what radios use counted."""
    if channel["kind"] == "radios":
        return {**channel, "radios": [counting(each, part) for each in channel["radios"]]}
    return {**channel, "energy": part if channel["kind"] == "ble" else "states"}


def run(channel: dict[str, Any], *faults: dict[str, Any], **more: Any) -> Simulation:
    if channel["kind"] == "radios":
        more["team"] = TEAM
    simulation = Simulation(scenario(*faults, channel=channel, **more), 1, (ENERGY, FRAMES))
    simulation.outcome = simulation.run()  # type: ignore[attr-defined,assignment,method-assign]
    return simulation


def energy_rows(simulation: Simulation) -> list[tuple[Any, ...]]:
    return list(zip(*simulation.trace.columns(ENERGY.name).values(), strict=True))


@CHANNELS
@pytest.mark.parametrize("faults", [(), FAULTS], ids=["sound", "faulty"])
def test_to_count_changes_no_digest_no_event_and_no_frame(channel: dict[str, Any], faults: tuple[dict[str, Any], ...]):
    without, counted = run(channel, *faults), run(counting(channel), *faults)
    assert without.outcome.digest == counted.outcome.digest
    assert without.trace.digest() != counted.trace.digest()
    assert without.trace.digest(["frames", "events"]) == counted.trace.digest(["frames", "events"])
    assert without.outcome.metrics.items() <= counted.outcome.metrics.items()
    assert energy_rows(without) == []
    assert not any("radio_tx" in metric.name for metric in without.metric_columns)


@CHANNELS
def test_states_of_each_radio_last_as_long_as_the_run_and_add_up_to_the_columns(channel: dict[str, Any]):
    simulation = run(counting(channel), *FAULTS)
    metrics, told = simulation.outcome.metrics, energy_rows(simulation)
    assert {row[0] for row in told} == {6 * S}
    lasting: dict[tuple[int, int], float] = {}
    sums: dict[str, float] = {}
    for _, robot, radio, state, _, time_s, _ in told:
        lasting[robot, radio] = lasting.get((robot, radio), 0.0) + time_s
        sums[state] = sums.get(state, 0.0) + time_s
    carried = [(robot, radio) for robot in (0, 1) for radio in simulation.channel.carried(robot)]
    assert lasting == pytest.approx(dict.fromkeys(carried, 6.0), rel=1e-12)
    names = {"radio_tx_s": "transmit", "radio_rx_s": "receive", "radio_idle_s": "idle", "radio_sleep_s": "sleep"}
    assert {name: metrics[name] for name in names} == pytest.approx({n: sums.get(s, 0.0) for n, s in names.items()})
    off = {(robot, radio): time_s for _, robot, radio, state, _, time_s, _ in told if state == "off"}
    down = {0: 1.0, 1: 2.95}
    assert off == pytest.approx({(robot, radio): down[robot] for robot, radio in carried})


def test_several_radios_are_counted_one_by_one():
    metrics = run(counting(RADIOS)).outcome.metrics
    for name in ("tx_s", "rx_s", "idle_s", "sleep_s"):
        assert metrics[f"radio_0_radio_{name}"] + metrics[f"radio_1_radio_{name}"] == metrics[f"radio_{name}"]
    assert metrics["radio_0_radio_energy_j"] == metrics["radio_energy_j"] > 0
    assert "radio_1_radio_energy_j" not in metrics


def test_energy_is_volts_times_amperes_times_seconds():
    simulation = run(counting(BLE))
    total = 0.0
    for _, _, _, state, phy, time_s, energy_j in energy_rows(simulation):
        amperes = {"transmit": 6.40e-3, "receive": 6.26e-3, "idle": 6.26e-3, "sleep": 3.16e-6}[state]
        assert phy == ("" if state == "sleep" else "1M")
        assert energy_j == pytest.approx(3.0 * amperes * time_s, rel=1e-12)
        total += energy_j
    assert simulation.outcome.metrics["radio_energy_j"] == pytest.approx(total, rel=1e-12)
    unpriced = run(counting(BLE, "states"))
    assert {row[-1] for row in energy_rows(unpriced)} == {None}
    assert "radio_energy_j" not in unpriced.outcome.metrics


def test_a_current_that_is_not_published_is_none():
    assert NRF52840.watts(Use(TRANSMIT, "1M"), 8.0) == pytest.approx(49.2e-3)
    assert NRF52840.watts(Use(TRANSMIT, "1M"), 7.0) is None
    assert NRF52840.watts(Use("off"), 0.0) == 0.0
    accounts = Accounts("nrf52840", lambda robot, now: {Use(TRANSMIT, "2M"): 1}, [0.0])
    with pytest.raises(UserError, match="no published current to transmit on 2M"):
        accounts.summary(0)
    assert set(PARTS) == {"nrf52840"}


# ---------------------------------------------------------------- batteries


def test_a_battery_that_counts_states_lasts_as_long_as_what_radios_do_lets_it():
    always_on_w = 3.0 * 6.26e-3  # it listens all the time, and sends for 3 J in a thousand
    simulation = run(counting(BLE), battery(1, 2.0 * always_on_w, energy="states"))
    assert rows(simulation)[0] == (2 * S, 1, "BatteryEmpty")
    simulation = run(counting(BLE), battery(1, 2.0 * always_on_w, energy="states"), radio_off(1, 0.5, 1.0))
    assert rows(simulation)[-2][:2] == (int(2.5 * S), 1)


def test_a_battery_pays_for_host_and_drive_beside_its_radio_and_the_table_tells_it():
    simulation = run(counting(BLE), battery(0, 99.0, energy="states", idle_w=2.0, drive_j_per_m=5.0), far_m=1.0)
    told = {(row[1], row[2], row[3]): row[-1] for row in energy_rows(simulation)}
    assert told[0, -1, "host"] == pytest.approx(2.0 * 5.9)  # up to the last tick
    assert told[0, -1, "drive"] == pytest.approx(5.0 * simulation.outcome.metrics["distance_m"] / 2, rel=1e-6)
    spent = told[0, -1, "host"] + told[0, -1, "drive"]
    radio = math.fsum(value for (robot, of, _), value in told.items() if (robot, of) == (0, 0))
    assert simulation.outcome.metrics["host_j"] == told[0, -1, "host"]
    assert simulation.outcome.metrics["drive_j"] == told[0, -1, "drive"]
    left = simulation.faults.energy_j()[0]
    assert 99.0 - spent - radio <= left <= 99.0 - spent - 0.98 * radio
    assert (1, -1, "host") not in told


def test_columns_of_drives_and_hosts_are_those_of_all_batteries_and_no_outcome():
    ours = battery(0, 99.0, idle_w=2.0, drive_j_per_m=5.0), battery(1, 50.0, energy="states", idle_w=1.0)
    constant = battery(1, 50.0, idle_w=1.0)
    metrics = run(counting(BLE), *ours, far_m=1.0).outcome.metrics
    assert metrics["host_j"] == pytest.approx((2.0 + 1.0) * 5.9)  # up to the last tick
    assert metrics["drive_j"] == pytest.approx(5.0 * metrics["distance_m"] / 2, rel=1e-6)
    counts, does_not = run(counting(BLE), *ours), run(counting(BLE), ours[0], constant)
    assert counts.outcome.metrics.keys() - does_not.outcome.metrics.keys() == {"drive_j", "host_j"}
    assert counts.outcome.metrics.keys() == {metric.name for metric in counts.metric_columns}
    assert counts.outcome.digest == does_not.outcome.digest


def test_a_battery_that_counts_states_needs_a_part():
    for channel in ({"kind": "ideal"}, BLE, counting(BLE, "states"), counting(ADHOC), counting(CLASSIC)):
        with pytest.raises(UserError, match=r"faults\[0\].energy: states needs a part that channel.energy names"):
            executed(battery(0, 1.0, energy="states"), channel=channel)
    with pytest.raises(UserError, match="needs a part"):  # of all of its radios
        run(counting(RADIOS), battery(0, 1.0, energy="states"))
    run(counting(RADIOS), battery(1, 1.0, energy="states"))


def test_what_a_radio_takes_is_constant_or_by_states():
    with pytest.raises(ValueError, match="is given beside radio_w"):
        scenario(battery(0, 1.0, energy="states", radio_w=1.0))
    constant = [executed(battery(1, 1.0, radio_w=0.5, **more)) for more in ({}, {"energy": "constant"})]
    assert constant[0].outcome.digest == constant[1].outcome.digest
    assert rows(constant[0])[0] == (2 * S, 1, "BatteryEmpty")
