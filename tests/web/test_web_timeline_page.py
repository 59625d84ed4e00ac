"""The timeline in a real browser: it draws what the trace has, and is reached by keys, mouse and fingers."""

import random
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import FRAMES
from cosim.units import MS, SLOT, S
from cosim.web.live import Live
from cosim.web.recorded import Recorded
from tests.tiers import each_value
from tests.web.browser import GRAVE, Browser, axe, pixels, tab
from tests.web.console import PLAIN
from tests.web.drawn import END, LOST, PAYLOAD, PHASE, SENTENCE, Frame, write_trace
from tests.web.served import Served

pytestmark = pytest.mark.slow

SIZES = [(1280, 720), (1920, 1080), (390, 844)]
BAD_ROWS = """() => {
  const canvas = document.getElementById("content");
  const { data, width, height } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  const probe = document.createElement("canvas").getContext("2d");
  probe.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--bad");
  probe.fillRect(0, 0, 1, 1);
  const [r, g, b] = probe.getImageData(0, 0, 1, 1).data;
  const bad = (y) => [...Array(width).keys()].some((x) => {
    const at = 4 * (y * width + x);
    return data[at] === r && data[at + 1] === g && data[at + 2] === b;
  });
  const rows = [...Array(height).keys()].filter(bad);
  return [Math.min(...rows), Math.max(...rows)];
}"""
"""The first and the last row of pixels in which something is drawn as lost."""
LINE = "document.getElementById('timeline').timeline"


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Frame]]:
    folder = tmp_path_factory.mktemp("drawn")
    return folder, write_trace(folder)


@pytest.fixture(scope="module")
def served(drawn: tuple[Path, list[Frame]]) -> Iterator[Served]:
    served = Served(Recorded(drawn[0], playing=False))
    yield served
    served.stop()


@pytest.fixture
def page(browser: Browser, served: Served) -> Iterator[Any]:
    """Open the page at the beginning of the run, in a window of the usual size."""
    with tab(browser, served) as page:
        page.wait_for_selector("#timeline:not([hidden])")
        settled(page)
        yield page


