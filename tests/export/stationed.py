"""A short run with stations in the background: two robots with 802.11, a pair by Bluetooth, and one by Low Energy."""

import json
from pathlib import Path
from typing import Any, Final, NamedTuple

import pandas as pd

from cosim.export.recording import Recording, of_folder
from cosim.scenario import Scenario, build, dump
from cosim.simulation import Simulation
from cosim.trace import TABLES
from cosim.web.scenes import read_scene, scene_of, write_scene

LAW: Final = {"propagation": {"model": "log_distance"}}
PLACES: Final = [(1.0, 1.0), (4.0, 1.5), (8.0, 2.0), (8.5, 6.0)]
"""Of stations 0 to 3."""
ROBOTS: Final = 2
NAMES: Final = ["robot 0", "robot 1", "station 0", "station 1", "station 2", "station 3"]
"""What everybody is called, by address."""
RADIOS: Final = [0, 0, 1, 1, 2, 2]
"""Which radio everybody has."""
SCENARIO: Final[Scenario] = build(
    {
        "name": "stationed",
        "duration_s": 3,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 12, 8], "walls": [[3, 0, 3, 3]]},
        "team": {"size": ROBOTS, "starts": [[5, 4], [10, 5]], "body": {"radius_m": 0.2, "drive": "grid"}},
        "channel": {
            "kind": "radios",
            "air": "shared",
            "radios": [
                {"kind": "adhoc", "channel": 6, **LAW},
                {"kind": "bluetooth", "power_class": 2, **LAW},
                {"kind": "ble", **LAW},
            ],
            "background": [
                {"radio": 1, "places_m": PLACES[:2], "payload_bytes": 200, "interval_s": 0.02},
                {"radio": 2, "places_m": PLACES[2:], "payload_bytes": 100, "interval_s": 0.02},
            ],
        },
        "protocol": {"use": "pseudonet", "parameters": {"algorithm": "spanning_tree", "trace_calls": True}},
    },
    "stationed",
    Path(),
)


class Stationed(NamedTuple):
    """What the run has left."""

    simulation: Simulation
    folder: Path
    """With the tables, and the scene."""
    tables: dict[str, pd.DataFrame]
    recording: Recording

    def scene(self) -> dict[str, Any]:
        found = read_scene(self.folder)
        assert found is not None
        return found


def make(folder: Path) -> Stationed:
    """Make the run, and keep its trace in *folder*."""
    simulation = Simulation(SCENARIO, 1, tuple(TABLES.values()))
    outcome = simulation.run()
    outcome.trace.write(folder, {"scenario": json.dumps(dump(SCENARIO)), "metrics": json.dumps(outcome.metrics)})
    write_scene(scene_of(SCENARIO, simulation.floorplan, 1), folder)
    tables = {path.stem: pd.read_parquet(path) for path in folder.glob("*.parquet")}
    return Stationed(simulation, folder, tables, of_folder(folder, read_scene(folder)))
