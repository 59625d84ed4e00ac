"""The pictures of the handbook: their lists of boxes are what the runs' tables hold, made again."""

import csv
import re
import sys
from functools import cache
from importlib import import_module
from typing import Any

import pandas as pd
import pytest
from PIL import Image

from cosim.export.recording import DRAWN, Recording
from cosim.scenario import load
from cosim.simulation import Simulation
from tests.checkout import ROOT
from tests.export.recordings import silences

FOLDER = ROOT / "docs" / "pictures"
GUIDE = (ROOT / "docs" / "guides" / "pictures.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def draw() -> Any:
    """Return the script that makes the pictures."""
    before = list(sys.path)
    sys.path.insert(0, str(FOLDER))
    yield import_module("draw")
    sys.path[:] = before
    for name in ("draw", "flows"):
        sys.modules.pop(name, None)


@cache
def made(scenario: str) -> tuple[Recording, dict[str, pd.DataFrame]]:
    from cosim.cli_pictures import recording_of

    given = load(FOLDER / f"{scenario}.yaml")
    simulation = Simulation(given, given.seed, DRAWN)
    outcome = simulation.run()
    tables = {name: outcome.trace.arrow(name).to_pandas() for name in outcome.trace.tables}
    return recording_of(simulation, outcome, given.seed), tables


def listed(name: str) -> list[dict[str, str]]:
    with (FOLDER / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


NAMES = sorted(path.stem for path in FOLDER.glob("*.csv"))


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_list_of_a_picture_is_what_the_tables_of_its_run_hold(name: str, draw: Any) -> None:
    [picture] = [each for each in draw.PICTURES if each.name == name]
    recording, tables = made(picture.scenario)
    view = picture.view(recording)
    rows = listed(name)

    def within(table: Any, start: str, ends: Any) -> Any:
        return table[(table[start] < view.end) & (ends > view.begin)]

    frames, sent, states = tables["frames"], tables["transmissions"], tables["intervals"]
    frames = within(frames, "time_ns", frames["time_ns"] + frames["duration_ns"])
    frames = frames[frames["destination"] >= 0]
    sent = within(sent, "time_ns", sent["time_ns"] + sent["duration_ns"])
    states = within(states, "start_ns", states["end_ns"])
    columns = (
        ("received", frames, ("time_ns", "destination", "source", "kind", "channel", "outcome", "part"),
         ("start", "robot", "peer", "kind", "channel", "outcome", "part")),
        ("sent", sent, ("time_ns", "source", "destination", "kind", "channel"),
         ("start", "robot", "peer", "kind", "channel")),
        ("states", states, ("start_ns", "end_ns", "robot", "radio", "state", "detail"),
         ("start", "end", "robot", "radio", "kind", "detail")),
    )  # fmt: skip
    for what, table, theirs, ours in columns:
        expected = sorted(tuple(map(str, row)) for row in table[list(theirs)].itertuples(index=False))
        assert sorted(tuple(row[each] for each in ours) for row in rows if row["what"] == what) == expected
        assert expected or what == "received"
    sensed = [
        (*span, robot, radio, what)
        for (robot, radio, what), each in silences(recording, tables).items()
        for span in each
        if span[0] < view.end and span[1] > view.begin
    ]
    names = ("start", "end", "robot", "radio", "what")
    told = [tuple(row[name] for name in names) for row in rows if row["what"] in ("busy", "NAV")]
    assert sorted(told) == sorted(tuple(map(str, each)) for each in sensed)
    assert len(rows) == len(frames) + len(sent) + len(states) + len(sensed)


@pytest.mark.parametrize("name", NAMES)
def test_each_kind_of_a_picture_is_in_its_legend(name: str) -> None:
    svg = (FOLDER / f"{name}.svg").read_text(encoding="utf-8")
    texts = set(re.findall(r">([^<>\n]+)</text>", svg))
    rows = listed(name)
    assert {row["detail"] or row["kind"] if row["what"] != "states" else row["kind"] for row in rows} <= texts
    assert ("lost" in texts) == any(row["outcome"] not in ("", "received") for row in rows)
    assert f"(../pictures/{name}.svg)" in GUIDE


def kinds(name: str, **wanted: str) -> set[str]:
    return {row["detail"] if row["what"] != "states" and row["detail"] else row["kind"] for row in listed(name)
            if all(row[key] == value for key, value in wanted.items())}  # fmt: skip


def test_the_pictures_show_what_they_are_of() -> None:
    assert kinds("setting_up") >= {
        "inquiry",
        "inquiry_scan",
        "page",
        "page_scan",
        "master",
        "slave",
        "ID",
        "FHS",
        "POLL",
    }
    assert [row["kind"] for row in listed("paging") if row["what"] == "received"] == [
        "ID",
        "ID",
        "FHS",
        "ID",
        "POLL",
        "NULL",
    ]
    assert kinds("lost_payload", part="payload") == {"DM1"}
    assert kinds("masters_death", robot="0") >= {"killed", "master"}
    assert kinds("masters_death", robot="1") >= {"slave", "inquiry", "page", "master"}
    assert kinds("hidden_terminal", outcome="collided", robot="1") == {"DATA"}
    assert kinds("aodv_repair") >= {"killed", "RREQ", "RREP", "route", "backoff", "awaits_ack"}
    lost = [int(row["channel"]) for row in listed("jammer_with_afh") if row["outcome"] == "collided"]
    assert set(lost) <= set(range(30, 51))
    assert len(lost) > 20
    assert kinds("growing_map") >= {"DATA"}


def test_readme_shows_the_first_in_at_most_two_megabytes() -> None:
    path = FOLDER / "setting_up.webp"
    assert "(docs/pictures/setting_up.webp)" in (ROOT / "README.md").read_text(encoding="utf-8")
    assert path.stat().st_size <= 2_000_000
    with Image.open(path) as film:
        assert film.n_frames > 20