def settled(page: Any) -> None:
    """Wait until all is drawn that is to be seen."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    page.wait_for_function(f"() => {LINE}.complete()")


def window(page: Any) -> tuple[float, float, float]:
    """Return from when to when the window is (ns), and how wide (px)."""
    settled(page)
    shown = page.evaluate(f"{LINE}.window()")
    return shown["from_ns"], shown["to_ns"], shown["width_px"]


def press(page: Any, *keys: str) -> None:
    """Press keys while the lanes have the focus."""
    for key in keys:
        page.locator(".tl-overlay").press(key)
    settled(page)


def look(page: Any, from_ns: int, to_ns: int) -> None:
    """Name a window in the address."""
    page.evaluate(
        "hash => { history.replaceState(null, '', hash); dispatchEvent(new HashChangeEvent('hashchange')) }",
        f"#from={from_ns / S:.9f}&span={(to_ns - from_ns) / S:.9f}",
    )
    assert window(page)[:2] == (from_ns, to_ns)


def told(page: Any, words: str) -> None:
    """Wait until the page says *words*."""
    page.wait_for_function("words => document.querySelector('.tl-status').textContent.includes(words)", arg=words)


def pinned(page: Any) -> dict[str, str]:
    """Return the fields of the box that is pinned."""
    rows = page.locator(".tl-pin table").last.locator("tr").all()
    return {row.locator("th").inner_text(): row.locator("td").inner_text() for row in rows}


# ---------------------------------------------------------------- what is drawn


def test_the_boxes_that_are_drawn_are_the_rows_of_the_trace(page: Any, drawn: Any):
    stream = random.Random(26)
    every = [("inquiry", 0, 3 * S), ("link", 3 * S, END), ("link", 4 * S, END), ("crashed", 18 * S, 19 * S)]
    for _ in range(20):
        span = stream.randrange(SLOT // 2, 400 * MS)
        begin = stream.randrange(0, END - 2 * span)
        look(page, begin, begin + span)
        boxes = page.evaluate(f"{LINE}.boxes()")
        expected = [row for row in drawn[1] if row.start + row.duration >= begin and row.start < begin + span]
        for what, robot in (("sent", "source"), ("received", "destination")):
            found = [box for box in boxes if box["what"] == what]
            rows = [
                (row.start, row.start + row.duration, getattr(row, robot), row.kind, row.outcome) for row in expected
            ]
            told = [
                (box["start_ns"], box["end_ns"], box["robot"], box["kind"], box["outcome"] or "received")
                for box in found
            ]
            assert sorted(told) == sorted(rows)
        states = [(box["kind"], box["start_ns"], box["end_ns"]) for box in boxes if box["what"] == "states"]
        assert sorted(states) == sorted(state for state in every if state[2] >= begin and state[1] < begin + span)


def test_a_box_is_drawn_where_its_time_is(page: Any):
    begin = LOST - 5 * SLOT
    look(page, begin, begin + 20 * SLOT)
    from_ns, to_ns, width_px = window(page)
    [box] = [each for each in page.evaluate(f"{LINE}.boxes()") if each["kind"] == "DM1" and each["what"] == "received"]
    x, y = page.evaluate(f"box => {LINE}.place(box)", box)
    left = page.locator(".tl-overlay").bounding_box()["x"]
    assert x - left == pytest.approx((LOST + 183_000 - from_ns) / (to_ns - from_ns) * width_px, abs=1)
    page.mouse.move(x, y)
    assert page.inner_text(".tl-tip").startswith("DM1, robot 0 to 2, 12.345123 s")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_whole_run_shows_what_was_lost(browser: Browser, served: Served, scheme: str):
    with tab(browser, served, scheme=scheme) as page:
        page.wait_for_selector("#timeline:not([hidden])")
        from_ns, to_ns, _ = window(page)
        assert from_ns <= PHASE
        assert to_ns >= END - 2 * SLOT
        page.evaluate("document.querySelector('.tl-content').id = 'content'")
        assert 10 < pixels(page, "bad", "content") < 400  # two frames among thousands
        first, last = page.evaluate(BAD_ROWS)
        assert last - first > 80  # where robot 0 has sent it, of whose frames only sums are drawn, and at robot 2
        page.get_by_role("button", name="DM1").click()  # in the legend
        settled(page)
        assert pixels(page, "bad", "content") == 0


def test_nothing_is_blank_while_the_server_is_silent(page: Any):
    """The server's answers are kept from the page: it stretches those that it has."""
    address = page.url.split("#")[0]
    page.goto("about:blank")
    page.goto(f"{address}#from=10&span=2")
    page.wait_for_selector("#timeline:not([hidden])")
    settled(page)
    page.evaluate("document.querySelector('.tl-content').id = 'content'")
    page.evaluate("WebSocket.prototype.send = () => {}")
    page.locator(".tl-overlay").press("0")
    page.wait_for_timeout(200)
    assert not page.evaluate(f"{LINE}.complete()")
    assert (
        page.evaluate(
            "() => { const c = document.getElementById('content');"
            " const { data } = c.getContext('2d').getImageData(0, 0, c.width, c.height);"
            " let n = 0; for (let at = 3; at < data.length; at += 4) n += data[at] === 255; return n; }"
        )
        > 1000
    )


# ---------------------------------------------------------------- zoom and pan


