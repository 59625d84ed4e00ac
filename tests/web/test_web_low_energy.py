"""Pages of runs over Bluetooth Low Energy: links, searches, strips, poll gaps, lost sections, and what packets say."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import pytest

from cosim.decoding import decoded, frame_said
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.timeline.curves import Drawn, Parts, curves, values
from cosim.timeline.index import opened
from cosim.trace import TABLES
from cosim.units import MS, S, Time
from cosim.web.live import Live
from cosim.web.messages import Seek, Step
from cosim.web.recorded import Recorded
from cosim.web.scenes import scene_of, write_scene
from tests.timeline.test_timeline_windows import Page
from tests.web.browser import LABELS, Browser, tab
from tests.web.served import Served
from tests.web.test_web_timeline_page import LINE, look, press, settled, window

SCENARIO: Final = Scenario.model_validate(
    {
        "duration_s": 4,
        "floorplan": {"map": "walls", "bounds_m": [0, 0, 6, 5], "walls": [[3, 0, 3, 3]]},
        "team": {"size": 4},
        "channel": {
            "kind": "ble",
            "idle_frames": True,
            "propagation": {"model": "log_distance", "exponent": 3.5},
            "power_dbm": -10,
        },
        "protocol": {"use": "pseudonet", "parameters": {"algorithm": "spanning_tree"}},
        "faults": [
            {"kind": "jammer", "x_m": 3, "y_m": 4, "power_dbm": 0, "at_s": 1.5, "until_s": 2.0},
            {"kind": "kill", "robot": 2, "at_s": 2.2},
        ],
    }
)
LOOKED_AT: Final = [20 * MS, 90 * MS, 120 * MS, 200 * MS, 1 * S, 2_500 * MS, 3_900 * MS]
"""Instants of a scan, of pages, of links, and of one that one end only still holds."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the trace of a central with three peripherals, a jammer, and a peripheral that dies."""
    folder = tmp_path_factory.mktemp("low_energy")
    run = Simulation(SCENARIO, 1, tuple(TABLES.values()))
    run.run().trace.write(folder, {"scenario": json.dumps(SCENARIO.model_dump(mode="json"))})
    write_scene(scene_of(SCENARIO, run.floorplan, 1), folder)
    return folder


def table(folder: Path, name: str) -> pd.DataFrame:
    return pd.read_parquet(folder / f"{name}.parquet")


def at(folder: Path, time: Time, *states: str) -> list[Any]:
    """Return the intervals of some *states* that *time* is in."""
    rows = table(folder, "intervals")
    return list(rows[rows.state.isin(states) & (rows.start_ns <= time) & (rows.end_ns > time)].itertuples())


def peer(row: Any) -> int:
    return int(row.detail.removeprefix("peer="))


def ends(folder: Path, time: Time) -> dict[tuple[int, int], int]:
    """Return how many ends each link of a (central, peripheral) has at *time*."""
    found: dict[tuple[int, int], int] = {}
    for row in at(folder, time, "central", "peripheral"):
        link = (row.robot, peer(row)) if row.state == "central" else (peer(row), row.robot)
        found[link] = found.get(link, 0) + 1
    return found


# ---------------------------------------------------------------- what pages are told


def test_a_recorded_run_tells_each_end_of_a_link_once(folder: Path) -> None:
    session = Recorded(folder, lambda: 0.0, playing=False)
    seen = set()
    for time in LOOKED_AT:
        session.wish(Seek(say="seek", time_s=time / S))
        [told], _ = session.look(None)
        links = [(robot, role, other) for _, robot, _, _, _, role, other in told["doing"] if role]
        rows = at(folder, time, "central", "peripheral")
        roles = {"central": "master", "peripheral": "slave"}
        assert sorted(links) == sorted((row.robot, roles[row.state], peer(row)) for row in rows)
        seen.add(len(links))
    assert {0, 2, 6} <= seen


