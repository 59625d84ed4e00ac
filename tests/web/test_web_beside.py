"""Two recorded runs side by side: one clock for both, each page in a frame, and no other page's frame."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import connect

from cosim.errors import UserError
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import TABLES
from cosim.units import S
from cosim.web.beside import Beside
from cosim.web.history import Cursor
from cosim.web.messages import Again, Pause, Play, Seek, Speed, Step
from cosim.web.recorded import Recorded
from cosim.web.scenes import scene_of, write_scene
from cosim.web.server import PAIR
from tests.web.browser import GRAVE, Browser, axe
from tests.web.commanded import commanded
from tests.web.console import PLAIN
from tests.web.served import Served, next_of
from tests.web.test_web_browser import WAITS
from tests.web.test_web_recorded import Wall
from tests.web.test_web_server import refused


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return the traces of a run of 6 s and of one of 9 s, whose events are half a second later."""
    made = []
    for name, calls, start_s in (("short", 5, 0.0), ("long", 8, 0.5)):
        protocol = {"use": "tests.web.console:SPEC", "parameters": {"calls": calls}}
        scenario = Scenario.model_validate(PLAIN | {"protocol": protocol, "faults": []})
        run = Simulation(scenario, 1, tuple(TABLES.values()))
        run.begin()
        run.advance(round(start_s * S))
        if start_s:
            run.operate(0, b"{}")
        run.advance(20 * S)
        folder = tmp_path_factory.mktemp("traces") / name
        run.trace.write(folder)
        write_scene(scene_of(scenario, run.floorplan, 1), folder)
        made.append(folder)
    return made


@pytest.fixture
def wall() -> Wall:
    return Wall()


@pytest.fixture
def both(folders: list[Path], wall: Wall) -> Beside:
    return Beside([Recorded(folder, wall, playing=False) for folder in folders])


def seen(both: Beside) -> list[tuple[float, str, float]]:
    """Return the time, state and speed that each page is told: the one around first."""
    told: list[tuple[float, str, float]] = []
    for session in (both, *both.runs):
        [now], _ = session.look(None)
        told.append((now["time_s"], now["state"], now["speed"]))
    return told


def test_what_one_is_asked_for_happens_for_both(both: Beside, wall: Wall):
    first, second = both.runs
    assert seen(both) == [(0, "paused", 1)] * 3
    first.wish(Seek(say="seek", time_s=2.0))
    assert seen(both) == [(2, "paused", 1)] * 3
    second.wish(Speed(say="speed", speed=2))
    both.wish(Play(say="play"))
    wall.now_s += 0.5
    assert seen(both) == [(3, "playing", 2)] * 3
    second.wish(Pause(say="pause"))
    wall.now_s += 5
    assert seen(both) == [(3, "paused", 2)] * 3
    first.wish(Step(say="step", by="tick", count=-3))
    assert seen(both) == [(pytest.approx(2.7), "paused", 2)] * 3


def test_the_clock_goes_on_until_the_longest_has_ended(folders: list[Path], both: Beside, wall: Wall):
    ends_s = [Recorded(folder).scene["duration_s"] for folder in folders]
    assert ends_s[0] < ends_s[1]
    assert [run["duration_s"] for run in both.scene["runs"]] == ends_s
    assert both.scene["duration_s"] == both.runs[0].scene["duration_s"] == ends_s[1]
    both.wish(Seek(say="seek", time_s=ends_s[0] + 1))
    assert seen(both) == [(pytest.approx(ends_s[0] + 1), "paused", 1)] * 3
    both.wish(Play(say="play"))
    wall.now_s += 100
    assert seen(both) == [(ends_s[1], "ended", 1)] * 3
    both.wish(Play(say="play"))
    assert seen(both) == [(0, "playing", 1)] * 3


def test_the_next_event_is_that_of_either(folders: list[Path], both: Beside):
    times = sorted({round(row[0] * S) for folder in folders for row in Recorded(folder).scene["marks"]["rows"]})
    assert 0.4 * S < times[0] < 0.6 * S  # of the second run only
    reached = []
    for _ in range(3):
        both.wish(Step(say="step", by="event"))
        reached.append(both.clock.now)
    assert reached == times[:3]
    both.wish(Step(say="step", by="event", count=-2))
    assert both.clock.now == times[0]


def test_what_no_recorded_run_can_do_is_told(both: Beside):
    with pytest.raises(UserError, match="go back to its beginning"):
        both.wish(Again(say="again"))
    with pytest.raises(UserError, match="has no slots"):
        both.wish(Step(say="step", by="slot"))


def test_a_page_is_told_what_is_new_only(both: Beside):
    cursor: Cursor | None = None
    told, cursor = both.look(cursor)
    assert len(told) == 1
    assert both.look(cursor)[0] == []
    both.wish(Seek(say="seek", time_s=1.0))
    assert both.look(cursor)[0][0]["time_s"] == 1


# ---------------------------------------------------------------- the server


@pytest.fixture
def served(both: Beside) -> Iterator[Served]:
    made = Served(both, page=PAIR, framed=both.runs)
    yield made
    made.stop()


def test_pages_are_in_frames_of_this_server_only(served: Served, folders: list[Path]):
    for path in ("/", "/runs/0/", "/runs/1/"):
        assert "frame-ancestors 'self';" in served.get(path)[0].headers["content-security-policy"]
        assert served.get(path, Origin="http://evil.example")[0].status == 403
        assert served.get(path, Host="evil.example")[0].status == 403
    assert served.get("/runs/2/")[0].status == 404
    alone = Served(Recorded(folders[0], playing=False))
    assert "frame-ancestors 'none';" in alone.get("/")[0].headers["content-security-policy"]
    assert alone.get("/runs/0/")[0].status == 404
    alone.stop()


