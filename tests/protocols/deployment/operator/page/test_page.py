"""The playbook page in a real browser: plays are called, tailored and refused, by consoles that a test commands."""

from typing import Any

import pytest

from tests.protocols.deployment.operator.page.consoles import Consoles, Still
from tests.protocols.deployment.operator.page.hand import add_place, choose, focused, tailoring, until
from tests.web.browser import pixels

pytestmark = pytest.mark.slow


# ---------------------------------------------------------------- the tree


def test_the_tree_of_plays_is_walked_with_the_keyboard(page: Any):
    page.locator("#plays .row >> nth=0").focus()
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
    assert page.locator("#plays .row[data-id='deploy']").get_attribute("aria-expanded") == "false"
    assert page.locator("#plays [tabindex='0']").count() == 1
    page.keyboard.press("Enter")
    assert page.inner_text("#calling-title") == "photo"
    assert page.locator("#plays .row[data-id='photo']").get_attribute("aria-selected") == "true"


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
    scale = min((box["width"] - 44) / 12, (box["height"] - 66) / 8)  # buttons are above
    page.mouse.click(box["x"] + box["width"] / 2 + scale, box["y"] + box["height"] / 2 + 11 - 2 * scale)  # 7, 6
    page.mouse.click(box["x"] + 3, box["y"] + 3)  # off the floor
    page.keyboard.press("Escape")
    assert page.is_hidden("#hint")
    page.select_option("#form .places select", label="posts 2: 8, 4")
    page.select_option("#form .places select", label="base")
    add_place(page, "3.5, 2")
    page.fill("#form .places input", "nowhere")
    page.press("#form .places input", "Enter")
    assert page.get_attribute("#form .places input", "aria-invalid") == "true"
    page.get_by_role("button", name="base ×: remove").click()
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
    page.select_option("#form label:has-text('robot') select", "2")
    page.select_option("#form label:has-text('robot') select", "")  # the planner chooses, after all
    page.click("#execute")
    page.get_by_role("group", name="place").locator("select").select_option("base")
    page.select_option("#form label:has-text('robot') select", "1")
    page.select_option("#form label:has-text('strategy') select", "leap_frog")
    page.click("#execute")
    until(page, "document.getElementById('played-title').textContent.startsWith('Plan 2')")
    first, second = (said["call"] for said in consoles.said("call"))
    assert first == {"play": "photo", "parameters": {}}
    assert second["parameters"] == {"place": "base", "robot": 1, "strategy": "leap_frog"}


def click_at(page: Any, x_m: float, y_m: float, up_px: float = 0.0) -> None:
    """Click on the floor of the double, or so much above a place on it."""
    box = page.locator("#floor").bounding_box()
    scale = min((box["width"] - 44) / 12, (box["height"] - 66) / 8)  # buttons are above
    across, down = (x_m - 6) * scale, (4 - y_m) * scale - up_px
    page.mouse.click(box["x"] + box["width"] / 2 + across, box["y"] + box["height"] / 2 + 11 + down)


def test_a_letter_on_the_floor_is_its_place(page: Any, consoles: Consoles, still: Still):
    still.gap_m = 2.0  # robot 0 stands at base
    choose(page, "deploy/group")
    page.click("#form .pick")
    click_at(page, 8.02, 4.1)  # a place with a name that others have too
    click_at(page, 1, 1, up_px=20)  # the letters above base
    page.keyboard.press("Escape")
    click_at(page, 4.05, 4.0)  # nobody has asked for it: it is for the list that was used last
    page.click("#execute")
    until(page, "document.getElementById('played-title').textContent.startsWith('Plan 1')")
    choose(page, "photo")
    click_at(page, 1, 1)
    assert page.locator("#team [aria-pressed=true]").inner_text().strip() == "0"  # robots are chosen as ever
    click_at(page, 1, 1, up_px=20)
    page.click("#execute")
    until(page, "document.getElementById('played-title').textContent.startsWith('Plan 2')")
    deploy, photo = (said["call"]["parameters"] for said in consoles.said("call"))
    assert deploy == {"places": [[8, 4], "base", [4, 4]]}
    assert photo == {"place": "base"}


