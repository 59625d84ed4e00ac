"""The browser of the pages' tests: Debian's Chromium, driven by Playwright."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files
from typing import Any, Protocol

import pytest


class Addressed(Protocol):
    """What a browser can open."""

    @property
    def address(self) -> str: ...


class Browser:
    """A browser that runs, and the tabs of it that are free: one that is used again costs half of what a new one does.

    No page stores anything that another one could find.
    """

    def __init__(self, program: Any) -> None:
        self._program = program
        self._free: list[Any] = []

    def open(self) -> Any:
        """Open a tab in a profile of its own."""
        page = self._program.new_context(viewport={"width": 1366, "height": 768}).new_page()
        page.set_default_timeout(60_000)
        return page

    def take(self) -> Any:
        return self._free.pop() if self._free else self.open()

    def give_back(self, page: Any) -> None:
        page.mouse.move(0, 0)
        page.goto("about:blank")
        self._free.append(page)


def find_chromium() -> str:
    """Return the program; skip the test, or in CI fail it, if there is none."""
    found = shutil.which("chromium")
    if found is None:
        if os.environ.get("CI"):
            pytest.fail("CI has no chromium")
        pytest.skip("there is no chromium here (Debian: apt-get install chromium)")
    return found


@contextmanager
def chromium() -> Iterator[Browser]:
    """Run the browser, without a window."""
    program = find_chromium()
    sync_api = (
        pytest.importorskip("playwright.sync_api")
        if not os.environ.get("CI")
        else __import__("playwright.sync_api", fromlist=["sync_api"])
    )
    flags = ["--no-sandbox"] if os.geteuid() == 0 else []  # it refuses to run as root inside of one
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=flags)
        yield Browser(browser)
        browser.close()


@contextmanager
def tab(
    browser: Browser, served: Addressed, own: bool = False, clock: bool = False, scheme: Any = "light"
) -> Iterator[Any]:
    """Open the page of *served*; afterwards nothing may have gone wrong in it.

    *own*: in a tab of its own, which is closed afterwards. *clock*: so too, with a clock that a test can put forward.
    """
    own = own or clock
    page = browser.open() if own else browser.take()
    faults: list[str] = []
    listeners = {
        "pageerror": lambda error: faults.append(str(error)),
        "console": lambda told: faults.append(told.text) if told.type == "error" else None,
        "request": lambda asked: faults.append(asked.url) if not asked.url.startswith(allowed) else None,
    }
    for event, listener in listeners.items():
        page.on(event, listener)
    allowed = (served.address, "data:", "about:")
    page.emulate_media(color_scheme=scheme)
    if clock:
        page.clock.install()
    page.goto(served.address)
    page.wait_for_function("() => document.querySelector('#about')?.textContent")  # the scene has come
    page.faults = faults
    try:
        yield page
    except BaseException:
        page.context.close()
        raise
    if own:
        page.context.close()
    else:
        browser.give_back(page)
    for event, listener in listeners.items():
        page.remove_listener(event, listener)
    assert not faults, faults


COLOURED = """([name, id]) => {
  const canvas = document.getElementById(id);
  const probe = document.createElement("canvas").getContext("2d");
  probe.fillStyle = getComputedStyle(document.documentElement).getPropertyValue(`--${name}`);
  probe.fillRect(0, 0, 1, 1);
  const [r, g, b] = probe.getImageData(0, 0, 1, 1).data;
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let count = 0;
  for (let at = 0; at < data.length; at += 4) {
    count += data[at] === r && data[at + 1] === g && data[at + 2] === b && data[at + 3] === 255;
  }
  return count;
}"""
"""Counts the pixels of a canvas that have one of the page's named colours."""


def pixels(page: Any, colour: str, canvas: str = "floor") -> int:
    """Return how many pixels of *canvas* have the named *colour*."""
    count: int = page.evaluate(COLOURED, [colour, canvas])
    return count


LABELS = """() => {
  window.labels = {};
  const { fillText } = CanvasRenderingContext2D.prototype;
  CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
    window.labels[text] = [x, y];
    fillText.call(this, text, x, y);
  };
}"""
"""Keeps where a page writes what on its canvases."""


def axe() -> str:
    """Return the program of axe-core, which a package of the extra dev carries."""
    try:
        return (files("axe_playwright_python") / "axe.min.js").read_text(encoding="utf-8")
    except ModuleNotFoundError:
        if os.environ.get("CI"):
            raise
        pytest.skip("axe-playwright-python is not installed")


GRAVE = """async () => {
  const rules = { "label-content-name-mismatch": { enabled: true } };
  const { violations } = await axe.run(document, { rules });
  return violations.map(({ id, impact, nodes }) => [id, impact, nodes[0].html]);
}"""
"""What axe-core finds on a page, once its program is there."""