def test_poll_gaps_are_those_between_packets_of_a_central_to_a_peripheral(folder: Path) -> None:
    index, intervals, sent = opened(folder), table(folder, "intervals"), table(folder, "transmissions")
    drawn, parts = Drawn(index.lanes, index.codes), Parts(100 * MS, 190 * MS, 20)
    assert "poll_gap" in {curve.name for curve in curves(drawn)}
    for robot in (1, 2, None):
        gaps: list[tuple[int, float]] = []
        for link in intervals[intervals.state == "peripheral"].itertuples():
            to_it = sent[(sent.source == peer(link)) & (sent.destination == link.robot)]
            polls = to_it.time_ns[(to_it.time_ns >= link.start_ns) & (to_it.time_ns < link.end_ns)].sort_values()
            if robot in (None, link.robot):
                gaps += zip(polls[1:], polls.diff()[1:] / MS, strict=True)
        assert len(gaps) > 60
        found = values("poll_gap", drawn, parts, robot)
        assert found is not None
        for part, low in enumerate(parts.edges[:-1]):
            here = [gap for end, gap in gaps if low <= end < low + parts.step]
            told = [column[part] for column in found]
            expected = [sum(here) / len(here), min(here), max(here)] if here else [np.nan] * 3
            assert told == pytest.approx(expected, nan_ok=True)


def test_every_packet_says_something_and_all_payloads_that_arrive_are_among_it(folder: Path) -> None:
    said: dict[int, list[Any]] = {}
    for row in table(folder, "transmissions").to_dict("records"):
        told = frame_said(SCENARIO, bytes.fromhex(row["body"]), row)
        assert isinstance(told, dict), told
        assert told["low_energy"].get("pdu", row["kind"]) == row["kind"]
        assert ("payload" in told) == (row["length"] > 0)
        said.setdefault(row["source"], []).append(told.get("payload"))
    arrived = table(folder, "messages")
    assert len(arrived) > 100
    for row in arrived.to_dict("records"):
        assert decoded(SCENARIO, bytes.fromhex(row["payload"])) in said[row["sender"]]


def test_the_inspector_takes_a_packet_apart(folder: Path) -> None:
    page = Page(Recorded(folder, playing=False))
    seen = set()
    for number, lane in page.lanes.items():
        if lane["what"] not in ("sent", "received", "messages"):
            continue
        for box in page.everything()[number]:
            what = lane["what"], page.kinds[box.kind]
            if what in seen:
                continue
            seen.add(what)
            told = page.box(number, box.row)["decoded"]
            assert isinstance(told, dict), told
            assert ("low_energy" in told) == (lane["what"] != "messages")
    assert {("sent", "DATA"), ("received", "DATA"), ("sent", "CONTROL"), ("messages", "message")} <= seen


# ---------------------------------------------------------------- what pages draw


@pytest.fixture(scope="module")
def served(folder: Path) -> Iterator[Served]:
    served = Served(Recorded(folder, playing=False))
    yield served
    served.stop()


@pytest.fixture
def page(browser: Browser, served: Served) -> Iterator[Any]:
    with tab(browser, served, own=True) as page:
        page.wait_for_selector("#timeline:not([hidden])")
        settled(page)
        yield page


def drawn_links(page: Any) -> dict[tuple[int, int], int]:
    links = page.evaluate("cosim.seen().links")
    assert len({(each["master"], each["slave"]) for each in links}) == len(links)
    return {(each["master"], each["slave"]): each["ends"] for each in links}


def sought(page: Any, served: Served, time: Time) -> None:
    served.server.session.wish(Seek(say="seek", time_s=time / S))
    page.wait_for_function("time_s => cosim.seen().time_s === time_s", arg=time / S)
    for _ in range(2):
        page.evaluate("() => new Promise(requestAnimationFrame)")


@pytest.mark.slow
def test_the_floor_shows_links_and_searches(page: Any, served: Served, folder: Path) -> None:
    page.evaluate(LABELS)
    seen = set()
    for time in LOOKED_AT:
        page.evaluate("window.labels = {}")
        sought(page, served, time)
        assert drawn_links(page) == ends(folder, time)
        page.evaluate("window.labels = {}")
        page.click("#zoom-in")  # painted anew
        page.evaluate("() => new Promise(requestAnimationFrame)")
        labels = page.evaluate("Object.keys(window.labels)")
        searches = {row.state for row in at(folder, time, "scanning", "initiating")}
        assert searches == set(labels) & {"scanning", "initiating"}
        words = page.inner_text("#robots")
        assert "central" not in words
        assert "peripheral" not in words
        seen |= searches | {len(drawn_links(page))}
    assert {"scanning", "initiating", 0, 3} <= seen