def test_what_is_missing_is_marked_and_the_first_of_it_has_focus(page: Any, consoles: Consoles):
    consoles.lacks = "places"
    choose(page, "deploy/group")
    page.click("#execute")
    page.wait_for_selector("#form .missing")
    assert page.inner_text("#missing").startswith("Still to be filled in: places.")
    assert page.locator("#form .missing .title").all_inner_texts() == ["places"]
    assert page.evaluate("document.activeElement.ariaLabel") == "places: places with names"
    assert page.evaluate("document.activeElement.ariaInvalid") == "true"
    assert page.is_hidden("#refusal")
    page.select_option("#form .places select", label="base")
    assert page.locator("#form .missing, #form [aria-invalid=true]").count() == 0
    assert page.inner_text("#missing") == ""
    consoles.lacks = "place"
    choose(page, "photo/go")
    page.click("#execute")
    page.wait_for_selector("#form .missing")
    choose(page, "photo")  # the same form: what is said of it is said anew
    assert page.inner_text("#missing") == ""


# ---------------------------------------------------------------- tailoring


def test_of_a_plan_of_which_nobody_knows_how_long_it_takes_the_least_time_is_told(page: Any, consoles: Consoles):
    consoles.expected_s = None
    tailoring(page)
    assert page.inner_text("#draft-title") == "Plan 1: time unknown, at least 12.5 s"
    page.click("#execute-tailored")
    until(page, "document.getElementById('played-title').textContent.startsWith('Plan 2')")
    assert page.inner_text("#played-state").endswith("s, time unknown, at least 12.5 s")


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
    page.select_option("#constraint-kind", label="starts with")
    page.click("#constraint button")  # two tasks of which none is part of the other are chosen already
    page.select_option("#constraint-kind", label="ends with")
    page.select_option("#constraint [name=task]", "stage-1/robot-0")
    page.select_option("#constraint [name=of]", "stage-1/robot-1")
    page.click("#constraint button")
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
        {
            "kind": "after",
            "task": "stage-1",
            "edge": "start",
            "of": "stage-2",
            "of_edge": "start",
            "at_least_s": 0,
            "at_most_s": 0,
        },
        {"kind": "ends_with", "task": "stage-1/robot-0", "of": "stage-1/robot-1"},
        {"kind": "within", "task": "stage-1", "seconds": 30},
        {"kind": "deadline", "task": "", "seconds": 93},
    ]
    until(page, "document.querySelectorAll('#constraints li').length === 6")
    page.click("#execute-tailored")
    page.wait_for_selector("#tasks li")
    assert consoles.said("call")[-1]["call"]["constraints"] == wanted
    page.click("#tab-tailored")
    told = page.locator("#constraints li span").all_inner_texts()
    assert told[2] == "stage-1 starts when stage-2 starts"
    assert told[3] == "stage-1/robot-0 is terminated when stage-1/robot-1 ends"
    assert told[5] == "the whole play has ended at most 93 s after the play begins"
    page.locator("#constraints .remove").nth(1).click()
    page.click("#check")
    until(page, "document.getElementById('draft-title').textContent.startsWith('Plan 10')")
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


def test_what_is_tailored_is_executed_whatever_else_has_been_chosen_since(page: Any, consoles: Consoles):
    tailoring(page)
    page.select_option("#roles label:has-text('robots-2') select", "0")
    until(page, "document.getElementById('draft-title').textContent.startsWith('Plan 2')")
    choose(page, "photo")
    page.get_by_role("group", name="place").locator("select").select_option("base")
    page.select_option("#form label:has-text('robot') select", "1")
    page.click("#execute-tailored")
    page.wait_for_selector("#tasks li")
    call = consoles.said("call")[-1]["call"]
    assert (call["play"], call["parameters"], call["roles"]) == ("deploy/group", {"places": ["posts"]}, {"robots-2": 0})
    assert page.locator("#roles label").count() == 2
    assert len(consoles.said("call")) == 3  # what is filled in for another play is no change of this one


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


def test_a_refusal_goes_when_what_was_refused_has_been_changed(page: Any, consoles: Consoles):
    consoles.refused = True
    choose(page, "deploy/group")
    for change in (lambda: add_place(page, "2, 2"), lambda: choose(page, "photo")):
        page.click("#execute")
        page.wait_for_selector("#refusal:not([hidden])")
        change()
        assert page.is_hidden("#refusal")


def test_a_refusal_of_a_change_takes_no_focus_away(page: Any, consoles: Consoles):
    tailoring(page)
    consoles.refused = True
    add_place(page, "2, 2")
    page.wait_for_selector("#refusal:not([hidden])")
    assert page.evaluate("document.activeElement.placeholder") == "x, y"
    assert page.inner_text("#draft-title") == "No plan"