def test_the_wheel_zooms_about_the_pointer_and_with_shift_moves(page: Any):
    box = page.locator(".tl-overlay").bounding_box()
    from_ns, to_ns, width_px = window(page)
    at = from_ns + (to_ns - from_ns) * 300 / width_px
    page.mouse.move(box["x"] + 300, box["y"] + 20)
    page.mouse.wheel(0, -800)
    page.wait_for_function(
        f"span => {{ const w = {LINE}.window(); return w.to_ns - w.from_ns < span / 5 }}", arg=to_ns - from_ns
    )
    near = window(page)
    assert near[0] + (near[1] - near[0]) * 300 / width_px == pytest.approx(at, abs=2 * (near[1] - near[0]) / width_px)
    page.keyboard.down("Shift")
    page.mouse.wheel(0, 200)
    page.keyboard.up("Shift")
    page.wait_for_function(f"from => {LINE}.window().from_ns > from", arg=near[0])
    moved = window(page)
    assert moved[1] - moved[0] == pytest.approx(near[1] - near[0])
    assert moved[0] - near[0] == pytest.approx(200 * (near[1] - near[0]) / width_px, rel=0.01)


def test_a_drag_moves_and_does_not_pin(page: Any):
    look(page, 5 * S, 5 * S + 100 * MS)
    before = window(page)
    box = page.locator(".tl-overlay").bounding_box()
    page.mouse.move(box["x"] + 400, box["y"] + 30)
    page.mouse.down()
    page.mouse.move(box["x"] + 300, box["y"] + 30, steps=5)
    page.mouse.up()
    after = window(page)
    assert after[0] - before[0] == pytest.approx(100 * (before[1] - before[0]) / before[2], rel=0.01)
    assert page.evaluate(f"{LINE}.pinned()") is None


def test_two_fingers_zoom(page: Any):
    fingers = page.context.new_cdp_session(page)
    box = page.locator(".tl-overlay").bounding_box()

    def touch(kind: str, *places: float) -> None:
        touched = [{"x": box["x"] + x, "y": box["y"] + 40, "id": number} for number, x in enumerate(places)]
        fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touched})

    before = window(page)
    touch("touchStart", 300, 400)
    for step in range(1, 6):
        touch("touchMove", 300 - 20 * step, 400 + 20 * step)
    touch("touchEnd")
    after = window(page)
    fingers.detach()
    assert (before[1] - before[0]) / (after[1] - after[0]) == pytest.approx(3, rel=0.05)
    assert (after[0] + (after[1] - after[0]) * 350 / after[2]) == pytest.approx(
        before[0] + (before[1] - before[0]) * 350 / before[2], rel=0.01
    )


@pytest.mark.parametrize(
    ("keys", "buttons"),
    [
        ("w", "in"),
        ("+", "in"),
        ("s", "out"),
        ("-", "out"),
        ("a", "left"),
        ("d", "right"),
        ("Shift+ArrowRight", "right"),
    ],
)
def test_keys_and_buttons_do_the_same(page: Any, keys: str, buttons: str):
    look(page, 5 * S, 6 * S)
    begin = window(page)
    press(page, keys)
    by_key = window(page)
    assert by_key[:2] != begin[:2]
    look(page, 5 * S, 6 * S)
    page.mouse.move(0, 0)
    page.click(f"#tl-{buttons}")
    assert window(page) == by_key


def test_one_can_zoom_down_to_half_slots(page: Any):
    press(page, *["w"] * 60)
    from_ns, to_ns, _ = window(page)
    assert to_ns - from_ns < 312_500
    press(page, "0")
    assert window(page)[1] > END - 2 * SLOT


# ---------------------------------------------------------------- finding


@pytest.mark.parametrize("size", SIZES)
def test_the_keyboard_alone_finds_the_first_lost_frame_and_reads_why(page: Any, size: tuple[int, int]):
    usual = page.viewport_size
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.evaluate("document.activeElement.blur()")
    for _ in range(80):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.classList.contains('tl-overlay')"):
            break
    page.keyboard.press("l")
    told(page, SENTENCE)
    settled(page)
    assert page.get_attribute(".tl-status", "role") == "status"
    shown = [box for box in page.evaluate(f"{LINE}.boxes()") if box["start_ns"] == LOST and box["what"] == "received"]
    assert 0 < page.evaluate(f"box => {LINE}.place(box)", shown[0])[0] < size[0]
    page.keyboard.press("Enter")  # to read all about it
    assert page.evaluate("document.activeElement.classList.contains('tl-pin')")
    page.locator(".tl-overlay").press("l")
    told(page, "17.98")
    page.keyboard.press("l")
    told(page, "No further lost frame")
    page.keyboard.press("Shift+L")
    told(page, SENTENCE)
    page.set_viewport_size(usual)


