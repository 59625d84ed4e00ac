"""The playbook page in a real browser, before consoles that say what a test has them say."""

from collections.abc import Iterator
from typing import Any

import pytest

from tests.web.browser import chromium, pixels, tab
from tests.web.playbook_double import Consoles, Still
from tests.web.served import Served

pytestmark = pytest.mark.slow

PAGE = "playbook.html"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as browser:
        yield browser


@pytest.fixture
def consoles() -> Consoles:
    return Consoles()


@pytest.fixture
def still(consoles: Consoles) -> Still:
    return Still(consoles)


@pytest.fixture
def served(still: Still) -> Iterator[Served]:
    made = Served(still, page=PAGE)
    yield made
    if made.thread.is_alive():
        made.stop()


@pytest.fixture
def page(browser: Any, served: Served) -> Iterator[Any]:
    with tab(browser, served) as page:
        page.wait_for_selector("#plays li")
        page.wait_for_selector("#team button >> nth=2")
        yield page


def choose(page: Any, path: str) -> None:
    """Choose a play in the tree, opening what it is in."""
    for at in range(1, path.count("/") + 1):
        above = page.locator(f"#plays li[data-id='{'/'.join(path.split('/')[:at])}']")
        if above.get_attribute("aria-expanded") == "false":
            above.locator("> .row > .twist").click()
    page.locator(f"#plays li[data-id='{path}'] > .row").click()


def add_place(page: Any, text: str) -> None:
    page.fill("#form .places input", text)
    page.press("#form .places input", "Enter")


def focused(page: Any) -> str:
    identity: str = page.evaluate("document.activeElement.dataset.id || document.activeElement.id")
    return identity


def until(page: Any, condition: str) -> None:
    page.wait_for_function(f"() => {condition}")


# ---------------------------------------------------------------- the tree


def test_the_tree_of_plays_is_walked_with_the_keyboard(page: Any):
    page.locator("#plays > li >> nth=0").focus()
    walk = [
        ("ArrowDown", "deploy/group"),
        ("ArrowRight", "deploy/group"),
        ("ArrowRight", "deploy/group/deploy"),
        ("ArrowLeft", "deploy/group"),
        ("ArrowLeft", "deploy/group"),
        ("ArrowDown", "deploy/wave"),
        ("ArrowLeft", "deploy"),
        ("ArrowLeft", "deploy"),
        ("ArrowDown", "photo"),
        ("ArrowDown", "photo"),
        ("Home", "deploy"),
        ("End", "photo"),
        ("ArrowUp", "deploy"),
        ("p", "photo"),
    ]
    for key, place in walk:
        page.keyboard.press(key)
        assert focused(page) == place, key
    assert page.locator("#plays li[data-id='deploy']").get_attribute("aria-expanded") == "false"
    assert page.locator("#plays [tabindex='0']").count() == 1
    page.keyboard.press("Enter")
    assert page.inner_text("#calling-title") == "photo"
    assert page.locator("#plays li[data-id='photo']").get_attribute("aria-selected") == "true"


def test_a_play_is_called_at_every_level_of_the_tree(page: Any, consoles: Consoles):
    for path in ("deploy", "deploy/wave", "deploy/group/deploy"):
        choose(page, path)
        if page.locator("#form .chip-button").count() == 0:
            page.select_option("#form .places select", label="posts, all 2")
        page.click("#execute")
        until(
            page, f"document.getElementById('played-title').textContent === 'Plan {consoles.number or 1}: deploy/group'"
        )
    calls = [(said["call"]["play"], said["call"]["parameters"], said["execute"]) for said in consoles.said("call")]
    assert calls == [(path, {"places": ["posts"]}, True) for path in ("deploy", "deploy/wave", "deploy/group/deploy")]


def test_a_folder_asks_for_what_all_its_plays_ask_for(page: Any):
    choose(page, "deploy")
    titles = page.locator("#form .title").all_inner_texts()
    assert titles == ["places", "robots"]
    choose(page, "deploy/wave")
    assert page.locator("#form .title").all_inner_texts() == ["places", "robots", "apart m"]


# ---------------------------------------------------------------- the form


