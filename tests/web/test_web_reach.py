"""The pages for everybody: on a phone and a laptop, by fingers and by keys, and as a screen reader is told of them."""

import math
from collections.abc import Iterator
from typing import Any

import pytest

from cosim.web.server import VIEW
from tests.protocols.deployment.operator.page.consoles import Consoles, Still
from tests.protocols.deployment.operator.page.hand import PAGE, choose, playing, ready, settled, tailoring, until
from tests.tiers import each_value
from tests.web.browser import GRAVE, LABELS, Browser, axe, tab
from tests.web.served import Served

pytestmark = pytest.mark.slow

LAPTOP, PHONE = (1280, 720), (390, 844)
PAGES = pytest.mark.parametrize("name", [VIEW, PAGE])


@pytest.fixture
def still(consoles: Consoles) -> Still:
    still = Still(consoles)
    still.gap_m = 3.0
    return still


@pytest.fixture
def opened(browser: Browser, still: Still, name: str, size: tuple[int, int]) -> Iterator[Any]:
    """Open the page *name* in a window of *size*, which notes what it writes where on the floor."""
    served = Served(still, page=name)
    with tab(browser, served) as page:
        if name == PAGE:
            ready(page)
        usual = page.viewport_size
        page.evaluate(LABELS)
        page.set_viewport_size({"width": size[0], "height": size[1]})  # all is drawn anew
        until(page, "window.labels[2]")
        yield page
        page.set_viewport_size(usual)
    served.stop()


# ---------------------------------------------------------------- what a screen reader is told


@pytest.mark.parametrize(("name", "size"), each_value([VIEW, PAGE], [LAPTOP, PHONE]))
def test_axe_finds_nothing(opened: Any, name: str, size: tuple[int, int], consoles: Consoles):
    opened.evaluate(axe())
    assert opened.evaluate(GRAVE) == []
    if name == VIEW:
        return
    playing(opened)
    tailoring(opened)
    consoles.refused = True
    opened.click("#check")
    opened.wait_for_selector("#refusal:not([hidden])")
    assert opened.evaluate(GRAVE) == []
    opened.click("#tab-played")
    consoles.refused, consoles.lacks = False, "place"
    choose(opened, "photo")
    opened.click("#execute")
    opened.wait_for_selector("#form .missing")
    assert opened.evaluate(GRAVE) == []


@pytest.mark.parametrize(("name", "size"), [(VIEW, LAPTOP)])
def test_the_floor_is_described_about_once_a_second(opened: Any, still: Still):
    opened.evaluate(
        "() => { window.told = []; const floor = document.getElementById('floor'); new MutationObserver(() =>"
        " window.told.push(floor.ariaLabel)).observe(floor, { attributeFilter: ['aria-label'] });"
        " window.begun = performance.now(); }"
    )
    for time_s in range(2, 14):
        still.time_s = float(time_s)
        until(opened, f"parseFloat(document.getElementById('time').textContent) === {time_s}")
    told, spent_s = opened.evaluate("[window.told.length, (performance.now() - window.begun) / 1000]")
    assert told <= 2 + spent_s
    until(opened, "document.getElementById('floor').ariaLabel.startsWith('The floor at 13.0 s')")


# ---------------------------------------------------------------- on a phone


@PAGES
@pytest.mark.parametrize("size", [PHONE], ids=["phone"])
def test_a_phone_shows_the_page_without_scrolling_it_away(opened: Any, name: str, size: tuple[int, int]):
    if name == PAGE:
        playing(opened)
        opened.evaluate("document.querySelector('main').scrollTo(0, 1e6)")
    assert opened.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]") == [*size]
    for part in (".bar >> nth=0", "#play", "#speed"):
        box = opened.locator(part).bounding_box()
        assert box["y"] >= 0, part
        assert box["y"] + box["height"] <= size[1], part


@pytest.mark.parametrize(("name", "size"), [(PAGE, PHONE)])
def test_who_is_to_pick_a_place_sees_the_floor(opened: Any):
    choose(opened, "deploy/group")
    opened.evaluate("document.querySelector('main').scrollTo(0, 0)")
    opened.evaluate("document.querySelector('#form .pick').click()")  # by which the test scrolls nothing itself
    box, hint = (opened.locator(part).bounding_box() for part in ("#floor", "#hint"))
    footer = opened.locator("#transport").bounding_box()
    assert box["y"] >= 0
    assert hint["y"] + hint["height"] <= footer["y"]
    assert hint["y"] >= box["y"] + 0.9 * box["height"]  # it does not cover what is to be clicked on


