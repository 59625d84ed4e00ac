"""The playbook page in a real browser: what is being played, robots, the host, and what goes wrong."""

import math
from collections.abc import Iterator
from itertools import combinations
from typing import Any

import pytest

from cosim.errors import UserError
from cosim.web.messages import Plain
from tests.protocols.deployment.operator.page.consoles import Consoles, Still
from tests.protocols.deployment.operator.page.hand import (
    PAGE,
    choose,
    focused,
    playing,
    ready,
    settled,
    tailoring,
    until,
)
from tests.web.browser import LABELS, Browser, pixels, tab
from tests.web.served import Served

pytestmark = pytest.mark.slow


# ---------------------------------------------------------------- in play


def shown(page: Any, time_s: float) -> None:
    """Wait until the page has been told that it is *time_s*."""
    until(page, f"parseFloat(document.getElementById('time').textContent) === {time_s}")


def news(still: Still, task: str, state: str, **more: Any) -> None:
    still.tell({"say": "task", "plan": 1, "task": task, "state": state, "robot": None, "why": "", **more})


def test_tasks_are_shown_as_they_stand(page: Any, still: Still):
    playing(page)
    for task, state in [("group", "running"), ("group/stage-1", "done"), ("group/stage-2/robot-1/again", "running")]:
        news(still, task, state)
    news(still, "group/stage-2/robot-1", "failed", why="a wall is in the way")
    still.tell({"say": "breach", "plan": 1, "why": "the call: group ends at most 12.5 s after"})
    until(page, "document.querySelectorAll('#tasks .sign.done').length === 1")
    page.wait_for_selector("#breaches li")
    item = page.get_by_role("treeitem", name="stage-1 done", exact=True)
    assert item.count() == 1
    assert "a wall is in the way" in page.inner_text("#tasks")
    assert page.locator("#tasks li[data-id='group/stage-2/robot-1/again']").count() == 1  # no task of the plan itself
    still.time_s = 21.0
    still.tell({"say": "ended", "plan": 1, "result": "failed"})
    until(page, "document.getElementById('played-state').textContent.startsWith('failed after 20 s')")
    assert page.is_hidden("#played-controls")
    assert "failed" in page.inner_text("#news")


def test_what_is_made_anew_stands_below_what_it_was(page: Any, still: Still):
    playing(page)
    news(still, "group/stage-1/robot-0", "done")
    news(still, "group/stage-1", "running")
    news(still, "group/stage-1~2/robot-1-to-2", "running")
    until(page, "document.querySelector('#tasks li[data-id=\"group/stage-1~2/robot-1-to-2\"]') !== null")
    told = "rows => rows.map((row) => ['b', '.unseen'].map((part) => row.querySelector(part).textContent))"
    assert [tuple(names) for names in page.locator("#tasks .row").evaluate_all(told)] == [
        ("group", "running"),
        ("stage-1", "running"),
        ("robot-0", "done"),
        ("robot-1", "given up"),
        ("made anew (2)", "running"),
        ("robot-1-to-2", "running"),
        ("stage-2", "waiting"),
        ("robot-1", "waiting"),
    ]


def test_the_strategy_is_switched_and_tasks_are_terminated(page: Any, consoles: Consoles):
    playing(page)
    assert page.is_disabled("#switch")  # there is no deployment in that plan
    page.click("#terminate")
    page.locator("#tasks li[data-id='group/stage-2'] > .row").click()
    assert page.inner_text("#terminate") == "Terminate stage-2"
    page.click("#terminate")
    settled(page, lambda: len(consoles.said("terminate")), 2)
    assert [said["task"] for said in consoles.said("terminate")] == ["", "group/stage-2"]


