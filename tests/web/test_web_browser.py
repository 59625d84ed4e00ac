"""The page in a real browser: a recorded run and one under way, by mouse and by keyboard, and what goes wrong."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import TABLES
from cosim.units import S
from cosim.web.live import Live
from cosim.web.recorded import Recorded
from cosim.web.scenes import scene_of, write_scene
from cosim.web.server import Session
from tests.web.browser import Browser, pixels, tab
from tests.web.console import PLAIN
from tests.web.served import Served, next_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the trace of a run in which robot 0 drives, robot 2 is killed, and all call and mark."""
    folder = tmp_path_factory.mktemp("trace")
    faults = [{"kind": "kill", "robot": 2, "at_s": 4.0}]
    protocol = {"use": "tests.web.console:SPEC", "parameters": {"calls": 8}}
    plain = Scenario.model_validate(PLAIN | {"faults": faults, "protocol": protocol})
    run = Simulation(plain, 1, tuple(TABLES.values()))
    run.begin()
    run.operate(0, b'{"go": [10.0, 3.0]}')
    run.advance(20 * S)
    run.trace.write(folder)
    write_scene(scene_of(plain, run.floorplan, 1) | {"base_m": [1.0, 6.0]}, folder)
    return folder


@pytest.fixture
def serve() -> Iterator[Any]:
    """Return a function that serves a session; all are ended after the test."""
    begun: list[tuple[Served, Session]] = []

    def begin(session: Session, port: int = 0) -> Served:
        begun.append((Served(session, port=port), session))
        return begun[-1][0]

    yield begin
    for served, session in begun:
        if served.thread.is_alive():
            served.stop()
        session.close()


def live(playing: bool = True, speed: float = 1.0, **parameters: Any) -> Live:
    duration_s = parameters.pop("duration_s", 10)
    protocol = {"use": "tests.web.console:SPEC", "parameters": parameters}
    return Live(Scenario.model_validate(PLAIN | {"protocol": protocol, "duration_s": duration_s}), 1, playing, speed)


def state(page: Any, name: str) -> None:
    """Wait until the page says that the run is in the state *name*."""
    page.wait_for_function("name => document.getElementById('state').textContent === name", arg=name)


def seconds(page: Any) -> float:
    return float(page.inner_text("#time").split()[0])


# ---------------------------------------------------------------- recorded


def test_a_recorded_run_is_played_by_the_keyboard(browser: Browser, serve: Any, folder: Path):
    with tab(browser, serve(Recorded(folder, playing=False))) as page:
        assert page.inner_text("#name") == "consoles"
        assert page.inner_text("#about").endswith("recorded")
        state(page, "paused")
        assert seconds(page) == 0
        page.keyboard.press("ArrowRight")
        page.wait_for_function("() => document.getElementById('time').textContent.startsWith('0.10')")
        page.keyboard.press("ArrowLeft")
        page.wait_for_function("() => document.getElementById('time').textContent.startsWith('0.00')")
        page.keyboard.press("Space")
        state(page, "playing")
        page.keyboard.press("Space")
        state(page, "paused")
        assert 0 < seconds(page) < 8
        page.locator("#scrub").press("Space")
        state(page, "playing")
        page.locator("#scrub").press("Space")
        state(page, "paused")
        page.evaluate("document.activeElement.blur()")
        page.keyboard.press("End")
        state(page, "ended")
        end_s = seconds(page)
        assert 8 < end_s < 8.2
        page.keyboard.press("Home")
        page.wait_for_function("() => document.getElementById('time').textContent.startsWith('0.00')")
        page.keyboard.press("+")
        page.wait_for_function("() => document.getElementById('speed').value === '2'")


