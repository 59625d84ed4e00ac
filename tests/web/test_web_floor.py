"""The floor as its users meet it: colours for all eyes, layers, what the address keeps, ranges; a run begun anew."""

import json
import re
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.channels.propagation import Propagation, PropagationSettings
from cosim.errors import UserError
from cosim.geometry.segments import segment_grid
from cosim.randomness import Streams
from cosim.scenario import Scenario
from cosim.simulation import Simulation
from cosim.trace import TABLES
from cosim.web.anew import Anew
from cosim.web.live import Live
from cosim.web.messages import Again, parsed
from cosim.web.reach import reach
from cosim.web.recorded import Recorded
from cosim.web.scenes import scene_of, write_scene
from cosim.web.server import STATIC
from tests.web.browser import GRAVE, LABELS, Browser, axe, pixels, tab
from tests.web.console import PLAIN
from tests.web.served import Served, next_of
from tests.web.test_web_live import Page

# ---------------------------------------------------------------- colours

EYES = {
    "usual": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]],
}
"""What eyes make of linear RGB (Machado, Oliveira and Fernandes 2009, table 1, severity 1.0)."""
TO_XYZ = [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.072175], [0.0193339, 0.119192, 0.9503041]]
WHITE = np.sum(TO_XYZ, axis=1)


def colours(scheme: str) -> dict[str, np.ndarray[Any, Any]]:
    """Return the pages' colours as linear RGB."""
    light, dark = (STATIC / "common.css").read_text(encoding="utf-8").split("@media (prefers-color-scheme: dark)")
    found = re.findall(r"--([a-z]+(?:-\d+)?): #([0-9a-f]{6});", {"light": light, "dark": dark}[scheme])
    encoded = {name: np.array([int(text[at : at + 2], 16) for at in (0, 2, 4)]) / 255 for name, text in found}
    return {name: np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) for name, c in encoded.items()}