def test_a_deployment_that_is_played_can_go_on_by_another_strategy(page: Any, still: Still, consoles: Consoles):
    act = {"act": "deploy", "strategy": "wave", "robots": [0, 2], "places_m": [[4, 4], [8, 4]], "augmented": True}
    root = {"name": "wave", "label": "", "act": act, "order": "serial", "subtasks": []}
    consoles.playing = {"number": 4, "play": "deploy/wave", "robots": [0, 2], "root": root, "constraints": []}
    before = pixels(page, "robot-2")
    news(still, "wave", "running", plan=4)  # nobody has told this page of plan 4: it asks
    until(page, "document.getElementById('played-title').textContent === 'Plan 4: deploy/wave'")
    until(page, "document.getElementById('strategy').value === 'wave'")
    page.select_option("#strategy", "leap_frog")
    page.click("#switch")
    settled(page, lambda: len(consoles.said("switch")), 1)
    assert [said["strategy"] for said in consoles.said("switch")] == ["leap_frog"]
    assert pixels(page, "robot-2") - before > 45  # its place is two rings; one of them has about 30


def test_a_team_that_goes_straight_to_its_places_leaves_the_choice_of_a_strategy_as_it_was(
    page: Any, still: Still, consoles: Consoles
):
    for number, strategy in ((4, "wave"), (5, "direct")):
        act = {"act": "deploy", "strategy": strategy, "robots": [0], "places_m": [[4, 4]], "augmented": True}
        root = {"name": strategy, "label": "", "act": act, "order": "serial", "subtasks": []}
        consoles.playing = {"number": number, "play": "deploy", "robots": [0], "root": root, "constraints": []}
        news(still, strategy, "running", plan=number)
        until(page, f"document.getElementById('played-title').textContent === 'Plan {number}: deploy'")
        until(page, "document.getElementById('strategy').value === 'wave'")
        assert page.is_enabled("#switch")


def test_a_second_page_sees_the_same_however_late_it_comes(
    browser: Browser, served: Served, page: Any, still: Still, consoles: Consoles
):
    playing(page)
    news(still, "group/stage-1", "running")
    with tab(browser, served) as late:
        late.wait_for_selector("#tasks li[data-id='group/stage-1'] > .row .running")
        news(still, "group/stage-1", "done")
        for each in (page, late):
            each.wait_for_selector("#tasks li[data-id='group/stage-1'] > .row .done")
        assert late.inner_text("#tasks") == page.inner_text("#tasks")
        assert late.inner_text("#played-title") == page.inner_text("#played-title") == "Plan 1: deploy/group"
        choose(late, "deploy/wave")
        late.click("#execute")
        until(page, "document.getElementById('played-title').textContent.startsWith('Plan 2')")
    served.wait_for(1)
    requests = [data["request"] for _, data in consoles.asked]
    assert len(set(requests)) == len(requests)
    first = min(requests) >> 32
    assert {number >> 32 for number in requests} == {first, first + 1}  # each page has its own: no answer is for both


def test_a_closed_page_leaves_nothing(browser: Browser, served: Served):
    with tab(browser, served, own=True) as one:
        playing(one)
        served.wait_for(1)
    served.wait_for(0)


# ---------------------------------------------------------------- robots


def test_the_selected_robot_tells_how_it_stands(page: Any, still: Still):
    rows = [
        [0, 1.0, 1.0, 0.0, "", False, 0.0, None],
        [1, 2.25, 1.0, 1.5708, "group/stage-1/robot-1", True, 3.0, [4, 4]],
    ]
    still.tell({"say": "positions", "at_s": 1.0, "robots": rows})
    still.tell({"say": "positions", "at_s": 1.0, "robots": [[1, 9, 9, 0, "", False, 0, None]]}, robot=2)  # is no host
    page.get_by_role("button", name="robot 1", exact=True).click()
    until(page, "document.getElementById('robot-state').textContent.includes('2.25')")
    told = page.inner_text("#robot-state")
    assert "group/stage-1/robot-1" in told
    assert "2.25, 1.00 m, 90°" in told
    assert "robot 1, moving" in told
    assert "3 s ago" in told
    still.time_s = 9.0
    until(page, "document.getElementById('robot-state').textContent.includes('11 s ago')")
    page.click("#way")
    until(page, "document.getElementById('robot-said').textContent === 'The way is 6.0 m.'")
    page.get_by_role("button", name="robot 2", exact=True).click()
    until(page, "document.getElementById('look').disabled")  # it has no camera
    assert page.is_disabled("#way")


