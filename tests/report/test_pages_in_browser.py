"""The pages of reports in a browser: light and dark, on a laptop and a phone, by keys, on paper, without a script."""

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cosim.report.reproduction import Reproduction
from tests.checkout import DATA
from tests.report.sheets import written
from tests.web.browser import GRAVE, Browser, axe

pytestmark = pytest.mark.slow

LAPTOP, PHONE = (1280, 720), (390, 844)


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a page with failures, figures and all verdicts, and the index over it."""
    folder = tmp_path_factory.mktemp("pages")
    shutil.copy(DATA / "delays.py", folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.delitem(sys.modules, "delays", raising=False)
        patch.chdir(folder)
        patch.syspath_prepend(folder)
        written(folder / "delays", parameters={"size": 1, "broken": 4}, sweep={"size": [2, 3, 4]})
        found = Reproduction(("delays",), folder / "out", True, 1)
        assert not found.make("delays", lambda *_: None).error
    return folder / "out"


@pytest.fixture
def opened(browser: Browser, pages: Path, name: str, size: tuple[int, int], scheme: Any) -> Iterator[Any]:
    """Open a page; afterwards nothing may have been asked for or gone wrong."""
    page = browser.open()
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", lambda told: faults.append(told.text) if told.type == "error" else None)
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.emulate_media(color_scheme=scheme)
    page.goto((pages / name).as_uri())
    page.on("request", lambda asked: faults.append(asked.url))
    yield page
    page.context.close()
    assert not faults


@pytest.mark.parametrize("name", ["delays.html", "index.html"])
@pytest.mark.parametrize(("size", "scheme"), [(LAPTOP, "light"), (PHONE, "dark")], ids=["laptop", "phone"])
def test_axe_finds_nothing_and_nothing_is_wider_than_the_window(opened: Any, name: str):
    opened.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
    opened.evaluate(axe())
    assert opened.evaluate(GRAVE) == []
    assert opened.evaluate("document.documentElement.scrollWidth <= innerWidth")


@pytest.mark.parametrize(("name", "size", "scheme"), [("delays.html", PHONE, "light")])
def test_keys_reach_the_contents_and_the_numbers_of_a_figure(opened: Any):
    opened.keyboard.press("Tab")
    assert opened.evaluate("document.activeElement.textContent") == "To the contents"
    opened.keyboard.press("Enter")
    assert opened.evaluate("document.activeElement.id") == "contents"
    for _ in range(40):
        opened.keyboard.press("Tab")
        if opened.evaluate("document.activeElement.tagName") == "SUMMARY":
            break
    opened.keyboard.press("Enter")
    assert opened.is_visible("figure details table")


TEXT = """() => {
  const text = document.querySelector("figure svg text");
  const ground = getComputedStyle(document.body).backgroundColor;
  return [getComputedStyle(text).fill, getComputedStyle(document.body).color, ground];
}"""


@pytest.mark.parametrize(("name", "size"), [("delays.html", LAPTOP)])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_figure_has_the_colours_of_its_page_and_paper_is_white(opened: Any, scheme: str):
    fill, ink, ground = opened.evaluate(TEXT)
    assert fill == ink
    assert (ground == "rgb(255, 255, 255)") == (scheme == "light")
    opened.emulate_media(media="print", color_scheme=scheme)
    assert opened.evaluate(TEXT) == ["rgb(0, 0, 0)", "rgb(0, 0, 0)", "rgb(255, 255, 255)"]
