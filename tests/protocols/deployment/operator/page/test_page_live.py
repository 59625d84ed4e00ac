"""The playbook page before a real team: plays are called, tailored, refused and played to their end."""

import math
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cosim.scenario import load
from cosim.web.live import Live
from tests.protocols.deployment.operator.page.hand import PAGE, choose, until
from tests.protocols.deployment.operator.page.scene import FLOOR, begun, written
from tests.tiers import SOAK_SHARE
from tests.web.browser import LABELS, Browser, tab
from tests.web.commanded import ROOT, commanded
from tests.web.served import Served

pytestmark = pytest.mark.slow

POSTS: list[list[float]] = FLOOR["places"]["posts"]


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., tuple[Served, Live]]]:
    """Return a function that begins a run and serves its page; all is ended after the test."""
    made: list[tuple[Served, Live]] = []

    def serve(**changes: Any) -> tuple[Served, Live]:
        session = begun(tmp_path, **changes)
        made.append((Served(session, page=PAGE), session))
        return made[-1]

    yield serve
    for served, session in made:
        if served.thread.is_alive():
            served.stop()
        session.close()
        assert not session.running


SAID_OF_THE_HOST = """() => {
  window.said = [];
  const host = document.getElementById("host");
  new MutationObserver(() => window.said.push(host.textContent)).observe(host, { childList: true });
}"""
"""Keeps all that a page says of its host, however soon something else is said."""


def choose_posts(page: Any, path: str) -> None:
    choose(page, path)
    page.wait_for_selector("#form .places select option >> nth=2", state="attached")
    page.select_option("#form .places select", label="posts, all 3")


def done(page: Any, plan: int) -> None:
    until(page, f"document.getElementById('played-title').textContent.startsWith('Plan {plan}:')")
    until(page, "document.getElementById('played-state').textContent.startsWith('done')")


def places(session: Live) -> list[tuple[float, float]]:
    now = session.look(None)[0][0]
    return [(x, y) for x, y, *_ in now["robots"]]


def held(session: Live, posts: list[list[float]]) -> bool:
    """Return whether some robot truly stands at each of *posts*."""
    return all(min(math.dist(post, place) for place in places(session)) < 0.3 for post in posts)


def told_s(session: Live, task: str, state: str) -> float:
    """Return when the operator was told that *task* was in *state*."""
    told = [message for message in session.look(None)[0] if message["say"] == "operator"]
    (at_s,) = [
        message["time_s"]
        for message in told
        if (message["data"].get("task"), message["data"].get("state")) == (task, state)
    ]
    return float(at_s)


# ---------------------------------------------------------------- a person plays


def test_plays_are_called_at_two_levels_of_the_tree_and_watched_to_their_end(browser: Browser, serve: Any):
    served, session = serve()
    with tab(browser, served) as page, tab(browser, served) as other:
        choose_posts(page, "deploy")  # whichever of the plays in it is the quickest
        page.click("#execute")
        done(page, 1)
        assert held(session, POSTS)
        choose(page, "photo/go")  # one task of a play
        page.select_option("#form .places select", label="corner")
        page.click("#execute")
        done(page, 2)
        assert held(session, FLOOR["places"]["corner"])
        done(other, 2)
        assert other.inner_text("#tasks") == page.inner_text("#tasks")


def test_an_infeasible_play_is_refused_and_what_mends_it_does(browser: Browser, serve: Any):
    served, session = serve()
    with tab(browser, served) as page:
        choose_posts(page, "deploy/wave")
        page.click("#tailor")
        page.wait_for_selector("#draft li")
        page.select_option("#constraint-kind", "deadline")
        page.select_option("#constraint [name=task]", "")
        page.fill("#constraint [name=seconds]", "5")
        page.press("#constraint [name=seconds]", "Enter")
        page.wait_for_selector("#refusal:not([hidden])")
        until(page, "document.activeElement.id === 'refusal'")
        assert "wave ends at most 5 s after the plan begins" in page.inner_text("#conflicts")
        (mend,) = page.locator("#mend li").all_inner_texts()
        mended = mend.partition("at most ")[2].partition(" s")[0]
        assert float(mended) > 5
        page.click("#execute-tailored")  # as it is: nothing happens
        page.wait_for_timeout(300)
        assert session.look(None)[0][0]["state"] == "playing"
        assert page.text_content("#played-title") == "Nothing is being played"
        page.click("#mend button")
        until(page, "document.getElementById('draft-title').textContent.startsWith('Plan')")
        assert page.is_hidden("#refusal")
        assert page.locator("#constraints li").count() == 1
        assert f"at most {mended} s after" in page.inner_text("#constraints")
        page.locator("#constraints .remove").click()
        page.click("#execute-tailored")
        until(page, "document.getElementById('played-state').textContent.startsWith('done')")
        assert held(session, POSTS)
        assert page.locator("#breaches li").count() == 0