def test_a_way_is_asked_for_by_the_keyboard(page: Any, consoles: Consoles):
    page.get_by_role("button", name="robot 1", exact=True).press("Enter")
    page.wait_for_selector("#way-to:enabled")
    page.locator("#way-to").press("Enter")
    assert "where robot 1 would go" in page.inner_text("#hint")
    page.keyboard.press("Escape")
    assert page.is_hidden("#hint")
    assert focused(page) == "way-to"
    page.keyboard.press("Enter")
    page.keyboard.type("20, 3")
    page.keyboard.press("Enter")
    assert page.get_attribute("#hint-place", "aria-invalid") == "true"  # that is off the floor
    page.keyboard.press("Control+a")
    page.keyboard.type("4, 2.5")
    page.keyboard.press("Enter")
    until(page, "document.getElementById('robot-said').textContent === 'The way is 6.0 m.'")
    assert [(said["robot"], said["to"]) for said in consoles.said("route")] == [(1, [4, 2.5])]
    assert page.is_hidden("#hint")
    assert focused(page) == "way-to"


def test_a_picture_is_drawn_and_told_in_words(page: Any):
    page.get_by_role("button", name="robot 1", exact=True).click()
    page.click("#look")
    page.wait_for_selector("#picture:not([hidden])")
    assert "Robot 1 at 1.0, 2.0 m, looking to 0°; nearest: 1.0 m" in page.inner_text("#picture-text")
    shades = page.evaluate(
        "() => { const c = document.getElementById('picture-canvas'); const at = (x) =>"
        " c.getContext('2d').getImageData(x, 80, 1, 1).data[0]; return [at(2), at(160), at(310)]; }"
    )
    assert shades[0] > shades[1] > shades[2]  # the farther the darker
    page.click("#picture-close")
    assert page.is_hidden("#picture")


# ---------------------------------------------------------------- the host


def test_the_page_goes_to_whom_it_is_told_to_go(page: Any, consoles: Consoles):
    consoles.host = 2
    choose(page, "deploy/group")
    page.click("#execute")
    page.wait_for_selector("#tasks li")
    asked = [(robot, data["say"]) for robot, data in consoles.asked if data["say"] == "call"]
    assert asked == [(0, "call"), (2, "call")]


@pytest.fixture
def timed(browser: Browser, served: Served) -> Iterator[Any]:
    """Open the page, with a clock that the test puts forward."""
    with tab(browser, served, clock=True) as page:
        ready(page)
        yield page


def test_a_host_that_falls_silent_is_succeeded_and_what_it_was_asked_is_asked_again(
    timed: Any, still: Still, consoles: Consoles
):
    page = timed
    consoles.dead.add(0)
    choose(page, "deploy/group")
    page.click("#execute")
    page.clock.run_for(5000)
    assert page.inner_text("#host") == ""  # the simulation may be busy: its time has not gone on
    still.time_s = 1.9  # or hardly
    shown(page, 1.9)
    page.clock.run_for(5000)
    page.wait_for_timeout(200)
    assert page.inner_text("#host") == ""
    still.state = "busy"  # that is no pause: patience goes on
    until(page, "document.getElementById('state').textContent === 'busy'")
    for time_s in (6.0, 12.0, 18.0):  # at sixty times real time, while what is asked makes it compile
        still.state, still.time_s = "playing", time_s
        shown(page, time_s)
    page.clock.run_for(5000)
    assert page.inner_text("#host") == ""
    still.time_s = 18.1
    until(page, "document.getElementById('host').textContent.includes('does not answer')", seconds=20)
    for step in range(5):
        still.time_s = 20.0 + step
        shown(page, still.time_s)
    page.clock.run_for(2000)
    page.wait_for_timeout(200)  # whatever is on its way arrives
    assert page.locator("#tasks li").count() == 0
    consoles.host = 1
    probes = len(consoles.said("state"))
    page.clock.run_for(4000)
    page.wait_for_timeout(200)
    assert len(consoles.said("state")) <= probes + 3
    for step in range(5):
        still.time_s = 30.0 + step
        shown(page, still.time_s)
    page.clock.run_for(2000)
    page.wait_for_selector("#tasks li")
    assert page.inner_text("#host") == "robot 1 is host now"
    assert [robot for robot, data in consoles.asked if data["say"] == "call"] == [0, 1]