def test_a_pinned_frame_tells_all_that_the_trace_has(page: Any):
    press(page, "l")
    told(page, SENTENCE)
    fields = pinned(page)
    assert fields["begins"] == f"{LOST / S:.9f} s"
    assert fields["time_ns"] == str(LOST)
    assert fields["duration_ns"] == "366000"
    expected = {"source": "0", "destination": "2", "kind": "DM1", "channel": "41", "lt_addr": "2", "length": "11"}
    assert {name: fields[name] for name in expected} == expected
    text = page.inner_text(".tl-pin")
    assert page.locator(".tl-pin table").first.locator("tbody td").all_inner_texts() == [
        "lost: payload",
        "4.5 dB",
        "-62.0 dBm",
    ]
    assert "hello robot" in text  # its bytes as letters
    assert " ".join(PAYLOAD[at : at + 2] for at in range(0, len(PAYLOAD), 2)) in text


def test_a_click_pins_and_escape_unpins(page: Any):
    begin = PHASE + 48 * SLOT
    look(page, begin - 3 * SLOT, begin + 6 * SLOT)
    [box] = [each for each in page.evaluate(f"{LINE}.boxes()") if each["start_ns"] == begin and each["what"] == "sent"]
    page.mouse.click(*page.evaluate(f"box => {LINE}.place(box)", box))
    told(page, f"POLL, robot 0 to 1, {begin / S:.6f} s, channel {48 * 7 % 79}, received")
    press(page, "n")
    told(page, f"POLL, robot 0 to 2, {(begin + 24 * SLOT) / S:.6f} s")
    press(page, "p")
    told(page, f"POLL, robot 0 to 1, {begin / S:.6f} s")
    press(page, "Escape")
    assert page.evaluate(f"{LINE}.pinned()") is None


def test_two_cursors_measure_seconds_and_slots(page: Any):
    begin = PHASE + 48 * SLOT
    look(page, begin - 3 * SLOT, begin + 6 * SLOT)
    [box] = [each for each in page.evaluate(f"{LINE}.boxes()") if each["start_ns"] == begin and each["what"] == "sent"]
    page.mouse.click(*page.evaluate(f"box => {LINE}.place(box)", box))
    page.mouse.move(0, 0)
    press(page, "1", "n")
    told(page, "POLL, robot 0 to 2")
    press(page, "2")
    told(page, f"from cursor 1 to 2: {24 * SLOT / S:.9f} s, 24 slots of 625 µs")
    page.wait_for_selector(".tl-region td")
    rows = [row.split("\t") for row in page.locator(".tl-region tr").all_inner_texts()]
    assert rows[:8] == [  # a POLL, and a NULL in the next slot
        ["length", "15 ms"],
        ["frames sent", "2"],
        ["air time", "252 µs, 1.68 %"],
        ["lost on the way to one robot", "0 of 2, 0 %"],
        ["payload received", "0 bit/s, 0 B"],
        ["first to last frame: gap", "499 µs"],
        ["delta of their starts", "625 µs"],
        ["span", "751 µs"],
    ]
    assert ["POLL, sent", "1", "0", "126 µs", "0.84 %"] in rows
    assert not [row for row in rows if row[0].startswith("link")]  # they begin later
    page.get_by_role("button", name="robot 1", exact=True).first.click()
    page.wait_for_function("() => document.querySelector('.tl-region caption').textContent.startsWith('Of robot 1,')")
    rows = [row.split("\t") for row in page.locator(".tl-region tr").all_inner_texts()]
    assert ["frames sent", "1"] in rows
    assert ["span", "126 µs"] in rows
    page.keyboard.press("Escape")
    press(page, "x")
    assert not page.locator(".tl-region").is_visible()