def test_every_control_is_reached_by_the_tabulator(browser: Browser, serve: Any, folder: Path):
    with tab(browser, serve(Recorded(folder, playing=False))) as page:
        page.keyboard.press("End")
        state(page, "ended")
        reached = set()
        for _ in range(150):
            page.keyboard.press("Tab")
            reached.add(page.evaluate("document.activeElement.id || document.activeElement.closest('ul, ol')?.id"))
        controls = {"floor", "follow", "trail", "legend", "robots", "kind", "of-robot", "filter", "events"}
        assert controls | {"start", "back", "play", "step", "step-by", "end", "scrub", "speed"} <= reached


def test_every_control_has_a_name_for_those_who_do_not_see_it(browser: Browser, serve: Any, folder: Path):
    with tab(browser, serve(Recorded(folder, playing=False))) as page:
        for name in ("Play", "A step on", "A step back", "To the beginning", "To the end"):
            assert page.get_by_role("button", name=name, exact=True).count() == 1
        assert page.get_by_role("slider", name="Time").count() == 1
        assert page.get_by_role("combobox", name="Speed").count() == 1
        assert page.get_by_role("searchbox").get_attribute("aria-label")
        assert "robot 0 at 2.0, 2.0" in page.get_attribute("#floor", "aria-label")


def test_one_can_scrub_to_any_time_and_sees_what_was_then(browser: Browser, serve: Any, folder: Path):
    with tab(browser, serve(Recorded(folder, playing=False))) as page:
        page.locator("#scrub").fill("5.95")
        page.wait_for_function("() => document.getElementById('time').textContent.startsWith('5.95')")
        page.wait_for_function("() => document.querySelectorAll('#events li').length > 10")
        assert "robot 2 †" in page.inner_text("#robots")
        assert page.inner_text("#events li >> nth=0").startswith("5.")  # the newest is the first
        page.locator("#scrub").fill("2")
        page.wait_for_function("() => document.getElementById('time').textContent.startsWith('2.00')")
        page.wait_for_function("() => !document.getElementById('robots').textContent.includes('†')")
        assert page.locator("#events li").count() < 8


def test_an_event_leads_to_its_time(browser: Browser, serve: Any, folder: Path):
    with tab(browser, serve(Recorded(folder, playing=False))) as page:
        page.keyboard.press("End")
        page.fill("#filter", "killed")
        page.wait_for_function("() => document.querySelectorAll('#events li').length === 1")
        page.locator("#events").get_by_role("button", name="Killed").click()
        page.wait_for_function("() => document.getElementById('time').textContent.startsWith('4.00')")


def test_a_robot_can_be_selected_in_the_list_and_on_the_floor(browser: Browser, serve: Any, folder: Path):
    with tab(browser, serve(Recorded(folder, playing=False))) as page:
        page.keyboard.press("End")
        state(page, "ended")
        page.locator("#robots button").nth(1).click()
        page.wait_for_function(
            "() => [...document.querySelectorAll('#events li')].every(row => / 1 /.test(row.textContent))"
        )
        page.keyboard.press("Escape")
        page.wait_for_function(
            "() => [...document.querySelectorAll('#events li')].some(row => / 0 /.test(row.textContent))"
        )
        box = page.locator("#floor").bounding_box()
        scale = min((box["width"] - 44) / 12, (box["height"] - 66) / 8)  # buttons are above
        across, up = box["width"] / 2 + (4 - 6) * scale, box["height"] / 2 + 11 - (2 - 4) * scale
        page.mouse.click(box["x"] + across, box["y"] + up)  # robot 1 stands at 4, 2
        page.wait_for_function(
            "() => document.querySelectorAll('#robots button')[1].getAttribute('aria-pressed') === 'true'"
        )


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_floor_shows_walls_base_robots_and_their_trails(browser: Browser, serve: Any, folder: Path, scheme: str):
    with tab(browser, serve(Recorded(folder, playing=False)), scheme=scheme) as page:
        page.locator("#scrub").fill("7.5")
        page.wait_for_function("() => document.getElementById('time').textContent.startsWith('7.50')")
        page.wait_for_timeout(200)
        for colour, least in [("wall", 1000), ("base", 40), ("robot-0", 40), ("robot-1", 40)]:
            assert pixels(page, colour) >= least, colour
        assert pixels(page, "robot-2") < 20  # it is dead: only an outline is left


