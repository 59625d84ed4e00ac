"""The page of a run that needs no server: what Chromium reads from the disk is what the tables hold."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from cosim.channels.adhoc.channel import AdhocChannel
from cosim.channels.adhoc.settings import AdhocSettings
from cosim.export.recording import DRAWN, Recording, of_run
from cosim.kernel import Kernel
from cosim.picture.page import write_page
from cosim.randomness import Streams
from cosim.trace import Trace
from cosim.units import S
from experiments.saturation_throughput.saturation import Host, Network, Parameters, Tally
from tests.export.recordings import called, make, sendings, silences
from tests.web.browser import GRAVE, axe

Whole = tuple[Recording, dict[str, pd.DataFrame], Path]


@contextmanager
def shown(
    browser: Any, path: Path, at: str = "", scheme: str = "light", size: tuple[int, int] = (1280, 720)
) -> Iterator[Any]:
    """Open the page in the file *path* without a network; afterwards nothing may have gone wrong in it."""
    page = browser.open()
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", lambda told: faults.append(told.text) if told.type == "error" else None)
    page.on("request", lambda asked: faults.append(asked.url) if not asked.url.startswith("file:") else None)
    page.context.set_offline(True)
    page.emulate_media(color_scheme=scheme)
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.goto(f"{path.as_uri()}{at}")
    page.wait_for_selector("body[data-ready]")
    try:
        yield page
    finally:
        page.context.close()
    assert not faults, faults


@pytest.fixture(scope="module")
def page_file(piconet: Whole, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "a & b.html"
    _, tables, _ = piconet
    boxes = len(tables["frames"]) + len(sendings(tables)) + len(tables["intervals"])
    assert write_page(piconet[0], path, (0, piconet[0].end + 1)) == boxes
    return path


LANES = """() => run.lanes.filter((lane) => lane.what === "received").flatMap((lane) =>
  [...lane.starts].map((start, row) => [start, start + lane.lengths[row], lane.sources[row], lane.robot,
    word(lane.kinds[row]), lane.channels[row], word(lane.outcomes[row]), word(lane.part[row]), isLost(lane, row)]))"""


@pytest.mark.slow
def test_what_the_browser_reads_is_what_the_table_holds(browser: Any, page_file: Path, piconet: Whole) -> None:
    frames = piconet[1]["frames"]
    with shown(browser, page_file) as page:
        read = page.evaluate(LANES)
        ticks = page.evaluate("() => [...run.ticks]")
        places = page.evaluate("() => run.robots.map((_, robot) => run.ticks.length && place(robot, run.ticks.at(-1)))")
        events = page.evaluate("() => [...run.events.times].map((time, row) => [time, word(run.events.names[row])])")
    names = ("time_ns", "source", "destination", "kind", "channel", "outcome", "part")
    columns = {name: frames[name].tolist() for name in names}
    ends = (frames["time_ns"] + frames["duration_ns"]).tolist()
    lost = (frames["outcome"] != "received").tolist()
    starts, *others = columns.values()
    assert sorted(map(tuple, read)) == sorted(zip(starts, ends, *others, lost, strict=True))
    poses = piconet[1]["poses"]
    assert ticks == sorted(set(poses["time_ns"]))
    last = poses[poses["time_ns"] == ticks[-1]]
    for (x, y, _), row in zip(places, last.itertuples(), strict=True):
        assert (x, y) == pytest.approx((row.x_m, row.y_m), abs=0.0051)  # a page keeps centimetres
    assert events == piconet[1]["events"][["time_ns", "event"]].values.tolist()


SILENCES = """() => run.lanes.filter((lane) => lane.what === "states").flatMap((lane) =>
  [...lane.starts].map((start, row) =>
    [start, start + lane.lengths[row], lane.robot, lane.radio, word(lane.kinds[row])]))
  .filter((box) => box[4] === "busy" || box[4] === "NAV")"""


@pytest.mark.slow
def test_a_page_of_802_11_has_carrier_sense_and_the_names_of_routers_packets(
    browser: Any, line: tuple[Recording, dict[str, pd.DataFrame]], tmp_path: Path
) -> None:
    recording, tables = line
    write_page(recording, tmp_path / "run.html", (0, recording.end + 1))
    with shown(browser, tmp_path / "run.html") as page:
        read = page.evaluate(SILENCES)
        sent = page.evaluate(SENT)
        legend = page.locator("#legend").inner_text()
    expected = [
        (*span, robot, radio, what)
        for (robot, radio, what), each in silences(recording, tables).items()
        for span in each
    ]
    assert sorted(map(tuple, read)) == sorted(expected)
    columns = (tables["transmissions"][name] for name in ("time_ns", "source", "kind"))
    names = called(tables)
    assert sorted(map(tuple, sent)) == sorted(
        (time, source, names.get((time, source), kind)) for time, source, kind in zip(*columns, strict=True)
    )
    assert {"busy", "NAV", "RREQ", "RREP"} < set(legend.split())


SENT = """() => run.lanes.filter((lane) => lane.what === "sent").flatMap((lane) =>
  [...lane.starts].map((start, row) => [start, lane.robot, word(lane.kinds[row])]))"""


@pytest.mark.slow
def test_the_keyboard_finds_the_first_lost_frame_and_reads_why(browser: Any, page_file: Path, piconet: Whole) -> None:
    frames = piconet[1]["frames"]
    lost = frames[frames["outcome"] != "received"].iloc[0]
    with shown(browser, page_file) as page:
        page.keyboard.press("l")
        told = page.locator("#chosen").inner_text().split("\n")
        assert f"{lost['time_ns'] / 1e9:.9f} s" in told
        assert told[told.index("outcome") + 1] == lost["outcome"]
        assert told[told.index("lost part") + 1] == lost["part"]
        assert told[told.index("RF channel") + 1] == f"{lost['channel']}, {2402 + lost['channel']} MHz"
        seen = page.evaluate("() => view.from <= now && now <= view.to")
        assert seen
        for _ in range((frames["outcome"] != "received").sum() + 1):
            page.keyboard.press("l")
        assert page.locator("#chosen").inner_text() == "There is none any more."


@pytest.mark.slow
def test_zoom_pan_and_a_click_choose_a_box(browser: Any, page_file: Path, piconet: Whole) -> None:
    frame = piconet[1]["frames"].iloc[1500]
    with shown(browser, page_file, f"#t={frame['time_ns'] / 1e9}&span=0.01") as page:
        wide = page.evaluate("() => view.to - view.from")
        assert wide == pytest.approx(10e6)
        spot = page.evaluate(
            """([start, robot]) => {
            const lane = run.lanes.find((each) => each.robot === robot && each.what === "received");
            const row = lower(lane.starts, start);
            return [frame.X(start) + 1, lane.y + 5, lane.starts[row] === start]; }""",
            [int(frame["time_ns"]), int(frame["destination"])],
        )
        assert spot[2]
        page.locator("#lanes").click(position={"x": spot[0], "y": spot[1]})
        assert f"{frame['time_ns'] / 1e9:.9f} s" in page.locator("#chosen").inner_text()
        box = page.locator("#lanes").bounding_box()
        page.mouse.move(box["x"] + 640, box["y"] + 40)
        page.mouse.wheel(0, 400)
        page.wait_for_function(f"() => Math.abs((view.to - view.from) / {wide} - Math.E) < 0.01")
        before = page.evaluate("() => view.from")
        page.mouse.down()
        page.mouse.move(box["x"] + 540, box["y"] + 40, steps=4)
        page.mouse.up()
        assert page.evaluate("() => view.from") > before
        page.locator("#all").click()
        assert page.evaluate("() => view.to - view.from === run.to - run.from")


@pytest.mark.slow
def test_it_plays_in_simulated_time(browser: Any, page_file: Path) -> None:
    with shown(browser, page_file) as page:
        page.select_option("#speed", "10")
        page.keyboard.press("Space")
        page.wait_for_function("() => now > 2e9")
        page.keyboard.press("Space")
        stopped = page.evaluate("() => now")
        page.wait_for_timeout(100)
        assert page.evaluate("() => now") == stopped
        assert page.locator("#play").inner_text() == "Play"


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [(1280, 720), (390, 844)], ids=str)
def test_axe_finds_nothing_grave(browser: Any, page_file: Path, scheme: str, size: tuple[int, int]) -> None:
    with shown(browser, page_file, "#t=5&span=0.05", scheme, size) as page:
        page.keyboard.press("n")
        page.evaluate(axe())
        assert not [each for each in page.evaluate(GRAVE) if each[1] not in (None, "minor")]
        assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")


# ---------------------------------------------------------------- size


@pytest.mark.slow
def test_a_minute_of_a_piconet_with_idle_frames_takes_at_most_a_megabyte(tmp_path: Path) -> None:
    recording, tables = make(("examples/2_bluetooth.yaml", ("duration_s=60", "channel.idle_frames=true")))
    assert recording.size == 4
    assert len(tables["frames"]) > 10_000
    write_page(recording, tmp_path / "run.html", (0, recording.end + 1))
    assert (tmp_path / "run.html").stat().st_size <= 1_000_000


PART_S = 12
"""How much of a minute is simulated: a page has no less beside its boxes for a shorter run."""


def saturated(radio: dict[str, Any], stations: int) -> Recording:
    """Return a part of a minute of *stations* that always have something to send, in the open."""
    kernel, trace = Kernel(), Trace(DRAWN)
    unlimited = {"short_retries": None, "long_retries": None}
    channel = AdhocChannel(AdhocSettings(**radio, **unlimited), kernel, trace, stations, Streams(1))
    given = Parameters(network=Network(radio=AdhocSettings(**radio)), stations=stations, payloads=10**9)
    tally = Tally(channel, given)
    for address in range(stations):
        channel.attach(address, Host(address, tally, stations, bytes(1500)))
    kernel.run(PART_S * S)
    bounds = {"bounds_m": [0, 0, 10, 10], "walls_m": [], "polygons_m": [], "radii_m": [0.2] * stations}
    scenario = {"channel": AdhocSettings(**radio).model_dump(mode="json")}
    return of_run(trace, {"name": "saturated", **bounds}, {"scenario": json.dumps(scenario)})


@pytest.mark.slow
def test_a_minute_of_802_11_at_saturation_takes_at_most_five(tmp_path: Path) -> None:
    recording = saturated({"phy": "dsss", "rate_mbps": 11}, stations=5)
    assert recording.count("transmissions") * 60 / PART_S > 60_000
    assert write_page(recording, tmp_path / "run.html", (0, PART_S * S)) > 5 * recording.count("transmissions")
    assert (tmp_path / "run.html").stat().st_size * 60 / PART_S <= 5_000_000