def test_markers_have_names_and_are_in_the_address(page: Any):
    begin = PHASE + 48 * SLOT
    look(page, begin - 3 * SLOT, begin + 6 * SLOT)
    [box] = [each for each in page.evaluate(f"{LINE}.boxes()") if each["start_ns"] == begin and each["what"] == "sent"]
    page.mouse.click(*page.evaluate(f"box => {LINE}.place(box)", box))
    page.mouse.move(0, 0)
    told(page, f"POLL, robot 0 to 1, {begin / S:.6f} s")  # else this may come after what is said of the marker
    press(page, "m")
    told(page, f"marker 1 at {begin / S:.9f} s")
    page.keyboard.type("m0| poll")  # the name has the focus: letters are no commands
    page.keyboard.press("Enter")
    press(page, "l")
    told(page, SENTENCE)
    press(page, "m")
    page.keyboard.press("Escape")
    assert page.locator(".tl-markers button:not(.tl-remove)").all_inner_texts() == [
        f"{begin / S:.9f} s",
        f"{LOST / S:.9f} s",
    ]
    press(page, "[")
    told(page, f"m0  poll at {begin / S:.9f} s")
    from_ns, to_ns, _ = window(page)
    assert from_ns < begin < to_ns < LOST
    page.get_by_role("button", name=f"{LOST / S:.9f} s", exact=True).click()
    from_ns, to_ns, _ = window(page)
    assert begin < from_ns < LOST < to_ns
    page.wait_for_function("() => new URLSearchParams(location.hash.slice(1)).get('markers')?.includes('marker 1')")
    address = page.url
    page.goto("about:blank")
    page.goto(address)
    page.wait_for_selector("#timeline:not([hidden])")
    names = "[...document.querySelectorAll('.tl-markers input')].map(({ value }) => value)"
    assert page.evaluate(names) == ["m0  poll", "marker 1"]
    page.get_by_role("button", name=f"Remove the marker at {begin / S:.9f} s").click()
    assert page.evaluate(names) == ["marker 1"]
    page.wait_for_function("() => !location.hash.includes('m0')")


def test_a_hovered_frame_lights_its_robots_on_the_floor(page: Any):
    begin = PHASE + 48 * SLOT
    look(page, begin - 3 * SLOT, begin + 6 * SLOT)
    before = pixels(page, "accent")
    [box] = [each for each in page.evaluate(f"{LINE}.boxes()") if each["start_ns"] == begin and each["what"] == "sent"]
    page.mouse.move(*page.evaluate(f"box => {LINE}.place(box)", box))
    page.wait_for_timeout(100)
    assert pixels(page, "accent") > before + 100
    page.mouse.move(0, 0)
    page.wait_for_timeout(100)
    assert pixels(page, "accent") == before


def test_by_channel_each_frame_stands_at_its_channel(page: Any, drawn: Any):
    look(page, 5 * S, 5 * S + 300 * MS)
    press(page, "c")
    boxes = page.evaluate(f"{LINE}.boxes()")
    rows = [row for row in drawn[1] if row.start + row.duration >= 5 * S and row.start < 5 * S + 300 * MS]
    assert sorted(box["start_ns"] for box in boxes) == sorted(row.start for row in rows)
    channels = {row.start: row.channel for row in rows}
    stage = page.locator(".tl-overlay").bounding_box()
    for box in boxes[:8]:
        assert box["what"] == "channel"
        _, y = page.evaluate(f"box => {LINE}.place(box)", box)
        high = 79 * (1 - (y - stage["y"]) / stage["height"])
        assert high == pytest.approx(channels[box["start_ns"]] + 0.5, abs=0.5)
    press(page, "l")
    told(page, SENTENCE)
    press(page, "c")
    assert {box["what"] for box in page.evaluate(f"{LINE}.boxes()")} >= {"sent", "received"}
    page.wait_for_function("() => !location.hash.includes('channels')")