def test_places_are_clicked_on_the_floor_named_or_typed(page: Any, consoles: Consoles):
    choose(page, "deploy/group")
    page.click("#form .pick")
    assert "Click on the floor: places" in page.inner_text("#hint")
    box = page.locator("#floor").bounding_box()
    scale = min((box["width"] - 44) / 12, (box["height"] - 44) / 8)
    page.mouse.click(box["x"] + box["width"] / 2 + scale, box["y"] + box["height"] / 2 - 2 * scale)  # 7, 6
    page.mouse.click(box["x"] + 3, box["y"] + 3)  # off the floor
    page.keyboard.press("Escape")
    assert page.is_hidden("#hint")
    page.select_option("#form .places select", label="posts 2: 8, 4")
    page.select_option("#form .places select", label="base")
    add_place(page, "3.5, 2")
    page.fill("#form .places input", "nowhere")
    page.press("#form .places input", "Enter")
    assert page.get_attribute("#form .places input", "aria-invalid") == "true"
    page.get_by_role("button", name="base: remove").click()
    page.wait_for_timeout(100)
    assert pixels(page, "accent") > 30  # dashed rings
    page.click("#execute")
    until(page, "document.getElementById('played-title').textContent.startsWith('Plan 1')")
    (x, y), *others = consoles.said("call")[0]["call"]["parameters"]["places"]
    assert (x, y) == (pytest.approx(7, abs=0.05), pytest.approx(6, abs=0.05))
    assert others == [[8, 4], [3.5, 2]]


def test_robots_are_counted_or_named(page: Any, consoles: Consoles):
    choose(page, "deploy/group")
    page.fill("#form input[type=number]", "2")
    page.click("#execute")
    page.get_by_role("button", name="robots: robot 2").click()
    assert page.input_value("#form input[type=number]") == ""
    page.get_by_role("button", name="robots: robot 0").click()
    page.click("#execute")
    page.fill("#form input[type=number]", "1")
    page.click("#execute")
    until(page, "document.getElementById('played-title').textContent.startsWith('Plan 3')")
    assert [said["call"]["parameters"] for said in consoles.said("call")] == [
        {"robots": 2},
        {"robots": [2, 0]},
        {"robots": 1},
    ]


def test_what_is_left_open_is_not_said(page: Any, consoles: Consoles):
    choose(page, "photo")
    page.click("#execute")
    page.get_by_role("group", name="place").locator("select").select_option("base")
    page.select_option("#form label:has-text('robot') select", "1")
    page.select_option("#form label:has-text('strategy') select", "leap_frog")
    page.click("#execute")
    until(page, "document.getElementById('played-title').textContent.startsWith('Plan 2')")
    first, second = (said["call"] for said in consoles.said("call"))
    assert first == {"play": "photo", "parameters": {}}
    assert second["parameters"] == {"place": "base", "robot": 1, "strategy": "leap_frog"}


# ---------------------------------------------------------------- tailoring


def tailoring(page: Any) -> None:
    choose(page, "deploy/group")
    page.select_option("#form .places select", label="posts, all 2")
    page.click("#tailor")
    page.wait_for_selector("#draft li")


def test_tailoring_shows_the_plan_with_its_windows_and_executes_nothing(page: Any, consoles: Consoles):
    tailoring(page)
    assert page.inner_text("#draft-title") == "Plan 1: about 12.5 s"
    rows = page.locator("#draft .content").all_inner_texts()
    assert [row.split("\n")[0] for row in rows] == ["group", "stage-1", "robot-0", "robot-1", "stage-2", "robot-1"]
    assert "starts at 0 s, ends 6.3–40 s" in rows[1]
    assert "ends from 12.5 s on" in rows[0]
    assert "robot 1 to 4, 4" in rows[3]
    assert [said["execute"] for said in consoles.said("call")] == [False]
    assert page.text_content("#played-title") == "Nothing is being played"
    page.click("#execute-tailored")
    page.wait_for_selector("#tasks li")
    assert consoles.said("call")[-1]["execute"] is True