def test_all_sockets_are_guarded(both: Beside):
    guarded = Served(both, "yes", page=PAIR, framed=both.runs)
    assert refused(guarded) == 403
    for number, run in enumerate(both.runs):
        address = f"ws://127.0.0.1:{guarded.port}/runs/{number}/socket"
        with pytest.raises(Exception, match="403"), connect(address, proxy=None):
            pass
        with (
            pytest.raises(Exception, match="403"),
            connect(f"{address}?token=yes", proxy=None, additional_headers={"Origin": "http://evil.example"}),
        ):
            pass
        with connect(f"{address}?token=yes", proxy=None) as page:
            assert next_of(page, "scene")["duration_s"] == run.scene["duration_s"]
    guarded.stop()


# ---------------------------------------------------------------- the page


def at(page: Any, time_s: str) -> None:
    """Wait until the page and those in its frames are at a time."""
    for frame in page.frames:
        frame.wait_for_function(f"() => document.getElementById('time')?.textContent.startsWith('{time_s}')")


WINDOW = "document.getElementById('timeline').timeline.window()"
WIDTH = f"() => {WINDOW}.to_ns - {WINDOW}.from_ns"


def windows(page: Any) -> list[tuple[int, int]]:
    """Return which part of the runs each timeline shows."""
    shown = [frame.evaluate(WINDOW) for frame in page.frames[1:]]
    return [(each["from_ns"], each["to_ns"]) for each in shown]


@pytest.mark.slow
@pytest.mark.parametrize("size", [(1280, 720), (390, 844)])
def test_two_floors_have_one_transport(browser: Browser, served: Served, size: tuple[int, int]):
    page = browser.open()
    page.set_default_timeout(20_000)
    page.set_viewport_size({"width": size[0], "height": size[1]})
    faults: list[str] = []
    page.on("pageerror", lambda fault: faults.append(str(fault)))
    page.on("console", lambda told: faults.append(told.text) if told.type == "error" else None)
    page.goto(served.address)
    at(page, "0.00")
    assert page.inner_text("#name") == "short beside long"
    titles = page.locator("h2").all_inner_texts()
    assert [title.split(",")[0] for title in titles] == ["short: consoles", "long: consoles"]
    page.keyboard.press("ArrowRight")
    at(page, "0.10")
    _, left, right = page.frames
    assert not left.locator("#transport").is_visible()
    right.locator("#floor").press("ArrowRight")
    at(page, "0.20")
    page.locator("#scrub").fill("3.5")
    at(page, "3.5")
    left.locator("#events button").first.click()
    at(page, "3.0")
    boxes = [frame.bounding_box() for frame in page.locator("iframe").all()]
    axis = "x" if size[0] > 800 else "y"
    assert boxes[1][axis] >= boxes[0][axis] + boxes[0]["width" if axis == "x" else "height"] - 2
    assert min(box["height"] for box in boxes) > 400
    left.locator(".tl-overlay").focus()
    whole = windows(page)
    assert whole[0] == whole[1]
    page.keyboard.press("w")
    left.wait_for_function(WIDTH + f" < {whole[0][1] - whole[0][0]}")
    shared = windows(page)
    right.wait_for_function(WIDTH + f" === {shared[0][1] - shared[0][0]}")
    assert windows(page) == [shared[0]] * 2
    page.click("#tied")
    right.locator(".tl-overlay").press("w")
    right.wait_for_function(WIDTH + f" < {shared[0][1] - shared[0][0]}")
    page.wait_for_timeout(400)
    assert windows(page)[0] == shared[0]
    assert page.url.split("#")[1].startswith("t=3")
    assert page.url.endswith("tied=no")
    page.evaluate(axe())
    assert [found for found in page.evaluate(GRAVE) if found[1] in ("moderate", "serious", "critical")] == []
    page.context.close()
    assert not faults, faults


@pytest.mark.slow
def test_who_asks_for_a_connection_begins_the_waiting_times_anew(browser: Browser, served: Served):
    page = browser.open()
    page.add_init_script(WAITS)
    page.goto(served.address)
    at(page, "0.00")
    served.stop()
    page.wait_for_function("() => window.waits.length === 2")
    page.click("#reconnect")
    page.wait_for_function("() => window.waits.length === 3")
    assert page.evaluate("() => window.waits") == [1000, 2000, 1000]
    page.context.close()


# ---------------------------------------------------------------- the command


def test_only_recorded_runs_are_shown_side_by_side(folders: list[Path], cosim: Any):
    for words in ((str(folders[0]), "pseudonet_coverage"), ("pseudonet_coverage", str(folders[0]))):
        ended = cosim("view", *words)
        assert (ended.code, ended.out) == (2, "")
        assert ended.err.count("\n") == 1
        assert "pseudonet_coverage: two runs side by side are recorded ones" in ended.err


@pytest.mark.slow
def test_two_traces_are_shown_by_one_command(folders: list[Path]):
    with commanded("view", *folders, "--paused", "--token") as shown, connect(shown.socket, proxy=None) as page:
        assert [run["folder"] for run in json.loads(page.recv(timeout=30))["runs"]] == ["short", "long"]