def test_a_constraint_that_was_added_is_kept(browser: Browser, serve: Any):
    served, session = serve()
    with tab(browser, served) as page:
        choose(page, "photo")
        page.select_option("#form .places select", label="corner")
        page.click("#tailor")
        page.wait_for_selector("#draft li[data-id='photo/photo']")
        page.select_option("#constraint-kind", "after")
        page.select_option("#constraint [name=task]", "photo")
        page.select_option("#constraint [name=of]", "go")
        page.fill("#constraint [name=at_least_s]", "20")
        page.click("#constraint button")
        page.click("#execute-tailored")
        until(
            page, "[...document.querySelectorAll('#tasks .sign')].map(({ title }) => title).join() === 'done,done,done'"
        )
    gone_s = told_s(session, "photo/go", "done")
    assert told_s(session, "photo/photo", "running") >= gone_s + 20


def test_whoever_of_two_arrives_first_ends_the_others_drive(browser: Browser, serve: Any):
    served, session = serve()
    with tab(browser, served) as page:
        choose_posts(page, "deploy/group")
        page.click("#tailor")
        page.wait_for_selector("#draft li")
        page.select_option("#constraint-kind", label="ends with")
        chosen = [page.input_value(f"#constraint [name={field}]") for field in ("task", "of")]
        assert chosen == ["deploy/stage-1", "deploy/stage-2"], "not deploy, of which all others are parts"
        page.click("#constraint button")
        page.wait_for_selector("#refusal", state="hidden")
        page.locator("#constraints .remove").click()
        drives = [f"deploy/stage-1/robot-{robot}" for robot in (0, 1)]
        for task, of in (drives, drives[::-1]):
            page.select_option("#constraint [name=task]", task)
            page.select_option("#constraint [name=of]", of)
            page.click("#constraint button")
        page.click("#execute-tailored")
        until(page, "document.getElementById('played-state').textContent.startsWith('done')")
        signs = [page.locator(f"#tasks li[data-id='group/{drive}'] .sign").get_attribute("title") for drive in drives]
        assert sorted(map(str, signs)) == ["done", "given up"]
    first, last = sorted(drives, key=lambda drive: signs[drives.index(drive)])
    assert told_s(session, f"group/{last}", "terminated") == told_s(session, f"group/{first}", "done")
    assert held(session, POSTS), "who was stopped on its way goes on to its place"


def test_while_time_stands_still_plans_are_made(browser: Browser, serve: Any):
    served, session = serve(playing=False)
    with tab(browser, served) as page:
        choose_posts(page, "deploy/group")
        page.click("#tailor")
        page.wait_for_selector("#draft li")
        page.click("#execute-tailored")
        page.wait_for_selector("#tasks .sign.running")
        assert page.inner_text("#state") == "paused"
        assert session.look(None)[0][0]["time_s"] < 0.001  # not a tick: time stands still
        page.keyboard.press("Control+Home")  # no shortcut of ours
        page.locator("#floor").press("Space")
        until(page, "document.getElementById('state').textContent === 'playing'")


def test_strategy_and_end_are_in_the_hands_of_the_operator(browser: Browser, serve: Any):
    served, _ = serve(speed=2.0)  # faster, and on a busy machine the play is over before it is ended
    with tab(browser, served) as page:
        choose_posts(page, "deploy/leap-frog")
        page.click("#execute")
        until(page, "document.querySelectorAll('#tasks .sign.running').length >= 3")
        assert page.input_value("#strategy") == "leap_frog"
        page.select_option("#strategy", "wave")
        page.click("#switch")
        until(page, "[...document.querySelectorAll('#tasks li')].some((item) => item.dataset.id.includes('~2'))")
        page.click("#terminate")
        until(page, "document.getElementById('played-state').textContent.startsWith('terminated')")


