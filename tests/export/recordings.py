"""Recordings of short runs, for the tests of exports and pictures, and what their tables hold, read by pandas."""

from pathlib import Path
from typing import Any

import pandas as pd

from cosim.cli_pictures import metadata_of, recording_of
from cosim.export.recording import DRAWN, Recording
from cosim.scenario import load
from cosim.simulation import Simulation
from tests.checkout import ROOT

BLUETOOTH = (
    "examples/2_bluetooth.yaml",
    (
        "duration_s=14",
        "channel.idle_frames=true",
        "faults=[{kind: jammer, x_m: 10, y_m: 6, at_s: 8, until_s: 9, power_dbm: 20, channels: [20, 40]}]",
    ),
)
"""A piconet, and for a second a jammer: some of its frames are lost."""
WALLS = ("examples/3_walls_and_faults.yaml", ("duration_s=46",))
"""802.11 with routes, collisions, a robot that dies, one that boots again, and a jammer."""
QUIET = (WALLS[0], ("duration_s=1", "faults=[]"))
RADIOS = ("examples/4_two_radios.yaml", ("duration_s=30",))
"""Two radios a robot; one host dies, and then nobody hears the other."""


def make(named: tuple[str, tuple[str, ...]], folder: Path | None = None) -> tuple[Recording, dict[str, pd.DataFrame]]:
    """Make a run, and return its recording and its tables as pandas sees them; keep its trace in *folder*."""
    scenario = load(ROOT / named[0], named[1])
    simulation = Simulation(scenario, 3, DRAWN)
    outcome = simulation.run()
    tables = {name: outcome.trace.arrow(name).to_pandas() for name in outcome.trace.tables}
    if folder is not None:
        from cosim.web.scenes import scene_of, write_scene

        outcome.trace.write(folder, metadata_of(simulation, outcome, 3))
        write_scene(scene_of(scenario, simulation.floorplan, 3), folder)
    return recording_of(simulation, outcome, 3), tables


def sendings(tables: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Return a row for each frame that was sent, as the tables of transmissions or else of frames tell."""
    names = ["time_ns", "source", "kind", "duration_ns"]
    sent, frames = tables["transmissions"], tables["frames"]
    if "radio" in frames:
        names.append("radio")
        untold = frames[~frames["radio"].isin(sent["radio"])]
    else:
        untold = frames.iloc[:0] if len(sent) else frames
    return pd.concat([sent[names], untold[names].drop_duplicates(["time_ns", "source", *names[2:3], *names[4:]])])


def spans(table: Any, start: str = "time_ns") -> list[tuple[int, int, str]]:
    """Return begin, end and kind of each row, sorted."""
    ends = table[start] + table["duration_ns"]
    return sorted(zip(table[start].tolist(), ends.tolist(), table["kind"], strict=True))
