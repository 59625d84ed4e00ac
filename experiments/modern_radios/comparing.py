"""A task of one of the papers over one radio, alone or with pairs of stations of the other technologies on the air.

The scenario of each task stands beside this file, over messages that arrive at once. Radios have the strongest usual
power, and one law of propagation: free space, and what walls cost. The stations are placed by the floor's extent alone:
for each technology a pair in the middle of its left half, and one in the middle of the right half.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal, TypeAlias, get_args

from cosim.experiment import experiment_function
from cosim.scenario import Scenario, changed, load
from cosim.settings import Settings
from cosim.simulation import Simulation
from cosim.trace import Field as Column
from cosim.world.floorplan import load_floorplan
from experiments.deployment.deploying import StartSettings, drawn

Task: TypeAlias = Literal["reflection", "exploration", "aggregation", "pseudonet", "deployment"]
Radio: TypeAlias = Literal[
    "ideal", "optical", "bluetooth", "le links", "le broadcasts", "le mesh", "802.11b", "802.11g"
]
Air: TypeAlias = Literal["alone", "others"]
Plain: TypeAlias = dict[str, Any]

TASKS: Final[tuple[Task, ...]] = get_args(Task)
RADIOS: Final[tuple[Radio, ...]] = get_args(Radio)
LAW: Final = {"propagation": {"model": "free_space", "walls": True}}
_LE: Final = {"kind": "ble", "power_dbm": 8, "energy": "nrf52840", **LAW}
_WIFI: Final = {"kind": "adhoc", "channel": 6, "host_jitter_s": 0.01, "energy": "states", **LAW}
CHANNELS: Final[Mapping[Radio, Plain]] = MappingProxyType(
    {
        "ideal": {"kind": "ideal"},
        "optical": {"kind": "optical"},
        "bluetooth": {"kind": "bluetooth", "power_class": 1, "afh": True, "supervision_s": 8, **LAW},
        "le links": _LE,
        "le broadcasts": _LE,
        "le mesh": _LE | {"broadcast": {"by": "mesh"}},
        "802.11b": _WIFI | {"phy": "dsss", "rate_mbps": 11},
        "802.11g": _WIFI | {"phy": "erp", "rate_mbps": 54},
    }
)
"""The channel of each radio."""
LINKED: Final = ("bluetooth", "le links")
"""Radios over which nothing is said without a link."""
LINKS: Final[Mapping[Task, Plain]] = MappingProxyType(
    {
        "reflection": {"protocol.parameters.links": True},
        "exploration": {"protocol.parameters.sharing.links": {}},
        "aggregation": {"protocol.parameters.links": {}},
        "pseudonet": {},
        "deployment": {"protocol.parameters.courier.links": {}},
    }
)
"""What makes robots keep links."""
STATIONS: Final[Mapping[str, tuple[Plain, int, float]]] = MappingProxyType(
    {
        "bluetooth": ({"kind": "bluetooth", "power_class": 2, "afh": True, **LAW}, 339, 25e-3),
        "ble": ({"kind": "ble", "power_dbm": 0, "connection": {"interval_s": 0.1, "links": 1}, **LAW}, 244, 16.7e-3),
        "adhoc": ({"kind": "adhoc", "channel": 6, "phy": "dsss", "rate_mbps": 11, **LAW}, 1500, 10.4e-3),
    }
)
"""Channel of the stations of each technology, bytes of their payloads, and s from one to the next.