def test_a_host_that_dies_in_mid_play_is_succeeded_and_the_page_goes_along(browser: Browser, serve: Any):
    faults = [{"kind": "kill", "robot": 0, "at_s": 12.0}]
    parameters = {"silence_s": 4.0, "alone_s": 8.0}
    served, session = serve(faults=faults, parameters=parameters, playing=False, speed=20.0)
    with tab(browser, served) as page:
        page.evaluate(SAID_OF_THE_HOST)
        choose_posts(page, "deploy/leap-frog")
        page.click("#execute")
        page.wait_for_selector("#tasks .sign.running")
        page.click("#play")
        until(page, "document.getElementById('host').textContent.includes('robot 1 is host now')")
        assert page.evaluate("window.said[0]") == "robot 0, the host, does not answer: waiting for its successor"
        until(page, "/^(done|failed)/.test(document.getElementById('played-state').textContent)")
        page.get_by_role("button", name="robot 2", exact=True).click()
        page.click("#look")
        page.wait_for_selector("#picture:not([hidden])")
        assert held(session, POSTS[:1])


def test_pictures_and_ways_come_from_the_robots(browser: Browser, serve: Any):
    served, _ = serve(parameters={"cameras": [0, 1]})
    with tab(browser, served) as page:
        page.get_by_role("button", name="robot 1", exact=True).click()
        page.click("#look")
        page.wait_for_selector("#picture:not([hidden])")
        assert page.inner_text("#picture-text").startswith("Robot 1 at ")
        page.click("#way-to")
        box = page.locator("#floor").bounding_box()
        scale = min((box["width"] - 44) / 16, (box["height"] - 66) / 10)
        page.mouse.click(
            box["x"] + box["width"] / 2 + 3 * scale, box["y"] + box["height"] / 2 + 11 + 2 * scale
        )  # 11, 3
        until(page, "document.getElementById('robot-said').textContent.startsWith('The way is ')")
        length_m = float(page.inner_text("#robot-said").split()[3])
        assert 8.0 < length_m < 10.5
        page.get_by_role("button", name="robot 2", exact=True).click()
        until(page, "document.getElementById('look').disabled")


# ---------------------------------------------------------------- the typical scenario

WEAN = ROOT / "experiments" / "deployment_wean" / "playbook.yaml"


def call_wean(page: Any) -> None:
    """Execute wean with nothing filled in, then fill it in by letters on the floor, and execute it."""
    page.evaluate(LABELS)
    choose(page, "wean")
    page.click("#execute")
    page.wait_for_selector("#form .missing")
    missing = "crossing, leap places, group places. Click letters on the floor, or choose names."
    assert page.inner_text("#missing") == f"Still to be filled in: {missing}"
    until(page, IN_SIGHT)
    until(page, "window.labels.A && window.labels[0]")
    labels = page.evaluate("window.labels")
    assert math.dist(labels["A"], labels["0"]) > 12  # the robot stands there
    x_min, y_min, x_max, y_max = page.evaluate(BOUNDS)
    box = page.locator("#floor").bounding_box()
    scale = min((box["width"] - 44) / (x_max - x_min), (box["height"] - 66) / (y_max - y_min))

    def click(x_m: float, y_m: float) -> None:
        across, down = (x_m - (x_min + x_max) / 2) * scale, ((y_min + y_max) / 2 - y_m) * scale
        page.mouse.click(box["x"] + box["width"] / 2 + across, box["y"] + box["height"] / 2 + 11 + down)

    for place in ((29, 34), (29, 50), (29, 66)):  # B, C, D: the crossing, and where to leap
        click(*place)
    assert page.inner_text("#form .next .title") == "leap places"
    assert page.inner_text("#missing") == "Still to be filled in: group places. Press Pick there, or choose names."
    page.get_by_text("group places", exact=True).click()
    assert page.inner_text("#form .next .title") == "group places"
    for place in ((29, 18), (29, 2)):  # E, F
        click(*place)
    assert page.locator("#form .chip-button").all_inner_texts() == [f"{name} ×" for name in "BCDEF"]
    page.click("#execute")