def test_while_time_stands_still_nobody_is_taken_for_silent(timed: Any, still: Still, consoles: Consoles):
    page = timed
    still.state = "paused"
    until(page, "document.getElementById('state').textContent === 'paused'")
    consoles.dead.add(0)
    still.down.add(0)
    choose(page, "deploy/group")
    page.click("#execute")
    page.clock.run_for(5000)
    page.wait_for_timeout(200)
    assert page.inner_text("#host") == ""
    assert still.wishes == []


def test_a_run_that_is_busy_says_so_and_can_be_paused(page: Any, still: Still):
    assert page.get_attribute("#play", "aria-label") == "Pause"
    still.state = "busy"
    until(page, "document.getElementById('state').textContent === 'busy'")
    page.click("#play")
    until(page, "document.getElementById('play').ariaLabel === 'Pause'")
    settled(page, lambda: len(still.wishes), 1)
    assert [wish.say for wish in still.wishes] == ["pause"]


def test_until_the_host_has_told_its_plays_the_page_says_whom_it_waits_for(
    browser: Browser, served: Served, still: Still
):
    answer, held = still.answering, list[tuple[int, Plain]]()
    still.answering = lambda robot, data: held.append((robot, data)) or []  # type: ignore[func-returns-value]
    with tab(browser, served) as page:
        assert page.inner_text("#plays-wait") == "Waiting for the host …"
        assert "Choose one" not in page.inner_text(".calling")
        still.answering = answer
        for robot, data in held:
            for told in answer(robot, data):
                still.tell(told, robot)
        ready(page)
        assert page.is_hidden("#plays-wait")
        assert "Choose one" in page.inner_text(".calling")


# ---------------------------------------------------------------- what goes wrong


def test_what_nobody_understands_breaks_nothing(page: Any, still: Still):
    task = {"name": "a", "label": "", "act": None, "order": "serial", "subtasks": [{"name": 3}]}
    for said in (
        *(None, 5, "text", [], {}, {"say": "nonsense"}, {"say": "plan"}, {"say": "plan", "plan": 7, "executed": True}),
        *({"say": "positions"}, {"say": "positions", "robots": [[]]}, {"say": "positions", "robots": [[1, "x"]]}),
        *({"say": "state", "host": 0, "plan": {}}, {"say": "state", "host": 0, "plan": {"number": 2, "root": task}}),
        *({"say": "task", "plan": "x"}, {"say": "breach"}, {"answer": "x", "say": "error", "host": 99}),
    ):
        still.tell(said)
        page.wait_for_timeout(60)
    still.tell({"say": "positions", "at_s": 1.0, "robots": [[0, 1.0, 1.0, 0.0, "here", False, 0.0, None]]})
    page.get_by_role("button", name="robot 0", exact=True).click()
    until(page, "document.getElementById('robot-state').textContent.includes('here')")
    playing(page)
    assert page.inner_text("#played-title") == "Plan 1: deploy/group"


def test_a_page_whose_server_has_gone_says_so_and_comes_back(browser: Browser, consoles: Consoles):
    served = Served(Still(consoles), page=PAGE)
    with tab(browser, served) as page:
        ready(page)
        playing(page)
        served.stop()
        page.wait_for_selector("#trouble:not([hidden])")
        assert page.inner_text("#state") == "not connected"
        choose(page, "deploy/wave")
        page.click("#execute")  # into the void
        until(page, "document.getElementById('trouble-text').textContent === 'the server is gone'")
        again = Served(Still(consoles), port=served.port, page=PAGE)  # the page comes back by itself
        until(page, "document.getElementById('state').textContent === 'playing'")
        page.wait_for_selector("#tasks li")
        assert page.is_hidden("#trouble")
        again.stop()
        page.wait_for_selector("#trouble:not([hidden])")
        assert all("WebSocket" in fault for fault in page.faults), page.faults
        page.faults.clear()