@pytest.mark.slow
def test_a_live_floor_and_timeline_show_links(browser: Browser, folder: Path) -> None:
    live = Live(SCENARIO, 1, playing=False)
    served = Served(live)
    with tab(browser, served, own=True) as page:
        for tick in (1, 2, 3):
            live.wish(Step(say="step", by="tick", count=1))
            page.wait_for_function("time_s => Math.abs(cosim.seen().time_s - time_s) < 1e-6", arg=tick * 0.1)
            for _ in range(2):
                page.evaluate("() => new Promise(requestAnimationFrame)")
            assert drawn_links(page) == ends(folder, tick * 100 * MS)
        page.set_viewport_size({"width": 1366, "height": 2400})
        page.wait_for_function(
            f"() => new Set({LINE}.boxes().filter(({{ what }}) => what === 'piconet')"
            f".map(({{ peer }}) => peer)).size === 3"
        )
    served.stop()
    live.close()


KINDS: Final = """async (kinds) => {
  const { Kinds } = await import("/static/timeline/kinds.js");
  const { paint_member } = await import("/static/timeline/piconets.js");
  const made = new Kinds(), filled = [];
  made.take(kinds, []);
  const pen = { fillRect: () => filled.push(pen.fillStyle), createPattern: () => "pattern" };
  for (const { code } of kinds) paint_member(pen, made, code, 3, [0, 0, 9, 9]);
  const owner = ({ code }) => made.robots.indexOf(made.state_colour(code, 2, 3));
  return [kinds.map(owner), kinds.map((_, at) => made.robots.indexOf(filled[2 * at]))];
}"""
"""Whose colour states of robot 2 have, with robot 3 at the other end; and whose the strip of member 3 has first."""


@pytest.mark.slow
def test_links_have_the_colour_of_their_central_and_strips_that_of_the_peripheral(page: Any, folder: Path) -> None:
    kinds = opened(folder).codes.plain["kinds"]
    links = [next(kind for kind in kinds if kind["name"] == name) for name in ("central", "peripheral")]
    owners, strips = page.evaluate(KINDS, links)
    assert owners == [2, 3]
    assert strips == [-1, 3]  # a central is no member


@pytest.mark.slow
def test_the_timeline_has_a_strip_for_each_peripheral(page: Any, folder: Path) -> None:
    page.set_viewport_size({"width": 1366, "height": 2400})
    look(page, 0, 4 * S)
    strips = {
        (box["robot"], box["peer"], box["start_ns"], box["end_ns"])
        for box in page.evaluate(f"{LINE}.boxes()")
        if box["what"] == "piconet"
    }
    rows = table(folder, "intervals")
    links = rows[rows.state == "peripheral"].itertuples()
    assert strips == {(peer(row), row.robot, row.start_ns, row.end_ns) for row in links}


@pytest.mark.slow
def test_the_header_of_a_lost_packet_is_hatched_as_far_as_its_phy_says(page: Any, folder: Path) -> None:
    frames = table(folder, "frames")
    lost = frames[(frames.part == "header") & (frames.duration_ns == 80_000)].iloc[0]  # a poll on LE 1M
    start = int(lost.time_ns)
    look(page, start - 20_000, start + 120_000)
    [box] = [
        each
        for each in page.evaluate(f"{LINE}.boxes()")
        if (each["what"], each["start_ns"], each["robot"]) == ("sent", start, lost.source)
    ]
    _, y = page.evaluate(f"box => {LINE}.place(box)", box)
    from_ns, to_ns, width_px = window(page)
    top = page.locator(".tl-overlay").bounding_box()["y"]

    def hatched(at_ns: int) -> bool:
        colours: int = page.evaluate(
            """([x, y]) => {
              const { data } = document.querySelector(".tl-content").getContext("2d").getImageData(x - 3, y, 7, 1);
              return new Set([...Array(7).keys()].map((at) => [...data.slice(4 * at, 4 * at + 3)].join(" "))).size;
            }""",
            [round((start + at_ns - from_ns) / (to_ns - from_ns) * width_px), round(y - top) + 3],
        )
        return colours > 1

    assert [hatched(at_ns) for at_ns in (3_000, 50_000)] == [True, True]
    assert [hatched(at_ns) for at_ns in (60_000, 76_000)] == [False, False]


@pytest.mark.slow
def test_a_run_without_slots_is_not_measured_in_any(page: Any) -> None:
    look(page, 1 * S, 1 * S + 2 * MS)
    page.locator(".tl-overlay").hover(position={"x": 100, "y": 60})
    press(page, "1")
    page.locator(".tl-overlay").hover(position={"x": 300, "y": 60})
    press(page, "2")
    page.wait_for_function("() => document.querySelector('.tl-status').textContent.includes('from cursor 1 to 2')")
    assert "slots" not in page.inner_text(".tl-status")