def test_constraints_of_all_kinds_are_added_and_removed(page: Any, consoles: Consoles):
    tailoring(page)
    page.select_option("#constraint [name=first]", "stage-1/robot-1")
    page.select_option("#constraint [name=then]", "stage-1/robot-0")
    page.fill("#constraint [name=at_least_s]", "2.5")
    page.click("#constraint button")
    page.select_option("#constraint-kind", "after")
    page.select_option("#constraint [name=task]", "stage-2")
    page.select_option("#constraint [name=of]", "stage-1")
    page.select_option("#constraint [name=of_edge]", "start")
    page.fill("#constraint [name=at_least_s]", "10")
    page.fill("#constraint [name=at_most_s]", "20")
    page.press("#constraint [name=at_most_s]", "Enter")
    page.select_option("#constraint-kind", "within")
    page.select_option("#constraint [name=task]", "stage-1")
    page.click("#constraint button")  # how long? it asks
    assert page.evaluate("document.activeElement.name") == "seconds"
    page.fill("#constraint [name=seconds]", "30")
    page.click("#constraint button")
    page.select_option("#constraint-kind", "deadline")
    page.select_option("#constraint [name=task]", "")
    page.fill("#constraint [name=seconds]", "93")
    page.click("#constraint button")
    wanted = [
        {"kind": "before", "first": "stage-1/robot-1", "then": "stage-1/robot-0", "at_least_s": 2.5},
        {
            "kind": "after",
            "task": "stage-2",
            "edge": "start",
            "of": "stage-1",
            "of_edge": "start",
            "at_least_s": 10,
            "at_most_s": 20,
        },
        {"kind": "within", "task": "stage-1", "seconds": 30},
        {"kind": "deadline", "task": "", "seconds": 93},
    ]
    until(page, "document.querySelectorAll('#constraints li').length === 4")
    page.click("#execute-tailored")
    page.wait_for_selector("#tasks li")
    assert consoles.said("call")[-1]["call"]["constraints"] == wanted
    page.click("#tab-tailored")
    assert "the whole play has ended at most 93 s after the play begins" in page.inner_text("#constraints")
    page.locator("#constraints .remove").nth(1).click()
    page.click("#check")
    until(page, "document.getElementById('draft-title').textContent.startsWith('Plan 8')")
    assert consoles.said("call")[-1]["call"]["constraints"] == [wanted[0], *wanted[2:]]


def test_waypoints_roles_and_options_are_part_of_the_call(page: Any, consoles: Consoles):
    tailoring(page)
    page.select_option("#drive", "stage-2/robot-1")
    page.fill("#waypoints .places input", "6, 6")
    page.press("#waypoints .places input", "Enter")
    page.select_option("#waypoints .places select", label="base")
    page.select_option("#roles label:has-text('robots-2') select", "0")
    page.select_option("#option-strategy", "wave")
    page.get_by_role("button", name="robot 1 may take part").click()
    page.click("#execute-tailored")
    page.wait_for_selector("#tasks li")
    call = consoles.said("call")[-1]["call"]
    assert call["via"] == {"stage-2/robot-1": [[6, 6], "base"]}
    assert (call["roles"], call["strategy"], call["robots"]) == ({"robots-2": 0}, "wave", [0, 2])


def test_a_change_is_checked_by_itself(page: Any, consoles: Consoles):
    tailoring(page)
    add_place(page, "2, 2")
    until(page, "document.getElementById('draft-title').textContent.startsWith('Plan 2')")
    assert consoles.said("call")[-1]["call"]["parameters"]["places"] == ["posts", [2, 2]]
    assert page.locator("#roles label").count() == 3
    assert focused(page) != "refusal"


# ---------------------------------------------------------------- refusals


def test_a_refusal_names_conflicts_and_mends_and_has_focus(page: Any, consoles: Consoles):
    consoles.refused = True
    choose(page, "deploy/group")
    page.click("#execute")
    page.wait_for_selector("#refusal:not([hidden])")
    until(page, "document.activeElement.id === 'refusal'")
    assert page.get_attribute("#refusal", "role") == "alert"
    assert page.locator("#conflicts li").count() == 2
    assert "at most 3 s" in page.inner_text("#conflicts")
    assert page.locator("#mend li").all_inner_texts() == ["the call: at most 12.5 s"]
    consoles.refused = False
    page.click("#execute")
    page.wait_for_selector("#tasks li")
    assert page.is_hidden("#refusal")


def test_a_refusal_of_a_change_takes_no_focus_away(page: Any, consoles: Consoles):
    tailoring(page)
    consoles.refused = True
    add_place(page, "2, 2")
    page.wait_for_selector("#refusal:not([hidden])")
    assert page.evaluate("document.activeElement.placeholder") == "x, y"
    assert page.inner_text("#draft-title") == "No plan"


# ---------------------------------------------------------------- in play


