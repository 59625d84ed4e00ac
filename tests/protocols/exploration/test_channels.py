"""The experiment that compares channels: its arms can be run, and its claims are the same for each network."""

import csv
from typing import Any

import pytest

from cosim.experiment import Arm, load_experiment
from experiments.exploration import exploring
from experiments.exploration_channels import figures
from tests.checkout import EXPERIMENTS

FOLDER = EXPERIMENTS / "exploration_channels"
WORDS = {
    "shared": "a shared map",
    "ideal": "messages that arrive at once",
    "near": "messages that arrive at once within 15 m",
    "adhoc": "802.11 within 15 m",
    "bluetooth": "Bluetooth within 15 m",
}


def arms(*sets: str) -> dict[str, Arm]:
    return {str(arm.labels["network"]): arm for arm in load_experiment(FOLDER / "sweep.yaml", sets).arms}


def test_every_network_is_claimed_and_swept_and_has_its_radio() -> None:
    found = arms("map=office", "robots=4")
    assert tuple(found) == figures.NETWORKS
    for network, arm in found.items():
        scenario = exploring.Parameters.model_validate(arm.parameters).scenario
        own: Any = scenario.protocol.parameters
        channel: Any = scenario.channel
        assert channel.kind == (network if network in ("adhoc", "bluetooth") else "ideal")
        assert (own.map == "shared") == (network == "shared")
        assert (own.sharing.links is not None) == (network == "bluetooth")
        assert channel.range_m == (None if network in ("shared", "ideal") else 15.0)


def test_the_same_is_claimed_of_each_network() -> None:
    with (FOLDER / "published.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    found = {network: [row for row in rows if row["id"].endswith(f"_{network}")] for network in figures.NETWORKS}
    assert sum(len(each) for each in found.values()) == len(rows)
    for network, words in WORDS.items():
        wanted = [
            {key: value.replace(WORDS["adhoc"], words).replace("_adhoc", f"_{network}") for key, value in row.items()}
            for row in found["adhoc"]
            if network != "shared" or not row["id"].startswith("costs_little")
        ]
        assert found[network] == wanted


@pytest.mark.slow
@pytest.mark.parametrize("network", [network for network in figures.NETWORKS if network != "shared"])
def test_something_is_told_over_each_network(network: str) -> None:
    arm = arms("map=corridor", "robots=4", "scenario.duration_s=12")[network]
    measured = exploring.measure(arm.parameters, 1)
    assert measured["frames"] > 40
    assert measured["payload_bytes"] > 20 * measured["frames"]
    assert measured["coverage"] > 0.01