IN_SIGHT = """(() => {
  const box = (selector) => document.querySelector(selector).getBoundingClientRect();
  const [list, row] = [box("#plays"), box("#plays [aria-selected=true]")];
  return row.top >= list.top - 1 && row.bottom <= list.bottom + 1;
})()"""
"""Whether the play that is chosen is in sight, in the tree."""
BOUNDS = """async () => {
  const socket = new WebSocket(`ws://${location.host}/socket`);
  const scene = await new Promise((done) => { socket.onmessage = ({ data }) => done(JSON.parse(data)); });
  socket.close();
  return scene.bounds_m;
}"""
"""The extent of the floor, as the page's server tells it."""


def test_the_team_of_wean_is_deployed_from_a_laptop_and_called_home_from_a_phone(browser: Browser):
    session = Live(load(WEAN), 1, speed=60.0, attended=True)
    served = Served(session, page=PAGE)
    with tab(browser, served, own=True) as page:
        page.set_viewport_size({"width": 1280, "height": 720})
        page.evaluate(SAID_OF_THE_HOST)
        assert page.is_hidden("#scrub")  # it has no end
        call_wean(page)
        page.wait_for_selector("#tasks li")
        told = page.inner_text("#tasks")
        assert " to B" in told
        assert "leap-frog: " in told
        assert " to D" in told
        done(page, 2)  # what was executed first had a number too
        assert held(session, [[29, 50], [29, 66], [29, 18], [29, 2]])
        assert page.evaluate("window.said") == []
    with tab(browser, served, own=True) as phone:
        phone.set_viewport_size({"width": 390, "height": 844})
        phone.evaluate(SAID_OF_THE_HOST)
        until(phone, "/^done after \\d+ s/.test(document.getElementById('played-state').textContent)")  # before it came
        choose(phone, "return")
        phone.fill("#form input[type=number]", "4")
        phone.click("#execute")
        done(phone, 3)
        assert all(math.dist(place, (3, 34)) < 3 for place in places(session))
        assert phone.evaluate("window.said") == []
    served.stop()
    session.close()


@pytest.mark.soak
@pytest.mark.skipif(SOAK_SHARE < 1.0, reason="compiles all kernels: only in a whole soak")
def test_from_an_empty_cache_the_first_play_is_played_without_a_false_alarm(browser: Browser, tmp_path: Path):
    begun_cold = commanded("playbook", WEAN, long_s=400.0, NUMBA_CACHE_DIR=str(tmp_path))
    with begun_cold as shown, tab(browser, shown, own=True) as page:
        page.evaluate(SAID_OF_THE_HOST)
        kernels = {path.name for path in tmp_path.rglob("*.nbc")}
        call_wean(page)
        page.wait_for_selector("#tasks .sign.running")
        until(page, "parseFloat(document.getElementById('played-state').textContent.split(' ')[2]) >= 20", seconds=300)
        assert page.evaluate("window.said") == []
        assert len({path.name for path in tmp_path.rglob("*.nbc")} - kernels) < 5  # they were compiled before


# ---------------------------------------------------------------- the command


def test_a_command_that_is_killed_in_mid_play_leaves_a_page_that_says_so_and_nothing_else(
    browser: Browser, tmp_path: Path
):
    with commanded("playbook", written(tmp_path)) as shown, tab(browser, shown) as page:
        choose_posts(page, "deploy/group")
        page.click("#execute")
        page.wait_for_selector("#tasks .sign.running")
        shown.process.kill()
        page.wait_for_selector("#trouble:not([hidden])")
        assert page.inner_text("#trouble-text") == "The server is gone."
        assert page.inner_text("#state") == "not connected"
        _, err = shown.process.communicate(timeout=30)  # both at their end: nobody else can write to them
        assert (shown.process.returncode, err) == (-signal.SIGKILL, "")
        with pytest.raises(ProcessLookupError):
            os.killpg(shown.process.pid, 0)  # no process that it has begun
        page.click("#reconnect")
        until(page, "document.getElementById('trouble-text').textContent.includes('does not answer')")
        assert all("WebSocket connection" in fault for fault in page.faults), page.faults
        page.faults.clear()
