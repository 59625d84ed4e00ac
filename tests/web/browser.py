"""The browser of the pages' tests: Debian's Chromium, driven by Playwright."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from tests.web.served import Served


def find_chromium() -> str:
    """Return the program; skip the test, or in CI fail it, if there is none."""
    found = shutil.which("chromium")
    if found is None:
        if os.environ.get("CI"):
            pytest.fail("CI has no chromium")
        pytest.skip("there is no chromium here (Debian: apt-get install chromium)")
    return found


@contextmanager
def chromium() -> Iterator[Any]:
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
        yield browser
        browser.close()


@contextmanager
def tab(browser: Any, served: Served, **more: Any) -> Iterator[Any]:
    """Open a page of *served* in a profile of its own; afterwards nothing may have gone wrong in it."""
    context = browser.new_context(**({"viewport": {"width": 1366, "height": 768}} | more))
    page = context.new_page()
    page.set_default_timeout(60_000)
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", lambda told: faults.append(told.text) if told.type == "error" else None)
    page.on("request", lambda asked: faults.append(asked.url) if not asked.url.startswith(own) else None)
    own = (served.address, "data:")
    page.goto(served.address)
    page.wait_for_function("() => document.title !== 'cosim'")
    page.faults = faults
    yield page
    context.close()
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