def test_frames_fly_and_fade(browser: Browser, serve: Any, folder: Path):
    with tab(browser, serve(Recorded(folder, playing=False))) as page:
        page.locator("#scrub").fill("0.95")
        page.wait_for_function("() => document.getElementById('time').textContent.startsWith('0.95')")
        assert "0 frames" in page.inner_text("#counts")
        page.click("#step")
        page.wait_for_function("() => document.getElementById('counts').textContent.startsWith('3 frames')")


# ---------------------------------------------------------------- under way


def test_a_run_under_way_is_paused_stepped_and_played_to_its_end(browser: Browser, serve: Any):
    with tab(browser, serve(live(playing=False))) as page:
        state(page, "paused")
        assert page.is_disabled("#scrub")
        assert page.is_disabled("#back")
        page.click("#step")
        page.wait_for_function("() => document.getElementById('time').textContent.startsWith('0.10')")
        page.select_option("#speed", "10")
        page.click("#play")
        state(page, "ended")
        page.wait_for_selector("#metrics tr")
        metrics = page.inner_text("#metrics")
        assert "heard" in metrics
        assert page.is_disabled("#play")
        assert page.locator("#events li").count() == 9


def test_a_run_that_has_begun_with_a_speed_of_its_own_shows_it(browser: Browser, serve: Any):
    session = live(playing=False, speed=30.0)
    with tab(browser, serve(session)) as page:
        state(page, "paused")
        assert page.input_value("#speed") == "30"
        assert page.locator("#speed option").all_inner_texts()[6:9] == ["10 ×", "20 ×", "30 ×"]
        page.keyboard.press("-")
        assert page.input_value("#speed") == "20"
        while session.look(None)[0][0]["speed"] != 20:
            page.wait_for_timeout(20)


def test_a_second_page_sees_the_same_and_a_closed_one_leaves_nothing(browser: Browser, serve: Any):
    served = serve(live(patient=True, duration_s=1000))
    with tab(browser, served) as one:
        with tab(browser, served, own=True) as two:
            served.wait_for(2)
            one.keyboard.press("Space")
            for page in (one, two):
                state(page, "paused")
            assert seconds(one) == seconds(two)
            assert one.inner_text("#robots") == two.inner_text("#robots")
            two.keyboard.press("Space")
            state(one, "playing")
        served.wait_for(1)
    served.wait_for(0)


def test_a_run_that_breaks_says_why(browser: Browser, serve: Any):
    with tab(browser, serve(live(break_at_s=0.5))) as page:
        state(page, "failed: RuntimeError: the console has broken")


def test_what_cannot_be_done_is_told(browser: Browser, serve: Any):
    served = serve(live(patient=True, duration_s=1000))
    with tab(browser, served) as page:
        page.evaluate(
            "() => { const s = new WebSocket(`ws://${location.host}/socket`); window.told = [];"
            " s.onmessage = (e) => window.told.push(JSON.parse(e.data).say);"
            " s.onopen = () => s.send('nonsense'); }"
        )
        page.wait_for_function("() => window.told.includes('error')")


# ---------------------------------------------------------------- what goes wrong


def test_a_page_whose_server_has_gone_says_so_and_comes_back(browser: Browser, serve: Any):
    served = serve(live(patient=True, duration_s=1000))
    with tab(browser, served) as page:
        state(page, "playing")
        served.stop()
        page.wait_for_selector("#trouble:not([hidden])")
        assert "server" in page.inner_text("#trouble-text")
        page.locator("#robots button").nth(1).click()  # what is drawn anew says no other
        page.wait_for_function("() => document.querySelector('#robots [aria-pressed=true]')")
        assert page.inner_text("#state") == "not connected"
        page.click("#reconnect")  # nobody is there yet
        page.wait_for_function("() => document.getElementById('trouble-text').textContent.includes('does not answer')")
        serve(live(playing=False, patient=True), port=served.port)
        page.click("#reconnect")
        state(page, "paused")
        assert page.is_hidden("#trouble")
        assert all("WebSocket connection" in fault for fault in page.faults)
        page.faults.clear()