def test_a_loss_is_found_once_and_for_one_robot_only_if_it_is_its(page: Any):
    press(page, "ArrowDown", "r")  # only what is of this robot
    told(page, "Finding only what is of robot 0")
    press(page, "l")
    told(page, SENTENCE)
    press(page, "l")
    told(page, "17.98")
    press(page, "l")
    told(page, "No further lost frame of robot 0.")


def test_the_lost_part_is_hatched_and_the_rest_is_not(page: Any):
    look(page, LOST - 50_000, LOST + 450_000)
    [box] = [each for each in page.evaluate(f"{LINE}.boxes()") if each["kind"] == "DM1" and each["what"] == "received"]
    _, y = page.evaluate(f"box => {LINE}.place(box)", box)
    from_ns, to_ns, width_px = window(page)
    top = page.locator(".tl-overlay").bounding_box()["y"]

    def colours(at_ns: int) -> set[str]:
        found: list[str] = page.evaluate(
            """([x, y]) => {
              const { data } = document.querySelector(".tl-content").getContext("2d").getImageData(x - 3, y, 7, 1);
              return [...Array(7).keys()].map((at) => [...data.slice(4 * at, 4 * at + 3)].join(" "));
            }""",
            [round((at_ns - from_ns) / (to_ns - from_ns) * width_px), round(y - top) + 4],
        )
        return set(found)

    assert len(colours(LOST + 36_000)) == 1  # the access code
    assert colours(LOST + 36_000) == colours(LOST + 100_000)  # the header
    assert len(colours(LOST + 300_000)) > 1  # the payload


COMMON = """async (links) => {
  const { paint_common } = await import("/static/timeline/piconets.js");
  const filled = [], answer = { from_ns: 0, blocks: new Map() };
  const drawn = links.map(([master, member, from_ns, to_ns], row) => {
    answer.blocks.set(row, { starts: [from_ns], durations: [to_ns - from_ns], rows: [row], codes: [0], outcomes: [0] });
    return [{ lane: { lane: row, what: "piconet", robot: master, stacked: member } }, answer, 0, 0, 10 * row, 0, 8];
  });
  const kinds = { name: () => "slave", role: () => "slave", paint: { ink: "black" } };
  const axis = { place: (time_ns) => time_ns, ns_per_px: 1 };
  paint_common({ fillRect: (...box) => filled.push(box) }, kinds, axis, drawn);
  return filled;
}"""
"""What is filled on strips of links (master, member, from, to), ten pixels a row, a pixel a nanosecond."""


def test_strips_show_who_is_in_two_piconets_at_once_and_where_a_link_changes_its_roles(page: Any):
    bridge = [[0, 1, 0, 100], [2, 1, 60, 200], [3, 4, 0, 200], [2, 5, 0, 50], [5, 6, 40, 90]]
    marks = page.evaluate(COMMON, bridge)
    assert sorted(marks) == [[40, 30, 10, 2.5], [60, 0, 40, 2.5], [60, 10, 40, 2.5]]  # a member elsewhere a master, too
    assert page.evaluate(COMMON, [[0, 1, 0, 100], [1, 0, 100, 200], [1, 0, 300, 400]]) == [[99, 0, 2, 18]]


# ---------------------------------------------------------------- for everybody


@pytest.mark.parametrize(("size", "scheme"), each_value(SIZES, ["light", "dark"]))
def test_axe_finds_nothing(browser: Browser, served: Served, size: tuple[int, int], scheme: str):
    with tab(browser, served, scheme=scheme) as page:
        usual = page.viewport_size
        page.set_viewport_size({"width": size[0], "height": size[1]})
        page.wait_for_selector("#timeline:not([hidden])")
        settled(page)
        page.evaluate(axe())
        assert page.evaluate(GRAVE) == []
        for part in ("aside", "#robots", "#events", ".tl-foot"):  # what has something to say has room for it
            assert page.locator(part).bounding_box()["height"] > 15, part
        press(page, "l")
        told(page, SENTENCE)
        press(page, "m", "1")
        before = page.inner_text(".tl-status")
        press(page, "n")
        page.wait_for_function("before => document.querySelector('.tl-status').innerText !== before", arg=before)
        press(page, "2")
        page.wait_for_selector(".tl-region td")
        page.evaluate("document.querySelectorAll('.tl-side details').forEach((each) => { each.open = true })")
        page.wait_for_selector(".tl-listing td")
        assert page.evaluate(GRAVE) == []
        scrolled = page.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]")
        assert scrolled == [*size]
        assert page.locator("aside").bounding_box()["height"] > 200  # lists have room, if only below all else
        page.set_viewport_size(usual)