def lab(linear: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Return CIELAB."""
    ratio = np.array(TO_XYZ) @ np.clip(linear, 0, 1) / WHITE
    f = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio * (29 / 6) ** 2 / 3 + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("eyes", EYES)
def test_ten_robots_have_colours_that_differ_for_all_eyes(scheme: str, eyes: str):
    robots = [colours(scheme)[f"robot-{number}"] for number in range(10)]
    seen = [lab(np.array(EYES[eyes]) @ colour) for colour in robots]
    assert min(np.linalg.norm(one - other) for one, other in combinations(seen, 2)) > 9  # 2.3 is just noticeable


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_robots_stand_out_from_the_floor(scheme: str):
    known = colours(scheme)
    luminance = {name: float(np.dot(TO_XYZ[1], colour)) + 0.05 for name, colour in known.items()}
    for number in range(10):
        for ground in ("floor", "paper"):
            dark, light = sorted((luminance[f"robot-{number}"], luminance[ground]))
            assert light / dark >= 3.0  # WCAG 2.2, 1.4.11


# ---------------------------------------------------------------- ranges

WALLS = [[4.6, 0, 4.6, 5], [7, 2, 9, 6], [0, 7, 12, 7]]


def scene(channel: dict[str, Any], **team: Any) -> dict[str, Any]:
    floor = {"map": "walls", "bounds_m": [0, 0, 12, 8], "walls": WALLS}
    scenario = Scenario.model_validate(PLAIN | {"channel": channel, "floorplan": floor, "team": PLAIN["team"] | team})
    return scene_of(scenario, Simulation(scenario, 1).floorplan, 1)


def places_of(shown: dict[str, Any]) -> np.ndarray[Any, Any]:
    """Return the middles of the cells of a map, (cells, 2)."""
    (x, y), cell = shown["corner_m"], shown["cell_m"]
    across, up = x + cell * (np.arange(shown["columns"]) + 0.5), y + cell * (np.arange(shown["rows"]) + 0.5)
    return np.stack([np.tile(across, len(up)), np.repeat(up, len(across))], axis=1)


def test_the_map_of_a_range_is_what_the_law_of_the_channel_says():
    law = {"model": "log_distance", "exponent": 2.7}
    told = scene({"kind": "adhoc", "propagation": law, "power_dbm": 7.0, "detection_dbm": -82.0})
    (shown,) = reach(told, 1, (3.1, 2.2))["radios"]
    propagation = Propagation(
        PropagationSettings.model_validate(law),
        segment_grid(told["walls_m"]),
        told["wall_losses_db"],
        Streams(1).draws("x"),
    )
    places = places_of(shown)
    assert len(places) == len(shown["power_dbm"]) > 2000
    chosen = np.random.default_rng(3).choice(len(places), 60, replace=False)
    gains = propagation.gains_db(np.vstack([[3.1, 2.2], places[chosen]]))[0, 1:]
    assert np.array(shown["power_dbm"])[chosen] == pytest.approx(7.0 + gains, abs=0.51)
    assert shown["faintest_dbm"] == -82.0
    assert min(shown["power_dbm"]) < max(shown["power_dbm"]) - 40


def test_bluetooth_is_heard_down_to_its_sensitivity():
    law = {"model": "free_space"}
    told = scene({"kind": "bluetooth", "propagation": law, "power_class": 1, "sensitivity_dbm": -75.0})
    (shown,) = reach(told, 0, (1.0, 1.0))["radios"]
    assert shown["faintest_dbm"] == -75.0
    near = np.argmin(np.hypot(*(places_of(shown) - [1.0, 1.0]).T))
    far = np.hypot(*(places_of(shown)[near] - [1.0, 1.0]))
    assert shown["power_dbm"][near] == pytest.approx(20.0 - 40.2 - 20 * np.log10(max(far, 0.1)), abs=0.51)


def test_light_ends_at_walls_and_where_one_sees_no_farther():
    (shown,) = reach(scene({"kind": "optical", "range_m": 5.0}), 0, (3.0, 3.0))["radios"]
    places = places_of(shown)
    heard = np.array(shown["power_dbm"]) >= shown["faintest_dbm"]
    far = np.hypot(*(places - [3.0, 3.0]).T)
    assert not heard[far > 5.0].any()
    assert heard[(far < 5.0) & (places[:, 0] < 3.9) & (places[:, 1] < 6.9)].all()
    assert not heard[(places[:, 0] > 4.7) & (places[:, 1] < 3.0)].any()  # behind the first wall


def test_a_reach_is_a_disc_of_that_radius():
    told = scene({"kind": "ideal", "range_m": 4.0}, groups=[{"size": 1, "reach_m": 6.0}, {"size": 2}])
    assert [reach(told, robot, (1, 1))["radios"][0]["range_m"] for robot in range(3)] == [6.0, 4.0, 4.0]
    told = scene({"kind": "ideal"})
    assert reach(told, 0, (1, 1))["radios"] == [{"radio": 0, "kind": "ideal", "range_m": None}]


def test_a_robot_has_the_ranges_of_its_own_radios():
    radios = [{"kind": "adhoc", "range_m": 5}, {"kind": "ideal", "range_m": 9}]
    team = {"groups": [{"size": 1, "radios": [0, 1]}, {"size": 2, "radios": [0]}]}
    told = scene({"kind": "radios", "radios": radios}, **team)
    ranges = [[(each["radio"], each["range_m"]) for each in reach(told, robot, (1, 1))["radios"]] for robot in (0, 2)]
    assert ranges == [[(0, 5.0), (1, 9.0)], [(0, 5.0)]]


def test_a_page_is_answered_how_far_a_robot_is_heard(folder: Path):
    served = Served(Recorded(folder, playing=False))
    with served.connect() as page, served.connect() as other:
        page.send('{"say": "reach", "robot": 1, "x_m": 3, "y_m": 2}')
        answer = next_of(page, "reach")
        assert (answer["robot"], answer["place_m"]) == (1, [3, 2])
        page.send('{"say": "reach", "robot": 9, "x_m": 3, "y_m": 2}')
        assert "there is no robot 9" in next_of(page, "error")["why"]
        assert all(json.loads(other.recv(timeout=60))["say"] in ("scene", "lanes", "now") for _ in range(2))
    served.stop()


# ---------------------------------------------------------------- begin anew


@pytest.fixture
def again() -> Iterator[Anew]:
    short = PLAIN | {"duration_s": 1}
    session = Anew(lambda: Live(Scenario.model_validate(short), 1, True, 2.0))
    yield session
    session.close()


def test_a_run_that_has_ended_begins_anew(again: Anew):
    page = Page(again)  # type: ignore[arg-type]
    page.until(lambda message: message["say"] == "ended")
    again.wish(Again(say="again"))
    assert [message["say"] for message in page.look()] == ["again"]
    fresh = Page(again)  # type: ignore[arg-type]
    fresh.until(lambda message: message["say"] == "ended")
    assert fresh.of("now")[0]["time_s"] < 1.0
    assert fresh.of("ended") == page.of("ended")
    assert again.scene["again"]


def test_a_run_that_has_not_ended_does_not_begin_anew(folder: Path):
    still = Anew(lambda: Live(Scenario.model_validate(PLAIN), 1, playing=False))
    with pytest.raises(UserError, match="has not ended"):
        still.wish(Again(say="again"))
    still.close()
    with pytest.raises(UserError, match="recorded"):
        Recorded(folder).wish(Again(say="again"))
    assert parsed('{"say": "again"}') == Again(say="again")


@pytest.mark.slow
def test_the_button_begins_the_run_anew(browser: Browser, again: Anew):
    served = Served(again)
    with tab(browser, served) as page:
        page.wait_for_function("() => document.getElementById('play').ariaLabel === 'Begin anew'")
        assert page.inner_text("#state") == "ended"
        page.evaluate(  # the run may be over before the browser is asked
            """() => {
                const play = document.getElementById("play");
                window.labels = [];
                new MutationObserver(() => window.labels.push(play.ariaLabel)).observe(play, { attributes: true });
            }"""
        )
        page.click("#play")
        page.wait_for_function("() => window.labels.some((label) => label !== 'Begin anew')")
        page.wait_for_function("() => document.getElementById('play').ariaLabel === 'Begin anew'")
    served.stop()


# ---------------------------------------------------------------- what the address keeps


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the trace of a run of twelve robots with a jammer, one of which is killed."""
    folder = tmp_path_factory.mktemp("floor")
    faults: list[dict[str, Any]] = [
        {"kind": "kill", "robot": 2, "at_s": 2.0},
        {"kind": "frozen", "robot": 1, "at_s": 1.0, "for_s": 3.0},
        {"kind": "jammer", "x_m": 6.0, "y_m": 6.0, "at_s": 1.0, "for_s": 3.0},
    ]
    channel = {"kind": "adhoc", "range_m": 6.0}
    plain = PLAIN | {"faults": faults, "channel": channel, "team": PLAIN["team"] | {"size": 4}}
    plain |= {"protocol": {"use": "tests.web.console:SPEC", "parameters": {"calls": 5}}}
    scenario = Scenario.model_validate(plain)
    run = Simulation(scenario, 1, tuple(TABLES.values()))
    outcome = run.run()
    outcome.trace.write(folder)
    write_scene(scene_of(scenario, run.floorplan, 1), folder)
    return folder


@pytest.fixture
def opened(browser: Browser, folder: Path) -> Iterator[Any]:
    served = Served(Recorded(folder, playing=False))
    with tab(browser, served, own=True) as page:
        page.address = served.address
        yield page
    served.stop()


def until(page: Any, condition: str) -> None:
    page.wait_for_function(f"() => {condition}")


@pytest.mark.slow
def test_the_address_keeps_what_is_shown_and_a_reload_restores_it(opened: Any):
    page = opened
    page.click("#robots button >> nth=1")
    page.locator("#legend button[data-layer=trails]").click()
    page.locator("#legend button[data-layer=ranges]").click()
    page.select_option("#trail", "30")
    for _ in range(3):
        page.click("#zoom-in")
    page.locator("#scrub").fill("2.25")
    page.select_option("#kind", "Marked")
    until(page, "['t=2.25', 'kind=Marked', 'lane='].every((word) => location.hash.includes(word))")
    kept = dict(word.split("=") for word in page.evaluate("location.hash.slice(1)").split("&"))
    assert kept["robot"] == "1"
    assert kept["layers"] == "links,frames,ranges,routes,marks,jammers,names,maps,ways,estimates"
    assert (kept["trail"], kept["zoom"], kept["kind"]) == ("30", "2.744", "Marked")
    page.click("#start")
    until(page, "document.getElementById('time').textContent.startsWith('0.0')")
    page.goto("about:blank")
    page.goto(page.address + "#" + "&".join(f"{name}={value}" for name, value in kept.items()))
    until(page, "document.getElementById('time').textContent.startsWith('2.25')")
    assert page.get_attribute("#robots button >> nth=1", "aria-pressed") == "true"
    assert page.get_attribute("#legend button[data-layer=trails]", "aria-pressed") == "false"
    assert page.get_attribute("#legend button[data-layer=ranges]", "aria-pressed") == "true"
    assert page.input_value("#trail") == "30"
    assert page.input_value("#kind") == "Marked"
    assert set(page.locator("#events li :is(b, button)").all_inner_texts()) == {"Marked"}
    page.wait_for_timeout(500)
    again = dict(word.split("=") for word in page.evaluate("location.hash.slice(1)").split("&"))
    assert again == kept


@pytest.mark.slow
def test_an_address_that_means_nothing_shows_all_as_usual(opened: Any):
    page = opened
    page.goto("about:blank")
    page.goto(page.address + "#t=x&robot=77&layers=trails,nonsense&zoom=-3&at=1&trail=5&kind=Nothing")
    until(page, "document.querySelector('#robots button')")
    assert page.locator("#robots [aria-pressed=true]").count() == 0
    assert page.input_value("#trail") == "120"
    assert page.get_attribute("#legend button[data-layer=trails]", "aria-pressed") == "true"


@pytest.mark.slow
def test_a_layer_that_is_off_is_not_painted(opened: Any):
    page = opened
    page.locator("#scrub").fill("1.2")
    until(page, "cosim.seen().frames.length > 0")
    page.locator("#legend button[data-layer=frames]").focus()
    page.keyboard.press("Enter")
    until(page, "cosim.seen().frames.length === 0")
    assert page.evaluate("document.activeElement.dataset.layer") == "frames"  # it is another button, in its place
    page.evaluate(LABELS)
    page.locator("#legend button[data-layer=jammers]").click()
    page.locator("#legend button[data-layer=names]").click()
    page.wait_for_timeout(200)
    page.evaluate("window.labels = {}")
    page.locator("#legend button[data-layer=jammers]").click()
    until(page, "window.labels['jammer constant'] && window.labels.frozen")
    assert page.evaluate("window.labels[0]") is None


@pytest.mark.slow
def test_the_legend_names_what_this_run_has(opened: Any):
    page = opened
    entries = page.inner_text("#legend")
    assert "jammers" not in entries
    assert "goals" not in entries
    page.locator("#scrub").fill("2.5")
    until(page, "/jammers/.test(document.getElementById('legend').textContent)")
    entries = page.inner_text("#legend")
    assert "events" in entries
    assert "ghosts" not in entries
    assert "routes" not in entries
    assert "empty if dead" in entries


@pytest.mark.slow
def test_a_robot_is_followed_by_the_keyboard(opened: Any):
    page = opened
    page.evaluate(LABELS)
    page.click("#robots button >> nth=2")
    page.locator("#floor").focus()
    page.keyboard.press("f")
    until(page, "document.getElementById('follow').ariaPressed === 'true'")
    page.wait_for_timeout(200)
    box = page.locator("#floor").bounding_box()
    x, y = page.evaluate("window.labels[2]")
    assert abs(x - box["width"] / 2) < 60
    assert abs(y - box["height"] / 2) < 60
    page.keyboard.press("Shift+ArrowLeft")
    until(page, "document.getElementById('follow').ariaPressed === 'false'")


@pytest.mark.slow
def test_steps_by_frame_and_event_are_chosen_by_the_keyboard(opened: Any):
    page = opened
    page.select_option("#step-by", "event")
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("ArrowRight")
    until(page, "document.getElementById('time').textContent.startsWith('1.00')")
    first = page.evaluate("cosim.seen().time_s")
    page.select_option("#step-by", "frame")
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("ArrowRight")
    until(page, f"cosim.seen().time_s > {first} && cosim.seen().frames.some((f) => f.start_s === cosim.seen().time_s)")
    assert page.locator("#step-by option[value=slot]").inner_text() == "slot (20 µs)"


@pytest.mark.slow
def test_a_table_tells_what_the_canvas_shows(opened: Any):
    page = opened
    page.locator("#scrub").fill("2.5")
    until(page, "document.querySelectorAll('#floor-robots tbody tr').length === 4")
    until(page, "/does nothing/.test(document.querySelector('#floor-robots tbody').rows[2].textContent)")
    assert "frozen" in page.evaluate("document.querySelector('#floor-robots tbody').rows[1].textContent")
    assert page.get_attribute("#floor", "aria-details") == "floor-robots"


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_with_all_layers_on(browser: Browser, folder: Path, scheme: str):
    served = Served(Recorded(folder, playing=False))
    with tab(browser, served, own=True, scheme=scheme) as page:
        page.locator("#scrub").fill("2.5")
        page.click("#robots button >> nth=1")
        page.locator("#legend button[data-layer=ranges]").click()
        until(page, "document.querySelector('#legend [data-layer=jammers]')")
        page.evaluate(axe())
        assert page.evaluate(GRAVE) == []
        assert pixels(page, "robot-1") > 20
    served.stop()
