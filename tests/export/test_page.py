"""The page of a run that needs no server: what Chromium reads from the disk is what the tables hold."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from benchmarks.picture_page import saturated
from cosim.export.recording import NAMES, Recording
from cosim.picture.page import write_page
from cosim.timeline.sensing import SENSED
from cosim.units import S
from tests.export.recordings import called, make, sendings, silences
from tests.tiers import each_value
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
def crowd() -> Whole:
    """Return stations of 802.11 that always have something to send."""
    recording = saturated({"phy": "ofdm", "rate_mbps": 54}, 5, S // 5)
    tables = {name: pd.DataFrame(list(recording.rows(name))) for name in NAMES if recording.count(name)}
    return recording, tables, Path()


@pytest.fixture(scope="module")
def page_file(piconet: Whole, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "a & b.html"
    _, tables, _ = piconet
    boxes = len(tables["frames"]) + len(sendings(tables)) + len(tables["intervals"])
    assert write_page(piconet[0], path, (0, piconet[0].end + 1)) == boxes
    return path


BOXES = """() => Object.fromEntries(["received", "broadcasts", "sent", "states"].map((what) => [what,
  run.lanes.filter((lane) => lane.what === what).flatMap((lane) => [...lane.starts].map((start, row) => {
    const numbers = ["sources", "peers", "channels", "sizes"].map((name) => lane[name] && lane[name][row]);
    const texts = [lane.part, lane.detail].map((words) => words && textOf(words, row));
    return [start, start + lane.lengths[row], lane.robot, word(lane.kinds[row]), ...numbers,
      word(lane.outcomes[row]), ...texts, isLost(lane, row)]; }))]))"""
APART = """() => run.lanes.filter((lane) => lane.what === "states").every((lane) =>
  lane.starts.every((start, row) => !row || lane.starts[row - 1] + lane.lengths[row - 1] <= start))"""
FROM_FRAMES = ("source", "destination", "channel", "length")


def drawn(tables: dict[str, pd.DataFrame]) -> dict[str, list[tuple[Any, ...]]]:
    """Return the boxes that a page is to have, of frames as receivers tell, and of states; sorted."""
    frames, states = tables["frames"], tables["intervals"]
    where = frames["destination"].where(frames["destination"] >= 0, frames["source"])
    lost = ~frames["outcome"].isin(["received", ""])
    columns = [frames["time_ns"], frames["time_ns"] + frames["duration_ns"], where, frames["kind"]]
    columns += [frames[name] for name in (*FROM_FRAMES, "outcome", "part")]
    heard = sorted(zip(*columns, [None] * len(frames), lost, strict=True))
    columns = [states[name] for name in ("start_ns", "end_ns", "robot", "state")]
    none = [[None] * len(states)] * 4
    texts = [[""] * len(states), [None] * len(states), states["detail"], [False] * len(states)]
    return {"frames": heard, "states": sorted(zip(*columns, *none, *texts, strict=True))}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["piconet", "walls", "crowd"])
def test_each_box_in_the_browser_is_a_row_of_the_tables(
    browser: Any, name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    recording, tables, _ = request.getfixturevalue(name)
    write_page(recording, tmp_path / "run.html", (0, recording.end + 1))
    with shown(browser, tmp_path / "run.html") as page:
        read = {what: sorted(map(tuple, boxes)) for what, boxes in page.evaluate(BOXES).items()}
        named = page.evaluate("() => Object.keys(looks)")
        assert page.evaluate(APART), "a click and a zoom look for states from their starts alone"
    wanted = drawn(tables)
    assert sorted(read["received"] + read["broadcasts"]) == wanted["frames"]
    assert [box for box in read["states"] if box[3] not in SENSED] == wanted["states"]
    sent = sendings(tables)
    ends = sent["time_ns"] + sent["duration_ns"]
    assert [box[:4] for box in read["sent"]] == sorted(
        zip(sent["time_ns"], ends, sent["source"], sent["kind"], strict=True)
    )
    if len(tables["transmissions"]):
        told = tables["transmissions"][list(FROM_FRAMES)].value_counts().to_dict()
        assert Counter(box[4:8] for box in read["sent"]) == told
    kinds = {box[3] for what in ("received", "broadcasts", "sent") for box in read[what]}
    states = {box[3] for box in read["states"]}
    assert states - set(SENSED) == set(tables["intervals"]["state"])
    assert named == sorted(kinds) + sorted(states), "the legend, the same each time"


@pytest.mark.slow
def test_places_and_events_in_the_browser_are_what_the_tables_hold(
    browser: Any, page_file: Path, piconet: Whole
) -> None:
    with shown(browser, page_file) as page:
        ticks = page.evaluate("() => [...run.ticks]")
        places = page.evaluate("() => run.robots.map((_, robot) => run.ticks.length && place(robot, run.ticks.at(-1)))")
        events = page.evaluate("() => [...run.events.times].map((time, row) => [time, word(run.events.names[row])])")
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
@pytest.mark.parametrize(("scheme", "size"), each_value(["light", "dark"], [(1280, 720), (390, 844)]))
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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("radio", "part_s", "least"),
    [({"phy": "dsss", "rate_mbps": 11}, 12, 60_000), ({"phy": "ofdm", "rate_mbps": 54}, 4, 300_000)],
    ids=["11", "54"],
)
def test_a_minute_of_802_11_at_saturation_takes_at_most_five(
    radio: dict[str, Any], part_s: int, least: int, tmp_path: Path
) -> None:
    # a part of a minute is simulated: a page has no less beside its boxes for a shorter run
    recording = saturated(radio, 5, part_s * S)
    assert recording.count("transmissions") * 60 / part_s > least
    assert write_page(recording, tmp_path / "run.html", (0, part_s * S)) > 5 * recording.count("transmissions")
    assert (tmp_path / "run.html").stat().st_size * 60 / part_s <= 5_000_000