RINGED = """() => {
  const button = document.activeElement, bar = button.closest(".tl-bar").getBoundingClientRect();
  const box = button.getBoundingClientRect(), style = getComputedStyle(button);
  const ring = parseFloat(style.outlineWidth) + parseFloat(style.outlineOffset);
  const inside = box.left - ring >= 0 && box.right + ring <= innerWidth
    && box.top - ring >= bar.top && box.bottom + ring <= bar.bottom;
  const top = document.elementFromPoint((box.left + box.right) / 2, (box.top + box.bottom) / 2);
  return [button.id, ring > 1, innerWidth > 800 || inside, top === button];
}"""
"""Which button has the focus, if it has a ring, if a bar that scrolls shows all of it, and if nothing covers it."""


@pytest.mark.parametrize("size", SIZES)
def test_each_button_is_seen_whole_when_the_keyboard_comes_to_it(page: Any, size: tuple[int, int]):
    usual = page.viewport_size
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.locator("#tl-in").focus()
    shown = page.evaluate("[...document.querySelectorAll('.tl-bar button')].filter((each) => each.offsetParent).length")
    page.keyboard.press("End")
    reached = [page.evaluate(RINGED)]
    for _ in range(shown - 1):
        page.keyboard.press("ArrowLeft")
        reached.append(page.evaluate(RINGED))
    assert len({button for button, *_ in reached}) == shown > 20
    assert reached[-1][0] == "tl-in"
    assert [each for each in reached if each[1:] != [True, True, True]] == []
    page.set_viewport_size(usual)


def test_the_buttons_are_one_stop_and_arrows_lead_from_one_to_the_next(page: Any):
    page.locator("#tl-in").focus()
    reached = [page.evaluate("document.activeElement.id")]
    for _ in range(40):
        page.keyboard.press("ArrowRight")
        reached.append(page.evaluate("document.activeElement.id"))
    assert len(set(reached)) == page.locator(".tl-bar button").count()
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Tab")
    assert not page.evaluate("document.activeElement.closest('.tl-bar')")
    page.keyboard.press("Shift+Tab")
    assert page.evaluate("document.activeElement.id") == reached[1]


def test_the_table_tells_what_is_in_the_window(page: Any, drawn: Any):
    begin = LOST - 50 * SLOT
    look(page, begin, begin + 100 * SLOT)
    page.locator("summary", has_text="Table of the window").click()
    page.wait_for_selector(".tl-listing td")
    rows = page.locator(".tl-listing tbody tr").all_inner_texts()
    expected = [row for row in drawn[1] if row.start + row.duration >= begin and row.start < begin + 100 * SLOT]
    assert sum("POLL" in row or "NULL" in row or "DM1" in row for row in rows) == 2 * len(expected)
    assert any("bit errors" in row and f"{LOST / S:.6f}" in row for row in rows)
    press(page, "0")
    page.wait_for_timeout(600)
    assert page.locator(".tl-listing tbody tr").count() <= 220


def test_the_address_leads_to_the_same_window(page: Any):
    press(page, "l")
    told(page, SENTENCE)
    page.wait_for_function("() => location.hash.includes('span')")
    page.wait_for_timeout(700)
    shown = window(page)
    address = page.url
    page.goto("about:blank")
    page.goto(address)
    page.wait_for_selector("#timeline:not([hidden])")
    assert window(page)[:2] == pytest.approx(shown[:2], abs=1)