def test_who_waits_for_an_answer_when_the_server_goes_is_told_and_may_ask_again(browser: Browser, consoles: Consoles):
    served = Served(Still(consoles), page=PAGE)
    with tab(browser, served) as page:
        ready(page)
        tailoring(page)
        consoles.dead.add(0)
        page.click("#execute-tailored")
        page.click("#team button >> nth=0")
        page.click("#look")
        until(page, "document.getElementById('robot-said').textContent.startsWith('Waiting for a picture')")
        assert page.is_disabled("#execute-tailored")
        served.stop()
        page.wait_for_selector("#trouble:not([hidden])")
        for name in ("#execute", "#tailor", "#execute-tailored"):
            page.wait_for_selector(f"{name}:enabled", timeout=10_000)
        why = page.inner_text("#trouble-text")
        # its last word is lost, and the page finds it gone, if the page was just telling it something
        assert why in ("The server has been ended.", "The server is gone.")
        assert page.inner_text("#robot-said") == why
        page.faults.clear()


@pytest.mark.parametrize(("code", "why"), [(1012, "The server has been ended."), (1013, "Too many pages are open.")])
def test_a_page_tells_why_its_connection_was_closed(browser: Browser, still: Still, code: int, why: str):
    served = Served(still, page=PAGE)
    page = browser.open()
    page.route_web_socket("**/socket*", lambda way: way.close(code=code))
    page.goto(served.address)
    page.wait_for_selector("#trouble:not([hidden])")
    assert page.inner_text("#trouble-text") == why
    page.context.close()
    served.stop()


def test_what_the_server_does_not_pass_on_is_not_waited_for(page: Any, still: Still):
    def busy(robot: int, data: Plain) -> list[Plain]:
        raise UserError("the simulation is busy")

    choose(page, "deploy/group")
    still.answering = busy
    page.click("#execute")
    until(page, "document.getElementById('trouble-text').textContent === 'the simulation is busy'")
    page.wait_for_selector("#execute:enabled", timeout=10_000)


# ---------------------------------------------------------------- for everybody


def test_all_fits_a_laptop(page: Any):
    tailoring(page)
    width, height = page.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]")
    assert (width, height) == (1366, 768)
    for name in ("#plays", "#execute", "#tailor", "#team", "#look", "#floor", "#execute-tailored", "#play", "#speed"):
        box = page.locator(name).bounding_box()
        assert box["x"] >= 0, name
        assert box["x"] + box["width"] <= 1366, name
        assert box["y"] + box["height"] <= 768, name


def test_every_control_has_a_name_and_is_reached_by_the_tabulator(page: Any):
    tailoring(page)
    nameless = page.evaluate(
        "() => [...document.querySelectorAll('button, select, input')].filter((each) => !(each.textContent.trim()"
        " && each.matches('button')) && !each.ariaLabel && !each.labels?.length).map((each) => each.outerHTML)"
    )
    assert nameless == []
    page.evaluate("document.activeElement.blur()")
    reached = set()
    for _ in range(80):
        page.keyboard.press("Tab")
        reached.add(
            page.evaluate(
                "document.activeElement.id || document.activeElement.closest('ul[id], form[id], div[id]')?.id"
            )
        )
    wanted = {
        "plays",
        "form",
        "execute",
        "tailor",
        "team",
        "floor",
        "tab-tailored",
        "draft",
        "execute-tailored",
        "check",
    }
    assert wanted | {
        "constraint-kind",
        "constraint-fields",
        "drive",
        "roles",
        "options",
        "play",
        "speed",
    } <= reached | {"constraint-fields"}


def test_robots_that_stand_close_together_can_be_told_by_their_labels(page: Any, still: Still):
    page.evaluate(LABELS)
    for gap_m in (0.4, 0.1):
        still.gap_m = gap_m
        still.time_s += 1
        shown(page, still.time_s)
        labels = page.evaluate("[0, 1, 2].map((robot) => window.labels[robot])")
        apart = [math.dist(one, two) for one, two in combinations(labels, 2)]
        assert min(apart) > 12, apart


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_floor_shows_base_robots_and_goals(browser: Browser, served: Served, still: Still, scheme: str):
    with tab(browser, served, scheme=scheme) as page:
        page.wait_for_selector("#plays li")
        playing(page)
        page.wait_for_timeout(200)
        for colour, least in [("wall", 300), ("base", 60), ("robot-0", 80), ("robot-1", 80)]:
            assert pixels(page, colour) >= least, colour