def playing(page: Any) -> None:
    choose(page, "deploy/group")
    page.click("#execute")
    page.wait_for_selector("#tasks li")


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
    item = page.get_by_role("treeitem", name="stage-1, done", exact=False)
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
    names = page.locator("#tasks li").evaluate_all("items => items.map((item) => item.ariaLabel.split(', '))")
    assert [(name[0], name[-1]) for name in names] == [
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
    page.wait_for_timeout(200)
    assert [said["task"] for said in consoles.said("terminate")] == ["", "group/stage-2"]


def test_a_deployment_that_is_played_can_go_on_by_another_strategy(page: Any, still: Still, consoles: Consoles):
    act = {"act": "deploy", "strategy": "wave", "robots": [0, 2], "places_m": [[4, 4], [8, 4]], "augmented": True}
    root = {"name": "wave", "label": "", "act": act, "order": "serial", "subtasks": []}
    consoles.playing = {"number": 4, "play": "deploy/wave", "robots": [0, 2], "root": root, "constraints": []}
    news(still, "wave", "running", plan=4)  # nobody has told this page of plan 4: it asks
    until(page, "document.getElementById('played-title').textContent === 'Plan 4: deploy/wave'")
    until(page, "document.getElementById('strategy').value === 'wave'")
    page.select_option("#strategy", "leap_frog")
    page.click("#switch")
    page.wait_for_timeout(200)
    assert [said["strategy"] for said in consoles.said("switch")] == ["leap_frog"]
    assert pixels(page, "robot-2") > 60  # its place, as two rings, besides the robot itself


def test_a_second_page_sees_the_same_however_late_it_comes(browser: Any, served: Served, page: Any, still: Still):
    playing(page)
    news(still, "group/stage-1", "running")
    with tab(browser, served) as late:
        until(late, "document.querySelectorAll('#tasks .sign.running').length === 1")
        news(still, "group/stage-1", "done")
        for each in (page, late):
            until(each, "document.querySelectorAll('#tasks .sign.done').length === 1")
        assert late.inner_text("#tasks") == page.inner_text("#tasks")
        assert late.inner_text("#played-title") == page.inner_text("#played-title") == "Plan 1: deploy/group"
        choose(late, "deploy/wave")
        late.click("#execute")
        until(page, "document.getElementById('played-title').textContent.startsWith('Plan 2')")
    served.wait_for(1)


def test_a_closed_page_leaves_nothing(browser: Any, served: Served):
    with tab(browser, served) as one:
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
    assert "2.25, 1.00 m, 90°, moving" in told
    assert "3 s ago" in told
    still.time_s = 9.0
    until(page, "document.getElementById('robot-state').textContent.includes('11 s ago')")
    page.click("#way")
    until(page, "document.getElementById('robot-said').textContent === 'The way is 6.0 m.'")
    page.get_by_role("button", name="robot 2", exact=True).click()
    until(page, "document.getElementById('look').disabled")  # it has no camera
    assert page.is_disabled("#way")


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


def test_a_host_that_falls_silent_is_succeeded_and_what_it_was_asked_is_asked_again(
    page: Any, still: Still, consoles: Consoles
):
    consoles.dead.add(0)
    choose(page, "deploy/group")
    page.click("#execute")
    until(page, "document.getElementById('host').textContent.includes('does not answer')")
    page.wait_for_timeout(2000)
    assert page.locator("#tasks li").count() == 0
    consoles.host = 1
    page.wait_for_selector("#tasks li")
    assert page.inner_text("#host") == "robot 1 is host now"
    assert [robot for robot, data in consoles.asked if data["say"] == "call"] == [0, 1]


def test_while_time_stands_still_nobody_is_taken_for_silent(page: Any, still: Still, consoles: Consoles):
    still.state = "paused"
    until(page, "document.getElementById('state').textContent === 'paused'")
    consoles.dead.add(0)
    choose(page, "deploy/group")
    page.click("#execute")
    page.wait_for_timeout(5000)
    assert page.inner_text("#host") == ""


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


def test_a_page_whose_server_has_gone_says_so_and_comes_back(page: Any, still: Still, served: Served):
    playing(page)
    served.stop()
    page.wait_for_selector("#trouble:not([hidden])")
    assert page.inner_text("#state") == "not connected"
    choose(page, "deploy/wave")
    page.click("#execute")  # into the void
    until(page, "document.getElementById('trouble-text').textContent === 'the server is gone'")
    again = Served(still, port=served.port, page=PAGE)
    page.click("#reconnect")
    until(page, "document.getElementById('state').textContent === 'playing'")
    page.wait_for_selector("#tasks li")
    assert page.is_hidden("#trouble")
    again.stop()
    page.wait_for_selector("#trouble:not([hidden])")
    assert all("WebSocket" in fault for fault in page.faults), page.faults
    page.faults.clear()


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


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_floor_shows_base_robots_and_goals(browser: Any, served: Served, still: Still, scheme: str):
    with tab(browser, served, color_scheme=scheme) as page:
        page.wait_for_selector("#plays li")
        playing(page)
        page.wait_for_timeout(200)
        for colour, least in [("wall", 300), ("base", 60), ("robot-0", 80), ("robot-1", 80)]:
            assert pixels(page, colour) >= least, colour