def test_the_timeline_can_have_most_of_the_page(page: Any):
    usual = page.locator("#timeline").bounding_box()["height"]
    page.click("#tl-tall")
    assert page.locator("#timeline").bounding_box()["height"] > 1.5 * usual
    page.click("#tl-tall")
    assert page.locator("#timeline").bounding_box()["height"] == usual
    page.locator(".tl-grip").press("ArrowUp")
    assert page.locator("#timeline").bounding_box()["height"] > usual
    page.locator(".tl-grip").press("ArrowDown")
    grip = page.locator(".tl-grip").bounding_box()
    page.mouse.move(grip["x"] + 400, grip["y"] + 4)
    page.mouse.down()
    page.mouse.move(grip["x"] + 400, grip["y"] - 96, steps=3)
    page.mouse.up()
    assert page.locator("#timeline").bounding_box()["height"] == pytest.approx(usual + 100, abs=6)


# ---------------------------------------------------------------- under way


def test_a_run_under_way_is_followed_until_one_looks_elsewhere(browser: Browser):
    plain = PLAIN | {"protocol": {"use": "tests.web.console:SPEC", "parameters": {"calls": 1000}}, "duration_s": 1000}
    session = Live(Scenario.model_validate(plain), 1, True, 20.0)
    served = Served(session)
    with tab(browser, served) as page:
        page.wait_for_selector("#timeline:not([hidden])")
        page.wait_for_function(f"() => {LINE}.window().from_ns > 2e9")
        before = page.evaluate(f"{LINE}.window()")
        assert before["to_ns"] - before["from_ns"] == pytest.approx(10e9)
        page.locator(".tl-overlay").press("a")
        moved = page.evaluate(f"{LINE}.window().from_ns")
        page.wait_for_timeout(500)
        assert page.evaluate(f"{LINE}.window().from_ns") == moved
        page.wait_for_function(f"() => {LINE}.boxes().length > 0")
        assert {box["kind"] for box in page.evaluate(f"{LINE}.boxes()") if box["what"] == "sent"} == {"IDEAL"}
        page.click("#tl-follow")
        page.wait_for_function(f"from => {LINE}.window().from_ns > from + 5e9", arg=moved)
    served.stop()
    session.close()


def test_a_run_under_way_has_the_boxes_that_its_trace_would_have(browser: Browser):
    scenario = Scenario.model_validate(PLAIN | {"duration_s": 5})
    run = Simulation(scenario, 1, (FRAMES,))
    run.begin()
    run.advance(5 * S)
    columns = run.trace.columns("frames")
    rows = set(zip(columns["time_ns"], columns["source"], columns["duration_ns"], strict=True))
    session = Live(scenario, 1, True, 10.0)
    served = Served(session)
    with tab(browser, served) as page:
        page.wait_for_function("() => document.getElementById('state').textContent === 'ended'")
        press(page, "0")
        page.wait_for_timeout(500)
        sent = [box for box in page.evaluate(f"{LINE}.boxes()") if box["what"] == "sent"]
        assert {(box["start_ns"], box["robot"], box["end_ns"] - box["start_ns"]) for box in sent} == rows
        assert len(sent) == len(rows) == 9
    served.stop()
    session.close()


def test_who_wants_less_motion_gets_pages_that_are_turned(browser: Browser):
    plain = PLAIN | {"protocol": {"use": "tests.web.console:SPEC", "parameters": {"calls": 1000}}, "duration_s": 1000}
    session = Live(Scenario.model_validate(plain), 1, True, 20.0)
    served = Served(session)
    with tab(browser, served, own=True) as page:
        page.emulate_media(reduced_motion="reduce")
        page.wait_for_selector("#timeline:not([hidden])")
        page.wait_for_function(f"() => {LINE}.window().from_ns > 0")
        begins = set()
        for _ in range(40):
            begins.add(page.evaluate(f"{LINE}.window().from_ns"))
            page.wait_for_timeout(25)
        pages = sorted(begins)
        assert len(pages) > 1
        assert all(later - page > 7e9 for page, later in pairwise(pages))  # of 10 s
    served.stop()
    session.close()
