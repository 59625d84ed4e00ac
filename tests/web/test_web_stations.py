"""Pages of a run with stations in the background: where they are, what they do, and names that are no robot's."""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cosim.channels.propagation import Propagation, PropagationSettings
from cosim.errors import UserError
from cosim.geometry.segments import segment_grid
from cosim.randomness import Streams
from cosim.units import MS, S
from cosim.web.live import Live
from cosim.web.messages import Seek
from cosim.web.reach import reach
from cosim.web.recorded import Recorded
from cosim.web.timeline import AskCurves, AskRegion
from tests.export.stationed import LAW, NAMES, PLACES, ROBOTS, SCENARIO, Stationed, make
from tests.web.browser import LABELS, Browser, pixels, tab
from tests.web.served import Served, next_of
from tests.web.test_web_floor import places_of
from tests.web.test_web_timeline_page import LINE, look, settled

NO_ROBOT = re.compile(r"robot[ _][2-9]")
"""What calls a station a robot."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Stationed:
    return make(tmp_path_factory.mktemp("stationed"))


@pytest.fixture(params=["recorded", "live"])
def session(request: pytest.FixtureRequest, made: Stationed) -> Iterator[Any]:
    """Return the run from its files, and the same under way, both at its end."""
    if request.param == "recorded":
        session: Any = Recorded(made.folder, playing=False)
        session.wish(Seek(say="seek", time_s=3.0))
    else:
        session = Live(SCENARIO, 1, speed=1000.0)
        session._thread.join(120)
        assert session.state == "ended"
    yield session
    session.close()


# ---------------------------------------------------------------- what the server tells


def test_how_far_a_station_is_heard_is_what_the_law_says(made: Stationed) -> None:
    told = made.scene()
    assert [radio["carried"] for radio in told["radios"]] == [[0, 1], [2, 3], [4, 5]]
    (shown,) = reach(told, 4, PLACES[2])["radios"]
    assert (shown["radio"], shown["kind"]) == (2, "ble")
    law = PropagationSettings.model_validate(LAW["propagation"])
    walls = segment_grid(told["walls_m"])
    propagation = Propagation(law, walls, told["wall_losses_db"], Streams(1).draws("x"))
    places = places_of(shown)
    chosen = np.random.default_rng(3).choice(len(places), 60, replace=False)
    gains = propagation.gains_db(np.vstack([PLACES[2], places[chosen]]))[0, 1:]
    assert np.array(shown["power_dbm"])[chosen] == pytest.approx(SCENARIO.radios[2].power_dbm + gains, abs=0.51)
    with pytest.raises(UserError, match="there is no robot 6: the team has robots 0 to 1"):
        reach(told, 6, (1, 1))


def test_lanes_of_stations_come_after_those_of_robots_by_their_names(session: Any) -> None:
    lanes = session.timeline.told(None)[0]["lanes"]
    owners = [lane["robot"] for lane in lanes if lane["what"] not in ("piconet", "channel")]
    assert owners == sorted(owners)
    assert set(owners) == set(range(len(NAMES)))
    for lane in lanes:
        if lane["what"] == "sent":
            radio = f", radio {lane['radio']}" if lane["robot"] < ROBOTS else ""
            assert lane["name"] == f"{NAMES[lane['robot']]}{radio}: sent"
    strips = {lane["name"] for lane in lanes if lane["what"] == "piconet"}
    assert strips >= {"piconet of station 0, radio 1: station 1", "piconet of station 2, radio 2: station 3"}


WINDOW = {"from_ns": str(2 * S), "to_ns": str(3 * S)}


@pytest.mark.parametrize("whose", [None, 1, 2, 5])
def test_sums_of_the_team_are_without_stations_which_have_their_own(
    session: Any, made: Stationed, whose: int | None
) -> None:
    def of(rows: pd.DataFrame, column: str) -> pd.DataFrame:
        return rows[rows[column] < ROBOTS] if whose is None else rows[rows[column] == whose]

    def within(rows: pd.DataFrame) -> pd.DataFrame:
        return rows[(rows.time_ns >= 2 * S) & (rows.time_ns < 3 * S)]

    frames, payloads = made.tables["frames"], of(made.tables["payloads"], "source")
    sent = within(of(made.tables["transmissions"], "source"))
    heard = within(of(frames, "destination"))
    region = session.timeline.answer(AskRegion(say="region", number=1, robot=whose, **WINDOW))
    assert sum(each["count"] for each in region["sums"] if each["what"] == "sent") == len(sent) > 0
    assert region["received_bytes"] == heard[heard.outcome == "received"].length.sum()
    names = ["sent", "lost", "queue_length"]
    asked = AskCurves(say="curves", number=2, names=names, robot=whose, step_ns=str(1 * S), **WINDOW)
    curves = {each["name"]: each["mean"][0] for each in session.timeline.answer(asked)["curves"]}
    assert curves["sent"] == len(sent)
    assert curves["lost"] == (heard.outcome != "received").sum()
    lasted = payloads.end_ns.clip(2 * S, 3 * S) - payloads.time_ns.clip(2 * S, 3 * S)
    assert curves["queue_length"] == pytest.approx(lasted.sum() / S)


def test_who_asks_for_the_reach_of_a_station_is_answered(made: Stationed) -> None:
    served = Served(Recorded(made.folder, playing=False))
    with served.connect() as page:
        page.send('{"say": "reach", "robot": 3, "x_m": 4, "y_m": 1.5}')
        assert [each["radio"] for each in next_of(page, "reach")["radios"]] == [1]
    served.stop()


# ---------------------------------------------------------------- what the page shows


@pytest.fixture
def page(browser: Browser, made: Stationed) -> Iterator[Any]:
    """Open the recorded run while station 0 sends a payload, with what the page writes on its canvases."""
    frames = made.tables["frames"]
    row = frames[(frames.source == ROBOTS) & (frames.kind == "DM5")].iloc[10]
    run = Recorded(made.folder, playing=False)
    served = Served(run)
    with tab(browser, served, own=True) as page:
        page.evaluate(LABELS)
        run.wish(Seek(say="seek", time_s=(row.time_ns + row.duration_ns / 2) / S))
        page.wait_for_function(f"() => window.labels.s3 && window.labels['DM5 k{row.channel}']")
        page.begun = int(row.time_ns)
        yield page
    served.stop()


@pytest.mark.slow
def test_the_floor_shows_stations_as_squares_with_their_labels_and_frames_between_them(page: Any) -> None:
    seen = page.evaluate("cosim.seen()")
    flying = [frame for frame in seen["frames"] if frame["end_s"] > seen["time_s"]]
    assert [(frame["source"], frame["destination"]) for frame in flying] == [(2, 3)]
    assert {(link["master"], link["slave"]) for link in seen["links"]} >= {(2, 3), (4, 5)}
    labels = page.evaluate("window.labels")
    assert {"0", "1", "s0", "s1", "s2", "s3"} <= set(labels)
    scale = (labels["s2"][0] - labels["s0"][0]) / (PLACES[2][0] - PLACES[0][0])
    assert labels["s1"][0] - labels["s0"][0] == pytest.approx(scale * (PLACES[1][0] - PLACES[0][0]), abs=30)
    assert 4 * 7**2 < pixels(page, "quiet") < 4 * 10**2  # squares of 10 px a side, with a pale edge that is blurred
    page.wait_for_function("() => document.querySelector('#floor-frames tbody').innerText.includes('DM5\\ts0\\ts1')")
    rows = page.locator("#floor-robots tbody tr").all_inner_texts()
    assert [row.split("\t")[:3] for row in rows[ROBOTS:]] == [
        [f"s{number}", f"{x:.2f}", f"{y:.2f}"] for number, (x, y) in enumerate(PLACES)
    ]
    assert "station 3 at 8.5, 6.0" in page.get_attribute("#floor", "aria-label")
    assert "■ stations" in page.locator("#legend").inner_text()


@pytest.mark.slow
def test_a_station_is_chosen_and_heard_while_events_and_map_stay_those_of_the_team(page: Any) -> None:
    names = page.locator("#robots .name").all_inner_texts()
    assert names == NAMES
    states = page.locator("#robots .state").all_inner_texts()
    assert states[ROBOTS:] == ["master of s1", "slave of s0", "master of s3", "slave of s2"]
    events = page.locator("#events li").count()
    page.click("[data-layer=ranges]")
    page.locator("#robots button", has_text="station 2").click()
    page.wait_for_function("() => Object.keys(window.labels).some((text) => text.startsWith('heard down to'))")
    page.wait_for_function("() => location.hash.includes('robot=4')")
    assert page.locator(".tl-labels [aria-pressed=true]").all_inner_texts() == ["station 2", "piconet of s2"]
    assert page.input_value("#of-robot") == ""
    assert page.locator("#events li").count() == events > 10
    page.wait_for_function("() => cosim.seen().beliefs.map?.robot === -1")
    assert not page.locator("#trouble").is_visible()
    page.reload()
    page.wait_for_selector(".tl-labels [aria-pressed=true]")
    assert page.locator("#robots [aria-pressed=true] .name").all_inner_texts() == ["station 2"]


@pytest.mark.slow
def test_the_timeline_names_stations(page: Any) -> None:
    settled(page)
    labels = page.locator(".tl-labels button").all_inner_texts()
    assert [label for label in labels if label.startswith("station")] == NAMES[ROBOTS:]
    assert {"piconet of s0", "piconet of s2"} <= set(labels)
    page.click("#tl-tall")
    look(page, page.begun - 2 * MS, page.begun + 8 * MS)
    told = "DM5, station 0 to station 1"
    for what in ("sent", "received"):
        wanted = f"(box) => box.what === '{what}' && box.kind === 'DM5' && box.robot >= {ROBOTS}"
        box = page.evaluate(f"{LINE}.boxes().find({wanted})")
        page.mouse.move(*page.evaluate(f"box => {LINE}.place(box)", box))
        page.wait_for_function("() => !document.querySelector('.tl-tip').hidden")
        assert page.inner_text(".tl-tip").startswith(told)
        page.mouse.click(*page.evaluate(f"box => {LINE}.place(box)", box))
        page.wait_for_selector("#tl-unpin")
        page.wait_for_function("() => document.querySelector('.tl-pin').textContent.includes('Who heard it')")
        pinned = page.inner_text(".tl-pin")
        assert f"{told}, " in pinned
        assert "station 1\treceived" in pinned
        assert "station in the background" in pinned  # which says nothing
    page.click("#tl-only")
    assert page.inner_text(".tl-status") == "Finding only what is of station 1"
    page.locator("details", has_text="Table of the window").last.locator("summary").click()
    page.wait_for_function("() => document.querySelector('.tl-listing').textContent.includes('station 0: sent')")
    words = page.evaluate("Object.keys(window.labels)")
    assert "→ s1" in " ".join(words)
    assert not NO_ROBOT.search(page.locator("body").inner_text() + " ".join(words))


@pytest.mark.slow
def test_a_run_under_way_shows_stations(browser: Browser) -> None:
    session = Live(SCENARIO, 1, speed=5.0)
    served = Served(session)
    with tab(browser, served, own=True) as page:
        page.wait_for_function("() => document.querySelector('.tl-labels')?.textContent.includes('station 3')")
        page.wait_for_function("() => document.getElementById('state').textContent === 'ended'")
        assert page.locator("#robots .name").all_inner_texts() == NAMES
        assert not NO_ROBOT.search(page.locator("body").inner_text())
    served.stop()
    session.close()