WAITS = """
    window.waits = [];
    const plain = window.setTimeout;
    window.setTimeout = (call, ms, ...more) => {
      if (String(call).includes("connect")) window.waits.push(ms);
      return plain(call, ms, ...more);
    };
"""
"""Notes how long a page waits until it connects again."""


def test_who_asks_for_a_connection_begins_the_waiting_times_anew(browser: Browser, serve: Any):
    served = serve(live(patient=True, duration_s=1000))
    page = browser.open()
    page.add_init_script(WAITS)
    page.goto(served.address)
    state(page, "playing")
    served.stop()
    page.wait_for_function("() => window.waits.length === 2")
    page.click("#reconnect")
    page.wait_for_function("() => window.waits.length === 3")
    assert page.evaluate("() => window.waits") == [1000, 2000, 1000]
    page.context.close()


HIDDEN = """
    () => {
      window.said = [];
      new MutationObserver(() => window.said.push(document.getElementById("trouble-text").textContent))
        .observe(document.getElementById("trouble-text"), { childList: true, characterData: true, subtree: true });
      window.dispatchEvent(new PageTransitionEvent("pagehide", { persisted: true }));
    }
"""
"""What a browser does to a page that is left and may come back, as far as the page can tell."""


def test_a_page_that_is_left_and_comes_back_from_the_history_connects_without_a_word(browser: Browser, serve: Any):
    served = serve(live(playing=False, patient=True))
    with tab(browser, served) as page:
        state(page, "paused")
        page.evaluate(HIDDEN)
        served.wait_for(0)
        page.evaluate('() => window.dispatchEvent(new PageTransitionEvent("pageshow", { persisted: true }))')
        served.wait_for(1)
        state(page, "paused")
        assert [said for said in page.evaluate("() => window.said") if said] == []
        assert page.is_hidden("#trouble")


def test_a_page_that_comes_back_from_the_history_says_that_its_server_has_gone(browser: Browser, serve: Any):
    served = serve(live(playing=False, patient=True))
    with tab(browser, served, own=True) as page:
        state(page, "paused")
        page.evaluate(HIDDEN)
        served.wait_for(0)
        served.stop()
        page.evaluate('() => window.dispatchEvent(new PageTransitionEvent("pageshow", { persisted: true }))')
        state(page, "not connected")
        assert "does not answer" in page.inner_text("#trouble-text")
        assert page.is_visible("#reconnect")
        assert all("WebSocket connection" in fault for fault in page.faults)
        page.faults.clear()


def test_a_page_too_many_says_so_and_comes_when_another_has_gone(
    browser: Browser, serve: Any, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("cosim.web.server.MOST_PAGES", 1)
    served = serve(live(playing=False, patient=True))
    page = browser.open()
    with served.connect() as other:
        next_of(other, "scene")
        page.goto(served.address)
        page.wait_for_function(
            "() => document.getElementById('trouble-text').textContent === 'Too many pages are open.'"
        )
        state(page, "not connected")
    state(page, "paused")  # by itself
    assert page.is_hidden("#trouble")
    page.context.close()


def test_a_page_from_elsewhere_cannot_talk_to_the_run(browser: Browser, serve: Any, folder: Path):
    served, elsewhere = serve(live(patient=True, duration_s=1000)), serve(Recorded(folder))
    page = browser.open()
    page.goto(elsewhere.address + "static/view.css")  # another origin of this computer, whose policy has no script
    talked = page.evaluate(
        "address => new Promise((done) => { const s = new WebSocket(address);"
        " s.onmessage = () => done('answered'); s.onerror = () => done('refused'); })",
        f"ws://127.0.0.1:{served.port}/socket",
    )
    page.context.close()
    assert talked == "refused"
    assert served.server.open == 0