A payload and its answer are on the air for 3.75 ms (a DH5 and the slot after it), 2.5 ms (2.12, 0.08 and two pauses of
0.15) and 1.57 ms (1.31, 0.01 and 0.25): 15 % of the time a pair, 30 % both.
"""
APART_M: Final = 4.0
"""From one station of a pair to the other."""
STARTS: Final = StartSettings(base="base", half_m=(3.4, 3.4), apart_m=1.6)
"""Where the robots of a deployment stand in the beginning."""
_FOR_ONE: Final[Mapping[Task, str]] = MappingProxyType(
    {
        "aggregation": "searchers answer their host alone, which takes a link",
        "pseudonet": "a team is a piconet: it is made of links",
        "deployment": "orders and reports are for one robot, which takes a link",
    }
)
NO_CELL: Final[Mapping[tuple[Task, Radio], str]] = MappingProxyType(
    {(task, radio): why for task, why in _FOR_ONE.items() for radio in ("le broadcasts", "le mesh")}
)
"""Why a task cannot be done over a radio."""
UNDISTURBED: Final = "nothing at 2.4 GHz disturbs it"
"""Why there are no stations beside a radio that is none."""
COLUMNS: Final = (
    Column("time_s", "float", "s", "until the task was done; the longest run if it never was"),
    Column("done", "float", "1", "1 if it was done in time, else 0"),
    Column("payloads", "float", "1", "payloads that robots have sent"),
    Column("unsent", "float", "1", "share of them that were never on the air"),
    Column("radio_tx_s", "float", "s", "in which the robots' radios have sent, all together; NaN where none counts it"),
    Column(
        "radio_energy_j", "float", "J", "what their radios have used, all together; NaN where no currents are known"
    ),
    Column("distance_m", "float", "m", "driven by all robots together"),
    Column("background", "float", "1", "share of the stations' payloads that have arrived; NaN without stations"),
)


class Parameters(Settings):
    """A cell of the table."""

    task: Task = "reflection"
    radio: Radio = "ideal"
    air: Air = "alone"

    def missing(self) -> str | None:
        """Return why there can be no such run; None if there can."""
        if self.air == "others" and self.radio in ("ideal", "optical"):
            return UNDISTURBED
        return NO_CELL.get((self.task, self.radio))

    def scenario(self, seed: int) -> Scenario:
        """Return the run with its radio and stations; a deployment's robots start where *seed* has it."""
        here = Path(__file__).parent
        scenario = load(here / f"{self.task}.yaml")
        changes = dict(LINKS[self.task]) if self.radio in LINKED else {}
        changes["channel"] = self._channel(scenario)
        if self.task == "deployment":
            floor = load_floorplan(scenario.floorplan, here)
            changes["team.starts"] = drawn(STARTS, scenario, floor, seed)
        return changed(scenario, changes, "radio", here)

    def _channel(self, scenario: Scenario) -> Plain:
        own = CHANNELS[self.radio]
        if self.radio in ("ideal", "optical"):
            return own
        others = [each for kind, each in STATIONS.items() if kind != own["kind"]] if self.air == "others" else []
        floor = load_floorplan(scenario.floorplan, Path(__file__).parent)
        return {
            "kind": "radios",
            "air": "shared",
            "radios": [own, *(channel for channel, *_ in others)],
            "background": [
                {"radio": radio, "places_m": places, "payload_bytes": octets, "interval_s": interval_s}
                for radio, (_, octets, interval_s) in enumerate(others, 1)
                for places in _places(floor.bounds_m, radio)
            ],
        }


def _places(bounds_m: tuple[float, float, float, float], row: int) -> list[list[list[float]]]:
    """Return the places of two pairs: in the middle of the left and of the right half, *row* m above the middle."""
    x0, y0, x1, y1 = bounds_m
    y = (y0 + y1) / 2.0 + row
    middles = x0 + (x1 - x0) / 4.0, x0 + 3.0 * (x1 - x0) / 4.0
    return [[[x - APART_M / 2.0, y], [x + APART_M / 2.0, y]] for x in middles]


@experiment_function
def measure(parameters: Mapping[str, Any], seed: int) -> dict[str, float]:
    """Make the run and return ``COLUMNS``; all are NaN, and no run is made, where there can be none."""
    given = Parameters.model_validate(parameters)
    if given.missing() is not None:
        return {column.name: math.nan for column in COLUMNS}
    scenario = given.scenario(seed)
    simulation = Simulation(scenario, seed)
    metrics = simulation.run().metrics
    time_s = _time_s(given.task, metrics)
    payloads = sum(node.payloads for node in simulation.nodes)
    return {
        "time_s": scenario.duration_s if math.isnan(time_s) else time_s,
        "done": float(not math.isnan(time_s)),
        "payloads": float(payloads),
        "unsent": metrics["payloads_unsent"] / payloads if payloads else math.nan,
        "radio_tx_s": metrics.get("radio_tx_s", math.nan),
        "radio_energy_j": metrics.get("radio_energy_j", math.nan),
        "distance_m": metrics["distance_m"],
        "background": _arrived(metrics),
    }


def _time_s(task: Task, metrics: Mapping[str, float]) -> float:
    """Return how long the task took; NaN if it was not done."""
    match task:
        case "reflection":
            return math.nan if metrics["targets_given_up"] else metrics["simulated_s"]
        case "exploration":
            return metrics["time_95_s"]
        case "aggregation":
            return 60.0 * metrics["search_time_min"] if metrics["completed"] else math.nan
        case "pseudonet":
            return metrics["time_to_cover_s"]
        case "deployment":
            return metrics["deployment_s"]


def _arrived(metrics: Mapping[str, float]) -> float:
    sent, received = (
        sum(value for name, value in metrics.items() if name.endswith(f"_background_{what}"))
        for what in ("sent", "received")
    )
    return received / sent if sent else math.nan