# ---------------------------------------------------------------- a part of the floor


DRAWN = """async () => {
  const drawn = () => [window.labels[0], window.labels[2]];
  const picture = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  let before;
  do { before = drawn(); await picture(); } while (String(before) !== String(drawn()));
  return before;
}"""
"""Where they are written once another picture changes nothing."""


def places(page: Any) -> tuple[list[float], list[float]]:
    """Return where robots 0 and 2 are written on the canvas, px."""
    labels = page.evaluate(DRAWN)
    return labels[0], labels[1]


@PAGES
@pytest.mark.parametrize("size", [PHONE], ids=["phone"])
def test_fingers_magnify_the_floor_and_move_it(opened: Any, name: str):
    fingers = opened.context.new_cdp_session(opened)

    def touch(kind: str, *points: tuple[float, float]) -> None:
        touched = [{"x": box["x"] + x, "y": box["y"] + y, "id": number} for number, (x, y) in enumerate(points)]
        fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touched})

    opened.evaluate("document.querySelector('.stage').scrollIntoView()")
    still_there = opened.evaluate("document.querySelector('main').scrollTop")
    before, box = places(opened), opened.locator("#floor").bounding_box()
    fingers.send("Emulation.setTouchEmulationEnabled", {"enabled": True, "maxTouchPoints": 2})
    touch("touchStart", (150, 150), (230, 150))
    for step in range(1, 5):
        touch("touchMove", (150 - 10 * step, 150), (230 + 10 * step, 150))
    touch("touchEnd")
    after = places(opened)
    assert math.dist(*after) / math.dist(*before) == pytest.approx(2.0, rel=0.15)  # labels stand beside their robots
    touch("touchStart", (200, 150))
    for step in range(1, 5):
        touch("touchMove", (200 - 5 * step, 150 - 10 * step))
    touch("touchEnd")
    moved = places(opened)
    assert (moved[0][0] - after[0][0], moved[0][1] - after[0][1]) == pytest.approx((-20, -40), abs=11)
    assert opened.evaluate("document.querySelector('main').scrollTop") == still_there
    fingers.send("Emulation.setTouchEmulationEnabled", {"enabled": False})
    fingers.detach()


@pytest.mark.parametrize(("name", "size"), [(VIEW, LAPTOP)])
def test_a_magnified_floor_is_dragged_and_a_drag_is_no_click(opened: Any):
    box = opened.locator("#floor").bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    opened.mouse.move(*middle)
    opened.mouse.wheel(0, -350)
    before = places(opened)
    opened.mouse.down()
    opened.mouse.move(middle[0] + 30, middle[1] - 40, steps=4)
    opened.mouse.up()
    after = places(opened)
    assert (after[0][0] - before[0][0], after[0][1] - before[0][1]) == pytest.approx((30, -40), abs=1)
    opened.click("#robots button >> nth=1")
    opened.mouse.move(*middle)
    opened.mouse.down()
    opened.mouse.move(middle[0] + 30, middle[1], steps=4)
    opened.mouse.up()
    assert opened.locator("#robots [aria-pressed=true]").count() == 1  # a click on nothing would take the choice back
    opened.mouse.click(*middle)
    until(opened, "document.querySelectorAll('#robots [aria-pressed=true]').length === 0")


@pytest.mark.parametrize(("name", "size"), [(VIEW, LAPTOP)])
def test_the_floor_is_magnified_and_moved_by_keys_that_time_does_not_take(opened: Any, still: Still):
    whole = places(opened)
    opened.locator("#floor").focus()
    for key, change in (("PageUp", 1.4), ("PageUp", 1.96), ("PageDown", 1.4)):
        opened.keyboard.press(key)
        assert math.dist(*places(opened)) / math.dist(*whole) == pytest.approx(change, rel=0.01), key
    before = places(opened)
    for key, way in (("Left", (60, 0)), ("Up", (60, 60)), ("Right", (0, 60)), ("Down", (0, 0))):
        opened.keyboard.press(f"Shift+Arrow{key}")
        now = places(opened)
        assert (now[0][0] - before[0][0], now[0][1] - before[0][1]) == pytest.approx(way, abs=1), key
    opened.keyboard.press("0")
    assert places(opened) == whole
    assert still.wishes == []
    opened.keyboard.press("ArrowRight")
    settled(opened, lambda: len(still.wishes), 1)
    assert [wish.say for wish in still.wishes] == ["step"]
