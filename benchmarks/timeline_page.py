"""How smoothly the timeline of a trace is panned and zoomed in Chromium, without a window or a graphics processor.

    python -m benchmarks.timeline_page FOLDER

FOLDER holds the tables of a run, as ``cosim run --trace FOLDER`` writes them. Of the page at 1920 x 1080 it tells the
time from picture to picture while something moves in each (median, and what 95 % keep to), the time from a change of
the window to its complete picture, and how many pictures had a part of which nothing was known.
"""

import argparse
import os
import shutil
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from statistics import median, quantiles
from typing import Any

import uvicorn

from cosim.web.guard import HOST
from cosim.web.recorded import Recorded
from cosim.web.server import Server, config, listening

SIZE = {"width": 1920, "height": 1080}
PICTURES = 240
VIEWS = 100
DRIVE = """async ([pictures, views]) => {
  const { timeline } = document.getElementById("timeline");
  const lanes = document.querySelector(".tl-overlay");
  const box = lanes.getBoundingClientRect();
  const picture = () => new Promise(requestAnimationFrame);
  const turn = (deltaY, shiftKey, at) => lanes.dispatchEvent(new WheelEvent("wheel", {
    deltaY, shiftKey, clientX: box.left + at * box.width, clientY: box.top + 10, cancelable: true, bubbles: true,
  }));
  let seed = 1;
  const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
  const complete = async () => { while (!timeline.complete()) await picture(); };
  const moved = async (act) => {
    const spent = [];
    let before = await picture();
    for (let number = 0; number < pictures; number += 1) {
      act(number);
      const now = await picture();
      spent.push(now - before);
      before = now;
    }
    await complete();
    return spent;
  };
  const answers = { panned: [], zoomed: [], views: [], blank: 0 };
  const blank = timeline.blank();
  for (const into of [0, 1200, 2400]) {
    turn(1e5, false, 0.5); // the whole run
    turn(-into, false, 0.4);
    await complete();
    answers.panned.push(...await moved((number) => turn(number % 120 < 60 ? 35 : -35, true, 0.5)));
  }
  turn(1e5, false, 0.5);
  await complete();
  answers.zoomed.push(...await moved((number) => turn(number % 160 < 80 ? -70 : 70, false, 0.3 + 0.4 * random())));
  for (let number = 0; number < views; number += 1) {
    const began = performance.now();
    const kind = random();
    if (kind < 0.4) turn((random() < 0.5 ? -1 : 1) * box.width * (0.3 + random()), true, 0.5);
    else turn((random() < 0.62 ? -1 : 1) * (150 + 700 * random()), false, random());
    await picture();
    await complete();
    answers.views.push(performance.now() - began);
  }
  answers.blank = timeline.blank() - blank;
  return answers;
}"""


@contextmanager
def browsing() -> Iterator[Any]:
    """Run Chromium without a window, and give an empty page of it."""
    from playwright.sync_api import sync_playwright

    flags = ["--disable-gpu"] + (["--no-sandbox"] if os.geteuid() == 0 else [])
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=flags)
        yield browser.new_context(viewport=SIZE).new_page()  # type: ignore[arg-type]
        browser.close()


def measured(address: str) -> tuple[dict[str, Any], float]:
    """Return what the page at *address* took (ms), and the time to its first complete picture (s)."""
    with browsing() as page:
        began = time.perf_counter()
        page.goto(address)
        page.wait_for_selector("#timeline:not([hidden])")
        page.wait_for_function("() => document.getElementById('timeline').timeline.complete()")
        first_s = time.perf_counter() - began
        page.evaluate("document.getElementById('tl-tall').click()")  # twenty lanes are to be seen
        page.wait_for_timeout(500)
        found: dict[str, Any] = page.evaluate(DRIVE, [PICTURES, VIEWS])
    return found, first_s


def main(words: Sequence[str] | None = None) -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    asked = parser.parse_args(words)
    began = time.perf_counter()
    session = Recorded(asked.folder, playing=False)
    opened_s = time.perf_counter() - began
    listener = listening(0)
    port = listener.getsockname()[1]
    server = uvicorn.Server(config(Server(session).app(port)))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    thread.start()
    found, first_s = measured(f"http://{HOST}:{port}/")
    server.should_exit = True
    thread.join(10)
    print(f"opened in {opened_s:.1f} s, first complete picture {first_s:.2f} s after the request; ", end="")
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for name, meaning in (
        ("panned", "from picture to picture, panned"),
        ("zoomed", "from picture to picture, zoomed"),
        ("views", "from a change to its complete picture"),
    ):
        spent = found[name]
        print(
            f"{meaning:40} median {median(spent):6.1f} ms   95 % {quantiles(spent, n=20)[-1]:6.1f} ms   n {len(spent)}"
        )
    print(f"{'pictures with a blank part':40} {found['blank']}")


if __name__ == "__main__":
    sys.exit(main())
