"""Recordings of short runs, for the tests of exports and pictures, and what their tables hold, read by pandas."""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import pandas as pd

from cosim.channels.adhoc.settings import AdhocSettings
from cosim.cli_pictures import metadata_of, recording_of
from cosim.export.recording import DRAWN, Recording, of_run
from cosim.scenario import load
from cosim.simulation import Simulation
from cosim.trace import POSES
from cosim.units import MS, S
from tests.channels.adhoc.test_adhoc_tables import Field
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


def relayed() -> tuple[Recording, dict[str, pd.DataFrame]]:
    """Return the recording and the tables of a line of robots that relay payloads by AODV, long ones with RTS."""
    settings = {"range_m": 15.0, "rts_threshold": 60, "routing": {"kind": "aodv"}}
    places = [(0.0, 0.0), (10.0, 0.0), (20.0, 0.0), (30.0, 0.0)]
    field = Field(places, DRAWN, **settings)
    for at in range(20):
        field.send_at((at + 1) * 40 * MS, at % 4, (at + 3) % 4, 10 * at)
    field.run(2 * S)
    for robot, (x_m, y_m) in enumerate(places):
        field.trace.row(POSES, S, robot, x_m, y_m, 0.0)
    scene = {"name": "relayed", "bounds_m": [0, 0, 30, 5], "walls_m": [], "polygons_m": [], "radii_m": [0.2] * 4}
    channel = AdhocSettings.model_validate(settings).model_dump(mode="json")
    tables = {name: field.trace.arrow(name).to_pandas() for name in field.trace.tables}
    return of_run(field.trace, scene, {"scenario": json.dumps({"channel": channel})}), tables


Silences = dict[tuple[int, int, str], list[tuple[int, int]]]


def silences(recording: Recording, tables: dict[str, pd.DataFrame]) -> Silences:
    """Return begin and end of when the medium was busy, and reserved (NAV), by robot, radio and which of both.

    A walk from instant to instant over what a station sends and hears, as IEEE 802.11-1999, 9.2.1, has it.
    """
    channel = recording.scenario["channel"]
    found: Silences = {}
    for radio, part in enumerate(channel.get("radios", [channel])):
        if part["kind"] != "adhoc":
            continue
        sent, heard = (tables[name] for name in ("transmissions", "receptions"))
        if "radio" in sent:
            sent, heard = sent[sent.radio == radio], heard[heard.radio == radio]
        delay, loud_mw = round(part.get("propagation_s", 1e-6) * 1e9), 10 ** (part.get("energy_dbm", -62) / 10)
        both = heard.merge(sent, on=["time_ns", "source"])
        for robot in range(recording.size):
            own = sent[sent.source == robot]
            there = both[(both.receiver == robot) & (both.outcome != "out_of_range")]
            ends = there.time_ns + there.duration_ns + delay
            followed = there.power_dbm.isna() | there.sinr_db.notna()
            mw = (10 ** (there.power_dbm.astype(float) / 10)).fillna(0.0)
            noises = [
                (begin, begin + lasts, True, 0.0) for begin, lasts in zip(own.time_ns, own.duration_ns, strict=True)
            ]
            noises += zip(there.time_ns + delay, ends, followed, mw, strict=True)
            told = (there.outcome == "received") & (there.destination != robot) & (there.destination != -1)
            reserved = [
                (end, end + more, True, 0.0) for end, more in zip(ends[told], there.reserves_ns[told], strict=True)
            ]
            for what, spans in (("busy", noises), ("NAV", reserved)):
                if walked := _walked(spans, loud_mw):
                    found[robot, radio, what] = walked
    return found


def _walked(spans: list[Any], loud_mw: float) -> list[tuple[int, int]]:
    """Return when any of the *spans* that count holds, or all that hold together are as strong as *loud_mw*."""
    silent: list[tuple[int, int]] = []
    waiting, on = sorted(spans), []
    instants = sorted({time for begin, end, *_ in spans for time in (begin, end)})
    for begin, end in pairwise(instants):
        on = [each for each in on if each[1] > begin]
        while waiting and waiting[0][0] <= begin:
            on.append(waiting.pop(0))
        on = [each for each in on if each[1] > begin]
        if any(counts for *_, counts, _ in on) or sum(mw for *_, mw in on) >= loud_mw:
            joined = silent and silent[-1][1] == begin
            silent[-1:] = [(silent[-1][0], end)] if joined else [*silent[-1:], (begin, end)]
    return silent


ROUTERS = {654: {1: "RREQ", 2: "RREP", 3: "RERR", 4: "RREPACK"}}
"""What RFC 3561 calls the types of AODV's messages, which come after 20 B of IPv4 and 8 B of UDP, by port."""


def called(tables: dict[str, pd.DataFrame]) -> dict[tuple[int, int], str]:
    """Return what routers' own packets on the air are called, by time and sender."""
    sent = tables["transmissions"]
    found = {}
    for time, source, body in sent[sent.routed][["time_ns", "source", "body"]].itertuples(index=False):
        packet = bytes.fromhex(body)
        names = ROUTERS.get(int.from_bytes(packet[22:24], "big"))
        if names:
            found[time, source] = names[packet[28]]
    return found
